//! Comma-separated values: a table as text. A point becomes the columns x and y, a line the column wkt.
//!
//! A line as well-known text opens as a line in GDAL and what is built on it; four columns of numbers would not.
//!
//! # Reference
//! RFC 4180; OGC 06-103r4 for well-known text.

use std::io::{self, Write};

use rayon::prelude::*;

use super::table::{Kind, Table, Values};

/// Digits behind the point of map coordinates: a tenth of a millimetre. chosen: below what any scanner places.
const COORDINATE_DECIMALS: usize = 4;

/// Rows that become text in one piece. chosen: half a megabyte of text.
const PIECE_ROWS: usize = 4096;

/// Pieces in memory at a time. chosen: enough for 32 threads; 16 MB of text.
const PIECES: usize = 32;

/// Writes a table with a header line.
///
/// # Errors
/// Whatever writing gives.
pub fn write(mut out: impl Write, table: &dyn Table) -> io::Result<()> {
    let names: Vec<String> = table
        .columns()
        .iter()
        .map(|column| match column.kind {
            Kind::Point => "x,y".to_owned(),
            Kind::Line => "wkt".to_owned(),
            _ => field(column.name),
        })
        .collect();
    write!(out, "{}\r\n", names.join(","))?;
    let rows = table.rows();
    let starts: Vec<usize> = (0..rows).step_by(PIECE_ROWS).collect();
    for group in starts.chunks(PIECES) {
        let pieces: Vec<Vec<u8>> = group
            .par_iter()
            .map(|&start| piece(table, start..rows.min(start + PIECE_ROWS)))
            .collect::<io::Result<_>>()?;
        for piece in pieces {
            out.write_all(&piece)?;
        }
    }
    out.flush()
}

/// The lines of some rows.
fn piece(table: &dyn Table, rows: std::ops::Range<usize>) -> io::Result<Vec<u8>> {
    let columns = table.columns();
    let values: Vec<Values<'_>> =
        (0..columns.len()).map(|column| table.values(column, rows.clone())).collect();
    let fields: Vec<Vec<String>> = values
        .iter()
        .map(|values| match values {
            Values::Words { words, .. } => words.iter().map(|word| field(word)).collect(),
            _ => Vec::new(),
        })
        .collect();
    let mut text = Vec::with_capacity(128 * rows.len());
    for row in 0..rows.len() {
        for (index, (values, column)) in values.iter().zip(columns).enumerate() {
            if index > 0 {
                text.push(b',');
            }
            match (values, column.kind) {
                (Values::Integers(numbers), _) => write!(text, "{}", numbers[row])?,
                (Values::Reals(numbers), Kind::Real { decimals }) => {
                    write!(text, "{:.decimals$}", numbers[row])?;
                }
                (Values::Reals(numbers), _) => write!(text, "{}", numbers[row])?,
                (Values::Words { indices, .. }, _) => {
                    text.extend_from_slice(fields[index][usize::from(indices[row])].as_bytes());
                }
                (Values::Points(points), _) => {
                    let [x, y] = points[row];
                    write!(text, "{x:.COORDINATE_DECIMALS$},{y:.COORDINATE_DECIMALS$}")?;
                }
                (Values::Lines(lines), _) => {
                    let [[x, y], [x2, y2]] = lines[row];
                    write!(
                        text,
                        "\"LINESTRING ({x:.COORDINATE_DECIMALS$} {y:.COORDINATE_DECIMALS$}, \
                         {x2:.COORDINATE_DECIMALS$} {y2:.COORDINATE_DECIMALS$})\""
                    )?;
                }
            }
        }
        text.extend_from_slice(b"\r\n");
    }
    Ok(text)
}

/// A text as a field: in quotes where it would be taken for more than one, or for none.
fn field(text: &str) -> String {
    if text.contains(['"', ',', '\r', '\n']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;
    use std::ops::Range;

    use super::*;
    use crate::io::table::Column;

    /// Rows 0, 1, 2 … of every kind.
    struct Counted(usize);

    impl Table for Counted {
        fn rows(&self) -> usize {
            self.0
        }

        fn columns(&self) -> &[Column] {
            &[
                Column { name: "id", kind: Kind::Integer },
                Column { name: "word, quoted", kind: Kind::Word },
                Column { name: "geometry", kind: Kind::Point },
                Column { name: "height_m", kind: Kind::Real { decimals: 2 } },
            ]
        }

        fn values(&self, column: usize, rows: Range<usize>) -> Values<'_> {
            match column {
                0 => Values::Integers(rows.map(|i| i as i64).collect()),
                1 => Values::Words {
                    indices: rows.map(|i| (i % 2) as u16).collect(),
                    words: Cow::Owned(vec!["plain".into(), "a \"b\", c".into()]),
                },
                2 => Values::Points(rows.map(|i| [500_000.25 + i as f64, -0.5]).collect()),
                _ => Values::Reals(rows.map(|i| i as f32 + 0.126).collect()),
            }
        }
    }

    fn text(table: &dyn Table) -> String {
        let mut out = Vec::new();
        write(&mut out, table).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn every_kind_becomes_text() {
        assert_eq!(
            text(&Counted(2)),
            "id,\"word, quoted\",x,y,height_m\r\n\
             0,plain,500000.2500,-0.5000,0.13\r\n\
             1,\"a \"\"b\"\", c\",500001.2500,-0.5000,1.13\r\n"
        );
    }

    #[test]
    fn lines_become_well_known_text() {
        struct Line;
        impl Table for Line {
            fn rows(&self) -> usize {
                1
            }
            fn columns(&self) -> &[Column] {
                &[
                    Column { name: "geometry", kind: Kind::Line },
                    Column { name: "length_m", kind: Kind::Real { decimals: 1 } },
                ]
            }
            fn values(&self, column: usize, _: Range<usize>) -> Values<'_> {
                match column {
                    0 => Values::Lines(vec![[[500_000.25, -0.5], [500_003.25, 3.5]]].into()),
                    _ => Values::Reals(vec![5.0].into()),
                }
            }
        }
        assert_eq!(
            text(&Line),
            "wkt,length_m\r\n\"LINESTRING (500000.2500 -0.5000, 500003.2500 3.5000)\",5.0\r\n"
        );
    }

    #[test]
    fn no_rows_leave_the_header() {
        assert_eq!(text(&Counted(0)).lines().count(), 1);
    }

    #[test]
    fn rows_stay_in_order_across_pieces() {
        let rows = PIECE_ROWS * (PIECES + 1) + 7;
        let written = text(&Counted(rows));
        let ids = written.lines().skip(1).map(|line| line.split(',').next().unwrap().to_owned());
        assert!(ids.eq((0..rows).map(|i| i.to_string())));
    }
}
