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
use super::vigor::Offer;
use super::{Competition, Parameters, carbon_pool, intersection, mortality};
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
    /// Least height at which the canopy begins anywhere.
    lowest_canopy_m: f32,
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
    /// The least that the pool held at the end of a month.
    lowest_pool: f32,
}

/// A plant that lives on, as large as it has grown.
#[derive(Clone, Copy, Debug)]
struct Survivor {
    plant: u32,
    size_m: [f32; 2],
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
            lowest_canopy_m: plot.canopy.iter().map(|c| c.base_m).fold(f32::INFINITY, f32::min),
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

    /// Memory that the plants take, with what their arrays have room for.
    pub fn plant_bytes(&self) -> usize {
        let measures = [
            &self.east_m,
            &self.south_m,
            &self.idealized_age_years,
            &self.carbon_pool,
            &self.height_m,
            &self.crown_radius_m,
        ];
        self.id.capacity() * size_of::<u64>()
            + self.species.capacity() * size_of::<u16>()
            + measures.iter().map(|values| values.capacity() * size_of::<f32>()).sum::<usize>()
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
        let (seedlings, lowest_pool) = self.grow();
        let deaths = self.die(&lowest_pool);
        self.add(&seedlings);
        YearFigures { plants, deaths, sprouted: seedlings.len() }
    }

    /// Adds seedlings as [`Community::plant`] would, each measure by itself.
    fn add(&mut self, seedlings: &[Seedling]) {
        let sizes: Vec<[f32; 2]> = self.traits.iter().map(|traits| traits.size_m(0.0)).collect();
        let size = |seedling: &Seedling| sizes[usize::from(seedling.species)];
        let pool = self.parameters.pool_capacity;
        rayon::scope(|measures| {
            measures.spawn(|_| self.id.extend(seedlings.iter().map(|s| s.id)));
            measures.spawn(|_| self.species.extend(seedlings.iter().map(|s| s.species)));
            measures.spawn(|_| self.east_m.extend(seedlings.iter().map(|s| s.east_m)));
            measures.spawn(|_| self.south_m.extend(seedlings.iter().map(|s| s.south_m)));
            measures.spawn(|_| self.idealized_age_years.extend(seedlings.iter().map(|_| 0.0)));
            measures.spawn(|_| self.carbon_pool.extend(seedlings.iter().map(|_| pool)));
            measures.spawn(|_| self.height_m.extend(seedlings.iter().map(|s| size(s)[0])));
            measures.spawn(|_| self.crown_radius_m.extend(seedlings.iter().map(|s| size(s)[1])));
        });
    }

    /// Twelve months of growth under competition; gives the year's seedlings, and how low each plant's carbon pool fell.
    fn grow(&mut self) -> (Vec<Seedling>, Vec<f32>) {
        let tiles = Tile::all(&self.plot);
        let by_tile = self.by_tile(tiles.len());
        let mut years: Vec<TileYear> = tiles
            .par_iter()
            .zip(by_tile)
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

        let seedlings = years.iter_mut().flat_map(|year| std::mem::take(&mut year.seedlings));
        let seedlings: Vec<Seedling> = seedlings.collect();
        let grown = || years.iter().flat_map(|year| &year.grown).chain(&together);
        let set = |values: &mut [f32], of: fn(&Grown) -> f32| {
            grown().for_each(|grown| values[grown.plant as usize] = of(grown));
        };
        let mut lowest_pool = vec![0.0; self.id.len()];
        rayon::scope(|measures| {
            measures
                .spawn(|_| set(&mut self.idealized_age_years, |grown| grown.idealized_age_years));
            measures.spawn(|_| set(&mut self.carbon_pool, |grown| grown.carbon_pool));
            measures.spawn(|_| set(&mut lowest_pool, |grown| grown.lowest_pool));
        });
        (seedlings, lowest_pool)
    }

    /// Plants that reach into each tile.
    fn by_tile(&self, tile_count: usize) -> Vec<Vec<u32>> {
        let tile_cols = self.plot.cols.div_ceil(TILE_CELLS);
        let mut tiles: Vec<Vec<u32>> = vec![Vec::new(); tile_count];
        for plant in 0..self.len() {
            let index = plant as u32; // far fewer than 2³²
            if self.disk(plant).is_of_one_cell(self.plot.cell_m) {
                let [row, col] = self.plot.cell_at(self.east_m[plant], self.south_m[plant]);
                tiles[row / TILE_CELLS * tile_cols + col / TILE_CELLS].push(index);
                continue;
            }
            let [rows, cols] = self.tiles_of(plant);
            for row in rows {
                for col in cols.clone() {
                    tiles[row * tile_cols + col].push(index);
                }
            }
        }
        tiles
    }

    /// Puts plants in the order in which they get their shares: the tallest first, of equals the oldest id.
    fn sort_by_height(&self, plants: &mut [u32]) {
        // heights are not negative, so their bits are in their order
        let lowness = |plant: u32| u64::from(u32::MAX - self.height_m[plant as usize].to_bits());
        let mut keys: Vec<u64> =
            plants.iter().map(|plant| lowness(*plant) << 32 | u64::from(*plant)).collect();
        keys.sort_unstable();
        plants.iter_mut().zip(&keys).for_each(|(plant, key)| *plant = *key as u32); // the low half
        let height = |plant: u32| self.height_m[plant as usize].to_bits();
        let id = |plant: &u32| self.id[*plant as usize];
        for equals in plants.chunk_by_mut(|a, b| height(*a) == height(*b)) {
            if !equals.is_sorted_by_key(id) {
                equals.sort_unstable_by_key(id);
            }
        }
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

    /// Whether a plant's crown lies in one tile.
    fn is_of_one_tile(&self, plant: usize) -> bool {
        self.disk(plant).is_of_one_cell(self.plot.cell_m)
            || self.tiles_of(plant).iter().all(|tiles| tiles.len() == 1)
    }

    fn disk(&self, plant: usize) -> Disk {
        Disk {
            east_m: self.east_m[plant],
            south_m: self.south_m[plant],
            radius_m: self.crown_radius_m[plant],
        }
    }

    fn tile_year(&self, tile: Tile, mut plants: Vec<u32>) -> TileYear {
        self.sort_by_height(&mut plants);
        let competitor = |plant: &u32| Competitor {
            disk: self.disk(*plant as usize),
            species: self.species[*plant as usize],
        };
        let competitors: Vec<Competitor> = plants.iter().map(competitor).collect();
        let (shares, cells) = tile.compete(&self.plot, &self.traits, &competitors);
        let (mut grown, mut parts) = (Vec::with_capacity(plants.len()), Vec::new());
        for (plant, shares) in plants.iter().zip(&shares) {
            if self.is_of_one_tile(*plant as usize) {
                grown.push(self.grown(*plant, shares));
            } else {
                parts.push((*plant, *shares));
            }
        }
        let seedlings = germination::sprout(&cells, &self.plot, &self.traits, self.seed, self.year);
        TileYear { grown, parts, seedlings }
    }

    /// Twelve months of a plant on its shares.
    fn grown(&self, plant: u32, shares: &Shares) -> Grown {
        let index = plant as usize;
        let traits = &self.traits[usize::from(self.species[index])];
        let [row, col] = self.plot.cell_at(self.east_m[index], self.south_m[index]);
        let ground = &self.plot.ground[self.plot.ground_of(row, col)];
        let (light, per_cell) = (shares.light / shares.cells, 1.0 / shares.cells);
        let mut water_mm = shares.water_mm;
        water_mm.iter_mut().for_each(|mm| *mm *= per_cell);
        let vigor = Offer::new(ground, light, water_mm).vigor(traits);
        let (mut pool, mut age_years) = (self.carbon_pool[index], self.idealized_age_years[index]);
        let mut lowest_pool = f32::INFINITY;
        for (vigor, years) in vigor.into_iter().zip(traits.years_a_month) {
            let overflow;
            (pool, overflow) = carbon_pool::after_month(pool, vigor, self.parameters.pool_capacity);
            age_years += overflow * years;
            lowest_pool = if pool < lowest_pool { pool } else { lowest_pool };
        }
        Grown { plant, idealized_age_years: age_years, carbon_pool: pool, lowest_pool }
    }

    /// The yearly test of death, and the end of what has reached the canopy; gives the number of deaths.
    fn die(&mut self, lowest_pool: &[f32]) -> usize {
        let before = self.len();
        let dominated = match self.parameters.competition {
            Competition::Resources => Vec::new(),
            Competition::Intersection => {
                let disks: Vec<Disk> = (0..before).map(|plant| self.disk(plant)).collect();
                intersection::dominated(&disks, &self.height_m, &self.id)
            }
        };
        let is_dominated = |plant: u32| dominated.get(plant as usize) == Some(&true);
        let plants = (0..before as u32).into_par_iter(); // far fewer than 2³²
        let survivors: Vec<Survivor> = plants
            .filter(|plant| !is_dominated(*plant))
            .filter_map(|plant| self.survivor(plant, lowest_pool[plant as usize]))
            .collect();
        rayon::scope(|measures| {
            measures.spawn(|_| keep(&mut self.id, &survivors));
            measures.spawn(|_| keep(&mut self.species, &survivors));
            measures.spawn(|_| keep(&mut self.east_m, &survivors));
            measures.spawn(|_| keep(&mut self.south_m, &survivors));
            measures.spawn(|_| keep(&mut self.idealized_age_years, &survivors));
            measures.spawn(|_| keep(&mut self.carbon_pool, &survivors));
            measures.spawn(|_| replace(&mut self.height_m, survivors.iter().map(|s| s.size_m[0])));
            measures.spawn(|_| {
                replace(&mut self.crown_radius_m, survivors.iter().map(|s| s.size_m[1]))
            });
        });
        before - self.len()
    }

    /// A plant with the size it has grown to, if it lives on.
    fn survivor(&self, plant: u32, lowest_pool: f32) -> Option<Survivor> {
        let index = plant as usize;
        let traits = &self.traits[usize::from(self.species[index])];
        let background = traits.background_death_probability_per_year;
        let chance = mortality::death_probability_per_year(background, lowest_pool);
        let (seed, entity) = (self.seed, self.id[index]);
        let key = Key { seed, process: Process::PlantDeath, year: self.year, month: 0, entity };
        if chance >= 1.0 || rng::uniforms(key)[0] < chance {
            return None;
        }
        let size_m = traits.size_m(self.idealized_age_years[index]);
        let is_below_canopy = size_m[0] < self.lowest_canopy_m || {
            let [row, col] = self.plot.cell_at(self.east_m[index], self.south_m[index]);
            size_m[0] < self.plot.canopy[row * self.plot.cols + col].base_m
        };
        is_below_canopy.then_some(Survivor { plant, size_m })
    }
}

/// Keeps the values of survivors, which are in ascending order.
fn keep<T: Copy>(values: &mut Vec<T>, survivors: &[Survivor]) {
    for (to, survivor) in survivors.iter().enumerate() {
        values[to] = values[survivor.plant as usize];
    }
    values.truncate(survivors.len());
}

fn replace(values: &mut Vec<f32>, by: impl Iterator<Item = f32>) {
    values.clear();
    values.extend(by);
}
