//! Whatever GDAL reads: band 1 of any raster format. Built with `--features gdal`.

use std::path::Path;

use gdal::Dataset;
use gdal::errors::GdalError;
use gdal::spatial_ref::SpatialRef;

use super::geotiff::read::unit_by_name;
use super::raster_file::RasterHead;
use super::window;
use super::{Error, Limits, ParseError, wkt};
use crate::raster::MapWindow;
use crate::raster::{Affine, Crs, CrsProblem, LengthUnit, SourceRaster};

/// Band 1 of a raster, or the part of it that `window` (in the file's CRS) touches.
///
/// # Errors
/// If GDAL cannot read the file, it has no map position, or the limits are passed.
pub fn read(
    path: &Path,
    window: Option<&MapWindow>,
    limits: &Limits,
) -> Result<SourceRaster, Error> {
    if let Err(source) = std::fs::metadata(path) {
        return Err(Error::Read { path: path.to_path_buf(), source });
    }
    let dataset = Dataset::open(path).map_err(|e| refused(&e).at(path))?;
    raster(&dataset, window, limits).map_err(|e| e.at(path))
}

fn refused(error: &GdalError) -> ParseError {
    ParseError::new(format!("GDAL cannot read it: {error}"), "see whether gdalinfo reads it")
}

fn raster(
    dataset: &Dataset,
    window: Option<&MapWindow>,
    limits: &Limits,
) -> Result<SourceRaster, ParseError> {
    let (cols, rows) = dataset.raster_size();
    let affine = affine(dataset)?;
    window::check_affine(&affine, rows, cols)?;
    let range = window::cells(window, &affine, rows, cols, limits)?;
    let band = dataset.rasterband(1).map_err(|e| refused(&e))?;
    if band.color_table().is_some() {
        return Err(ParseError::new(
            "the file is a picture (colours or a palette), not elevations",
            "give the elevation raster itself, not its rendering",
        ));
    }

    // Cells; as f64, so that nodata compares exactly whatever the band's type
    let size = (range.cols.len(), range.rows.len());
    // both lie inside the raster, whose sides GDAL keeps below 2³¹
    let corner = (range.cols.start as isize, range.rows.start as isize);
    let (scale, offset) = (band.scale().unwrap_or(1.0), band.offset().unwrap_or(0.0));
    let nodata = band.no_data_value();
    // nodata values are compared below; masks and alpha bands lie apart
    let masks = band.mask_flags().map_err(|e| refused(&e))?;
    let mask = (masks.is_per_dataset() || masks.is_alpha()).then(|| band.open_mask_band());
    let mask = mask.transpose().map_err(|e| refused(&e))?;
    let mut values = vec![0.0_f32; range.len()];
    let mut valid = vec![false; range.len()];
    let mut non_finite_cells = 0;
    for row in 0..size.1 {
        let from = (corner.0, corner.1 + row as isize);
        let line =
            band.read_as::<f64>(from, (size.0, 1), (size.0, 1), None).map_err(|e| refused(&e))?;
        let shown = match &mask {
            Some(mask) => {
                let read = mask.read_as::<u8>(from, (size.0, 1), (size.0, 1), None);
                read.map_err(|e| refused(&e))?.data().to_vec()
            }
            None => vec![u8::MAX; size.0],
        };
        let cells = row * size.0..(row + 1) * size.0;
        let out = values[cells.clone()].iter_mut().zip(&mut valid[cells]);
        for ((stored, shown), (value, valid)) in line.data().iter().zip(shown).zip(out) {
            // f32 bands compare in their own precision: nodata is declared in decimals
            let is_nodata = nodata.is_some_and(|n| {
                *stored == n || *stored == f64::from(n as f32) || (n.is_nan() && stored.is_nan())
            });
            let height = (stored * scale + offset) as f32; // beyond f32: infinite, caught below
            if is_nodata || shown == 0 {
            } else if height.is_finite() {
                (*value, *valid) = (height, true);
            } else {
                non_finite_cells += 1;
            }
        }
    }
    let (crs, crs_problem, crs_unit) = reference(dataset);
    window::require_valid(SourceRaster {
        rows: size.1,
        cols: size.0,
        affine: window::shifted(&affine, range.rows.start as f64, range.cols.start as f64),
        crs,
        crs_problem,
        vertical_unit: unit_by_name(&band.unit()).or(crs_unit),
        latitude_deg: None,
        values,
        valid,
        non_finite_cells,
    })
}

/// The horizontal CRS, why there is none although the file names one, and the unit of heights of a compound CRS.
fn reference(dataset: &Dataset) -> (Option<Crs>, Option<CrsProblem>, Option<LengthUnit>) {
    let Ok(reference) = dataset.spatial_ref() else { return (None, None, None) };
    if reference.is_local() {
        return (None, None, None);
    }
    let (named, unit) = reference.to_wkt().map_or((None, None), |text| wkt::parse(&text));
    let crs = named.or_else(|| {
        reference.to_proj4().ok().filter(|text| !text.trim().is_empty()).map(Crs::of_proj)
    });
    let problem = crs.is_none().then(|| CrsProblem {
        text: "the file names a CRS that is not understood; give the CRS yourself: --crs EPSG:n"
            .into(),
        is_fatal: true,
    });
    (crs, problem, unit)
}

/// Size and place that GDAL tells of a file; no cell is read.
///
/// # Errors
/// If GDAL cannot read the file, or it has no map position.
pub fn head(path: &Path) -> Result<RasterHead, Error> {
    let dataset = Dataset::open(path).map_err(|e| refused(&e).at(path))?;
    let (cols, rows) = dataset.raster_size();
    let affine = affine(&dataset).map_err(|e| e.at(path))?;
    let (crs, problem, _) = reference(&dataset);
    let crs = if problem.is_some() { None } else { Some(crs.unwrap_or(Crs::Local)) };
    Ok(RasterHead { rows, cols, affine, crs })
}

fn affine(dataset: &Dataset) -> Result<Affine, ParseError> {
    let [origin_x, col_dx, row_dx, origin_y, col_dy, row_dy] =
        dataset.geo_transform().map_err(|_| {
            ParseError::new(
                "the raster has no map position",
                "add one, e.g. with gdal_translate -a_srs EPSG:n -a_ullr WEST NORTH EAST SOUTH",
            )
        })?;
    Ok(Affine { origin_x, origin_y, col_dx, col_dy, row_dx, row_dy })
}

#[cfg(test)]
mod tests {
    use super::*;
    use gdal::DriverManager;
    use gdal::raster::Buffer;

    #[test]
    fn an_erdas_image_is_read_whole_and_in_part() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("terrain.img");
        {
            let driver = DriverManager::get_driver_by_name("HFA").unwrap();
            let mut dataset = driver.create_with_band_type::<f32, _>(&path, 3, 2, 1).unwrap();
            dataset.set_geo_transform(&[500_000.0, 2.0, 0.0, 5_000_000.0, 0.0, -2.0]).unwrap();
            dataset.set_spatial_ref(&SpatialRef::from_epsg(32633).unwrap()).unwrap();
            let mut band = dataset.rasterband(1).unwrap();
            band.set_no_data_value(Some(-9999.0)).unwrap();
            let cells = vec![1.0_f32, 2.0, 3.0, 4.0, -9999.0, f32::NAN];
            band.write((0, 0), (3, 2), &mut Buffer::new((3, 2), cells)).unwrap();
        }
        let whole = read(&path, None, &Limits::default()).unwrap();
        assert_eq!(whole.values, [1.0, 2.0, 3.0, 4.0, 0.0, 0.0]);
        assert_eq!(whole.valid, [true, true, true, true, false, false]);
        assert_eq!((whole.non_finite_cells, whole.crs), (1, Some(Crs::Epsg(32633))));

        let window = MapWindow { west: 500_002.5, south: 4_999_998.5, east: 500_009.0, north: 5e6 };
        let part = read(&path, Some(&window), &Limits::default()).unwrap();
        assert_eq!((part.values, part.affine.origin_x), (vec![2.0, 3.0], 500_002.0));
    }

    #[test]
    fn issue_2_masks_and_compound_crs_are_honoured() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("masked.tif");
        {
            let driver = DriverManager::get_driver_by_name("GTiff").unwrap();
            let mut dataset = driver.create_with_band_type::<f32, _>(&path, 2, 1, 1).unwrap();
            dataset.set_geo_transform(&[500_000.0, 2.0, 0.0, 5_000_000.0, 0.0, -2.0]).unwrap();
            // NAD83 / UTM 10N with heights over NAVD88 in US survey feet
            dataset
                .set_spatial_ref(&SpatialRef::from_definition("EPSG:26910+6360").unwrap())
                .unwrap();
            let mut band = dataset.rasterband(1).unwrap();
            band.write((0, 0), (2, 1), &mut Buffer::new((2, 1), vec![1.0_f32, 2.0])).unwrap();
            band.create_mask_band(true).unwrap();
            let mut mask = band.open_mask_band().unwrap();
            mask.write((0, 0), (2, 1), &mut Buffer::new((2, 1), vec![255_u8, 0])).unwrap();
        }
        let raster = read(&path, None, &Limits::default()).unwrap();
        assert_eq!(raster.valid, [true, false]);
        assert_eq!(raster.crs, Some(Crs::Epsg(26910)));
        assert_eq!(raster.vertical_unit, Some(LengthUnit::UsSurveyFoot));
    }

    #[test]
    fn other_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notes.txt");
        std::fs::write(&path, "no raster").unwrap();
        assert!(matches!(read(&path, None, &Limits::default()), Err(Error::Content { .. })));
        let missing = read(&folder.path().join("none.img"), None, &Limits::default());
        assert!(matches!(missing, Err(Error::Read { .. })));
    }
}
