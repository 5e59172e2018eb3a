//! Sky, sun and haze: colours of light as it arrives, in linear light where white paper in the sun is about 1.

use super::vector::{UP, Vec3, vec3};
use crate::math;

/// Sky at the zenith and at the horizon. chosen: a clear summer morning, so that shade is bluish, not blue.
const ZENITH: Vec3 = vec3(0.165, 0.315, 0.640);
const HORIZON: Vec3 = vec3(0.640, 0.745, 0.860);
/// What lies under the horizon where no ground is known. chosen: mist over a valley in the shade.
const MIST: Vec3 = vec3(0.150, 0.190, 0.228);
/// How much light each metre of air scatters, by red, green and blue; chosen: a clear morning after rain.
const SCATTERING_PER_M: Vec3 = vec3(0.000_045, 0.000_060, 0.000_086);

/// The light of the hour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sky {
    /// Direction to the sun.
    pub sun: Vec3,
    /// Light of the sun on a surface square to it.
    pub sun_light: Vec3,
    /// Light of the whole sky on a level surface.
    pub sky_light: Vec3,
    /// How thick the haze is, 1 on a clear day.
    pub haze: f32,
}

impl Sky {
    /// The light of a sun in a direction; low suns are red and weak.
    pub fn new(sun: Vec3, haze: f32) -> Self {
        // air that the light crosses, in thicknesses of the atmosphere
        let air_mass = 1.0 / (sun.z.max(0.0) + 0.06);
        let through = vec3(0.060, 0.105, 0.205).map(|depth| math::exp(-depth * air_mass));
        let day = math::smoothstep((sun.z + 0.1) / 0.35);
        Self {
            sun,
            sun_light: through * (3.35 * math::smoothstep((sun.z + 0.02) / 0.06)),
            sky_light: vec3(0.45, 0.49, 0.55) * (0.25 + 0.75 * day),
            haze,
        }
    }

    /// Light that comes from a direction of the open sky.
    #[inline]
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let up = direction.z.max(0.0);
        // the horizon's band is a few degrees high
        let rise = 1.0 - math::exp(-up * 4.2);
        let base = HORIZON.lerp(ZENITH, rise);
        let toward = direction.dot(self.sun).max(0.0);
        let wide = toward * toward * toward * toward;
        let glow = self.sun_light * (0.045 * wide + 0.5 * math::powf(toward, 220.0));
        let light = base + glow * (1.0 - 0.5 * rise);
        light.lerp(MIST, math::smoothstep(-direction.z / 0.62))
    }

    /// Light from the sky on a surface that sees `share` of it.
    #[inline]
    pub fn ambient(&self, normal: Vec3, share: f32) -> Vec3 {
        self.sky_light * (share * (0.5 + 0.5 * normal.z))
    }

    /// What is left of a light from `distance_m` off, with the light that the air between adds.
    #[inline]
    pub fn hazed(&self, light: Vec3, direction: Vec3, distance_m: f32) -> Vec3 {
        let through =
            SCATTERING_PER_M.map(|per_m| math::exp(-per_m * self.haze * distance_m.max(0.0)));
        let level = vec3(direction.x, direction.y, direction.z.max(0.02)).normalize_or(UP);
        let air = self.radiance(level) * 0.85;
        light * through + air * (through.map(|t| 1.0 - t))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::render::vector::LUMINANCE;

    #[test]
    fn low_suns_are_red_and_haze_swallows_what_is_far() {
        let high = Sky::new(vec3(0.5, 0.0, 0.8).normalize_or(UP), 1.0);
        let low = Sky::new(vec3(1.0, 0.0, 0.05).normalize_or(UP), 1.0);
        assert!(low.sun_light.x / low.sun_light.z > 2.0 * high.sun_light.x / high.sun_light.z);
        assert!(
            Sky::new(vec3(1.0, 0.0, -0.2).normalize_or(UP), 1.0).sun_light.dot(LUMINANCE) < 1e-6
        );
        let level = vec3(0.0, 1.0, 0.0);
        let near = high.hazed(Vec3::splat(0.1), level, 0.0);
        assert!((near - Vec3::splat(0.1)).length() < 1e-6);
        let far = high.hazed(Vec3::splat(0.1), level, 1e6);
        assert!(
            (far - high.radiance(vec3(0.0, 1.0, 0.02).normalize_or(UP)) * 0.85).length() < 1e-3
        );
    }
}
