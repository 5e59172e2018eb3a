//! The columns of a GeoParquet file that somebody asks for, a run of rows at a time.
//!
//! Files that other programs changed are read as well: columns in any order, more columns, wider numbers, either order
//! of bytes. Memory is bounded by a run of rows and a page of each column, whatever the file claims.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, BufReader, Read};
use std::ops::Deref;
use std::panic::AssertUnwindSafe;
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Float64Type, Int32Type, Int64Type, UInt32Type, UInt64Type};
use arrow_array::{Array, RecordBatch};
use arrow_schema::DataType;
use bytes::Bytes;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder,
};
use parquet::basic::Compression;
use parquet::errors::ParquetError;
use parquet::file::metadata::ParquetMetaData;
use parquet::file::reader::{ChunkReader, Length};
use serde_json::Value;

use super::{GEO_KEY, LINE_BYTES, POINT_BYTES, thrift};
use crate::io::geotiff::ByteSource;
use crate::io::table::{Column, Kind, Values};
use crate::io::{ParseError, ParseErrorKind};
use crate::raster::Crs;

/// Rows handed on at a time. chosen: 2 MB of values; and every row could have a word of its own.
const RUN_ROWS: usize = 32_768;

const AGAIN: &str = "write it again, or run the stage again that made it";

/// Reads `columns` of a file and hands their values to `each`, in the order asked for, a run of rows at a time.
///
/// # Errors
/// If the file is damaged, is packed in a way not known here, lacks one of the columns or a value in it, has more than
/// `max_rows` rows, or has its places in another system than `crs`; or whatever `each` gives.
pub fn read<S>(
    source: Arc<S>,
    columns: &[Column],
    crs: &Crs,
    max_rows: usize,
    each: &mut dyn FnMut(Vec<Values<'static>>) -> Result<(), ParseError>,
) -> Result<(), ParseError>
where
    S: ByteSource + Send + ?Sized + 'static,
{
    check_directory(&*source)?;
    let chunks = Chunks(source);
    let options = ArrowReaderOptions::new().with_skip_arrow_metadata(true);
    let metadata = guarded(|| ArrowReaderMetadata::load(&chunks, options))?;
    check_layout(metadata.metadata(), chunks.len(), max_rows)?;
    check_pages(metadata.metadata(), &*chunks.0)?;
    check_crs(metadata.metadata(), columns, crs)?;
    let fields = metadata.schema().fields();
    let roots: Vec<usize> = columns
        .iter()
        .map(|column| {
            fields.iter().position(|field| field.name() == column.name).ok_or_else(|| {
                ParseError::new(format!("the table has no column `{}`", column.name), AGAIN)
            })
        })
        .collect::<Result<_, _>>()?;
    let mask = ProjectionMask::roots(metadata.parquet_schema(), roots);
    let mut batches = guarded(|| {
        ParquetRecordBatchReaderBuilder::new_with_metadata(chunks, metadata)
            .with_batch_size(RUN_ROWS)
            .with_projection(mask)
            .build()
    })?;
    let mut rows = 0;
    while let Some(batch) = guarded(|| Ok(batches.next().transpose()?))? {
        rows += batch.num_rows();
        if rows > max_rows {
            return Err(too_many_rows(max_rows));
        }
        each(columns.iter().map(|column| values(&batch, column)).collect::<Result<_, _>>()?)?;
    }
    Ok(())
}

fn too_many_rows(max_rows: usize) -> ParseError {
    ParseError::new(
        format!("the table has more than {max_rows} rows"),
        "split the scene into smaller ones",
    )
}

/// What `parquet` gives. It panics on some damaged files (60.1: shifts too far in the width of dictionary indices), and
/// what it panicked in is dropped: reading ends there.
fn guarded<T>(read: impl FnOnce() -> Result<T, ParquetError>) -> Result<T, ParseError> {
    match std::panic::catch_unwind(AssertUnwindSafe(read)) {
        Ok(result) => result.map_err(damaged),
        Err(_) => Err(ParseError::new("not a sound Parquet file (its pages are damaged)", AGAIN)),
    }
}

fn damaged(error: ParquetError) -> ParseError {
    match error {
        ParquetError::External(e) => match e.downcast::<io::Error>() {
            Ok(e) => {
                ParseError::new(e.to_string(), AGAIN).of_kind(ParseErrorKind::Device(e.kind()))
            }
            Err(e) => ParseError::new(format!("not a sound Parquet file ({e})"), AGAIN),
        },
        e => ParseError::new(format!("not a sound Parquet file ({e})"), AGAIN),
    }
}

fn unsound(what: &str) -> ParseError {
    ParseError::new(format!("not a sound Parquet file ({what})"), AGAIN)
}

fn bytes_of<S: ByteSource + ?Sized>(
    source: &S,
    start: u64,
    length: u64,
) -> Result<Vec<u8>, ParseError> {
    let mut bytes = Vec::new();
    Stream { source, position: start }.take(length).read_to_end(&mut bytes).map_err(|e| {
        ParseError::new(e.to_string(), AGAIN).of_kind(ParseErrorKind::Device(e.kind()))
    })?;
    Ok(bytes)
}

/// Refuses a directory that is no structure, or claims more than it holds: the library would count it all.
fn check_directory<S: ByteSource + ?Sized>(source: &S) -> Result<(), ParseError> {
    let Some(foot) = source.len().checked_sub(8) else { return Err(unsound("it ends too early")) };
    let tail = bytes_of(source, foot, 8)?;
    let [a, b, c, d, ..] = tail[..] else { return Err(unsound("it ends too early")) };
    let length = u64::from(u32::from_le_bytes([a, b, c, d]));
    let start = foot.checked_sub(length).ok_or_else(|| unsound("its directory is cut"))?;
    let walked = thrift::walk(&bytes_of(source, start, length)?);
    walked.map(drop).ok_or_else(|| unsound("its directory is damaged"))
}

/// Bytes that most page headers lie within.
const HEADER_BYTES: u64 = 1 << 10;

/// Refuses pages whose headers are no structures, or claim more than they hold.
fn check_pages<S: ByteSource + ?Sized>(
    metadata: &ParquetMetaData,
    source: &S,
) -> Result<(), ParseError> {
    let damaged = || unsound("the header of a page is damaged");
    for chunk in metadata.row_groups().iter().flat_map(|group| group.columns()) {
        // within the file, as its layout was checked
        let (mut start, length) = chunk.byte_range();
        let end = start + length;
        while start < end {
            let mut header = thrift::walk(&bytes_of(source, start, HEADER_BYTES.min(end - start))?);
            if header.is_none() && HEADER_BYTES < end - start {
                header = thrift::walk(&bytes_of(source, start, end - start)?);
            }
            let header = header.ok_or_else(damaged)?;
            let size = header.third_field.and_then(|size| u64::try_from(size).ok());
            let size = size.ok_or_else(damaged)?;
            start = start.saturating_add(header.bytes as u64).saturating_add(size);
        }
    }
    Ok(())
}

/// Refuses what the columns cannot be: chunks outside the file, too many rows, unknown compression.
fn check_layout(metadata: &ParquetMetaData, bytes: u64, max_rows: usize) -> Result<(), ParseError> {
    let broken = || ParseError::new("the table's directory contradicts itself", AGAIN);
    let mut all_rows = 0_usize;
    for group in metadata.row_groups() {
        let rows = usize::try_from(group.num_rows()).map_err(|_| broken())?;
        all_rows = all_rows.checked_add(rows).ok_or_else(broken)?;
        for chunk in group.columns() {
            let unsigned = |number: i64| u64::try_from(number).map_err(|_| broken());
            let start = unsigned(chunk.dictionary_page_offset().unwrap_or(0))?;
            let start = start.max(unsigned(chunk.data_page_offset())?);
            let end = start.checked_add(unsigned(chunk.compressed_size())?);
            if end.is_none_or(|end| end > bytes) || chunk.num_values() < 0 {
                return Err(broken());
            }
            if !matches!(chunk.compression(), Compression::UNCOMPRESSED | Compression::ZSTD(_)) {
                let what = format!("the table is packed by {}", chunk.compression());
                let hint = "write it again with the compression zstd";
                return Err(ParseError::new(what, hint).of_kind(ParseErrorKind::Unsupported));
            }
        }
    }
    if all_rows > max_rows {
        return Err(too_many_rows(max_rows));
    }
    Ok(())
}

/// Refuses points and lines that say they are in another system; those that do not say are taken for `crs`.
fn check_crs(metadata: &ParquetMetaData, columns: &[Column], crs: &Crs) -> Result<(), ParseError> {
    let Some(geometry) = columns.iter().find(|column| column.kind.is_geometry()) else {
        return Ok(());
    };
    let pairs = metadata.file_metadata().key_value_metadata();
    let text =
        pairs.and_then(|pairs| pairs.iter().find(|pair| pair.key == GEO_KEY)?.value.as_ref());
    let Some(text) = text else { return Ok(()) };
    let geo: Value = serde_json::from_str(text).map_err(|e| {
        ParseError::new(format!("the table's `geo` metadata is no JSON ({e})"), AGAIN)
    })?;
    let named = match geo["columns"][geometry.name].get("crs") {
        // the specification's default
        None => Some("OGC:CRS84 (degrees)".to_owned()),
        Some(named) => {
            let (authority, code) = (&named["id"]["authority"], &named["id"]["code"]);
            authority.as_str().map(|authority| match code.as_str() {
                Some(code) => format!("{authority}:{code}"),
                None => format!("{authority}:{code}"),
            })
        }
    };
    match named {
        Some(named) if !named.eq_ignore_ascii_case(&crs.to_string()) => Err(ParseError::new(
            format!("the places are in {named}, the scene is in {crs}"),
            "bring them into the scene's system, e.g. with GeoPandas' to_crs",
        )),
        _ => Ok(()),
    }
}

/// A source as the Parquet reader asks for it. Lengths are checked here: the reader believes what files claim.
struct Chunks<S: ?Sized>(Arc<S>);

impl<S: ByteSource + ?Sized> Length for Chunks<S> {
    fn len(&self) -> u64 {
        self.0.len()
    }
}

impl<S: ByteSource + Send + ?Sized> ChunkReader for Chunks<S> {
    type T = BufReader<Stream<Arc<S>>>;

    fn get_read(&self, start: u64) -> Result<Self::T, ParquetError> {
        Ok(BufReader::new(Stream { source: Arc::clone(&self.0), position: start }))
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes, ParquetError> {
        let end = start.checked_add(length as u64);
        if end.is_none_or(|end| end > self.0.len()) {
            return Err(ParquetError::EOF("the file ends too early".to_owned()));
        }
        let mut bytes = vec![0; length];
        Stream { source: Arc::clone(&self.0), position: start }.read_exact(&mut bytes)?;
        Ok(bytes.into())
    }
}

/// A stream over a source that it holds.
struct Stream<S> {
    source: S,
    position: u64,
}

impl<S: Deref<Target: ByteSource>> Read for Stream<S> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.source.read_at(self.position, buffer)?;
        self.position = self.position.saturating_add(count as u64);
        Ok(count)
    }
}

/// The values of a column in a run of rows.
fn values(batch: &RecordBatch, column: &Column) -> Result<Values<'static>, ParseError> {
    let name = column.name;
    let wrong = |what: &str| ParseError::new(format!("column `{name}` {what}"), AGAIN);
    let array = batch.column_by_name(name).ok_or_else(|| wrong("is missing"))?;
    if array.null_count() > 0 {
        return Err(wrong("lacks a value"));
    }
    let found = match (column.kind, array.data_type()) {
        (Kind::Integer, DataType::Int64) => {
            Values::Integers(array.as_primitive::<Int64Type>().values().to_vec().into())
        }
        (Kind::Integer, DataType::Int32) => Values::Integers(
            array.as_primitive::<Int32Type>().values().iter().map(|&n| i64::from(n)).collect(),
        ),
        (Kind::Integer, DataType::UInt32) => Values::Integers(
            array.as_primitive::<UInt32Type>().values().iter().map(|&n| i64::from(n)).collect(),
        ),
        (Kind::Integer, DataType::UInt64) => Values::Integers(
            array
                .as_primitive::<UInt64Type>()
                .values()
                .iter()
                .map(|&n| i64::try_from(n).map_err(|_| wrong("has numbers of 2⁶³ and more")))
                .collect::<Result<Vec<i64>, _>>()?
                .into(),
        ),
        (Kind::Real { .. }, DataType::Float32) => {
            Values::Reals(array.as_primitive::<Float32Type>().values().to_vec().into())
        }
        (Kind::Real { .. }, DataType::Float64) => Values::Reals(
            // programs that widened the numbers give the same back
            array.as_primitive::<Float64Type>().values().iter().map(|&n| n as f32).collect(),
        ),
        (Kind::Word, DataType::Utf8) => words(array.as_string::<i32>().iter().flatten()),
        (Kind::Point, DataType::Binary) => Values::Points(
            array
                .as_binary::<i32>()
                .iter()
                .flatten()
                .map(|bytes| point(bytes).ok_or_else(|| wrong("has something that is no point")))
                .collect::<Result<Vec<[f64; 2]>, _>>()?
                .into(),
        ),
        (Kind::Line, DataType::Binary) => Values::Lines(
            array
                .as_binary::<i32>()
                .iter()
                .flatten()
                .map(|bytes| {
                    line(bytes).ok_or_else(|| wrong("has something that is no line of two points"))
                })
                .collect::<Result<Vec<[[f64; 2]; 2]>, _>>()?
                .into(),
        ),
        (kind, found) => {
            let expected = match kind {
                Kind::Integer => "whole numbers",
                Kind::Real { .. } => "real numbers",
                Kind::Word => "text",
                Kind::Point => "points as well-known binary",
                Kind::Line => "lines as well-known binary",
            };
            return Err(wrong(&format!("holds {found}, not {expected}")));
        }
    };
    Ok(found)
}

/// Words by index, in the order of their first appearance.
fn words<'a>(texts: impl Iterator<Item = &'a str>) -> Values<'static> {
    let mut known: BTreeMap<&str, u16> = BTreeMap::new();
    let mut words: Vec<Cow<'static, str>> = Vec::new();
    let mut last: Option<(&str, u16)> = None;
    let indices = texts
        .map(|text| match last {
            Some((word, index)) if word == text => index,
            _ => {
                let index = *known.entry(text).or_insert_with(|| {
                    words.push(text.to_owned().into());
                    (words.len() - 1) as u16 // a run has fewer rows than u16 has numbers
                });
                last = Some((text, index));
                index
            }
        })
        .collect();
    Values::Words { indices, words: words.into() }
}

/// The place that well-known binary gives, if it is a point with two coordinates.
fn point(bytes: &[u8]) -> Option<[f64; 2]> {
    let bytes: &[u8; POINT_BYTES] = bytes.try_into().ok()?;
    let is_little = match bytes[..5] {
        [1, 1, 0, 0, 0] => true,
        [0, 0, 0, 0, 1] => false,
        _ => return None,
    };
    Some([5, 13].map(|at| coordinate(bytes, at, is_little)))
}

/// The ends of the line that well-known binary gives, if it has two points with two coordinates each.
fn line(bytes: &[u8]) -> Option<[[f64; 2]; 2]> {
    let bytes: &[u8; LINE_BYTES] = bytes.try_into().ok()?;
    let is_little = match bytes[..9] {
        [1, 2, 0, 0, 0, 2, 0, 0, 0] => true,
        [0, 0, 0, 0, 2, 0, 0, 0, 2] => false,
        _ => return None,
    };
    Some([[9, 17], [25, 33]].map(|point| point.map(|at| coordinate(bytes, at, is_little))))
}

/// The coordinate at a place in well-known binary, in either order of bytes.
fn coordinate(bytes: &[u8], at: usize, is_little: bool) -> f64 {
    let eight = std::array::from_fn(|i| bytes[at + i]);
    if is_little { f64::from_le_bytes(eight) } else { f64::from_be_bytes(eight) }
}

#[cfg(test)]
mod tests {
    use arrow_array::{ArrayRef, BinaryArray, Float64Array, Int32Array, StringArray, UInt64Array};
    use parquet::arrow::ArrowWriter;
    use parquet::file::metadata::KeyValue;

    use super::*;

    const COLUMNS: [Column; 4] = [
        Column { name: "id", kind: Kind::Integer },
        Column { name: "species", kind: Kind::Word },
        Column { name: "geometry", kind: Kind::Point },
        Column { name: "height_m", kind: Kind::Real { decimals: 3 } },
    ];

    fn point_bytes(is_little: bool, x: f64) -> Vec<u8> {
        let (order, kind) = if is_little { (1, [1, 0, 0, 0]) } else { (0, [0, 0, 0, 1]) };
        let number = |n: f64| if is_little { n.to_le_bytes() } else { n.to_be_bytes() };
        [&[order], &kind[..], &number(x), &number(7.0)].concat()
    }

    /// A file as other programs write it: columns in another order, one more, other types.
    fn columns() -> Vec<(&'static str, ArrayRef)> {
        let points = [point_bytes(true, 1.5), point_bytes(false, 2.5), point_bytes(true, 3.5)];
        vec![
            ("height_m", Arc::new(Float64Array::from(vec![1.0, 2.0, 3.0]))),
            ("note", Arc::new(StringArray::from(vec!["a", "b", "c"]))),
            ("geometry", Arc::new(BinaryArray::from_iter_values(points))),
            ("id", Arc::new(Int32Array::from(vec![4, 5, 6]))),
            ("species", Arc::new(StringArray::from(vec!["oak", "fir", "oak"]))),
        ]
    }

    fn file(columns: Vec<(&'static str, ArrayRef)>, geo: Option<&str>) -> Arc<[u8]> {
        let batch = RecordBatch::try_from_iter(columns).unwrap();
        let mut bytes = Vec::new();
        let mut writer = ArrowWriter::try_new(&mut bytes, batch.schema(), None).unwrap();
        writer.write(&batch).unwrap();
        if let Some(geo) = geo {
            let geo = geo.to_owned();
            writer.append_key_value_metadata(KeyValue::new(GEO_KEY.to_owned(), geo));
        }
        writer.close().unwrap();
        bytes.into()
    }

    fn rows(source: Arc<[u8]>) -> Result<Vec<Vec<Values<'static>>>, ParseError> {
        let mut runs = Vec::new();
        read(source, &COLUMNS, &Crs::Epsg(32611), 1000, &mut |run| {
            runs.push(run);
            Ok(())
        })?;
        Ok(runs)
    }

    #[test]
    fn what_other_programs_write_is_read() {
        let runs = rows(file(columns(), None)).unwrap();
        let expected = vec![
            Values::Integers(vec![4, 5, 6].into()),
            Values::Words {
                indices: vec![0, 1, 0].into(),
                words: vec!["oak".into(), "fir".into()].into(),
            },
            Values::Points(vec![[1.5, 7.0], [2.5, 7.0], [3.5, 7.0]].into()),
            Values::Reals(vec![1.0, 2.0, 3.0].into()),
        ];
        assert_eq!(runs, [expected]);
    }

    #[test]
    fn what_cannot_be_the_table_is_refused() {
        let with = |name: &'static str, array: ArrayRef| {
            let mut columns = columns();
            columns.retain(|(other, _)| *other != name);
            columns.push((name, array));
            rows(file(columns, None)).unwrap_err().to_string()
        };
        let line = [&[1, 2, 0, 0, 0][..], &[0; 16]].concat();
        for (problem, names) in [
            (with("id", Arc::new(UInt64Array::from(vec![1, 2, u64::MAX]))), "2⁶³"),
            (with("id", Arc::new(StringArray::from(vec!["1", "2", "3"]))), "whole numbers"),
            (with("id", Arc::new(Int32Array::from(vec![Some(1), None, None]))), "lacks a value"),
            (with("species", Arc::new(Int32Array::from(vec![1, 2, 3]))), "text"),
            (with("height_m", Arc::new(Int32Array::from(vec![1, 2, 3]))), "real numbers"),
            (with("geometry", Arc::new(BinaryArray::from_iter_values([&line; 3]))), "no point"),
            (with("geometry", Arc::new(BinaryArray::from_iter_values([b"x"; 3]))), "no point"),
        ] {
            assert!(problem.contains(names), "{problem}");
        }
        let mut lacking = columns();
        lacking.retain(|(name, _)| *name != "species");
        let problem = rows(file(lacking, None)).unwrap_err();
        assert!(problem.what.contains("no column `species`"), "{problem}");
    }

    #[test]
    fn points_of_another_system_are_refused() {
        let geo = |crs: &str| {
            let text = format!(r#"{{"columns": {{"geometry": {{"encoding": "WKB"{crs}}}}}}}"#);
            rows(file(columns(), Some(&text)))
        };
        let id =
            |code: &str| format!(r#", "crs": {{"id": {{"authority": "EPSG", "code": {code}}}}}"#);
        assert!(geo(&id("32611")).is_ok() && geo(&id(r#""32611""#)).is_ok());
        assert!(geo(r#", "crs": null"#).is_ok(), "unknown: taken for the scene's");
        assert!(geo(&id("32612")).unwrap_err().what.contains("EPSG:32612"));
        assert!(geo("").unwrap_err().what.contains("degrees"));
        assert!(rows(file(columns(), Some("{"))).unwrap_err().what.contains("no JSON"));
    }

    #[test]
    fn lines_of_two_points_are_read_in_either_order_of_bytes() {
        let ends = [[1.5, -2.0], [500_000.25, 7.0]];
        let little = super::super::line_bytes(&ends);
        let numbers = ends.iter().flatten().flat_map(|n: &f64| n.to_be_bytes());
        let big: Vec<u8> = [0, 0, 0, 0, 2, 0, 0, 0, 2].into_iter().chain(numbers).collect();
        assert_eq!((line(&little), line(&big)), (Some(ends), Some(ends)));
        let mut three_points = little;
        three_points[5] = 3;
        assert_eq!((line(&three_points), line(&little[..40]), line(&[])), (None, None, None));
        assert_eq!((line(&point_bytes(true, 1.0)), point(&little)), (None, None));
    }

    #[test]
    fn words_are_numbered_as_they_appear() {
        let Values::Words { indices, words } = words(["b", "a", "a", "b", "c"].into_iter()) else {
            panic!("not words");
        };
        assert_eq!(
            (&indices[..], &words[..]),
            (&[0, 1, 1, 0, 2][..], &["b", "a", "c"].map(Cow::from)[..])
        );
    }
}
