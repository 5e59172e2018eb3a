//! Traits: what the year of a species asks for, worked out once.

use super::vigor::Scaled;
use super::{Competition, GrowthCurve, Parameters, mortality};
use crate::math;
use crate::raster::MONTHS;
use crate::species::niche::Niche;
use crate::species::{Biome, Form, Species};

/// Shade share of plants that grow under a canopy or under each other.
const AMONG_OTHERS: f32 = 1.0;

/// A species in the simulation.
#[derive(Clone)]
pub struct Traits {
    pub sun_h: Scaled,
    pub moisture_mm: Scaled,
    pub temperature_c: Scaled,
    pub slope_rad: Scaled,
    /// Share of the light that a crown lets through.
    pub passed_light_fraction: f32,
    /// Water it takes before what is left over is shared, mm a month.
    pub need_mm: f32,
    /// Years of idealized age for each month whose growth runs over wholly; 0 outside the season.
    pub years_a_month: [f32; MONTHS],
    /// Chance of death without stress.
    pub background_death_probability_per_year: f32,
    /// Weight among germinating species besides vigor: 1/ℓ^β.
    pub seed_weight: f32,
    /// One bit a sub-biome that it grows in.
    pub sub_biomes: u32,
    /// How many times likelier it sprouts on a decaying downed log than beside it (α of Peytavie 2024, Eq. 5).
    pub downed_log_seeding_multiplier: f32,
    growth: GrowthCurve,
    /// Sizes by idealized age for [`GrowthCurve::Envelope`], else none.
    envelope: Vec<EnvelopeSizes>,
    species: Species,
}

/// Height, crown radius and stem diameter, m.
pub type Size = [f32; 3];

/// Sizes at an age, among others and alone.
#[derive(Clone, Copy)]
struct EnvelopeSizes {
    dense_m: Size,
    isolated_m: Size,
}

/// Steps of idealized age in an envelope's table. chosen: a year or so of a tree's growth, as in the authors' tables.
const ENVELOPE_STEPS: usize = 512;

impl Traits {
    /// Traits of every species of a biome.
    pub fn of(biome: &Biome, parameters: &Parameters) -> Vec<Self> {
        let for_resources = parameters.competition == Competition::Resources;
        let of_species = |species: &Species| {
            let season = species.growing_season;
            let month_years = 1.0 / f32::from(season.months());
            let years = |month: usize| {
                if season.contains(month as u8 + 1) { month_years } else { 0.0 }
            };
            Self {
                sun_h: Scaled::of(species.niche.sun_h),
                moisture_mm: Scaled::of(species.niche.moisture_mm),
                temperature_c: Scaled::of(species.niche.temperature_c),
                slope_rad: Scaled::of(species.niche.slope_rad),
                passed_light_fraction: if for_resources {
                    1.0 - species.absorbed_light_fraction
                } else {
                    1.0
                },
                need_mm: if for_resources { least_water_mm(&species.niche) } else { 0.0 },
                years_a_month: std::array::from_fn(years),
                background_death_probability_per_year:
                    mortality::background_death_probability_per_year(
                        parameters.survivors_fraction,
                        species.max_age_years,
                    ),
                seed_weight: math::powf(species.max_age_years, -parameters.lifespan_exponent),
                sub_biomes: species.sub_biomes.iter().fold(0, |bits, index| bits | 1 << index),
                downed_log_seeding_multiplier: species.decay.log_seeding_multiplier,
                growth: match (species.form, parameters.growth) {
                    (Form::Herb, GrowthCurve::Smoothstep) => GrowthCurve::Saturating,
                    (_, growth) => growth,
                },
                envelope: match parameters.growth {
                    GrowthCurve::Envelope => envelope(species),
                    _ => Vec::new(),
                },
                species: species.clone(),
            }
        };
        biome.species.iter().map(of_species).collect()
    }

    /// Height in m at an idealized age, and crown radius.
    ///
    /// # Reference
    /// Kapp et al. 2020, Eqs. 2–3; Peytavie et al. 2024, Eq. 2.
    pub fn size_m(&self, idealized_age_years: f32) -> [f32; 2] {
        let species = &self.species;
        let height_m = match self.growth {
            GrowthCurve::Smoothstep => {
                species.max_height_m * math::smoothstep(idealized_age_years / species.max_age_years)
            }
            GrowthCurve::Saturating => species.height_at_age_m(idealized_age_years, AMONG_OTHERS),
            GrowthCurve::Envelope => {
                let [height_m, crown_radius_m, _] =
                    self.envelope_size_m(idealized_age_years, AMONG_OTHERS);
                return [height_m, crown_radius_m];
            }
        };
        [height_m, species.crown_radius_m(height_m)]
    }

    /// Height, crown radius and stem diameter in m at an idealized age, from alone (`crowding_fraction` 0) to among
    /// others (1).
    ///
    /// # Reference
    /// Peytavie et al. 2024, Eq. 1; a table of [`ENVELOPE_STEPS`] ages, straight between them.
    ///
    /// # Panics
    /// If the parameters' growth is not [`GrowthCurve::Envelope`].
    #[inline]
    pub fn envelope_size_m(&self, idealized_age_years: f32, crowding_fraction: f32) -> Size {
        let at = (idealized_age_years / self.species.max_age_years).clamp(0.0, 1.0)
            * ENVELOPE_STEPS as f32;
        let step = (at as usize).min(ENVELOPE_STEPS - 1);
        let (from, to, share) = (&self.envelope[step], &self.envelope[step + 1], at - step as f32);
        std::array::from_fn(|measure| {
            let between = |sizes: &EnvelopeSizes| {
                let isolated_m = sizes.isolated_m[measure];
                isolated_m + crowding_fraction * (sizes.dense_m[measure] - isolated_m)
            };
            let from_m = between(from);
            from_m + share * (between(to) - from_m)
        })
    }

    /// What its species file says.
    pub fn species(&self) -> &Species {
        &self.species
    }
}

fn envelope(species: &Species) -> Vec<EnvelopeSizes> {
    let at = |step: usize| {
        let years = species.max_age_years * step as f32 / ENVELOPE_STEPS as f32;
        let size_m = |shade_fraction: f32| {
            let height_m = species.height_at_age_m(years, shade_fraction);
            let radius_m = species.crown_radius_in_shade_m(height_m, shade_fraction);
            [height_m, radius_m, species.dbh_in_shade_m(height_m, shade_fraction)]
        };
        EnvelopeSizes { dense_m: size_m(1.0), isolated_m: size_m(0.0) }
    };
    (0..=ENVELOPE_STEPS).map(at).collect()
}

/// Water that a plant needs at least, mm a month: the dry end of what its species bears.
///
/// # Reference
/// Kapp et al. 2020, section 6.1, speaks of "a defined minimum" and gives no value. chosen: with less than this a plant is
/// under stress, so it is what roots that reach water first take first.
pub fn least_water_mm(niche: &Niche) -> f32 {
    (niche.moisture_mm.ideal - niche.moisture_mm.half_width).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_season_is_a_year_of_growth_and_full_age_is_full_height() {
        for name in Biome::BUILTIN_NAMES {
            let biome = Biome::builtin(name).unwrap();
            for (traits, species) in
                Traits::of(&biome, &Parameters::kapp2020()).iter().zip(&biome.species)
            {
                assert!((traits.years_a_month.iter().sum::<f32>() - 1.0).abs() < 1e-5);
                let [height_m, radius_m] = traits.size_m(species.max_age_years);
                let least = if species.form == Form::Herb { 0.99 } else { 1.0 };
                assert!((least..=1.0).contains(&(height_m / species.max_height_m)), "{name}");
                assert_eq!(radius_m, species.crown_radius_m(height_m));
                assert_eq!(traits.size_m(0.0), [0.0, 0.0]);
            }
        }
    }

    #[test]
    fn smoothstep_is_used_as_meant_not_as_printed() {
        let biome = Biome::builtin("sonoma").unwrap();
        let index = biome.species_index("tanoak").unwrap();
        let (traits, species) =
            (Traits::of(&biome, &Parameters::kapp2020()), &biome.species[index]);
        // printed, −2x³ + 3x³ = x³ is an eighth at half age
        let [height_m, _] = traits[index].size_m(0.5 * species.max_age_years);
        assert!((height_m / species.max_height_m - 0.5).abs() < 1e-6);
    }

    #[test]
    fn ferns_have_most_of_their_height_in_the_second_year() {
        let biome = Biome::builtin("sonoma").unwrap();
        let index = biome.species_index("western-swordfern").unwrap();
        let [height_m, _] = Traits::of(&biome, &Parameters::kapp2020())[index].size_m(2.0);
        // the smoothstep of Eq. 3 has 0.42 m
        assert!((height_m - 1.0).abs() < 0.05, "{height_m}");
    }
}
