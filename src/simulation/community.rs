//! Community: the plants of a plot, and what a year does to them.
//!
//! # Reference
//! Kapp et al. 2020, Algorithm 2, doi:10.1145/3414685.3417848.
//! # Departures
//! Crowns enter the competition grid at the turn of the year, not after each month's growth: within a year shares change
//! with the months' light and water alone. One full growing season counts as a year of idealized age, else plants of short
//! seasons would never come near the height that their age allows.

use rayon::prelude::*;

use super::competition::{Competitor, Shares, TILE_CELLS, Tile};
use super::germination::{self, Seedling};
use super::plot::{Disk, Plot};
use super::traits::Traits;
use super::{Parameters, carbon_pool, mortality, vigor};
use crate::rng::{self, Key, Process};
use crate::species::Biome;

/// Live plants of a plot under a canopy that does not change: one array a measure, places in metres from the plot's
/// north-west corner.
#[derive(Clone)]
pub struct Community {
    plot: Plot,
    parameters: Parameters,
    traits: Vec<Traits>,
    seed: u64,
    year: u16,
    /// Unique, never given again.
    pub id: Vec<u64>,
    /// Index into the biome's species.
    pub species: Vec<u16>,
    /// Metres east.
    pub east_m: Vec<f32>,
    /// Metres south.
    pub south_m: Vec<f32>,
    /// Years of unhindered growth to its height.
    pub idealized_age_years: Vec<f32>,
    /// Reserves, in months of the best vigor; below 0 overdrawn.
    pub carbon_pool: Vec<f32>,
    /// Height.
    pub height_m: Vec<f32>,
    /// Crown radius.
    pub crown_radius_m: Vec<f32>,
}

/// What a year did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct YearFigures {
    /// Plants that lived through it or died in it.
    pub plants: usize,
    /// Of them, those that died.
    pub deaths: usize,
    /// Seedlings that the next year begins with.
    pub sprouted: usize,
}

/// What a year left of a plant's growth.
#[derive(Clone, Copy, Debug)]
struct Grown {
    plant: u32,
    idealized_age_years: f32,
    carbon_pool: f32,
}

/// A tile's year.
struct TileYear {
    /// Plants whose crowns lie wholly in it.
    grown: Vec<Grown>,
    /// Shares here of plants that reach into other tiles.
    parts: Vec<(u32, Shares)>,
    seedlings: Vec<Seedling>,
}

impl Community {
    /// Bare ground under a plot's canopy, in year 0.
    pub fn new(plot: Plot, biome: &Biome, parameters: Parameters, seed: u64) -> Self {
        Self {
            traits: Traits::of(biome, &parameters),
            plot,
            parameters,
            seed,
            year: 0,
            id: Vec::new(),
            species: Vec::new(),
            east_m: Vec::new(),
            south_m: Vec::new(),
            idealized_age_years: Vec::new(),
            carbon_pool: Vec::new(),
            height_m: Vec::new(),
            crown_radius_m: Vec::new(),
        }
    }

    /// Number of live plants.
    pub fn len(&self) -> usize {
        self.id.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.id.is_empty()
    }

    /// Years simulated.
    pub fn year(&self) -> u16 {
        self.year
    }

    /// The ground.
    pub fn plot(&self) -> &Plot {
        &self.plot
    }

    /// Adds a plant of an idealized age, its reserves full.
    pub fn plant(&mut self, id: u64, species: u16, [east_m, south_m]: [f32; 2], age_years: f32) {
        let [height_m, crown_radius_m] = self.traits[usize::from(species)].size_m(age_years);
        self.id.push(id);
        self.species.push(species);
        self.east_m.push(east_m);
        self.south_m.push(south_m);
        self.idealized_age_years.push(age_years);
        self.carbon_pool.push(self.parameters.pool_capacity);
        self.height_m.push(height_m);
        self.crown_radius_m.push(crown_radius_m);
    }

    /// Lives through a year: twelve months of growth, then deaths, then seedlings for the next.
    pub fn live_a_year(&mut self) -> YearFigures {
        self.year += 1;
        let plants = self.len();
        let seedlings = self.grow();
        let deaths = self.die();
        let sprouted = seedlings.len();
        for Seedling { id, species, east_m, south_m } in seedlings {
            self.plant(id, species, [east_m, south_m], 0.0);
        }
        YearFigures { plants, deaths, sprouted }
    }

    /// Twelve months of growth under competition; gives the year's seedlings.
    fn grow(&mut self) -> Vec<Seedling> {
        let tiles = Tile::all(&self.plot);
        let by_tile = self.by_tile(tiles.len());
        let years: Vec<TileYear> = tiles
            .par_iter()
            .zip(&by_tile)
            .map(|(tile, plants)| self.tile_year(*tile, plants))
            .collect();

        // crowns over several tiles: their shares are added up in the order of tiles
        let mut parts: Vec<(u32, Shares)> = Vec::new();
        for year in &years {
            parts.extend(&year.parts);
        }
        parts.sort_by_key(|(plant, _)| *plant);
        let together = parts.par_chunk_by(|a, b| a.0 == b.0).map(|parts| {
            let mut shares = parts[0].1;
            parts[1..].iter().for_each(|(_, part)| shares.add(part));
            self.grown(parts[0].0, &shares)
        });
        let together: Vec<Grown> = together.collect();

        let of_tiles = years.iter().flat_map(|year| &year.grown);
        for grown in of_tiles.chain(&together) {
            let plant = grown.plant as usize;
            self.carbon_pool[plant] = grown.carbon_pool;
            self.idealized_age_years[plant] = grown.idealized_age_years;
        }
        let sizes: Vec<[f32; 2]> = (self.species.par_iter().zip(&self.idealized_age_years))
            .map(|(species, age_years)| self.traits[usize::from(*species)].size_m(*age_years))
            .collect();
        for (plant, [height_m, crown_radius_m]) in sizes.into_iter().enumerate() {
            self.height_m[plant] = height_m;
            self.crown_radius_m[plant] = crown_radius_m;
        }
        years.into_iter().flat_map(|year| year.seedlings).collect()
    }

    /// Plants of each tile, the tallest first.
    fn by_tile(&self, tile_count: usize) -> Vec<Vec<u32>> {
        let tile_cols = self.plot.cols.div_ceil(TILE_CELLS);
        let mut tiles: Vec<Vec<u32>> = vec![Vec::new(); tile_count];
        for plant in 0..self.len() {
            let [rows, cols] = self.tiles_of(plant);
            for row in rows {
                for col in cols.clone() {
                    tiles[row * tile_cols + col].push(plant as u32); // far fewer than 2³²
                }
            }
        }
        tiles.par_iter_mut().for_each(|plants| {
            let height = |plant: &u32| self.height_m[*plant as usize];
            let id = |plant: &u32| self.id[*plant as usize];
            plants.sort_unstable_by(|a, b| height(b).total_cmp(&height(a)).then(id(a).cmp(&id(b))));
        });
        tiles
    }

    /// Rows and columns of tiles under a plant's crown.
    fn tiles_of(&self, plant: usize) -> [std::ops::Range<usize>; 2] {
        let disk = self.disk(plant);
        let cell_m = self.plot.cell_m;
        let tiles = |cells: std::ops::Range<usize>| {
            cells.start / TILE_CELLS..cells.end.div_ceil(TILE_CELLS)
        };
        [tiles(disk.rows(self.plot.rows, cell_m)), tiles(disk.all_cols(self.plot.cols, cell_m))]
    }

    fn disk(&self, plant: usize) -> Disk {
        Disk {
            east_m: self.east_m[plant],
            south_m: self.south_m[plant],
            radius_m: self.crown_radius_m[plant],
        }
    }

    fn tile_year(&self, tile: Tile, plants: &[u32]) -> TileYear {
        let competitors = plants.iter().map(|plant| Competitor {
            disk: self.disk(*plant as usize),
            species: self.species[*plant as usize],
        });
        let (shares, cells) = tile.compete(&self.plot, &self.traits, competitors);
        let (mut grown, mut parts) = (Vec::with_capacity(plants.len()), Vec::new());
        for (plant, shares) in plants.iter().zip(&shares) {
            let [rows, cols] = self.tiles_of(*plant as usize);
            if rows.len() == 1 && cols.len() == 1 {
                grown.push(self.grown(*plant, shares));
            } else {
                parts.push((*plant, *shares));
            }
        }
        let seedlings =
            germination::sprout(&cells, &self.plot, &self.traits, self.seed, self.year);
        TileYear { grown, parts, seedlings }
    }

    /// Twelve months of a plant on its shares.
    fn grown(&self, plant: u32, shares: &Shares) -> Grown {
        let index = plant as usize;
        let traits = &self.traits[usize::from(self.species[index])];
        let [row, col] = self.plot.cell_at(self.east_m[index], self.south_m[index]);
        let ground = &self.plot.ground[self.plot.ground_of(row, col)];
        let (light, per_cell) = (shares.light / shares.cells, 1.0 / shares.cells);
        let water_mm = shares.water_mm.map(|mm| mm * per_cell);
        let vigor = vigor::by_month(traits, ground, light, &water_mm);
        let (mut pool, mut age_years) = (self.carbon_pool[index], self.idealized_age_years[index]);
        for (vigor, years) in vigor.into_iter().zip(traits.years_a_month) {
            let overflow;
            (pool, overflow) = carbon_pool::after_month(pool, vigor, self.parameters.pool_capacity);
            age_years += overflow * years;
        }
        Grown { plant, idealized_age_years: age_years, carbon_pool: pool }
    }

    /// The yearly test of death, and the end of what has reached the canopy; gives the number of deaths.
    fn die(&mut self) -> usize {
        let lives: Vec<bool> = (0..self.len())
            .into_par_iter()
            .map(|plant| {
                let traits = &self.traits[usize::from(self.species[plant])];
                let background = traits.background_death_probability_per_year;
                let chance =
                    mortality::death_probability_per_year(background, self.carbon_pool[plant]);
                let (seed, entity) = (self.seed, self.id[plant]);
                let key =
                    Key { seed, process: Process::PlantDeath, year: self.year, month: 0, entity };
                let [row, col] = self.plot.cell_at(self.east_m[plant], self.south_m[plant]);
                let canopy_base_m = self.plot.canopy[row * self.plot.cols + col].base_m;
                rng::uniforms(key)[0] >= chance && self.height_m[plant] < canopy_base_m
            })
            .collect();
        let before = self.len();
        retain(&mut self.id, &lives);
        retain(&mut self.species, &lives);
        for measure in [
            &mut self.east_m,
            &mut self.south_m,
            &mut self.idealized_age_years,
            &mut self.carbon_pool,
            &mut self.height_m,
            &mut self.crown_radius_m,
        ] {
            retain(measure, &lives);
        }
        before - self.len()
    }
}

/// Keeps the values of those that live, in their order.
fn retain<T>(values: &mut Vec<T>, lives: &[bool]) {
    let mut lives = lives.iter();
    values.retain(|_| lives.next() == Some(&true));
}
