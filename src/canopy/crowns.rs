//! Crowns as spheres on a grid of working cells, in whole numbers, so that every machine sees the same crown.
//!
//! # Reference
//! Kapp et al. 2020, section 5.2: a crown is a sphere over the trunk whose apex is the tree's top.

/// Units in the width of a working cell. A radius stays below 2048 units: its square is then below 2²², where a square
/// root in `f32` rounds down to the exact whole root.
pub const UNITS_PER_CELL: i32 = 32;

/// Greatest radius in units.
pub const MAX_RADIUS_UNITS: i32 = 2047;

/// Crowns, struct of arrays; all lengths in units of 1/[`UNITS_PER_CELL`] of a working cell.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Crowns {
    /// From the grid's west edge eastward to the trunk.
    pub x: Vec<i32>,
    /// From the grid's north edge southward to the trunk.
    pub y: Vec<i32>,
    /// Radius of the sphere, 1..=[`MAX_RADIUS_UNITS`].
    pub radius: Vec<i32>,
    /// Elevation of the sphere's centre above a datum below the whole scene, within 0..2²⁴.
    pub center_z: Vec<i32>,
}

impl Crowns {
    /// Number of crowns.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }
}
