//! Detail: canopy heights at 4 m brought to the terrain's cell with crowns, not with a blur.
//!
//! Crowns as narrow or as wide as their height asks for stand where the coarse map has its tops, stay below its low
//! places, and are then stretched until each coarse cell's 90th percentile is the height it had. Draws are keyed by
//! absolute place: a window of a map is the same as the map, as far as the coarse heights agree up to [`MARGIN_CELLS`]
//! around it.
//!
//! # Departures
//! From what was measured: airborne canopies of 1 m (British Columbia, Florida) brought to 4 m and back keep their
//! coarse heights within 6 % and all of their coarse footprint; height differences at 1–8 m come within a quarter,
//! rumple, tops a hectare and cover within a tenth. Single crowns are not those that were measured.

use rayon::prelude::*;

use super::detail_surface::{Axis, Canvas};
use super::detail_trees;
use crate::math::lerp;
use crate::raster::{Grid, MapPoint};

/// Heights above this are canopy, m.
pub const CANOPY_M: f32 = 3.0;
/// Coarse cells around the frame that cells of it depend on: 10.5 by thinning (seven passes of three places), 2 by
/// the trees' form, 2 by crowns and 3 by corrections, rounded up. Where the coarse map has fewer, its rim goes on.
pub const MARGIN_CELLS: usize = 18;
/// Spread of the heights around a block, as a share of their mean, from which on a canopy is uneven. Read off the
/// measured canopies that `detail_trees` is fitted to: the more neighbours differ, the deeper the gaps between crowns.
const UNEVEN_SPREAD: f32 = 0.5;
/// How high even canopies are filled between crowns, as a share of their height, by each metre of height. Fitted.
const FILL_PER_M: f32 = 0.016;
/// Most of the height that is filled. Chosen: what is measured in tall, even canopy.
const MOST_FILL_FRACTION: f32 = 0.6;
/// Blocks beyond the frame that are drawn, for the corrections of those in it.
const DRAWN_BLOCKS: f64 = 4.0;
/// Corrections towards the coarse heights. Chosen: the third takes a quarter of the error that two leave.
const CORRECTIONS: usize = 3;
/// Cells of at least this share of a coarse cell show no crowns.
const CROWNLESS_FRACTION: f64 = 0.75;

/// Canopy heights on square cells that are aligned to multiples of their width in map coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct CoarseCanopy {
    /// Absolute number of the westernmost cells: their west edge lies at so many cell widths.
    pub first_east: i64,
    /// Absolute number of the northernmost cells: their south edge lies at so many cell widths.
    pub first_north: i64,
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
    /// Cell width.
    pub cell_m: f64,
    /// Heights above ground, row-major from the north-west: what nine tenths of a cell's surface lie below.
    pub heights_m: Vec<f32>,
}

impl CoarseCanopy {
    /// The height at so many rows and columns from the north-west corner; beyond the rim, that of the rim; none below 0.
    fn height_m(&self, row: i64, col: i64) -> f32 {
        // sizes are far below 2⁶³, and what is clamped lies within them
        let row = row.clamp(0, self.rows as i64 - 1) as usize;
        let col = col.clamp(0, self.cols as i64 - 1) as usize;
        self.heights_m[row * self.cols + col].max(0.0)
    }

    /// The height at a place: smooth within canopy and within open land, the border between them kept as it is.
    fn crisp_m(&self, at: MapPoint) -> f32 {
        // whole numbers below 2⁵³ are exact; rounding keeps centres that meet coarse centres on them
        let rounded = |cells: f64| (cells * 1024.0).round() / 1024.0;
        let east = rounded(at.east_m / self.cell_m - self.first_east as f64);
        let south = rounded((self.first_north + 1) as f64 - at.north_m / self.cell_m);
        let here_m = self.height_m(south.floor() as i64, east.floor() as i64); // far below 2⁵³
        let (east, south) = (east - 0.5, south - 0.5);
        let (col, row) = (east.floor(), south.floor());
        let (east, south) = ((east - col) as f32, (south - row) as f32); // shares
        let near = |down: i64, across: i64| {
            let near_m = self.height_m(row as i64 + down, col as i64 + across);
            if (near_m > CANOPY_M) == (here_m > CANOPY_M) { near_m } else { here_m }
        };
        let north_m = lerp(near(0, 0), near(0, 1), east);
        let south_m = lerp(near(1, 0), near(1, 1), east);
        let smooth_m = lerp(north_m, south_m, south);
        // rounding must not carry it over the limit
        if (smooth_m > CANOPY_M) == (here_m > CANOPY_M) { smooth_m } else { here_m }
    }
}

/// Coarse heights over the frame and [`MARGIN_CELLS`] around it; rows count southwards.
#[derive(Clone, Debug)]
pub(super) struct Blocks {
    pub rows: usize,
    pub cols: usize,
    /// Absolute number of column 0.
    pub first_east: i64,
    /// Absolute number of row 0, counted southwards.
    pub first_south: i64,
    pub cell_m: f32,
    pub heights_m: Vec<f32>,
    /// By block: 1 where it and the eight around it are equally tall, 0 where they differ by [`UNEVEN_SPREAD`].
    pub evenness: Vec<f32>,
    /// By block: how high it is filled where no crown is, at most.
    pub filled_m: Vec<f32>,
}

impl Blocks {
    /// The blocks around a rectangle, given by its west and north edges and its extent.
    fn around(
        coarse: &CoarseCanopy,
        [west_m, south_start_m]: [f64; 2],
        extent_m: [f64; 2],
    ) -> Self {
        let number = |m: f64| (m / coarse.cell_m).floor() as i64; // far below 2⁵³
        let margin = MARGIN_CELLS as i64; // small
        let (first_east, first_south) = (number(west_m) - margin, number(south_start_m) - margin);
        let count = |first: i64, end_m: f64| (number(end_m) + margin - first + 1) as usize; // positive
        let cols = count(first_east, west_m + extent_m[0]);
        let rows = count(first_south, south_start_m + extent_m[1]);
        // rows of the coarse map begin south of this edge
        let (down, across) = (first_south + coarse.first_north + 1, first_east - coarse.first_east);
        let height_m = |index: usize| {
            coarse.height_m((index / cols) as i64 + down, (index % cols) as i64 + across)
        };
        let heights_m = (0..rows * cols).map(height_m).collect();
        Self::new([rows, cols], [first_east, first_south], coarse.cell_m as f32, heights_m) // some metres
    }

    /// Blocks of given heights.
    pub fn new(
        [rows, cols]: [usize; 2],
        [first_east, first_south]: [i64; 2],
        cell_m: f32,
        heights_m: Vec<f32>,
    ) -> Self {
        let (evenness, filled_m) = (Vec::new(), Vec::new());
        let mut blocks =
            Self { rows, cols, first_east, first_south, cell_m, heights_m, evenness, filled_m };
        let even = |block: usize| {
            let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
            for near_m in blocks.around_block(block, 1) {
                count += 1.0;
                sum += near_m;
                squares += near_m * near_m;
            }
            let mean = sum / count;
            let variance: f32 = squares / count - mean * mean;
            if mean > 0.0 {
                (1.0 - variance.max(0.0).sqrt() / (UNEVEN_SPREAD * mean)).max(0.0)
            } else {
                0.0
            }
        };
        let evenness: Vec<f32> = (0..rows * cols).into_par_iter().map(even).collect();
        let filled = |(height_m, even): (&f32, &f32)| {
            if *height_m > CANOPY_M {
                height_m * (FILL_PER_M * height_m * even).min(MOST_FILL_FRACTION)
            } else {
                0.0
            }
        };
        blocks.filled_m = blocks.heights_m.iter().zip(&evenness).map(filled).collect();
        blocks.evenness = evenness;
        blocks
    }

    /// Heights of a block and of those up to `reach` rows and columns from it.
    pub fn around_block(&self, block: usize, reach: usize) -> impl Iterator<Item = f32> + '_ {
        let (row, col) = (block / self.cols, block % self.cols);
        let rows = row.saturating_sub(reach)..(row + reach + 1).min(self.rows);
        let cols = col.saturating_sub(reach)..(col + reach + 1).min(self.cols);
        rows.flat_map(move |row| &self.heights_m[row * self.cols..][cols.clone()]).copied()
    }

    /// The coarse height of a block.
    pub fn height_m(&self, row: usize, col: usize) -> f32 {
        self.heights_m[row * self.cols + col]
    }

    /// Of each block and the eight around it the greatest height.
    pub fn tops_m(&self) -> Vec<f32> {
        let top_m = |block| self.around_block(block, 1).fold(f32::NEG_INFINITY, f32::max);
        (0..self.heights_m.len()).into_par_iter().map(top_m).collect()
    }
}

/// Canopy height in metres on the ground's frame, 0 where masked: crowns, gaps and edges whose 90th percentile in each
/// coarse cell is about the coarse height. Cells of three quarters of a coarse cell and more show the coarse heights
/// themselves, smoothed inside canopy, with its border as it is. Equal bits for any number of threads.
///
/// # Panics
/// If the coarse heights do not fill their grid or are no finite numbers.
pub fn detailed(coarse: &CoarseCanopy, ground: &Grid<f32>, seed: u64) -> Grid<f32> {
    assert_eq!(coarse.rows * coarse.cols, coarse.heights_m.len(), "coarse heights fill no grid");
    assert!(!coarse.heights_m.is_empty(), "no coarse heights");
    if let Some(bad) = coarse.heights_m.iter().position(|h| !h.is_finite()) {
        panic!("coarse height {} at cell {bad} is no number", coarse.heights_m[bad]);
    }
    let frame = ground.frame();
    let mut heights_m = if frame.transform.cell_m >= CROWNLESS_FRACTION * coarse.cell_m {
        let height_m = |index| coarse.crisp_m(frame.transform.center(frame.cell(index)));
        (0..frame.len()).into_par_iter().map(height_m).collect()
    } else {
        with_crowns(coarse, ground, seed)
    };
    for (height_m, valid) in heights_m.iter_mut().zip(ground.mask().as_slice()) {
        if !valid {
            *height_m = 0.0;
        }
    }
    ground.with_values(heights_m)
}

fn with_crowns(coarse: &CoarseCanopy, ground: &Grid<f32>, seed: u64) -> Vec<f32> {
    let frame = ground.frame();
    let t = frame.transform;
    let extent_m = [frame.cols, frame.rows].map(|cells| cells as f64 * t.cell_m); // exact below 2⁵³
    let blocks = Blocks::around(coarse, [t.west_m, -t.north_m], extent_m);
    let (nodes, trees) = detail_trees::planted(&blocks, seed);
    // a rim of whole cells, so that the frame's own keep their places
    let rim = (DRAWN_BLOCKS * coarse.cell_m / t.cell_m).ceil() as usize + 1; // some dozens
    let axis = |first_m: f64, cells: usize, first_block: i64, block_count: usize| {
        let first_m = first_m - rim as f64 * t.cell_m;
        Axis::new(first_m, t.cell_m, cells + 2 * rim, first_block, block_count, coarse.cell_m)
    };
    let east = axis(t.west_m, frame.cols, blocks.first_east, blocks.cols);
    let south = axis(-t.north_m, frame.rows, blocks.first_south, blocks.rows);
    let mut canvas = Canvas::drawn(&blocks, [east, south], &nodes, &trees, frame.cell_m(), seed);
    for _ in 0..CORRECTIONS {
        canvas.correct();
    }
    canvas.finished(rim)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::detail_surface::percentile;
    use super::*;
    use crate::math;
    use crate::raster::{Cell, Crs, Frame, GeoTransform, Mask};

    const FIRST_EAST: i64 = -40;
    const FIRST_NORTH: i64 = 70;

    /// Stands of 6–25 m with glades, on cells of 4 m.
    fn coarse(rows: usize, cols: usize) -> CoarseCanopy {
        let height_m = |index: usize| {
            let (y, x) = ((index / cols) as f32, (index % cols) as f32);
            let stand = 15.0 + 8.0 * math::sin(x / 9.0) * math::cos(y / 7.0);
            let tops = 3.0 * math::sin(x * 2.3 + y * 1.1) * math::cos(y * 2.9 - x * 0.7);
            let glade = math::sin(x / 5.0 + 1.0) + math::cos(y / 6.0) > 1.25;
            if glade { 0.4 + 0.1 * tops } else { stand + tops }
        };
        let heights_m = (0..rows * cols).map(height_m).collect();
        let (first_east, first_north) = (FIRST_EAST, FIRST_NORTH);
        CoarseCanopy { first_east, first_north, rows, cols, cell_m: 4.0, heights_m }
    }

    /// Ground of `rows` × `cols` cells whose north-west corner lies so many metres inside that of [`coarse`].
    fn ground(inside_m: [f64; 2], rows: usize, cols: usize, cell_m: f64) -> Grid<f32> {
        let transform = GeoTransform {
            west_m: FIRST_EAST as f64 * 4.0 + inside_m[0],
            north_m: (FIRST_NORTH + 1) as f64 * 4.0 - inside_m[1],
            cell_m,
        };
        let frame = Frame { rows, cols, transform, crs: Crs::Local };
        let mask = Mask::all_valid(frame.len());
        Grid::new(Arc::new(frame), Arc::new(mask), vec![0.0; rows * cols])
    }

    #[test]
    fn brought_back_to_coarse_cells_it_is_the_coarse_map() {
        let coarse = coarse(90, 90);
        for (cell_m, per_block) in [(1.0, 4), (0.5, 8), (0.25, 16), (2.0, 2)] {
            let fine =
                detailed(&coarse, &ground([60.0; 2], 60 * per_block, 60 * per_block, cell_m), 5);
            let (mut squares, mut sum, mut canopy, mut agreeing) = (0.0, 0.0, 0, 0);
            for block in 0..3600 {
                let (row, col) = (block / 60, block % 60);
                let mut cells = Vec::new();
                for r in row * per_block..(row + 1) * per_block {
                    cells.extend_from_slice(&fine.row(r)[col * per_block..][..per_block]);
                }
                let got_m = percentile(&mut cells);
                let want_m = coarse.heights_m[(row + 15) * 90 + col + 15];
                agreeing += usize::from((got_m > CANOPY_M) == (want_m > CANOPY_M));
                if want_m > CANOPY_M {
                    squares += f64::from((got_m - want_m) * (got_m - want_m));
                    sum += f64::from(want_m);
                    canopy += 1;
                }
            }
            assert!((1500..3400).contains(&canopy), "{canopy} blocks of canopy");
            let mean_m = sum / f64::from(canopy);
            let error = (squares / f64::from(canopy)).sqrt() / mean_m;
            assert!(error < 0.08, "cells of {cell_m} m: off by {error} of {mean_m} m");
            assert!(agreeing >= 3564, "cells of {cell_m} m: {agreeing} of 3600 agree");
        }
    }

    #[test]
    fn a_window_shows_what_the_map_shows() {
        let coarse = coarse(90, 90);
        for cell_m in [1.0, 0.914, 0.4, 2.5] {
            let cells = (120.0 / cell_m) as usize;
            let whole = detailed(&coarse, &ground([100.0; 2], cells, cells, cell_m), 5);
            let (row, col, rows, cols) = (cells / 3, cells / 4, cells / 3, cells / 2);
            let west_m = 100.0 + col as f64 * cell_m;
            let south_m = 100.0 + row as f64 * cell_m;
            let place = ground([west_m, south_m], rows, cols, cell_m);
            // the least coarse map that a window asks for
            let cut = cut(&coarse, &place);
            let part = detailed(&cut, &place, 5);
            for r in 0..rows {
                assert_eq!(part.row(r), &whole.row(row + r)[col..][..cols], "cells of {cell_m} m");
            }
        }
    }

    /// The coarse cells of a frame and the margin around it.
    fn cut(coarse: &CoarseCanopy, place: &Grid<f32>) -> CoarseCanopy {
        let t = place.frame().transform;
        let margin = MARGIN_CELLS as i64;
        let south_west = place.frame().south_west();
        let east_m = t.west_m + place.frame().cols as f64 * t.cell_m;
        let number = |m: f64| (m / 4.0).floor() as i64;
        let (first_east, last_east) = (number(t.west_m) - margin, number(east_m) + margin);
        let (last_north, first_north) =
            (number(south_west.north_m) - margin, number(t.north_m) + margin);
        let (rows, cols) =
            ((first_north - last_north + 1) as usize, (last_east - first_east + 1) as usize);
        let (down, across) = (coarse.first_north - first_north, first_east - coarse.first_east);
        assert!(down >= 0 && across >= 0);
        let height_m =
            |i: usize| coarse.height_m((i / cols) as i64 + down, (i % cols) as i64 + across);
        let heights_m = (0..rows * cols).map(height_m).collect();
        CoarseCanopy { first_east, first_north, rows, cols, cell_m: 4.0, heights_m }
    }

    #[test]
    fn the_canopy_is_the_same_for_any_number_of_threads() {
        let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        let coarse = coarse(60, 60);
        let draw = || detailed(&coarse, &ground([50.0; 2], 150, 130, 1.0), 5);
        assert!(pool(1).install(draw).values() == pool(3).install(draw).values());
    }

    #[test]
    fn cells_of_the_coarse_map_keep_its_bits_and_large_ones_its_border() {
        let coarse = coarse(60, 60);
        let same = detailed(&coarse, &ground([40.0; 2], 30, 35, 4.0), 5);
        for (index, height_m) in same.values().iter().enumerate() {
            let Cell { row, col } = same.frame().cell(index);
            assert_eq!(*height_m, coarse.heights_m[(row + 10) * 60 + col + 10]);
        }
        for cell_m in [3.0, 3.7, 5.0] {
            let other = detailed(&coarse, &ground([41.0; 2], 20, 20, cell_m), 5);
            for (index, height_m) in other.values().iter().enumerate() {
                let at = other.frame().transform.center(other.frame().cell(index));
                let east = (at.east_m / 4.0).floor() as i64 - FIRST_EAST;
                let south = FIRST_NORTH - (at.north_m / 4.0).floor() as i64;
                let nearest_m = coarse.height_m(south, east);
                assert_eq!(*height_m > CANOPY_M, nearest_m > CANOPY_M, "{at:?}");
            }
        }
    }

    /// Cells higher than their eight neighbours and 3 m, on a hectare.
    fn tops_per_ha(fine: &Grid<f32>) -> f64 {
        let Frame { rows, cols, .. } = **fine.frame();
        let top = |row: usize, col: usize| {
            let around = (0..9).filter(|i| *i != 4).map(|i| (row + i / 3 - 1, col + i % 3 - 1));
            let height_m = fine[Cell { row, col }];
            let mut around = around.map(|(row, col)| fine[Cell { row, col }]);
            height_m > CANOPY_M && around.all(|h| h < height_m)
        };
        let inner = (1..rows - 1).flat_map(|r| (1..cols - 1).map(move |c| (r, c)));
        inner.filter(|(r, c)| top(*r, *c)).count() as f64 / ((rows - 2) * (cols - 2)) as f64 * 1e4
    }

    #[test]
    fn crowns_are_seen_and_are_wider_where_the_canopy_is_tall() {
        let tops = |height_m: f32| {
            let even = CoarseCanopy { heights_m: vec![height_m; 3600], ..coarse(60, 60) };
            tops_per_ha(&detailed(&even, &ground([60.0; 2], 120, 120, 1.0), 5))
        };
        // measured in British Columbia at cells of 1 m: 431 where the canopy is even and above 20 m
        let (low, tall) = (tops(6.0), tops(24.0));
        assert!((300.0..520.0).contains(&tall) && (300.0..900.0).contains(&low), "{low}, {tall}");
        assert!(low > 1.3 * tall, "{low}, {tall}");
    }

    #[test]
    fn nothing_stands_far_from_coarse_canopy_and_masked_cells_are_bare() {
        let mut heights_m = vec![0.3; 3600];
        for block in [30 * 60 + 25, 30 * 60 + 26, 31 * 60 + 25] {
            heights_m[block] = 22.0;
        }
        let coarse = CoarseCanopy { heights_m, ..coarse(60, 60) };
        let open = ground([56.0; 2], 128, 128, 1.0);
        let valid = (0..128 * 128).map(|i| i % 128 != 47).collect();
        let masked =
            Grid::new(Arc::clone(open.frame()), Arc::new(Mask::new(valid)), open.values().to_vec());
        let fine = detailed(&coarse, &masked, 5);
        assert_eq!(fine.mask().valid_count(), 128 * 127);
        let mut canopy = 0;
        for (index, height_m) in fine.values().iter().enumerate() {
            let Cell { row, col } = fine.frame().cell(index);
            assert!(col != 47 || *height_m == 0.0);
            if *height_m > CANOPY_M {
                canopy += 1;
                // blocks' cells, and one block around them
                assert!((60..76).contains(&row) && (40..56).contains(&col), "{row} {col}");
            }
        }
        assert!((12..60).contains(&canopy), "{canopy} cells");
    }
}
