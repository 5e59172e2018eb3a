//! GeoPackage: tables with places as layers of one SQLite file, each with its spatial index.
//!
//! Reading order: [`Layer`], [`write()`]; tables that every GeoPackage has in `schema`, geometries in `geometry`, the index in
//! `spatial_index`. Files hold no times: equal tables become equal bytes.
//!
//! # Reference
//! OGC 12-128r18 (GeoPackage 1.3.1); gpkg_ogr_contents and the triggers' names as GDAL has them.

use std::path::Path;

use rayon::prelude::*;
use rusqlite::{Connection, OpenFlags, Statement};

use super::table::{Column, Kind, Table, Values};
use crate::progress::{Cancelled, Reporter};
use crate::raster::Crs;

mod geometry;
mod schema;
mod spatial_index;

use geometry::Encoded;

/// Rows that are encoded in one piece. chosen: a megabyte of values.
const PIECE_ROWS: usize = 8192;

/// Pieces in memory at a time. chosen: enough for 16 threads.
const PIECES: usize = 16;

/// Bytes of a page. chosen: SQLite's and GDAL's own; pages up to 65,536 save a tenth of the time at most.
const PAGE_BYTES: u32 = 4096;

/// Why a GeoPackage was not written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum Error {
    #[error(transparent)]
    Sqlite(#[from] rusqlite::Error),
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// A layer of the file.
pub struct Layer<'a> {
    /// Its name.
    pub name: &'a str,
    /// What it holds, in a sentence.
    pub description: &'a str,
    /// Its rows; one column is the geometry, which becomes the column `geom`.
    pub table: &'a dyn Table,
    /// What becomes of the geometry.
    pub shape: Shape<'a>,
}

/// What becomes of a table's places.
#[derive(Clone, Copy)]
pub enum Shape<'a> {
    /// Points, their z from this column.
    Point {
        /// Name of a column of reals.
        z: &'static str,
    },
    /// Lines, the z of each end from a function of its place and of this column.
    Line {
        /// Name of a column of reals.
        z: &'static str,
        /// Elevation at a place, given that of the column.
        elevation_m: &'a (dyn Fn([f64; 2], f32) -> f32 + Sync),
    },
    /// Polygons about points, as large as disks whose radius is this column.
    Disk {
        /// Name of a column of reals.
        radius: &'static str,
    },
}

/// Writes a file that does not exist yet, whose places are in `crs`.
///
/// # Errors
/// If the file cannot be written, or the run was cancelled; a part of it may be left.
///
/// # Panics
/// If a layer's table lacks its geometry or the column that its shape names.
pub fn write(
    path: &Path,
    layers: &[Layer<'_>],
    crs: &Crs,
    reporter: &Reporter,
) -> Result<(), Error> {
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE
        | OpenFlags::SQLITE_OPEN_CREATE
        | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags)?;
    // the file has no readers before it is whole, and a broken one is thrown away: no journal, no waiting for the disk
    connection.execute_batch(&format!(
        "PRAGMA page_size = {PAGE_BYTES}; PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; \
         PRAGMA locking_mode = EXCLUSIVE; PRAGMA temp_store = MEMORY; PRAGMA cache_size = -65536; BEGIN"
    ))?;
    let srs_id = schema::create(&connection, crs)?;
    let rows: usize = layers.iter().map(|layer| layer.table.rows()).sum();
    let stage = reporter.stage("geopackage", rows as u64);
    for layer in layers {
        schema::create_layer(&connection, layer, srs_id)?;
        let boxes = insert(&connection, layer, srs_id, &mut |rows| {
            stage.advance(rows as u64);
            reporter.check_cancelled()
        })?;
        schema::describe_layer(&connection, layer, &boxes)?;
        spatial_index::create(&connection, layer.name, &boxes)?;
        schema::create_triggers(&connection, layer.name)?;
    }
    connection.execute_batch("COMMIT")?;
    connection.close().map_err(|(_, error)| error)?;
    Ok(())
}

/// West, south, east and north of a geometry.
type Bounds = [f64; 4];

/// Inserts all rows and gives the bounds of each, in the order of `fid` from 1.
fn insert(
    connection: &Connection,
    layer: &Layer<'_>,
    srs_id: i32,
    done: &mut dyn FnMut(usize) -> Result<(), Cancelled>,
) -> Result<Vec<Bounds>, Error> {
    let table = layer.table;
    let columns = table.columns();
    let places = vec!["?"; columns.len() + 1].join(", ");
    let mut statement =
        connection.prepare(&format!("INSERT INTO \"{}\" VALUES ({places})", layer.name))?;
    let mut boxes = Vec::with_capacity(table.rows());
    let starts: Vec<usize> = (0..table.rows()).step_by(PIECE_ROWS).collect();
    for group in starts.chunks(PIECES) {
        let pieces: Vec<(Vec<Values<'_>>, Encoded)> = group
            .par_iter()
            .map(|&start| {
                let rows = start..table.rows().min(start + PIECE_ROWS);
                let values: Vec<Values<'_>> =
                    (0..columns.len()).map(|column| table.values(column, rows.clone())).collect();
                let encoded = geometry::encode(columns, &values, &layer.shape, srs_id);
                (values, encoded)
            })
            .collect();
        for (values, encoded) in pieces {
            for row in 0..encoded.boxes.len() {
                let fid = (boxes.len() + row + 1) as i64; // tables have fewer than 2³² rows
                statement.raw_bind_parameter(1, fid)?;
                statement.raw_bind_parameter(2, encoded.bytes(row))?;
                bind(&mut statement, columns, &values, row)?;
                statement.raw_execute()?;
            }
            done(encoded.boxes.len())?;
            boxes.extend(encoded.boxes);
        }
    }
    Ok(boxes)
}

/// Binds the values of a row that are no geometry, from the third parameter on.
fn bind(
    statement: &mut Statement<'_>,
    columns: &[Column],
    values: &[Values<'_>],
    row: usize,
) -> rusqlite::Result<()> {
    let others = columns.iter().zip(values).filter(|(column, _)| !column.kind.is_geometry());
    for (parameter, (_, values)) in (3_usize..).zip(others) {
        match values {
            Values::Integers(numbers) => statement.raw_bind_parameter(parameter, numbers[row])?,
            Values::Reals(numbers) => {
                statement.raw_bind_parameter(parameter, f64::from(numbers[row]))?;
            }
            Values::Words { indices, words } => {
                let word: &str = &words[usize::from(indices[row])];
                statement.raw_bind_parameter(parameter, word)?;
            }
            Values::Points(_) | Values::Lines(_) => {}
        }
    }
    Ok(())
}

/// The columns of a table that are no geometry, with their types in SQL.
fn sql_columns(columns: &[Column]) -> impl Iterator<Item = (&'static str, &'static str)> {
    columns.iter().filter_map(|column| {
        let kind = match column.kind {
            Kind::Integer => "INTEGER",
            Kind::Real { .. } => "FLOAT",
            Kind::Word => "TEXT",
            Kind::Point | Kind::Line => return None,
        };
        Some((column.name, kind))
    })
}

#[cfg(test)]
pub(super) mod tests {
    use std::borrow::Cow;
    use std::ops::Range;

    use super::*;

    /// Trees on a grid, with a word, an id and two measures.
    pub(super) struct Trees(pub(super) usize);

    impl Table for Trees {
        fn rows(&self) -> usize {
            self.0
        }

        fn columns(&self) -> &[Column] {
            &[
                Column { name: "id", kind: Kind::Integer },
                Column { name: "species", kind: Kind::Word },
                Column { name: "geometry", kind: Kind::Point },
                Column { name: "z_m", kind: Kind::Real { decimals: 3 } },
                Column { name: "crown_radius_m", kind: Kind::Real { decimals: 3 } },
            ]
        }

        fn values(&self, column: usize, rows: Range<usize>) -> Values<'_> {
            match column {
                0 => Values::Integers(rows.map(|i| 7 * i as i64).collect()),
                1 => Values::Words {
                    indices: rows.map(|i| (i % 2) as u16).collect(),
                    words: Cow::Owned(vec!["oak".into(), "fir's \"best\"".into()]),
                },
                2 => Values::Points(
                    rows.map(|i| [500_000.1 + (i * 37 % 101) as f64, (i / 3) as f64]).collect(),
                ),
                3 => Values::Reals(rows.map(|i| i as f32 / 8.0).collect()),
                _ => Values::Reals(rows.map(|i| (i % 5) as f32).collect()),
            }
        }
    }

    fn written(rows: usize, crs: &Crs) -> (tempfile::TempDir, Connection) {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("a.gpkg");
        let table = Trees(rows);
        let points = Layer {
            name: "plants",
            description: "",
            table: &table,
            shape: Shape::Point { z: "z_m" },
        };
        let crowns = Layer {
            name: "crowns",
            description: "",
            table: &table,
            shape: Shape::Disk { radius: "crown_radius_m" },
        };
        write(&path, &[points, crowns], crs, &Reporter::silent()).unwrap();
        (home, Connection::open(&path).unwrap())
    }

    fn one<T: rusqlite::types::FromSql>(connection: &Connection, sql: &str) -> T {
        connection.query_row(sql, [], |row| row.get(0)).unwrap()
    }

    #[test]
    fn rows_come_back_as_they_went() {
        let rows = PIECE_ROWS + 11;
        let (_home, connection) = written(rows, &Crs::Epsg(32611));
        assert_eq!(one::<String>(&connection, "PRAGMA integrity_check"), "ok");
        assert_eq!(one::<i64>(&connection, "SELECT count(*) FROM plants"), rows as i64);
        let (id, species, z): (i64, String, f64) = connection
            .query_row("SELECT id, species, z_m FROM plants WHERE fid = 8196", [], |row| {
                Ok((row.get(0)?, row.get(1)?, row.get(2)?))
            })
            .unwrap();
        assert_eq!((id, species.as_str(), z), (7 * 8195, "fir's \"best\"", 8195.0 / 8.0));
    }

    #[test]
    fn the_file_says_what_it_is() {
        let (home, connection) = written(100, &Crs::Epsg(32611));
        let head = std::fs::read(home.path().join("a.gpkg")).unwrap();
        assert_eq!(&head[68..72], b"GPKG");
        assert_eq!(one::<u32>(&connection, "PRAGMA user_version"), 10_300);
        let place = "FROM gpkg_contents JOIN gpkg_spatial_ref_sys USING (srs_id) WHERE table_name = 'plants'";
        assert_eq!(one::<u32>(&connection, &format!("SELECT srs_id {place}")), 32_611);
        let wkt: String = one(&connection, &format!("SELECT definition {place}"));
        assert!(wkt.starts_with("PROJCS[\"WGS 84 / UTM zone 11N\""), "{wkt}");
        assert_eq!(one::<f64>(&connection, &format!("SELECT min_x {place}")), 500_000.1);
        assert_eq!(one::<f64>(&connection, &format!("SELECT max_y {place}")), 33.0);
    }

    #[test]
    fn local_metres_are_an_undefined_plane() {
        let (_home, connection) = written(1, &Crs::Local);
        let srs: i32 = one(&connection, "SELECT srs_id FROM gpkg_geometry_columns");
        assert_eq!(srs, -1);
    }

    #[test]
    fn layers_without_rows_are_layers() {
        let (_home, connection) = written(0, &Crs::Local);
        let count = "SELECT count(*) FROM rtree_plants_geom WHERE minx > 0";
        assert_eq!(one::<u32>(&connection, count), 0);
        let min_x: Option<f64> = one(&connection, "SELECT min_x FROM gpkg_contents");
        assert_eq!(min_x, None);
        assert_eq!(one::<String>(&connection, "SELECT rtreecheck('rtree_plants_geom')"), "ok");
    }

    #[test]
    fn the_index_finds_what_a_scan_finds() {
        for rows in [1, 51, 52, 3000] {
            let (_home, connection) = written(rows, &Crs::Epsg(32611));
            for layer in ["plants", "crowns"] {
                let check = format!("SELECT rtreecheck('rtree_{layer}_geom')");
                assert_eq!(one::<String>(&connection, &check), "ok", "{layer} {rows}");
            }
            let table = Trees(rows);
            let Values::Points(points) = table.values(2, 0..rows) else { unreachable!() };
            let within = |[x, y]: &&[f64; 2]| {
                (500_020.0..=500_050.0).contains(x) && (10.0..=700.0).contains(y)
            };
            let expected = points.iter().filter(within).count();
            let sql = "SELECT count(*) FROM rtree_plants_geom \
                       WHERE maxx >= 500020 AND minx <= 500050 AND maxy >= 10 AND miny <= 700";
            assert_eq!(one::<i64>(&connection, sql), expected as i64);
        }
    }

    #[test]
    fn equal_tables_are_equal_bytes_on_any_number_of_threads() {
        let bytes = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let (home, connection) = pool.install(|| written(20_000, &Crs::Epsg(3794)));
            drop(connection);
            std::fs::read(home.path().join("a.gpkg")).unwrap()
        };
        assert!(bytes(1) == bytes(2));
    }
}
