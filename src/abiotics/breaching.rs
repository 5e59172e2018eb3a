//! Breaching: a trench through what dams a valley in the elevation model but not on the ground.
//!
//! A road crosses a stream on an embankment; the water goes through a culvert that airborne LiDAR does not
//! see. Filled, the valley would be a lake that spills wherever its banks are lowest. So from every pit the
//! cheapest trench to lower ground is sought, and dug where it is short and shallow enough to be a
//! culvert, a bridge or a gap in the data. Craters, kettles and dolines beyond that stay closed.
//!
//! With z₀ the pit's height, a trench that runs through cells of height zᵢ over steps of length lᵢ costs
//!
//! ```text
//! Σ lᵢ (max(zᵢ − z₀, 0) + c)        the earth to move, and a little for length alone
//! ```
//!
//! Every search sees the ground as it came, and a cell takes the lowest of the trenches through it: the
//! result depends on no order, and still every trench runs down to its end.
//!
//! # Reference
//! Least-cost trenches: Lindsay & Dhun 2015, "Modelling surface drainage patterns in altered landscapes
//! using LiDAR", International Journal of Geographical Information Science 29(3),
//! doi:10.1080/13658816.2014.975715. Bounded, the rest filled: Lindsay 2016, "Efficient hybrid
//! breaching-filling sink removal methods for flow path enforcement in digital elevation models",
//! Hydrological Processes 30(6), doi:10.1002/hyp.10648. Carving at least cost: Soille 2004, "Optimal removal
//! of spurious pits in grid digital elevation models", Water Resources Research 40(12),
//! doi:10.1029/2004WR003060.
//! # Departures
//! Lindsay 2016 follows the flood's path over the lowest saddle. Beside an incised stream that saddle is
//! often a low bank, not the road, and the trench would lead into a field.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use crate::progress::{Cancelled, Reporter};

use super::drainage::{NEIGHBOURS, neighbour_offsets, step};

/// Deepest trench, m below the ground and measured from the pit's height. chosen: road and field
/// embankments over streams; a dam higher than that is one.
const MAX_DEPTH_M: f32 = 5.0;

/// Longest trench, m. chosen: the foot of an embankment 5 m high under a road of two lanes is about
/// 30 m wide, and culverts cross aslant.
const MAX_LENGTH_M: f32 = 60.0;

/// Longest trench, cells. chosen: on cells under 1 m the time of a search grows with the square of this.
const MAX_LENGTH_CELLS: f32 = 60.0;

/// Cost of a trench's length, as metres of depth. chosen: tells equal cuts apart, no more.
const LENGTH_COST_M: f32 = 0.02;

/// Fall of a trench, m per m, where its end lies low enough. chosen: a culvert's.
const TRENCH_FALL: f32 = 0.01;

/// Pits searched by one task. chosen: keeps the threads busy, costs no memory to speak of.
const PITS_PER_TASK: usize = 64;

/// Digs trenches from the pits of `height_m`, which has a rim (see `drainage`), where they may be dug.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
pub(super) fn breach(
    height_m: &mut [f32],
    stride: usize,
    cell_m: f32,
    reporter: &Reporter,
) -> Result<(), Cancelled> {
    let pits = pits(height_m, stride);
    let ground_m = &*height_m;
    let trenches: Vec<Result<Vec<Dug>, Cancelled>> = pits
        .par_chunks(PITS_PER_TASK)
        .map_init(
            || Search::new(cell_m),
            |search, pits| {
                reporter.check_cancelled()?;
                let mut dug = Vec::new();
                for &pit in pits {
                    search.run(ground_m, stride, pit, &mut dug);
                }
                Ok(dug)
            },
        )
        .collect();
    for dug in trenches {
        for (p, floor_m) in dug? {
            height_m[p] = height_m[p].min(floor_m);
        }
    }
    Ok(())
}

/// A cell of a trench and its height there.
type Dug = (usize, f32);

/// Cells inland from which no way leads down, one or a few for each level floor.
fn pits(height_m: &[f32], stride: usize) -> Vec<usize> {
    let offsets = neighbour_offsets(stride);
    let is_pit = |p: usize| {
        let here = height_m[p];
        offsets.iter().all(|&o| {
            let n = step(p, o);
            // of equals the first stands for all; water leaves at an edge
            (height_m[n] > here || (height_m[n] == here && n > p)) && height_m[n] != f32::INFINITY
        })
    };
    let rows = height_m.len() / stride;
    (1..rows.saturating_sub(1))
        .into_par_iter()
        .flat_map_iter(|row| (row * stride + 1..(row + 1) * stride - 1).filter(|&p| is_pit(p)))
        .collect()
}

/// What a search knows of a cell.
#[derive(Clone, Copy, Default)]
struct Visit {
    /// The search that wrote this; other entries are blank.
    search: u32,
    cost: f32,
    length_cells: f32,
    /// Direction the cell was reached in.
    direction: u8,
    is_settled: bool,
}

/// A search for trenches; holds the square of cells around the pit that one may reach.
struct Search {
    cell_m: f32,
    max_length_cells: f32,
    /// Half the square's width, in cells.
    reach: isize,
    width: isize,
    visits: Vec<Visit>,
    current: u32,
    /// Cost as ordered bits, place in the square.
    queue: BinaryHeap<Reverse<(u32, u32)>>,
    /// Cells of a trench from its end up, with the length from the pit.
    path: Vec<(usize, f32)>,
}

impl Search {
    fn new(cell_m: f32) -> Self {
        let max_length_cells = (MAX_LENGTH_M / cell_m).min(MAX_LENGTH_CELLS);
        let reach = max_length_cells as isize; // at most 60
        let width = 2 * reach + 1;
        Self {
            cell_m,
            max_length_cells,
            reach,
            width,
            visits: vec![Visit::default(); (width * width) as usize],
            current: 0,
            queue: BinaryHeap::new(),
            path: Vec::new(),
        }
    }

    /// Seeks the cheapest trench from a pit to lower ground; adds its cells to `dug` if there is one.
    fn run(&mut self, ground_m: &[f32], stride: usize, pit: usize, dug: &mut Vec<Dug>) {
        let offsets = neighbour_offsets(stride);
        let pit_m = ground_m[pit];
        self.current += 1;
        self.queue.clear();
        let centre = self.reach * self.width + self.reach;
        self.visits[centre as usize] = Visit { search: self.current, ..Visit::default() };
        self.queue.push(Reverse((0, centre as u32)));

        while let Some(Reverse((_, place))) = self.queue.pop() {
            let visit = &mut self.visits[place as usize];
            if std::mem::replace(&mut visit.is_settled, true) {
                continue;
            }
            let visit = *visit;
            let (row, col) = (place as isize / self.width, place as isize % self.width);
            let p = step(pit, (row - self.reach) * stride as isize + col - self.reach);
            if ground_m[p] < pit_m {
                self.dig(ground_m, offsets, pit, (p, place as usize), dug);
                return;
            }
            for (direction, &(d_row, d_col)) in NEIGHBOURS.iter().enumerate() {
                let step_cells = STEP_CELLS[direction];
                let length_cells = visit.length_cells + step_cells;
                if length_cells > self.max_length_cells {
                    continue; // so the square is never left
                }
                let height_m = ground_m[step(p, offsets[direction])];
                let depth_m = (height_m - pit_m).max(0.0);
                if depth_m > MAX_DEPTH_M {
                    continue; // rim and voids too
                }
                let cost = visit.cost + step_cells * (depth_m + LENGTH_COST_M);
                let to = ((row + d_row) * self.width + col + d_col) as usize;
                let known = &mut self.visits[to];
                if known.search != self.current || (!known.is_settled && cost < known.cost) {
                    *known = Visit {
                        search: self.current,
                        cost,
                        length_cells,
                        direction: direction as u8, // 0–7
                        is_settled: false,
                    };
                    self.queue.push(Reverse((cost.to_bits(), to as u32))); // costs are ≥ 0
                }
            }
        }
    }

    /// Digs from the pit to the end that was found.
    fn dig(
        &mut self,
        ground_m: &[f32],
        offsets: [isize; 8],
        pit: usize,
        (end, end_place): (usize, usize),
        dug: &mut Vec<Dug>,
    ) {
        let (mut p, mut place) = (end, end_place);
        self.path.clear();
        while p != pit {
            let visit = self.visits[place];
            self.path.push((p, visit.length_cells));
            let direction = visit.direction as usize;
            let (d_row, d_col) = NEIGHBOURS[direction];
            p = step(p, -offsets[direction]);
            place = step(place, -(d_row * self.width + d_col));
        }
        let (pit_m, end_m) = (ground_m[pit], ground_m[end]);
        let end_cells = self.path[0].1;
        let fall_m = ((pit_m - end_m) / end_cells).min(TRENCH_FALL * self.cell_m);
        let cells = self.path.iter().rev().take(self.path.len() - 1);
        dug.extend(cells.map(|&(p, length_cells)| (p, pit_m - length_cells * fall_m)));
    }
}

/// Distance to each of [`NEIGHBOURS`], in cells.
const STEP_CELLS: [f32; 8] = {
    let d = std::f32::consts::SQRT_2;
    [1.0, d, 1.0, d, 1.0, d, 1.0, d]
};

#[cfg(test)]
mod tests {
    use super::super::drainage::{DrainageSurface, padded, rimmed};
    use super::*;
    use crate::math::sin;
    use crate::raster::{Cell, Grid};

    fn breached(elevation_m: &Grid<f32>) -> Grid<f32> {
        let (stride, frame) = (elevation_m.frame().cols + 2, elevation_m.frame());
        let mut height_m = rimmed(elevation_m);
        breach(&mut height_m, stride, frame.cell_m(), &Reporter::silent()).unwrap();
        Grid::from_fn(frame.rows, frame.cols, f64::from(frame.cell_m()), |cell| {
            height_m[padded(stride, cell.row, cell.col)]
        })
    }

    /// A bed 2 m deep and 3 m wide in a plain that falls south and a little west, crossed at rows 50–57 by a
    /// road whose crown lies 3 m above the bed; water that cannot pass would go round over the plain.
    fn dammed() -> Grid<f32> {
        Grid::from_fn(120, 100, 1.0, |cell| {
            let plain_m = 300.0 - 0.01 * cell.row as f32 + 0.004 * cell.col as f32;
            let in_bed = (59..62).contains(&cell.col);
            if in_bed && (50..58).contains(&cell.row) {
                return plain_m + 1.0;
            }
            if in_bed { plain_m - 2.0 } else { plain_m }
        })
    }

    /// Where water from a cell leaves the map.
    fn outlet(elevation_m: &Grid<f32>, mut cell: Cell) -> Cell {
        let surface = DrainageSurface::new(elevation_m, &Reporter::silent()).unwrap();
        while let Some(next) = surface.receiver(cell) {
            assert!(surface.height_m(next) < surface.height_m(cell));
            cell = next;
        }
        cell
    }

    #[test]
    fn a_stream_goes_on_beneath_a_road() {
        let elevation_m = dammed();
        let end = outlet(&elevation_m, Cell { row: 20, col: 60 });
        assert!(end.row == 119 && (59..62).contains(&end.col), "{end:?}");
        let breached = breached(&elevation_m);
        let cut: Vec<usize> =
            (0..120 * 100).filter(|&i| breached.values()[i] < elevation_m.values()[i]).collect();
        assert!(cut.iter().all(|i| (50..58).contains(&(i / 100))), "only the road is cut");
        assert!((8..=20).contains(&cut.len()), "a trench, not a valley: {}", cut.len());
    }

    #[test]
    fn a_dam_higher_than_a_culverts_holds() {
        let walled = Grid::from_fn(120, 100, 1.0, |cell| {
            let wall_m = if (50..58).contains(&cell.row) { MAX_DEPTH_M + 1.0 } else { 0.0 };
            300.0 - 0.01 * cell.row as f32 - 0.02 * cell.col.abs_diff(60) as f32 + wall_m
        });
        assert_eq!(breached(&walled).values(), walled.values());
    }

    #[test]
    fn a_long_dam_holds() {
        let broad = Grid::from_fn(200, 9, 1.0, |cell| match (cell.row, cell.col) {
            (50..=115, 1..=7) => 3.0,
            (row, 1..=7) => 1.0 - 0.001 * row as f32,
            _ => 30.0,
        });
        assert_eq!(breached(&broad).values(), broad.values());
    }

    #[test]
    fn a_crater_stays_closed() {
        let crater = Grid::from_fn(150, 150, 1.0, |cell| {
            let (r, c) = (cell.row as f32 - 75.0, cell.col as f32 - 75.0);
            let distance = (r * r + c * c).sqrt();
            500.0 - 0.05 * distance - (20.0 - 0.5 * distance).max(0.0)
        });
        assert_eq!(breached(&crater).values(), crater.values());
        let surface = DrainageSurface::new(&crater, &Reporter::silent()).unwrap();
        let filled_m = surface.height_m(Cell { row: 75, col: 75 }) - 480.0;
        assert!((17.5..18.5).contains(&filled_m), "filled by {filled_m} m to its rim");
    }

    #[test]
    fn trenches_run_down_and_only_ever_lower_the_ground() {
        let rough = Grid::from_fn(90, 110, 1.0, |cell| {
            let (r, c) = (cell.row as f32, cell.col as f32);
            100.0 + 2.0 * sin(r * 12.9898 + c * 78.233) + 7.0 * sin(r * 0.31) * sin(c * 0.23)
        });
        let breached = breached(&rough);
        let inland = |i: &usize| (1..89).contains(&(i / 110)) && (1..109).contains(&(i % 110));
        let has_lower = |grid: &Grid<f32>, i: usize| {
            neighbour_offsets(110).iter().any(|&o| grid.values()[step(i, o)] < grid.values()[i])
        };
        let mut cut = 0;
        for i in (0..90 * 110).filter(inland) {
            let (before, after) = (rough.values()[i], breached.values()[i]);
            assert!(after <= before && before - after <= MAX_DEPTH_M + 0.7, "cell {i}");
            assert!(after == before || has_lower(&breached, i), "trench cell {i} is a pit");
            cut += usize::from(after < before);
        }
        let pits = |grid: &Grid<f32>| {
            (0..90 * 110).filter(inland).filter(|&i| !has_lower(grid, i)).count()
        };
        assert!(cut > 100 && pits(&breached) * 5 < pits(&rough), "{cut}, {}", pits(&breached));
    }
}
