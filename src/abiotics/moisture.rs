//! Soil moisture of every month from a model that conserves water.
//!
//! Rain less evaporation, and water from upslope, enter a bounded soil store as slope and season
//! allow ([`water_balance`](super::water_balance)); runoff and drainage run down a depression-free
//! surface ([`routing`](super::routing), [`drainage`](super::drainage)); channels with enough
//! discharge are rivers, and land little above them drinks from them ([`riparian`](super::riparian)).
//! Over the whole map and in every month
//!
//! ```text
//! rain = evaporation + transpiration + change of storage + outflow
//! ```
//!
//! Everything follows from rain, so a drought that scales rain changes all of it.
//!
//! # Calibration
//! Infiltration, store and evaporated share are the values Kapp et al. 2020 ran. The three rates
//! [`MoistureParams`] calls calibrated were chosen once, for both species sets together, so that yearly
//! mean moisture lies where the species tables put their plants: 50–100 mm on Californian oak savanna
//! (Kapp 2020, Table 3), 20–40 mm on the steep Gresolet slopes (Peytavie 2024, Table 5). They are
//! plausible as soil physics, but nothing was measured on these sites.
//! # Departures
//! Kapp 2020 draws rivers from catchment area and drops its runoff; here rivers follow discharge.
//! Rivers keep the soil's capacity as moisture; [`Water::river`] tells where water stands.
//! Catchments end at the map's edge: water from beyond it is unknown and missing.

use rayon::prelude::*;

use crate::progress::{Cancelled, Reporter};
use crate::raster::{Grid, MONTHS, MonthlyGrid};
use crate::species::Climate;
use crate::terrain::Terrain;

use super::drainage::DrainageSurface;
use super::riparian::{NearestDrainage, take_up};
use super::routing::{Routed, route};
use super::water_balance::{CellSite, DAYS, WaterYear};

/// What the moisture model can be told.
#[derive(Clone, Debug, PartialEq)]
pub struct MoistureParams {
    /// Rate at which any soil drains below its roots, per month.
    /// Calibrated (see the module).
    pub percolation_per_month: f32,
    /// Rate at which soil drains along a slope, per month and sine of the slope.
    /// Calibrated (see the module).
    pub hillslope_drainage_per_month: f32,
    /// Length of slope, m, over which 63 % of the water running or seeping down it would enter the
    /// soil, had it room. Makes hollows wet at any cell size. Calibrated (see the module).
    pub run_on_infiltration_m: f32,
    /// Land that must drain to a place for a channel to begin there, m²; never under
    /// [`CHANNEL_MIN_CELLS`] cells. chosen: 1 ha, the middle of the 0.1–10 ha of Montgomery & Dietrich 1988.
    pub channel_area_m2: f32,
    /// Mean discharge from which a channel is a river, m³/s. chosen: 1 l/s, which 6 ha with 500 mm of
    /// yearly runoff give: the small end of streams that flow most of the year.
    pub river_discharge_m3_s: f32,
    /// Height above a river up to which its water table wets the root zone, m. chosen: about the depth
    /// of tree roots and capillary rise together.
    pub riparian_reach_m: f32,
}

impl Default for MoistureParams {
    fn default() -> Self {
        Self {
            percolation_per_month: 0.4,
            hillslope_drainage_per_month: 2.4,
            run_on_infiltration_m: 150.0,
            channel_area_m2: 10_000.0,
            river_discharge_m3_s: 0.001,
            riparian_reach_m: 2.0,
        }
    }
}

/// Fewest cells a channel drains, whatever their size. chosen: on coarse grids a handful of cells is no
/// valley, and single flow would draw stripes.
pub const CHANNEL_MIN_CELLS: f32 = 64.0;

/// Water on a terrain through the year.
#[derive(Clone, Debug)]
pub struct Water {
    /// Plant-available water in the soil, mean over each month, mm.
    pub moisture_mm: MonthlyGrid,
    /// Runoff and drainage through each cell, mean over the year, m³/s.
    pub discharge_m3_s: Grid<f32>,
    /// Height above the river cell (or else the map's edge) the cell's water first reaches, m, ≥ 0.
    pub height_above_drainage_m: Grid<f32>,
    /// Where a river runs.
    pub river: Grid<bool>,
    /// The books, January first.
    pub balance: [WaterBalance; MONTHS],
}

/// Where a month's rain went; means over the valid cells, mm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WaterBalance {
    /// Rain.
    pub rain_mm: f64,
    /// Evaporated before it reached the soil.
    pub evaporation_mm: f64,
    /// Drawn by vegetation, from soil and rivers.
    pub transpiration_mm: f64,
    /// Gained by the soil.
    pub storage_change_mm: f64,
    /// Left the map.
    pub outflow_mm: f64,
}

impl WaterBalance {
    /// Rain that is not accounted for, mm.
    pub fn error_mm(&self) -> f64 {
        self.rain_mm
            - self.evaporation_mm
            - self.transpiration_mm
            - self.storage_change_mm
            - self.outflow_mm
    }
}

/// Moisture and rivers of a terrain in a climate. `open_sky_sunlight_h` is what `sunlight_h` would be on
/// open flat ground.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
///
/// # Panics
/// If the grids differ in size.
pub fn run(
    terrain: &Terrain,
    slope_rad: &Grid<f32>,
    sunlight_h: &MonthlyGrid,
    open_sky_sunlight_h: [f32; MONTHS],
    climate: &Climate,
    params: &MoistureParams,
    reporter: &Reporter,
) -> Result<Water, Cancelled> {
    let elevation_m = &terrain.elevation_m;
    let frame = elevation_m.frame();
    assert_eq!(slope_rad.frame().len(), frame.len(), "slope is not on the terrain's grid");
    assert_eq!(sunlight_h.frame().len(), frame.len(), "sunlight is not on the terrain's grid");
    let valid_cells = elevation_m.mask().valid_count();
    let stage = reporter.stage("moisture", valid_cells as u64);
    let cell_m = frame.cell_m();
    let cell_m2 = cell_m * cell_m;
    let surface = DrainageSurface::new(elevation_m, reporter)?;

    // Every cell's year, from the ridges down
    let water_year =
        WaterYear::new(climate, terrain.latitude_rad, open_sky_sunlight_h, cell_m, params);
    let demand_mm = |month: usize, index: usize| {
        let (elevation, sun) = (elevation_m.values()[index], sunlight_h.month(month)[index]);
        water_year.demand_mm(month, elevation, sun)
    };
    let channel_area_cells = (params.channel_area_m2 / cell_m2).max(CHANNEL_MIN_CELLS);
    let Routed { mut moisture_mm, mut yearly_outflow_mm, mut channels, sums } =
        route(&surface, channel_area_cells, reporter, &stage, |index, run_on_mm| {
            let site = CellSite {
                slope_rad: slope_rad.values()[index],
                demand_mm: std::array::from_fn(|month| demand_mm(month, index)),
            };
            water_year.run(&site, run_on_mm)
        })?;

    // Rivers and the land along them
    let discharge_per_yearly_mm = cell_m2 / 1000.0 / (DAYS.iter().sum::<f32>() * 86_400.0);
    let is_river: Vec<bool> = channels
        .iter()
        .map(|channel| {
            let mm = yearly_outflow_mm[channel.cell as usize];
            mm * discharge_per_yearly_mm >= params.river_discharge_m3_s
        })
        .collect();
    let drainage = NearestDrainage::new(&surface, &channels, &is_river, reporter)?;
    let heights_m = drainage.heights_m(&surface, &channels);
    let uptake = take_up(
        &drainage,
        &heights_m,
        &mut channels,
        &mut moisture_mm,
        climate.soil.soil_capacity_mm,
        params.riparian_reach_m,
        demand_mm,
    );

    // Maps
    let mut river = vec![false; frame.len()];
    for (channel, is_river) in channels.iter().zip(is_river) {
        river[channel.cell as usize] = is_river;
        yearly_outflow_mm[channel.cell as usize] = channel.outflow_mm.iter().sum::<f64>() as f32;
    }
    yearly_outflow_mm.par_iter_mut().for_each(|mm| *mm *= discharge_per_yearly_mm);

    let evaporated = f64::from(climate.soil.evaporated_rain_fraction);
    let cells = valid_cells.max(1) as f64;
    let balance = std::array::from_fn(|m| WaterBalance {
        rain_mm: f64::from(climate.rain_mm[m]),
        evaporation_mm: f64::from(climate.rain_mm[m]) * evaporated,
        transpiration_mm: (sums.transpiration_mm[m] + uptake.taken_mm[m]) / cells,
        storage_change_mm: sums.storage_change_mm[m] / cells,
        outflow_mm: (sums.outflow_mm[m] - uptake.taken_mm[m]) / cells,
    });
    Ok(Water {
        moisture_mm: MonthlyGrid::new(frame.clone(), elevation_m.mask().clone(), moisture_mm),
        discharge_m3_s: elevation_m.with_values(yearly_outflow_mm),
        height_above_drainage_m: elevation_m.with_values(heights_m),
        river: elevation_m.with_values(river),
        balance,
    })
}
