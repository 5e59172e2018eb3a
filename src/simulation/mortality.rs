//! Death of live plants, tested once a year.
//!
//! # Reference
//! Kapp et al. 2020, section 6.1, doi:10.1145/3414685.3417848; Peytavie et al. 2024, Eqs. 6–8, doi:10.1145/3641816.

use crate::math;

/// Chance of a year that has nothing to do with stress: of those that sprout, `survivors_fraction` reach the greatest age.
///
/// # Reference
/// Kapp et al. 2020, section 6.1: μ_b = 1 − P_s^(1/ℓ).
pub fn background_death_probability_per_year(survivors_fraction: f32, max_age_years: f32) -> f32 {
    1.0 - math::powf(survivors_fraction, 1.0 / max_age_years)
}

/// Chance that a live plant dies within the year, in 0..=1: background plus how far its carbon pool was overdrawn when it was
/// lowest.
///
/// # Reference
/// Kapp et al. 2020: μ = min(μ_b + μ_s, 1), μ_s = max(−R_i, 0); Peytavie et al. 2024, Eqs. 6–8.
/// # Departures
/// Kapp prints a test every month, with a lifespan in years: a fern of five years would die within months. The test is
/// yearly, as Peytavie's (PAPER_NOTES §7), and on the year's worst month: where winters are kind, a test at New Year lets
/// ferns live in full sun, whose summer kills them.
#[inline]
pub fn death_probability_per_year(background_per_year: f32, lowest_carbon_pool: f32) -> f32 {
    (background_per_year + (-lowest_carbon_pool).max(0.0)).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_in_a_hundred_reaches_the_greatest_age() {
        for age_years in [5.0, 120.0, 1500.0] {
            let chance = f64::from(background_death_probability_per_year(0.01, age_years));
            let reached = math::powf_f64(1.0 - chance, f64::from(age_years));
            assert!((reached / 0.01 - 1.0).abs() < 0.01, "{reached}");
        }
    }

    #[test]
    fn stress_adds_to_the_background_and_is_never_more_than_certain() {
        assert_eq!(death_probability_per_year(0.1, 0.4), 0.1);
        assert!((death_probability_per_year(0.1, -0.3) - 0.4).abs() < 1e-6);
        assert_eq!(death_probability_per_year(0.3, -1.0), 1.0);
    }
}
