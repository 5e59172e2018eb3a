//! Sunlight: hours of light a day, month by month, past the terrain's own horizon and through the clouds.
//!
//! # Reference
//! Kapp et al. 2020, section 5.1, doi:10.1145/3414685.3417848: direct and diffuse light in hours a day from
//! the sun's position every 15 minutes. Clouds: Kasten & Czeplak 1980, "Solar and terrestrial radiation
//! dependent on the amount and type of cloud", Solar Energy 24(2), doi:10.1016/0038-092X(80)90391-6.
//! Clear sky: Erbs, Klein & Duffie 1982, "Estimation of the diffuse radiation fraction for hourly, daily and
//! monthly-average global radiation", Solar Energy 28(4), doi:10.1016/0038-092X(82)90302-4.

use rayon::prelude::*;

use super::exposure::{Exposure, exposure};
use super::solar::{REPRESENTATIVE_DAY, day_length_h, declination_rad};
use crate::progress::{Cancelled, Reporter};
use crate::raster::{Grid, MonthlyGrid};
use crate::species::Climate;
use crate::terrain::Terrain;

/// How sunlight is worked out.
#[derive(Clone, Debug, PartialEq)]
pub struct SunlightParams {
    /// Directions in which the horizon is looked up, at least 8 (fewer are taken as 8).
    pub azimuth_count: usize,
    /// Longest step along the sun's path, in hours; steps also end where the sun passes a looked-up direction.
    pub path_step_h: f64,
    /// Share of light that comes from the sky rather than the sun when no cloud is there.
    pub clear_sky_diffuse_fraction: f32,
    /// Light under an overcast sky over light under a clear one.
    pub overcast_light_fraction: f32,
}

impl Default for SunlightParams {
    fn default() -> Self {
        Self {
            azimuth_count: 64,
            path_step_h: 0.25,                 // Kapp 2020, section 5.1
            clear_sky_diffuse_fraction: 0.165, // Erbs et al. 1982, clearness index above 0.8
            overcast_light_fraction: 0.25,     // Kasten & Czeplak 1980: 1 − 0.75·N^3.4 at N = 1
        }
    }
}

/// What the sun gives a terrain.
#[derive(Clone, Debug)]
pub struct Sunlight {
    /// Hours of light a day, mean of the month; 0 where masked.
    pub sunlight_h: MonthlyGrid,
    /// Share of the sky's light that reaches the tilted cell, in 0..=1; 0 where masked.
    pub sky_view: Grid<f32>,
}

/// Sunlight over a terrain in a climate: direct sun under clear sky, and sky light under clear and cloudy sky,
/// c·((1 − k)·direct + k·V·L) + (1 − c)·t·V·L hours a day, with clear-sky fraction c, clear-sky diffuse
/// share k, overcast light t, sky view V and day length L.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
pub fn run(
    terrain: &Terrain,
    climate: &Climate,
    params: &SunlightParams,
    reporter: &Reporter,
) -> Result<Sunlight, Cancelled> {
    let Exposure { direct_sun_h, sky_view } =
        exposure(terrain, params.azimuth_count, params.path_step_h, reporter)?;
    let (frame, mask) = (direct_sun_h.frame().clone(), direct_sun_h.mask().clone());
    let mut months_h = direct_sun_h.into_months();
    months_h.par_iter_mut().enumerate().for_each(|(month_index, hours)| {
        let light = MonthLight::new(terrain.latitude_rad, climate, params, month_index);
        hours.par_iter_mut().zip(sky_view.values()).for_each(|(hours, sky_view)| {
            *hours = light.sunlight_h(*hours, *sky_view);
        });
    });
    Ok(Sunlight { sunlight_h: MonthlyGrid::new(frame, mask, months_h), sky_view })
}

/// Sunlight on open level ground, in hours a day: the day's length less what clouds keep.
pub fn open_sky_sunlight_h(latitude_rad: f64, climate: &Climate, month_index: usize) -> f64 {
    let light = MonthLight::new(latitude_rad, climate, &SunlightParams::default(), month_index);
    f64::from(light.sunlight_h(light.day_length_h, 1.0))
}

/// How a month's light is shared between sun, sky and clouds.
#[derive(Clone, Copy, Debug)]
struct MonthLight {
    day_length_h: f32,
    /// Weight of an hour of direct sun.
    direct: f32,
    /// Weight of an hour of open sky.
    sky: f32,
}

impl MonthLight {
    fn new(
        latitude_rad: f64,
        climate: &Climate,
        params: &SunlightParams,
        month_index: usize,
    ) -> Self {
        let declination_rad = declination_rad(REPRESENTATIVE_DAY[month_index]);
        let clear = climate.clear_sky_fraction[month_index];
        let diffuse = params.clear_sky_diffuse_fraction;
        Self {
            day_length_h: day_length_h(latitude_rad, declination_rad) as f32,
            direct: clear * (1.0 - diffuse),
            sky: clear * diffuse + (1.0 - clear) * params.overcast_light_fraction,
        }
    }

    #[inline]
    fn sunlight_h(&self, direct_sun_h: f32, sky_view: f32) -> f32 {
        self.direct * direct_sun_h + self.sky * sky_view * self.day_length_h
    }
}
