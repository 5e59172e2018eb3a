//! A snag's years: it drops its branches, snaps, and falls from its stump.
//!
//! # Reference
//! Peytavie et al. 2024, section 5.2, Table 2; PAPER_NOTES §10.

use super::branches::Branches;
use super::decay::{self, LEAST_DENSITY_OF_CLASS};
use crate::math;
use crate::plants::deadwood::Cause;
use crate::species::Species;

/// A dead tree that stands. Places are metres from the plot's north-west corner.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Snag {
    /// The tree's id.
    pub id: u64,
    /// Index of its species.
    pub species: u16,
    /// Metres east.
    pub east_m: f32,
    /// Metres south.
    pub south_m: f32,
    /// Height that stands.
    pub height_m: f32,
    /// Height at death.
    pub height_at_death_m: f32,
    /// Crown radius at death.
    pub crown_radius_m: f32,
    /// Stem diameter at breast height, at death.
    pub dbh_m: f32,
    /// Years of decay at the best rate that lie behind it.
    pub decayed_years: f32,
    /// Years of decay that it lasts.
    pub deathspan_years: f32,
    /// Share of its primary branches that it still has.
    pub branch_fraction: f32,
    /// Year of its death.
    pub year: u16,
    /// What killed it.
    pub cause: Cause,
}

/// What a year of decay brings down.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fallen {
    /// Primary branches.
    pub branches: u32,
    /// Height above which the stem breaks, m; what stands above it falls.
    pub stem_above_m: Option<f32>,
    /// Whether the break leaves but a stump.
    pub leaves_stump: bool,
}

/// Greatest height of a stump. Peytavie 2024, Table 2: less than 2 m of trunk remaining.
pub const STUMP_M: f32 = 2.0;
/// Least height of a stump. chosen: a stem that rots off at the ground leaves some decimetres.
const LEAST_STUMP_M: f32 = 0.3;
/// Chance, for each year of decay, that a snag of class 1–5 falls from its stump. chosen: few bare snags stand for more than a decade
/// of decay, within the 5–25 years that inventories of dead conifers and beeches report.
const FALL_PROBABILITY_PER_DECAY_YEAR: [f32; 5] = [0.02, 0.1, 0.2, 0.3, 1.0];
/// How stems taper: diameter falls with this power of the distance from the top. chosen: gives the form factor 0.45.
const TAPER_EXPONENT: f32 = 0.61;
/// Shares of its height at which a snag snaps. chosen: anywhere but near its ends.
const SNAP_FRACTIONS: [f32; 2] = [0.25, 0.75];

impl Snag {
    /// Density of its wood over that at death.
    pub fn density_fraction(&self) -> f32 {
        decay::density_fraction(self.decayed_years / self.deathspan_years)
    }

    /// Decay class, 1–5.
    pub fn decay_class(&self) -> u8 {
        decay::class(self.density_fraction())
    }

    /// Whether it has rotted away.
    pub fn is_gone(&self) -> bool {
        self.decayed_years >= self.deathspan_years
    }

    /// Its primary branches, when it died.
    pub fn branches(&self, species: &Species) -> Branches {
        Branches::of(species, self.dbh_m, self.crown_radius_m)
    }

    /// Diameter of its stem at a height, m: breast height's at the foot, nothing at the top.
    pub fn diameter_at_m(&self, height_m: f32) -> f32 {
        let left = (1.0 - height_m / self.height_at_death_m).max(0.0);
        self.dbh_m * math::powf(left, TAPER_EXPONENT)
    }

    /// Ages by years of decay and tells what falls. Of `draws`, the first two decide on the heights of breaks, the third on
    /// whether its roots give way.
    ///
    /// # Departures
    /// The paper's snags stand until their stem snaps and rots off. Most real ones fall before, as roots rot: each year of
    /// decay has a chance of it, without which two thirds of deadwood stood.
    pub fn age(&mut self, years: f32, species: &Species, draws: [f32; 3]) -> Fallen {
        self.decayed_years = (self.decayed_years + years).min(self.deathspan_years);
        let density = self.density_fraction();
        let class = decay::class(density);
        let mut fallen = Fallen::default();

        // branches, through classes 2 and 3
        let [bare, _, debranched, _] = LEAST_DENSITY_OF_CLASS;
        let left = ((density - debranched) / (bare - debranched)).clamp(0.0, 1.0);
        let left = left.min(self.branch_fraction);
        let whole = |fraction: f32| (self.branches(species).count * fraction) as u32; // some dozens
        fallen.branches = whole(self.branch_fraction) - whole(left);
        self.branch_fraction = left;

        // the stem: it snaps on the way to class 4, and is a stump in class 5
        let stump_m = LEAST_STUMP_M + draws[1] * (STUMP_M - LEAST_STUMP_M);
        let falls = draws[2] < years * FALL_PROBABILITY_PER_DECAY_YEAR[usize::from(class) - 1];
        let breaks_at_m = if (class == 5 || falls) && self.height_m > STUMP_M {
            fallen.leaves_stump = true;
            stump_m
        } else if class == 4 && self.height_m > SNAP_FRACTIONS[1] * self.height_at_death_m {
            let [low, high] = SNAP_FRACTIONS;
            ((low + draws[0] * (high - low)) * self.height_at_death_m).max(STUMP_M)
        } else {
            f32::INFINITY
        };
        if breaks_at_m < self.height_m {
            fallen.stem_above_m = Some(breaks_at_m);
        }
        fallen
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::species::Biome;

    fn snag() -> Snag {
        Snag {
            id: 7,
            species: 3,
            east_m: 1.0,
            south_m: 2.0,
            height_m: 20.0,
            height_at_death_m: 20.0,
            crown_radius_m: 2.0,
            dbh_m: 0.4,
            decayed_years: 0.0,
            deathspan_years: 40.0,
            branch_fraction: 1.0,
            year: 3,
            cause: Cause::Age,
        }
    }

    #[test]
    fn a_snag_loses_branches_then_its_top_then_all_but_its_stump() {
        let biome = Biome::builtin("pyrenees").unwrap();
        let fir = biome.species_by_key("silver-fir").unwrap();
        let mut snag = snag();
        let (mut branches, mut breaks) = (0, Vec::new());
        let (mut class, mut density) = (1, 1.0);
        for year in 1..=40 {
            let fallen = snag.age(1.0, fir, [0.5, 0.5, 1.0]);
            assert!(snag.decay_class() >= class && snag.density_fraction() <= density);
            (class, density) = (snag.decay_class(), snag.density_fraction());
            branches += fallen.branches;
            if let Some(above_m) = fallen.stem_above_m {
                breaks.push((year, class, above_m, branches));
                snag.height_m = above_m;
            }
        }
        // the density of 1 − s(t/40) falls below .5 after half, below .3 after 0.637 of the deathspan
        let expected = [(21, 4, 10.0_f32, 20), (26, 5, 1.15, 20)];
        assert_eq!(breaks.len(), expected.len());
        for ((year, class, above_m, branches), expected) in breaks.into_iter().zip(expected) {
            assert_eq!((year, class, branches), (expected.0, expected.1, expected.3));
            assert!((above_m - expected.2).abs() < 1e-5, "{above_m}");
        }
        assert!(snag.is_gone());
    }

    #[test]
    fn low_stems_rot_where_they_stand() {
        let biome = Biome::builtin("pyrenees").unwrap();
        let fir = biome.species_by_key("silver-fir").unwrap();
        let mut snag = Snag { height_m: 1.8, height_at_death_m: 1.8, ..snag() };
        for _ in 0..40 {
            assert_eq!(snag.age(1.0, fir, [0.5, 0.5, 1.0]).stem_above_m, None);
        }
        assert!(snag.is_gone());
    }
}
