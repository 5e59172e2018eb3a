//! Archetypes: models that many plants share, one unit large, stretched to the size of each.

use super::mesh::{Material, Mesh};

/// Levels of detail: near, middle, far.
pub const LEVELS: usize = 3;

/// A model that many instances share.
///
/// Standing ones have their foot at the origin, are 1 high along z, and their crown has radius 1: an instance scales x and y
/// by its crown radius and z by its height. Stems reach a little below the foot, so that they stand in slopes. What has no crown (bare
/// snags, stumps) has radius 1 at its foot. Downed logs lie along x from their thick end at the origin, 1 long, their axis on z = 0, and
/// have diameter 1 at the thick end: an instance scales x by length, y and z by diameter.
#[derive(Clone, Debug)]
pub struct Archetype {
    /// Stable name, e.g. `silver-fir.tree.forest.s2`.
    pub key: String,
    /// Index of the species in the biome.
    pub species: u16,
    /// The same model in [`LEVELS`] levels of detail, the finest first.
    pub levels: [Mesh; LEVELS],
    /// Natural colours of its materials, sRGB, in the order of [`Material::ALL`].
    pub colors_srgb: [[u8; 3]; Material::ALL.len()],
}

impl Archetype {
    /// Natural colour of one of its materials, sRGB, before an instance's tint.
    pub fn color_srgb(&self, material: Material) -> [u8; 3] {
        self.colors_srgb[material as usize]
    }
}
