//! What is known of one species. Values come from `species/*.toml`, where each has its source.

use super::allometry::GrownEnvelope;
use super::niche::Niche;

/// One species of a biome.
#[derive(Clone, Debug, PartialEq)]
pub struct Species {
    /// Stable name in files and flags, e.g. `coast-live-oak`.
    pub key: String,
    /// Everyday name.
    pub common_name: String,
    /// Botanical name.
    pub scientific_name: String,
    /// Growth form.
    pub form: Form,
    /// Needles or broad leaves.
    pub leaf: Leaf,
    /// Whether it sheds its leaves.
    pub leaf_habit: LeafHabit,
    /// Colour on maps, sRGB.
    pub color_srgb: [u8; 3],
    /// Indices of the sub-biomes it grows in.
    pub sub_biomes: Vec<usize>,
    /// Index of the one sub-biome whose canopy it can form; none for plants of the undergrowth alone.
    pub canopy_sub_biome: Option<usize>,
    /// Age that one in a hundred reaches (Kapp 2020, section 6.1.3; Peytavie 2024, Eq. 7).
    pub max_age_years: f32,
    /// Greatest height, grown among others.
    pub max_height_m: f32,
    /// Greatest height grown alone, as a share of `max_height_m`.
    pub isolated_height_fraction: f32,
    /// Steepness q of the height curve, negative as printed (Peytavie 2024, Eq. 2).
    pub height_curve_q: f32,
    /// Share of the light that a crown takes, 0–1 (the papers' alpha or "crown transparency").
    pub absorbed_light_fraction: f32,
    /// Months in which it grows.
    pub growing_season: GrowingSeason,
    /// Where it thrives.
    pub niche: Niche,
    /// Its crown.
    pub crown: Crown,
    /// Its stem.
    pub stem: Stem,
    /// Its wood.
    pub wood: Wood,
    /// What happens to it after death.
    pub decay: Decay,
}

impl Species {
    /// Whether it can stand in the canopy; if not, it lives in the undergrowth alone.
    pub fn can_be_canopy(&self) -> bool {
        self.canopy_sub_biome.is_some()
    }
}

/// Growth form of a grown plant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// No wood.
    Herb,
    /// Several woody stems.
    Shrub,
    /// A shrub in the open, a climber under trees.
    ShrubVine,
    /// A shrub on poor sites, a tree on good ones.
    ShrubTree,
    /// One woody stem.
    Tree,
}

/// Kind of foliage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Leaf {
    /// Needles or needle-like leaves.
    Needle,
    /// Broad leaves.
    Broad,
    /// Fern fronds.
    Frond,
}

/// Whether foliage stays over the unfavourable season.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LeafHabit {
    /// Green all year.
    Evergreen,
    /// Bare in winter.
    WinterDeciduous,
    /// Sheds part or all of its leaves in drought.
    DroughtDeciduous,
}

/// Months of growth, both ends counted; the season may run over the new year.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GrowingSeason {
    /// First month, 1–12.
    pub first_month: u8,
    /// Last month, 1–12; before `first_month` if the season wraps.
    pub last_month: u8,
}

impl GrowingSeason {
    /// Whether it grows in `month`, 1–12.
    #[inline]
    pub fn contains(self, month: u8) -> bool {
        if self.first_month <= self.last_month {
            (self.first_month..=self.last_month).contains(&month)
        } else {
            month >= self.first_month || month <= self.last_month
        }
    }

    /// Number of months, 1–12.
    pub fn months(self) -> u8 {
        (self.last_month + 12 - self.first_month) % 12 + 1
    }
}

/// Shape of a crown's outline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CrownShape {
    /// Pointed above, wide below: most conifers.
    Cone,
    /// Rounded above and below.
    Ellipsoid,
    /// A dome, flat below.
    Hemisphere,
    /// Narrow above and below, as wide throughout.
    Cylinder,
    /// Narrow below, wide above: many shrubs and ferns.
    InvertedCone,
}

/// A species' crown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crown {
    /// Outline.
    pub shape: CrownShape,
    /// Radius by height.
    pub radius: GrownEnvelope,
    /// Height of the lowest live branches as a share of the plant's, among others.
    pub base_fraction_dense: f32,
    /// The same, grown alone.
    pub base_fraction_isolated: f32,
}

/// A species' stem.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stem {
    /// Diameter at breast height by height.
    pub dbh: GrownEnvelope,
    /// Greatest diameter.
    pub max_trunk_diameter_m: f32,
}

/// A species' wood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wood {
    /// Density of air-dry wood.
    pub density_kg_m3: f32,
    /// Bending stress that breaks a green stem.
    pub modulus_of_rupture_pa: f32,
    /// Turning moment per mass of stem that uproots it (C of Peytavie 2024, Eq. 14), N m kg⁻¹.
    pub pulling_coefficient_nm_kg: f32,
}

/// What happens to a species' dead wood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decay {
    /// Years until a stem 50 cm thick is gone (δ of Peytavie 2024, Eq. 9, as their program ran it).
    pub deathspan_years: f32,
    /// How many times likelier its seedlings root on decaying wood than elsewhere (α of Peytavie 2024, Eq. 5).
    pub log_seeding_multiplier: f32,
    /// How well its heartwood resists decay.
    pub resistance: DecayResistance,
}

/// Resistance of heartwood to decay, in the four groups of the Wood Handbook (FPL-GTR-282, chapter 14).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DecayResistance {
    /// Slightly or not resistant.
    Slight,
    /// Moderately resistant.
    Moderate,
    /// Resistant.
    Resistant,
    /// Exceptionally resistant.
    VeryResistant,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_season_may_run_over_the_new_year() {
        let winter = GrowingSeason { first_month: 12, last_month: 5 };
        let grows: Vec<u8> = (1..=12).filter(|&m| winter.contains(m)).collect();
        assert_eq!((grows, winter.months()), (vec![1, 2, 3, 4, 5, 12], 6));
        let summer = GrowingSeason { first_month: 4, last_month: 10 };
        assert_eq!((1..=12).filter(|&m| summer.contains(m)).count(), 7);
        assert_eq!(summer.months(), 7);
    }

    #[test]
    fn every_season_counts_the_months_it_contains() {
        for first_month in 1..=12 {
            for last_month in 1..=12 {
                let season = GrowingSeason { first_month, last_month };
                let count = (1..=12).filter(|&m| season.contains(m)).count();
                assert_eq!(count, usize::from(season.months()));
            }
        }
    }
}
