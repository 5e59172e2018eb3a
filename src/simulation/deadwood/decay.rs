//! Decay: how long dead wood lasts, how dense it still is, and the class that foresters would give it.
//!
//! # Reference
//! Peytavie et al. 2024, section 5.2, Eqs. 9–11, Table 2, doi:10.1145/3641816.

use crate::math;
use crate::species::niche::{BELL_AT_HALF_WIDTH, BELL_EXPONENT, Tolerance};

/// Least density of decay classes 1–4, as a share of that at death; class 5 has what is below.
///
/// # Reference
/// Peytavie et al. 2024, Table 2.
pub const LEAST_DENSITY_OF_CLASS: [f32; 4] = [0.9, 0.7, 0.5, 0.3];

/// How fast wood decays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecayParameters {
    /// Years of decay that a snag ages in a year where fungi thrive.
    pub snag_years_per_year: f32,
    /// The same of downed logs.
    pub downed_log_years_per_year: f32,
    /// Yearly mean temperature that fungi like, °C.
    pub temperature_c: Tolerance,
    /// Yearly mean soil water that they like, mm.
    pub moisture_mm: Tolerance,
}

impl DecayParameters {
    /// Rates that were calibrated on Gresolet.
    ///
    /// # Reference
    /// The tolerances are not printed. chosen: fungi thrive in warmth, so that wood lasts longer up the mountains, and yearly
    /// means hide warm summers; wood on dry ground rots at half the best rate and on waterlogged ground, which holds 180 mm, at a fifth.
    /// # Departures
    /// The authors' program ran 2.25 (snags) and 2.75 (logs) times a constant 1.2 (PAPER_NOTES §10).
    pub fn peytavie2024() -> Self {
        Self {
            snag_years_per_year: 1.8,
            downed_log_years_per_year: 2.0,
            temperature_c: Tolerance { ideal: 18.0, half_width: 15.0 },
            moisture_mm: Tolerance { ideal: 80.0, half_width: 100.0 },
        }
    }

    /// How well fungi thrive at a place, in 0..=1.
    ///
    /// # Reference
    /// Peytavie et al. 2024, Eq. 10: the least of the adaptations to temperature and moisture, without stress.
    pub fn viability(&self, temperature_c: f32, moisture_mm: f32) -> f32 {
        bell(self.temperature_c, temperature_c).min(bell(self.moisture_mm, moisture_mm))
    }
}

/// Eq. 4 with a = 0.
fn bell(tolerance: Tolerance, value: f32) -> f32 {
    let distance = (value - tolerance.ideal).abs() / tolerance.half_width;
    math::exp(math::ln(BELL_AT_HALF_WIDTH) * math::powf(distance, BELL_EXPONENT))
}

/// Years of decay at the best rate that wood of a diameter lasts.
///
/// # Reference
/// Peytavie et al. 2024, Eq. 9: δ_i = α_φ · φ_i · δ_s.
/// # Departures
/// As their program ran (PAPER_NOTES §10): δ_s (0.592 + 0.00816 φ) with φ in cm, 0.6 δ_s φ below one; δ_s is what wood of
/// 50 cm lasts, not the fastest of 10 cm.
pub fn deathspan_years(species_deathspan_years: f32, diameter_m: f32) -> f32 {
    let diameter_cm = 100.0 * diameter_m;
    let share = if diameter_cm < 1.0 { 0.6 * diameter_cm } else { 0.592 + 0.00816 * diameter_cm };
    species_deathspan_years * share
}

/// Density over that at death, 1 at first and 0 when `decayed_fraction` of the deathspan, 1, is over.
///
/// # Reference
/// Peytavie et al. 2024, Eq. 11.
/// # Departures
/// Eq. 11 prints the smoothstep as −2x³ + 3x³, and rising; density is what is left: 1 − (3x² − 2x³).
pub fn density_fraction(decayed_fraction: f32) -> f32 {
    1.0 - math::smoothstep(decayed_fraction)
}

/// Decay class, 1–5, of a density.
///
/// # Reference
/// Peytavie et al. 2024, Table 2.
pub fn class(density_fraction: f32) -> u8 {
    1 + LEAST_DENSITY_OF_CLASS.iter().filter(|least| density_fraction < **least).count() as u8 // ≤ 5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deathspans_are_the_program_s() {
        assert!((deathspan_years(50.0, 0.10) - 50.0 * 0.6736).abs() < 1e-3);
        assert!((deathspan_years(50.0, 0.50) - 50.0).abs() < 1e-3);
        assert!((deathspan_years(50.0, 0.005) - 15.0).abs() < 1e-3);
    }

    #[test]
    fn density_falls_from_one_to_nothing_as_meant_not_as_printed() {
        assert_eq!(
            [density_fraction(0.0), density_fraction(1.0), density_fraction(2.0)],
            [1.0, 0.0, 0.0]
        );
        // printed: x³ = 1/64
        assert!((density_fraction(0.25) - (1.0 - 0.15625)).abs() < 1e-6);
        let falling = (0..100).map(|i| density_fraction(i as f32 * 0.01)).collect::<Vec<_>>();
        assert!(falling.windows(2).all(|pair| pair[1] < pair[0]));
    }

    #[test]
    fn classes_are_those_of_table_2() {
        let classes = [1.0, 0.9, 0.89, 0.7, 0.69, 0.5, 0.49, 0.3, 0.29, 0.0].map(class);
        assert_eq!(classes, [1, 1, 2, 2, 3, 3, 4, 4, 5, 5]);
    }

    #[test]
    fn fungi_want_warmth_and_neither_drought_nor_flood() {
        let parameters = DecayParameters::peytavie2024();
        assert_eq!(parameters.viability(18.0, 80.0), 1.0);
        assert!((parameters.viability(3.0, 80.0) - 0.2).abs() < 1e-5);
        assert!((parameters.viability(18.0, 0.0) - 0.554).abs() < 1e-3);
        assert!((parameters.viability(18.0, 180.0) - 0.2).abs() < 1e-5);
    }
}
