//! A model card: what a network takes and gives, and the hash its file must have.

use serde::Deserialize;

use super::InferenceError;

/// The card's format that this program reads.
const FORMAT: i64 = 1;
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
    /// Cells around a map that can change what it gives inside.
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
    /// If it is no card, of another format, or of a network with other inputs than `channels`.
    pub fn parse(text: &str, place: &str, channels: &[&str]) -> Result<Self, InferenceError> {
        let problem = |problem: String| InferenceError::Card { place: place.to_owned(), problem };
        let card: Self =
            toml::from_str(text).map_err(|e| problem(format!("no model card: {e}")))?;
        if card.format != FORMAT {
            return Err(problem(format!(
                "format {} of model cards; this wildwood reads format {FORMAT}",
                card.format
            )));
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
        if !is_side(card.stride_cells) || card.halo_cells > MOST_CELLS || !card.cell_m.is_normal() {
            return Err(problem(
                "stride_cells, halo_cells and cell_m must be sizes of cells".to_owned(),
            ));
        }
        Ok(card)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
        format = 1
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
        let card = Card::parse(TEXT, "height.toml", &["footprint", "relief"]).unwrap();
        assert_eq!((card.stride_cells, card.halo_cells, card.cell_m), (16, 48, 4.0));
    }

    #[test]
    fn what_cannot_be_fed_is_refused_by_name() {
        let error = |text: &str| {
            Card::parse(text, "height.toml", &["footprint", "relief"]).unwrap_err().to_string()
        };
        assert!(error("[[[").starts_with("height.toml: no model card"));
        assert!(error(&TEXT.replace("format = 1", "format = 2")).contains("reads format 1"));
        assert!(error(&TEXT.replace("\"relief\"", "\"slope\"")).contains("takes footprint, slope"));
        assert!(error(&TEXT.replace("stride_cells = 16", "stride_cells = 0")).contains("stride"));
        assert!(error(&TEXT.replace("cell_m = 4.0", "cell_m = nan")).contains("cell_m"));
    }
}
