//! Habits: what tells the kinds of trees apart from afar, by their genus.
//!
//! Species files hold sizes and shapes, not how branches grow or what colour bark has. Genera that forests of the shipped biomes are
//! made of are listed here; others get the habit of their kind of leaf.

use crate::species::{CrownShape, Leaf, Species};

/// How a crown is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CrownStyle {
    /// Tiers of branches around a straight stem.
    Tiers {
        /// How far tips hang below where branches leave the stem, as a share of their length; negative where they rise.
        droop: f32,
        /// How deep tiers are cut between branches, as a share of their reach.
        notch: f32,
        /// Thickness of a tier in distances between tiers.
        thickness: f32,
        /// Power of the distance from the top that reach grows with: 1 a cone, less a rounded top.
        roundness: f32,
        /// How unequal branches are: the share that the shortest lack.
        raggedness: f32,
    },
    /// Clumps of leaves at the ends of branches.
    Clumps {
        /// Number of clumps.
        count: usize,
        /// Radius of a clump in crown radii.
        size: f32,
        /// Height of a clump over its width.
        flatness: f32,
        /// How far clumps are scattered off the crown's outline: 0 a smooth dome, 1 ragged.
        looseness: f32,
    },
}

/// What one sees of a kind of tree from afar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Habit {
    /// How its crown is built.
    pub crown: CrownStyle,
    /// Bark, sRGB.
    pub bark_srgb: [u8; 3],
    /// Leaves in summer, sRGB.
    pub foliage_srgb: [u8; 3],
    /// How crooked its stem is, as a share of its height.
    pub crook: f32,
}

/// Habits by genus, sRGB colours of bark and of leaves in summer. chosen: after photographs in floras.
const GENERA: [(&str, Habit); 15] = [
    ("Abies", tiered([0.12, 0.34, 1.6, 0.9, 0.12], [112, 108, 100], [46, 74, 50])),
    ("Pseudotsuga", tiered([0.45, 0.46, 1.7, 0.8, 0.3], [92, 74, 60], [58, 82, 50])),
    ("Sequoia", tiered([0.22, 0.52, 0.95, 0.5, 0.5], [122, 74, 52], [54, 84, 48])),
    ("Picea", tiered([0.5, 0.38, 1.5, 1.0, 0.15], [104, 84, 72], [44, 68, 46])),
    ("Pinus", clumped([13.0, 0.36, 0.5, 0.8, 0.02], [126, 90, 66], [70, 92, 58])),
    ("Fagus", clumped([17.0, 0.40, 0.72, 0.25, 0.005], [142, 142, 136], [84, 118, 48])),
    ("Quercus", clumped([15.0, 0.38, 0.66, 0.55, 0.03], [104, 94, 82], [78, 104, 48])),
    ("Betula", clumped([15.0, 0.33, 1.15, 0.6, 0.015], [222, 220, 212], [112, 140, 62])),
    ("Arbutus", clumped([12.0, 0.38, 0.7, 0.6, 0.04], [168, 92, 56], [92, 120, 66])),
    ("Notholithocarpus", clumped([15.0, 0.38, 0.85, 0.35, 0.01], [112, 102, 90], [82, 108, 64])),
    ("Umbellularia", clumped([15.0, 0.36, 0.85, 0.35, 0.02], [106, 94, 80], [88, 116, 50])),
    ("Buxus", clumped([12.0, 0.42, 0.85, 0.3, 0.02], [136, 126, 104], [68, 92, 42])),
    ("Arctostaphylos", clumped([11.0, 0.38, 0.7, 0.5, 0.03], [122, 54, 40], [124, 142, 110])),
    ("Artemisia", clumped([12.0, 0.36, 0.9, 0.6, 0.02], [128, 116, 100], [144, 152, 128])),
    ("Adenostoma", clumped([12.0, 0.34, 1.1, 0.7, 0.02], [108, 86, 68], [94, 106, 58])),
];

const fn tiered(
    [droop, notch, thickness, roundness, raggedness]: [f32; 5],
    bark_srgb: [u8; 3],
    foliage_srgb: [u8; 3],
) -> Habit {
    let crown = CrownStyle::Tiers { droop, notch, thickness, roundness, raggedness };
    Habit { crown, bark_srgb, foliage_srgb, crook: 0.0 }
}

const fn clumped(
    [count, size, flatness, looseness, crook]: [f32; 5],
    bark_srgb: [u8; 3],
    foliage_srgb: [u8; 3],
) -> Habit {
    // small whole numbers
    let crown = CrownStyle::Clumps { count: count as usize, size, flatness, looseness };
    Habit { crown, bark_srgb, foliage_srgb, crook }
}

impl Habit {
    /// The habit of a species: its genus's, else that of its leaf, in a green near its map colour where that is one.
    pub fn of(species: &Species) -> Self {
        let genus = species.scientific_name.split_whitespace().next().unwrap_or("");
        if let Some((_, habit)) = GENERA.iter().find(|(name, _)| *name == genus) {
            return *habit;
        }
        let green = super::color::leaf_green(species);
        match (species.leaf, species.crown.shape) {
            (Leaf::Needle, CrownShape::Cone | CrownShape::Cylinder) => {
                tiered([0.25, 0.35, 1.5, 0.9, 0.2], [108, 88, 72], green)
            }
            (Leaf::Needle, _) => clumped([13.0, 0.36, 0.6, 0.7, 0.02], [118, 90, 70], green),
            (Leaf::Broad, _) => clumped([15.0, 0.38, 0.75, 0.4, 0.02], [112, 102, 90], green),
            (Leaf::Frond, _) => clumped([10.0, 0.4, 0.6, 0.5, 0.0], [96, 74, 52], green),
        }
    }
}
