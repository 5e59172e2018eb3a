//! A raster as its file holds it, before it becomes terrain.

use super::{Crs, GeoTransform};

/// Map position of a raster as files give it; may be rotated, geographic, or have oblong cells.
///
/// x = origin_x + col·col_dx + row·row_dx, y = origin_y + col·col_dy + row·row_dy, where
/// integer (row, col) are **corners** of cells and + 0.5 their centres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    /// Map x of the first cell's outer corner.
    pub origin_x: f64,
    /// Map y of the first cell's outer corner.
    pub origin_y: f64,
    /// Step in x per column.
    pub col_dx: f64,
    /// Step in y per column; 0 unless rotated.
    pub col_dy: f64,
    /// Step in x per row; 0 unless rotated.
    pub row_dx: f64,
    /// Step in y per row; negative when rows run from the north.
    pub row_dy: f64,
}

impl From<&GeoTransform> for Affine {
    fn from(transform: &GeoTransform) -> Self {
        let GeoTransform { west_m, north_m, cell_m } = *transform;
        Self {
            origin_x: west_m,
            origin_y: north_m,
            col_dx: cell_m,
            col_dy: 0.0,
            row_dx: 0.0,
            row_dy: -cell_m,
        }
    }
}

/// A unit of length in file headers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub enum LengthUnit {
    /// Metre.
    Metre,
    /// International foot, 0.3048 m.
    Foot,
    /// US survey foot, 1200/3937 m.
    UsSurveyFoot,
}

impl LengthUnit {
    /// Metres in one unit.
    pub fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Foot => 0.3048,
            Self::UsSurveyFoot => 1200.0 / 3937.0,
        }
    }
}

/// Why the CRS that a file names is not understood.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CrsProblem {
    /// What is wrong, and what to do.
    pub text: String,
    /// Whether coordinates must not be taken as local metres instead: the file itself speaks, not one beside it.
    pub is_fatal: bool,
}

/// Values, place and units of a raster as read; row-major in the file's row order, first row first.
#[derive(Clone, Debug)]
pub struct SourceRaster {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
    /// Map position.
    pub affine: Affine,
    /// The CRS the file names, if any.
    pub crs: Option<Crs>,
    /// Why `crs` is `None` although the file names one.
    pub crs_problem: Option<CrsProblem>,
    /// The vertical unit the file names, if any.
    pub vertical_unit: Option<LengthUnit>,
    /// Latitude the file names outside any CRS (`.elv`), degrees north.
    pub latitude_deg: Option<f64>,
    /// Heights in the file's unit; 0 where invalid.
    pub values: Vec<f32>,
    /// Cells that hold a finite value other than nodata.
    pub valid: Vec<bool>,
    /// Cells that were NaN or infinite without being declared nodata.
    pub non_finite_cells: usize,
}
