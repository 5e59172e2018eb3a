//! The part of a raster somebody asked for, as a map rectangle and as rows and columns.

use std::ops::Range;

use super::{Limits, ParseError, ParseErrorKind};
use crate::raster::{Affine, MapWindow, SourceRaster};

/// Rows and columns of a raster.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CellWindow {
    pub(super) rows: Range<usize>,
    pub(super) cols: Range<usize>,
}

impl CellWindow {
    /// Number of cells; a window lies inside a raster whose size was checked.
    pub(super) fn len(&self) -> usize {
        self.rows.len() * self.cols.len()
    }
}

/// Share of a cell that a window may reach into before the cell counts: decimal edges are not exact.
const EDGE_TOLERANCE_CELLS: f64 = 1e-6;

/// The affine with its origin moved to the corner of cell (`row`, `col`).
pub(super) fn shifted(affine: &Affine, row: f64, col: f64) -> Affine {
    Affine {
        origin_x: affine.origin_x + col * affine.col_dx + row * affine.row_dx,
        origin_y: affine.origin_y + col * affine.col_dy + row * affine.row_dy,
        ..*affine
    }
}

/// # Errors
/// If the affine is not finite, or squeezes cells to nothing.
pub(super) fn check_affine(affine: &Affine, rows: usize, cols: usize) -> Result<(), ParseError> {
    let a = affine;
    let far = shifted(a, rows as f64, cols as f64);
    let numbers = [
        a.origin_x,
        a.origin_y,
        a.col_dx,
        a.col_dy,
        a.row_dx,
        a.row_dy,
        far.origin_x,
        far.origin_y,
    ];
    let area = a.col_dx * a.row_dy - a.row_dx * a.col_dy;
    if numbers.iter().any(|n| !n.is_finite()) || !area.is_normal() {
        return Err(ParseError::new(
            "the cell size or the map position is zero or not a number",
            "set it anew, e.g. with gdal_translate -a_ullr WEST NORTH EAST SOUTH",
        ));
    }
    Ok(())
}

/// The cells that `window` touches; all of them without a window.
///
/// # Errors
/// If the raster is empty, the window misses it, or the cells are more than the limit.
pub(super) fn cells(
    window: Option<&MapWindow>,
    affine: &Affine,
    rows: usize,
    cols: usize,
    limits: &Limits,
) -> Result<CellWindow, ParseError> {
    if rows == 0 || cols == 0 {
        return Err(ParseError::new(
            format!("the raster has no cells ({cols} × {rows})"),
            "give another file",
        ));
    }
    let range = match window {
        None => CellWindow { rows: 0..rows, cols: 0..cols },
        Some(window) => touched(window, affine, rows, cols)?,
    };
    match range.rows.len().checked_mul(range.cols.len()) {
        Some(len) if len <= limits.max_cells => Ok(range),
        _ => Err(ParseError::new(
            format!(
                "{} × {} cells are more than the limit of {}",
                range.cols.len(),
                range.rows.len(),
                limits.max_cells
            ),
            "ask for a part of it (--bbox WEST,SOUTH,EAST,NORTH), or resample it with gdalwarp -tr",
        )),
    }
}

fn touched(
    window: &MapWindow,
    affine: &Affine,
    rows: usize,
    cols: usize,
) -> Result<CellWindow, ParseError> {
    let MapWindow { west, south, east, north } = *window;
    let ordered = west < east && south < north;
    if !ordered || [west, south, east, north].iter().any(|v| !v.is_finite()) {
        return Err(ParseError::new(
            format!("the window {west},{south},{east},{north} is empty"),
            "give it as WEST,SOUTH,EAST,NORTH in the file's CRS",
        ));
    }
    // Grid coordinates of the window's corners, by the affine's inverse
    let a = affine;
    let area = a.col_dx * a.row_dy - a.row_dx * a.col_dy;
    let (mut least, mut most) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for (x, y) in [(west, south), (west, north), (east, south), (east, north)] {
        let (dx, dy) = (x - a.origin_x, y - a.origin_y);
        let col = (dx * a.row_dy - dy * a.row_dx) / area;
        let row = (dy * a.col_dx - dx * a.col_dy) / area;
        for (axis, value) in [row, col].into_iter().enumerate() {
            least[axis] = least[axis].min(value);
            most[axis] = most[axis].max(value);
        }
    }
    let range = |axis: usize, len: usize| {
        // `as` saturates: what lies outside is cut at the raster's edge
        let first = (least[axis] + EDGE_TOLERANCE_CELLS).floor().max(0.0) as usize;
        let end = (most[axis] - EDGE_TOLERANCE_CELLS).ceil().max(0.0) as usize;
        first.min(len)..end.min(len)
    };
    let range = CellWindow { rows: range(0, rows), cols: range(1, cols) };
    if range.rows.is_empty() || range.cols.is_empty() {
        let far = shifted(a, rows as f64, cols as f64);
        return Err(ParseError::new(
            format!(
                "the window misses the raster, which covers {},{},{},{}",
                a.origin_x.min(far.origin_x),
                a.origin_y.min(far.origin_y),
                a.origin_x.max(far.origin_x),
                a.origin_y.max(far.origin_y)
            ),
            "give --bbox WEST,SOUTH,EAST,NORTH in the file's CRS",
        )
        .of_kind(ParseErrorKind::Nothing));
    }
    Ok(range)
}

/// The part of a raster that `window` touches, and the check that every format ends with.
///
/// # Errors
/// If the window misses the raster, or nothing in it is valid.
pub(super) fn crop(
    raster: SourceRaster,
    window: Option<&MapWindow>,
    limits: &Limits,
) -> Result<SourceRaster, ParseError> {
    let range = cells(window, &raster.affine, raster.rows, raster.cols, limits)?;
    if range.len() == raster.values.len() {
        return require_valid(raster);
    }
    let rows_of = |r: usize| r * raster.cols + range.cols.start..r * raster.cols + range.cols.end;
    let values =
        range.rows.clone().flat_map(|r| raster.values[rows_of(r)].iter().copied()).collect();
    let valid = range.rows.clone().flat_map(|r| raster.valid[rows_of(r)].iter().copied()).collect();
    require_valid(SourceRaster {
        rows: range.rows.len(),
        cols: range.cols.len(),
        affine: shifted(&raster.affine, range.rows.start as f64, range.cols.start as f64),
        values,
        valid,
        ..raster
    })
}

/// Such trouble is of the kind [`ParseErrorKind::Nothing`], so that one empty tile spoils no mosaic.
///
/// # Errors
/// If no cell is valid.
pub(super) fn require_valid(raster: SourceRaster) -> Result<SourceRaster, ParseError> {
    if raster.valid.contains(&true) { Ok(raster) } else { Err(nothing_valid()) }
}

pub(super) fn nothing_valid() -> ParseError {
    ParseError::new(
        "the raster holds no valid cell (all are nodata)",
        "give another file or window, or mend its nodata value",
    )
    .of_kind(ParseErrorKind::Nothing)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NORTH_UP: Affine = Affine {
        origin_x: 100.0,
        origin_y: 50.0,
        col_dx: 2.0,
        col_dy: 0.0,
        row_dx: 0.0,
        row_dy: -2.0,
    };

    fn ask(west: f64, south: f64, east: f64, north: f64) -> Result<CellWindow, ParseError> {
        let window = MapWindow { west, south, east, north };
        cells(Some(&window), &NORTH_UP, 10, 20, &Limits::default())
    }

    #[test]
    fn a_window_takes_the_cells_it_touches() {
        let range = ask(103.0, 40.0, 108.0, 46.0).unwrap();
        assert_eq!(range, CellWindow { rows: 2..5, cols: 1..4 });
        // an edge between cells touches only the cells inside
        assert_eq!(ask(102.0, 46.0, 104.0, 48.0).unwrap(), CellWindow { rows: 1..2, cols: 1..2 });
        // what juts out is cut
        assert_eq!(
            ask(-1e300, 0.0, 1e300, 1e300).unwrap(),
            CellWindow { rows: 0..10, cols: 0..20 }
        );
    }

    #[test]
    fn windows_that_miss_or_are_turned_are_refused() {
        assert!(ask(0.0, 0.0, 50.0, 50.0).unwrap_err().what.contains("covers 100,30,140,50"));
        assert!(ask(110.0, 40.0, 105.0, 46.0).is_err());
        assert!(ask(f64::NAN, 40.0, 105.0, 46.0).is_err());
    }

    #[test]
    fn the_limit_counts_the_window_not_the_raster() {
        let limits = Limits { max_cells: 9, ..Limits::default() };
        let window = MapWindow { west: 103.0, south: 40.0, east: 108.0, north: 46.0 };
        assert!(cells(Some(&window), &NORTH_UP, 10, 20, &limits).is_ok());
        assert!(cells(None, &NORTH_UP, 10, 20, &limits).is_err());
    }

    #[test]
    fn cropping_moves_the_origin() {
        let raster = SourceRaster {
            rows: 10,
            cols: 20,
            affine: NORTH_UP,
            crs: None,
            vertical_unit: None,
            latitude_deg: None,
            crs_problem: None,
            values: (0..200_u8).map(f32::from).collect(),
            valid: vec![true; 200],
            non_finite_cells: 0,
        };
        let window = MapWindow { west: 103.0, south: 44.0, east: 107.0, north: 46.0 };
        let part = crop(raster, Some(&window), &Limits::default()).unwrap();
        assert_eq!((part.affine.origin_x, part.affine.origin_y), (102.0, 46.0));
        assert_eq!(part.values, [41.0, 42.0, 43.0]);
    }
}
