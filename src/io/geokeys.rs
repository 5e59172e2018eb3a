//! GeoTIFF keys: the coordinate reference system of GeoTIFF rasters and LAS clouds.

use super::ParseError;
use crate::raster::{Crs, LengthUnit};

/// What GeoTIFF keys say of place.
#[derive(Clone, Debug, PartialEq)]
pub struct GeoReference {
    /// The CRS the keys name, if any.
    pub crs: Option<Crs>,
    /// The vertical unit the keys name, if any.
    pub vertical_unit: Option<LengthUnit>,
    /// Whether raster positions are cell centres.
    pub pixel_is_point: bool,
}

/// Reads a key directory with its doubles and text.
///
/// # Errors
/// If the directory is shorter than it says.
pub fn parse(
    directory: &[u16],
    _doubles: &[f64],
    _ascii: &str,
) -> Result<GeoReference, ParseError> {
    let mut found = GeoReference { crs: None, vertical_unit: None, pixel_is_point: false };
    let count = usize::from(directory.get(3).copied().unwrap_or(0));
    if directory.len() < 4 * (count + 1) {
        return Err(ParseError::new(
            "the GeoTIFF key directory is shorter than it says",
            "rewrite the file with GDAL or PDAL",
        ));
    }
    let mut geographic = None;
    for key in directory[4..].chunks_exact(4).take(count).filter(|key| key[1] == 0) {
        match (key[0], key[3]) {
            (1025, 2) => found.pixel_is_point = true,
            (2048, code) if code < 32767 => geographic = Some(Crs::Epsg(code.into())),
            (3072, code) if code < 32767 => found.crs = Some(Crs::Epsg(code.into())),
            (4099, 9001) => found.vertical_unit = Some(LengthUnit::Metre),
            (4099, 9002) => found.vertical_unit = Some(LengthUnit::Foot),
            (4099, 9003) => found.vertical_unit = Some(LengthUnit::UsSurveyFoot),
            _ => {}
        }
    }
    found.crs = found.crs.or(geographic);
    Ok(found)
}
