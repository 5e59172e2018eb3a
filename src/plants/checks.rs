//! Checks on rows that are read of a table: whether ids, words, places and measures can be what they say.

use std::borrow::Cow;
use std::ops::RangeInclusive;

use super::deadwood::Cause;
use crate::io::ParseError;
use crate::raster::{Frame, MapPoint};
use crate::species::Biome;

pub(super) const EDIT_AGAIN: &str = "correct the table, or run the stage again that made it";

/// Where the scene lies and how far it reaches.
pub(super) struct Place {
    south_west: MapPoint,
    width_m: f32,
    height_m: f32,
}

impl Place {
    pub(super) fn new(frame: &Frame) -> Self {
        let side_m = |cells: usize| (cells as f64 * frame.transform.cell_m) as f32; // rounded as positions are
        Self {
            south_west: frame.south_west(),
            width_m: side_m(frame.cols),
            height_m: side_m(frame.rows),
        }
    }

    /// Metres east and north of the corner, `None` outside the scene.
    pub(super) fn position(&self, point: [f64; 2]) -> Option<(f32, f32)> {
        self.position_within(point, 0.0)
    }

    /// Metres east and north of the corner, `None` if that is outside the scene by more than `margin_m`.
    pub(super) fn position_within(
        &self,
        [east_m, north_m]: [f64; 2],
        margin_m: f32,
    ) -> Option<(f32, f32)> {
        // the difference of two f64 holds all that f32 keeps
        let east_m = (east_m - self.south_west.east_m) as f32;
        let north_m = (north_m - self.south_west.north_m) as f32;
        let is_within = |at_m: f32, side_m: f32| (-margin_m..=side_m + margin_m).contains(&at_m);
        (is_within(east_m, self.width_m) && is_within(north_m, self.height_m))
            .then_some((east_m, north_m))
    }
}

/// Adds the ids of a run of rows; `of` says what has them.
pub(super) fn append_ids(into: &mut Vec<u64>, ids: &[i64], of: &str) -> Result<(), ParseError> {
    for id in ids {
        into.push(
            u64::try_from(*id)
                .map_err(|_| ParseError::new(format!("{of} id {id} is negative"), EDIT_AGAIN))?,
        );
    }
    Ok(())
}

/// Adds what the words of a run of rows stand for.
pub(super) fn append_words<T: Copy, W: AsRef<str>>(
    into: &mut Vec<T>,
    indices: &[u16],
    words: &[W],
    meaning: impl Fn(&str) -> Result<T, ParseError>,
) -> Result<(), ParseError> {
    let meanings =
        words.iter().map(|word| meaning(word.as_ref())).collect::<Result<Vec<T>, _>>()?;
    into.extend(indices.iter().map(|index| meanings[usize::from(*index)]));
    Ok(())
}

/// Adds the measures of a run of rows, of which all have to be `allowed`; `of` says what has them.
pub(super) fn append_reals(
    into: &mut Vec<f32>,
    numbers: &[f32],
    allowed: RangeInclusive<f32>,
    of: &str,
    name: &str,
) -> Result<(), ParseError> {
    if let Some(row) = numbers.iter().position(|number| !allowed.contains(number)) {
        let what = format!("the {of} of row {} has {name} = {}", into.len() + row, numbers[row]);
        return Err(ParseError::new(what, EDIT_AGAIN));
    }
    into.extend_from_slice(numbers);
    Ok(())
}

/// Adds the decay classes of a run of rows; `of` says what has them.
pub(super) fn append_decay_classes(
    into: &mut Vec<u8>,
    classes: &[i64],
    of: &str,
) -> Result<(), ParseError> {
    for class in classes {
        match u8::try_from(*class) {
            Ok(known @ 1..=5) => into.push(known),
            _ => {
                let what = format!("the {of} of row {} has decay_class = {class}", into.len());
                return Err(ParseError::new(what, "decay classes are 1 to 5"));
            }
        }
    }
    Ok(())
}

/// The index of a species' key in the biome.
pub(super) fn species_index(biome: &Biome, key: &str) -> Result<u16, ParseError> {
    let index = biome.species_index(key).and_then(|index| u16::try_from(index).ok());
    index.ok_or_else(|| {
        let keys: Vec<&str> = biome.species.iter().map(|species| species.key.as_str()).collect();
        ParseError::new(
            format!("`{key}` is no species of the biome {}", biome.key),
            format!("name one of {}, or the biome that has it", keys.join(", ")),
        )
    })
}

/// What is said of a word that is none of those `known`; `of` says what they are.
pub(super) fn unknown_word(word: &str, of: &str, known: &[&str]) -> ParseError {
    ParseError::new(format!("`{word}` is no {of}"), format!("name one of {}", known.join(", ")))
}

/// The cause of a name.
pub(super) fn cause(name: &str) -> Result<Cause, ParseError> {
    Cause::from_name(name)
        .ok_or_else(|| unknown_word(name, "cause of death or fall", &Cause::ALL.map(Cause::name)))
}

/// Refuses ids that two rows share; `of` says what has them.
pub(super) fn check_ids(ids: &[u64], of: &str) -> Result<(), ParseError> {
    let twice =
        |sorted: &[u64]| sorted.windows(2).find(|pair| pair[0] == pair[1]).map(|pair| pair[0]);
    let found = if ids.is_sorted() {
        twice(ids)
    } else {
        let mut sorted = ids.to_vec();
        sorted.sort_unstable();
        twice(&sorted)
    };
    found.map_or(Ok(()), |id| {
        Err(ParseError::new(format!("two {of}s have the id {id}"), EDIT_AGAIN))
    })
}

/// Refuses to write ids that most programs cannot read; `of` says what has them.
///
/// # Panics
/// If an id is 2⁶³ or more.
pub(super) fn assert_ids(mut ids: impl Iterator<Item = u64>, of: &str) {
    assert!(
        ids.all(|id| i64::try_from(id).is_ok()),
        "{of} ids stay below 2⁶³: most programs know signed whole numbers only"
    );
}

/// Keys of the biome's species, as the words of a table.
///
/// # Panics
/// If one of `species` is none of the biome's.
pub(super) fn species_words<'a>(
    mut species: impl Iterator<Item = u16>,
    biome: &'a Biome,
) -> Vec<Cow<'a, str>> {
    assert!(
        species.all(|species| usize::from(species) < biome.species.len()),
        "every species that is written is one of the biome"
    );
    biome.species.iter().map(|species| species.key.as_str().into()).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::raster::{Crs, GeoTransform};

    /// 4 × 6 km whose south-west corner is the given one.
    fn place(west_m: f64, south_m: f64) -> Place {
        let transform = GeoTransform { west_m, north_m: south_m + 4000.0, cell_m: 2.0 };
        Place::new(&Frame { rows: 2000, cols: 3000, transform, crs: Crs::Local })
    }

    #[test]
    fn margins_widen_the_scene_on_every_side() {
        let place = place(100.0, 200.0);
        for (point, is_within) in [
            ([90.0, 300.0], true),
            ([89.0, 300.0], false),
            ([6110.0, 4210.0], true),
            ([6111.0, 300.0], false),
            ([300.0, 189.0], false),
            ([300.0, 4211.0], false),
        ] {
            assert_eq!(place.position_within(point, 10.0).is_some(), is_within, "{point:?}");
            assert_eq!(place.position(point), None);
        }
        assert_eq!(place.position_within([90.0, 300.0], 10.0), Some((-10.0, 100.0)));
        assert_eq!(place.position_within([f64::NAN, 300.0], 10.0), None);
    }

    #[test]
    fn decay_classes_are_one_to_five() {
        let mut classes = vec![3];
        append_decay_classes(&mut classes, &[1, 5], "snag").unwrap();
        assert_eq!(classes, [3, 1, 5]);
        for wrong in [0, 6, -1, 257] {
            let problem = append_decay_classes(&mut classes, &[wrong], "snag").unwrap_err();
            assert!(problem.what.starts_with("the snag of row 3 has"), "{problem}");
        }
    }

    #[test]
    fn unknown_words_are_told_what_is_known() {
        assert_eq!(cause("storm"), Ok(Cause::Storm));
        let problem = cause("boredom").unwrap_err().to_string();
        assert!(
            problem.contains("`boredom` is no cause") && problem.contains("drought"),
            "{problem}"
        );
    }

    proptest! {
        #[test]
        fn positions_read_back_at_any_corner(
            west in -8e6..8e6_f64, south in -8e6..8e6_f64, east in 0.015_625..6000_f32, north in 0.015_625..4000_f32,
        ) {
            let place = place(west, south);
            let MapPoint { east_m, north_m } = place.south_west;
            let point = [east_m + f64::from(east), north_m + f64::from(north)];
            prop_assert_eq!(place.position(point), Some((east, north)));
        }

        #[test]
        fn positions_at_the_edge_read_back_within_a_nanometre(west in 4.2e6..8e6_f64, east in 0.0..0.0157_f32) {
            let place = place(west, 0.0);
            let (found, _) = place.position([west + f64::from(east), 1.0]).unwrap();
            prop_assert!((found - east).abs() <= 1e-9);
        }
    }
}
