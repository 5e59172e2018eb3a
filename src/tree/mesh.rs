//! Triangles of a model, sorted by material.

/// What a surface is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Material {
    /// Bark of stems and branches.
    Bark,
    /// Leaves and needles, in the colour of the species.
    Foliage,
    /// Bare wood of snags, downed logs and breaks.
    Wood,
    /// Soil that a root plate holds.
    Soil,
}

impl Material {
    /// Every material, in the order of their numbers.
    pub const ALL: [Self; 4] = [Self::Bark, Self::Foliage, Self::Wood, Self::Soil];

    /// The material's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bark => "bark",
            Self::Foliage => "foliage",
            Self::Wood => "wood",
            Self::Soil => "soil",
        }
    }
}

/// A model's surface of one material. Triangles wind counter-clockwise seen from outside.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshPart {
    /// What it is made of.
    pub material: Material,
    /// Places of vertices: x east, y north, z up, in units of the model.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals of vertices.
    pub normals: Vec<[f32; 3]>,
    /// Indices of three vertices each.
    pub triangles: Vec<[u32; 3]>,
}

/// A model's surface, a part a material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Its parts, each material at most once.
    pub parts: Vec<MeshPart>,
}

impl Mesh {
    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.parts.iter().map(|part| part.triangles.len()).sum()
    }
}
