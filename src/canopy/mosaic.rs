//! Mosaic: small deviations of vigor from place to place, so that species whose vigor is equal share the ground in
//! patches.
//!
//! Target shares need it: on ground that is the same everywhere, such as a plain, a weight gives all or nothing.

use crate::math;
use crate::raster::Frame;
use crate::rng::{self, Key, Process};

/// Distance between the draws that deviations are drawn out from, metres. chosen: patches some crowns wide, as stands
/// of one species are.
const SPACING_M: f64 = 24.0;
/// Greatest deviation of ln vigor. chosen: 5 % of vigor, less than anybody could tell on the ground.
pub(super) const MOST_DEVIATION: f32 = 0.05;

/// Deviations of ln vigor, a smooth field a species, keyed by absolute map cells.
pub(super) struct Mosaic {
    seed: u64,
    /// Cells between draws.
    spacing: i64,
    /// Absolute map cell of the first column, eastward, and of the first row, southward.
    first_col: i64,
    first_row: i64,
}

impl Mosaic {
    pub(super) fn new(frame: &Frame, seed: u64) -> Self {
        let t = &frame.transform;
        Self {
            seed,
            // at least 1: cells are a few metres at most, coordinates far below 2⁶³
            spacing: ((SPACING_M / t.cell_m).round() as i64).max(1),
            first_col: (t.west_m / t.cell_m).round() as i64,
            first_row: (-t.north_m / t.cell_m).round() as i64,
        }
    }

    /// A reader of the field, row by row.
    pub(super) fn rows(&self, cols: usize) -> MosaicRows<'_> {
        let first_node = self.first_col.div_euclid(self.spacing);
        let place = |col: usize| {
            let col = self.first_col + col as i64;
            let node = col.div_euclid(self.spacing) - first_node;
            let within = col.rem_euclid(self.spacing) as f32 / self.spacing as f32;
            (node as usize, math::smoothstep(within)) // not negative, below the number of columns
        };
        let places = (0..cols).map(place).collect();
        MosaicRows { mosaic: self, first_node, places, draws: Vec::new() }
    }

    /// The draw at a node, within ±[`MOST_DEVIATION`].
    fn draw(&self, node_east: i64, node_south: i64, species: usize) -> f32 {
        // nodes lie within 2²³ of the origin, species below 2⁸
        let entity = rng::entity_of_cell(node_east * 256 + species as i64, -node_south);
        let process = Process::SpeciesMosaic;
        let [uniform, ..] =
            rng::uniforms(Key { seed: self.seed, process, year: 0, month: 0, entity });
        (2.0 * uniform - 1.0) * MOST_DEVIATION
    }
}

/// The field of a [`Mosaic`], row by row.
pub(super) struct MosaicRows<'a> {
    mosaic: &'a Mosaic,
    first_node: i64,
    /// Node to the west of each column, and how far the column lies on the way to the next.
    places: Vec<(usize, f32)>,
    draws: Vec<NodeRows>,
}

/// Draws of one species on the rows of nodes to the north and the south of where the reader is.
struct NodeRows {
    species: usize,
    node_south: i64,
    upper: Vec<f32>,
    lower: Vec<f32>,
}

impl MosaicRows<'_> {
    /// Deviations of a species along a row.
    pub(super) fn fill(&mut self, row: usize, species: usize, deviation: &mut [f32]) {
        let mosaic = self.mosaic;
        let south = mosaic.first_row + row as i64;
        let node_south = south.div_euclid(mosaic.spacing);
        let within = south.rem_euclid(mosaic.spacing) as f32 / mosaic.spacing as f32;
        let down = math::smoothstep(within);
        let nodes = self.places.last().map_or(0, |place| place.0 + 2);
        let draw_row = |node_south: i64| -> Vec<f32> {
            let node = |node: usize| {
                mosaic.draw(self.first_node + node as i64, node_south, species) // far below 2⁶³
            };
            (0..nodes).map(node).collect()
        };
        let known = self.draws.iter().position(|rows| rows.species == species);
        let at = known.unwrap_or(self.draws.len());
        if known.is_none() || self.draws[at].node_south != node_south {
            let (upper, lower) = (draw_row(node_south), draw_row(node_south + 1));
            let rows = NodeRows { species, node_south, upper, lower };
            match self.draws.get_mut(at) {
                Some(kept) => *kept = rows,
                None => self.draws.push(rows),
            }
        }
        let NodeRows { upper, lower, .. } = &self.draws[at];
        for (deviation, &(node, right)) in deviation.iter_mut().zip(&self.places) {
            let west = math::lerp(upper[node], lower[node], down);
            let east = math::lerp(upper[node + 1], lower[node + 1], down);
            *deviation = math::lerp(west, east, right);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::GeoTransform;

    fn field(west_m: f64, species: usize) -> Vec<f32> {
        let transform = GeoTransform { west_m, north_m: 5_000_000.0, cell_m: 1.0 };
        let frame = Frame { transform, ..Frame::local(1, 200, 1.0) };
        let mosaic = Mosaic::new(&frame, 7);
        let mut deviation = vec![0.0; 200];
        mosaic.rows(200).fill(0, species, &mut deviation);
        deviation
    }

    #[test]
    fn a_place_keeps_its_deviation_in_any_frame() {
        assert_eq!(field(500_000.0, 3)[37..], field(500_037.0, 3)[..163]);
        assert_ne!(field(500_000.0, 3), field(500_000.0, 4));
    }

    #[test]
    fn deviations_are_small_and_smooth() {
        let deviation = field(-300.0, 0);
        assert!(deviation.iter().all(|d| d.abs() <= MOST_DEVIATION));
        let steps = deviation.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        // a smoothstep over 24 cells rises 1.5/24 of its height a cell at most
        assert!(steps.fold(0.0, f32::max) <= 2.0 * MOST_DEVIATION * 1.5 / 24.0 + 1e-6);
    }
}
