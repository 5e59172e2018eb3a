//! The deadwood of a forest: its snags and downed logs, what becomes of dying trees, and a year of decay.

use super::branches::Branches;
use super::decay::{self, DecayParameters};
use super::downed_log::{DownedLog, LEAST_DIAMETER_M};
use super::falling::{self, StandingTrunks};
use super::snag::Snag;
use crate::math;
use crate::plants::deadwood::{Cause, DownedLogKind, LifeEvent, LifeEventKind};
use crate::rng::{self, Key, Process};
use crate::simulation::community::DeadPlant;
use crate::species::{Form, Species};

/// Least stem of a snag. chosen: thinner stems are litter within a few years; inventories of saplings begin at 2.5 cm.
pub const LEAST_SNAG_DBH_M: f32 = 0.025;

/// Month in which the year's deaths, decay and falls take place.
pub const YEARS_END: u8 = 12;

/// Snags and downed logs.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Stock {
    /// Dead trees that stand, in the order of their deaths.
    pub snags: Vec<Snag>,
    /// Wood on the ground, in the order in which it came down.
    pub downed_logs: Vec<DownedLog>,
    next_id: u64,
}

/// The ground that wood decays and falls on, by place in metres east and south.
pub trait Ground {
    /// How well fungi thrive, 0..=1.
    fn viability(&self, at: [f32; 2]) -> f32;
    /// Slope in radians, and the direction downhill, clockwise from north.
    fn slope(&self, at: [f32; 2]) -> [f32; 2];
}

/// A stem that comes down.
#[derive(Clone, Copy, Debug)]
pub struct FallingStem {
    /// Kind of downed log that it becomes.
    pub kind: DownedLogKind,
    /// What brings it down.
    pub cause: Cause,
    /// Length, m.
    pub length_m: f32,
    /// Diameter of its thick end, m.
    pub diameter_base_m: f32,
    /// Diameter of its thin end, m; a pointed stem has the least that holds together.
    pub diameter_tip_m: f32,
    /// Direction that it leans to, clockwise from north, radians.
    pub azimuth_rad: f32,
    /// Share of its deathspan that lies behind it.
    pub decayed_fraction: f32,
}

/// Branches that come down.
#[derive(Clone, Copy, Debug)]
pub struct FallingBranches {
    /// How many.
    pub number: u32,
    /// What brings them down.
    pub cause: Cause,
    /// Share of their deathspan that lies behind them.
    pub decayed_fraction: f32,
}

/// What wood decays in.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// How fast it decays.
    pub parameters: &'a DecayParameters,
    /// Where.
    pub ground: &'a (dyn Ground + Sync),
    /// The biome's species.
    pub species: &'a [Species],
    /// Trunks that stems fall between.
    pub trunks: &'a StandingTrunks,
}

/// Which plant wood comes from.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    /// Its id.
    pub id: u64,
    /// Index of its species.
    pub index: u16,
    /// Its species.
    pub species: &'a Species,
    /// Metres east and south.
    pub at: [f32; 2],
}

impl Stock {
    /// Lets a dead tree stand as a snag, if it has a stem, and gives it; what is left of shrubs and herbs is litter.
    pub fn add_snag(
        &mut self,
        plant: &DeadPlant,
        species: &Species,
        cause: Cause,
        year: u16,
    ) -> Option<&mut Snag> {
        let has_one_stem = matches!(species.form, Form::Tree | Form::ShrubTree);
        if plant.dbh_m < LEAST_SNAG_DBH_M || !has_one_stem {
            return None;
        }
        self.snags.push(Snag {
            id: plant.id,
            species: plant.species,
            east_m: plant.east_m,
            south_m: plant.south_m,
            height_m: plant.height_m,
            height_at_death_m: plant.height_m,
            crown_radius_m: plant.crown_radius_m,
            dbh_m: plant.dbh_m,
            decayed_years: 0.0,
            deathspan_years: decay::deathspan_years(species.decay.deathspan_years, plant.dbh_m),
            branch_fraction: 1.0,
            year,
            cause,
        });
        self.snags.last_mut()
    }

    /// Lays a stem down between the trunks that stand, if it is thick enough to be a downed log.
    pub fn lay_stem(
        &mut self,
        source: &Source,
        stem: &FallingStem,
        trunks: &StandingTrunks,
        year: u16,
    ) {
        if stem.diameter_base_m < LEAST_DIAMETER_M || stem.length_m < LEAST_LENGTH_M {
            return;
        }
        let azimuth_rad = trunks.direction(source.id, source.at, stem.azimuth_rad, stem.length_m);
        let full_years =
            decay::deathspan_years(source.species.decay.deathspan_years, stem.diameter_base_m);
        self.downed_logs.push(DownedLog {
            id: self.next_id,
            parent_id: source.id,
            species: source.index,
            kind: stem.kind,
            east_m: source.at[0],
            south_m: source.at[1],
            length_m: stem.length_m,
            diameter_base_m: stem.diameter_base_m,
            diameter_tip_m: stem.diameter_tip_m.max(TIP_FRACTION * stem.diameter_base_m),
            azimuth_rad: math::atan2(math::sin(azimuth_rad), math::cos(azimuth_rad)),
            decayed_years: stem.decayed_fraction * full_years,
            deathspan_years: full_years,
            year,
            cause: stem.cause,
        });
        self.next_id += 1;
    }

    /// Strews branches under a crown, those that are thick enough to be downed logs.
    pub fn lay_branches(
        &mut self,
        source: &Source,
        branches: &Branches,
        falling: &FallingBranches,
        year: u16,
        seed: u64,
    ) {
        if branches.diameter_m < LEAST_DIAMETER_M {
            return;
        }
        let full_years =
            decay::deathspan_years(source.species.decay.deathspan_years, branches.diameter_m);
        for _ in 0..falling.number {
            let key =
                Key { seed, process: Process::FallingBranch, year, month: 0, entity: self.next_id };
            let [around, away, turn, length] = rng::uniforms(key);
            let (around_rad, turn_rad) =
                (std::f32::consts::TAU * around, std::f32::consts::TAU * turn);
            let away_m = STREWN_FRACTION * branches.length_m * away.sqrt();
            self.downed_logs.push(DownedLog {
                id: self.next_id,
                parent_id: source.id,
                species: source.index,
                kind: DownedLogKind::Branch,
                east_m: source.at[0] + away_m * math::sin(around_rad),
                south_m: source.at[1] - away_m * math::cos(around_rad),
                length_m: branches.length_m * math::lerp(LEAST_BROKEN_FRACTION, 1.0, length),
                diameter_base_m: branches.diameter_m,
                diameter_tip_m: TIP_FRACTION * branches.diameter_m,
                azimuth_rad: math::atan2(math::sin(turn_rad), math::cos(turn_rad)),
                decayed_years: falling.decayed_fraction * full_years,
                deathspan_years: full_years,
                year,
                cause: falling.cause,
            });
            self.next_id += 1;
        }
    }

    /// A year of decay: snags drop branches, snap and fall, and what has rotted away is gone. `history` gets what happens
    /// to stems.
    ///
    /// # Reference
    /// Peytavie et al. 2024, section 5.2.
    pub fn decay(
        &mut self,
        around: &Surroundings,
        seed: u64,
        year: u16,
        history: &mut Vec<LifeEvent>,
    ) {
        let Surroundings { parameters, ground, species, trunks } = *around;
        for downed_log in &mut self.downed_logs {
            let viability = ground.viability([downed_log.east_m, downed_log.south_m]);
            downed_log.age(viability * parameters.downed_log_years_per_year);
        }
        let mut snags = std::mem::take(&mut self.snags);
        for snag in &mut snags {
            let at = [snag.east_m, snag.south_m];
            let species = &species[usize::from(snag.species)];
            let source = Source { id: snag.id, index: snag.species, species, at };
            let key = Key { seed, process: Process::SnagDecay, year, month: 0, entity: snag.id };
            let [snap, stump, lean, roots] = rng::uniforms(key);
            let years = ground.viability(at) * parameters.snag_years_per_year;
            let fallen = snag.age(years, species, [snap, stump, roots]);
            let decayed_fraction = snag.decayed_years / snag.deathspan_years;
            if fallen.branches > 0 {
                let branches = snag.branches(species);
                let (number, cause) = (fallen.branches, Cause::Decay);
                let falling = FallingBranches { number, cause, decayed_fraction };
                self.lay_branches(&source, &branches, &falling, year, seed);
            }
            let Some(above_m) = fallen.stem_above_m else { continue };
            let [slope_rad, downhill_rad] = ground.slope(at);
            let stem = FallingStem {
                kind: if fallen.leaves_stump { DownedLogKind::Trunk } else { DownedLogKind::Top },
                cause: Cause::Decay,
                length_m: snag.height_m - above_m,
                diameter_base_m: snag.diameter_at_m(above_m),
                diameter_tip_m: snag.diameter_at_m(snag.height_m),
                azimuth_rad: falling::lean_rad(slope_rad, downhill_rad, lean),
                decayed_fraction,
            };
            self.lay_stem(&source, &stem, trunks, year);
            let kind = match stem.kind {
                DownedLogKind::Trunk => LifeEventKind::SnagFell,
                _ => LifeEventKind::SnagSnapped,
            };
            history.push(LifeEvent {
                plant_id: snag.id,
                year,
                month: YEARS_END,
                kind,
                severity: stem.length_m / snag.height_at_death_m,
                cause: Cause::Decay,
            });
            snag.height_m = above_m;
        }
        snags.retain(|snag| !snag.is_gone());
        self.snags = snags;
        self.downed_logs.retain(|downed_log| !downed_log.is_gone());
    }
}

/// How far from the stem branches come to lie, as a share of their length. chosen: under the crown.
const STREWN_FRACTION: f32 = 0.7;
/// Least share of a branch that stays in one piece. chosen: half.
const LEAST_BROKEN_FRACTION: f32 = 0.5;
/// Diameter of a thin end over that of the thick one. chosen: what is thinner breaks off and is litter.
const TIP_FRACTION: f32 = 0.2;
/// Least length of a downed log. chosen: shorter pieces are blocks.
const LEAST_LENGTH_M: f32 = 1.0;
