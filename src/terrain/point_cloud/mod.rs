//! Ground and canopy surfaces of a classified point cloud.
//!
//! Reading order: [`Params`] and [`surfaces`] here, `layout` (the grid), `ground` (which ground points count),
//! `triangulation` (points to DEM), `canopy` (highest returns to DSM and CHM), [`synthetic`] (a made-up cloud).

mod canopy;
mod ground;
mod layout;
pub mod synthetic;
mod triangulation;

use std::sync::Arc;

use crate::io::las::PointCloud;
use crate::progress::{Cancelled, Reporter};
use crate::raster::{Crs, Grid};

/// How a cloud becomes surfaces.
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    /// Cell width, m; `None` takes the smallest of 0.5, 1, 2, 5, 10 m that holds two points on average
    /// (where there are points at all).
    pub cell_m: Option<f64>,
    /// Widest empty disk, m across, over which ground is interpolated.
    /// Default 40, chosen: the ground under closed canopy is hit every few metres and roofs of houses
    /// are narrower, lakes without returns are mostly wider.
    pub max_gap_m: f64,
    /// Returns higher above ground than this, m, are birds or clouds.
    /// Default 120, chosen: the tallest tree on Earth stands 116 m.
    pub max_canopy_height_m: f32,
    /// Most cells of the grid.
    pub max_cells: usize,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            cell_m: None,
            max_gap_m: 40.0,
            max_canopy_height_m: 120.0,
            max_cells: crate::io::Limits::default().max_cells,
        }
    }
}

/// Surfaces of a cloud on one frame; each has its own mask.
#[derive(Clone, Debug)]
pub struct CloudSurfaces {
    /// Bare earth, m; masked in voids wider than [`Params::max_gap_m`] and outside the points.
    pub dem: Grid<f32>,
    /// Highest return, m, buildings and wires included; masked where there are none nearby.
    pub dsm: Grid<f32>,
    /// Canopy height above the DEM, m, ≥ 0; buildings, wires and bridges count as no canopy.
    pub chm: Grid<f32>,
}

/// Why a cloud gives no surfaces.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum Error {
    /// No ground class.
    #[error(
        "none of the cloud's {points} points is classed as ground (class 2); classify it first (`pdal ground in.laz out.laz`, or LAStools `lasground`), or give a DEM"
    )]
    NoGround { points: usize },
    /// Ground points, but no surface.
    #[error(
        "the cloud's {ground_points} ground points lie too far apart for a surface; raise the largest gap above {max_gap_m} m, or give a DEM"
    )]
    GroundTooSparse { ground_points: usize, max_gap_m: f64 },
    /// No points.
    #[error("the cloud has no points; give another, or check --bbox")]
    NoPoints,
    /// Too many cells.
    #[error(
        "the cloud spans {width_m:.0} × {height_m:.0} m, {cells} cells of {cell_m} m, more than the limit of {max_cells}; give --bbox or a larger --cell, and check it for points far off"
    )]
    TooLarge { width_m: f64, height_m: f64, cells: u64, cell_m: f64, max_cells: usize },
    /// A parameter out of its range.
    #[error("{name} must be a positive number of metres, not {value}; leave it out for the default")]
    Parameter { name: &'static str, value: f64 },
    /// The run was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// DEM, DSM and CHM of a cloud whose coordinates are metres (see [`PointCloud::to_metres`]) of `crs`.
///
/// The grid's edges are multiples of its cell in map coordinates, so grids of neighbouring clouds fit.
///
/// # Errors
/// If the cloud has no points or no ground, spans too much, or the run was cancelled.
pub fn surfaces(
    cloud: &PointCloud,
    crs: Crs,
    params: &Params,
    reporter: &Reporter,
) -> Result<CloudSurfaces, Error> {
    for (name, value) in [
        ("the cell", params.cell_m.unwrap_or(1.0)),
        ("the largest gap", params.max_gap_m),
        ("the largest canopy height", f64::from(params.max_canopy_height_m)),
    ] {
        if !(value.is_finite() && value > 0.0) {
            return Err(Error::Parameter { name, value });
        }
    }
    let frame = Arc::new(layout::frame(cloud, crs, params)?);
    let ground = ground::points(cloud, &frame, reporter)?;
    let dem = triangulation::interpolate(&ground, &frame, params.max_gap_m, reporter)?;
    if dem.mask().valid_count() == 0 {
        let (ground_points, max_gap_m) = (ground.len(), params.max_gap_m);
        return Err(Error::GroundTooSparse { ground_points, max_gap_m });
    }
    reporter.check_cancelled()?;
    let (dsm, chm) = canopy::surfaces(cloud, &dem, params.max_canopy_height_m, reporter);
    Ok(CloudSurfaces { dem, dsm, chm })
}
