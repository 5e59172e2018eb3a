//! Crowns as a canopy height model shows them: the highest surface at each cell's centre, with the roughness of leaves.

use rayon::prelude::*;

use super::planting::Lattice;
use super::trees::{Planted, PlantedRows};
use crate::raster::{Cell, Grid};
use crate::rng::{self, Key, Process};

/// Rows of cells drawn by one worker at a time.
const BAND_ROWS: usize = 32;
/// How far the surface lies below the crown's outline at most, as a share of the height. Chosen: by eye, beside
/// measured canopies of 1 m.
const ROUGHNESS_FRACTION: f32 = 0.12;
/// Share of canopy cells where the pulse falls through to lower branches. Chosen: what is left after pits are filled.
const PIT_FRACTION: f32 = 0.012;

/// For each cell the greatest [`Planted::value`] of the crowns over its centre, −∞ where there is none.
pub fn cover_values(ground: &Grid<f32>, lattice: &Lattice, planted: &PlantedRows) -> Vec<f32> {
    greatest(ground, lattice, planted, f32::NEG_INFINITY, |planted, _| planted.value)
}

/// Canopy height at cell centres in metres, 0 where masked.
pub fn draw(ground: &Grid<f32>, lattice: &Lattice, planted: &PlantedRows, seed: u64) -> Grid<f32> {
    let frame = ground.frame();
    let mut heights =
        greatest(ground, lattice, planted, 0.0, |planted, share2| planted.tree.surface_m(share2));
    heights.par_chunks_mut(frame.cols).enumerate().for_each(|(row, heights)| {
        let corner = frame.transform.center(Cell { row, col: 0 });
        let cell_m = frame.transform.cell_m;
        // far below 2⁵³ cells from the origin
        let first_east = (corner.east_m / cell_m).floor() as i64;
        let north = (corner.north_m / cell_m).floor() as i64;
        for (col, height) in heights.iter_mut().enumerate() {
            if !ground.mask().is_valid(row * frame.cols + col) {
                *height = 0.0;
                continue;
            }
            let entity = rng::entity_of_cell(first_east + col as i64, north);
            let key = Key { seed, process: Process::CanopyRoughness, year: 0, month: 0, entity };
            *height = rough(*height, rng::uniforms(key));
        }
    });
    ground.with_values(heights)
}

/// A surface height with the roughness of leaves, or of grass where no crown is.
fn rough(height_m: f32, [texture, pit, depth, _]: [f32; 4]) -> f32 {
    if height_m <= 0.0 {
        // grass and herbs, mostly too low to be seen
        return (0.35 * texture * texture - 0.1).max(0.0);
    }
    let through = if pit < PIT_FRACTION { 0.3 + 0.5 * depth } else { 1.0 };
    height_m * through * (1.0 - ROUGHNESS_FRACTION * texture * texture)
}

/// For each cell the greatest of what `measure` gives for the crowns over its centre, by the squared distance from the
/// trunk in crown radii; `none` where there is no crown.
fn greatest(
    ground: &Grid<f32>,
    lattice: &Lattice,
    planted: &PlantedRows,
    none: f32,
    measure: impl Fn(&Planted, f32) -> f32 + Sync,
) -> Vec<f32> {
    let frame = ground.frame();
    let cell_m = frame.cell_m();
    let widest_m = lattice.widest_crown_m();
    let north_of = |row: usize| (frame.rows as f32 - row as f32) * cell_m;
    let mut values = vec![none; frame.len()];
    values.par_chunks_mut(BAND_ROWS * frame.cols).enumerate().for_each(|(band, values)| {
        let first_row = band * BAND_ROWS;
        let rows = values.len() / frame.cols;
        let (north_m, south_m) = (north_of(first_row), north_of(first_row + rows));
        let near = lattice.rows_between(south_m - widest_m, north_m + widest_m);
        for planted in planted.rows[near].iter().flatten() {
            let tree = &planted.tree;
            let radius_m = tree.crown_radius_m;
            let per_radius2 = 1.0 / (radius_m * radius_m);
            // cells whose centres lie within the radius; `as` cuts negatives to 0
            let first = |at_m: f32| ((at_m - radius_m) / cell_m - 0.5).ceil() as usize;
            let end = |at_m: f32, cells: usize| {
                (((at_m + radius_m) / cell_m - 0.5).floor() + 1.0).clamp(0.0, cells as f32) as usize
            };
            let down_m = north_m - tree.north_m;
            let cols = first(tree.east_m)..end(tree.east_m, frame.cols);
            for row in first(down_m)..end(down_m, rows) {
                let south = (row as f32 + 0.5) * cell_m - down_m;
                let line = &mut values[row * frame.cols..][..frame.cols];
                for col in cols.clone() {
                    let east = (col as f32 + 0.5) * cell_m - tree.east_m;
                    let share2 = (east * east + south * south) * per_radius2;
                    if share2 <= 1.0 {
                        line[col] = line[col].max(measure(planted, share2));
                    }
                }
            }
        }
    });
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canopy::generate::GenerateParams;
    use crate::canopy::generate::tests::hills;
    use crate::canopy::generate::trees::GeneratedTree;

    #[test]
    fn crowns_stand_where_their_trunks_are_whatever_the_cell() {
        let tree = GeneratedTree {
            east_m: 20.3,
            north_m: 31.9,
            height_m: 18.0,
            crown_radius_m: 4.2,
            crown_depth_fraction: 0.5,
            roundness: 1.0,
        };
        for cell_m in [0.5, 1.0, 2.5] {
            let terrain = hills((60.0 / cell_m) as usize, cell_m);
            let frame = terrain.elevation_m.frame();
            let params = GenerateParams { trees_per_ha: 150.0, ..GenerateParams::default() };
            let lattice = Lattice::new(frame, &params);
            let mut rows = vec![Vec::new(); lattice.rows];
            let at = lattice.rows_between(31.9, 31.9).start;
            rows[at].push(Planted { tree, value: 1.0, luck: 1.0 });
            let planted = PlantedRows { rows, level: 0.0 };
            let heights =
                greatest(&terrain.elevation_m, &lattice, &planted, 0.0, |p, s| p.tree.surface_m(s));
            let mut covered = 0;
            for (index, &height) in heights.iter().enumerate() {
                let center = frame.transform.center(frame.cell(index));
                let (e, n) = (center.east_m - 20.3, center.north_m - 31.9);
                let share2 = ((e * e + n * n) / (4.2 * 4.2)) as f32;
                covered += usize::from(height > 0.0);
                let expected = if share2 <= 1.0 { tree.surface_m(share2) } else { 0.0 };
                assert!((height - expected).abs() < 2e-3 || (share2 - 1.0).abs() < 1e-4);
            }
            let area = covered as f64 * cell_m * cell_m / (std::f64::consts::PI * 4.2 * 4.2);
            assert!((area - 1.0).abs() < 0.15, "cells of {cell_m} m: {area}");
        }
    }

    #[test]
    fn leaves_only_lower_the_surface_and_pits_are_rare() {
        assert_eq!(rough(20.0, [0.0, 1.0, 0.5, 0.0]), 20.0);
        assert!((rough(20.0, [1.0, 1.0, 0.5, 0.0]) - 17.6).abs() < 1e-4);
        assert!(rough(20.0, [0.0, 0.0, 0.5, 0.0]) < 12.0);
        assert_eq!(rough(0.0, [0.3, 1.0, 0.5, 0.0]), 0.0);
        assert!(rough(0.0, [0.99, 1.0, 0.5, 0.0]) < 0.3);
    }
}
