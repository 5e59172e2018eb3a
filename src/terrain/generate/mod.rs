//! A landscape of its own: ridges, valleys and a river, for demonstrations and tests without data.
//!
//! Reading order: `landscape` (from coarse cells to the finest), `plan` (the large forms), `drainage` (where water
//! runs), `erosion` (what it carves), `valley` (the river's floor and bed), `noise`, `extent`.

mod drainage;
mod erosion;
pub(crate) mod extent;
mod landscape;
pub(crate) mod noise;
mod plan;
mod valley;

use std::sync::Arc;

use crate::progress::{Cancelled, Reporter};
use crate::raster::{Frame, Grid, Mask};
use crate::terrain::Terrain;

/// What a generated landscape is to be like.
#[derive(Clone, Debug, PartialEq)]
pub struct GenerateParams {
    /// Number of rows, at least 1.
    pub rows: usize,
    /// Number of columns, at least 1.
    pub cols: usize,
    /// Cell width.
    pub cell_m: f64,
    /// Another seed, another landscape.
    pub seed: u64,
    /// Height of the highest cell above the lowest.
    pub relief_m: f32,
    /// Altitude of the lowest cell, where the river leaves.
    pub lowest_m: f32,
    /// Latitude of the middle, degrees north.
    pub latitude_deg: f64,
}

impl Default for GenerateParams {
    /// About 1 km² of hills at 2 m, as airborne LiDAR would see them.
    fn default() -> Self {
        Self {
            rows: 512,
            cols: 512,
            cell_m: 2.0,
            seed: 1,
            relief_m: 250.0,
            lowest_m: 200.0,
            latitude_deg: 45.0,
        }
    }
}

/// A terrain with dendritic valleys and one main river that leaves the map, in local metres.
/// Equal parameters give equal bits, whatever the number of threads.
///
/// ```
/// use wildwood::progress::Reporter;
/// use wildwood::terrain::generate::{GenerateParams, generate};
///
/// let hills = GenerateParams { rows: 40, cols: 60, relief_m: 30.0, ..Default::default() };
/// let terrain = generate(&hills, &Reporter::silent())?;
/// let (lowest_m, highest_m) = terrain.elevation_m.range().ok_or("no cells")?;
/// assert!((highest_m - lowest_m - 30.0).abs() < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
///
/// # Panics
/// If rows or columns are 0, or the cell width is not a positive number.
pub fn generate(params: &GenerateParams, reporter: &Reporter) -> Result<Terrain, Cancelled> {
    assert!(params.rows > 0 && params.cols > 0, "a landscape without cells");
    assert!(params.cell_m > 0.0 && params.cell_m.is_finite(), "cell width {}", params.cell_m);
    let frame = Arc::new(Frame::local(params.rows, params.cols, params.cell_m));
    let heights = landscape::heights_m(params, reporter)?;
    let mask = Arc::new(Mask::all_valid(frame.len()));
    Ok(Terrain {
        elevation_m: Grid::new(frame, mask, heights),
        latitude_rad: params.latitude_deg.to_radians(),
        grid_convergence_rad: 0.0,
    })
}
