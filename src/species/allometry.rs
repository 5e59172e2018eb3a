//! Size from size: crown radius and stem diameter from height, height from age and back.
//!
//! # Reference
//! Kapp et al. 2020, Eqs. 2–3, doi:10.1145/3414685.3417848; Peytavie et al. 2024, Eqs. 1–2, doi:10.1145/3641816.
//! The shade share (0 alone, 1 among others) moves a plant between the isolated and the dense envelope.

use super::species::Species;
use crate::math;

/// Metres from metres: e^(log_m + exponent · ln h), a straight line on doubly logarithmic paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PowerLaw {
    /// Natural logarithm of the value, in metres, of a plant one metre tall (a of Kapp 2020, Eq. 2).
    pub log_m: f32,
    /// Power of height (b of Kapp 2020, Eq. 2).
    pub exponent: f32,
}

impl PowerLaw {
    /// Value in metres for a plant `height_m` tall; 0 for no plant.
    #[inline]
    pub fn at_m(self, height_m: f32) -> f32 {
        if height_m <= 0.0 {
            return 0.0;
        }
        math::exp(self.log_m + self.exponent * math::ln(height_m))
    }
}

/// One measure of plants by height: on the whole, grown among others, and grown alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GrownEnvelope {
    /// Where the surroundings are not known.
    pub typical: PowerLaw,
    /// Among others.
    pub dense: PowerLaw,
    /// Alone.
    pub isolated: PowerLaw,
}

impl GrownEnvelope {
    /// Value in metres between the isolated (`shade_fraction` 0) and the dense (1) law.
    #[inline]
    pub fn in_shade_m(&self, height_m: f32, shade_fraction: f32) -> f32 {
        let share = shade_fraction.clamp(0.0, 1.0);
        math::lerp(self.isolated.at_m(height_m), self.dense.at_m(height_m), share)
    }
}

impl Species {
    /// Crown radius in metres of a plant `height_m` tall whose surroundings are not known.
    ///
    /// # Reference
    /// Kapp et al. 2020, Eq. 2: r = e^(a + b ln h).
    #[inline]
    pub fn crown_radius_m(&self, height_m: f32) -> f32 {
        self.crown.radius.typical.at_m(height_m)
    }

    /// Crown radius in metres of a plant `height_m` tall, from isolated (`shade_fraction` 0) to dense (1).
    ///
    /// # Reference
    /// Peytavie et al. 2024, Eq. 1.
    #[inline]
    pub fn crown_radius_in_shade_m(&self, height_m: f32, shade_fraction: f32) -> f32 {
        self.crown.radius.in_shade_m(height_m, shade_fraction)
    }

    /// Height in metres of the lowest live branches, from isolated (`shade_fraction` 0) to dense (1).
    #[inline]
    pub fn crown_base_m(&self, height_m: f32, shade_fraction: f32) -> f32 {
        let share = shade_fraction.clamp(0.0, 1.0);
        let crown = &self.crown;
        height_m * math::lerp(crown.base_fraction_isolated, crown.base_fraction_dense, share)
    }

    /// Diameter at breast height, in metres, of a plant `height_m` tall whose surroundings are not known.
    /// Below breast height (1.3 m) the law goes on and means the stem's own thickness.
    #[inline]
    pub fn dbh_m(&self, height_m: f32) -> f32 {
        self.stem.dbh.typical.at_m(height_m).min(self.stem.max_trunk_diameter_m)
    }

    /// Diameter at breast height, in metres, from isolated (`shade_fraction` 0) to dense (1).
    ///
    /// # Reference
    /// Peytavie et al. 2024, Eq. 1.
    #[inline]
    pub fn dbh_in_shade_m(&self, height_m: f32, shade_fraction: f32) -> f32 {
        let law_m = self.stem.dbh.in_shade_m(height_m, shade_fraction);
        law_m.min(self.stem.max_trunk_diameter_m)
    }

    /// Height in metres that the curve tends to, from isolated (`shade_fraction` 0) to dense (1).
    #[inline]
    pub fn height_limit_m(&self, shade_fraction: f32) -> f32 {
        let share = shade_fraction.clamp(0.0, 1.0);
        self.max_height_m * math::lerp(self.isolated_height_fraction, 1.0, share)
    }

    /// Height in metres at an idealized age: years of unhindered growth, not of the calendar.
    ///
    /// # Reference
    /// Peytavie et al. 2024, Eq. 2: h = (2 / (1 + e^(q t / max age)) − 1) · limit, with q < 0.
    /// # Departures
    /// As printed; their program has q positive and leaves the −1 out (PAPER_NOTES §10).
    #[inline]
    pub fn height_at_age_m(&self, age_years: f32, shade_fraction: f32) -> f32 {
        let years = age_years.max(0.0);
        let rise = 2.0 / (1.0 + math::exp(self.height_curve_q * years / self.max_age_years)) - 1.0;
        rise * self.height_limit_m(shade_fraction)
    }

    /// Idealized age in years at which a plant is `height_m` tall, in 0..=`max_age_years`: the inverse of
    /// [`Species::height_at_age_m`]. Plants taller than the curve at the greatest age get that age.
    #[inline]
    pub fn age_at_height_years(&self, height_m: f32, shade_fraction: f32) -> f32 {
        let rise = height_m.max(0.0) / self.height_limit_m(shade_fraction);
        if rise >= 1.0 {
            return self.max_age_years;
        }
        let years =
            self.max_age_years / self.height_curve_q * math::ln((1.0 - rise) / (1.0 + rise));
        years.min(self.max_age_years)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Biome;
    use super::*;

    fn every_species() -> Vec<Species> {
        Biome::BUILTIN_NAMES.iter().flat_map(|name| Biome::builtin(name).unwrap().species).collect()
    }

    #[test]
    fn crown_radius_follows_kapps_equation() {
        let sonoma = Biome::builtin("sonoma").unwrap();
        let redwood = sonoma.species_by_key("redwood").unwrap();
        // allometry D: e^(−0.728451431 + 0.656991006 ln 30) = 4.5093
        assert!((redwood.crown_radius_m(30.0) - 4.5093).abs() < 1e-3);
        let sorrel = sonoma.species_by_key("redwood-sorrel").unwrap();
        assert!((sorrel.crown_radius_m(0.25) - 1.0).abs() < 1e-5, "E: r = 4 h");
        assert_eq!(redwood.crown_radius_m(0.0), 0.0);
    }

    #[test]
    fn measures_grow_with_height_and_narrow_in_shade() {
        for species in every_species() {
            let heights = (1..=100).map(|i| species.max_height_m * i as f32 / 100.0);
            let (mut radius_m, mut dbh_m) = (0.0, 0.0);
            for height_m in heights {
                for shade in [0.0, 0.5, 1.0] {
                    let dbh = species.dbh_in_shade_m(height_m, shade);
                    assert!(dbh > 0.0 && dbh <= species.stem.max_trunk_diameter_m);
                }
                let (r, d) = (species.crown_radius_m(height_m), species.dbh_m(height_m));
                assert!(r > radius_m && d >= dbh_m, "{}", species.key);
                (radius_m, dbh_m) = (r, d);
            }
            let top = species.max_height_m;
            let alone = species.crown_radius_in_shade_m(top, 0.0);
            let crowded = species.crown_radius_in_shade_m(top, 1.0);
            assert!(crowded <= alone, "{}: {crowded} m against {alone} m", species.key);
            assert!((crowded..=alone).contains(&species.crown_radius_m(top)), "{}", species.key);
        }
    }

    #[test]
    fn height_follows_peytavies_equation_as_printed() {
        let pyrenees = Biome::builtin("pyrenees").unwrap();
        let fir = pyrenees.species_by_key("silver-fir").unwrap();
        // 50 · (2 / (1 + e^(−6·100/550)) − 1) = 50 · tanh(0.54545) = 24.855
        assert!((fir.height_at_age_m(100.0, 1.0) - 24.855).abs() < 1e-3);
        // without the −1 the program starts at half the limit and more
        assert_eq!(fir.height_at_age_m(0.0, 1.0), 0.0);
        assert!(fir.height_at_age_m(100.0, 0.0) < fir.height_at_age_m(100.0, 1.0));
    }

    #[test]
    fn age_inverts_height() {
        for species in every_species() {
            for shade in [0.0, 0.4, 1.0] {
                for i in 0..=20 {
                    let age = species.max_age_years * i as f32 / 20.0;
                    let height_m = species.height_at_age_m(age, shade);
                    let back = species.age_at_height_years(height_m, shade);
                    let bound = 1e-3 * species.max_age_years;
                    assert!((back - age).abs() < bound, "{}: {age} → {back}", species.key);
                }
                assert_eq!(species.age_at_height_years(1e4, shade), species.max_age_years);
                assert_eq!(species.age_at_height_years(-1.0, shade), 0.0);
            }
        }
    }

    #[test]
    fn shaded_crowns_start_higher() {
        for species in every_species() {
            let (alone, crowded) =
                (species.crown_base_m(10.0, 0.0), species.crown_base_m(10.0, 1.0));
            assert!((0.0..10.0).contains(&alone) && crowded >= alone, "{}", species.key);
        }
    }
}
