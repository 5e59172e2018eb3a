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
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
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
            // chosen: on real 1–2 m terrain hours of 64 and 256 directions differ by 0.06–0.09 h (rms), less than
            // the 0.1–0.2 h by which any number of them differs from rays marched minute by minute
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
pub fn open_sky_sunlight_h(
    latitude_rad: f64,
    climate: &Climate,
    params: &SunlightParams,
    month_index: usize,
) -> f64 {
    let light = MonthLight::new(latitude_rad, climate, params, month_index);
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

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::abiotics::slope::{aspect_rad, slope_rad};
    use crate::raster::MONTHS;
    use crate::species::Soil;

    /// The weather of Sonoma, Kapp 2020.
    fn climate() -> Climate {
        Climate {
            latitude_deg: 38.578,
            station_altitude_m: 0.0,
            temperature_c: [15.0; MONTHS],
            clear_sky_fraction: [
                0.43, 0.45, 0.50, 0.57, 0.67, 0.81, 0.92, 0.90, 0.87, 0.72, 0.53, 0.47,
            ],
            rain_mm: [50.0; MONTHS],
            lapse_rate_c_per_m: 0.0065,
            soil: Soil {
                evaporated_rain_fraction: 0.25,
                infiltration_max_mm: 100.0,
                infiltration_full_slope_rad: 0.0873,
                infiltration_none_slope_rad: 0.96,
                soil_capacity_mm: 180.0,
            },
        }
    }

    fn sunlight(terrain: &Terrain, climate: &Climate) -> Sunlight {
        let params = SunlightParams::default();
        run(terrain, climate, &params, &Reporter::silent()).expect("nobody cancels")
    }

    #[test]
    fn open_level_ground_has_the_day_less_what_clouds_keep() {
        let (climate, latitude_rad) = (climate(), 38.578_f64.to_radians());
        let terrain = Terrain {
            elevation_m: Grid::from_fn(3, 9, 1.0, |_| 100.0),
            latitude_rad,
            grid_convergence_rad: 0.0,
        };
        let sunlight = sunlight(&terrain, &climate);
        for (month_index, day) in REPRESENTATIVE_DAY.iter().enumerate() {
            let clear = f64::from(climate.clear_sky_fraction[month_index]);
            let day_h = day_length_h(latitude_rad, declination_rad(*day));
            let expected_h = day_h * (clear + 0.25 * (1.0 - clear));
            let open_h = open_sky_sunlight_h(
                latitude_rad,
                &climate,
                &SunlightParams::default(),
                month_index,
            );
            assert!((open_h - expected_h).abs() < 1e-5);
            for hours in sunlight.sunlight_h.month(month_index) {
                assert!((f64::from(*hours) - expected_h).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn clouds_spare_the_shade() {
        // a cloudier month takes light from the sun's side, and gives the shaded cell none it had not
        let mut climate = climate();
        climate.clear_sky_fraction[0] = 1.0;
        let params = SunlightParams::default();
        let clear = MonthLight::new(0.7, &climate, &params, 0);
        climate.clear_sky_fraction[0] = 0.0;
        let overcast = MonthLight::new(0.7, &climate, &params, 0);
        assert_eq!(overcast.sunlight_h(8.0, 0.8), overcast.sunlight_h(0.0, 0.8));
        assert!(clear.sunlight_h(8.0, 0.8) > 3.0 * overcast.sunlight_h(8.0, 0.8));
        assert!(clear.sunlight_h(0.0, 0.8) < overcast.sunlight_h(0.0, 0.8));
    }

    #[test]
    fn gresolets_northern_slopes_lie_dark_in_winter() {
        let data = std::env::var_os("WILDWOOD_DATA").map_or_else(
            || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data")),
            PathBuf::from,
        );
        let Ok(text) = std::fs::read_to_string(data.join("gresolet/heightfield.elv")) else {
            eprintln!("skipped: ../shared/data is missing");
            return;
        };
        let numbers: Vec<f32> = text.split_whitespace().map_while(|n| n.parse().ok()).collect();
        let (cols, rows) = (numbers[0] as usize, numbers[1] as usize);
        let elevation_m = Grid::from_fn(rows, cols, f64::from(numbers[2]), |cell| {
            numbers[4 + (rows - 1 - cell.row) * cols + cell.col]
        });
        let latitude_rad = f64::from(numbers[3]).to_radians();
        let terrain = Terrain { elevation_m, latitude_rad, grid_convergence_rad: 0.0 };
        let december = sunlight(&terrain, &climate()).sunlight_h.month(11).to_vec();
        let slope = slope_rad(&terrain.elevation_m);
        let aspect = aspect_rad(&terrain.elevation_m);
        let mean_h = |facing_deg: f32| {
            let faces = |index: &usize| {
                let off_deg = (aspect.values()[*index].to_degrees() - facing_deg).rem_euclid(360.0);
                slope.values()[*index] > 0.26 && !(45.0..=315.0).contains(&off_deg)
            };
            let hours = (0..december.len()).filter(faces).map(|index| december[index]);
            let (sum, count) = hours.fold((0.0, 0.0), |(sum, count), h| (sum + h, count + 1.0));
            sum / count
        };
        let (north_h, south_h) = (mean_h(0.0), mean_h(180.0));
        assert!(south_h > 1.5 * north_h, "north {north_h} h, south {south_h} h");
    }
}
