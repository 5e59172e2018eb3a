//! Crowns of a coarse canopy on the scene's cells, and how they are brought to meet the coarse heights.

use std::ops::Range;

use rayon::prelude::*;

use super::detail::{Blocks, CANOPY_M};
use super::detail_trees::{CrownTree, Node, PLACES};
use crate::math::{lerp, smoothstep};
use crate::rng::{self, Key, Process};

/// Rows of cells drawn by one worker at a time.
const BAND_ROWS: usize = 32;
/// Blocks beyond its own that a crown reaches at most.
const REACH_BLOCKS: usize = 2;
/// Outline of crowns: 0 a cone, 1 a paraboloid. Fitted, see `detail_trees`.
const ROUNDNESS: f32 = 0.1;
/// How far crowns' outlines are bent at most, m. Fitted: real crowns are no circles.
const BEND_M: f32 = 1.0;
/// How far leaves lie below the crown's outline at most, as a share of the height. Chosen: within fitted crowns little
/// is left for leaves.
const ROUGHNESS_FRACTION: f32 = 0.05;
/// Share of canopy cells where the pulse falls through. Chosen: most of what measured canopies show are gaps.
const PIT_FRACTION: f32 = 0.008;
/// Tallest undergrowth between crowns, as a share of the coarse height. Fitted.
const UNDERGROWTH_FRACTION: f32 = 0.1;
/// Lowest of what fills even canopies between crowns, as a share of its height. Fitted.
const LEAST_FILLED_FRACTION: f32 = 0.45;
/// How much of the undergrowth's height differs from cell to cell, the rest over metres. Fitted.
const UNDERGROWTH_GRAIN: f32 = 0.5;
/// Undergrowth of open land: lowest share of the coarse height. Chosen: its 90th percentile then is about that height.
const OPEN_LOWEST_FRACTION: f32 = 0.15;
/// Least and greatest change of a block's heights in one correction. Chosen: beyond them crowns lose their form.
const CORRECTION_LIMITS: [f32; 2] = [0.5, 2.0];
/// Highest cell against the highest block near it. Chosen: as measured canopies' tops stand over the 90th percentile;
/// corrections lift splinters of crowns beyond it.
const HIGHEST_FRACTION: f32 = 1.15;
/// What of a coarse cell's cells lies below its height.
const PERCENTILE: f32 = 0.9;
/// Heights that stand over a block that shall be open, as shares of what they were. Chosen: undergrowth.
const CUT_FRACTION: f32 = 0.3;
/// Positions are rounded to this share of a metre: equal in windows whose corners differ by rounding.
const STEPS_PER_M: f64 = 1024.0;

/// How a line of the canvas's cells, west to east or north to south, lies in blocks.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Absolute number of the first cell.
    first: i64,
    /// By cell: its place.
    ticks: Vec<Tick>,
    /// By block: its cells.
    cells: Vec<Range<usize>>,
}

/// A cell's place along an axis.
#[derive(Clone, Copy, Debug)]
struct Tick {
    /// Block that holds the cell's centre.
    block: usize,
    /// Metres from the block's first edge.
    offset_m: f32,
    /// Lattice place that holds it, and how far it is to the next.
    node: usize,
    node_fraction: f32,
    /// The nearest other block, and its share in what is smooth across blocks.
    beside: usize,
    beside_weight: f32,
}

impl Axis {
    /// Cells from `first_m` on; `first_block` is the absolute number of block 0 of `blocks`.
    pub fn new(
        first_m: f64,
        cell_m: f64,
        cells: usize,
        first_block: i64,
        blocks: usize,
        block_m: f64,
    ) -> Self {
        let tick = |cell: usize| {
            let at_m = first_m + (cell as f64 + 0.5) * cell_m; // exact below 2⁵³
            let at_m = (at_m * STEPS_PER_M).round() / STEPS_PER_M;
            let block = (at_m / block_m).floor();
            let share = ((at_m - block * block_m) / block_m).clamp(0.0, 1.0) as f32; // a share
            // far below 2⁵³, and padding holds every cell's block
            let block_index = (block as i64 - first_block) as usize;
            let node_share = (share * PLACES as f32).min(PLACES as f32 - 1e-4); // a small count
            let node = node_share as usize; // cut to 0 or 1
            let far = (share - 0.5).abs();
            Tick {
                block: block_index,
                offset_m: (at_m - block * block_m) as f32, // some metres
                node: block_index * PLACES + node,
                node_fraction: node_share - node as f32,
                beside: if share < 0.5 { block_index - 1 } else { block_index + 1 },
                // blocks' middles keep their own, borders halve
                beside_weight: 0.5 * smoothstep(2.0 * far),
            }
        };
        let ticks: Vec<Tick> = (0..cells).map(tick).collect();
        let mut ranges = vec![0..0; blocks];
        for (cell, tick) in ticks.iter().enumerate() {
            let range = &mut ranges[tick.block];
            *range = if range.start == range.end { cell..cell + 1 } else { range.start..cell + 1 };
        }
        // a quarter keeps frames that begin on cells' edges or middles off the border between two numbers
        let first = (first_m / cell_m + 0.25).floor() as i64; // far below 2⁵³
        Self { first, ticks, cells: ranges }
    }

    fn len(&self) -> usize {
        self.ticks.len()
    }
}

/// Crown heights over the scene and a rim around it.
#[derive(Clone, Debug)]
pub struct Canvas<'a> {
    blocks: &'a Blocks,
    east: Axis,
    south: Axis,
    heights_m: Vec<f32>,
}

impl<'a> Canvas<'a> {
    /// Crowns, undergrowth and leaves as they fall out, not yet true to the coarse heights.
    pub fn drawn(
        blocks: &'a Blocks,
        [east, south]: [Axis; 2],
        nodes: &[Node],
        trees: &[Vec<CrownTree>],
        cell_m: f32,
        seed: u64,
    ) -> Self {
        let cols = east.len();
        let mut heights_m = vec![0.0; cols * south.len()];
        heights_m.par_chunks_mut(BAND_ROWS * cols).enumerate().for_each(|(band, heights_m)| {
            let first_row = band * BAND_ROWS;
            let rows = &south.ticks[first_row..][..heights_m.len() / cols];
            let bends = bends(&east.ticks, rows, nodes, blocks.cols * PLACES);
            crown_heights(heights_m, &bends, &east.ticks, rows, blocks.cell_m, trees, cell_m);
            let lines = heights_m.chunks_mut(cols).zip(bends.chunks(cols)).zip(rows);
            for (row, ((heights_m, bends), down)) in lines.enumerate() {
                // far below 2⁶³; rows count southwards, keys northwards
                let north = -(south.first + (first_row + row) as i64 + 1);
                for (col, (height_m, bend)) in heights_m.iter_mut().zip(bends).enumerate() {
                    let entity = rng::entity_of_cell(east.first + col as i64, north);
                    let process = Process::CanopyDetailRoughness;
                    let draws = rng::uniforms(Key { seed, process, year: 0, month: 0, entity });
                    let across = &east.ticks[col];
                    let coarse_m = smooth(&blocks.heights_m, blocks.cols, down, across);
                    let filled_m = smooth(&blocks.filled_m, blocks.cols, down, across);
                    let canopy = blocks.height_m(down.block, across.block) > CANOPY_M;
                    let low_m = undergrowth_m(coarse_m, canopy, filled_m, bend[2], draws[3]);
                    *height_m = rough(*height_m, low_m, draws);
                }
            }
        });
        Self { blocks, east, south, heights_m }
    }

    /// Brings each block's 90th percentile nearer to its coarse height, smoothly across blocks of the same kind.
    pub fn correct(&mut self) {
        let [least, greatest] = CORRECTION_LIMITS;
        let ratio = |(got_m, want_m): (f32, &f32)| {
            if got_m > 0.0 { (want_m / got_m).clamp(least, greatest) } else { 1.0 }
        };
        let ratios: Vec<f32> =
            self.percentiles().into_iter().zip(&self.blocks.heights_m).map(ratio).collect();
        let (blocks, cols) = (self.blocks, self.east.len());
        let lines = self.heights_m.par_chunks_mut(cols).zip(&self.south.ticks);
        lines.for_each(|(heights_m, down)| {
            for (height_m, across) in heights_m.iter_mut().zip(&self.east.ticks) {
                let here = down.block * blocks.cols + across.block;
                let canopy = blocks.heights_m[here] > CANOPY_M;
                // crowns are not pulled down by the open land beside them
                let near = |row: usize, col: usize| {
                    let near = row * blocks.cols + col;
                    let alike = (blocks.heights_m[near] > CANOPY_M) == canopy;
                    ratios[if alike { near } else { here }]
                };
                let own = lerp(ratios[here], near(down.block, across.beside), across.beside_weight);
                let other = lerp(
                    near(down.beside, across.block),
                    near(down.beside, across.beside),
                    across.beside_weight,
                );
                *height_m *= lerp(own, other, down.beside_weight);
            }
        });
    }

    /// The canvas without its rim of `rim` cells, with blocks that crossed the canopy's limit brought back behind it.
    pub fn finished(&self, rim: usize) -> Vec<f32> {
        let (percentiles_m, tops_m) = (self.percentiles(), self.blocks.tops_m());
        let (blocks, cols) = (self.blocks, self.east.len());
        let inner_cols = cols - 2 * rim;
        let mut heights_m = vec![0.0; inner_cols * (self.south.len() - 2 * rim)];
        heights_m.par_chunks_mut(inner_cols).enumerate().for_each(|(row, heights_m)| {
            let down = self.south.ticks[row + rim].block;
            let line = &self.heights_m[(row + rim) * cols + rim..][..inner_cols];
            let places = line.iter().zip(&self.east.ticks[rim..]);
            for (to_m, (height_m, across)) in heights_m.iter_mut().zip(places) {
                let block = down * blocks.cols + across.block;
                let (got_m, want_m) = (percentiles_m[block], blocks.heights_m[block]);
                let lift = if want_m > CANOPY_M && got_m <= CANOPY_M && got_m > 0.0 {
                    want_m / got_m
                } else {
                    1.0
                };
                *to_m = (height_m * lift).min(HIGHEST_FRACTION * tops_m[block]);
                let open = want_m <= CANOPY_M && (got_m > CANOPY_M || tops_m[block] <= CANOPY_M);
                if open && *to_m > CANOPY_M {
                    *to_m = want_m.min(*to_m * CUT_FRACTION);
                }
            }
        });
        heights_m
    }

    /// 90th percentile of each block's cells, 0 where the canvas has none of them.
    fn percentiles(&self) -> Vec<f32> {
        let cols = self.east.len();
        let mut percentiles_m = vec![0.0; self.blocks.heights_m.len()];
        let rows = percentiles_m.par_chunks_mut(self.blocks.cols).zip(&self.south.cells);
        rows.for_each(|(percentiles_m, rows)| {
            let mut cells = Vec::new();
            for (percentile_m, span) in percentiles_m.iter_mut().zip(&self.east.cells) {
                cells.clear();
                for row in rows.clone() {
                    cells.extend_from_slice(&self.heights_m[row * cols..][span.clone()]);
                }
                *percentile_m = percentile(&mut cells);
            }
        });
        percentiles_m
    }
}

/// What of the values lies below nine tenths of them, straight between two; 0 of none.
pub fn percentile(values: &mut [f32]) -> f32 {
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let at = PERCENTILE * last as f32; // a block has some hundred cells
    let below = at as usize; // cut
    let fraction = at - below as f32;
    let (_, &mut low, above) = values.select_nth_unstable_by(below, f32::total_cmp);
    match above.iter().copied().min_by(f32::total_cmp) {
        Some(high) => lerp(low, high, fraction),
        None => low,
    }
}

/// Bend of crowns to the east and to the south, in metres, and height of undergrowth, 0..1, smooth between nodes.
fn bends(east: &[Tick], south: &[Tick], nodes: &[Node], node_cols: usize) -> Vec<[f32; 3]> {
    let mut bends = Vec::with_capacity(east.len() * south.len());
    for down in south {
        let [north, next] =
            [0, 1].map(|step| &nodes[(down.node + step) * node_cols..][..node_cols]);
        bends.extend(east.iter().map(|across| {
            std::array::from_fn(|k| {
                let along = |line: &[Node]| {
                    let (a, b) = (line[across.node].draws[k], line[across.node + 1].draws[k]);
                    lerp(a, b, across.node_fraction)
                };
                let value = lerp(along(north), along(next), down.node_fraction);
                if k < 2 { BEND_M * value } else { value }
            })
        }));
    }
    bends
}

/// The highest crown surface over each cell's centre in a band of rows; cells without a crown are left as they are.
fn crown_heights(
    heights_m: &mut [f32],
    bends: &[[f32; 3]],
    east: &[Tick],
    south: &[Tick],
    block_m: f32,
    trees: &[Vec<CrownTree>],
    cell_m: f32,
) {
    let cols = east.len();
    let (first_across, first_down, last_down) = (&east[0], &south[0], &south[south.len() - 1]);
    let near = first_down.block - REACH_BLOCKS..last_down.block + REACH_BLOCKS + 1;
    for (block_row, trees) in near.clone().zip(&trees[near]) {
        for tree in trees {
            // differences of blocks are exact
            let metres = |to: usize, from: usize| (to as f32 - from as f32) * block_m;
            let at_east_m =
                metres(tree.block_col, first_across.block) + tree.east_m - first_across.offset_m;
            let at_south_m =
                metres(block_row, first_down.block) + tree.south_m - first_down.offset_m;
            // a cell more on either side for what rounding moves; `as` cuts negatives to 0
            let reach_m = tree.radius_m + BEND_M;
            let span = |at_m: f32, cells: usize| {
                let first = ((at_m - reach_m) / cell_m - 1.0) as usize;
                first..(((at_m + reach_m) / cell_m + 2.0) as usize).min(cells)
            };
            let per_radius2 = 1.0 / (tree.radius_m * tree.radius_m);
            for row in span(at_south_m, south.len()) {
                let down_m =
                    metres(south[row].block, block_row) + south[row].offset_m - tree.south_m;
                for col in span(at_east_m, cols) {
                    let across = &east[col];
                    let across_m =
                        metres(across.block, tree.block_col) + across.offset_m - tree.east_m;
                    let [bend_east_m, bend_south_m, _] = bends[row * cols + col];
                    let (e, s) = (across_m + bend_east_m, down_m + bend_south_m);
                    let share2 = (e * e + s * s) * per_radius2;
                    if share2 <= 1.0 {
                        let fall = lerp(share2.sqrt(), share2, ROUNDNESS);
                        let surface_m = tree.height_m * (1.0 - tree.depth_fraction * fall);
                        let height_m = &mut heights_m[row * cols + col];
                        *height_m = height_m.max(surface_m);
                    }
                }
            }
        }
    }
}

/// A value of blocks at a place, smooth across their borders.
fn smooth(values: &[f32], block_cols: usize, down: &Tick, across: &Tick) -> f32 {
    let along = |row: usize| {
        let line = &values[row * block_cols..][..block_cols];
        lerp(line[across.block], line[across.beside], across.beside_weight)
    };
    lerp(along(down.block), along(down.beside), down.beside_weight)
}

/// Height of what stands where no crown does: shrubs, herbs, and in even canopies the crowns of lower trees.
fn undergrowth_m(coarse_m: f32, canopy: bool, filled_m: f32, undergrowth: f32, grain: f32) -> f32 {
    let share = lerp(undergrowth, grain, UNDERGROWTH_GRAIN);
    if canopy {
        coarse_m * UNDERGROWTH_FRACTION * share * share
            + filled_m * lerp(LEAST_FILLED_FRACTION, 1.0, share)
    } else {
        coarse_m.min(CANOPY_M) * (OPEN_LOWEST_FRACTION + share)
    }
}

/// A crown's height with the roughness of leaves, at least that of the undergrowth.
fn rough(height_m: f32, low_m: f32, [texture, pit, depth, _]: [f32; 4]) -> f32 {
    if height_m <= low_m {
        return low_m;
    }
    if pit < PIT_FRACTION {
        return lerp(low_m, height_m, 0.6 * depth);
    }
    height_m * (1.0 - ROUGHNESS_FRACTION * texture * texture)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_percentile_is_that_of_straight_lines_between_ranks() {
        let mut values: Vec<f32> = (0..16).rev().map(|v| v as f32).collect();
        assert!((percentile(&mut values) - 13.5).abs() < 1e-5);
        assert_eq!(percentile(&mut [4.0]), 4.0);
        assert_eq!(percentile(&mut []), 0.0);
    }

    #[test]
    fn leaves_only_lower_the_surface_and_undergrowth_stays_below() {
        assert_eq!(rough(20.0, 3.0, [0.0, 1.0, 0.5, 0.5]), 20.0);
        let leaves = rough(20.0, 3.0, [1.0, 1.0, 0.5, 0.5]);
        assert!((leaves - 20.0 * (1.0 - ROUGHNESS_FRACTION)).abs() < 1e-4);
        assert!(rough(20.0, 3.0, [0.0, 0.0, 0.5, 0.5]) < 10.0);
        assert_eq!(rough(2.0, 3.0, [0.5; 4]), 3.0);
        assert!(undergrowth_m(20.0, true, 0.0, 1.0, 1.0) <= 20.0 * UNDERGROWTH_FRACTION);
        assert_eq!(undergrowth_m(20.0, true, 9.0, 0.0, 0.0), 9.0 * LEAST_FILLED_FRACTION);
        assert_eq!(undergrowth_m(0.0, false, 0.0, 1.0, 0.5), 0.0);
    }

    #[test]
    fn an_axis_is_the_same_from_another_start() {
        let whole = Axis::new(-7.0 * 0.914, 0.914, 60, -6, 40, 4.0);
        let part = Axis::new(9.0 * 0.914, 0.914, 20, -2, 40, 4.0);
        assert_eq!(whole.first + 16, part.first);
        for (cell, tick) in part.ticks.iter().enumerate() {
            let same = &whole.ticks[cell + 16];
            assert_eq!(tick.block + 4, same.block);
            assert_eq!(tick.offset_m.to_bits(), same.offset_m.to_bits());
        }
        for (block, cells) in whole.cells.iter().enumerate() {
            assert!(cells.clone().all(|cell| whole.ticks[cell].block == block));
        }
    }
}
