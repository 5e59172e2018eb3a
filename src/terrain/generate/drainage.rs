//! Where water runs: every cell's receiver and drained area, out of every hollow to the outlet.
//!
//! # Reference
//! Barnes et al. 2014, "Priority-flood", doi:10.1016/j.cageo.2013.04.024; steepest of eight neighbours:
//! O'Callaghan & Mark 1984, doi:10.1016/S0734-189X(84)80011-0.
//! # Departures
//! Falls are favoured at random, see [`WOBBLE`].
//! The priority queue holds 65,536 levels of height, first in first out within one, which makes it linear:
//! cells of one level (a few millimetres) may drain in either direction. Receivers are the steepest neighbours
//! among those flooded earlier, so the order of flooding is an order of the drainage tree and no cycle can arise.

use rayon::prelude::*;

use super::extent::Extent;

/// Height levels of the flood's queue.
const LEVELS: usize = 1 << 16;

/// Share by which a neighbour's fall is favoured or slighted at random. On an even slope the eight directions would
/// else draw valleys as straight lines (Fairfield & Leymarie 1991, doi:10.1029/90WR02658). Chosen: bridges the 8 %
/// by which the fall along a direction 22.5° off is less.
const WOBBLE: f32 = 0.25;

/// No cell.
const NONE: u32 = u32::MAX;

/// The eight neighbours: (row step, column step, cells in one over the distance).
const NEIGHBOURS: [(isize, isize, f32); 8] = [
    (-1, -1, std::f32::consts::FRAC_1_SQRT_2),
    (-1, 0, 1.0),
    (-1, 1, std::f32::consts::FRAC_1_SQRT_2),
    (0, -1, 1.0),
    (0, 1, 1.0),
    (1, -1, std::f32::consts::FRAC_1_SQRT_2),
    (1, 0, 1.0),
    (1, 1, std::f32::consts::FRAC_1_SQRT_2),
];

/// The drainage tree of a surface.
#[derive(Clone, Debug, Default)]
pub struct Drainage {
    /// Cells from the outlet upstream: every receiver stands before its givers.
    pub order: Vec<u32>,
    /// The cell each cell drains to; outlets drain to themselves.
    pub receiver: Vec<u32>,
    /// Distance to the receiver in cells, 0 at outlets.
    pub step_cells: Vec<f32>,
    /// Drained area in m², the cell's own included.
    pub area_m2: Vec<f32>,
}

impl Drainage {
    /// The drainage of `height_m` towards the cells named in `outlets`. `wobble` holds one random word a cell.
    ///
    /// # Panics
    /// If there is no outlet: then no cell would drain.
    pub fn of(height_m: &[f32], wobble: &[u32], outlets: &[u32], extent: &Extent) -> Self {
        assert!(!outlets.is_empty(), "a landscape without an outlet");
        let order = flood_order(height_m, outlets, extent);
        let mut rank = vec![0_u32; extent.len()];
        for (position, &cell) in order.iter().enumerate() {
            rank[cell as usize] = position as u32; // cells number less than 2³²
        }

        let mut receiver = vec![0_u32; extent.len()];
        let mut step_cells = vec![0.0_f32; extent.len()];
        receiver
            .par_chunks_mut(extent.cols)
            .zip(step_cells.par_chunks_mut(extent.cols))
            .enumerate()
            .for_each(|(row, (receivers, steps))| {
                for (col, (receiver, step)) in receivers.iter_mut().zip(steps).enumerate() {
                    let cell = row * extent.cols + col;
                    *receiver = cell as u32;
                    let mut steepest = f32::NEG_INFINITY;
                    for_neighbours(row, col, extent, |which, neighbour| {
                        // four bits of the word for each of eight neighbours
                        let bits = wobble[cell] >> (4 * which) & 15;
                        let favour = 1.0 + WOBBLE * (bits as f32 / 7.5 - 1.0);
                        let per_distance = NEIGHBOURS[which].2;
                        let fall = favour * per_distance * (height_m[cell] - height_m[neighbour]);
                        if rank[neighbour] < rank[cell] && fall > steepest {
                            steepest = fall;
                            (*receiver, *step) = (neighbour as u32, 1.0 / per_distance);
                        }
                    });
                }
            });
        for &outlet in outlets {
            (receiver[outlet as usize], step_cells[outlet as usize]) = (outlet, 0.0);
        }

        let cell_area = (extent.cell_m * extent.cell_m) as f32;
        let mut area_m2 = vec![cell_area; extent.len()];
        for &cell in order.iter().rev() {
            let to = receiver[cell as usize];
            if to != cell {
                area_m2[to as usize] += area_m2[cell as usize];
            }
        }
        Self { order, receiver, step_cells, area_m2 }
    }
}

/// Calls `visit` with number (0..8) and cell of each neighbour inside the extent.
#[inline]
pub fn for_neighbours(
    row: usize,
    col: usize,
    extent: &Extent,
    mut visit: impl FnMut(usize, usize),
) {
    let (rows, cols) = (extent.rows, extent.cols);
    let inside = row > 0 && col > 0 && row + 1 < rows && col + 1 < cols;
    for (which, (down, right, _)) in NEIGHBOURS.into_iter().enumerate() {
        let (r, c) = (row.wrapping_add_signed(down), col.wrapping_add_signed(right));
        if inside || (r < rows && c < cols) {
            visit(which, r * cols + c);
        }
    }
}

/// All cells in the order in which water rising from the outlets reaches them.
fn flood_order(height_m: &[f32], outlets: &[u32], extent: &Extent) -> Vec<u32> {
    let (low, high) = height_m
        .iter()
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), &z| (lo.min(z), hi.max(z)));
    let levels_per_m = (LEVELS - 1) as f32 / (high - low).max(1e-6);
    let level_of = |z: f32| (((z - low) * levels_per_m) as usize).min(LEVELS - 1);

    // one chain of cells a level: first, last, and each cell's successor
    let (mut first, mut last) = (vec![NONE; LEVELS], vec![NONE; LEVELS]);
    let mut next = vec![NONE; height_m.len()];
    let mut reached = vec![false; height_m.len()];
    let mut order = Vec::with_capacity(height_m.len());
    for &outlet in outlets {
        if !std::mem::replace(&mut reached[outlet as usize], true) {
            append(level_of(height_m[outlet as usize]), outlet, &mut first, &mut last, &mut next);
        }
    }
    for level in 0..LEVELS {
        while first[level] != NONE {
            let cell = first[level];
            first[level] = next[cell as usize];
            order.push(cell);
            let (row, col) = (cell as usize / extent.cols, cell as usize % extent.cols);
            for_neighbours(row, col, extent, |_, neighbour| {
                if !std::mem::replace(&mut reached[neighbour], true) {
                    // below the water table: drowned, and reached at this level
                    let at = level_of(height_m[neighbour]).max(level);
                    append(at, neighbour as u32, &mut first, &mut last, &mut next);
                }
            });
        }
    }
    order
}

fn append(level: usize, cell: u32, first: &mut [u32], last: &mut [u32], next: &mut [u32]) {
    if first[level] == NONE {
        first[level] = cell;
    } else {
        next[last[level] as usize] = cell;
    }
    last[level] = cell;
    next[cell as usize] = NONE;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn extent(rows: usize, cols: usize) -> Extent {
        Extent { rows, cols, cell_m: 2.0, west_m: 0.0, north_m: 2.0 * rows as f64 }
    }

    #[test]
    fn a_gutter_gathers_the_whole_roof() {
        // a trough along the middle column falling south, outlet at its foot
        let e = extent(6, 5);
        let height: Vec<f32> =
            (0..30).map(|i| (6 - i / 5) as f32 + 4.0 * (i % 5_usize).abs_diff(2) as f32).collect();
        let outlet = 5 * 5 + 2;
        let drainage = Drainage::of(&height, &[0; 30], &[outlet], &e);
        assert_eq!(drainage.area_m2[outlet as usize], 30.0 * 4.0);
        assert_eq!(drainage.receiver[outlet as usize], outlet);
        assert_eq!(drainage.receiver[2], 5 + 2);
    }

    #[test]
    fn hollows_drain_and_receivers_come_first() {
        let e = extent(9, 9);
        // a bowl: every path to the corner leads over the rim
        let height: Vec<f32> = (0..81)
            .map(|i| {
                let (r, c) = ((i / 9) as f32 - 4.0, (i % 9) as f32 - 4.0);
                r * r + c * c
            })
            .collect();
        let drainage = Drainage::of(&height, &[0; 81], &[0], &e);
        assert_eq!(drainage.order.len(), 81);
        assert_eq!(drainage.area_m2[0], 81.0 * 4.0);
        let mut seen = [false; 81];
        for &cell in &drainage.order {
            let to = drainage.receiver[cell as usize];
            assert!(to == cell || seen[to as usize]);
            seen[cell as usize] = true;
        }
    }
}
