//! A model card: what a network takes and gives, and the hash its file must have.

use serde::Deserialize;

use super::InferenceError;

/// The card's format that this program reads.
const FORMAT: i64 = 2;
/// Cell size that networks are fed, m.
pub const CELL_M: f64 = 4.0;
/// A network trained on cells as near as this serves. chosen: crowns a seventh wider or narrower are as plausible.
const MOST_CELL_MISS_FRACTION: f64 = 0.15;
/// Sides and halos beyond this are no network of ours, cells.
const MOST_CELLS: usize = 4096;

/// What is said of a network beside its weights.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Card {
    format: i64,
    /// The network's name, also of its files.
    pub name: String,
    /// SHA-256 of the file of weights, in lower-case hexadecimal.
    pub sha256: String,
    /// Cell size that it was trained on, m.
    pub cell_m: f64,
    /// Sides of a map handed to it, and its place on the lattice, are multiples of this.
    pub stride_cells: usize,
    /// Cells around a map that can change what it gives inside, and that it leaves out.
    pub halo_cells: usize,
    /// Its inputs in order, besides the noise.
    pub channels: Vec<Channel>,
}

/// One map that a network takes.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Channel {
    /// Name, as `relief`.
    pub name: String,
}

impl Card {
    /// Reads a card and checks that this program can feed its network; `place` names it in errors.
    ///
    /// # Errors
    /// If it is no card, of another format, or of a network other than `name`, with other inputs than `channels`, or for
    /// other cells than wildwood's.
    pub fn parse(
        text: &str,
        place: &str,
        name: &str,
        channels: &[&str],
    ) -> Result<Self, InferenceError> {
        let problem = |problem: String| InferenceError::Card { place: place.to_owned(), problem };
        let card: Self =
            toml::from_str(text).map_err(|e| problem(format!("no model card: {e}")))?;
        if card.format != FORMAT {
            return Err(problem(format!(
                "format {} of model cards; this wildwood reads format {FORMAT}",
                card.format
            )));
        }
        if card.name != name {
            return Err(problem(format!("the card of a network `{}`, not `{name}`", card.name)));
        }
        let names: Vec<&str> = card.channels.iter().map(|channel| channel.name.as_str()).collect();
        if names != channels {
            return Err(problem(format!(
                "its network takes {}; wildwood feeds {}",
                names.join(", "),
                channels.join(", ")
            )));
        }
        let is_side = |cells: usize| (1..=MOST_CELLS).contains(&cells);
        if !is_side(card.stride_cells) || card.halo_cells > MOST_CELLS {
            return Err(problem("stride_cells and halo_cells must be numbers of cells".to_owned()));
        }
        let missed = (card.cell_m / CELL_M - 1.0).abs();
        if !missed.is_finite() || missed > MOST_CELL_MISS_FRACTION {
            return Err(problem(format!(
                "its network is for cells of {} m; wildwood feeds cells of {CELL_M} m",
                card.cell_m
            )));
        }
        Ok(card)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
        format = 2
        name = "height"
        sha256 = "00"
        cell_m = 4.0
        stride_cells = 16
        halo_cells = 48
        date = 2026-01-01
        [[channels]]
        name = "footprint"
        meaning = "canopy"
        [[channels]]
        name = "relief"
    "#;

    #[test]
    fn a_card_is_read_with_whatever_else_it_tells() {
        let card = Card::parse(TEXT, "height.toml", "height", &["footprint", "relief"]).unwrap();
        assert_eq!((card.stride_cells, card.halo_cells, card.cell_m), (16, 48, 4.0));
    }

    #[test]
    fn what_cannot_be_fed_is_refused_by_name() {
        let error = |text: &str| {
            Card::parse(text, "height.toml", "height", &["footprint", "relief"])
                .unwrap_err()
                .to_string()
        };
        assert!(error("[[[").starts_with("height.toml: no model card"));
        assert!(error(&TEXT.replace("format = 2", "format = 1")).contains("reads format 2"));
        assert!(error(&TEXT.replace("\"relief\"", "\"slope\"")).contains("takes footprint, slope"));
        assert!(error(&TEXT.replace("stride_cells = 16", "stride_cells = 0")).contains("stride"));
        assert!(error(&TEXT.replace("cell_m = 4.0", "cell_m = nan")).contains("4 m"));
        assert!(error(&TEXT.replace("cell_m = 4.0", "cell_m = 1.0")).contains("cells of 1 m"));
        assert!(error(&TEXT.replace("\"height\"", "\"depth\"")).contains("network `depth`"));
    }
}
