//! Temperature by altitude.
//!
//! # Reference
//! Kapp et al. 2020, section 5.1, doi:10.1145/3414685.3417848: temperature falls with altitude at the standard lapse rate.

use super::rounding::rounded_value;
use crate::raster::{Grid, MONTHS};
use crate::species::Climate;

/// Mean temperature of a month at an altitude, in °C.
#[inline]
pub fn temperature_c(climate: &Climate, month_index: usize, elevation_m: f32) -> f32 {
    climate.temperature_c[month_index]
        - climate.lapse_rate_c_per_m * (elevation_m - climate.station_altitude_m)
}

/// Monthly temperature over a terrain, worked out where it is asked for:
/// it is linear in elevation, so twelve stored bands would say the same thing twelve times.
#[derive(Clone, Debug)]
pub struct MonthlyTemperature {
    elevation_m: Grid<f32>,
    climate: Climate,
}

impl MonthlyTemperature {
    /// Temperature over a terrain in a climate.
    pub fn new(elevation_m: &Grid<f32>, climate: &Climate) -> Self {
        Self { elevation_m: elevation_m.clone(), climate: climate.clone() }
    }

    #[inline]
    fn at_elevation(&self, month_index: usize, elevation_m: f32) -> f32 {
        rounded_value(temperature_c(&self.climate, month_index, elevation_m))
    }

    /// °C in a month (0 is January) at the cell stored at `index`.
    #[inline]
    pub fn at(&self, month_index: usize, index: usize) -> f32 {
        self.at_elevation(month_index, self.elevation_m.values()[index])
    }

    /// The elevation temperature is worked out from.
    pub fn elevation_m(&self) -> &Grid<f32> {
        &self.elevation_m
    }

    /// Mean over the year, °C.
    pub fn yearly_mean(&self) -> Grid<f32> {
        let yearly = |z: f32| {
            let sum: f32 = (0..MONTHS).map(|m| self.at_elevation(m, z)).sum();
            sum / MONTHS as f32
        };
        let values = self.elevation_m.values();
        self.elevation_m.with_values(values.iter().map(|&z| yearly(z)).collect())
    }

    /// All values of a month, in °C.
    pub fn month(&self, month_index: usize) -> Grid<f32> {
        assert!(month_index < MONTHS, "month index {month_index} is past December");
        let values = self.elevation_m.values();
        self.elevation_m
            .with_values(values.iter().map(|&z| self.at_elevation(month_index, z)).collect())
    }
}
