//! What a site offers a tree over the whole year: the means that vigor is worked out from.

use crate::abiotics::AbioticMaps;
use crate::raster::Grid;

/// Yearly means of what a site offers, cell by cell, on one frame and mask.
///
/// # Reference
/// Kapp et al. 2020, section 5.1: temperature, moisture and sunlight are averaged over the year.
#[derive(Clone, Debug)]
pub struct Site {
    /// Light a day, hours.
    pub sun_h: Grid<f32>,
    /// Plant-available soil water, mm.
    pub moisture_mm: Grid<f32>,
    /// Temperature, °C.
    pub temperature_c: Grid<f32>,
    /// Slope, radians.
    pub slope_rad: Grid<f32>,
}

impl Site {
    /// The yearly means of abiotic maps.
    pub fn of(maps: &AbioticMaps) -> Self {
        Self {
            sun_h: maps.sunlight_h.yearly_mean(),
            moisture_mm: maps.moisture_mm.yearly_mean(),
            temperature_c: maps.temperature_c.yearly_mean(),
            slope_rad: maps.slope_rad.clone(),
        }
    }
}
