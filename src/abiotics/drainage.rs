//! Which way water runs: a depression-free surface and the shares each lower neighbour receives.
//!
//! Every valid cell of the surface either has a strictly lower neighbour or lies on the map's edge (voids
//! have edges too), where the ground is taken to go on as it came and water leaves if that is down;
//! so descending heights are an order in which all of a cell's upslope cells come before it.
//!
//! # Reference
//! Filling: Barnes, Lehman & Mulla 2014, "Priority-flood: An optimal depression-filling and
//! watershed-labeling algorithm for digital elevation models", Computers & Geosciences 62,
//! doi:10.1016/j.cageo.2013.04.024 (the variant that leaves a gradient on flats).
//! Queue: Ahuja, Mehlhorn, Orlin & Tarjan 1990, "Faster algorithms for the shortest path problem",
//! Journal of the ACM 37(2), doi:10.1145/77600.77615 (radix heap).
//! Shares: Quinn, Beven, Chevallier & Planchon 1991, "The prediction of hillslope flow paths for
//! distributed hydrological modelling using digital terrain models", Hydrological Processes 5(1),
//! doi:10.1002/hyp.3360050106.
//! # Departures
//! The gradient on flats is one unit in the last place of an `f32` a step (0.06 mm at 1000 m above
//! sea level), so a flat 1000 cells wide rises by some centimetres. Only routing sees this surface.

use crate::progress::{Cancelled, Reporter};
use crate::raster::{Cell, Grid};

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

/// Cells between two looks at the cancel flag.
const CANCEL_INTERVAL: usize = 1 << 20;

/// Elevation with depressions filled to their spill points, in metres.
///
/// Stored with a rim of one cell around the grid, so that every cell has eight neighbours;
/// rim and masked cells are infinitely high.
pub(super) struct DrainageSurface {
    rows: usize,
    cols: usize,
    height_m: Vec<f32>,
}

impl DrainageSurface {
    /// Elevation with every depression filled. Water leaves at the edges of the grid and of voids.
    ///
    /// # Errors
    /// [`Cancelled`] once the run was cancelled.
    pub fn new(elevation_m: &Grid<f32>, reporter: &Reporter) -> Result<Self, Cancelled> {
        let frame = elevation_m.frame();
        let (rows, cols) = (frame.rows, frame.cols);
        let stride = cols + 2;
        let mask = elevation_m.mask();
        let offsets = neighbour_offsets(stride);

        // valid cells not yet reached are infinitely low
        let mut height_m = vec![f32::INFINITY; (rows + 2) * stride];
        for index in (0..frame.len()).filter(|&i| mask.is_valid(i)) {
            height_m[padded(stride, index / cols, index % cols)] = f32::NEG_INFINITY;
        }
        let elevation_at =
            |p: usize| elevation_m.values()[(p / stride - 1) * cols + p % stride - 1];

        // edges keep their height: there the water leaves
        let mut edges = Vec::new();
        for row in 0..rows {
            for col in 0..cols {
                let p = padded(stride, row, col);
                let reaches_edge = offsets.iter().any(|&o| height_m[step(p, o)] == f32::INFINITY);
                if height_m[p] != f32::INFINITY && reaches_edge {
                    edges.push(p);
                }
            }
        }
        let mut queue = RadixHeap::default();
        for p in edges {
            height_m[p] = elevation_at(p);
            queue.push(height_m[p], p);
        }

        // inland from the lowest shore, each cell at least a hair above the one it was reached from
        let mut reached = 0;
        while let Some(p) = queue.pop() {
            reached += 1;
            if reached % CANCEL_INTERVAL == 0 {
                reporter.check_cancelled()?;
            }
            let least = height_m[p].next_up();
            for o in offsets {
                let n = step(p, o);
                if height_m[n] == f32::NEG_INFINITY {
                    height_m[n] = elevation_at(n).max(least);
                    queue.push(height_m[n], n);
                }
            }
        }
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
    #[inline]
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

/// Index with the rim counted.
#[inline]
fn padded(stride: usize, row: usize, col: usize) -> usize {
    (row + 1) * stride + col + 1
}

#[inline]
fn neighbour_offsets(stride: usize) -> [isize; 8] {
    NEIGHBOURS.map(|(row, col)| row * stride as isize + col)
}

#[inline]
fn step(index: usize, offset: isize) -> usize {
    index.wrapping_add_signed(offset)
}

/// Priority queue for keys that never fall below the last one taken out.
/// Bucket b holds keys that differ from the last in bit b − 1 and in none above.
struct RadixHeap {
    last_key: u32,
    buckets: [Vec<(u32, u32)>; 33],
}

impl Default for RadixHeap {
    fn default() -> Self {
        Self { last_key: 0, buckets: std::array::from_fn(|_| Vec::new()) }
    }
}

impl RadixHeap {
    fn bucket(&self, key: u32) -> usize {
        (u32::BITS - (key ^ self.last_key).leading_zeros()) as usize
    }

    #[inline]
    fn push(&mut self, height_m: f32, index: usize) {
        let key = ordered_bits(height_m);
        debug_assert!(key >= self.last_key, "keys must not fall");
        let bucket = self.bucket(key);
        self.buckets[bucket].push((key, index as u32)); // cells are limited to 400 million
    }

    #[inline]
    fn pop(&mut self) -> Option<usize> {
        if self.buckets[0].is_empty() {
            let source = self.buckets.iter().position(|b| !b.is_empty())?;
            let mut entries = std::mem::take(&mut self.buckets[source]);
            self.last_key = entries.iter().map(|&(key, _)| key).min()?;
            for entry in entries.drain(..) {
                let bucket = self.bucket(entry.0);
                self.buckets[bucket].push(entry);
            }
            self.buckets[source] = entries; // keep the allocation
        }
        self.buckets[0].pop().map(|(_, index)| index as usize)
    }
}

/// Bits that order as the numbers do.
#[inline]
fn ordered_bits(x: f32) -> u32 {
    let bits = x.to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::math::sin;
    use crate::raster::{Frame, Mask};

    /// Rough heights without any pattern.
    fn rough(cell: Cell) -> f32 {
        let (r, c) = (cell.row as f32, cell.col as f32);
        100.0 + 10.0 * sin(r * 12.9898 + c * 78.233) + 7.0 * sin(r * 0.31) * sin(c * 0.23)
    }

    fn surface(elevation_m: &Grid<f32>) -> DrainageSurface {
        DrainageSurface::new(elevation_m, &Reporter::silent()).unwrap()
    }

    /// Fills by lowering a flood until nothing changes (Planchon & Darboux 2002 without gradient).
    fn naive_fill(elevation_m: &Grid<f32>) -> Vec<f32> {
        let (rows, cols) = (elevation_m.frame().rows, elevation_m.frame().cols);
        let valid = |r: isize, c: isize| {
            r >= 0 && c >= 0 && elevation_m.get(Cell { row: r as usize, col: c as usize }).is_some()
        };
        let mut filled = vec![f32::INFINITY; rows * cols];
        loop {
            let mut changed = false;
            for i in 0..rows * cols {
                let (r, c) = ((i / cols) as isize, (i % cols) as isize);
                if !valid(r, c) {
                    continue;
                }
                let mut level = f32::INFINITY;
                for (dr, dc) in NEIGHBOURS {
                    level = level.min(if valid(r + dr, c + dc) {
                        filled[((r + dr) * cols as isize + c + dc) as usize]
                    } else {
                        f32::NEG_INFINITY
                    });
                }
                let new = elevation_m.values()[i].max(level);
                changed |= new < filled[i];
                filled[i] = filled[i].min(new);
            }
            if !changed {
                return filled;
            }
        }
    }

    #[test]
    fn fills_as_the_naive_flood_does() {
        let whole = Grid::from_fn(37, 41, 1.0, rough);
        let valid = (0..37 * 41).map(|i| i % 97 != 5).collect();
        let holed = Grid::new(
            Arc::new(Frame::local(37, 41, 1.0)),
            Arc::new(Mask::new(valid)),
            whole.values().to_vec(),
        );
        for elevation_m in [whole, holed] {
            let (ours, naive) = (surface(&elevation_m), naive_fill(&elevation_m));
            let mut raised = 0;
            for (i, &expected) in naive.iter().enumerate() {
                if !elevation_m.mask().is_valid(i) {
                    continue;
                }
                let filled = ours.height_m(elevation_m.frame().cell(i));
                raised += usize::from(expected > elevation_m.values()[i]);
                // up to one unit in the last place a step: 100 steps of 8e-6 m
                assert!(filled >= expected && filled - expected < 8e-4, "cell {i}");
            }
            assert!(raised > 100, "the test terrain has pits");
        }
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

    #[test]
    fn heap_gives_rising_heights_across_zero() {
        let mut heap = RadixHeap::default();
        let heights = [3.5, -2.0, 0.0, 1e-3, -1e6, 8848.0, -0.5];
        for (i, &h) in heights.iter().enumerate() {
            heap.push(h, i);
        }
        let popped: Vec<f32> = std::iter::from_fn(|| heap.pop()).map(|i| heights[i]).collect();
        assert_eq!(popped, [-1e6, -2.0, -0.5, 0.0, 1e-3, 3.5, 8848.0]);
    }
}
