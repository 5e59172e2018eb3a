//! Abiotic maps: what the site offers before any plant competes for it.
//!
//! Reading order: [`solar`], [`horizon`], [`exposure`], [`sunlight`]; [`slope`]; [`temperature`]; [`moisture`] with its
//! `water_balance` (one cell's year), `drainage` (which way water runs, after `breaching` and `filling`), `routing` (from cell to cell) and
//! `riparian` (land along rivers).
//!
//! # Reference
//! Kapp et al. 2020, section 5.1, doi:10.1145/3414685.3417848.

mod breaching;
mod drainage;
pub mod exposure;
mod filling;
pub mod horizon;
pub mod moisture;
mod riparian;
mod rounding;
mod routing;
mod sky_view;
pub mod slope;
pub mod solar;
mod sun_path;
pub mod sunlight;
pub mod temperature;
mod water_balance;

use crate::progress::{Cancelled, Reporter};
use crate::raster::{Grid, MONTHS, MonthlyGrid};
use crate::species::Climate;
use crate::terrain::Terrain;

pub use moisture::{MoistureParams, WaterBalance};
pub use sunlight::SunlightParams;
pub use temperature::MonthlyTemperature;

/// How abiotic maps are made.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct Params {
    /// Sunlight.
    pub sunlight: SunlightParams,
    /// Moisture.
    pub moisture: MoistureParams,
}

/// What the site offers, cell by cell.
#[derive(Clone, Debug)]
pub struct AbioticMaps {
    /// Light a day, in hours of clear sun, by month.
    pub sunlight_h: MonthlyGrid,
    /// Plant-available soil water, mm, by month.
    pub moisture_mm: MonthlyGrid,
    /// Mean temperature, °C, by month.
    pub temperature_c: MonthlyTemperature,
    /// Steepest slope, radians.
    pub slope_rad: Grid<f32>,
    /// Runoff and drainage through each cell, mean over the year, m³/s.
    pub discharge_m3_s: Grid<f32>,
    /// Where a river runs.
    pub river: Grid<bool>,
    /// Where each month's rain went.
    pub balance: [WaterBalance; MONTHS],
}

/// The abiotic maps of a terrain in a climate.
///
/// ```
/// use wildwood::abiotics::{self, Params};
/// use wildwood::raster::Grid;
/// use wildwood::{progress::Reporter, species::Biome, terrain::Terrain};
///
/// // a valley from north to south, its sides as steep as one in two
/// let elevation_m = Grid::from_fn(20, 41, 2.0, |cell| 300.0 + cell.col.abs_diff(20) as f32);
/// let latitude_rad = 38.5_f64.to_radians();
/// let terrain = Terrain { elevation_m, latitude_rad, grid_convergence_rad: 0.0 };
/// let climate = Biome::builtin("sonoma")?.climate;
/// let maps = abiotics::run(&terrain, &climate, &Params::default(), &Reporter::silent())?;
///
/// let january_mm = maps.moisture_mm.month(0);
/// let (floor, side) = (10 * 41 + 20, 10 * 41 + 5);
/// assert!(january_mm[floor] > january_mm[side]);
/// assert!((maps.slope_rad.values()[side] - 0.5_f32.atan()).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
pub fn run(
    terrain: &Terrain,
    climate: &Climate,
    params: &Params,
    reporter: &Reporter,
) -> Result<AbioticMaps, Cancelled> {
    let slope_rad = {
        let _stage = reporter.stage("slope", 1);
        slope::slope_rad(&terrain.elevation_m)
    };
    let sunlight = sunlight::run(terrain, climate, &params.sunlight, reporter)?;
    let sunlight_h = rounding::rounded(sunlight.sunlight_h);
    let water = water(terrain, &slope_rad, &sunlight_h, climate, params, reporter)?;
    Ok(AbioticMaps {
        sunlight_h,
        moisture_mm: rounding::rounded(water.moisture_mm),
        temperature_c: MonthlyTemperature::new(&terrain.elevation_m, climate),
        slope_rad,
        discharge_m3_s: water.discharge_m3_s,
        river: water.river,
        balance: water.balance,
    })
}

/// Soil water, mm, by month, that other rain brings to ground whose maps are known.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
pub fn moisture_of(
    terrain: &Terrain,
    maps: &AbioticMaps,
    climate: &Climate,
    params: &Params,
    reporter: &Reporter,
) -> Result<MonthlyGrid, Cancelled> {
    let water = water(terrain, &maps.slope_rad, &maps.sunlight_h, climate, params, reporter)?;
    Ok(rounding::rounded(water.moisture_mm))
}

fn water(
    terrain: &Terrain,
    slope_rad: &Grid<f32>,
    sunlight_h: &MonthlyGrid,
    climate: &Climate,
    params: &Params,
    reporter: &Reporter,
) -> Result<moisture::Water, Cancelled> {
    let open_sky_sunlight_h = std::array::from_fn(|month_index| {
        // hours a day: far within f32
        sunlight::open_sky_sunlight_h(terrain.latitude_rad, climate, &params.sunlight, month_index)
            as f32
    });
    moisture::run(
        terrain,
        slope_rad,
        sunlight_h,
        open_sky_sunlight_h,
        climate,
        &params.moisture,
        reporter,
    )
}
