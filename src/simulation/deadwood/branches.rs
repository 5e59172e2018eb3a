//! Primary branches of a tree: how many it has, how thick and how long they are.

use crate::species::{Leaf, Species};

/// Primary branches of needle trees. chosen: between 13 of fir and 26 of pine in the growth tables of Peytavie et al. 2024.
const OF_NEEDLE_TREES: f32 = 20.0;
/// Primary branches of broadleaved trees. chosen: 10 of oak, 8 of beech and 11 of birch in the same tables.
const OF_BROADLEAVED_TREES: f32 = 10.0;
/// Share of the stem's cross section that goes on into primary branches. chosen: half; by the pipe model (Shinozaki 1964)
/// cross sections add up, and the leader has the rest.
const CROSS_SECTION_FRACTION: f32 = 0.5;
/// Length of a branch over the crown's radius. chosen: branches rise.
const LENGTH_OVER_RADIUS: f32 = 1.2;

/// Primary branches of a tree (p and ψ of Peytavie 2024, Eq. 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Branches {
    /// Their number.
    pub count: f32,
    /// Mean diameter at the stem.
    pub diameter_m: f32,
    /// Length.
    pub length_m: f32,
}

impl Branches {
    /// Those of a tree of this stem and crown.
    ///
    /// # Departures
    /// The growth tables count branches that their program drew; here they follow from the stem, so that they fit any
    /// species.
    pub fn of(species: &Species, dbh_m: f32, crown_radius_m: f32) -> Self {
        let count = match species.leaf {
            Leaf::Needle => OF_NEEDLE_TREES,
            Leaf::Broad => OF_BROADLEAVED_TREES,
            Leaf::Frond => 0.0,
        };
        let diameter_m =
            if count > 0.0 { dbh_m * (CROSS_SECTION_FRACTION / count).sqrt() } else { 0.0 };
        Self { count, diameter_m, length_m: LENGTH_OVER_RADIUS * crown_radius_m }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::species::Biome;

    #[test]
    fn branches_have_half_of_the_stem_s_cross_section() {
        let biome = Biome::builtin("pyrenees").unwrap();
        for key in ["silver-fir", "sessile-oak"] {
            let branches = Branches::of(biome.species_by_key(key).unwrap(), 0.6, 3.0);
            let sum = branches.count * branches.diameter_m * branches.diameter_m;
            assert!((sum / 0.36 - 0.5).abs() < 1e-5);
        }
        let beech = Branches::of(biome.species_by_key("european-beech").unwrap(), 0.4, 3.0);
        assert!((0.07..0.1).contains(&beech.diameter_m));
    }
}
