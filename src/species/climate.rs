//! A biome's climate: monthly weather at the altitude where it was measured, and soil water facts.

use crate::raster::MONTHS;

/// Monthly weather of a landscape; January first.
#[derive(Clone, Debug, PartialEq)]
pub struct Climate {
    /// Latitude of the station, degrees north; used where the terrain's own is unknown.
    pub latitude_deg: f64,
    /// Altitude of the station, metres above sea level.
    pub station_altitude_m: f32,
    /// Mean temperature, °C, at the station.
    pub temperature_c: [f32; MONTHS],
    /// Share of daylight with the sun unclouded, 0–1.
    pub clear_sky_fraction: [f32; MONTHS],
    /// Rain, mm a month.
    pub rain_mm: [f32; MONTHS],
    /// Cooling with altitude, °C per metre.
    pub lapse_rate_c_per_m: f32,
    /// Soil water facts.
    pub soil: Soil,
}

/// How soil takes up and holds water.
#[derive(Clone, Debug, PartialEq)]
pub struct Soil {
    /// Share of rain that evaporates before it reaches the soil, 0–1.
    pub evaporated_rain_fraction: f32,
    /// Most water that infiltrates on gentle slopes, mm a month.
    pub infiltration_max_mm: f32,
    /// Slope up to which infiltration is at its most.
    pub infiltration_full_slope_rad: f32,
    /// Slope from which nothing infiltrates.
    pub infiltration_none_slope_rad: f32,
    /// Most water the soil holds, mm.
    pub soil_capacity_mm: f32,
}
