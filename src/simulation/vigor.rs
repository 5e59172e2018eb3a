//! Vigor of a species by month: how well its ground, light and water suit it, for twelve months at a time.
//!
//! The least of several adaptations is the adaptation at the greatest distance, because adaptation only falls with
//! distance from the ideal. So the bell is worked out once a month, not once a month for each of the four resources.

use super::plot::GroundCell;
use super::traits::Traits;
use crate::raster::MONTHS;
use crate::species::niche::{self, Tolerance};

/// Half widths from the ideal beyond which nothing changes: the bell is below 10⁻¹⁵ there.
const FARTHEST: f32 = 2.0;
/// log₂ of the share of the bell left at one half width, log₂ 0.2.
const LOG2_BELL_AT_HALF_WIDTH: f32 = -2.321_928;

// the square root below is this exponent's
const _: () = assert!(niche::BELL_EXPONENT == 4.5 && niche::BELL_AT_HALF_WIDTH == 0.2);

/// A tolerance with its width as a factor.
#[derive(Clone, Copy, Debug)]
pub struct Scaled {
    ideal: f32,
    per_half_width: f32,
}

impl Scaled {
    pub fn of(tolerance: Tolerance) -> Self {
        Self { ideal: tolerance.ideal, per_half_width: 1.0 / tolerance.half_width }
    }

    /// Distance of a value from the ideal in half widths.
    #[inline]
    fn distance(self, value: f32) -> f32 {
        (value - self.ideal).abs() * self.per_half_width
    }
}

/// Vigor by month, in −0.2..=1, on a share of the ground's light and with so much water.
///
/// # Reference
/// Peytavie et al. 2024, Eqs. 3–4, as [`niche::Niche::vigor`], to within 10⁻⁵.
#[inline]
pub fn by_month(
    traits: &Traits,
    ground: &GroundCell,
    light_fraction: f32,
    water_mm: &[f32; MONTHS],
) -> [f32; MONTHS] {
    let slope = traits.slope_rad.distance(ground.slope_rad);
    let mut vigor = [0.0; MONTHS];
    for (month, vigor) in vigor.iter_mut().enumerate() {
        let light = traits.sun_h.distance(ground.sun_h[month] * light_fraction);
        let water = traits.moisture_mm.distance(water_mm[month]);
        let warmth = traits.temperature_c.distance(ground.temperature_c[month]);
        *vigor = adaptation(larger(larger(light, water), larger(warmth, slope)));
    }
    vigor
}

/// Whether the slope alone keeps vigor from ever being above 0.
#[inline]
pub fn is_too_steep(traits: &Traits, slope_rad: f32) -> bool {
    adaptation(traits.slope_rad.distance(slope_rad)) <= 0.0
}

/// [`niche::adaptation`] at a distance in half widths, to within 10⁻⁵, without branches or calls.
#[inline]
fn adaptation(distance: f32) -> f32 {
    let distance = if distance < FARTHEST { distance } else { FARTHEST };
    let squared = distance * distance;
    let bell = exp2(LOG2_BELL_AT_HALF_WIDTH * (squared * squared * distance.sqrt()));
    (1.0 + niche::MOST_STRESS) * bell - niche::MOST_STRESS
}

/// 2 to a power in −120..=0, with a relative error below 10⁻⁶.
///
/// # Reference
/// The polynomial meets (2ˣ − 1)/x at the five Chebyshev nodes of −½..½.
#[inline]
fn exp2(power: f32) -> f32 {
    // 1.5·2²³: added to a number it leaves its whole part, rounded, in the low bits
    const WHOLE: f32 = 12_582_912.0;
    const ONE_EXPONENT: u32 = 127;
    let shifted = power + WHOLE;
    let x = power - (shifted - WHOLE);
    let fraction = 1.0
        + x * (0.693_147_2
            + x * (0.240_223_49 + x * (0.055_503_81 + x * (0.009_666_368 + x * 0.001_338_130_3))));
    fraction * f32::from_bits(shifted.to_bits().wrapping_add(ONE_EXPONENT) << 23)
}

/// The larger of two numbers that are not NaN.
#[inline]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::super::Parameters;
    use super::*;
    use crate::species::Biome;

    #[test]
    fn adaptation_is_the_niche_s_function() {
        for step in 0..3000 {
            let distance = step as f32 * 0.001;
            let (got, want) = (adaptation(distance), niche::adaptation(distance, 0.0, 1.0));
            assert!((got - want).abs() < 2e-6, "{distance}: {got} for {want}");
        }
        assert_eq!(adaptation(0.0), niche::adaptation(0.0, 0.0, 1.0));
        assert_eq!(adaptation(1e9), -niche::MOST_STRESS);
    }

    #[test]
    fn vigor_is_the_least_adaptation_of_each_month() {
        let biome = Biome::builtin("sonoma").unwrap();
        let month = |m: usize| m as f32;
        let ground = GroundCell {
            sun_h: std::array::from_fn(|m| 3.0 + 0.9 * month(m)),
            moisture_mm: [0.0; MONTHS],
            temperature_c: std::array::from_fn(|m| 5.0 + 2.0 * month(m)),
            slope_rad: 0.3,
        };
        let water_mm = std::array::from_fn(|m| 10.0 * month(m));
        for (traits, species) in
            Traits::of(&biome, &Parameters::kapp2020()).iter().zip(&biome.species)
        {
            let vigor = by_month(traits, &ground, 0.7, &water_mm);
            for m in 0..MONTHS {
                let (sun_h, temperature_c) = (0.7 * ground.sun_h[m], ground.temperature_c[m]);
                let want = species.niche.vigor(sun_h, water_mm[m], temperature_c, 0.3);
                assert!((vigor[m] - want).abs() < 1e-5, "{m}: {} for {want}", vigor[m]);
            }
        }
    }
}
