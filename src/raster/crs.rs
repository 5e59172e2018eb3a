//! Coordinate reference systems.

/// The coordinate reference system of map coordinates.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Crs {
    /// An entry of the EPSG registry.
    Epsg(u32),
    /// A PROJ string, for systems without an EPSG code. Inputs may have one; scenes never do.
    Proj(String),
    /// Metres in a plane of unknown place on Earth.
    Local,
}
