//! Brush: regions painted over the landscape, each with shares of its own, and how their borders blend.
//!
//! # Reference
//! Kapp et al. 2020, section 5.1: species proportions attached to a brush and painted locally.

use super::shares::Shares;
use crate::raster::{Frame, Grid};

/// Most regions of a brush. chosen: one byte a cell, less a few values that mean other things.
pub const MOST_REGIONS: usize = 250;

/// Nodes of the blend across the width of a border. chosen: a linear ramp loses nothing that shows.
const NODES_PER_FEATHER: f64 = 4.0;

/// A painted region.
#[derive(Clone, Debug, PartialEq)]
pub struct BrushRegion {
    /// The user's name for it.
    pub name: String,
    /// What its canopy is made of.
    pub shares: Shares,
}

/// Regions painted over the landscape.
#[derive(Clone, Debug)]
pub struct Brush {
    /// The regions, at most [`MOST_REGIONS`].
    pub regions: Vec<BrushRegion>,
    /// 0 where nothing is painted, else the region's place in `regions` counted from 1; masked cells are unpainted.
    pub cells: Grid<u8>,
}

impl Brush {
    /// The region number of each cell, 0 where nothing is painted.
    pub(super) fn region_of_cells(&self) -> Vec<u8> {
        let valid = self.cells.mask().as_slice();
        let cells = self.cells.values().iter().zip(valid);
        cells.map(|(&region, &valid)| if valid { region } else { 0 }).collect()
    }
}

/// How far each place belongs to each region: 1 inside, 0 outside, linear across a border as wide as the feather.
pub(super) struct Blend {
    step: usize,
    node_rows: usize,
    node_cols: usize,
    /// Membership of each region at the nodes, row-major; over all regions they sum to 1.
    memberships: Vec<Vec<f32>>,
}

impl Blend {
    /// The blend of regions, a number a cell below `regions`.
    pub(super) fn new(frame: &Frame, cells: &[u8], regions: usize, feather_m: f32) -> Self {
        let feather_cells = f64::from(feather_m) / frame.transform.cell_m;
        let step = ((feather_cells / NODES_PER_FEATHER).floor() as usize).max(1);
        let (node_rows, node_cols) = (frame.rows.div_ceil(step), frame.cols.div_ceil(step));
        let radius = (feather_cells / 2.0 / step as f64).round() as usize;
        let mut memberships = vec![vec![0.0_f32; node_rows * node_cols]; regions];
        for (row, cells) in cells.chunks(frame.cols.max(1)).enumerate() {
            for (col, &region) in cells.iter().enumerate() {
                memberships[usize::from(region)][row / step * node_cols + col / step] += 1.0;
            }
        }
        for plane in &mut memberships {
            box_means(plane, node_cols, radius);
        }
        for node in 0..node_rows * node_cols {
            let sum: f32 = memberships.iter().map(|plane| plane[node]).sum();
            memberships.iter_mut().for_each(|plane| plane[node] /= sum.max(f32::MIN_POSITIVE));
        }
        Self { step, node_rows, node_cols, memberships }
    }

    /// Weights at the nodes from each region's, candidate after candidate.
    pub(super) fn node_weights(&self, weights: &[Vec<i32>], candidates: usize) -> Vec<f32> {
        let nodes = self.node_rows * self.node_cols;
        let mut blended = vec![0.0_f32; candidates * nodes];
        for (plane, weights) in self.memberships.iter().zip(weights) {
            for (blended, &weight) in blended.chunks_mut(nodes.max(1)).zip(weights) {
                for (to, membership) in blended.iter_mut().zip(plane) {
                    *to += membership * weight as f32; // below 2²⁴
                }
            }
        }
        blended
    }

    /// One candidate's weights along a row of cells, drawn out between the nodes.
    pub(super) fn fill_row(&self, nodes: &[f32], row: usize, weights: &mut [i32]) {
        let place = |cell: usize, count: usize| {
            let at = (cell as f32 + 0.5) / self.step as f32 - 0.5;
            let first = (at.max(0.0) as usize).min(count - 1); // a node before the cell, or the first
            (first, (first + 1).min(count - 1), (at - first as f32).clamp(0.0, 1.0))
        };
        let (upper, lower, down) = place(row, self.node_rows);
        let at_node = |col: usize| {
            let (a, b) = (nodes[upper * self.node_cols + col], nodes[lower * self.node_cols + col]);
            a + (b - a) * down
        };
        let mut between = (usize::MAX, 0.0, 0.0);
        for (col, weight) in weights.iter_mut().enumerate() {
            let (left, right, along) = place(col, self.node_cols);
            if between.0 != left {
                between = (left, at_node(left), at_node(right));
            }
            *weight = (between.1 + (between.2 - between.1) * along) as i32; // below 2²⁴
        }
    }
}

/// Replaces values by sums over squares, cut at the grid's edge.
fn box_means(values: &mut [f32], cols: usize, radius: usize) {
    if cols == 0 || radius == 0 {
        return;
    }
    let rows = values.len() / cols;
    let mut line = Vec::new();
    let mut smooth = |first: usize, stride: usize, count: usize, values: &mut [f32]| {
        line.clear();
        line.extend((0..count).map(|i| f64::from(values[first + i * stride])));
        // sums of whole numbers: exact
        let mut sum: f64 = line.iter().take(radius).sum();
        for i in 0..count {
            sum += line.get(i + radius).copied().unwrap_or(0.0);
            if i > radius {
                sum -= line[i - radius - 1];
            }
            values[first + i * stride] = sum as f32;
        }
    };
    (0..rows).for_each(|row| smooth(row * cols, 1, cols, values));
    (0..cols).for_each(|col| smooth(col, cols, rows, values));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Region 1 in the east, 0 in the west, cells of `cell_m`.
    fn halves(cell_m: f64) -> (Blend, usize) {
        let cols = (200.0 / cell_m) as usize;
        let frame = Frame::local(cols / 2, cols, cell_m);
        let cells: Vec<u8> = (0..frame.len()).map(|i| u8::from(i % cols >= cols / 2)).collect();
        (Blend::new(&frame, &cells, 2, 20.0), cols)
    }

    #[test]
    fn weights_ramp_across_a_border() {
        for cell_m in [0.5, 1.0, 2.0, 5.0] {
            let (blend, cols) = halves(cell_m);
            let nodes = blend.node_weights(&[vec![0], vec![10_000]], 1);
            let mut row = vec![0; cols];
            blend.fill_row(&nodes, 3, &mut row);
            for (col, &weight) in row.iter().enumerate() {
                let from_border_m = (col as f64 + 0.5) * cell_m - 100.0;
                let expected = 10_000.0 * (from_border_m / 20.0 + 0.5).clamp(0.0, 1.0);
                let error = (f64::from(weight) - expected).abs();
                assert!(error < 1_800.0, "{cell_m} m, {from_border_m} m: {weight} for {expected}");
            }
            assert!(row.windows(2).all(|pair| pair[1] >= pair[0]), "{cell_m}");
            assert_eq!((row[0], row[cols - 1]), (0, 10_000));
        }
    }
}
