//! Vectors: places and directions in metres (x east, y north, z up), colours as linear red, green and blue.

use glam::Quat;
pub use glam::{Vec3, vec3};

/// Straight up.
pub const UP: Vec3 = Vec3::Z;
/// Shares of red, green and blue in the brightness of linear light (Rec. 709).
pub const LUMINANCE: Vec3 = vec3(0.2126, 0.7152, 0.0722);

/// A vector turned by a unit quaternion x, y, z, w.
#[inline]
pub fn turned(rotation: [f32; 4], v: Vec3) -> Vec3 {
    Quat::from_array(rotation) * v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_about_the_vertical_brings_east_to_north() {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let north = turned([0.0, 0.0, half, half], Vec3::X);
        assert!((north - Vec3::Y).length() < 1e-6, "{north:?}");
    }
}
