//! Species map: which species stands where.
//!
//! # Reference
//! Kapp et al. 2020, section 5.1 and Eq. 1, doi:10.1145/3414685.3417848.

use crate::raster::Grid;

/// Cells where no species stands.
pub const NO_SPECIES: u8 = u8::MAX;

/// Index into the biome's species for each cell, [`NO_SPECIES`] where none can stand.
pub type SpeciesMap = Grid<u8>;
