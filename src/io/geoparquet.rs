//! GeoParquet: a table with places, packed by columns, with its coordinate reference system.
//!
//! Points and lines are well-known binary in map coordinates, easting first. Files hold no times, their row groups have
//! one size, and columns are packed side by side: equal tables become equal bytes on any number of threads.
//!
//! # Reference
//! GeoParquet 1.1.0 (geoparquet.org); OGC 06-103r4 for well-known binary.

use std::io::{self, Write};
use std::sync::Arc;

use arrow_array::types::UInt16Type;
use arrow_array::{
    ArrayRef, BinaryArray, DictionaryArray, Float32Array, Int64Array, StringArray, UInt16Array,
};
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::ArrowSchemaConverter;
use parquet::arrow::arrow_writer::{
    ArrowColumnChunk, ArrowColumnWriter, ArrowRowGroupWriterFactory, compute_leaves,
};
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::ColumnPath;
use rayon::prelude::*;
use serde_json::{Value, json};

use super::projjson;
use super::table::{Column, Kind, Table, Values};
use crate::raster::Crs;

pub mod read;
mod thrift;

pub use read::read;

/// Rows of a row group. chosen: within the 50,000 to 150,000 that GeoParquet's guide for its distributors advises.
const ROW_GROUP_ROWS: usize = 131_072;

/// Strength of the compression, 1–22. chosen: stronger ones take longer and gain little on measures.
const ZSTD_LEVEL: i32 = 1;

/// The key of the file's metadata that makes a Parquet file a GeoParquet file.
const GEO_KEY: &str = "geo";

/// Bytes of a point: order of bytes, type, two coordinates.
const POINT_BYTES: usize = 21;

/// Bytes of a line: order of bytes, type, number of points, two coordinates each of two points.
const LINE_BYTES: usize = 41;

/// Writes a table whose points or lines are in `crs`.
///
/// # Errors
/// Whatever writing gives.
pub fn write<W: Write + Send>(out: W, table: &dyn Table, crs: &Crs) -> io::Result<()> {
    write_parquet(out, table, crs).map_err(|e| match e {
        ParquetError::External(e) => match e.downcast::<io::Error>() {
            Ok(e) => *e,
            Err(e) => io::Error::other(e),
        },
        e => io::Error::other(e),
    })
}

fn write_parquet<W: Write + Send>(
    out: W,
    table: &dyn Table,
    crs: &Crs,
) -> Result<(), ParquetError> {
    let columns = table.columns();
    let fields: Vec<Field> = columns.iter().map(field).collect();
    let schema = Arc::new(Schema::new(fields));
    let root = ArrowSchemaConverter::new().convert(&schema)?.root_schema_ptr();
    let properties = Arc::new(properties(columns, geo_metadata(table, crs))?);
    let mut file = SerializedFileWriter::new(out, root, properties)?;
    let factory = ArrowRowGroupWriterFactory::new(&file, Arc::clone(&schema));
    for (group, start) in (0..table.rows()).step_by(ROW_GROUP_ROWS).enumerate() {
        let rows = start..table.rows().min(start + ROW_GROUP_ROWS);
        let writers: Vec<(usize, ArrowColumnWriter)> =
            factory.create_column_writers(group)?.into_iter().enumerate().collect();
        let chunks: Vec<ArrowColumnChunk> = writers
            .into_par_iter()
            .with_max_len(1)
            .map(|(column, writer)| {
                pack(writer, schema.field(column), table.values(column, rows.clone()))
            })
            .collect::<Result<_, _>>()?;
        let mut row_group = file.next_row_group()?;
        for chunk in chunks {
            chunk.append_to_row_group(&mut row_group)?;
        }
        row_group.close()?;
    }
    file.close()?;
    Ok(())
}

fn field(column: &Column) -> Field {
    let kind = match column.kind {
        Kind::Integer => DataType::Int64,
        Kind::Real { .. } => DataType::Float32,
        Kind::Word => DataType::Utf8,
        Kind::Point | Kind::Line => DataType::Binary,
    };
    Field::new(column.name, kind, false)
}

fn properties(columns: &[Column], geo: Option<Value>) -> Result<WriterProperties, ParquetError> {
    let metadata = geo.map(|geo| vec![KeyValue::new(GEO_KEY.to_owned(), geo.to_string())]);
    let mut properties = WriterProperties::builder()
        .set_created_by(concat!("wildwood ", env!("CARGO_PKG_VERSION")).to_owned())
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(ZSTD_LEVEL)?))
        .set_dictionary_enabled(false)
        .set_statistics_enabled(EnabledStatistics::Chunk)
        .set_offset_index_disabled(true)
        .set_key_value_metadata(metadata);
    for column in columns {
        let path = ColumnPath::from(column.name);
        properties = match column.kind {
            Kind::Integer => properties.set_column_encoding(path, Encoding::DELTA_BINARY_PACKED),
            // the bytes of like significance together: half a crown's size
            Kind::Real { .. } => properties.set_column_encoding(path, Encoding::BYTE_STREAM_SPLIT),
            Kind::Word => properties.set_column_dictionary_enabled(path, true),
            // least and greatest bytes of a place say nothing
            Kind::Point | Kind::Line => {
                properties.set_column_statistics_enabled(path, EnabledStatistics::None)
            }
        };
    }
    Ok(properties.build())
}

/// What the file says of its geometry: its encoding, type, system and bounds. `None` for a table without one.
fn geo_metadata(table: &dyn Table, crs: &Crs) -> Option<Value> {
    let column = table.columns().iter().position(|column| column.kind.is_geometry())?;
    let Column { name, kind } = table.columns()[column];
    let geometry_type = if kind == Kind::Line { "LineString" } else { "Point" };
    let mut geometry =
        json!({ "encoding": "WKB", "geometry_types": [geometry_type], "crs": projjson::of(crs) });
    if let Some(bounds) = bounds(table, column) {
        geometry["bbox"] = json!(bounds);
    }
    Some(json!({ "version": "1.1.0", "primary_column": name, "columns": { name: geometry } }))
}

/// West, south, east and north of all points or lines; `None` if there are none.
fn bounds(table: &dyn Table, column: usize) -> Option<[f64; 4]> {
    let starts: Vec<usize> = (0..table.rows()).step_by(ROW_GROUP_ROWS).collect();
    let of_rows = |start: usize| {
        let values = table.values(column, start..table.rows().min(start + ROW_GROUP_ROWS));
        let of_point = |&[x, y]: &[f64; 2]| [x, y, x, y];
        match values {
            Values::Points(points) => points.iter().map(of_point).reduce(union),
            Values::Lines(lines) => lines.iter().flatten().map(of_point).reduce(union),
            _ => None,
        }
    };
    starts.into_par_iter().filter_map(of_rows).reduce_with(union)
}

fn union(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
}

/// A column of a row group, packed.
fn pack(
    mut writer: ArrowColumnWriter,
    field: &Field,
    values: Values<'_>,
) -> Result<ArrowColumnChunk, ParquetError> {
    let array: ArrayRef = match values {
        Values::Integers(numbers) => Arc::new(Int64Array::from(numbers.into_owned())),
        Values::Reals(numbers) => Arc::new(Float32Array::from(numbers.into_owned())),
        Values::Words { indices, words } => Arc::new(DictionaryArray::<UInt16Type>::try_new(
            UInt16Array::from(indices.into_owned()),
            Arc::new(StringArray::from_iter_values(words.iter())),
        )?),
        Values::Points(points) => {
            Arc::new(BinaryArray::from_iter_values(points.iter().map(point_bytes)))
        }
        Values::Lines(lines) => {
            Arc::new(BinaryArray::from_iter_values(lines.iter().map(line_bytes)))
        }
    };
    for leaf in compute_leaves(field, &array)? {
        writer.write(&leaf)?;
    }
    writer.close()
}

/// A point as well-known binary, little-endian.
fn point_bytes(&[x, y]: &[f64; 2]) -> [u8; POINT_BYTES] {
    let mut bytes = [0; POINT_BYTES];
    bytes[..2].copy_from_slice(&[1, 1]);
    bytes[5..13].copy_from_slice(&x.to_le_bytes());
    bytes[13..].copy_from_slice(&y.to_le_bytes());
    bytes
}

/// A line as well-known binary, little-endian.
fn line_bytes(ends: &[[f64; 2]; 2]) -> [u8; LINE_BYTES] {
    let mut bytes = [0; LINE_BYTES];
    bytes[..9].copy_from_slice(&[1, 2, 0, 0, 0, 2, 0, 0, 0]);
    for (into, coordinate) in bytes[9..].chunks_exact_mut(8).zip(ends.iter().flatten()) {
        into.copy_from_slice(&coordinate.to_le_bytes());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use parquet::file::reader::{FileReader, SerializedFileReader};

    use super::*;

    /// Points on a diagonal, and nothing else.
    struct Diagonal(usize);

    impl Table for Diagonal {
        fn rows(&self) -> usize {
            self.0
        }

        fn columns(&self) -> &[Column] {
            &[
                Column { name: "place", kind: Kind::Point },
                Column { name: "id", kind: Kind::Integer },
            ]
        }

        fn values(&self, column: usize, rows: Range<usize>) -> Values<'_> {
            match column {
                0 => Values::Points(rows.map(|i| [i as f64, -(i as f64)]).collect()),
                _ => Values::Integers(rows.map(|i| i as i64).collect()),
            }
        }
    }

    /// Lines from the diagonal, each three metres to the west and one to the north.
    struct Fallen(usize);

    impl Table for Fallen {
        fn rows(&self) -> usize {
            self.0
        }

        fn columns(&self) -> &[Column] {
            &[Column { name: "line", kind: Kind::Line }]
        }

        fn values(&self, _: usize, rows: Range<usize>) -> Values<'_> {
            let line = |i: usize| [[i as f64, i as f64], [i as f64 - 3.0, i as f64 + 1.0]];
            Values::Lines(rows.map(line).collect())
        }
    }

    fn written(rows: usize, crs: &Crs) -> SerializedFileReader<bytes::Bytes> {
        written_table(&Diagonal(rows), crs)
    }

    fn written_table(table: &dyn Table, crs: &Crs) -> SerializedFileReader<bytes::Bytes> {
        let mut bytes = Vec::new();
        write(&mut bytes, table, crs).unwrap();
        SerializedFileReader::new(bytes::Bytes::from(bytes)).unwrap()
    }

    fn geo(file: &SerializedFileReader<bytes::Bytes>) -> Value {
        let pairs = file.metadata().file_metadata().key_value_metadata().unwrap();
        assert_eq!(pairs.len(), 1, "nothing but the key geo");
        serde_json::from_str(pairs[0].value.as_ref().unwrap()).unwrap()
    }

    #[test]
    fn metadata_tells_what_points_are() {
        let geo = geo(&written(200_000, &Crs::Epsg(3794)));
        assert_eq!((&geo["version"], &geo["primary_column"]), (&json!("1.1.0"), &json!("place")));
        let place = &geo["columns"]["place"];
        assert_eq!(place["encoding"], "WKB");
        assert_eq!(place["geometry_types"], json!(["Point"]));
        assert_eq!(place["bbox"], json!([0.0, -199_999.0, 199_999.0, 0.0]));
        assert_eq!(place["crs"]["id"]["code"], 3794);
    }

    #[test]
    fn metadata_tells_what_lines_are() {
        let geo = geo(&written_table(&Fallen(200_000), &Crs::Epsg(3794)));
        let line = &geo["columns"]["line"];
        assert_eq!((&geo["primary_column"], &line["encoding"]), (&json!("line"), &json!("WKB")));
        assert_eq!(line["geometry_types"], json!(["LineString"]));
        assert_eq!(line["bbox"], json!([-3.0, 0.0, 199_999.0, 200_000.0]));
        assert_eq!(line["crs"]["id"]["code"], 3794);
    }

    /// OGC 06-103r4, 8.2: order of bytes, type 2, number of points, coordinates.
    #[test]
    fn lines_are_well_known_binary() {
        let bytes = line_bytes(&[[1.0, 2.0], [-2.0, 0.5]]);
        let text: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        let expected = [
            "01",
            "02000000",
            "02000000",
            "000000000000f03f",
            "0000000000000040",
            "00000000000000c0",
            "000000000000e03f",
        ];
        assert_eq!(text, expected.concat());
    }

    #[test]
    fn local_metres_are_of_unknown_system_and_no_rows_have_no_bounds() {
        let geo = geo(&written(0, &Crs::Local));
        let place = &geo["columns"]["place"];
        // absent would mean degrees
        assert_eq!(place.get("crs"), Some(&Value::Null));
        assert_eq!(place.get("bbox"), None);
    }

    #[test]
    fn row_groups_have_one_size() {
        let file = written(2 * ROW_GROUP_ROWS + 5, &Crs::Local);
        let rows: Vec<i64> = file.metadata().row_groups().iter().map(|g| g.num_rows()).collect();
        assert_eq!(rows, [ROW_GROUP_ROWS as i64, ROW_GROUP_ROWS as i64, 5]);
    }

    #[test]
    fn failing_devices_are_told_from_bad_tables() {
        struct Full;
        impl Write for Full {
            fn write(&mut self, _: &[u8]) -> io::Result<usize> {
                Err(io::ErrorKind::StorageFull.into())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let error = write(Full, &Diagonal(10_000), &Crs::Local).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::StorageFull);
    }
}
