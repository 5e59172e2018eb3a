//! Conditions: terrain and stand height as networks see them. Twin of training/dataset.py.
//!
//! Only height against the surroundings counts, so that networks know forests on any terrain, not two sites by altitude.

use rayon::prelude::*;

use crate::math;
use crate::raster::Grid;

/// Cells on each side of a box that the mean elevation is taken over; three passes come near a Gaussian of 200 m.
const RELIEF_RADIUS_CELLS: usize = 50;
/// Relief that is compressed to asinh 1, m.
const RELIEF_M: f64 = 15.0;
/// Gradient that is compressed to asinh 1.
const GRADIENT: f64 = 0.3;
/// Height at the top of the encoding, m.
const MAX_HEIGHT_M: f32 = 36.0;

/// Terrain as networks see it, row-major; 0 where masked.
pub struct TerrainChannels {
    /// asinh of height above the surroundings' mean over 15 m.
    pub relief: Vec<f32>,
    /// asinh of the rise eastward over 0.3.
    pub gradient_east: Vec<f32>,
    /// asinh of the rise northward over 0.3.
    pub gradient_north: Vec<f32>,
    /// Steepest slope, as rise per run.
    pub slope: Vec<f32>,
}

impl TerrainChannels {
    /// The channels of coarse terrain.
    pub fn of(elevation_m: &Grid<f32>) -> Self {
        let (rows, cols) = (elevation_m.frame().rows, elevation_m.frame().cols);
        let land = elevation_m.mask().as_slice();
        // heights above the first land cell: sums keep their digits
        let base = elevation_m.valid_values().next().copied().unwrap_or(0.0);
        let height =
            |i: usize| if land[i] { f64::from(elevation_m.values()[i] - base) } else { 0.0 };
        let heights: Vec<f64> = (0..rows * cols).map(height).collect();
        let weights: Vec<f64> = land.iter().map(|land| f64::from(u8::from(*land))).collect();
        let means = box_mean(&heights, &weights, cols, RELIEF_RADIUS_CELLS);
        let compressed = |value: f64| asinh(value) as f32; // a few units
        let relief = |i: usize| {
            if land[i] { compressed((heights[i] - means[i]) / RELIEF_M) } else { 0.0 }
        };
        // central differences; rim cells take their inner neighbours'
        let run_m = 2.0 * elevation_m.frame().transform.cell_m;
        let rise = |a: usize, b: usize| {
            if land[a] && land[b] { (heights[b] - heights[a]) / run_m } else { 0.0 }
        };
        let gradient = |i: usize| {
            if !land[i] {
                return [0.0, 0.0];
            }
            let inner = |at: usize, cells: usize| at.clamp(1, cells.saturating_sub(2).max(1));
            let (row, col) = (i / cols, i % cols);
            let east = if cols < 3 {
                0.0
            } else {
                let at = row * cols + inner(col, cols);
                rise(at - 1, at + 1)
            };
            let north = if rows < 3 {
                0.0
            } else {
                let at = inner(row, rows) * cols + col;
                rise(at + cols, at - cols)
            };
            [east, north]
        };
        let gradients: Vec<[f64; 2]> = (0..rows * cols).into_par_iter().map(gradient).collect();
        let of_axis =
            |axis: usize| gradients.par_iter().map(|g| compressed(g[axis] / GRADIENT)).collect();
        Self {
            relief: (0..rows * cols).into_par_iter().map(relief).collect(),
            gradient_east: of_axis(0),
            gradient_north: of_axis(1),
            slope: gradients.par_iter().map(|[e, n]| (e * e + n * n).sqrt() as f32).collect(), // a rise per run
        }
    }
}

/// A height as networks see it: −1 at the ground, 1 at 36 m, low canopy resolved finely.
pub fn encoded_height(height_m: f32) -> f32 {
    2.0 * (height_m.clamp(0.0, MAX_HEIGHT_M) / MAX_HEIGHT_M).sqrt() - 1.0
}

/// Inverse hyperbolic sine.
fn asinh(x: f64) -> f64 {
    math::ln_f64(x.abs() + (x * x + 1.0).sqrt()).copysign(x)
}

/// Means over three passes of a box of `2 radius + 1` cells a side, of what has weight; values must be 0 where the weight is.
pub(super) fn box_mean(values: &[f64], weights: &[f64], cols: usize, radius: usize) -> Vec<f64> {
    let rows = values.len() / cols.max(1);
    let three_passes = |values: &[f64]| {
        let once = box_sums(values, rows, cols, radius);
        box_sums(&box_sums(&once, rows, cols, radius), rows, cols, radius)
    };
    let (sums, shares) = (three_passes(values), three_passes(weights));
    sums.iter().zip(shares).map(|(sum, share)| sum / share.max(1e-12)).collect()
}

/// Sums over boxes of `2 radius + 1` cells a side, cut at the map's rim.
fn box_sums(values: &[f64], rows: usize, cols: usize, radius: usize) -> Vec<f64> {
    // along rows
    let mut across = vec![0.0; rows * cols];
    across.par_chunks_mut(cols).zip(values.par_chunks(cols)).for_each(|(out, line)| {
        let mut sum: f64 = line[..radius.min(cols)].iter().sum();
        for (col, out) in out.iter_mut().enumerate() {
            sum += line.get(col + radius).copied().unwrap_or(0.0);
            *out = sum;
            sum -= col.checked_sub(radius).map_or(0.0, |col| line[col]);
        }
    });
    // along columns, a whole row at a time
    let mut sums = vec![0.0; rows * cols];
    let mut sum = vec![0.0; cols];
    let line = |row: usize| &across[row * cols..][..cols];
    for row in 0..radius.min(rows) {
        sum.iter_mut().zip(line(row)).for_each(|(sum, v)| *sum += v);
    }
    for row in 0..rows {
        if row + radius < rows {
            sum.iter_mut().zip(line(row + radius)).for_each(|(sum, v)| *sum += v);
        }
        sums[row * cols..][..cols].copy_from_slice(&sum);
        if let Some(row) = row.checked_sub(radius) {
            sum.iter_mut().zip(line(row)).for_each(|(sum, v)| *sum -= v);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::raster::Mask;

    #[test]
    fn boxes_sum_what_they_hold() {
        let values: Vec<f64> = (0..35).map(|i| f64::from(i * i % 11)).collect();
        for radius in [0, 1, 2, 9] {
            let sums = box_sums(&values, 5, 7, radius);
            for (i, sum) in sums.iter().enumerate() {
                let (row, col) = (i / 7, i % 7);
                let expected: f64 = (0..35)
                    .filter(|j| {
                        (j / 7_usize).abs_diff(row) <= radius && (j % 7).abs_diff(col) <= radius
                    })
                    .map(|j| values[j])
                    .sum();
                assert!((sum - expected).abs() < 1e-9, "radius {radius}, cell {i}");
            }
        }
    }

    #[test]
    fn a_plane_has_its_gradients_and_no_relief() {
        let plane =
            Grid::from_fn(40, 50, 4.0, |c| 1000.0 + 1.2 * c.col as f32 + 0.4 * c.row as f32);
        let channels = TerrainChannels::of(&plane);
        // rows run south
        let (east, north) = (asinh(0.3 / 0.3) as f32, asinh(-0.1 / 0.3) as f32);
        assert!(channels.gradient_east.iter().all(|g| (g - east).abs() < 1e-3));
        assert!(channels.gradient_north.iter().all(|g| (g - north).abs() < 1e-3));
        assert!((channels.slope[77] - 0.1_f32.sqrt()).abs() < 1e-3);
        // in the middle the box lies alike on both sides
        assert!(channels.relief[20 * 50 + 25].abs() < 0.1);
    }

    #[test]
    fn altitude_does_not_count_and_voids_are_no_terrain() {
        let hill = |base: f32| {
            let grid = Grid::from_fn(60, 60, 4.0, |c| {
                base + 20.0 * math::sin(c.col as f32 / 9.0) * math::cos(c.row as f32 / 7.0)
            });
            let valid = (0..3600).map(|i| i % 60 < 50).collect();
            let values = grid.values().iter().enumerate();
            let values = values.map(|(i, v)| if i % 60 < 50 { *v } else { -9999.0 }).collect();
            TerrainChannels::of(&Grid::new(
                Arc::clone(grid.frame()),
                Arc::new(Mask::new(valid)),
                values,
            ))
        };
        let (low, high) = (hill(0.0), hill(2048.0));
        for (a, b) in low.relief.iter().zip(&high.relief) {
            assert!((a - b).abs() < 1e-3 && a.abs() < 2.0);
        }
        assert!(low.relief[55] == 0.0 && low.gradient_east[55] == 0.0);
        // beside the void there is no slope to know
        assert!(low.gradient_east[30 * 60 + 49] == 0.0 && low.gradient_east[30 * 60 + 30] != 0.0);
    }

    #[test]
    fn heights_are_encoded_by_their_root() {
        assert_eq!([0.0, 9.0, 36.0, 50.0].map(encoded_height), [-1.0, 0.0, 1.0, 1.0]);
    }
}
