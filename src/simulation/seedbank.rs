//! Seedbank: where seeds of a canopy's sub-biomes lie, and how likely one sprouts.
//!
//! # Reference
//! Kapp et al. 2020, section 6.1, Seeding, doi:10.1145/3414685.3417848.

use super::Parameters;
use super::plot::CanopyTree;
use crate::species::Biome;

/// Seeds of a piece of ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seeds {
    /// Chance a year that one sprouts in a simulation cell; where seeds lie everywhere, the share of the parameters' chance.
    pub chance_per_year: f32,
    /// One bit a sub-biome whose plants they may be.
    pub sub_biomes: u32,
}

impl Seeds {
    /// Seeds of all species, as many as the parameters have ([`super::parameters::Seeding::Everywhere`]).
    pub const EVERYWHERE: Self = Self { chance_per_year: 1.0, sub_biomes: u32::MAX };
}

/// Share of a tree's chance γ that is left so many of its crown radii away.
///
/// # Reference
/// Kapp et al. 2020: γ within 4 r, falling linearly to 0 at 12 r.
#[inline]
pub fn share_at(distance_radii: f32, parameters: &Parameters) -> f32 {
    let Parameters { seed_flat_radii: flat, seed_reach_radii: reach, .. } = *parameters;
    ((reach - distance_radii) / (reach - flat)).clamp(0.0, 1.0)
}

/// Chance a year that a tree gives a cell so many of its crown radii away.
#[inline]
pub fn chance_per_year(distance_radii: f32, parameters: &Parameters) -> f32 {
    parameters.seed_chance_per_year * share_at(distance_radii, parameters)
}

/// Adds a tree's seeds to ground whose cells, `cell_m` wide, are row-major from the north-west corner.
pub fn sow(
    tree: &CanopyTree,
    biome: &Biome,
    parameters: &Parameters,
    [rows, cols]: [usize; 2],
    cell_m: f32,
    seeds: &mut [Seeds],
) {
    let Some(sub_biome) = biome.species[usize::from(tree.species)].canopy_sub_biome else { return };
    let reach_m = parameters.seed_reach_radii * tree.crown_radius_m;
    let span = |at_m: f32, cells: usize| {
        // `as` cuts negatives to 0
        let first = ((at_m - reach_m) / cell_m).floor() as usize;
        first..(((at_m + reach_m) / cell_m).ceil().max(0.0) as usize).min(cells)
    };
    for row in span(tree.south_m, rows) {
        let south_m = (row as f32 + 0.5) * cell_m - tree.south_m;
        for col in span(tree.east_m, cols) {
            let east_m = (col as f32 + 0.5) * cell_m - tree.east_m;
            let away_m = (south_m * south_m + east_m * east_m).sqrt();
            if away_m < reach_m {
                let cell = &mut seeds[row * cols + col];
                let chance = chance_per_year(away_m / tree.crown_radius_m, parameters);
                cell.chance_per_year =
                    (cell.chance_per_year + chance).min(parameters.most_seed_chance_per_year);
                cell.sub_biomes |= 1 << sub_biome;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chance_is_flat_to_four_radii_and_gone_at_twelve() {
        let parameters = Parameters::kapp2020();
        let share = |radii: f32| share_at(radii, &parameters);
        assert_eq!([share(0.0), share(4.0)], [1.0; 2]);
        assert!((share(8.0) - 0.5).abs() < 1e-6);
        assert_eq!([share(12.0), share(20.0)], [0.0; 2]);
    }

    #[test]
    fn trees_sow_their_sub_biome_and_chances_add_up() {
        let biome = Biome::builtin("sonoma").unwrap();
        let parameters = Parameters::kapp2020();
        let canopy = |sub_biome: usize| biome.sub_biomes[sub_biome].canopy[0] as u16;
        let mut seeds = vec![Seeds::default(); 100 * 100];
        for (sub_biome, east_m) in [(0, 20.0), (1, 60.0)] {
            let species = canopy(sub_biome);
            let (height_m, crown_base_m) = (12.0, 4.0);
            let tree = CanopyTree {
                species,
                east_m,
                south_m: 50.0,
                crown_radius_m: 3.0,
                height_m,
                crown_base_m,
            };
            sow(&tree, &biome, &parameters, [100, 100], 1.0, &mut seeds);
        }
        assert_eq!(seeds[50 * 100 + 20].sub_biomes, 1);
        assert_eq!(seeds[50 * 100 + 40].sub_biomes, 3);
        assert!(seeds[50 * 100 + 40].chance_per_year > 0.003);
        assert_eq!(seeds[5 * 100 + 99].chance_per_year, 0.0);
    }
}
