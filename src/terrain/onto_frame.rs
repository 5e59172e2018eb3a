//! Rasters onto a scene's frame: copied where cells coincide, resampled where not.

use std::sync::Arc;

use super::framing::{Lattice, Placement, lattice_of, target_of};
use super::import::{ImportError, ImportParams, Resampling};
use super::mosaic::{self, NamedRaster};
use super::spikes;
use crate::progress::{Cancelled, Reporter, Warning};
use crate::raster::resample::{Kernel, Samples};
use crate::raster::warp::{self, Source, Warped};
use crate::raster::{Crs, Frame, Grid, Mask, Projector, SourceRaster};

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
    let to_source = (frame.crs != *crs)
        .then(|| Projector::new(&frame.crs, crs))
        .transpose()
        .map_err(|source| ImportError::Crs { path: crs.to_string().into(), source })?;
    let frame_lattice = lattice_of(frame);
    let offset = match to_source {
        None => frame_lattice.offset_of(&lattice),
        Some(_) => None,
    };
    let layer = match offset {
        Some(offset) => mosaic::cut(raster.clone(), offset, &frame_lattice),
        None => resampled(raster, to_source.as_ref(), frame, resampling, reporter)?,
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
            None => {
                let to_source = placement.to_source.as_ref();
                resampled(&raster, to_source, frame, params.resampling, reporter)?
            }
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
    to_source: Option<&Projector>,
    frame: &Frame,
    resampling: Resampling,
    reporter: &Reporter,
) -> Result<Warped, Cancelled> {
    let target = target_of(frame);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::{Affine, GeoTransform, LengthUnit};

    /// A raster of zone 32 beside the border belongs onto a frame of zone 33 where its neighbour lies there.
    #[test]
    fn issue_2_registered_takes_the_frames_crs() {
        let (from, to) = (Crs::Epsg(32632), Crs::Epsg(32633));
        let middle = Projector::new(&to, &from).unwrap().project([275_000.0, 5_200_000.0]).unwrap();
        let affine = Affine {
            origin_x: middle[0] - 500.0,
            origin_y: middle[1] + 500.0,
            col_dx: 10.0,
            col_dy: 0.0,
            row_dx: 0.0,
            row_dy: -10.0,
        };
        let raster = SourceRaster {
            rows: 100,
            cols: 100,
            affine,
            crs: Some(from.clone()),
            vertical_unit: Some(LengthUnit::Metre),
            latitude_deg: None,
            crs_problem: None,
            values: vec![7.0; 10_000],
            valid: vec![true; 10_000],
            non_finite_cells: 0,
        };
        let transform = GeoTransform { west_m: 274_900.0, north_m: 5_200_100.0, cell_m: 10.0 };
        let frame = Arc::new(Frame { rows: 20, cols: 20, transform, crs: to });
        let reporter = Reporter::silent();
        let grid = registered(&raster, &from, &frame, Resampling::Auto, &reporter).unwrap();
        assert!(grid.mask().is_all_valid());
        assert!(grid.values().iter().all(|v| (v - 7.0).abs() < 1e-4));
    }
}
