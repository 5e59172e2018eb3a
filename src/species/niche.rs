//! How well a place suits a species: adaptation to one resource, vigor over all four.
//!
//! # Reference
//! Kapp et al. 2020, Eq. 1, doi:10.1145/3414685.3417848; Peytavie et al. 2024, Eqs. 3–4, doi:10.1145/3641816.

use crate::math;

/// Stress far outside a niche, as a share of the best vigor. Peytavie 2024, Eq. 4: a = 0.2 (their program ran 0.4).
pub const MOST_STRESS: f32 = 0.2;
/// Share of the bell left at one half width. Peytavie 2024, Eq. 4, and what both programs ran.
pub const BELL_AT_HALF_WIDTH: f32 = 0.2;
/// How flat the bell's top is. Kapp 2020, Eq. 1; Peytavie 2024, Eq. 4.
pub const BELL_EXPONENT: f32 = 4.5;
/// ln([`BELL_AT_HALF_WIDTH`]), written out because logarithms are not constant expressions.
const LN_BELL_AT_HALF_WIDTH: f32 = -1.609_438;

/// Adaptation to one resource, in −0.2..=1: 1 at the ideal, 0 at 1.024 half widths, −0.2 far out.
///
/// # Reference
/// Peytavie et al. 2024, Eq. 4: g(d) = (1 + a)·e^(ln 0.2·(d/w)^4.5) − a.
/// # Departures
/// Kapp et al. 2020, Eq. 1 prints ln 0.01; both simulators ran ln 0.2, used here for every stage (PAPER_NOTES §1).
#[inline]
pub fn adaptation(value: f32, ideal: f32, half_width: f32) -> f32 {
    let distance = (value - ideal).abs() / half_width;
    let bell = math::exp(LN_BELL_AT_HALF_WIDTH * math::powf(distance, BELL_EXPONENT));
    (1.0 + MOST_STRESS) * bell - MOST_STRESS
}

/// What a species likes of one resource and how far it bears departures from it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Where it does best.
    pub ideal: f32,
    /// Distance from the ideal beyond which it barely holds its own.
    pub half_width: f32,
}

impl Tolerance {
    /// [`adaptation`] to `value`, in −0.2..=1.
    #[inline]
    pub fn adaptation(self, value: f32) -> f32 {
        adaptation(value, self.ideal, self.half_width)
    }
}

/// The four tolerances of a species.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Niche {
    /// Sunlight, hours a day.
    pub sun_h: Tolerance,
    /// Soil water, mm a month.
    pub moisture_mm: Tolerance,
    /// Mean temperature of the month, °C.
    pub temperature_c: Tolerance,
    /// Steepness, radians; ideal 0, half width the steepest slope it takes root on.
    pub slope_rad: Tolerance,
}

impl Niche {
    /// Vigor in −0.2..=1: the adaptation to whichever of the four suits least (Liebig's law of the minimum).
    ///
    /// # Reference
    /// Peytavie et al. 2024, Eq. 3; Kapp et al. 2020, section 5.1.
    /// # Departures
    /// Slope: Kapp's Table 3 has its ideal at 30–35°, which makes flat ground hostile to every species; Peytavie's
    /// ideal, level ground, serves both biomes (PAPER_NOTES §1).
    #[inline]
    pub fn vigor(&self, sun_h: f32, moisture_mm: f32, temperature_c: f32, slope_rad: f32) -> f32 {
        let light = self.sun_h.adaptation(sun_h);
        let water = self.moisture_mm.adaptation(moisture_mm);
        let warmth = self.temperature_c.adaptation(temperature_c);
        let ground = self.slope_rad.adaptation(slope_rad);
        light.min(water).min(warmth).min(ground)
    }
}

/// Suitability that rises from 0 to 1, stays, and falls back to 0.
///
/// # Reference
/// Kapp et al. 2020, section 6.3; the four corners as in the Gresolet grass file (PAPER_NOTES §9).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trapezoid {
    /// Below this nothing grows.
    pub lowest: f32,
    /// From here on it suits fully.
    pub full_from: f32,
    /// Up to here it suits fully.
    pub full_to: f32,
    /// Above this nothing grows.
    pub highest: f32,
}

impl Trapezoid {
    /// Suitability in 0..=1.
    #[inline]
    pub fn suitability(&self, value: f32) -> f32 {
        if value >= self.full_from && value <= self.full_to {
            1.0
        } else if value > self.lowest && value < self.full_from {
            (value - self.lowest) / (self.full_from - self.lowest)
        } else if value > self.full_to && value < self.highest {
            (self.highest - value) / (self.highest - self.full_to)
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adaptation_is_one_at_the_ideal_and_minus_a_far_out() {
        assert_eq!(adaptation(7.0, 7.0, 3.0), 1.0);
        assert!((adaptation(40.0, 7.0, 3.0) + MOST_STRESS).abs() < 1e-6);
        assert_eq!(adaptation(5.5, 7.0, 3.0), adaptation(8.5, 7.0, 3.0));
    }

    #[test]
    fn adaptation_vanishes_just_outside_the_half_width() {
        // (1 + a)·0.2^x − a = 0 where x = ln 6 / ln 5, so d/w = x^(1/4.5) = 1.0242
        let root = math::powf(math::ln(6.0) / math::ln(5.0), 1.0 / BELL_EXPONENT);
        assert!((root - 1.0242).abs() < 1e-4);
        assert!(adaptation(root * 3.0, 0.0, 3.0).abs() < 1e-5);
    }

    #[test]
    fn the_used_formula_differs_from_the_printed_one_at_the_half_width() {
        // Kapp's printed ln 0.01 gives 1.2·0.01 − 0.2 = −0.188; the used ln 0.2 gives 1.2·0.2 − 0.2 = 0.04
        assert!((adaptation(3.0, 0.0, 3.0) - 0.04).abs() < 1e-5);
        assert!((math::exp(LN_BELL_AT_HALF_WIDTH) - BELL_AT_HALF_WIDTH).abs() < 1e-6);
    }

    #[test]
    fn adaptation_never_rises_away_from_the_ideal() {
        let values: Vec<f32> = (0..200).map(|i| adaptation(i as f32 * 0.05, 0.0, 4.0)).collect();
        assert!(values.windows(2).all(|pair| pair[1] <= pair[0]));
    }

    #[test]
    fn the_least_suitable_resource_decides() {
        let wide = Tolerance { ideal: 0.0, half_width: 100.0 };
        let niche = Niche {
            sun_h: Tolerance { ideal: 6.0, half_width: 2.0 },
            moisture_mm: wide,
            temperature_c: wide,
            slope_rad: Tolerance { ideal: 0.0, half_width: 70f32.to_radians() },
        };
        assert_eq!(niche.vigor(8.0, 1.0, 1.0, 0.1), niche.sun_h.adaptation(8.0));
        // flat ground suits fully, where the printed c = 35°, w = 35° leaves 0.04
        assert_eq!(niche.vigor(6.0, 0.0, 0.0, 0.0), 1.0);
        assert!((adaptation(0.0, 35.0, 35.0) - 0.04).abs() < 1e-5);
    }

    #[test]
    fn trapezoid_has_its_corners() {
        let sun = Trapezoid { lowest: 1.5, full_from: 4.0, full_to: 12.0, highest: 15.0 };
        for (hours, expected) in
            [(1.0, 0.0), (1.5, 0.0), (2.75, 0.5), (4.0, 1.0), (12.0, 1.0), (13.5, 0.5), (15.0, 0.0)]
        {
            assert!((sun.suitability(hours) - expected).abs() < 1e-6, "{hours}");
        }
        let step = Trapezoid { lowest: 2.0, full_from: 2.0, full_to: 3.0, highest: 3.0 };
        assert_eq!(
            (step.suitability(2.0), step.suitability(1.9), step.suitability(3.1)),
            (1.0, 0.0, 0.0)
        );
    }
}
