//! Coarse cells: the grid of about 4 m that networks work on, and the terrain on it.

use std::sync::Arc;

use crate::inference::CELL_M;
use crate::raster::resample::{CellPosition, Samples};
use crate::raster::{Frame, GeoTransform, Grid, Mask};

/// Scene cells in this range are the networks' cells as they are. chosen: crowns a quarter larger or smaller are as
/// plausible, and nothing is lost by resampling.
const OWN_CELLS_M: std::ops::RangeInclusive<f64> = 3.0..=5.0;

/// The coarse cells that cover a scene, and where they lie on the map's lattice.
#[derive(Clone, Debug, PartialEq)]
pub struct CoarseCells {
    /// Size and place.
    pub frame: Arc<Frame>,
    /// Column 0, counted in cells eastward from the CRS's origin.
    pub first_east: i64,
    /// Row 0, counted in cells southward from the CRS's origin.
    pub first_south: i64,
}

impl CoarseCells {
    /// The scene's own cells where they are of about 4 m, else cells of 4 m at multiples of 4 m on the map.
    pub fn of(scene: &Frame) -> Self {
        let t = scene.transform;
        // places are below 10⁹ cells
        let floor = |m: f64, cell_m: f64| (m / cell_m + 1e-6).floor() as i64;
        let ceil = |m: f64, cell_m: f64| (m / cell_m - 1e-6).ceil() as i64;
        if OWN_CELLS_M.contains(&t.cell_m) {
            let first_east = floor(t.west_m, t.cell_m);
            let first_south = floor(-t.north_m, t.cell_m);
            return Self { frame: Arc::new(scene.clone()), first_east, first_south };
        }
        let (first_east, first_south) = (floor(t.west_m, CELL_M), floor(-t.north_m, CELL_M));
        let east_m = t.west_m + scene.cols as f64 * t.cell_m;
        let south_m = -t.north_m + scene.rows as f64 * t.cell_m;
        let frame = Frame {
            // a frame of at least one cell
            rows: (ceil(south_m, CELL_M) - first_south).max(1) as usize,
            cols: (ceil(east_m, CELL_M) - first_east).max(1) as usize,
            transform: GeoTransform {
                west_m: first_east as f64 * CELL_M,
                north_m: -(first_south as f64) * CELL_M,
                cell_m: CELL_M,
            },
            crs: scene.crs.clone(),
        };
        Self { frame: Arc::new(frame), first_east, first_south }
    }

    /// A scene's values on these cells: means of the scene's cells whose centres lie in each, or, where these are fewer than
    /// one a cell, between their centres. A cell is masked where most of the scene's cells in it are.
    pub fn averaged(&self, grid: &Grid<f32>) -> Grid<f32> {
        let (from, to) = (grid.frame(), &self.frame);
        if from == to {
            return grid.clone();
        }
        let (a, b) = (from.transform, to.transform);
        let mut values = vec![0.0_f32; to.len()];
        let mut valid = vec![false; to.len()];
        if a.cell_m < b.cell_m {
            let mut sums = vec![(0.0_f64, 0_u32, 0_u32); to.len()];
            for (index, value) in grid.values().iter().enumerate() {
                let at = a.center(from.cell(index));
                // centres lie inside; rounding must not carry them out
                let row = ((b.north_m - at.north_m) / b.cell_m) as usize;
                let col = ((at.east_m - b.west_m) / b.cell_m) as usize;
                let (sum, count, all) =
                    &mut sums[row.min(to.rows - 1) * to.cols + col.min(to.cols - 1)];
                *all += 1;
                if grid.mask().is_valid(index) {
                    *sum += f64::from(*value);
                    *count += 1;
                }
            }
            for (index, (sum, count, all)) in sums.into_iter().enumerate() {
                if count > 0 && 2 * count >= all {
                    // a mean of f32 values
                    (values[index], valid[index]) = ((sum / f64::from(count)) as f32, true);
                }
            }
            // a sliver at the rim may hold no centre
            self.fill_rim(from, &mut values, &mut valid);
        } else {
            let samples = Samples::new(from.rows, from.cols, grid.values(), grid.mask().as_slice());
            for index in 0..to.len() {
                let at = b.center(to.cell(index));
                let row = (a.north_m - at.north_m) / a.cell_m;
                let col = (at.east_m - a.west_m) / a.cell_m;
                // centres beyond the rim take the rim's value
                let inside = |at: f64, cells: usize| at.clamp(0.0, cells as f64 - 1e-6);
                let at = CellPosition { row: inside(row, from.rows), col: inside(col, from.cols) };
                if let Some(value) = samples.bilinear(at) {
                    (values[index], valid[index]) = (value, true);
                }
            }
        }
        Grid::new(Arc::clone(to), Arc::new(Mask::new(valid)), values)
    }

    /// Gives cells at the rim whose centres lie beyond the scene what their inner neighbours have, where they have nothing.
    pub fn fill_rim(&self, scene: &Frame, values: &mut [f32], valid: &mut [bool]) {
        let (t, s) = (self.frame.transform, scene.transform);
        let Frame { rows, cols, .. } = *self.frame;
        let half_m = t.cell_m / 2.0;
        let east_m = s.west_m + scene.cols as f64 * s.cell_m;
        let south_m = s.north_m - scene.rows as f64 * s.cell_m;
        let mut copy = |to: usize, from: usize| {
            if !valid[to] && valid[from] {
                (values[to], valid[to]) = (values[from], true);
            }
        };
        if cols > 1 {
            for row in 0..rows {
                let first = row * cols;
                if t.west_m + half_m <= s.west_m {
                    copy(first, first + 1);
                }
                if t.west_m + cols as f64 * t.cell_m - half_m >= east_m {
                    copy(first + cols - 1, first + cols - 2);
                }
            }
        }
        if rows > 1 {
            for col in 0..cols {
                if t.north_m - half_m >= s.north_m {
                    copy(col, cols + col);
                }
                if t.north_m - rows as f64 * t.cell_m + half_m <= south_m {
                    copy((rows - 1) * cols + col, (rows - 2) * cols + col);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Crs;

    fn frame(west_m: f64, north_m: f64, cell_m: f64, rows: usize, cols: usize) -> Frame {
        let transform = GeoTransform { west_m, north_m, cell_m };
        Frame { rows, cols, transform, crs: Crs::Local }
    }

    #[test]
    fn cells_lie_at_multiples_of_four_metres_and_cover_the_scene() {
        let cells = CoarseCells::of(&frame(1003.0, 2001.0, 1.0, 50, 50));
        let t = cells.frame.transform;
        assert_eq!((t.west_m, t.north_m, t.cell_m), (1000.0, 2004.0, 4.0));
        assert_eq!((cells.frame.rows, cells.frame.cols), (14, 14));
        assert_eq!((cells.first_east, cells.first_south), (250, -501));
        let whole = CoarseCells::of(&frame(1000.0, 2000.0, 1.0, 40, 80));
        assert_eq!((whole.frame.rows, whole.frame.cols), (10, 20));
    }

    #[test]
    fn cells_of_about_four_metres_are_kept() {
        let scene = frame(1001.5, 2001.5, 3.64, 30, 30);
        assert_eq!(*CoarseCells::of(&scene).frame, scene);
    }

    #[test]
    fn terrain_is_averaged_where_finer_and_drawn_between_centres_where_coarser() {
        for cell_m in [1.0, 2.0, 10.0] {
            let size = (120.0 / cell_m) as usize;
            let plane = Grid::from_fn(size, size, cell_m, |c| {
                (c.col as f32 + 0.5) * cell_m as f32 - 2.0 * (c.row as f32 + 0.5) * cell_m as f32
            });
            let cells = CoarseCells::of(plane.frame());
            let coarse = cells.averaged(&plane);
            assert_eq!((coarse.frame().rows, coarse.frame().cols), (30, 30));
            let at = coarse[crate::raster::Cell { row: 10, col: 20 }];
            assert!((at - (82.0 - 84.0)).abs() < 1e-3, "cells of {cell_m} m: {at}");
        }
    }

    #[test]
    fn a_scene_off_the_lattice_has_terrain_and_paint_to_its_rim() {
        for off in [1.0, 2.0, 3.0, 3.5] {
            let scene = frame(1000.0 + off, 2000.0 + off, 1.0, 50, 50);
            let count = scene.len();
            let scene = Arc::new(scene);
            let grid =
                Grid::new(Arc::clone(&scene), Arc::new(Mask::all_valid(count)), vec![7.0; count]);
            let cells = CoarseCells::of(&scene);
            let coarse = cells.averaged(&grid);
            assert!(coarse.valid_values().count() == cells.frame.len());
            assert!(coarse.values().iter().all(|v| *v == 7.0));
            let outside = |index: usize| {
                let at = cells.frame.transform.center(cells.frame.cell(index));
                at.east_m > 1000.0 + off
                    && at.east_m < 1050.0 + off
                    && at.north_m < 2000.0 + off
                    && at.north_m > 1950.0 + off
            };
            let mut valid: Vec<bool> = (0..cells.frame.len()).map(outside).collect();
            let mut values: Vec<f32> = valid.iter().map(|v| f32::from(u8::from(*v))).collect();
            cells.fill_rim(&scene, &mut values, &mut valid);
            assert!(valid.iter().all(|v| *v) && values.iter().all(|v| *v == 1.0));
        }
    }
}
