//! Which way water runs: a depression-free surface and the shares each lower neighbour receives.
//!
//! Dams that are low and thin are cut through (`breaching`), what stays closed is filled (`filling`).
//!
//! Every valid cell of the surface either has a strictly lower neighbour or lies on the map's edge (voids
//! have edges too), where the ground is taken to go on as it came and water leaves if that is down;
//! so descending heights are an order in which all of a cell's upslope cells come before it.
//!
//! # Reference
//! Shares: Quinn, Beven, Chevallier & Planchon 1991, "The prediction of hillslope flow paths for
//! distributed hydrological modelling using digital terrain models", Hydrological Processes 5(1),
//! doi:10.1002/hyp.3360050106.

use crate::progress::{Cancelled, Reporter};
use crate::raster::{Cell, Grid};

use super::breaching::breach;
use super::filling::fill;

/// Neighbours clockwise from north, as (row, column) steps.
pub(super) const NEIGHBOURS: [(isize, isize); 8] =
    [(-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1)];

/// 1 / distance to each of [`NEIGHBOURS`], in cells.
const INVERSE_DISTANCE: [f32; 8] = {
    let d = std::f32::consts::FRAC_1_SQRT_2;
    [1.0, d, 1.0, d, 1.0, d, 1.0, d]
};

/// Contour length that faces each of [`NEIGHBOURS`], in cells. Quinn et al. 1991.
const CONTOUR_LENGTH: [f32; 8] = {
    let (side, corner) = (0.5, std::f32::consts::SQRT_2 / 4.0);
    [side, corner, side, corner, side, corner, side, corner]
};

/// Elevation without depressions, in metres. Only what concerns water sees it.
///
/// Stored with a rim of one cell around the grid, so that every cell has eight neighbours;
/// rim and masked cells are infinitely high.
pub(super) struct DrainageSurface {
    rows: usize,
    cols: usize,
    height_m: Vec<f32>,
}

impl DrainageSurface {
    /// Elevation with every depression cut open or filled. Water leaves at the edges of the grid and of
    /// voids.
    ///
    /// # Errors
    /// [`Cancelled`] once the run was cancelled.
    pub fn new(elevation_m: &Grid<f32>, reporter: &Reporter) -> Result<Self, Cancelled> {
        let frame = elevation_m.frame();
        let (rows, cols) = (frame.rows, frame.cols);
        let stride = cols + 2;
        let mut height_m = rimmed(elevation_m);
        breach(&mut height_m, stride, frame.cell_m(), reporter)?;
        fill(&mut height_m, stride, reporter)?;
        Ok(Self { rows, cols, height_m })
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// Height of a valid cell in metres; infinite where masked.
    #[inline]
    pub fn height_m(&self, cell: Cell) -> f32 {
        self.height_m[padded(self.cols + 2, cell.row, cell.col)]
    }

    /// The ways down from a valid cell.
    #[inline]
    pub fn descent(&self, cell: Cell) -> Descent {
        let stride = self.cols + 2;
        let p = padded(stride, cell.row, cell.col);
        let here = self.height_m[p];
        let around = neighbour_offsets(stride).map(|o| self.height_m[step(p, o)]);
        let mut descent = Descent { falls: [0.0; 8], outward: [false; 8] };
        for d in 0..8 {
            let mut fall = here - around[d];
            if around[d] == f32::INFINITY {
                // beyond the edge the ground goes on as it came
                let behind = around[(d + 4) % 8];
                fall = if behind == f32::INFINITY { 0.0 } else { behind - here };
                descent.outward[d] = true;
            }
            descent.falls[d] = fall.max(0.0) * INVERSE_DISTANCE[d];
        }
        descent
    }

    /// Number of neighbours that are strictly higher and valid: those whose water may come here.
    #[inline]
    pub fn upslope_count(&self, cell: Cell) -> u8 {
        let stride = self.cols + 2;
        let p = padded(stride, cell.row, cell.col);
        let here = self.height_m[p];
        neighbour_offsets(stride)
            .iter()
            .map(|&o| {
                let height = self.height_m[step(p, o)];
                u8::from(height > here && height != f32::INFINITY)
            })
            .sum()
    }

    /// The cell that the steepest way down leads to; `None` where that way leaves the map.
    #[cfg(test)]
    pub fn receiver(&self, cell: Cell) -> Option<Cell> {
        self.descent(cell).steepest_inward().map(|direction| neighbour(cell, direction))
    }
}

/// The cell one step in a direction of [`NEIGHBOURS`]; it must exist.
#[inline]
pub(super) fn neighbour(cell: Cell, direction: usize) -> Cell {
    let (row, col) = NEIGHBOURS[direction];
    Cell { row: step(cell.row, row), col: step(cell.col, col) }
}

/// The ways down from a cell.
pub(super) struct Descent {
    /// Fall to each of [`NEIGHBOURS`] per cell width, in metres; 0 where there is none.
    pub falls: [f32; 8],
    /// Whether that neighbour lies off the map or is masked: water going there is gone.
    pub outward: [bool; 8],
}

impl Descent {
    /// Direction of the steepest fall, the first of equals; `None` if it leads off the map.
    #[inline]
    pub fn steepest_inward(&self) -> Option<usize> {
        let mut best = None;
        let mut best_fall = 0.0;
        for (direction, &fall) in self.falls.iter().enumerate() {
            if fall > best_fall {
                (best, best_fall) = (Some(direction), fall);
            }
        }
        best.filter(|&direction| !self.outward[direction])
    }

    /// Whether there is no way down: only on the map's edge, where all water leaves.
    #[inline]
    pub fn is_sink(&self) -> bool {
        self.falls.iter().all(|&fall| fall == 0.0)
    }

    /// Share of the cell's water that takes each way; they sum to 1, or to 0 in a sink.
    ///
    /// # Reference
    /// Quinn et al. 1991: contour length times slope.
    #[inline]
    pub fn shares(&self) -> [f64; 8] {
        let mut shares = [0.0; 8];
        let mut sum = 0.0;
        for (d, share) in shares.iter_mut().enumerate() {
            *share = f64::from(self.falls[d] * CONTOUR_LENGTH[d]);
            sum += *share;
        }
        if sum > 0.0 {
            let inverse = 1.0 / sum;
            shares.iter_mut().for_each(|share| *share *= inverse);
        }
        shares
    }
}

/// Heights with a rim of one cell; rim and masked cells are infinitely high.
pub(super) fn rimmed(elevation_m: &Grid<f32>) -> Vec<f32> {
    let frame = elevation_m.frame();
    let stride = frame.cols + 2;
    let mut height_m = vec![f32::INFINITY; (frame.rows + 2) * stride];
    for row in 0..frame.rows {
        let start = padded(stride, row, 0);
        for (col, height_m) in height_m[start..start + frame.cols].iter_mut().enumerate() {
            *height_m = *elevation_m.get(Cell { row, col }).unwrap_or(&f32::INFINITY);
        }
    }
    height_m
}

/// Index with the rim counted.
#[inline]
pub(super) fn padded(stride: usize, row: usize, col: usize) -> usize {
    (row + 1) * stride + col + 1
}

/// Steps to each of [`NEIGHBOURS`] between indices with the rim counted.
#[inline]
pub(super) fn neighbour_offsets(stride: usize) -> [isize; 8] {
    NEIGHBOURS.map(|(row, col)| row * stride as isize + col)
}

#[inline]
pub(super) fn step(index: usize, offset: isize) -> usize {
    index.wrapping_add_signed(offset)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sin;

    /// Rough heights without any pattern.
    fn rough(cell: Cell) -> f32 {
        let (r, c) = (cell.row as f32, cell.col as f32);
        100.0 + 10.0 * sin(r * 12.9898 + c * 78.233) + 7.0 * sin(r * 0.31) * sin(c * 0.23)
    }

    fn surface(elevation_m: &Grid<f32>) -> DrainageSurface {
        DrainageSurface::new(elevation_m, &Reporter::silent()).unwrap()
    }

    #[test]
    fn every_inland_cell_has_a_lower_neighbour() {
        for elevation_m in
            [Grid::from_fn(30, 50, 1.0, rough), Grid::from_fn(30, 50, 1.0, |_| 250.0)]
        {
            let surface = surface(&elevation_m);
            for row in 1..29 {
                for col in 1..49 {
                    assert!(surface.receiver(Cell { row, col }).is_some(), "({row}, {col})");
                }
            }
        }
    }

    #[test]
    fn water_of_a_pit_leaves_through_its_lowest_rim() {
        // a bowl with one notch in its rim, at (4, 8)
        let elevation_m = Grid::from_fn(9, 9, 1.0, |cell| match (cell.row, cell.col) {
            (4, 8) => 3.0,
            (4, 7) => 2.9,
            (0 | 8, _) | (_, 0 | 8) => 10.0,
            (4, 4) => -5.0,
            _ => 1.0,
        });
        let surface = surface(&elevation_m);
        let mut cell = Cell { row: 4, col: 4 };
        while let Some(next) = surface.receiver(cell) {
            assert!(surface.height_m(next) < surface.height_m(cell));
            cell = next;
        }
        assert_eq!(cell, Cell { row: 4, col: 8 });
        assert!((surface.height_m(Cell { row: 4, col: 4 }) - 3.0).abs() < 1e-4);
    }

    #[test]
    fn a_plane_shares_its_water_evenly_to_both_sides_of_the_fall_line() {
        let elevation_m = Grid::from_fn(5, 5, 2.0, |cell| 50.0 - cell.col as f32);
        let shares = surface(&elevation_m).descent(Cell { row: 2, col: 2 }).shares();
        // east 0.5·1, corners √2/4·1/√2 = 0.25 each
        let expected = [0.0, 0.25, 0.5, 0.25, 0.0, 0.0, 0.0, 0.0];
        for (share, expected) in shares.iter().zip(expected) {
            assert!((share - expected).abs() < 1e-6, "{shares:?}");
        }
    }

    #[test]
    fn water_crosses_the_edge_of_a_slope_that_goes_on_beyond_it() {
        let elevation_m =
            Grid::from_fn(5, 5, 1.0, |cell| 50.0 - 2.0 * cell.col as f32 - 0.1 * cell.row as f32);
        let surface = surface(&elevation_m);
        let descent = surface.descent(Cell { row: 2, col: 4 });
        assert_eq!(descent.steepest_inward(), None);
        let gone: f64 = (0..8).filter(|&d| descent.outward[d]).map(|d| descent.shares()[d]).sum();
        assert!(gone > 0.9, "{gone}");
    }
}
