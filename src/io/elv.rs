//! `.elv`: the plain-text heightfields of the Deadwood and EcoLearn programs.
//!
//! A header `nx ny cell latitude`, then ny rows of nx heights; x runs along a row, from west to east. The **first**
//! row is the southernmost: Deadwood's own reader stores file row j as grid row ny − 1 − j, and grid row 0 is north.
//!
//! Heights are read as metres. EcoLearn writes the same header and feet (its cells of 0.9144 m are three feet), which
//! the file does not tell: the caller overrides the vertical unit. Which place on Earth it is, the file does not tell
//! either, only its latitude.

use super::number_text::{self, Words};
use super::window;
use super::{Limits, ParseError};
use crate::raster::MapWindow;
use crate::raster::{Affine, Crs, SourceRaster};

/// Whether text begins like an `.elv` file: two counts, a cell size, a latitude.
pub(super) fn is_elv(start: &[u8]) -> bool {
    header(&mut Words::new(start)).is_ok()
}

struct Header {
    cols: usize,
    rows: usize,
    cell_m: f64,
    latitude_deg: f64,
}

fn header(words: &mut Words<'_>) -> Result<Header, ParseError> {
    let header = Header {
        cols: words.count("the number of columns")?,
        rows: words.count("the number of rows")?,
        cell_m: words.number("the cell size")?,
        latitude_deg: words.number("the latitude")?,
    };
    if !(header.cell_m > 0.0 && header.cell_m.is_finite()) {
        return Err(ParseError::new(
            format!("the cell size {} is not positive", header.cell_m),
            "the first line is: columns rows cell-size latitude",
        ));
    }
    if header.latitude_deg.is_nan() || header.latitude_deg.abs() > 90.0 {
        return Err(ParseError::new(
            format!("the latitude {} is not within -90 and 90 degrees", header.latitude_deg),
            "the first line is: columns rows cell-size latitude",
        ));
    }
    Ok(header)
}

/// The raster of an `.elv` file, or the part of it that `window` touches; the south-west corner is (0, 0).
///
/// # Errors
/// If the header or a height is no number, their count differs, or the limits are passed.
pub fn parse(
    bytes: &[u8],
    window: Option<&MapWindow>,
    limits: &Limits,
) -> Result<SourceRaster, ParseError> {
    let mut words = Words::new(bytes);
    let Header { cols, rows, cell_m, latitude_deg } = header(&mut words)?;
    let affine = Affine {
        origin_x: 0.0,
        origin_y: rows as f64 * cell_m,
        col_dx: cell_m,
        col_dy: 0.0,
        row_dx: 0.0,
        row_dy: -cell_m,
    };
    window::check_affine(&affine, rows, cols)?;
    window::cells(window, &affine, rows, cols, limits)?;
    let mut grid = number_text::grid(&mut words, rows, cols, None)?;
    let from_north = |row: usize| (rows - 1 - row) * cols..(rows - row) * cols;
    let raster = SourceRaster {
        rows,
        cols,
        affine,
        crs: Some(Crs::Local),
        vertical_unit: None,
        latitude_deg: Some(latitude_deg),
        crs_problem: None,
        values: (0..rows).flat_map(|row| grid.values[from_north(row)].iter().copied()).collect(),
        valid: (0..rows).flat_map(|row| grid.valid[from_north(row)].iter().copied()).collect(),
        non_finite_cells: std::mem::take(&mut grid.non_finite_cells),
    };
    window::crop(raster, window, limits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SMALL: &str = "3 2 2.0 42.5\n1 2 3 \n4 5 6 \n";

    #[test]
    fn the_first_row_lies_south() {
        let raster = parse(SMALL.as_bytes(), None, &Limits::default()).unwrap();
        assert_eq!(raster.values, [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]);
        assert_eq!((raster.affine.origin_y, raster.affine.row_dy), (4.0, -2.0));
        assert_eq!((raster.crs, raster.latitude_deg), (Some(Crs::Local), Some(42.5)));
        assert_eq!(raster.vertical_unit, None);
    }

    #[test]
    fn headers_are_checked() {
        for text in ["3 2 0 42.5 1 2 3 4 5 6", "3 2 2 91 1 2 3 4 5 6", "3 2", "900 900 2 42 1", "x"]
        {
            assert!(parse(text.as_bytes(), None, &Limits::default()).is_err(), "{text}");
        }
    }

    /// The Deadwood paper's terrain: 256 × 256 cells of 2 m between 1217 and 1460 m.
    #[test]
    fn gresolet_is_read() {
        let data = std::env::var("WILDWOOD_DATA").unwrap_or_else(|_| "../shared/data".into());
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
            .join(data)
            .join("gresolet/heightfield.elv");
        let Ok(bytes) = std::fs::read(path) else {
            eprintln!("skipped: ../shared/data is missing");
            return;
        };
        let raster = parse(&bytes, None, &Limits::default()).unwrap();
        assert_eq!((raster.rows, raster.cols, raster.values.len()), (256, 256, 65536));
        let (least, most) =
            raster.values.iter().fold((f32::MAX, f32::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
        assert_eq!((least, most), (1217.1, 1459.8));
        // the file's first number is the south-west corner
        assert_eq!(raster.values[255 * 256], 1319.4);
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(cut in 0..SMALL.len(), flip in 0..SMALL.len(), bit in 0..8_u32) {
            let mut bytes = SMALL.as_bytes().to_vec();
            bytes[flip] ^= 1 << bit;
            let _ = parse(&bytes, None, &Limits::default());
            let _ = parse(&bytes[..cut], None, &Limits::default());
        }
    }
}
