//! Competition: what each plant gets of the light and the water of the cells under its crown.
//!
//! Light falls from the tallest plant to the lowest, each taking its share. Water goes to roots in the same order, each its
//! least need, as far as it lasts; what is left over is shared by all plants of the cell and one share of seeds. Both need
//! only a running state of each cell, so one walk over a tile's plants, the tallest first, works out a year: no lists of
//! plants by cell are kept.
//!
//! # Reference
//! Kapp et al. 2020, section 6.1, doi:10.1145/3414685.3417848, after Gain et al. 2017, doi:10.1111/cgf.13106.
//! # Departures
//! There the canopy's trees drink first. Soil water, as our abiotic maps have it, is what transpiration has left, the canopy's
//! included: trees would drink twice, and nothing but the hardiest pine came up under the Pyrenees' oaks.

use super::plot::{Disk, Plot};
use super::traits::Traits;
use crate::raster::MONTHS;

/// Rows and columns of a tile in simulation cells. chosen: its state fits a core's second cache.
pub const TILE_CELLS: usize = 128;

/// A plant as competition sees it.
#[derive(Clone, Copy, Debug)]
pub struct Competitor {
    /// Its crown from above.
    pub disk: Disk,
    /// Index of its species.
    pub species: u16,
}

/// What a plant gets of its cells, summed over them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shares {
    /// Share of the light that reaches it.
    pub light: f32,
    /// Water by month, mm.
    pub water_mm: [f32; MONTHS],
    /// Number of cells.
    pub cells: f32,
    /// Share of the light that reaches the ground under it.
    pub light_left: f32,
}

impl Shares {
    /// Adds what it gets in other cells.
    pub fn add(&mut self, other: &Self) {
        self.light += other.light;
        self.water_mm.iter_mut().zip(other.water_mm).for_each(|(sum, mm)| *sum += mm);
        self.cells += other.cells;
        self.light_left += other.light_left;
    }
}

/// A rectangle of simulation cells.
#[derive(Clone, Copy, Debug)]
pub struct Tile {
    pub row: usize,
    pub col: usize,
    pub rows: usize,
    pub cols: usize,
}

/// Cells of a tile under each of its plants' crowns.
struct CrownCells {
    runs: Vec<Run>,
    /// End of each plant's runs.
    ends: Vec<u32>,
}

/// Neighbouring cells of a row, by the index of the first in the tile.
#[derive(Clone, Copy)]
struct Run {
    first: u16,
    count: u16,
}

// runs count a tile's cells
const _: () = assert!(TILE_CELLS * TILE_CELLS <= u16::MAX as usize);

/// State of a tile's cells while its plants are walked over, then what they leave to seeds.
#[derive(Debug)]
pub struct CellStates {
    tile: Tile,
    cells: Vec<CellState>,
}

#[derive(Clone, Copy, Debug)]
struct CellState {
    /// Share of the light that is left.
    light: f32,
    /// Water that was asked for, mm a month.
    taken_mm: f32,
    /// Number of plants, and one for seeds: those that share what is left of the water.
    sharers: f32,
    /// Index of the terrain cell.
    ground: u32,
}

impl Tile {
    /// The tiles of a plot, row by row.
    pub fn all(plot: &Plot) -> Vec<Self> {
        let starts = |cells: usize| (0..cells).step_by(TILE_CELLS);
        let tile = |row: usize, col: usize| Self {
            row,
            col,
            rows: TILE_CELLS.min(plot.rows - row),
            cols: TILE_CELLS.min(plot.cols - col),
        };
        starts(plot.rows).flat_map(|row| starts(plot.cols).map(move |col| tile(row, col))).collect()
    }

    /// Walks over the tile's plants, the tallest first. Gives what each gets here, in their order, and what is left.
    pub fn compete(
        self,
        plot: &Plot,
        traits: &[Traits],
        plants: &[Competitor],
    ) -> (Vec<Shares>, CellStates) {
        let mut cells = CellStates::under_canopy(self, plot);
        let crowns = CrownCells::of(self, plot, plants);
        let take = |(plant, runs): (&Competitor, _)| {
            cells.take(plot, &traits[usize::from(plant.species)], runs)
        };
        let mut shares: Vec<Shares> = plants.iter().zip(crowns.of_plants()).map(take).collect();
        for (got, runs) in shares.iter_mut().zip(crowns.of_plants()) {
            cells.share_the_rest(plot, runs, got);
        }
        (shares, cells)
    }
}

impl CrownCells {
    fn of(tile: Tile, plot: &Plot, plants: &[Competitor]) -> Self {
        let mut crowns = Self {
            runs: Vec::with_capacity(2 * plants.len()),
            ends: Vec::with_capacity(plants.len()),
        };
        for plant in plants {
            crowns.add(tile, plot, plant.disk);
            crowns.ends.push(crowns.runs.len() as u32); // far fewer than 2³²
        }
        crowns
    }

    #[inline]
    fn add(&mut self, tile: Tile, plot: &Plot, disk: Disk) {
        let Tile { row: top, col: left, rows, cols } = tile;
        if disk.is_of_one_cell(plot.cell_m) {
            let [row, col] = plot.cell_at(disk.east_m, disk.south_m);
            self.runs.push(Run { first: ((row - top) * cols + col - left) as u16, count: 1 });
            return;
        }
        let crown_rows = disk.rows(plot.rows, plot.cell_m);
        for row in crown_rows.start.max(top)..crown_rows.end.min(top + rows) {
            let crown_cols = disk.cols(row, plot.cols, plot.cell_m);
            let (first, end) = (crown_cols.start.max(left), crown_cols.end.min(left + cols));
            if first < end {
                let index = (row - top) * cols + first - left;
                self.runs.push(Run { first: index as u16, count: (end - first) as u16 });
            }
        }
    }

    fn of_plants(&self) -> impl Iterator<Item = &[Run]> {
        let mut start = 0;
        self.ends.iter().map(move |end| {
            let runs = &self.runs[start..*end as usize];
            start = *end as usize;
            runs
        })
    }
}

impl CellStates {
    fn under_canopy(tile: Tile, plot: &Plot) -> Self {
        let mut cells = Vec::with_capacity(tile.rows * tile.cols);
        for row in tile.row..tile.row + tile.rows {
            cells.extend((tile.col..tile.col + tile.cols).map(|col| CellState {
                light: plot.canopy_at(row * plot.cols + col).light_fraction,
                taken_mm: 0.0,
                sharers: 1.0,
                ground: plot.ground_of(row, col) as u32, // plots have fewer cells
            }));
        }
        Self { tile, cells }
    }

    /// What a plant gets before all that are lower.
    #[inline]
    fn take(&mut self, plot: &Plot, traits: &Traits, runs: &[Run]) -> Shares {
        let (keep, need_mm) = (traits.passed_light_fraction, traits.need_mm);
        let (mut light, mut water_mm, mut cells) = (0.0, [0.0; MONTHS], 0.0);
        for run in runs {
            let first = usize::from(run.first);
            for cell in &mut self.cells[first..first + usize::from(run.count)] {
                let moisture_mm = &plot.ground[cell.ground as usize].moisture_mm;
                light += cell.light;
                for (sum, there_mm) in water_mm.iter_mut().zip(moisture_mm) {
                    let left_mm = (there_mm - cell.taken_mm).max(0.0);
                    *sum += if left_mm < need_mm { left_mm } else { need_mm };
                }
                cells += 1.0;
                cell.light *= keep;
                cell.taken_mm += need_mm;
                cell.sharers += 1.0;
            }
        }
        Shares { light, water_mm, cells, light_left: 0.0 }
    }

    /// Adds a plant's share of the water that is left when all have taken theirs.
    #[inline]
    fn share_the_rest(&self, plot: &Plot, runs: &[Run], got: &mut Shares) {
        let (mut sums, mut light_left) = (got.water_mm, 0.0);
        for run in runs {
            let first = usize::from(run.first);
            for cell in &self.cells[first..first + usize::from(run.count)] {
                let moisture_mm = &plot.ground[cell.ground as usize].moisture_mm;
                let share = 1.0 / cell.sharers;
                light_left += cell.light;
                for (sum, there_mm) in sums.iter_mut().zip(moisture_mm) {
                    *sum += (there_mm - cell.taken_mm).max(0.0) * share;
                }
            }
        }
        (got.water_mm, got.light_left) = (sums, light_left);
    }

    /// Light that reaches the ground of a cell, as a share.
    #[inline]
    pub fn light_at(&self, cell: usize) -> f32 {
        self.cells[cell].light
    }

    /// Water that is kept for seeds in a cell, mm by month.
    #[inline]
    pub fn seed_water_mm(&self, cell: usize, plot: &Plot) -> [f32; MONTHS] {
        let CellState { taken_mm, sharers, ground, .. } = self.cells[cell];
        let mut left_mm = plot.ground[ground as usize].moisture_mm;
        let share = 1.0 / sharers;
        left_mm.iter_mut().for_each(|mm| *mm = (*mm - taken_mm).max(0.0) * share);
        left_mm
    }

    /// Index of the terrain cell of a cell.
    #[inline]
    pub fn ground_at(&self, cell: usize) -> usize {
        self.cells[cell].ground as usize
    }

    /// The rectangle.
    pub fn tile(&self) -> Tile {
        self.tile
    }
}
