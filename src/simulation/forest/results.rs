//! A forest as plants, snags and downed logs of a scene.

use rayon::prelude::*;

use super::run::Forest;
use super::tally::RECORDED_HEIGHT_M;
use crate::plants::deadwood::{Cause, Deadwood, DownedLogs, LifeEvent, LifeEventKind, Snags};
use crate::plants::{Layer, Plants};
use crate::raster::Grid;
use crate::raster::resample::{CellPosition, Samples};
use crate::simulation::deadwood::stock::YEARS_END;

/// Least height of canopy trees. Kapp et al. 2020, section 5.2: canopy begins at 3 m.
const LEAST_CANOPY_M: f32 = 3.0;
/// Least height of plants in tables, as of grown undergrowth.
const LEAST_PLANT_M: f32 = 0.1;
/// Least share of its crown that the sky sees of a canopy tree. chosen: half, as for trees that are fitted to a canopy.
const LEAST_SEEN_FRACTION: f32 = 0.5;

/// Places of a scene: from metres east and south to north and ground.
struct Place<'a> {
    elevation_m: &'a Grid<f32>,
    ground_m: Samples<'a>,
    cell_m: f64,
    width_m: f32,
    height_m: f32,
}

impl<'a> Place<'a> {
    fn new(elevation_m: &'a Grid<f32>) -> Self {
        let frame = elevation_m.frame();
        let valid = elevation_m.mask().as_slice();
        let side_m = |cells: usize| (cells as f64 * frame.transform.cell_m) as f32; // rounded as positions are
        Self {
            elevation_m,
            ground_m: Samples::new(frame.rows, frame.cols, elevation_m.values(), valid),
            cell_m: frame.transform.cell_m,
            width_m: side_m(frame.cols),
            height_m: side_m(frame.rows),
        }
    }

    fn east_m(&self, east_m: f32) -> f32 {
        east_m.clamp(0.0, self.width_m)
    }

    fn north_m(&self, south_m: f32) -> f32 {
        (self.height_m - south_m).clamp(0.0, self.height_m)
    }

    /// Elevation of the ground, or of the nearest cell of the scene.
    fn z_m(&self, east_m: f32, south_m: f32) -> f32 {
        let cells = |m: f32, most_m: f32| f64::from(m.clamp(0.0, most_m)) / self.cell_m;
        let (col, row) = (cells(east_m, self.width_m), cells(south_m, self.height_m));
        let frame = self.elevation_m.frame();
        let own =
            (row as usize).min(frame.rows - 1) * frame.cols + (col as usize).min(frame.cols - 1);
        let own_m = self.elevation_m.values()[own];
        self.ground_m.bilinear(CellPosition { row, col }).unwrap_or(own_m)
    }
}

impl Forest {
    /// Its plants that are a decimetre high; those that the sky sees are canopy. Seedlings below are in its state alone.
    pub fn plants(&self, elevation_m: &Grid<f32>) -> Plants {
        let (community, place) = (&self.community, Place::new(elevation_m));
        let seen = self.seen_fraction();
        let shown: Vec<usize> =
            (0..community.len()).filter(|p| community.height_m[*p] >= LEAST_PLANT_M).collect();
        let layer = |plant: usize| {
            let species = &self.biome.species[usize::from(community.species[plant])];
            let is_canopy = species.can_be_canopy()
                && community.height_m[plant] >= LEAST_CANOPY_M
                && seen[plant] >= LEAST_SEEN_FRACTION;
            if is_canopy { Layer::Canopy } else { Layer::Undergrowth }
        };
        let measure = |of: &(dyn Fn(usize) -> f32 + Sync)| -> Vec<f32> {
            shown.par_iter().map(|plant| of(*plant)).collect()
        };
        Plants {
            id: shown.iter().map(|plant| community.id[*plant]).collect(),
            species: shown.iter().map(|plant| community.species[*plant]).collect(),
            layer: shown.iter().map(|plant| layer(*plant)).collect(),
            east_m: measure(&|p| place.east_m(community.east_m[p])),
            north_m: measure(&|p| place.north_m(community.south_m[p])),
            z_m: measure(&|p| place.z_m(community.east_m[p], community.south_m[p])),
            height_m: measure(&|p| community.height_m[p]),
            crown_radius_m: measure(&|p| community.crown_radius_m[p]),
            dbh_m: measure(&|p| community.dbh_m[p]),
            age_years: measure(&|p| community.idealized_age_years[p]),
            vigor: measure(&|p| community.vigor[p]),
        }
    }

    /// Share of each plant's crown, on ground cells, over which no taller plant stands.
    fn seen_fraction(&self) -> Vec<f32> {
        let top_m = self.canopy_height_m();
        let community = &self.community;
        let seen = (0..community.len()).into_par_iter().map(|plant| {
            let (mut seen, mut cells) = (0.0, 0.0);
            let at = [community.east_m[plant], community.south_m[plant]];
            self.ground.under_disk(at, community.crown_radius_m[plant], |cell| {
                cells += 1.0;
                seen += f32::from(u8::from(community.height_m[plant] >= top_m[cell]));
            });
            seen / cells
        });
        seen.collect()
    }

    /// What happened to plants, each one's beginning included: those that left deadwood, and those that are or were as high as
    /// a breast.
    pub fn life_histories(&self) -> Vec<LifeEvent> {
        let community = &self.community;
        let tall = (0..community.len()).filter(|p| community.height_m[*p] >= RECORDED_HEIGHT_M);
        let mut ids: Vec<u64> = tall.map(|plant| community.id[plant]).collect();
        ids.extend(self.history.iter().map(|event| event.plant_id));
        ids.sort_unstable();
        ids.dedup();
        let beginnings = ids.into_iter().map(|plant_id| {
            let year = community.year_of_sprouting(plant_id);
            let kind = if year == 0 { LifeEventKind::Present } else { LifeEventKind::Sprouted };
            let month = if year == 0 { 1 } else { YEARS_END };
            LifeEvent { plant_id, year, month, kind, severity: 0.0, cause: Cause::Age }
        });
        let mut events: Vec<LifeEvent> = beginnings.collect();
        events.extend(&self.history);
        events
    }

    /// Its snags and downed logs.
    pub fn deadwood(&self, elevation_m: &Grid<f32>) -> Deadwood {
        let place = Place::new(elevation_m);
        let since = |year: u16| f32::from(self.year() - year);
        let mut snags = Snags::default();
        for snag in &self.stock.snags {
            snags.id.push(snag.id);
            snags.species.push(snag.species);
            snags.east_m.push(place.east_m(snag.east_m));
            snags.north_m.push(place.north_m(snag.south_m));
            snags.z_m.push(place.z_m(snag.east_m, snag.south_m));
            snags.height_m.push(snag.height_m);
            snags.height_at_death_m.push(snag.height_at_death_m);
            snags.dbh_m.push(snag.dbh_m);
            snags.years_dead.push(since(snag.year));
            snags.decay_class.push(snag.decay_class());
            snags.density_fraction.push(snag.density_fraction());
            snags.branch_fraction.push(snag.branch_fraction);
            snags.cause.push(snag.cause);
        }
        let mut downed_logs = DownedLogs::default();
        for downed_log in &self.stock.downed_logs {
            let [middle_east_m, middle_south_m] = downed_log.middle_m();
            downed_logs.id.push(downed_log.id);
            downed_logs.parent_id.push(downed_log.parent_id);
            downed_logs.species.push(downed_log.species);
            downed_logs.kind.push(downed_log.kind);
            // branches of trees at the rim may begin beyond it
            downed_logs.east_m.push(place.east_m(downed_log.east_m));
            downed_logs.north_m.push(place.north_m(downed_log.south_m));
            downed_logs.z_m.push(place.z_m(middle_east_m, middle_south_m));
            downed_logs.length_m.push(downed_log.length_m);
            downed_logs.diameter_base_m.push(downed_log.diameter_base_m);
            downed_logs.diameter_tip_m.push(downed_log.diameter_tip_m);
            downed_logs.azimuth_rad.push(downed_log.azimuth_rad);
            downed_logs.years_down.push(since(downed_log.year));
            downed_logs.decay_class.push(downed_log.decay_class());
            downed_logs.density_fraction.push(downed_log.density_fraction());
            downed_logs.cause.push(downed_log.cause);
        }
        Deadwood { snags, downed_logs }
    }
}
