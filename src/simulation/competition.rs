//! Competition: what each plant gets of the light and the water of the cells under its crown.
//!
//! Light falls from the tallest plant to the lowest, each taking its share. Water goes to roots in the same order, each its
//! least need, as far as it lasts; what is left over is shared by all plants of the cell and one share of seeds. Both need
//! only a running state of each cell, so one walk over a tile's plants, the tallest first, works out a year: no lists of
//! plants by cell are kept.
//!
//! # Reference
//! Kapp et al. 2020, section 6.1, doi:10.1145/3414685.3417848, after Gain et al. 2017, doi:10.1111/cgf.13106.

use super::plot::{Disk, Plot};
use super::traits::Traits;
use crate::raster::MONTHS;

/// Rows and columns of a tile in simulation cells. Chosen: its state fits a core's second cache.
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
}

impl Shares {
    /// Adds what it gets in other cells.
    pub fn add(&mut self, other: &Self) {
        self.light += other.light;
        self.water_mm.iter_mut().zip(other.water_mm).for_each(|(sum, mm)| *sum += mm);
        self.cells += other.cells;
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

/// State of a tile's cells while its plants are walked over, then what they leave to seeds.
#[derive(Debug)]
pub struct CellStates {
    tile: Tile,
    /// Share of the light that is left.
    light: Vec<f32>,
    /// Water that was asked for, mm a month.
    taken_mm: Vec<f32>,
    /// One over the number of plants and the share of seeds.
    share: Vec<f32>,
    plants: Vec<u16>,
    ground: Vec<u32>,
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
        plants: impl Iterator<Item = Competitor> + Clone,
    ) -> (Vec<Shares>, CellStates) {
        let mut cells = CellStates::under_canopy(self, plot);
        let mut shares: Vec<Shares> = plants
            .clone()
            .map(|plant| {
                let traits = &traits[usize::from(plant.species)];
                let (keep, need_mm) = (traits.passed_light_fraction, traits.need_mm);
                let mut got = Shares::default();
                cells.walk(plot, plant.disk, |cells, cell| {
                    let moisture_mm = &plot.ground[cells.ground[cell] as usize].moisture_mm;
                    let (light, taken_mm) = (cells.light[cell], cells.taken_mm[cell]);
                    got.light += light;
                    for (sum, there_mm) in got.water_mm.iter_mut().zip(moisture_mm) {
                        *sum += (there_mm - taken_mm).max(0.0).min(need_mm);
                    }
                    got.cells += 1.0;
                    cells.light[cell] = light * keep;
                    cells.taken_mm[cell] = taken_mm + need_mm;
                    cells.plants[cell] = cells.plants[cell].saturating_add(1);
                });
                got
            })
            .collect();
        cells.count_shares();
        for (plant, got) in plants.zip(&mut shares) {
            cells.walk(plot, plant.disk, |cells, cell| {
                let moisture_mm = &plot.ground[cells.ground[cell] as usize].moisture_mm;
                let (taken_mm, share) = (cells.taken_mm[cell], cells.share[cell]);
                for (sum, there_mm) in got.water_mm.iter_mut().zip(moisture_mm) {
                    *sum += (there_mm - taken_mm).max(0.0) * share;
                }
            });
        }
        (shares, cells)
    }
}

impl CellStates {
    fn under_canopy(tile: Tile, plot: &Plot) -> Self {
        let count = tile.rows * tile.cols;
        let mut cells = Self {
            tile,
            light: Vec::with_capacity(count),
            taken_mm: Vec::with_capacity(count),
            share: Vec::new(),
            plants: Vec::with_capacity(count),
            ground: Vec::with_capacity(count),
        };
        for row in tile.row..tile.row + tile.rows {
            for col in tile.col..tile.col + tile.cols {
                let canopy = &plot.canopy[row * plot.cols + col];
                cells.light.push(canopy.light_fraction);
                cells.taken_mm.push(canopy.taken_mm);
                cells.plants.push(canopy.trees);
                cells.ground.push(plot.ground_of(row, col) as u32); // plots have fewer cells
            }
        }
        cells
    }

    /// Visits the tile's cells under a crown by their index here.
    #[inline]
    fn walk(&mut self, plot: &Plot, disk: Disk, mut visit: impl FnMut(&mut Self, usize)) {
        let Tile { row: top, col: left, rows, cols } = self.tile;
        let crown_rows = disk.rows(plot.rows, plot.cell_m);
        for row in crown_rows.start.max(top)..crown_rows.end.min(top + rows) {
            let crown_cols = disk.cols(row, plot.cols, plot.cell_m);
            let line = (row - top) * cols;
            for col in crown_cols.start.max(left)..crown_cols.end.min(left + cols) {
                visit(self, line + col - left);
            }
        }
    }

    fn count_shares(&mut self) {
        self.share = self.plants.iter().map(|plants| 1.0 / (f32::from(*plants) + 1.0)).collect();
    }

    /// Light that reaches the ground of a cell, as a share.
    #[inline]
    pub fn light_at(&self, cell: usize) -> f32 {
        self.light[cell]
    }

    /// Water that is kept for seeds in a cell, mm by month.
    #[inline]
    pub fn seed_water_mm(&self, cell: usize, plot: &Plot) -> [f32; MONTHS] {
        let moisture_mm = &plot.ground[self.ground[cell] as usize].moisture_mm;
        moisture_mm.map(|there_mm| (there_mm - self.taken_mm[cell]).max(0.0) * self.share[cell])
    }

    /// Index of the terrain cell of a cell.
    #[inline]
    pub fn ground_at(&self, cell: usize) -> usize {
        self.ground[cell] as usize
    }

    /// The rectangle.
    pub fn tile(&self) -> Tile {
        self.tile
    }
}
