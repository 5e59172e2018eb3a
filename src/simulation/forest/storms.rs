//! A wind storm in a forest: which trees, live and dead, it throws, snaps or strips.

use super::deaths::Struck;
use super::run::Forest;
use super::tally::YearTally;
use crate::plants::deadwood::{Cause, DownedLogKind, LifeEvent, LifeEventKind};
use crate::rng::{self, Key, Process};
use crate::simulation::carbon_pool;
use crate::simulation::community::{DeadPlant, Season};
use crate::simulation::deadwood::branches::Branches;
use crate::simulation::deadwood::stock::{FallingBranches, FallingStem, Source};
use crate::simulation::disturbance::storm::{
    self, CriticalSpeeds, StemWood, StormDamage, StormSurface, WindStorm,
};
use crate::species::{Leaf, Species};

/// Form factors: volume of a stem over that of a cylinder of its height and breast height diameter. chosen: mid values of
/// yield tables, which have 0.4–0.5 for conifers and for broadleaved trees.
const FORM_FACTOR: [f32; 2] = [0.45, 0.48];
/// Mass of green wood over that of dry wood. Peytavie et al. 2024, section 5.3.2.
const GREEN_FACTOR: f32 = 1.85;
/// How far a tree's critical speeds lie from its species', as a share. chosen: roots and wood differ from tree to tree, so that
/// some stems break before their roots give way.
const STRENGTH_SPREAD: f32 = 0.25;
/// Sector around the wind in which trees fall, radians. chosen: gusts veer.
const GUST_SECTOR_RAD: f32 = 0.35;

impl Forest {
    /// A storm in a month; gives the trees that it took.
    ///
    /// # Reference
    /// Peytavie et al. 2024, section 5.3.2, Eqs. 14–16.
    /// # Departures
    /// Within a canopy wind falls off with depth, so that saplings do not fall with the trees above them. Critical speeds differ
    /// from tree to tree: by Eqs. 14–15 that of uprooting is one for all trees of a species, and nothing ever snaps.
    pub(super) fn blow(
        &mut self,
        wind: &WindStorm,
        month: u8,
        season: &mut Season,
        figures: &mut YearTally,
    ) -> Vec<DeadPlant> {
        let canopy_height_m = self.canopy_height_m();
        let surface = StormSurface {
            rows: self.ground.rows,
            cols: self.ground.cols,
            cell_m: self.ground.cell_m,
            elevation_m: &self.ground.elevation_m,
            canopy_height_m: &canopy_height_m,
        };
        let exposure = storm::exposure_fraction(&surface, wind);
        let speed_m_s = wind.speed_m_s();
        let downwind_rad = wind.fall_azimuth_rad();
        let (seed, year) = (self.seed, self.community.year());
        let blown = |cell: usize, height_m: f32| {
            let below = storm::below_canopy_fraction(height_m, canopy_height_m[cell]);
            speed_m_s * exposure[cell] * below
        };
        let draws = |entity: u64| {
            rng::uniforms(Key { seed, process: Process::StormDamage, year, month, entity })
        };
        // a tree's own roots and wood, the same in every storm
        let varied = |speeds: CriticalSpeeds, entity: u64| {
            let process = Process::StemStrength;
            let [roots, wood, ..] = rng::uniforms(Key { seed, process, year: 0, month: 0, entity });
            let vary = |draw: f32| 1.0 + STRENGTH_SPREAD * (2.0 * draw - 1.0);
            CriticalSpeeds {
                uproot_m_s: speeds.uproot_m_s * vary(roots),
                snap_m_s: speeds.snap_m_s * vary(wood),
            }
        };

        // trees
        let mut broken = Vec::new();
        let mut struck = vec![Struck::No; self.community.len()];
        for (plant, struck) in struck.iter_mut().enumerate() {
            let community = &self.community;
            let height_m = community.height_m[plant];
            if height_m < storm::LEAST_HEIGHT_M {
                continue;
            }
            let species = self.traits(community.species[plant]).species();
            let speeds = critical_speeds(species, community.dbh_m[plant], height_m, 1.0, true);
            let speeds = varied(speeds, community.id[plant]);
            let at = [community.east_m[plant], community.south_m[plant]];
            let wind_m_s = blown(self.ground.cell_at(at), height_m);
            let draws = draws(community.id[plant]);
            let azimuth_rad = downwind_rad + GUST_SECTOR_RAD * (2.0 * draws[3] - 1.0);
            let (kind, severity) = match storm::damage(&speeds, wind_m_s, draws) {
                StormDamage::None => continue,
                StormDamage::Branches { fraction } => {
                    broken.push((plant, fraction));
                    (LifeEventKind::BranchesBroken, fraction)
                }
                StormDamage::Snapped { height_fraction } => {
                    let standing_fraction = height_fraction;
                    *struck = Struck::Snapped { standing_fraction, azimuth_rad };
                    (LifeEventKind::Snapped, 1.0 - height_fraction)
                }
                StormDamage::Uprooted => {
                    *struck = Struck::Uprooted { azimuth_rad };
                    (LifeEventKind::Uprooted, 1.0)
                }
            };
            let plant_id = community.id[plant];
            self.history.push(LifeEvent {
                plant_id,
                year,
                month,
                kind,
                severity,
                cause: Cause::Storm,
            });
        }
        for (plant, fraction) in broken {
            self.break_branches(plant, fraction, season);
        }
        let is_struck: Vec<bool> = struck.iter().map(|struck| *struck != Struck::No).collect();
        let felled = self.community.fell(&is_struck);
        self.lay_down(&felled, &struck, month, figures);

        // snags
        let trunks = self.standing_trunks();
        let mut snags = std::mem::take(&mut self.stock.snags);
        let mut is_down = vec![false; snags.len()];
        for (snag, is_down) in snags.iter_mut().zip(&mut is_down) {
            // those of this year are what this storm, or one before it, left standing
            if snag.height_m < storm::LEAST_HEIGHT_M || snag.year == year {
                continue;
            }
            let at = [snag.east_m, snag.south_m];
            let species = &self.biome.species[usize::from(snag.species)];
            let strength = snag.density_fraction();
            let speeds = critical_speeds(species, snag.dbh_m, snag.height_m, strength, false);
            let speeds = varied(speeds, snag.id);
            let draws = draws(snag.id);
            let wind_m_s = blown(self.ground.cell_at(at), snag.height_m);
            let damage = storm::damage(&speeds, wind_m_s, draws);
            let above_m = match damage {
                StormDamage::None | StormDamage::Branches { .. } => continue,
                StormDamage::Snapped { height_fraction } => height_fraction * snag.height_m,
                StormDamage::Uprooted => 0.0,
            };
            let source = Source { id: snag.id, index: snag.species, species, at };
            let stem = FallingStem {
                kind: if above_m > 0.0 { DownedLogKind::Top } else { DownedLogKind::Uprooted },
                cause: Cause::Storm,
                length_m: snag.height_m - above_m,
                diameter_base_m: snag.diameter_at_m(above_m),
                diameter_tip_m: snag.diameter_at_m(snag.height_m),
                azimuth_rad: downwind_rad + GUST_SECTOR_RAD * (2.0 * draws[3] - 1.0),
                decayed_fraction: snag.decayed_years / snag.deathspan_years,
            };
            self.stock.lay_stem(&source, &stem, &trunks, year);
            let kind =
                if above_m > 0.0 { LifeEventKind::SnagSnapped } else { LifeEventKind::SnagFell };
            let severity = stem.length_m / snag.height_at_death_m;
            self.history.push(LifeEvent {
                plant_id: snag.id,
                year,
                month,
                kind,
                severity,
                cause: Cause::Storm,
            });
            (snag.height_m, *is_down) = (above_m, above_m == 0.0);
        }
        let standing = snags.into_iter().zip(is_down).filter(|(_, is_down)| !is_down);
        self.stock.snags = standing.map(|(snag, _)| snag).collect();
        felled
    }

    /// With all its branches a tree loses a full pool and more: it is certain to die.
    fn break_branches(&mut self, plant: usize, fraction: f32, season: &mut Season) {
        let (seed, year) = (self.seed, self.community.year());
        let community = &mut self.community;
        let loss = (community.pool_capacity(plant) - carbon_pool::LOWEST) * fraction;
        let pool = &mut community.carbon_pool[plant];
        *pool = (*pool - loss).max(carbon_pool::LOWEST);
        season.lowest_pool[plant] = season.lowest_pool[plant].min(*pool);
        let index = community.species[plant];
        let species = &self.biome.species[usize::from(index)];
        let branches =
            Branches::of(species, community.dbh_m[plant], community.crown_radius_m[plant]);
        let at = [community.east_m[plant], community.south_m[plant]];
        let source = Source { id: community.id[plant], index, species, at };
        let falling = FallingBranches {
            number: (branches.count * fraction) as u32, // some dozens
            cause: Cause::Storm,
            decayed_fraction: 0.0,
        };
        self.stock.lay_branches(&source, &branches, &falling, year, seed);
    }

    /// Height of the tallest plant or snag over each ground cell, 0 where there is none.
    pub(super) fn canopy_height_m(&self) -> Vec<f32> {
        let community = &self.community;
        let mut height_m = vec![0.0_f32; self.ground.rows * self.ground.cols];
        let mut raise = |at: [f32; 2], radius_m: f32, top_m: f32| {
            self.ground.under_disk(at, radius_m, |cell| height_m[cell] = height_m[cell].max(top_m));
        };
        for plant in 0..community.len() {
            let at = [community.east_m[plant], community.south_m[plant]];
            raise(at, community.crown_radius_m[plant], community.height_m[plant]);
        }
        self.stock
            .snags
            .iter()
            .for_each(|snag| raise([snag.east_m, snag.south_m], 0.0, snag.height_m));
        height_m
    }
}

/// Wind that throws and that snaps a stem, m/s; dead wood is as strong as it is dense.
fn critical_speeds(
    species: &Species,
    dbh_m: f32,
    height_m: f32,
    strength: f32,
    is_live: bool,
) -> CriticalSpeeds {
    let wood = &species.wood;
    let stem = StemWood {
        pulling_coefficient_nm_kg: strength * wood.pulling_coefficient_nm_kg,
        modulus_of_rupture_pa: strength * wood.modulus_of_rupture_pa,
        density_kg_m3: wood.density_kg_m3,
        form_factor: FORM_FACTOR[usize::from(species.leaf != Leaf::Needle)],
    };
    storm::critical_speeds(&stem, dbh_m, height_m, if is_live { GREEN_FACTOR } else { 1.0 })
}
