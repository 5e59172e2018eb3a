//! A measured canopy: the file of a canopy height model, checked before anything is written, then brought onto the scene.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::Error;
use crate::io::{Limits, ParseError, raster_file};
use crate::progress::{Reporter, Warning};
use crate::raster::{Crs, Frame, Grid, LengthUnit, SourceRaster};
use crate::terrain::import::Resampling;
use crate::terrain::onto_frame::registered;

/// Heights above this are no canopy. The tallest tree known is 116 m.
const MOST_CANOPY_HEIGHT_M: f32 = 120.0;
/// Share of such cells from which the raster is no canopy height model. chosen: towers and wires are fewer.
const MOST_TOO_HIGH_FRACTION: f64 = 0.01;
/// Heights below this are a mark of nodata that the file does not declare. chosen: no survey is that wrong.
const LEAST_CANOPY_HEIGHT_M: f32 = -100.0;
/// Heights below this are ground that the survey put too low, and any deeper ones no canopy.
/// chosen: differences of surveys are below 2 m.
const MOST_BELOW_GROUND_M: f32 = 2.0;
/// Where even the lowest hundredth of the land is higher than this, heights may be above sea level, m. chosen: a
/// closed forest shows some ground or low growth.
const MOST_LOWEST_M: f32 = 12.0;
/// A canopy height model this much finer than the scene loses what is averaged away. chosen: half a cell is no loss.
const FINER_FACTOR: f64 = 1.5;
/// Cells wider than this show no crowns, m.
const MOST_CELL_M: f64 = 5.0;
/// Share of the land without a measured canopy that is worth a warning. chosen: more than seams at the rim.
const WARN_UNMEASURED_FRACTION: f64 = 0.01;

/// A canopy height model as its file holds it, in metres above ground.
pub struct MeasuredCanopy {
    path: PathBuf,
    raster: SourceRaster,
}

impl MeasuredCanopy {
    /// Reads a canopy height model; `unit` is that of its heights where its header is silent or wrong.
    ///
    /// # Errors
    /// If it cannot be read, or holds no heights above ground.
    pub fn read(path: &Path, unit: Option<LengthUnit>, reporter: &Reporter) -> Result<Self, Error> {
        let mut raster = raster_file::read(path, None, &Limits::default())?;
        let named = path.display();
        if let (None, Some(problem)) = (&raster.crs, &raster.crs_problem) {
            let hint = "write it in the scene's CRS (gdalwarp -t_srs EPSG:n in.tif out.tif)";
            return Err(ParseError::new(problem.text.clone(), hint).at(path).into());
        }
        let say = |text: String| reporter.warn(Warning::Other { text });
        if let Some(unit) = unit.or(raster.vertical_unit) {
            let factor = unit.metres() as f32; // 1 or about 0.3
            raster.values.iter_mut().for_each(|height| *height *= factor);
        }
        let valid = || raster.values.iter().zip(&raster.valid).filter(|(_, valid)| **valid);
        let share = |test: &dyn Fn(f32) -> bool| {
            let cells = valid().filter(|(height, _)| test(**height)).count();
            (cells, cells as f64 / valid().count().max(1) as f64)
        };
        let (too_high_cells, too_high) = share(&|height| height > MOST_CANOPY_HEIGHT_M);
        if too_high > MOST_TOO_HIGH_FRACTION {
            let what = format!(
                "{named}: {:.0} % of the cells are higher than {MOST_CANOPY_HEIGHT_M} m; a canopy height model holds heights above ground: subtract the terrain if this is a surface model, or give --chm-unit ft",
                100.0 * too_high
            );
            return Err(Error::Usage { what });
        }
        let (_, low) = share(&|height| height <= MOST_LOWEST_M);
        if low < 0.01 && valid().count() > 0 {
            say(format!(
                "{named}: nearly no cell is lower than {MOST_LOWEST_M} m; a canopy height model holds heights above ground: subtract the terrain if this is a surface model"
            ));
        }
        let (below_cells, below) =
            share(&|height| (LEAST_CANOPY_HEIGHT_M..-MOST_BELOW_GROUND_M).contains(&height));
        if below > MOST_TOO_HIGH_FRACTION {
            say(format!(
                "{named}: {below_cells} cells lie more than {MOST_BELOW_GROUND_M} m below ground; they are taken for ground"
            ));
        }
        if too_high_cells > 0 {
            say(format!(
                "{named}: {too_high_cells} cells higher than {MOST_CANOPY_HEIGHT_M} m are left out"
            ));
        }
        for (height, valid) in raster.values.iter_mut().zip(&mut raster.valid) {
            *valid &= (LEAST_CANOPY_HEIGHT_M..=MOST_CANOPY_HEIGHT_M).contains(height);
            *height = if *valid { height.max(0.0) } else { 0.0 };
        }
        Ok(Self { path: path.to_owned(), raster })
    }

    /// The canopy on a scene's cells; `land` says which are masked.
    ///
    /// # Errors
    /// If it does not overlap the scene, or the run was cancelled.
    pub fn onto_scene(
        &self,
        frame: &Arc<Frame>,
        land: &[bool],
        reporter: &Reporter,
    ) -> Result<Grid<f32>, Error> {
        let (named, raster) = (self.path.display(), &self.raster);
        let say = |text: String| reporter.warn(Warning::Other { text });
        let crs = match (&raster.crs, &frame.crs) {
            (Some(crs), scene) if *crs != Crs::Local && *scene != Crs::Local => crs.clone(),
            (crs, scene) => {
                if crs.as_ref().is_some_and(|crs| crs != scene) || crs.is_none() {
                    say(format!("{named}: its coordinates are taken for the scene's ({scene})"));
                }
                scene.clone()
            }
        };
        let cell_m = f64::hypot(raster.affine.col_dx, raster.affine.col_dy);
        if crs == frame.crs && cell_m * FINER_FACTOR < frame.transform.cell_m {
            say(format!(
                "{named}: cells of {cell_m} m are averaged to the scene's {} m; give --cell {cell_m} to keep their detail",
                frame.transform.cell_m
            ));
        }
        if frame.transform.cell_m.max(if crs == frame.crs { cell_m } else { 0.0 }) > MOST_CELL_M {
            say(format!(
                "{named}: cells wider than {MOST_CELL_M} m show no crowns; trees are only as many as their crowns ask"
            ));
        }
        let chm_m = registered(raster, &crs, frame, Resampling::Auto, reporter)?;
        let is_measured = chm_m.mask().as_slice();
        let land_cells = land.iter().filter(|land| **land).count();
        let measured_cells = land.iter().zip(is_measured).filter(|(a, b)| **a && **b).count();
        if measured_cells == 0 {
            let what = format!("{named}: does not overlap the terrain; check its CRS and place");
            return Err(Error::Usage { what });
        }
        let unmeasured = 1.0 - measured_cells as f64 / land_cells.max(1) as f64;
        if unmeasured > WARN_UNMEASURED_FRACTION {
            say(format!(
                "{named}: {:.0} % of the land has no canopy height, and so no trees",
                100.0 * unmeasured
            ));
        }
        Ok(chm_m)
    }
}
