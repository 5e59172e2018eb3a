//! Community: the plants of a plot, and what a year does to them.
//!
//! # Reference
//! Kapp et al. 2020, Algorithm 2, doi:10.1145/3414685.3417848.
//! # Departures
//! Crowns enter the competition grid at the turn of the year, not after each month's growth: within a year shares change
//! with the months' light and water alone. One full growing season counts as a year of idealized age, else plants of short
//! seasons would never come near the height that their age allows.

mod acclimation;
mod state;

use std::ops::Range;

use rayon::iter::Either;
use rayon::prelude::*;

use super::competition::{Competitor, Shares, TILE_CELLS, Tile};
use super::germination::{self, Seedling, Sowing};
use super::plot::{Disk, Plot};
use super::traits::{Size, Traits};
use super::vigor::Offer;
use super::{Competition, GrowthCurve, Parameters, carbon_pool, intersection, mortality};
use crate::raster::MONTHS;
use crate::rng::{self, Key, Process};
use crate::species::Biome;
pub use state::{CommunityState, CommunityStateRef};

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
    /// Whether plants have stems and crowding: in whole forests.
    is_whole_forest: bool,
    /// Added to the ids of seedlings.
    first_seedling_id: u64,
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
    /// Stem diameter at breast height; empty but in whole forests ([`GrowthCurve::Envelope`]).
    pub dbh_m: Vec<f32>,
    /// Mean vigor over the last growing season; empty but in whole forests.
    pub vigor: Vec<f32>,
    /// Share of the light over its ground that others take, 0 alone to 1, last year; empty but in whole forests.
    pub crowding_fraction: Vec<f32>,
    /// What it bears beyond its niche, in months of the best vigor a month ([`Community::acclimate`]); empty but in whole
    /// forests.
    pub acclimation: Vec<f32>,
}

/// What befalls plants from outside in a year: nothing, unless told.
#[derive(Clone, Copy, Default)]
pub struct Circumstances<'a> {
    /// Whether a decaying downed log lies on each simulation cell; empty where there is none.
    pub downed_logs: &'a [bool],
    /// What plants lose of their pools month by month; empty where none does.
    pub losses: Option<&'a Losses>,
}

/// What some plants lose of their carbon pools by month, in months of the best vigor.
#[derive(Clone, Debug, Default)]
pub struct Losses {
    /// Index into `by_month` and 1, or 0 for plants that lose nothing; empty if none does.
    pub of_plant: Vec<u32>,
    /// January first.
    pub by_month: Vec<[f32; MONTHS]>,
}

impl Losses {
    /// Adds to what a plant of `plants` loses in a month.
    pub fn add(&mut self, plants: usize, plant: usize, month_index: usize, loss: f32) {
        self.of_plant.resize(plants, 0);
        if self.of_plant[plant] == 0 {
            self.by_month.push([0.0; MONTHS]);
            self.of_plant[plant] = self.by_month.len() as u32; // no more than plants
        }
        self.by_month[self.of_plant[plant] as usize - 1][month_index] += loss;
    }

    fn of(&self, plant: usize) -> [f32; MONTHS] {
        match self.of_plant.get(plant) {
            None | Some(0) => [0.0; MONTHS],
            Some(index) => self.by_month[*index as usize - 1],
        }
    }
}

/// What months of growth lead to at the end of the year.
#[derive(Clone, Debug, Default)]
pub struct Season {
    /// The least that each plant's pool held at the end of a month.
    pub lowest_pool: Vec<f32>,
    /// Seedlings of the year.
    seedlings: Vec<Seedling>,
}

/// A plant that died.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeadPlant {
    /// Its id.
    pub id: u64,
    /// Its species.
    pub species: u16,
    /// Metres east.
    pub east_m: f32,
    /// Metres south.
    pub south_m: f32,
    /// Height.
    pub height_m: f32,
    /// Crown radius.
    pub crown_radius_m: f32,
    /// Stem diameter at breast height.
    pub dbh_m: f32,
    /// Share of the light over its ground that others took.
    pub crowding_fraction: f32,
    /// Its chance of death within the year; 1 if it was struck.
    pub death_probability_per_year: f32,
    /// Whether it would have died without stress.
    pub is_of_age: bool,
    /// Index that it had when it died.
    pub index: u32,
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

/// What a year left of a plant's size.
#[derive(Clone, Copy, Debug)]
struct GrownSize {
    size_m: Size,
    vigor: f32,
    crowding_fraction: f32,
}

/// Runs of plants that are sorted into tiles side by side. chosen: enough for the cores of a desk, few lists for many tiles.
const TILE_RUNS: usize = 16;

/// A tile's year.
struct TileYear {
    /// Plants whose crowns lie wholly in it.
    grown: Vec<Grown>,
    /// Their sizes, in whole forests.
    sizes: Vec<GrownSize>,
    /// Shares here of plants that reach into other tiles.
    parts: Vec<(u32, Shares)>,
    seedlings: Vec<Seedling>,
}

impl Community {
    /// Bare ground under a plot's canopy, in year 0.
    pub fn new(plot: Plot, biome: &Biome, parameters: Parameters, seed: u64) -> Self {
        Self {
            traits: Traits::of(biome, &parameters),
            lowest_canopy_m: plot.lowest_canopy_m(),
            is_whole_forest: parameters.growth == GrowthCurve::Envelope,
            first_seedling_id: 0,
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
            dbh_m: Vec::new(),
            vigor: Vec::new(),
            crowding_fraction: Vec::new(),
            acclimation: Vec::new(),
        }
    }

    /// Year in which a plant sprouted; 0 if it was there from the start.
    pub fn year_of_sprouting(&self, id: u64) -> u16 {
        id.checked_sub(self.first_seedling_id).map_or(0, |number| (number >> 32) as u16)
    }

    /// Lets ids of seedlings begin at `first_id`.
    pub fn set_first_seedling_id(&mut self, first_id: u64) {
        self.first_seedling_id = first_id;
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
        self.id.capacity() * size_of::<u64>()
            + self.species.capacity() * size_of::<u16>()
            + self
                .measures()
                .iter()
                .map(|values| values.capacity() * size_of::<f32>())
                .sum::<usize>()
    }

    /// Years simulated.
    pub fn year(&self) -> u16 {
        self.year
    }

    /// The ground.
    pub fn plot(&self) -> &Plot {
        &self.plot
    }

    /// The ground, to change what it offers.
    pub fn plot_mut(&mut self) -> &mut Plot {
        &mut self.plot
    }

    /// Numbers of its processes.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// What each species asks for.
    pub(super) fn traits(&self, species: u16) -> &Traits {
        &self.traits[usize::from(species)]
    }

    /// Vigor that a plant's pool holds.
    pub fn pool_capacity(&self, plant: usize) -> f32 {
        self.parameters.pool_capacity_of(self.height_m[plant])
    }

    /// Adds a plant of an idealized age, its reserves full.
    pub fn plant(&mut self, id: u64, species: u16, [east_m, south_m]: [f32; 2], age_years: f32) {
        let [height_m, crown_radius_m] = self.traits[usize::from(species)].size_m(age_years);
        self.id.push(id);
        self.species.push(species);
        self.east_m.push(east_m);
        self.south_m.push(south_m);
        self.idealized_age_years.push(age_years);
        self.carbon_pool.push(self.parameters.pool_capacity_of(height_m));
        self.height_m.push(height_m);
        self.crown_radius_m.push(crown_radius_m);
        if self.is_whole_forest {
            let traits = &self.traits[usize::from(species)];
            self.dbh_m.push(traits.envelope_size_m(age_years, 1.0)[2]);
            self.vigor.push(0.0);
            self.crowding_fraction.push(0.0);
            self.acclimation.push(0.0);
        }
    }

    /// Lives through a year: twelve months of growth, then deaths, then seedlings for the next.
    pub fn live_a_year(&mut self) -> YearFigures {
        self.begin_year();
        let plants = self.len();
        let mut season = Season::default();
        self.grow(0..MONTHS, &Circumstances::default(), &mut season);
        let deaths = self.die(&season.lowest_pool).len();
        YearFigures { plants, deaths, sprouted: self.sprout(season) }
    }

    /// Begins a year; [`Community::grow`] through its months, [`Community::die`] and [`Community::sprout`] are its rest.
    pub fn begin_year(&mut self) {
        self.year += 1;
    }

    /// Adds a season's seedlings and gives their number.
    pub fn sprout(&mut self, season: Season) -> usize {
        self.add(&season.seedlings);
        season.seedlings.len()
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
        if self.is_whole_forest {
            self.dbh_m.resize(self.id.len(), 0.0);
            self.vigor.resize(self.id.len(), 0.0);
            self.crowding_fraction.resize(self.id.len(), 0.0);
            self.acclimation.resize(self.id.len(), 0.0);
        }
    }

    /// Months of growth under competition, by number from 0; those with December give the year's seedlings.
    ///
    /// Crowns enter the grid as they are; in whole forests plants are as large afterwards as they have grown.
    pub fn grow(&mut self, months: Range<usize>, around: &Circumstances, season: &mut Season) {
        let tiles = Tile::all(&self.plot);
        let by_tile = self.by_tile(tiles.len());
        let mut years: Vec<TileYear> = tiles
            .par_iter()
            .zip(by_tile)
            .map(|(tile, plants)| self.tile_year(*tile, plants, &months, around))
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
            self.grown(parts[0].0, &shares, &months, around)
        });
        let (together, sizes): (Vec<Grown>, Vec<Option<GrownSize>>) = together.unzip();
        years.push(TileYear {
            grown: together,
            sizes: sizes.into_iter().flatten().collect(),
            parts: Vec::new(),
            seedlings: Vec::new(),
        });

        season.seedlings =
            years.iter_mut().flat_map(|year| std::mem::take(&mut year.seedlings)).collect();
        let grown = || years.iter().flat_map(|year| &year.grown);
        let set = |values: &mut [f32], of: fn(&Grown) -> f32| {
            grown().for_each(|grown| values[grown.plant as usize] = of(grown));
        };
        season.lowest_pool.resize(self.id.len(), f32::INFINITY);
        rayon::scope(|measures| {
            measures
                .spawn(|_| set(&mut self.idealized_age_years, |grown| grown.idealized_age_years));
            measures.spawn(|_| set(&mut self.carbon_pool, |grown| grown.carbon_pool));
            measures.spawn(|_| {
                grown().for_each(|grown| {
                    let lowest = &mut season.lowest_pool[grown.plant as usize];
                    *lowest = lowest.min(grown.lowest_pool);
                });
            });
        });
        if !self.is_whole_forest {
            return;
        }
        let measured = || {
            years.iter().flat_map(|year| {
                year.grown.iter().map(|grown| grown.plant as usize).zip(&year.sizes)
            })
        };
        let measure = |values: &mut [f32], of: fn(&GrownSize) -> f32| {
            measured().for_each(|(plant, size)| values[plant] = of(size));
        };
        rayon::scope(|measures| {
            measures.spawn(|_| measure(&mut self.height_m, |size| size.size_m[0]));
            measures.spawn(|_| measure(&mut self.crown_radius_m, |size| size.size_m[1]));
            measures.spawn(|_| measure(&mut self.dbh_m, |size| size.size_m[2]));
            measures.spawn(|_| measure(&mut self.vigor, |size| size.vigor));
            measures.spawn(|_| measure(&mut self.crowding_fraction, |size| size.crowding_fraction));
        });
    }

    /// Plants that reach into each tile, in their order.
    fn by_tile(&self, tile_count: usize) -> Vec<Vec<u32>> {
        // runs of plants side by side, put one behind the other for each tile
        let run = self.len().div_ceil(TILE_RUNS).max(1);
        let runs: Vec<Vec<Vec<u32>>> = (0..TILE_RUNS)
            .into_par_iter()
            .map(|index| {
                let plants = index * run..((index + 1) * run).min(self.len());
                self.run_by_tile(plants, tile_count)
            })
            .collect();
        (0..tile_count)
            .into_par_iter()
            .map(|tile| {
                let parts = runs.iter().map(|run| run[tile].as_slice());
                parts.collect::<Vec<_>>().concat()
            })
            .collect()
    }

    fn run_by_tile(&self, plants: Range<usize>, tile_count: usize) -> Vec<Vec<u32>> {
        let tile_cols = self.plot.cols.div_ceil(TILE_CELLS);
        let mut tiles: Vec<Vec<u32>> = vec![Vec::new(); tile_count];
        for plant in plants {
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

    fn competitor(&self, plant: u32) -> Competitor {
        let index = plant as usize;
        Competitor { disk: self.disk(index), species: self.species[index] }
    }

    fn disk(&self, plant: usize) -> Disk {
        Disk {
            east_m: self.east_m[plant],
            south_m: self.south_m[plant],
            radius_m: self.crown_radius_m[plant],
        }
    }

    fn tile_year(
        &self,
        tile: Tile,
        mut plants: Vec<u32>,
        months: &Range<usize>,
        around: &Circumstances,
    ) -> TileYear {
        self.sort_by_height(&mut plants);
        let competitors: Vec<Competitor> =
            plants.iter().map(|plant| self.competitor(*plant)).collect();
        let (shares, cells) = tile.compete(&self.plot, &self.traits, &competitors);
        let mut year = TileYear {
            grown: Vec::with_capacity(plants.len()),
            sizes: Vec::new(),
            parts: Vec::new(),
            seedlings: Vec::new(),
        };
        for (plant, shares) in plants.iter().zip(&shares) {
            if self.is_of_one_tile(*plant as usize) {
                let (grown, size) = self.grown(*plant, shares, months, around);
                year.grown.push(grown);
                year.sizes.extend(size);
            } else {
                year.parts.push((*plant, *shares));
            }
        }
        if months.end == MONTHS {
            let sowing = Sowing {
                plot: &self.plot,
                traits: &self.traits,
                parameters: &self.parameters,
                downed_logs: around.downed_logs,
                seed: self.seed,
                year: self.year,
                first_id: self.first_seedling_id,
            };
            let trunks = self.trunks(tile, &plants);
            year.seedlings = germination::sprout(&cells, &trunks, &sowing);
        }
        year
    }

    /// Whether a trunk stands in each cell of a tile; empty but in whole forests.
    fn trunks(&self, tile: Tile, plants: &[u32]) -> Vec<bool> {
        if !self.is_whole_forest {
            return Vec::new();
        }
        let mut trunks = vec![false; tile.rows * tile.cols];
        for plant in plants {
            let plant = *plant as usize;
            let [row, col] = self.plot.cell_at(self.east_m[plant], self.south_m[plant]);
            let (row, col) = (row.wrapping_sub(tile.row), col.wrapping_sub(tile.col));
            if row < tile.rows && col < tile.cols {
                trunks[row * tile.cols + col] = true;
            }
        }
        trunks
    }

    /// Months of a plant on its shares; its size and crowding in whole forests.
    fn grown(
        &self,
        plant: u32,
        shares: &Shares,
        months: &Range<usize>,
        around: &Circumstances,
    ) -> (Grown, Option<GrownSize>) {
        let index = plant as usize;
        let traits = &self.traits[usize::from(self.species[index])];
        let mut vigor = self.vigor_on(index, shares);
        let before_years = self.idealized_age_years[index];
        let (mut pool, mut age_years) = (self.carbon_pool[index], before_years);
        let mut lowest_pool = f32::INFINITY;
        let mean_vigor = if self.is_whole_forest {
            let season = traits.years_a_month;
            let mean = vigor.iter().zip(season).map(|(vigor, share)| vigor * share).sum::<f32>();
            let acclimation = self.acclimation[index];
            vigor.iter_mut().for_each(|vigor| *vigor += acclimation);
            if let Some(losses) = around.losses {
                vigor.iter_mut().zip(losses.of(index)).for_each(|(vigor, loss)| *vigor -= loss);
            }
            mean
        } else {
            0.0
        };
        let capacity = self.parameters.pool_capacity_of(self.height_m[index]);
        let months = months.clone();
        for (vigor, years) in vigor[months.clone()].iter().zip(&traits.years_a_month[months]) {
            let overflow;
            (pool, overflow) = carbon_pool::after_month(pool, *vigor, capacity);
            age_years += overflow * years;
            lowest_pool = if pool < lowest_pool { pool } else { lowest_pool };
        }
        let size = self.is_whole_forest.then(|| {
            let open = shares.cells * traits.passed_light_fraction;
            let crowding_fraction = (1.0 - shares.light_left / open).clamp(0.0, 1.0);
            let from = traits.envelope_size_m(before_years, crowding_fraction);
            let to = traits.envelope_size_m(age_years, crowding_fraction);
            let now = [self.height_m[index], self.crown_radius_m[index], self.dbh_m[index]];
            let size_m = std::array::from_fn(|measure| {
                now[measure] + (to[measure] - from[measure]).max(0.0)
            });
            GrownSize { size_m, vigor: mean_vigor, crowding_fraction }
        });
        (Grown { plant, idealized_age_years: age_years, carbon_pool: pool, lowest_pool }, size)
    }

    /// Vigor of a plant by month on its shares, as its niche has it.
    #[inline]
    fn vigor_on(&self, index: usize, shares: &Shares) -> [f32; MONTHS] {
        let traits = &self.traits[usize::from(self.species[index])];
        let [row, col] = self.plot.cell_at(self.east_m[index], self.south_m[index]);
        let ground = &self.plot.ground[self.plot.ground_of(row, col)];
        let (light, per_cell) = (shares.light / shares.cells, 1.0 / shares.cells);
        let mut water_mm = shares.water_mm;
        water_mm.iter_mut().for_each(|mm| *mm *= per_cell);
        Offer::new(ground, light, water_mm).vigor(traits)
    }

    /// The yearly test of death, and the end of what has reached the canopy.
    pub fn die(&mut self, lowest_pool: &[f32]) -> Vec<DeadPlant> {
        let dominated = match self.parameters.competition {
            Competition::Resources => Vec::new(),
            Competition::Intersection => {
                let disks: Vec<Disk> = (0..self.len()).map(|plant| self.disk(plant)).collect();
                intersection::dominated(&disks, &self.height_m, &self.id)
            }
        };
        self.part(|community, plant| {
            if dominated.get(plant as usize) == Some(&true) {
                Either::Right(community.dead(plant, 1.0, false))
            } else {
                community.survivor(plant, lowest_pool[plant as usize])
            }
        })
    }

    /// Takes the plants away that were `struck`, one entry a plant.
    pub fn fell(&mut self, struck: &[bool]) -> Vec<DeadPlant> {
        self.part(|community, plant| {
            let index = plant as usize;
            if struck[index] {
                return Either::Right(community.dead(plant, 1.0, false));
            }
            let size_m = [community.height_m[index], community.crown_radius_m[index]];
            Either::Left(Survivor { plant, size_m })
        })
    }

    /// Parts the living from the dead.
    fn part(
        &mut self,
        fate: impl Fn(&Self, u32) -> Either<Survivor, DeadPlant> + Sync,
    ) -> Vec<DeadPlant> {
        let plants = (0..self.len() as u32).into_par_iter(); // far fewer than 2³²
        let (survivors, dead): (Vec<Survivor>, Vec<DeadPlant>) =
            plants.partition_map(|plant| fate(self, plant));
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
            if self.is_whole_forest {
                measures.spawn(|_| keep(&mut self.dbh_m, &survivors));
                measures.spawn(|_| keep(&mut self.vigor, &survivors));
                measures.spawn(|_| keep(&mut self.crowding_fraction, &survivors));
                measures.spawn(|_| keep(&mut self.acclimation, &survivors));
            }
        });
        dead
    }

    fn dead(&self, plant: u32, death_probability_per_year: f32, is_of_age: bool) -> DeadPlant {
        let index = plant as usize;
        let of_forest = |values: &[f32]| values.get(index).copied().unwrap_or_default();
        DeadPlant {
            id: self.id[index],
            species: self.species[index],
            east_m: self.east_m[index],
            south_m: self.south_m[index],
            height_m: self.height_m[index],
            crown_radius_m: self.crown_radius_m[index],
            dbh_m: of_forest(&self.dbh_m),
            crowding_fraction: of_forest(&self.crowding_fraction),
            death_probability_per_year,
            is_of_age,
            index: plant,
        }
    }

    /// A plant with the size it has grown to, if it lives on.
    fn survivor(&self, plant: u32, lowest_pool: f32) -> Either<Survivor, DeadPlant> {
        let index = plant as usize;
        let traits = &self.traits[usize::from(self.species[index])];
        let background = traits.background_death_probability_per_year;
        let chance = mortality::death_probability_per_year(background, lowest_pool);
        let (seed, entity) = (self.seed, self.id[index]);
        let key = Key { seed, process: Process::PlantDeath, year: self.year, month: 0, entity };
        let draw = rng::uniforms(key)[0];
        if chance >= 1.0 || draw < chance {
            return Either::Right(self.dead(plant, chance, draw < background));
        }
        if self.is_whole_forest {
            let size_m = [self.height_m[index], self.crown_radius_m[index]];
            return Either::Left(Survivor { plant, size_m });
        }
        let size_m = traits.size_m(self.idealized_age_years[index]);
        let is_below_canopy = size_m[0] < self.lowest_canopy_m || {
            let [row, col] = self.plot.cell_at(self.east_m[index], self.south_m[index]);
            size_m[0] < self.plot.canopy_at(row * self.plot.cols + col).base_m
        };
        if is_below_canopy {
            Either::Left(Survivor { plant, size_m })
        } else {
            Either::Right(self.dead(plant, 1.0, false))
        }
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
