//! A wildfire in a forest: what there is to burn, and what fire does to plants and deadwood.
//!
//! # Reference
//! Peytavie et al. 2024, section 5.3.1, Eqs. 12–13.

use super::deaths::Toll;
use super::run::Forest;
use super::tally::RECORDED_HEIGHT_M;
use crate::plants::deadwood::{Cause, LifeEvent, LifeEventKind};
use crate::simulation::carbon_pool;
use crate::simulation::community::Season;
use crate::simulation::disturbance::fire::{self, FuelCell, FuelMap, Wildfire};
use crate::species::{Form, Leaf};

/// Water of live fuel over its dry mass, percent, with an empty pool and with a full one. chosen: between dry grass and
/// half of what foliage holds, as litter burns with it.
const LIVE_MOISTURE_PERCENT: [f32; 2] = [3.5, 19.0];
/// The same of sound deadwood on ground as dry as it gets, and on ground as wet as usual. chosen: with both, fires of the authors'
/// script on Gresolet burn more than twice as much after its drought as without.
const DEAD_MOISTURE_PERCENT: [f32; 2] = [2.5, 15.0];
/// What rotten wood holds more than sound wood, percent. chosen: it soaks up as much again.
const ROTTEN_MOISTURE_PERCENT: f32 = 15.0;
/// Volume of dead wood on a m² that burns as well as a closed crown does, m. chosen: 200 m³/ha, an old-growth forest's.
const FULL_DEADWOOD_M: f32 = 0.02;
/// How much likelier needles burn, and broad leaves (P_veg): Alexandridis et al. 2008 have 0.4 for pines and −0.3 for
/// farmland; chosen: needle trees below pines, and broadleaved forest between.
const VEGETATION: [f32; 2] = [0.3, -0.2];
/// Volume of a snag over its diameter squared times its height. chosen: π/4 of a cylinder's, and the form factor 0.45.
const SNAG_FORM: f32 = 0.35;
/// Stem that loses half of what kills a thin one, a full pool and the certainty of death, m. chosen: bark grows with the stem.
const THICK_DBH_M: f32 = 0.5;
/// Share of what is left of its deathspan that wholly burnt deadwood loses. chosen: half burns away.
const CONSUMED_FRACTION: f32 = 0.5;

/// Fuel of a ground cell while it is gathered.
#[derive(Clone, Copy, Default)]
struct Load {
    top_m: f32,
    live: f32,
    dead: f32,
    /// Sums of vegetation and moisture, weighted by load.
    vegetation: f32,
    live_moisture: f32,
    dead_moisture: f32,
}

impl Forest {
    /// A fire in a month.
    pub(super) fn burn(
        &mut self,
        fire: &Wildfire,
        month: u8,
        season: &mut Season,
        toll: &mut Toll,
    ) {
        let cells = self.fuel(month);
        let (first_east, first_south) = self.first_ground_cell();
        let ground = &self.ground;
        let map = FuelMap {
            rows: ground.rows,
            cols: ground.cols,
            cell_m: ground.cell_m,
            first_east,
            first_south,
            elevation_m: &ground.elevation_m,
            cells: &cells,
        };
        let year = self.community.year();
        let burnt = fire::burn(&map, fire, self.seed, year, month);
        self.burnt_m2.push((
            year,
            burnt.iter().filter(|burnt| **burnt).count() as f32 * ground.cell_m * ground.cell_m,
        ));
        let (rows, cols, cell_m) = (ground.rows, ground.cols, ground.cell_m);
        let damage = |east_m: f32, south_m: f32| {
            fire::damage_fraction(&burnt, rows, cols, cell_m, east_m, south_m)
        };
        let community = &mut self.community;
        for plant in 0..community.len() {
            let severity = damage(community.east_m[plant], community.south_m[plant]);
            if severity <= 0.0 {
                continue;
            }
            let bark = 1.0 - 0.5 * (community.dbh_m[plant] / THICK_DBH_M).min(1.0);
            let loss = (community.pool_capacity(plant) - carbon_pool::LOWEST) * bark * severity;
            let pool = &mut community.carbon_pool[plant];
            *pool = (*pool - loss).max(carbon_pool::LOWEST);
            season.lowest_pool[plant] = season.lowest_pool[plant].min(*pool);
            toll.is_burnt[plant] = true;
            if community.height_m[plant] >= RECORDED_HEIGHT_M {
                self.history.push(LifeEvent {
                    plant_id: community.id[plant],
                    year,
                    month,
                    kind: LifeEventKind::Burnt,
                    severity,
                    cause: Cause::Fire,
                });
            }
        }
        for snag in &mut self.stock.snags {
            let left_years = snag.deathspan_years - snag.decayed_years;
            let severity = damage(snag.east_m, snag.south_m);
            snag.decayed_years += CONSUMED_FRACTION * severity * left_years;
        }
        for downed_log in &mut self.stock.downed_logs {
            let left_years = downed_log.deathspan_years - downed_log.decayed_years;
            let severity = damage(downed_log.east_m, downed_log.south_m);
            downed_log.decayed_years += CONSUMED_FRACTION * severity * left_years;
        }
    }

    /// Absolute numbers of the first ground cell, counted in ground cells.
    fn first_ground_cell(&self) -> (i64, i64) {
        let plot = self.community.plot();
        let cells =
            (f64::from(self.ground.cell_m) / f64::from(plot.cell_m)).round().max(1.0) as i64;
        (plot.first_east.div_euclid(cells), plot.first_south.div_euclid(cells))
    }

    /// Fuel of each ground cell in a month.
    ///
    /// # Reference
    /// Peytavie et al. 2024, section 5.3.1: density from the volume of plants, snags and downed logs, moderated by their
    /// decay; moisture of the living from their reserves, of the dead from decay; height of the tallest.
    /// # Departures
    /// Dead fuel also follows the month's soil water, so that a dry season tells at once.
    pub(super) fn fuel(&self, month: u8) -> Vec<FuelCell> {
        let ground = &self.ground;
        let plot = self.community.plot();
        let month_index = usize::from(month) - 1;
        let mut loads = vec![Load::default(); ground.rows * ground.cols];
        let community = &self.community;
        let cell_m2 = ground.cell_m * ground.cell_m;
        for plant in 0..community.len() {
            let species = self.traits(community.species[plant]).species();
            let at = [community.east_m[plant], community.south_m[plant]];
            let radius_m = community.crown_radius_m[plant];
            let [dry, fresh] = LIVE_MOISTURE_PERCENT;
            let filled = community.carbon_pool[plant] / community.pool_capacity(plant);
            let moisture = dry + (fresh - dry) * filled.clamp(0.0, 1.0);
            let vegetation = match (species.form, species.leaf) {
                (Form::Herb, _) => 0.0,
                (_, Leaf::Needle) => VEGETATION[0],
                _ => VEGETATION[1],
            };
            // crowns narrower than a cell count by their area
            let area_m2 = std::f32::consts::PI * radius_m * radius_m;
            let cover = species.absorbed_light_fraction * (area_m2 / cell_m2).min(1.0);
            let height_m = community.height_m[plant];
            ground.under_disk(at, radius_m, |cell| {
                let load = &mut loads[cell];
                load.top_m = load.top_m.max(height_m);
                load.live += cover;
                load.vegetation += cover * vegetation;
                load.live_moisture += cover * moisture;
            });
        }
        let mut add_dead = |cell: usize, volume_m3: f32, density: f32, vegetation: f32| {
            let [dry, usual] = DEAD_MOISTURE_PERCENT;
            let wetness = ground.wetness_fraction(plot, cell, month_index);
            let moisture =
                dry + (usual - dry) * wetness + ROTTEN_MOISTURE_PERCENT * (1.0 - density) * wetness;
            let amount = volume_m3 * density / cell_m2 / FULL_DEADWOOD_M;
            let load = &mut loads[cell];
            load.dead += amount;
            load.vegetation += amount * vegetation;
            load.dead_moisture += amount * moisture;
        };
        let vegetation_of = |species: u16| match self.traits(species).species().leaf {
            Leaf::Needle => VEGETATION[0],
            _ => VEGETATION[1],
        };
        for snag in &self.stock.snags {
            let volume_m3 = SNAG_FORM * snag.dbh_m * snag.dbh_m * snag.height_m;
            let cell = ground.cell_at([snag.east_m, snag.south_m]);
            add_dead(cell, volume_m3, snag.density_fraction(), vegetation_of(snag.species));
        }
        let mut cells = Vec::new();
        for downed_log in &self.stock.downed_logs {
            cells.clear();
            downed_log.cells([ground.rows, ground.cols], ground.cell_m, |row, col| {
                cells.push(row * ground.cols + col);
            });
            let part_m3 = downed_log.volume_m3() / cells.len().max(1) as f32;
            let (density, vegetation) =
                (downed_log.density_fraction(), vegetation_of(downed_log.species));
            cells.iter().for_each(|cell| add_dead(*cell, part_m3, density, vegetation));
        }
        loads
            .into_iter()
            .map(|load| {
                let total = load.live + load.dead;
                let mean = |sum: f32| if total > 0.0 { sum / total } else { 0.0 };
                FuelCell {
                    height_m: load.top_m,
                    density_fraction: total.min(1.0),
                    vegetation: mean(load.vegetation),
                    moisture_percent: mean(load.live_moisture + load.dead_moisture),
                }
            })
            .collect()
    }
}
