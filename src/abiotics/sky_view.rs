//! Share of the sky's light that reaches a tilted cell past its horizon.
//!
//! # Reference
//! Dozier & Frew 1990, "Rapid calculation of terrain parameters for radiation modeling from digital elevation
//! data", IEEE Transactions on Geoscience and Remote Sensing 28(5), doi:10.1109/36.58986, the sky-view factor
//! V_d: 1/2π ∫ [cos S sin²H + sin S cos(φ − A)(H − sin H cos H)] dφ, with slope S, aspect A and
//! the horizon's angle H from the zenith towards azimuth φ; the sky is equally bright all over.

use std::f32::consts::FRAC_PI_2;

use super::slope::Gradient;

/// What one azimuth adds to the sky-view factor, times 2π/cos S per radian.
///
/// `rise` is how the cell itself rises towards the azimuth, in metres per metre: a cell sees no sky behind itself.
/// Sky below the level of the cell is none: the earth goes on beyond the terrain.
#[inline]
pub(crate) fn sky_towards(tan_horizon: f32, rise: f32) -> f32 {
    let tan = tan_horizon.max(rise).max(0.0);
    let sin_squared = 1.0 / (1.0 + tan * tan);
    sin_squared - rise * (angle_from_zenith_rad(tan) - tan * sin_squared)
}

/// Sky-view factor, in 0..=1: 1 on open level ground, (1 + cos S)/2 on an open slope.
///
/// `sky_sum` is the sum of [`sky_towards`] over `azimuth_count` equal steps around the circle.
#[inline]
pub(crate) fn sky_view_fraction(sky_sum: f32, gradient: Gradient, azimuth_count: usize) -> f32 {
    (sky_sum * cos_slope(gradient) / azimuth_count as f32).clamp(0.0, 1.0)
}

#[inline]
fn cos_slope(Gradient { to_east, to_north }: Gradient) -> f32 {
    1.0 / (1.0 + to_east * to_east + to_north * to_north).sqrt()
}

/// Angle from the zenith whose elevation has the tangent `tan` ≥ 0, in radians, to 1e-5; without branches.
///
/// # Reference
/// Abramowitz & Stegun 1964, Handbook of Mathematical Functions, 4.4.47.
#[inline]
fn angle_from_zenith_rad(tan: f32) -> f32 {
    let steep = tan > 1.0;
    let x = tan.min(1.0) / tan.max(1.0);
    let xx = x * x;
    let odd = ((0.020_835_1 * xx - 0.085_133) * xx + 0.180_141) * xx - 0.330_299_5;
    let atan = (odd * xx + 0.999_866) * x;
    if steep { atan } else { FRAC_PI_2 - atan }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math;

    #[test]
    fn angle_from_zenith_is_the_arc_cotangent() {
        for step in 0..4000 {
            let tan = step as f32 * 0.005;
            let exact = FRAC_PI_2 - math::atan(tan);
            assert!((angle_from_zenith_rad(tan) - exact).abs() < 1.2e-5, "tan {tan}");
        }
    }

    #[test]
    fn a_cell_sees_no_sky_behind_itself() {
        // an open slope: facing away from azimuth 0, its own rise is the horizon
        let open = sky_towards(0.0, 1.0);
        assert_eq!(open, sky_towards(1.0, 1.0));
        assert!(open > 0.0 && open < sky_towards(0.0, 0.0));
    }
}
