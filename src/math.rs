//! Transcendental functions with the same bits on every platform.
//!
//! Rust's own `exp`, `sin`, `powf` … call the system's C library, whose last bits differ between
//! systems; these call libm's portable code. `sqrt` is exact by IEEE 754 and may be used as it is.

macro_rules! portable {
    ($($(#[$doc:meta])* $name:ident, $name_f64:ident, $single:path, $double:path;)*) => {$(
        $(#[$doc])*
        #[inline]
        pub fn $name(x: f32) -> f32 { $single(x) }
        $(#[$doc])*
        #[inline]
        pub fn $name_f64(x: f64) -> f64 { $double(x) }
    )*};
}

portable! {
    /// e to the power `x`.
    exp, exp_f64, libm::expf, libm::exp;
    /// Natural logarithm.
    ln, ln_f64, libm::logf, libm::log;
    /// Sine of an angle in radians.
    sin, sin_f64, libm::sinf, libm::sin;
    /// Cosine of an angle in radians.
    cos, cos_f64, libm::cosf, libm::cos;
    /// Tangent of an angle in radians.
    tan, tan_f64, libm::tanf, libm::tan;
    /// Arc sine in radians.
    asin, asin_f64, libm::asinf, libm::asin;
    /// Arc cosine in radians.
    acos, acos_f64, libm::acosf, libm::acos;
    /// Arc tangent in radians.
    atan, atan_f64, libm::atanf, libm::atan;
}

/// Angle of the vector (`x`, `y`) from the x axis, in radians, in −π..=π.
#[inline]
pub fn atan2(y: f32, x: f32) -> f32 {
    libm::atan2f(y, x)
}

/// Angle of the vector (`x`, `y`) from the x axis, in radians, in −π..=π.
#[inline]
pub fn atan2_f64(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

/// `base` to the power `exponent`.
#[inline]
pub fn powf(base: f32, exponent: f32) -> f32 {
    libm::powf(base, exponent)
}

/// `base` to the power `exponent`.
#[inline]
pub fn powf_f64(base: f64, exponent: f64) -> f64 {
    libm::pow(base, exponent)
}

/// `a` at 0, `b` at 1, straight between.
#[inline]
pub fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// 3t² − 2t³ with t clamped to 0..=1: 0 and flat at 0, 1 and flat at 1.
///
/// # Departures
/// Peytavie 2024 prints −2x³ + 3x³ (PAPER_NOTES §10).
#[inline]
pub fn smoothstep(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A value rounded to so many bits of mantissa after the leading one, half up in size; 23 leave it as it is.
/// The error is at most 2⁻⁽ᵇⁱᵗˢ⁺¹⁾ of the value.
#[inline]
pub fn rounded_to_mantissa(value: f32, mantissa_bits: u32) -> f32 {
    let dropped = 23_u32.saturating_sub(mantissa_bits);
    if dropped == 0 {
        return value;
    }
    let bits = value.to_bits().saturating_add(1 << (dropped - 1)) & (u32::MAX << dropped);
    let rounded = f32::from_bits(bits);
    if rounded.is_finite() { rounded } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identities_hold() {
        assert_eq!(exp(0.0), 1.0);
        assert!((exp_f64(ln_f64(7.5)) - 7.5).abs() < 1e-14);
        assert!((sin(0.3) * sin(0.3) + cos(0.3) * cos(0.3) - 1.0).abs() < 1e-6);
        assert!((powf(2.0, 0.5) - 2f32.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn rounding_errs_by_half_a_step_at_most() {
        for value in [1.0_f32, -1217.3456, 3.15e-5, 0.0, f32::MAX] {
            assert_eq!(rounded_to_mantissa(value, 23).to_bits(), value.to_bits());
            let error = (rounded_to_mantissa(value, 12) - value).abs();
            assert!(error <= value.abs() / 8192.0, "{value}: {error}");
        }
        assert_ne!(rounded_to_mantissa(1217.3456, 12), 1217.3456);
    }

    #[test]
    fn smoothstep_is_half_way_in_the_middle_and_clamped() {
        assert_eq!(smoothstep(0.5), 0.5);
        assert_eq!(smoothstep(-3.0), 0.0);
        assert_eq!(smoothstep(4.0), 1.0);
        // the printed −2x³ + 3x³ would give 0.125 at one half
        assert!(smoothstep(0.5) > 0.4);
    }
}
