//! Rasters onto a scene's frame: copied where cells coincide, resampled where not.

use std::sync::Arc;

use super::framing::{Lattice, Placement, lattice_of, target_of};
use super::import::{ImportError, ImportParams, Resampling};
use super::mosaic::{self, NamedRaster};
use super::spikes;
use crate::progress::{Cancelled, Reporter, Warning};
use crate::raster::resample::{Kernel, Samples};
use crate::raster::warp::{self, Source, Warped};
use crate::raster::{Crs, Frame, Grid, Mask, SourceRaster};

/// Cells that grow by more than this factor are averaged; chosen: below it the 4 × 4 cells of the
/// cubic cover the target cell, and averaging would blur.
const AVERAGE_FROM_FACTOR: f64 = 1.5;

/// A raster in `crs` drawn onto a scene's frame, such as a canopy height model onto its terrain's.
///
/// # Errors
/// If the CRS cannot be used, or the run was cancelled.
pub fn registered(
    raster: &SourceRaster,
    crs: &Crs,
    frame: &Arc<Frame>,
    resampling: Resampling,
    reporter: &Reporter,
) -> Result<Grid<f32>, ImportError> {
    let lattice = Lattice::of(raster);
    let placement = Placement::new(crs, lattice.middle())
        .map_err(|source| ImportError::Crs { path: crs.to_string().into(), source })?;
    let frame_lattice = lattice_of(frame);
    let offset = match placement.to_source {
        None => frame_lattice.offset_of(&lattice),
        Some(_) => None,
    };
    let layer = match offset {
        Some(offset) => mosaic::cut(raster.clone(), offset, &frame_lattice),
        None => resampled(raster, &placement, frame, resampling, reporter)?,
    };
    Ok(Grid::new(Arc::clone(frame), Arc::new(Mask::new(layer.valid)), layer.values))
}

/// All tiles on the scene's frame, the first named on top.
pub(super) fn on_frame(
    tiles: Vec<NamedRaster>,
    placement: &Placement,
    frame: &Frame,
    params: &ImportParams,
    reporter: &Reporter,
) -> Result<Warped, ImportError> {
    let (mut scene, mut spikes, mut disagreements) = (None::<Warped>, 0, 0);
    for group in mosaic::groups_on_one_lattice(tiles) {
        let [rows, cols] = mosaic::union_size(&group);
        if rows * cols > params.max_cells as f64 {
            return Err(ImportError::TooManyCells { rows, cols, max_cells: params.max_cells });
        }
        let (mut raster, disagreeing) = mosaic::join(group);
        disagreements += disagreeing;
        if params.remove_spikes {
            let cell_m =
                placement.cell_side_m(&Lattice::of(&raster)).unwrap_or(frame.transform.cell_m);
            spikes +=
                spikes::replace_spikes(raster.cols, cell_m, &mut raster.values, &raster.valid);
        }
        let frame_lattice = lattice_of(frame);
        let offset = match placement.to_source {
            None => frame_lattice.offset_of(&Lattice::of(&raster)),
            Some(_) => None,
        };
        let layer = match offset {
            Some(offset) => mosaic::cut(raster, offset, &frame_lattice),
            None => resampled(&raster, placement, frame, params.resampling, reporter)?,
        };
        match &mut scene {
            Some(above) => disagreements += mosaic::lay_under(above, &layer),
            None => scene = Some(layer),
        }
    }
    if spikes > 0 {
        reporter.warn(Warning::SpikesRemoved { cells: spikes });
    }
    if disagreements > 0 {
        reporter.warn(Warning::TilesDisagree { cells: disagreements });
    }
    scene.ok_or(ImportError::NoTiles)
}

fn resampled(
    raster: &SourceRaster,
    placement: &Placement,
    frame: &Frame,
    resampling: Resampling,
    reporter: &Reporter,
) -> Result<Warped, Cancelled> {
    let (target, to_source) = (target_of(frame), placement.to_source.as_ref());
    let factor = warp::source_cells_per_target_cell(&raster.affine, &target, to_source);
    let kernel = match resampling {
        Resampling::Bilinear => Kernel::Bilinear,
        Resampling::Auto if factor.is_some_and(|f| f > AVERAGE_FROM_FACTOR) => Kernel::Average,
        Resampling::Auto | Resampling::Bicubic => Kernel::Bicubic,
    };
    let samples = Samples::new(raster.rows, raster.cols, &raster.values, &raster.valid);
    let source = Source { samples, affine: raster.affine };
    warp::warp(&source, &target, to_source, kernel, reporter)
}
