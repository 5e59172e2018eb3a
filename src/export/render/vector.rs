//! Vectors of three numbers: places and directions in metres, colours as linear light.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A place or direction (x east, y north, z up), or linear red, green and blue.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vec3 {
    /// East, or red.
    pub x: f32,
    /// North, or green.
    pub y: f32,
    /// Up, or blue.
    pub z: f32,
}

/// A vector of three numbers.
#[inline]
pub const fn vec3(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3 { x, y, z }
}

/// Straight up.
pub const UP: Vec3 = vec3(0.0, 0.0, 1.0);

impl Vec3 {
    /// The same number thrice.
    #[inline]
    pub const fn splat(value: f32) -> Self {
        vec3(value, value, value)
    }

    /// Sum of products.
    #[inline]
    pub fn dot(self, other: Self) -> f32 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// Square to both, right-handed.
    #[inline]
    pub fn cross(self, other: Self) -> Self {
        vec3(
            self.y * other.z - self.z * other.y,
            self.z * other.x - self.x * other.z,
            self.x * other.y - self.y * other.x,
        )
    }

    /// Length.
    #[inline]
    pub fn length(self) -> f32 {
        self.dot(self).sqrt()
    }

    /// The same direction at length 1; up if there is none.
    #[inline]
    pub fn unit(self) -> Self {
        let length = self.length();
        if length > 1e-20 { self / length } else { UP }
    }

    /// Channel by channel: two colours multiplied.
    #[inline]
    pub fn times(self, other: Self) -> Self {
        vec3(self.x * other.x, self.y * other.y, self.z * other.z)
    }

    /// This at 0, the other at 1, straight between.
    #[inline]
    pub fn mix(self, other: Self, t: f32) -> Self {
        self + (other - self) * t
    }

    /// Each number changed alike.
    #[inline]
    pub fn map(self, f: impl Fn(f32) -> f32) -> Self {
        vec3(f(self.x), f(self.y), f(self.z))
    }

    /// Brightness of linear light (Rec. 709).
    #[inline]
    pub fn luminance(self) -> f32 {
        0.2126 * self.x + 0.7152 * self.y + 0.0722 * self.z
    }

    /// Whether all are finite.
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.z.is_finite()
    }
}

impl From<[f32; 3]> for Vec3 {
    #[inline]
    fn from([x, y, z]: [f32; 3]) -> Self {
        vec3(x, y, z)
    }
}

impl Add for Vec3 {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        vec3(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}

impl AddAssign for Vec3 {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Vec3 {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        vec3(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}

impl Neg for Vec3 {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        vec3(-self.x, -self.y, -self.z)
    }
}

impl Mul<f32> for Vec3 {
    type Output = Self;
    #[inline]
    fn mul(self, factor: f32) -> Self {
        vec3(self.x * factor, self.y * factor, self.z * factor)
    }
}

impl Div<f32> for Vec3 {
    type Output = Self;
    #[inline]
    fn div(self, divisor: f32) -> Self {
        self * (1.0 / divisor)
    }
}

/// A vector turned by a unit quaternion x, y, z, w.
#[inline]
pub fn turned([x, y, z, w]: [f32; 4], v: Vec3) -> Vec3 {
    let axis = vec3(x, y, z);
    let across = axis.cross(v) * 2.0;
    v + across * w + axis.cross(across)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_about_the_vertical_brings_east_to_north() {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let north = turned([0.0, 0.0, half, half], vec3(1.0, 0.0, 0.0));
        assert!((north - vec3(0.0, 1.0, 0.0)).length() < 1e-6, "{north:?}");
        assert_eq!(vec3(1.0, 0.0, 0.0).cross(vec3(0.0, 1.0, 0.0)), UP);
        assert_eq!(Vec3::default().unit(), UP);
    }
}
