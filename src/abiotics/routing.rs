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

use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::progress::{Cancelled, Reporter, Stage};
use crate::raster::{Cell, MONTHS};

use super::drainage::{self, DrainageSurface, NEIGHBOURS, flow_shares, steepest};
use super::water_balance::CellYear;

/// Tile width in cells. chosen: 64² cells of 52 B stay in a core's own cache.
const TILE: usize = 64;

/// `ChannelCell::receiver` where the channel leaves the map.
pub(super) const LEAVES_MAP: u32 = u32::MAX;

/// Twelve months of water over a cell, mm, and the number of cells it has drained, its own included.
/// Once the cell has run: its moisture, and its yearly outflow, mm.
type Slot = [f32; MONTHS + 1];
const LAST: usize = MONTHS;

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
    let (tile_rows, tile_cols) = (surface.rows().div_ceil(TILE), surface.cols().div_ceil(TILE));
    let mut tiles: Vec<Tile> = (0..tile_rows * tile_cols)
        .into_par_iter()
        .map(|t| Tile::new(surface, (t / tile_cols) * TILE, (t % tile_cols) * TILE))
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
    let mut bands = unfold(tiles, surface);
    let yearly_outflow_mm = bands.pop().unwrap_or_default();
    let mut bands = bands.into_iter();
    let moisture_mm = std::array::from_fn(|_| bands.next().unwrap_or_default());
    Ok(Routed { moisture_mm, yearly_outflow_mm, channels, sums })
}

/// Slots of tiles laid out as whole-map bands; each row of tiles is freed once copied.
fn unfold(tiles: Vec<Tile>, surface: &DrainageSurface) -> Vec<Vec<f32>> {
    let (rows, cols) = (surface.rows(), surface.cols());
    let mut bands: Vec<Vec<f32>> = (0..=LAST).map(|_| vec![0.0; rows * cols]).collect();
    let mut tiles = tiles.into_iter();
    for top in (0..rows).step_by(TILE) {
        let strip: Vec<Tile> = tiles.by_ref().take(cols.div_ceil(TILE)).collect();
        let bottom = (top + TILE).min(rows);
        bands.par_iter_mut().enumerate().for_each(|(band, values)| {
            for row in top..bottom {
                let line = &mut values[row * cols..][..cols];
                for (tile, piece) in strip.iter().zip(line.chunks_mut(TILE)) {
                    let slots = &tile.slots[(row - top) * TILE..];
                    for (value, slot) in piece.iter_mut().zip(slots) {
                        *value = slot[band];
                    }
                }
            }
        });
    }
    bands
}

struct Task<'a, F> {
    surface: &'a DrainageSurface,
    channel_area_cells: f32,
    run_cell: F,
}

/// Water on its way to a cell of another tile.
enum Parcel {
    /// None: only word that an upslope cell is done.
    Nothing,
    Hillslope(Slot),
    Channel {
        water_mm: Box<[f64; MONTHS]>,
        area_cells: f32,
    },
}

struct Mail {
    /// The cell's place in the receiving tile.
    local: u16,
    parcel: Parcel,
}

/// `Tile::waiting` of cells that have run, are masked, or lie outside.
const DONE: u8 = u8::MAX;

/// A square of cells; local index = row · [`TILE`] + column.
struct Tile {
    top: usize,
    left: usize,
    rows: usize,
    cols: usize,
    slots: Vec<Slot>,
    /// Channel water received, kept apart in full precision: a trickle must not drown in a river.
    channel_inflow_mm: BTreeMap<u16, [f64; MONTHS]>,
    /// Upslope cells that have not run yet.
    waiting: Vec<u8>,
    ready: Vec<u16>,
    inbox: Vec<Mail>,
    /// One per tile around, in the order of [`NEIGHBOURS`].
    outboxes: [Vec<Mail>; 8],
    channels: Vec<ChannelCell>,
    sums: WaterSums,
}

impl Tile {
    fn new(surface: &DrainageSurface, top: usize, left: usize) -> Self {
        let (rows, cols) = ((surface.rows() - top).min(TILE), (surface.cols() - left).min(TILE));
        let mut tile = Self {
            top,
            left,
            rows,
            cols,
            slots: vec![[0.0; MONTHS + 1]; rows * TILE],
            channel_inflow_mm: BTreeMap::new(),
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
        let slot = &mut self.slots[mail.local as usize];
        match mail.parcel {
            Parcel::Nothing => {}
            Parcel::Hillslope(water) => {
                for (have, more) in slot.iter_mut().zip(water) {
                    *have += more;
                }
            }
            Parcel::Channel { water_mm, area_cells } => {
                slot[LAST] += area_cells;
                let inflow = self.channel_inflow_mm.entry(mail.local).or_default();
                for (have, more) in inflow.iter_mut().zip(*water_mm) {
                    *have += more;
                }
            }
        }
        let waiting = &mut self.waiting[mail.local as usize];
        *waiting -= 1;
        if *waiting == 0 {
            self.ready.push(mail.local);
        }
    }

    fn run<F: Fn(usize, &[f64; MONTHS]) -> CellYear>(&mut self, local: u16, task: &Task<'_, F>) {
        let (row, col) = (local as usize / TILE, local as usize % TILE);
        let cell = Cell { row: self.top + row, col: self.left + col };
        let index = cell.row * task.surface.cols() + cell.col;
        self.waiting[local as usize] = DONE;

        // The cell's year
        let slot = &mut self.slots[local as usize];
        let area_cells = slot[LAST] + 1.0;
        let channel_inflow = self.channel_inflow_mm.remove(&local);
        let mut run_on_mm = channel_inflow.unwrap_or_default();
        for (total, hillslope) in run_on_mm.iter_mut().zip(&slot[..MONTHS]) {
            *total += f64::from(*hillslope);
        }
        let year = (task.run_cell)(index, &run_on_mm);
        slot[..MONTHS].copy_from_slice(&year.moisture_mm);
        slot[LAST] = year.outflow_mm.iter().sum::<f64>() as f32;
        for m in 0..MONTHS {
            self.sums.transpiration_mm[m] += year.transpiration_mm[m];
            self.sums.storage_change_mm[m] += year.storage_change_mm[m];
        }

        // Its water on the way down
        let falls = task.surface.falls(cell);
        let down = steepest(&falls);
        if down.is_none() {
            for m in 0..MONTHS {
                self.sums.outflow_mm[m] += year.outflow_mm[m];
            }
        }
        if area_cells >= task.channel_area_cells {
            let receiver = down.map(|d| drainage::neighbour(cell, d));
            self.channels.push(ChannelCell {
                cell: index as u32, // cells are limited to 400 million
                receiver: receiver
                    .map_or(LEAVES_MAP, |to| (to.row * task.surface.cols() + to.col) as u32),
                outflow_mm: year.outflow_mm,
            });
            for d in (0..8).filter(|&d| falls[d] > 0.0) {
                let parcel = if Some(d) == down {
                    Parcel::Channel { water_mm: Box::new(year.outflow_mm), area_cells }
                } else {
                    Parcel::Nothing
                };
                self.send(row, col, d, parcel);
            }
        } else {
            let outflow = year.outflow_mm.map(|v| v as f32);
            let shares = flow_shares(&falls);
            for d in (0..8).filter(|&d| falls[d] > 0.0) {
                let mut water = [area_cells * shares[d]; MONTHS + 1];
                for (part, whole) in water.iter_mut().zip(outflow) {
                    *part = whole * shares[d];
                }
                self.send(row, col, d, Parcel::Hillslope(water));
            }
        }
    }

    /// Hands a parcel to the neighbour of a local cell, in this tile or the next.
    #[inline]
    fn send(&mut self, row: usize, col: usize, direction: usize, parcel: Parcel) {
        let (d_row, d_col) = NEIGHBOURS[direction];
        let (row, col) = (row as isize + d_row, col as isize + d_col);
        let inside = |at: isize, size: usize| at >= 0 && (at as usize) < size;
        let wrapped = |at: isize| at.rem_euclid(TILE as isize) as usize;
        let mail = Mail { local: (wrapped(row) * TILE + wrapped(col)) as u16, parcel };
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
