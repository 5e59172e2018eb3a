//! Coarse cells: the grid of about 4 m that networks work on, and the terrain on it.

use std::sync::Arc;

use crate::progress::{Cancelled, Reporter};
use crate::raster::resample::{Kernel, Samples};
use crate::raster::warp::{self, Source, Target};
use crate::raster::{Affine, Frame, GeoTransform, Grid, Mask};

/// Cell size that networks are trained on, m.
pub const CELL_M: f64 = 4.0;
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

    /// A scene's values on these cells: means where they are wider than the scene's, else between its centres. Cells of
    /// which less than half has a value are masked.
    ///
    /// # Errors
    /// [`Cancelled`] once the run was cancelled.
    pub fn averaged(&self, grid: &Grid<f32>, reporter: &Reporter) -> Result<Grid<f32>, Cancelled> {
        let (from, to) = (grid.frame(), &self.frame);
        if from == to {
            return Ok(grid.clone());
        }
        let is_finer = from.transform.cell_m < to.transform.cell_m;
        let kernel = if is_finer { Kernel::Average } else { Kernel::Bilinear };
        let samples = Samples::new(from.rows, from.cols, grid.values(), grid.mask().as_slice());
        let source = Source { samples, affine: Affine::from(&from.transform) };
        let target = Target { rows: to.rows, cols: to.cols, transform: to.transform };
        let warped = warp::warp(&source, &target, None, kernel, reporter)?;
        Ok(Grid::new(Arc::clone(to), Arc::new(Mask::new(warped.valid)), warped.values))
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
            let coarse = cells.averaged(&plane, &Reporter::silent()).unwrap();
            assert_eq!((coarse.frame().rows, coarse.frame().cols), (30, 30));
            let at = coarse[crate::raster::Cell { row: 10, col: 20 }];
            assert!((at - (82.0 - 84.0)).abs() < 1e-3, "cells of {cell_m} m: {at}");
        }
    }
}
