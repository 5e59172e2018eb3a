//! Terrain: elevation on a metric grid, with its place on Earth.
//!
//! Reading order: [`import`] (from rasters to terrain), [`heights`] (units), [`framing`] (CRS and grid),
//! [`mosaic`] (tiles), [`onto_frame`] (resampling), [`spikes`], [`voids`]; [`cloud_import`] with [`point_cloud`] (from
//! points); [`generate`] (from nothing).

pub mod cloud_import;
pub mod framing;
pub mod generate;
pub mod heights;
pub mod import;
pub mod mosaic;
pub mod onto_frame;
pub mod point_cloud;
pub mod spikes;
pub mod voids;

use crate::raster::Grid;

/// Bare-earth elevation and what the sun needs to know of its place.
#[derive(Clone, Debug)]
pub struct Terrain {
    /// Metres above sea level; masked where unknown (sea, lakes, tile edges).
    pub elevation_m: Grid<f32>,
    /// Latitude of the middle, north positive.
    pub latitude_rad: f64,
    /// Angle from true north to grid north at the middle, clockwise positive; 0 for local metres.
    pub grid_convergence_rad: f64,
}
