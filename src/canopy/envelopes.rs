//! Envelopes: how narrow and how wide a species' crown may be at a height.

use super::crowns::MAX_RADIUS_UNITS;
use crate::species::Biome;

/// How far a crown may be from its species' allometry, as a share of it.
/// chosen: crowns of one species and height vary by about a third between open and closed stands (the growth tables of
/// Peytavie 2024; Pretzsch et al. 2015, doi:10.1016/j.ufug.2015.04.006).
pub const CROWN_ENVELOPE_FRACTION: f32 = 0.35;

/// Heights of the table in a metre. chosen: the crown of a 3 m tree changes by one in a hundred from one to the next.
const STEPS_PER_M: f32 = 32.0;

/// Narrowest and widest crown of every canopy species at every height: asked for each cell, so kept in a table.
#[derive(Clone, Debug)]
pub struct Envelopes {
    /// Radii in units, height after height; empty for species that are no canopy species.
    by_species: Vec<Vec<[i16; 2]>>,
}

impl Envelopes {
    /// Envelopes up to `highest_m`, for working cells with `units_per_m`.
    pub fn new(biome: &Biome, units_per_m: f32, highest_m: f32) -> Self {
        let mut by_species = vec![Vec::new(); biome.species.len()];
        let steps = (highest_m * STEPS_PER_M) as usize; // thousands
        for s in biome.canopy_species() {
            let radius = |step: usize| {
                biome.species[s].crown_radius_m(step as f32 / STEPS_PER_M) * units_per_m
            };
            let bound = |units: f32| (units as i32).clamp(1, MAX_RADIUS_UNITS) as i16; // < 2¹¹
            // within the bounds anywhere in the step
            let envelope = |step: usize| {
                let widest = bound((radius(step) * (1.0 + CROWN_ENVELOPE_FRACTION)).floor());
                let narrowest = bound((radius(step + 1) * (1.0 - CROWN_ENVELOPE_FRACTION)).ceil());
                [narrowest.min(widest), widest]
            };
            by_species[s] = (0..=steps).map(envelope).collect();
        }
        Self { by_species }
    }

    /// Narrowest and widest crown of a canopy species, units; above the highest canopy that at its height.
    #[inline]
    pub fn at(&self, species: u8, height_m: f32) -> [i32; 2] {
        let of_species = &self.by_species[usize::from(species)];
        let step = ((height_m * STEPS_PER_M) as usize).min(of_species.len() - 1);
        of_species[step].map(i32::from)
    }

    /// Widest crown that any tree can have, units.
    pub fn widest(&self) -> i32 {
        let widest = self.by_species.iter().flatten().map(|&[_, widest]| i32::from(widest));
        widest.max().unwrap_or(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn envelopes_stay_within_the_share_of_the_allometry_and_use_it() {
        let biome = Biome::builtin("sonoma").unwrap();
        let envelopes = Envelopes::new(&biome, 32.0, 60.0);
        for s in biome.canopy_species() {
            for height_m in [3.0, 3.02, 7.77, 20.0, 59.99] {
                let typical = biome.species[s].crown_radius_m(height_m) * 32.0;
                let [narrowest, widest] = envelopes.at(s as u8, height_m).map(|r| r as f32);
                let share = CROWN_ENVELOPE_FRACTION;
                assert!(narrowest >= typical * (1.0 - share) && widest <= typical * (1.0 + share));
                assert!(narrowest < typical * (1.0 - share) * 1.02 + 1.0);
                assert!(widest > typical * (1.0 + share) * 0.98 - 1.0);
                assert!(envelopes.widest() as f32 >= widest);
            }
        }
    }
}
