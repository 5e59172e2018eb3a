//! Water from cell to cell: every cell's year after those of all cells above it.
//!
//! The map is cut into square tiles. A round lets each tile run every cell whose upslope cells are done;
//! flows that cross a tile's edge are posted and delivered between rounds, in a fixed order. Tiles are
//! worked in parallel, and what a tile does in a round depends on its mail alone, so results have the
//! same bits for any number of threads.
//!
//! On hillslopes water fans out over all lower neighbours; in channels it follows the steepest way.
//!
//! # Reference
//! Channels begin where enough land drains to one place: Montgomery & Dietrich 1988, "Where do channels
//! begin?", Nature 336, doi:10.1038/336232a0. Multiple flow above channel heads, single flow below:
//! Quinn, Beven & Lamb 1995, "The ln(a/tanβ) index", Hydrological Processes 9(2), doi:10.1002/hyp.3360090204.

use rayon::prelude::*;

use crate::progress::{Cancelled, Reporter, Stage};
use crate::raster::{Cell, MONTHS};

use super::drainage::{self, DrainageSurface, NEIGHBOURS};
use super::water_balance::CellYear;

/// Tile width in cells. chosen: what is in flight over 64² cells stays in a core's own cache.
const TILE: usize = 64;

/// `ChannelCell::receiver` where the channel leaves the map.
pub(super) const LEAVES_MAP: u32 = u32::MAX;

/// Twelve months of water on its way into a cell, mm, and the number of cells it has drained.
/// In double precision: a trickle must not drown in a river.
type RunOn = [f64; MONTHS + 1];

/// Bands of the result: moisture of twelve months, then the year's outflow.
const BANDS: usize = MONTHS + 1;
const OUTFLOW: usize = MONTHS;

/// A cell of a channel, with what leaves it.
pub(super) struct ChannelCell {
    /// Index of the cell.
    pub cell: u32,
    /// Index of the cell it flows to, or [`LEAVES_MAP`].
    pub receiver: u32,
    /// Runoff and drainage, mm over the cell.
    pub outflow_mm: [f64; MONTHS],
}

/// Sums over all cells, mm.
#[derive(Clone, Default)]
pub(super) struct WaterSums {
    pub transpiration_mm: [f64; MONTHS],
    pub storage_change_mm: [f64; MONTHS],
    /// Water that left the map.
    pub outflow_mm: [f64; MONTHS],
}

/// What routing gives.
pub(super) struct Routed {
    /// Mean water in the soil each month, mm; 0 where masked.
    pub moisture_mm: [Vec<f32>; MONTHS],
    /// Water that left each cell in the year, mm; 0 where masked.
    pub yearly_outflow_mm: Vec<f32>,
    /// Channels, every cell after those upstream of it.
    pub channels: Vec<ChannelCell>,
    pub sums: WaterSums,
}

/// Runs every valid cell's year with `run_cell(index, run-on of each month in mm)` and passes its outflow on.
/// Cells that drain at least `channel_area_cells` cells are channels.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
pub(super) fn route(
    surface: &DrainageSurface,
    channel_area_cells: f32,
    reporter: &Reporter,
    stage: &Stage<'_>,
    run_cell: impl Fn(usize, &[f64; MONTHS]) -> CellYear + Sync,
) -> Result<Routed, Cancelled> {
    let (rows, cols) = (surface.rows(), surface.cols());
    let (tile_rows, tile_cols) = (rows.div_ceil(TILE), cols.div_ceil(TILE));

    // Every tile writes its own piece of each band
    let mut bands: [Vec<f32>; BANDS] = std::array::from_fn(|_| vec![0.0; rows * cols]);
    let mut pieces: Vec<Vec<&mut [f32]>> =
        (0..tile_rows * tile_cols).map(|_| Vec::with_capacity(BANDS * TILE)).collect();
    for band in &mut bands {
        for (row, line) in band.chunks_mut(cols.max(1)).enumerate() {
            for (tile_col, piece) in line.chunks_mut(TILE).enumerate() {
                pieces[(row / TILE) * tile_cols + tile_col].push(piece);
            }
        }
    }
    let mut tiles: Vec<Tile<'_>> = pieces
        .into_par_iter()
        .enumerate()
        .map(|(t, pieces)| {
            Tile::new(surface, (t / tile_cols) * TILE, (t % tile_cols) * TILE, pieces)
        })
        .collect();

    let mut channels = Vec::new();
    let task = Task { surface, channel_area_cells, run_cell };
    while tiles.iter().any(Tile::has_work) {
        reporter.check_cancelled()?;
        let done: usize = tiles.par_iter_mut().map(|tile| tile.work(&task)).sum();
        stage.advance(done as u64);
        for t in 0..tiles.len() {
            channels.append(&mut tiles[t].channels);
            for (direction, (d_row, d_col)) in NEIGHBOURS.into_iter().enumerate() {
                if tiles[t].outboxes[direction].is_empty() {
                    continue;
                }
                let mut mail = std::mem::take(&mut tiles[t].outboxes[direction]);
                let target = t.wrapping_add_signed(d_row * tile_cols as isize + d_col);
                tiles[target].inbox.append(&mut mail);
                tiles[t].outboxes[direction] = mail; // keep the allocation
            }
        }
    }

    let mut sums = WaterSums::default();
    for tile in &tiles {
        assert!(tile.waiting.iter().all(|&w| w == DONE), "a cell waits for water that never comes");
        for m in 0..MONTHS {
            sums.transpiration_mm[m] += tile.sums.transpiration_mm[m];
            sums.storage_change_mm[m] += tile.sums.storage_change_mm[m];
            sums.outflow_mm[m] += tile.sums.outflow_mm[m];
        }
    }
    drop(tiles);
    let [moisture_mm @ .., yearly_outflow_mm] = bands;
    Ok(Routed { moisture_mm, yearly_outflow_mm, channels, sums })
}

struct Task<'a, F> {
    surface: &'a DrainageSurface,
    channel_area_cells: f32,
    run_cell: F,
}

/// Word to a cell that one of its upslope cells is done, with the water that comes from there.
struct Mail {
    /// The cell's place in its tile.
    local: u16,
    /// `None` from a channel that flows elsewhere.
    water: Option<RunOn>,
}

/// `Tile::waiting` of cells that have run, are masked, or lie outside.
const DONE: u8 = u8::MAX;

/// `Tile::slot` of cells that nothing has run on to yet.
const EMPTY: u16 = u16::MAX;

/// A square of cells; local index = row · [`TILE`] + column.
struct Tile<'a> {
    top: usize,
    left: usize,
    rows: usize,
    cols: usize,
    /// Rows of the result, band by band.
    pieces: Vec<&'a mut [f32]>,
    /// Run-on of the cells that wait for more of it, and which of these entries are free.
    run_on: Vec<RunOn>,
    free: Vec<u16>,
    /// Each cell's entry of `run_on`, or [`EMPTY`].
    slot: Vec<u16>,
    /// Upslope cells that have not run yet.
    waiting: Vec<u8>,
    ready: Vec<u16>,
    inbox: Vec<Mail>,
    /// One per tile around, in the order of [`NEIGHBOURS`].
    outboxes: [Vec<Mail>; 8],
    channels: Vec<ChannelCell>,
    sums: WaterSums,
}

impl<'a> Tile<'a> {
    fn new(surface: &DrainageSurface, top: usize, left: usize, pieces: Vec<&'a mut [f32]>) -> Self {
        let (rows, cols) = ((surface.rows() - top).min(TILE), (surface.cols() - left).min(TILE));
        let mut tile = Self {
            top,
            left,
            rows,
            cols,
            pieces,
            run_on: Vec::new(),
            free: Vec::new(),
            slot: vec![EMPTY; rows * TILE],
            waiting: vec![DONE; rows * TILE],
            ready: Vec::new(),
            inbox: Vec::new(),
            outboxes: Default::default(),
            channels: Vec::new(),
            sums: WaterSums::default(),
        };
        for row in 0..rows {
            for col in 0..cols {
                let cell = Cell { row: top + row, col: left + col };
                if surface.height_m(cell) == f32::INFINITY {
                    continue;
                }
                let local = row * TILE + col;
                tile.waiting[local] = surface.upslope_count(cell);
                if tile.waiting[local] == 0 {
                    tile.ready.push(local as u16); // a tile has 4096 cells
                }
            }
        }
        tile
    }

    fn has_work(&self) -> bool {
        !self.ready.is_empty() || !self.inbox.is_empty()
    }

    /// Takes in the mail, runs all cells that can run; returns their number.
    fn work<F: Fn(usize, &[f64; MONTHS]) -> CellYear>(&mut self, task: &Task<'_, F>) -> usize {
        let mut inbox = std::mem::take(&mut self.inbox);
        for mail in inbox.drain(..) {
            self.receive(mail);
        }
        self.inbox = inbox; // keep the allocation
        let mut done = 0;
        while let Some(local) = self.ready.pop() {
            self.run(local, task);
            done += 1;
        }
        done
    }

    fn receive(&mut self, mail: Mail) {
        if let Some(water) = mail.water {
            for (have, more) in self.run_on_of(mail.local).iter_mut().zip(water) {
                *have += more;
            }
        }
        let waiting = &mut self.waiting[mail.local as usize];
        *waiting -= 1;
        if *waiting == 0 {
            self.ready.push(mail.local);
        }
    }

    /// The run-on of a cell so far.
    fn run_on_of(&mut self, local: u16) -> &mut RunOn {
        let slot = &mut self.slot[local as usize];
        if *slot == EMPTY {
            *slot = self.free.pop().unwrap_or_else(|| {
                self.run_on.push([0.0; MONTHS + 1]);
                (self.run_on.len() - 1) as u16 // a tile has 4096 cells
            });
        }
        &mut self.run_on[*slot as usize]
    }

    /// Takes the run-on of a cell out and frees its entry.
    fn take_run_on(&mut self, local: u16) -> RunOn {
        let slot = std::mem::replace(&mut self.slot[local as usize], EMPTY);
        if slot == EMPTY {
            return [0.0; MONTHS + 1];
        }
        self.free.push(slot);
        std::mem::replace(&mut self.run_on[slot as usize], [0.0; MONTHS + 1])
    }

    fn run<F: Fn(usize, &[f64; MONTHS]) -> CellYear>(&mut self, local: u16, task: &Task<'_, F>) {
        let (row, col) = (local as usize / TILE, local as usize % TILE);
        let cell = Cell { row: self.top + row, col: self.left + col };
        let index = cell.row * task.surface.cols() + cell.col;
        self.waiting[local as usize] = DONE;

        // The cell's year
        let [run_on_mm @ .., area_cells] = self.take_run_on(local);
        let area_cells = area_cells + 1.0;
        let year = (task.run_cell)(index, &run_on_mm);
        for m in 0..MONTHS {
            self.pieces[m * self.rows + row][col] = year.moisture_mm[m];
            self.sums.transpiration_mm[m] += year.transpiration_mm[m];
            self.sums.storage_change_mm[m] += year.storage_change_mm[m];
        }
        self.pieces[OUTFLOW * self.rows + row][col] = year.outflow_mm.iter().sum::<f64>() as f32;

        // Its water on the way down
        let descent = task.surface.descent(cell);
        let ways = (0..8).filter(|&d| descent.falls[d] > 0.0);
        if area_cells >= f64::from(task.channel_area_cells) {
            let down = descent.steepest_inward();
            let receiver = down.map(|d| drainage::neighbour(cell, d));
            self.channels.push(ChannelCell {
                cell: index as u32, // cells are limited to 400 million
                receiver: receiver
                    .map_or(LEAVES_MAP, |to| (to.row * task.surface.cols() + to.col) as u32),
                outflow_mm: year.outflow_mm,
            });
            for d in ways.filter(|&d| !descent.outward[d]) {
                let water = (Some(d) == down).then(|| scaled(&year.outflow_mm, area_cells, 1.0));
                self.send(row, col, d, water);
            }
            if down.is_none() {
                self.leave_map(&year.outflow_mm, 1.0);
            }
        } else if descent.is_sink() {
            self.leave_map(&year.outflow_mm, 1.0);
        } else {
            let shares = descent.shares();
            for d in ways {
                let share = shares[d];
                if descent.outward[d] {
                    self.leave_map(&year.outflow_mm, share);
                } else {
                    let water = scaled(&year.outflow_mm, area_cells, share);
                    self.send(row, col, d, Some(water));
                }
            }
        }
    }

    fn leave_map(&mut self, water_mm: &[f64; MONTHS], share: f64) {
        for (sum, water) in self.sums.outflow_mm.iter_mut().zip(water_mm) {
            *sum += water * share;
        }
    }

    /// Hands water to the neighbour of a local cell, in this tile or the next.
    #[inline]
    fn send(&mut self, row: usize, col: usize, direction: usize, water: Option<RunOn>) {
        let (d_row, d_col) = NEIGHBOURS[direction];
        let (row, col) = (row as isize + d_row, col as isize + d_col);
        let inside = |at: isize, size: usize| at >= 0 && (at as usize) < size;
        let wrapped = |at: isize| at.rem_euclid(TILE as isize) as usize;
        let mail = Mail { local: (wrapped(row) * TILE + wrapped(col)) as u16, water };
        if inside(row, self.rows) && inside(col, self.cols) {
            self.receive(mail);
        } else {
            let side = |at: isize| at.div_euclid(TILE as isize);
            let step = (side(row), side(col));
            let outbox = NEIGHBOURS.iter().position(|&n| n == step);
            assert!(outbox.is_some(), "water flows off the grid");
            self.outboxes[outbox.unwrap_or(0)].push(mail);
        }
    }
}

/// A share of a cell's outflow, with the same share of the land it drains.
#[inline]
fn scaled(outflow_mm: &[f64; MONTHS], area_cells: f64, share: f64) -> RunOn {
    let mut water = [area_cells * share; MONTHS + 1];
    for (part, whole) in water.iter_mut().zip(outflow_mm) {
        *part = whole * share;
    }
    water
}
