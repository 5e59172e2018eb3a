//! Heights of files in metres: units, and what no height on Earth can be.

use std::path::Path;

use super::framing::check_affine;
use super::import::{ImportError, ImportParams};
use super::mosaic::{self, NamedRaster};
use crate::progress::{Reporter, Warning};
use crate::raster::{Crs, LengthUnit, Projection, SourceRaster};

/// Lowest and highest height taken for real, metres: the Dead Sea's shore (−430 m) and the highest summit, rounded
/// outward. What lies deeper is sea floor, where no forest stands.
const PLAUSIBLE_M: std::ops::RangeInclusive<f32> = -500.0..=9_000.0;
/// Values that programs write for nodata, in the file's unit; none is a height of land, exactly whole as it is.
/// −9999 is ESRI's, −32767 and −32768 are those of 16-bit files.
const USUAL_NODATA: [f32; 3] = [-9999.0, -32_767.0, -32_768.0];
/// At and below this a value is a nodata mark whatever its digits; the least `f32`, −3.4e38, is the most usual.
const NODATA_BELOW: f32 = -1e30;
/// Up to this share of implausible heights is masked, more is an error; chosen: stray cells, not a wrong unit.
const STRAY_FRACTION: f64 = 0.01;

/// Tiles upright, heights in metres and plausible; tiles without any height are left out.
///
/// The unit of height is the user's, else the file's, else the CRS's; else feet where coordinates are
/// feet (with a warning), else metres.
///
/// # Errors
/// [`ImportError`] for map positions and heights that cannot be, and if no tile has a height.
pub fn in_metres(
    tiles: Vec<NamedRaster>,
    crs: &Crs,
    params: &ImportParams,
    reporter: &Reporter,
) -> Result<Vec<NamedRaster>, ImportError> {
    let first_path = tiles.first().map(|tile| tile.path.clone());
    let projection = match crs {
        Crs::Local => None,
        _ => {
            let path = first_path.clone().unwrap_or_default();
            Some(Projection::new(crs).map_err(|source| ImportError::Crs { path, source })?)
        }
    };
    let local_unit = params.horizontal_unit.filter(|_| projection.is_none());
    let foot = match &projection {
        Some(projection) => projection.foot(),
        None => local_unit.filter(|unit| *unit != LengthUnit::Metre),
    };
    let stage = reporter.stage("read heights", tiles.len() as u64);
    let mut kept = Vec::with_capacity(tiles.len());
    for NamedRaster { path, mut raster } in tiles {
        reporter.check_cancelled()?;
        stage.advance(1);
        check_affine(&path, &raster.affine)?;
        if raster.non_finite_cells > 0 {
            let cells = raster.non_finite_cells;
            reporter.warn(Warning::NonFiniteCells { path: path.clone(), cells });
        }
        mask_usual_nodata(&path, &mut raster, reporter);
        if let Some(unit) = local_unit {
            scale_affine(&mut raster, unit.metres());
        }
        let named = params
            .vertical_unit
            .or(raster.vertical_unit)
            .or_else(|| projection.as_ref().and_then(Projection::vertical_unit));
        if let (None, Some(_)) = (named, foot) {
            reporter.warn(Warning::VerticalUnitAssumedFeet { path: path.clone() });
        }
        scale_heights(&mut raster, named.or(foot).unwrap_or(LengthUnit::Metre));
        mask_implausible(&path, &mut raster, reporter)?;
        if raster.valid.contains(&true) {
            kept.push(NamedRaster { path, raster: mosaic::upright(raster) });
        }
    }
    match first_path {
        None => Err(ImportError::NoTiles),
        Some(path) if kept.is_empty() => Err(ImportError::NoData { path }),
        Some(_) => Ok(kept),
    }
}

fn scale_affine(raster: &mut SourceRaster, metres: f64) {
    let a = &mut raster.affine;
    for number in [
        &mut a.origin_x,
        &mut a.origin_y,
        &mut a.col_dx,
        &mut a.col_dy,
        &mut a.row_dx,
        &mut a.row_dy,
    ] {
        *number *= metres;
    }
}

fn scale_heights(raster: &mut SourceRaster, unit: LengthUnit) {
    if unit == LengthUnit::Metre {
        return;
    }
    for value in &mut raster.values {
        *value = (f64::from(*value) * unit.metres()) as f32; // smaller than it was
    }
}

fn mask_implausible(
    path: &Path,
    raster: &mut SourceRaster,
    reporter: &Reporter,
) -> Result<(), ImportError> {
    let (mut cells, mut valid_cells) = (0, 0);
    let (mut lowest_m, mut highest_m) = (f32::INFINITY, f32::NEG_INFINITY);
    for (value, valid) in raster.values.iter_mut().zip(&mut raster.valid) {
        if *valid {
            valid_cells += 1;
            (lowest_m, highest_m) = (lowest_m.min(*value), highest_m.max(*value));
            if !PLAUSIBLE_M.contains(value) {
                cells += 1;
                (*value, *valid) = (0.0, false);
            }
        }
    }
    if cells as f64 > STRAY_FRACTION * valid_cells as f64 {
        return Err(ImportError::Heights { path: path.to_path_buf(), cells, lowest_m, highest_m });
    }
    if cells > 0 {
        let path = path.to_path_buf();
        reporter.warn(Warning::ImplausibleHeights { path, cells, lowest_m, highest_m });
    }
    Ok(())
}

/// Masks values that stand for nodata though the file does not say so.
fn mask_usual_nodata(path: &Path, raster: &mut SourceRaster, reporter: &Reporter) {
    let mut cells = 0;
    for (value, valid) in raster.values.iter_mut().zip(&mut raster.valid) {
        if *valid && (*value <= NODATA_BELOW || USUAL_NODATA.contains(value)) {
            (*value, *valid) = (0.0, false);
            cells += 1;
        }
    }
    if cells > 0 {
        reporter.warn(Warning::UndeclaredNodata { path: path.to_path_buf(), cells });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Affine;

    fn column(values: Vec<f32>) -> SourceRaster {
        let affine = Affine {
            origin_x: 1.0,
            origin_y: 2.0,
            col_dx: 10.0,
            col_dy: 0.0,
            row_dx: 0.0,
            row_dy: -10.0,
        };
        SourceRaster {
            rows: values.len(),
            cols: 1,
            affine,
            crs: None,
            vertical_unit: None,
            latitude_deg: None,
            crs_problem: None,
            valid: vec![true; values.len()],
            values,
            non_finite_cells: 0,
        }
    }

    #[test]
    fn feet_are_0_3048_metres_and_survey_feet_a_little_more() {
        let mut feet = column(vec![1000.0]);
        scale_heights(&mut feet, LengthUnit::Foot);
        assert_eq!(feet.values, [304.8]);
        let mut feet = column(vec![1000.0]);
        scale_heights(&mut feet, LengthUnit::UsSurveyFoot);
        assert!((feet.values[0] - 304.8006).abs() < 1e-4 && feet.values[0] != 304.8);
        let mut metres = column(vec![0.1]);
        scale_heights(&mut metres, LengthUnit::Metre);
        assert_eq!(metres.values, [0.1]);
        scale_affine(&mut metres, 0.5);
        assert_eq!((metres.affine.origin_y, metres.affine.row_dy), (1.0, -5.0));
    }

    #[test]
    fn issue_2_undeclared_nodata() {
        let import = |values: Vec<f32>, unit: Option<LengthUnit>| {
            let reporter = Reporter::silent();
            let tiles = vec![NamedRaster { path: "a.tif".into(), raster: column(values) }];
            let params = ImportParams { vertical_unit: unit, ..ImportParams::default() };
            let kept = in_metres(tiles, &Crs::Local, &params, &reporter);
            (kept.map(|mut kept| kept.remove(0).raster), reporter.warnings())
        };
        // half the raster, in feet too: −9999 ft are −3048 m
        for unit in [None, Some(LengthUnit::Foot)] {
            let marks = [-9999.0, -32_767.0, -32_768.0, f32::MIN, -1e30, 10.0, 20.0, 30.0];
            let (raster, warnings) = import(marks.to_vec(), unit);
            let valid = [false, false, false, false, false, true, true, true];
            assert_eq!(raster.unwrap().valid, valid);
            assert_eq!(warnings, [Warning::UndeclaredNodata { path: "a.tif".into(), cells: 5 }]);
        }
        // the shore of the Dead Sea is land, the sea floor is not
        assert!(import(vec![-430.0; 8], None).0.is_ok_and(|r| !r.valid.contains(&false)));
        assert!(matches!(import(vec![-600.0; 8], None).0, Err(ImportError::Heights { .. })));
        assert!(matches!(import(vec![-9999.0; 8], None).0, Err(ImportError::NoData { .. })));
    }

    #[test]
    fn a_stray_height_is_masked_and_many_are_refused() {
        let reporter = Reporter::silent();
        let mut few = column(vec![500.0; 200]);
        few.values[7] = -22_768.0;
        assert!(mask_implausible(Path::new("a"), &mut few, &reporter).is_ok());
        assert_eq!(few.valid.iter().filter(|v| !**v).count(), 1);
        assert_eq!((few.values[7], reporter.warnings().len()), (0.0, 1));
        let mut many = column(vec![500.0; 200]);
        many.values[..3].fill(12_000.0);
        let refused = mask_implausible(Path::new("a"), &mut many, &reporter);
        assert!(matches!(refused, Err(ImportError::Heights { cells: 3, .. })));
    }
}
