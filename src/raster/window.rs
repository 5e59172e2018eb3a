//! Rectangles on the map.

/// A rectangle in map coordinates, in the unit of its CRS: metres in a scene, what the header says in a file.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct MapWindow {
    /// Western edge.
    pub west: f64,
    /// Southern edge.
    pub south: f64,
    /// Eastern edge.
    pub east: f64,
    /// Northern edge.
    pub north: f64,
}

impl MapWindow {
    /// What two windows share, `None` if nothing.
    pub fn intersection(&self, other: &Self) -> Option<Self> {
        let shared = Self {
            west: self.west.max(other.west),
            south: self.south.max(other.south),
            east: self.east.min(other.east),
            north: self.north.min(other.north),
        };
        (shared.west < shared.east && shared.south < shared.north).then_some(shared)
    }

    /// The smallest window around two.
    pub fn union(&self, other: &Self) -> Self {
        Self {
            west: self.west.min(other.west),
            south: self.south.min(other.south),
            east: self.east.max(other.east),
            north: self.north.max(other.north),
        }
    }

    /// Width by height, in square units of the CRS.
    pub fn area(&self) -> f64 {
        (self.east - self.west) * (self.north - self.south)
    }

    /// The window's middle, `[east, north]`.
    pub fn middle(&self) -> [f64; 2] {
        [(self.west + self.east) / 2.0, (self.south + self.north) / 2.0]
    }
}

impl std::fmt::Display for MapWindow {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.1},{:.1},{:.1},{:.1}", self.west, self.south, self.east, self.north)
    }
}
