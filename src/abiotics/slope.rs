//! Slope and aspect of the terrain.
//!
//! # Reference
//! Horn 1981, "Hill shading and the reflectance map", Proceedings of the IEEE 69(1),
//! doi:10.1109/PROC.1981.11918: weighted differences over the 3 × 3 neighbourhood.
//! Rims as GDAL's `gdaldem -compute_edges` treats them, so that maps made by either agree.

use std::f32::consts::TAU;

use rayon::prelude::*;

use crate::math::{atan, atan2};
use crate::raster::Grid;

/// Angle of the ground against the horizontal, in radians.
///
/// # Reference
/// Horn 1981.
pub fn slope_rad(elevation_m: &Grid<f32>) -> Grid<f32> {
    map_gradient(elevation_m, |gradient| {
        let Gradient { to_east, to_north } = gradient;
        atan((to_east * to_east + to_north * to_north).sqrt())
    })
}

/// Direction in which the ground falls, in radians clockwise from the grid's north, in 0..2π; 0 where it is level.
///
/// # Reference
/// Horn 1981.
pub fn aspect_rad(elevation_m: &Grid<f32>) -> Grid<f32> {
    map_gradient(elevation_m, |Gradient { to_east, to_north }| {
        let angle = atan2(-to_east, -to_north);
        match (to_east == 0.0 && to_north == 0.0, angle < 0.0) {
            (true, _) => 0.0,
            // a direction just west of north may round up to the full circle
            (_, true) => (angle + TAU) % TAU,
            _ => angle,
        }
    })
}

/// How the ground rises, in metres per metre.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Gradient {
    /// Rise towards the grid's east.
    pub(crate) to_east: f32,
    /// Rise towards the grid's north.
    pub(crate) to_north: f32,
}

fn map_gradient(elevation_m: &Grid<f32>, f: impl Fn(Gradient) -> f32 + Sync) -> Grid<f32> {
    let frame = elevation_m.frame();
    let mut values = vec![0.0; frame.len()];
    values.par_chunks_mut(frame.cols.max(1)).enumerate().for_each_init(
        || vec![Gradient::default(); frame.cols],
        |gradients, (row, values)| {
            gradient_row(elevation_m, row, gradients);
            for (value, gradient) in values.iter_mut().zip(gradients) {
                *value = f(*gradient);
            }
        },
    );
    elevation_m.with_values(values)
}

/// Gradients of one row of cells; level where masked.
pub(crate) fn gradient_row(elevation_m: &Grid<f32>, row: usize, out: &mut [Gradient]) {
    let frame = elevation_m.frame();
    let (rows, cols) = (frame.rows, frame.cols);
    let whole = elevation_m.mask().is_all_valid() && row > 0 && row + 1 < rows && cols > 2;
    let per_difference = 1.0 / (8.0 * frame.cell_m());
    if !whole {
        for (col, out) in out.iter_mut().enumerate() {
            *out = rim_window(elevation_m, row, col).gradient(per_difference);
        }
        return;
    }
    let (above, here, below) =
        (elevation_m.row(row - 1), elevation_m.row(row), elevation_m.row(row + 1));
    let inside = above.windows(3).zip(here.windows(3)).zip(below.windows(3));
    for (((a, h), b), out) in inside.zip(&mut out[1..]) {
        let window = Window([a[0], a[1], a[2], h[0], h[1], h[2], b[0], b[1], b[2]]);
        *out = window.gradient(per_difference);
    }
    for col in [0, cols - 1] {
        out[col] = rim_window(elevation_m, row, col).gradient(per_difference);
    }
}

/// Heights of a cell and its neighbours, row by row from the north-west.
struct Window([f32; 9]);

impl Window {
    #[inline]
    fn gradient(&self, per_difference: f32) -> Gradient {
        let [nw, n, ne, w, _, e, sw, s, se] = self.0;
        // opposite cells are subtracted first: their heights are large and alike
        let to_east = (ne - nw) + 2.0 * (e - w) + (se - sw);
        let to_north = (nw - sw) + 2.0 * (n - s) + (ne - se);
        Gradient { to_east: to_east * per_difference, to_north: to_north * per_difference }
    }
}

/// The window of a cell at the grid's rim or beside the unknown.
///
/// Beyond the rim heights continue as from the second row to the first (in the corners the column is repeated);
/// what is unknown has the cell's own height. A masked cell has a level window.
fn rim_window(elevation_m: &Grid<f32>, row: usize, col: usize) -> Window {
    let frame = elevation_m.frame();
    let (rows, cols) = (frame.rows, frame.cols);
    let at = |row: usize, col: usize| {
        let index = row * cols + col;
        elevation_m.mask().is_valid(index).then(|| elevation_m.values()[index])
    };
    let Some(own_m) = at(row, col) else { return Window([0.0; 9]) };
    let beyond = |first: Option<f32>, second: Option<f32>| Some(2.0 * first? - second?);
    let on_row_rim = (row == 0 || row + 1 == rows) && rows > 1;
    let neighbour = |d_row: isize, d_col: isize| -> Option<f32> {
        let (to_row, to_col) = (row.checked_add_signed(d_row), col.checked_add_signed(d_col));
        let to_row = to_row.filter(|r| *r < rows);
        let to_col = to_col.filter(|c| *c < cols);
        match (to_row, to_col) {
            (Some(r), Some(c)) => at(r, c),
            // beyond the north or south rim
            (None, c) if rows > 1 => {
                let c = c.unwrap_or(col);
                beyond(at(row, c), at(row.wrapping_add_signed(-d_row), c))
            }
            // beyond the west or east rim
            (Some(r), None) if cols > 1 && !on_row_rim => {
                beyond(at(r, col), at(r, col.wrapping_add_signed(-d_col)))
            }
            (Some(r), None) => at(r, col),
            (None, c) => at(row, c.unwrap_or(col)),
        }
    };
    let mut heights_m = [own_m; 9];
    for (index, height_m) in heights_m.iter_mut().enumerate() {
        let (d_row, d_col) = (index as isize / 3 - 1, index as isize % 3 - 1); // −1, 0 or 1
        *height_m = neighbour(d_row, d_col).unwrap_or(own_m);
    }
    Window(heights_m)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::raster::{Cell, Frame, Mask};

    #[test]
    fn a_plane_has_one_slope_and_aspect() {
        // falls 3 m to the east and 4 m to the south for every 10 m
        let plane = Grid::from_fn(6, 7, 2.0, |c| 50.0 - 0.6 * c.col as f32 - 0.8 * c.row as f32);
        let (slope, aspect) = (slope_rad(&plane), aspect_rad(&plane));
        for cell in (0..42).map(|index| plane.frame().cell(index)) {
            let corner = [0, 5].contains(&cell.row) && [0, 6].contains(&cell.col);
            if !corner {
                assert!((slope[cell] - atan(0.5)).abs() < 1e-5, "{cell:?}");
                assert!((aspect[cell] - atan2(0.3, -0.4)).abs() < 1e-5, "{cell:?}");
            }
        }
    }

    #[test]
    fn level_ground_has_no_slope() {
        let level = Grid::from_fn(3, 1, 1.0, |_| 7.0);
        assert!(slope_rad(&level).values().iter().all(|slope| *slope == 0.0));
        assert!(aspect_rad(&level).values().iter().all(|aspect| *aspect == 0.0));
    }

    #[test]
    fn rims_and_voids_are_as_gdaldem_has_them() {
        // gdaldem slope and aspect, -compute_edges, GDAL 3.6.2, cells of 2 m; 0 stands for nodata
        const VOID: usize = 7;
        #[rustfmt::skip]
        let height_m = vec![
            10.0, 12.0, 15.0, 11.0,  9.0,
            13.0, 14.0,  0.0, 12.0,  8.0,
            15.0, 19.0, 17.0, 13.0, 10.0,
            12.0, 16.0, 18.0, 14.0,  7.0,
        ];
        #[rustfmt::skip]
        let slope_deg = [
            55.6479, 51.0576, 24.2608, 45.2221, 29.2059,
            58.0072, 54.9964,  0.0000, 54.1404, 58.6908,
            58.6908, 45.2221, 46.8833, 62.7368, 64.9503,
            60.9829, 60.9829, 26.5651, 70.0169, 63.6122,
        ];
        #[rustfmt::skip]
        let aspect_deg = [
            340.0169, 315.0000, 33.6901, 82.8750, 116.565,
            321.3402, 336.8014,  0.0000, 71.5650,  81.2538,
            261.2538, 277.125, 69.4440, 75.0686,  96.7098,
            213.6901, 236.3099, 90.0000, 90.0000, 119.7449,
        ];
        let valid = (0..20).map(|index| index != VOID).collect();
        let frame = Arc::new(Frame::local(4, 5, 2.0));
        let grid = Grid::new(frame, Arc::new(Mask::new(valid)), height_m);
        let (slope, aspect) = (slope_rad(&grid), aspect_rad(&grid));
        for index in (0..20).filter(|index| *index != VOID) {
            let cell = grid.frame().cell(index);
            let slope_off = slope[cell].to_degrees() - slope_deg[index];
            let aspect_off = aspect[cell].to_degrees() - aspect_deg[index];
            assert!(slope_off.abs() < 2e-4, "slope at {cell:?}: {slope_off}°");
            assert!(aspect_off.abs() < 1e-3, "aspect at {cell:?}: {aspect_off}°");
        }
        assert_eq!(slope[Cell { row: 1, col: 2 }], 0.0);
    }
}
