//! Rasters of numbers that name things onto a scene's frame: each cell takes the value its centre lies in.

use std::path::Path;

use super::Error;
use crate::io::{Limits, ParseError, raster_file};
use crate::progress::{Reporter, Warning};
use crate::raster::resample::{Kernel, Samples};
use crate::raster::warp::{self, Source, Warped};
use crate::raster::{Crs, Frame, Projector, SourceRaster};
use crate::terrain::framing::{check_affine, target_of};

/// The values of a raster file at the centres of the frame's cells.
///
/// A file that names no CRS is taken to be in the scene's, with a warning; so is any file for a scene in local metres.
///
/// # Errors
/// If the file cannot be read, or its CRS not be used.
pub(super) fn read_nearest(
    path: &Path,
    frame: &Frame,
    limits: &Limits,
    reporter: &Reporter,
) -> Result<Warped, Error> {
    nearest_of(path, &raster_file::read(path, None, limits)?, frame, reporter)
}

/// The same of a raster that was read before; `path` names it in errors.
pub(super) fn nearest_of(
    path: &Path,
    raster: &SourceRaster,
    frame: &Frame,
    reporter: &Reporter,
) -> Result<Warped, Error> {
    if let (None, Some(problem)) = (&raster.crs, &raster.crs_problem) {
        let hint = "write it in the scene's CRS (gdalwarp -t_srs EPSG:n -r near in.tif out.tif)";
        return Err(ParseError::new(problem.text.clone(), hint).at(path).into());
    }
    check_affine(path, &raster.affine)?;
    let to_source = projector(path, &frame.crs, raster.crs.as_ref(), &frame.crs, reporter)?;
    let samples = Samples::new(raster.rows, raster.cols, &raster.values, &raster.valid);
    let source = Source { samples, affine: raster.affine };
    let target = target_of(frame);
    Ok(warp::warp(&source, &target, to_source.as_ref(), Kernel::Nearest, reporter)?)
}

/// What takes points from the scene's CRS to a file's (`from` is the scene's) or back; `None` where they are the same.
pub(super) fn projector(
    path: &Path,
    from: &Crs,
    of_file: Option<&Crs>,
    scene: &Crs,
    reporter: &Reporter,
) -> Result<Option<Projector>, Error> {
    let of_file = match of_file {
        Some(crs) if crs != &Crs::Local && scene != &Crs::Local => crs,
        Some(crs) if crs == scene => return Ok(None),
        Some(crs) => {
            let text = format!(
                "{}: it is in {crs}, the scene in {scene}; its coordinates are taken for the scene's",
                path.display()
            );
            reporter.warn(Warning::Other { text });
            return Ok(None);
        }
        None => {
            let text =
                format!("{}: it names no CRS; the scene's, {scene}, is assumed", path.display());
            reporter.warn(Warning::Other { text });
            return Ok(None);
        }
    };
    if of_file == scene {
        return Ok(None);
    }
    let to = if from == scene { of_file } else { scene };
    let projector = Projector::new(from, to);
    let what = |e| Error::Usage { what: format!("{}: {e}", path.display()) };
    projector.map(Some).map_err(what)
}
