//! ESRI ASCII grid.
//!
//! # Reference
//! ESRI, ArcGIS documentation, "Esri ASCII raster format"; `dx` and `dy` as GDAL writes them.

use super::number_text::{self, Words};
use super::window;
use super::{Limits, ParseError};
use crate::raster::MapWindow;
use crate::raster::{Affine, SourceRaster};

/// Nodata where the header is silent, as ESRI's documentation has it.
const DEFAULT_NODATA: f64 = -9999.0;

/// Header values as far as they were given.
#[derive(Debug, Default)]
struct Header {
    cols: Option<usize>,
    rows: Option<usize>,
    /// Least x, and whether it is a cell's centre rather than its corner.
    west: Option<(f64, bool)>,
    south: Option<(f64, bool)>,
    width: Option<f64>,
    height: Option<f64>,
    nodata: Option<f64>,
}

/// Whether text begins like an ESRI ASCII grid.
pub(super) fn is_ascii_grid(start: &[u8]) -> bool {
    let word = Words::new(start).next().unwrap_or_default().to_ascii_lowercase();
    matches!(
        &word[..],
        b"ncols"
            | b"nrows"
            | b"xllcorner"
            | b"yllcorner"
            | b"xllcenter"
            | b"yllcenter"
            | b"cellsize"
            | b"dx"
            | b"dy"
            | b"nodata_value"
    )
}

/// The raster of an ESRI ASCII grid, or the part of it that `window` touches. The format names neither CRS nor units.
///
/// # Errors
/// If the header is incomplete, the values do not match it, or the limits are passed.
pub fn parse(
    bytes: &[u8],
    window: Option<&MapWindow>,
    limits: &Limits,
) -> Result<SourceRaster, ParseError> {
    let mut words = Words::new(bytes);
    let header = header(&mut words)?;
    let missing = |key: &str| {
        ParseError::new(format!("the header lacks {key}"), format!("add a line: {key} VALUE"))
    };
    let cols = header.cols.ok_or_else(|| missing("ncols"))?;
    let rows = header.rows.ok_or_else(|| missing("nrows"))?;
    let (west, west_is_center) = header.west.ok_or_else(|| missing("xllcorner"))?;
    let (south, south_is_center) = header.south.ok_or_else(|| missing("yllcorner"))?;
    let width = header.width.ok_or_else(|| missing("cellsize"))?;
    let height = header.height.ok_or_else(|| missing("cellsize"))?;
    if !(width > 0.0 && height > 0.0) {
        return Err(ParseError::new(
            format!("the cell size {width} × {height} is not positive"),
            "correct the cell size in the header",
        ));
    }
    let edge =
        |value: f64, is_center: bool, size: f64| if is_center { value - size / 2.0 } else { value };
    let affine = Affine {
        origin_x: edge(west, west_is_center, width),
        origin_y: edge(south, south_is_center, height) + rows as f64 * height,
        col_dx: width,
        col_dy: 0.0,
        row_dx: 0.0,
        row_dy: -height,
    };
    window::check_affine(&affine, rows, cols)?;
    window::cells(window, &affine, rows, cols, limits)?;

    // At least two bytes a value were checked to be there, so memory stays in proportion to the file.
    let nodata = Some(header.nodata.unwrap_or(DEFAULT_NODATA));
    let grid = number_text::grid(&mut words, rows, cols, nodata)?;
    let raster = SourceRaster {
        rows,
        cols,
        affine,
        crs: None,
        vertical_unit: None,
        latitude_deg: None,
        crs_problem: None,
        values: grid.values,
        valid: grid.valid,
        non_finite_cells: grid.non_finite_cells,
    };
    window::crop(raster, window, limits)
}

/// Reads keys and values in any order up to the first number.
fn header(words: &mut Words<'_>) -> Result<Header, ParseError> {
    let mut header = Header::default();
    while let Some(word) = words.peek() {
        if !word[0].is_ascii_alphabetic() || is_number_word(word) {
            break;
        }
        let key = String::from_utf8_lossy(word).to_ascii_lowercase();
        words.next();
        match &key[..] {
            "ncols" => header.cols = Some(words.count("ncols")?),
            "nrows" => header.rows = Some(words.count("nrows")?),
            "xllcorner" => header.west = Some((words.number("xllcorner")?, false)),
            "xllcenter" => header.west = Some((words.number("xllcenter")?, true)),
            "yllcorner" => header.south = Some((words.number("yllcorner")?, false)),
            "yllcenter" => header.south = Some((words.number("yllcenter")?, true)),
            "cellsize" => {
                let size = words.number("cellsize")?;
                (header.width, header.height) = (Some(size), Some(size));
            }
            "dx" => header.width = Some(words.number("dx")?),
            "dy" => header.height = Some(words.number("dy")?),
            "nodata_value" => header.nodata = Some(words.number("nodata_value")?),
            _ => {
                let shown: String = key.chars().take(20).collect();
                return Err(ParseError::new(
                    format!("line {}: {shown:?} is no key of an ESRI ASCII grid", words.line()),
                    "the keys are ncols, nrows, xllcorner or xllcenter, yllcorner or yllcenter, cellsize (or dx and dy), nodata_value",
                ));
            }
        }
    }
    Ok(header)
}

/// Words that begin with a letter and are heights all the same.
fn is_number_word(word: &[u8]) -> bool {
    word.eq_ignore_ascii_case(b"nan") || word.eq_ignore_ascii_case(b"inf")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SMALL: &str = "ncols 3\nnrows 2\nxllcorner 100\nyllcorner 50\ncellsize 2\nNODATA_value -1\n1 2 3\n4 -1 6\n";

    fn read(text: &str) -> Result<SourceRaster, ParseError> {
        parse(text.as_bytes(), None, &Limits::default())
    }

    #[test]
    fn rows_run_from_the_north() {
        let raster = read(SMALL).unwrap();
        assert_eq!((raster.rows, raster.cols), (2, 3));
        assert_eq!(raster.values, [1.0, 2.0, 3.0, 4.0, 0.0, 6.0]);
        assert_eq!(raster.valid, [true, true, true, true, false, true]);
        let a = raster.affine;
        assert_eq!((a.origin_x, a.origin_y, a.col_dx, a.row_dy), (100.0, 54.0, 2.0, -2.0));
        assert_eq!((raster.crs, raster.vertical_unit), (None, None));
    }

    #[test]
    fn order_case_line_ends_and_centres_do_not_matter() {
        let other = "YLLCENTER 51\r\nDX 2\r\nNROWS 2\r\nXLLCENTER 101\r\nNODATA_VALUE -1\r\ndy 2\r\nNCOLS 3\r\n1 2\r\n3 4 -1 6";
        let (a, b) = (read(SMALL).unwrap(), read(other).unwrap());
        assert_eq!((a.affine, a.values, a.valid), (b.affine, b.values, b.valid));
    }

    #[test]
    fn a_window_cuts() {
        let window = MapWindow { west: 102.5, south: 52.5, east: 105.5, north: 53.0 };
        let raster = parse(SMALL.as_bytes(), Some(&window), &Limits::default()).unwrap();
        assert_eq!(raster.values, [2.0, 3.0]);
        assert_eq!((raster.affine.origin_x, raster.affine.origin_y), (102.0, 54.0));
    }

    #[test]
    fn errors_name_what_is_wrong() {
        let with = |from: &str, to: &str| read(&SMALL.replace(from, to)).unwrap_err().to_string();
        assert!(with("ncols 3\n", "").contains("lacks ncols"));
        assert!(with("ncols 3", "ncols 3.5").contains("ncols is 3.5"));
        assert!(with("ncols 3", "ncols -3").contains("line 1: ncols is -3"));
        assert!(with("cellsize 2", "cellsize 0").contains("not positive"));
        assert!(with("cellsize 2", "cellsize nan").contains("not positive"));
        assert!(with("cellsize", "cell").contains("line 5: \"cell\" is no key"));
        assert!(with("2\nxll", "3\nxll").contains("bytes follow"));
        let long = SMALL.replace("nrows 2", "nrows 3").replace("4 -1 6", "400000 -1 6");
        assert!(read(&long).unwrap_err().what.contains("ends after 6 of 9"));
        assert!(with("nrows 2", "nrows 1").contains("more than the 3 values"));
        assert!(with("nrows 2", "nrows 4000000000").contains("more than the limit"));
        assert!(with("nrows 2", "nrows 90000").contains("bytes follow"));
        assert!(with("1 2 3\n4 -1 6", "-1 -1 -1\n-1 -1 -1").contains("no valid cell"));
        assert!(read("").is_err());
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(cut in 0..SMALL.len(), flip in 0..SMALL.len(), bit in 0..8_u32) {
            let mut bytes = SMALL.as_bytes().to_vec();
            bytes[flip] ^= 1 << bit;
            let _ = parse(&bytes, None, &Limits::default());
            let _ = parse(&bytes[..cut], None, &Limits::default());
        }

        #[test]
        fn what_is_written_is_read(values in proptest::collection::vec(-1e6_f32..1e6, 12)) {
            let numbers: Vec<String> = values.iter().map(f32::to_string).collect();
            let text = format!("ncols 4 nrows 3 xllcorner 0 yllcorner 0 cellsize 1 {}", numbers.join(" "));
            prop_assert_eq!(read(&text).unwrap().values, values);
        }
    }
}
