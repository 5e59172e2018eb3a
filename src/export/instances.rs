//! Instances: every plant, snag and downed log as an archetype, a place, a turn and a size. What 3D formats are written from.

use crate::tree::archetype::Archetype;

/// The table that a row is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FeatureTable {
    /// Live plants.
    Plants,
    /// Snags.
    Snags,
    /// Downed logs.
    DownedLogs,
}

impl FeatureTable {
    /// The table's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plants => "plants",
            Self::Snags => "snags",
            Self::DownedLogs => "downed_logs",
        }
    }
}

/// All instances of an archetype: one entry of each array an instance, in the order of the table's rows.
#[derive(Clone, Debug, PartialEq)]
pub struct InstanceGroup {
    /// Index into [`Instances::archetypes`].
    pub archetype: usize,
    /// The table that `row` counts in.
    pub table: FeatureTable,
    /// Row of the feature in its table.
    pub row: Vec<u32>,
    /// Metres east, north and up from [`Instances::origin`].
    pub position_m: Vec<[f32; 3]>,
    /// Turn, a unit quaternion x, y, z, w.
    pub rotation: Vec<[f32; 4]>,
    /// Factors of the archetype's x, y and z, before the turn.
    pub scale: Vec<[f32; 3]>,
    /// What the colours of its materials are multiplied with, sRGB; 255 leaves them as they are.
    pub tint_srgb: Vec<[u8; 3]>,
}

/// A forest as instances.
#[derive(Clone, Debug, Default)]
pub struct Instances {
    /// Map coordinates and elevation that positions count from.
    pub origin: [f64; 3],
    /// Models.
    pub archetypes: Vec<Archetype>,
    /// Who stands where, at most one group an archetype and table.
    pub groups: Vec<InstanceGroup>,
}

impl Instances {
    /// Number of instances.
    pub fn len(&self) -> usize {
        self.groups.iter().map(|group| group.row.len()).sum()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
