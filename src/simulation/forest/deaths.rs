//! What becomes of plants that die: snags, downed logs, litter; and of branches that living trees give up.

use rayon::prelude::*;

use super::run::Forest;
use super::tally::{LEAST_DBH_M, RECORDED_HEIGHT_M, YearTally};
use crate::plants::deadwood::{Cause, DownedLogKind, LifeEvent, LifeEventKind};
use crate::rng::{self, Key, Process};
use crate::simulation::community::{DeadPlant, Losses, Season};
use crate::simulation::deadwood::branches::Branches;
use crate::simulation::deadwood::downed_log::LEAST_DIAMETER_M;
use crate::simulation::deadwood::stock::{FallingBranches, FallingStem, Source, YEARS_END};

/// Share of its primary branches that a wholly shaded tree gives up in a year. chosen: a crown that rises by its own length
/// in two centuries.
const PRUNED_FRACTION_PER_YEAR: f32 = 0.005;

/// Least share of its reserves that a dry year takes of a plant which counts as parched. chosen: half.
const LEAST_PARCHED: f32 = 0.5;

/// What a storm did to a tree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Struck {
    /// Nothing that kills it.
    #[default]
    No,
    /// It lies, its root plate torn out.
    Uprooted {
        /// Direction that it fell to, clockwise from north.
        azimuth_rad: f32,
    },
    /// Its stem broke.
    Snapped {
        /// Share of its height that stands.
        standing_fraction: f32,
        azimuth_rad: f32,
    },
}

/// What a year's disturbances do to each plant.
pub struct Toll {
    /// Whether fire reached it.
    pub is_burnt: Vec<bool>,
    /// Whether it is ill.
    pub is_ill: Vec<bool>,
    /// Trees that storms took, with the month.
    pub felled: Vec<(u64, u8)>,
}

impl Toll {
    pub fn new(plants: usize) -> Self {
        Self { is_burnt: vec![false; plants], is_ill: vec![false; plants], felled: Vec::new() }
    }

    /// Leaves trees out that a storm took, here and in what else the year keeps by plant.
    pub fn forget(
        &mut self,
        felled: &[DeadPlant],
        month: u8,
        season: &mut Season,
        losses: &mut Losses,
    ) {
        let mut stays = vec![true; self.is_ill.len()];
        for plant in felled {
            stays[plant.index as usize] = false;
            self.felled.push((plant.id, month));
        }
        keep(&mut self.is_burnt, &stays);
        keep(&mut self.is_ill, &stays);
        keep(&mut season.lowest_pool, &stays);
        if !losses.of_plant.is_empty() {
            keep(&mut losses.of_plant, &stays);
        }
    }
}

/// Keeps the values of those that stay.
fn keep<T>(values: &mut Vec<T>, stays: &[bool]) {
    let mut stays = stays.iter();
    values.retain(|_| stays.next().is_none_or(|stays| *stays));
}

impl Forest {
    /// Why a plant died.
    fn cause(&self, plant: &DeadPlant, toll: &Toll) -> Cause {
        let index = plant.index as usize;
        if plant.is_of_age {
            Cause::Age
        } else if toll.is_burnt[index] {
            Cause::Fire
        } else if toll.is_ill[index] {
            Cause::Disease
        } else if self.rain_fraction.iter().any(|fraction| *fraction < 1.0) {
            Cause::Drought
        } else {
            Cause::Competition
        }
    }

    /// Makes snags and litter of the year's dead.
    pub(super) fn bury(&mut self, dead: &[DeadPlant], toll: &Toll, figures: &mut YearTally) {
        for plant in dead {
            let cause = self.cause(plant, toll);
            let year = self.community.year();
            let species = &self.biome.species[usize::from(plant.species)];
            let leaves_snag = self.stock.add_snag(plant, species, cause, year).is_some();
            self.count_death(plant, YEARS_END, cause, leaves_snag, figures);
        }
    }

    /// Lays down trees that a storm took in a month; `struck` has what it did, by the plants' indices.
    pub(super) fn lay_down(
        &mut self,
        felled: &[DeadPlant],
        struck: &[Struck],
        month: u8,
        figures: &mut YearTally,
    ) {
        let trunks = self.standing_trunks();
        let year = self.community.year();
        for plant in felled {
            let species = &self.biome.species[usize::from(plant.species)];
            let at = [plant.east_m, plant.south_m];
            let source = Source { id: plant.id, index: plant.species, species, at };
            let (kind, azimuth_rad, standing_m) = match struck[plant.index as usize] {
                Struck::No => continue,
                Struck::Uprooted { azimuth_rad } => (DownedLogKind::Uprooted, azimuth_rad, 0.0),
                Struck::Snapped { standing_fraction, azimuth_rad } => {
                    (DownedLogKind::Top, azimuth_rad, standing_fraction * plant.height_m)
                }
            };
            let mut diameter_base_m = plant.dbh_m;
            if standing_m > 0.0
                && let Some(snag) = self.stock.add_snag(plant, species, Cause::Storm, year)
            {
                snag.height_m = standing_m;
                snag.branch_fraction = standing_m / plant.height_m;
                diameter_base_m = snag.diameter_at_m(standing_m);
            }
            let stem = FallingStem {
                kind,
                cause: Cause::Storm,
                length_m: plant.height_m - standing_m,
                diameter_base_m,
                diameter_tip_m: 0.0,
                azimuth_rad,
                decayed_fraction: 0.0,
            };
            self.stock.lay_stem(&source, &stem, &trunks, year);
            self.count_death(plant, month, Cause::Storm, true, figures);
        }
    }

    /// Counts a death, and records that of a plant which left deadwood or was as high as a breast.
    fn count_death(
        &mut self,
        plant: &DeadPlant,
        month: u8,
        cause: Cause,
        left_deadwood: bool,
        figures: &mut YearTally,
    ) {
        self.tally.died += 1;
        let species = usize::from(plant.species);
        figures.deaths[species][cause as usize] += 1;
        if plant.dbh_m >= LEAST_DBH_M {
            figures.tree_deaths[species][cause as usize] += 1;
        }
        if left_deadwood || plant.height_m >= RECORDED_HEIGHT_M {
            self.record_death(plant, month, cause);
        }
    }

    fn record_death(&mut self, plant: &DeadPlant, month: u8, cause: Cause) {
        let year = self.community.year();
        self.history.push(LifeEvent {
            plant_id: plant.id,
            year,
            month,
            kind: LifeEventKind::Died,
            severity: plant.death_probability_per_year,
            cause,
        });
    }

    /// Records whose reserves a dry year drew on, in its driest month: plants as high as a breast.
    pub(super) fn record_drought(&mut self, season: &Season) {
        let rain = self.rain_fraction;
        let driest = (0..rain.len()).min_by(|a, b| rain[*a].total_cmp(&rain[*b])).unwrap_or(0);
        if rain[driest] >= 1.0 {
            return;
        }
        let (community, year) = (&self.community, self.community.year());
        for (plant, lowest) in season.lowest_pool.iter().enumerate() {
            let severity = 1.0 - (lowest / community.pool_capacity(plant)).clamp(0.0, 1.0);
            if community.height_m[plant] >= RECORDED_HEIGHT_M && severity >= LEAST_PARCHED {
                self.history.push(LifeEvent {
                    plant_id: community.id[plant],
                    year,
                    month: driest as u8 + 1, // 1–12
                    kind: LifeEventKind::Parched,
                    severity,
                    cause: Cause::Drought,
                });
            }
        }
    }

    /// Puts the year's events in the order of time, without diseases of trees that a storm had taken before.
    pub(super) fn order_history(&mut self, first_of_year: usize, mut struck: Vec<(u64, u8)>) {
        struck.sort_unstable();
        let mut of_year = self.history.split_off(first_of_year);
        of_year.retain(|event| {
            let is_of_disease =
                matches!(event.kind, LifeEventKind::Infected | LifeEventKind::Recovered);
            match struck.binary_search_by_key(&event.plant_id, |(id, _)| *id) {
                Ok(found) if is_of_disease => event.month <= struck[found].1,
                _ => true,
            }
        });
        of_year.sort_by_key(|event| event.month); // stable: of a month as they came
        self.history.append(&mut of_year);
    }

    /// Branches that living trees give up in the shade of others.
    pub(super) fn prune(&mut self) {
        let (seed, year) = (self.seed, self.community.year());
        let community = &self.community;
        let branches_of = |plant: usize| {
            let species = community.traits(community.species[plant]).species();
            Branches::of(species, community.dbh_m[plant], community.crown_radius_m[plant])
        };
        let gives_up = |plant: &usize| {
            if community.dbh_m[*plant] < LEAST_PRUNED_DBH_M {
                return false;
            }
            let branches = branches_of(*plant);
            let entity = community.id[*plant];
            let key = Key { seed, process: Process::FallingBranch, year, month: YEARS_END, entity };
            let crowding = community.crowding_fraction[*plant];
            let chance = PRUNED_FRACTION_PER_YEAR * branches.count * crowding;
            branches.diameter_m >= LEAST_DIAMETER_M && rng::uniforms(key)[0] < chance
        };
        let pruned: Vec<usize> = (0..community.len()).into_par_iter().filter(gives_up).collect();
        for plant in pruned {
            let index = community.species[plant];
            let species = community.traits(index).species();
            let at = [community.east_m[plant], community.south_m[plant]];
            let source = Source { id: community.id[plant], index, species, at };
            let falling =
                FallingBranches { number: 1, cause: Cause::SelfPruning, decayed_fraction: 0.0 };
            self.stock.lay_branches(&source, &branches_of(plant), &falling, year, seed);
        }
    }
}

/// Least stem with branches as thick as downed logs: half of its cross section on ten branches.
const LEAST_PRUNED_DBH_M: f32 = 3.0 * LEAST_DIAMETER_M;
