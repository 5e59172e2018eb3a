//! Where the sun stands: declination, height, azimuth, day length.
//!
//! # Reference
//! Declination: Spencer 1971, "Fourier series representation of the position of the sun", Search 2(5);
//! representative days: Klein 1977, "Calculation of monthly average insolation on tilted surfaces",
//! Solar Energy 19(4), doi:10.1016/0038-092X(77)90001-9.
//! # Departures
//! No refraction and no solar disc: a point sun sets when its centre crosses the geometric horizon,
//! as in the closed form for day length.

use std::f64::consts::{PI, TAU};

use crate::math::{acos_f64, asin_f64, atan2_f64, cos_f64, sin_f64, tan_f64};
use crate::raster::MONTHS;

/// Day of the year (1 = 1 January) whose sun stands for its month's mean. Klein 1977, Table 1.
pub const REPRESENTATIVE_DAY: [u32; MONTHS] =
    [17, 47, 75, 105, 135, 162, 198, 228, 258, 288, 318, 344];

/// Declination of the sun on a day of a 365-day year (1 = 1 January), in radians.
///
/// # Reference
/// Spencer 1971; good to 0.0006 rad.
pub fn declination_rad(day_of_year: u32) -> f64 {
    let g = TAU * (f64::from(day_of_year) - 1.0) / 365.0;
    0.006918 - 0.399912 * cos_f64(g) + 0.070257 * sin_f64(g) - 0.006758 * cos_f64(2.0 * g)
        + 0.000907 * sin_f64(2.0 * g)
        - 0.002697 * cos_f64(3.0 * g)
        + 0.00148 * sin_f64(3.0 * g)
}

/// Hours from sunrise to sunset on open flat ground: 0 in polar night, 24 under the midnight sun.
pub fn day_length_h(latitude_rad: f64, declination_rad: f64) -> f64 {
    let cos_sunset = -tan_f64(latitude_rad) * tan_f64(declination_rad);
    24.0 / PI * acos_f64(cos_sunset.clamp(-1.0, 1.0))
}

/// Where the sun stands in the sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunPosition {
    /// Angle above the horizontal plane, negative below.
    pub elevation_rad: f64,
    /// Angle from true north, clockwise, in 0..2π.
    pub azimuth_rad: f64,
}

/// The sun's position at a solar time; 12 h is when it crosses the meridian.
pub fn sun_position(latitude_rad: f64, declination_rad: f64, solar_time_h: f64) -> SunPosition {
    let hour_angle = (solar_time_h - 12.0) * PI / 12.0;
    let (sin_lat, cos_lat) = (sin_f64(latitude_rad), cos_f64(latitude_rad));
    let (sin_dec, cos_dec) = (sin_f64(declination_rad), cos_f64(declination_rad));
    let up = sin_lat * sin_dec + cos_lat * cos_dec * cos_f64(hour_angle);
    let east = -cos_dec * sin_f64(hour_angle);
    let north = cos_lat * sin_dec - sin_lat * cos_dec * cos_f64(hour_angle);
    SunPosition {
        elevation_rad: asin_f64(up.clamp(-1.0, 1.0)),
        azimuth_rad: atan2_f64(east, north).rem_euclid(TAU),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solstices_and_equinoxes_lie_where_the_almanac_has_them() {
        assert!((declination_rad(172).to_degrees() - 23.45).abs() < 0.05); // 21 June
        assert!((declination_rad(355).to_degrees() + 23.45).abs() < 0.05); // 21 December
        assert!(declination_rad(80).to_degrees().abs() < 0.5); // 21 March
    }

    #[test]
    fn noon_sun_stands_south_at_mid_latitudes_and_north_below_the_equator() {
        let noon = sun_position(42.5_f64.to_radians(), 0.0, 12.0);
        assert!((noon.elevation_rad.to_degrees() - 47.5).abs() < 1e-9);
        assert!((noon.azimuth_rad.to_degrees() - 180.0).abs() < 1e-9);
        let noon = sun_position(-35.0_f64.to_radians(), 0.0, 12.0);
        assert!(noon.azimuth_rad.to_degrees() < 1e-9 || noon.azimuth_rad.to_degrees() > 359.9);
    }

    #[test]
    fn the_sun_rises_in_the_east() {
        let morning = sun_position(42.5_f64.to_radians(), 0.0, 6.0);
        assert!((morning.azimuth_rad.to_degrees() - 90.0).abs() < 1e-6);
        assert!(morning.elevation_rad.abs() < 1e-9);
    }

    #[test]
    fn equator_has_twelve_hours_and_the_pole_all_or_nothing() {
        assert!((day_length_h(0.0, 0.4) - 12.0).abs() < 1e-12);
        assert_eq!(day_length_h(1.5, 0.4), 24.0);
        assert_eq!(day_length_h(1.5, -0.4), 0.0);
    }
}
