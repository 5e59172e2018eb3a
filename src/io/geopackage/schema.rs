//! Tables that make an SQLite file a GeoPackage, and those of a layer.

use rusqlite::{Connection, params};

use super::{Bounds, Layer, Shape, sql_columns};
use crate::io::wkt;
use crate::raster::Crs;

/// When the file was made. chosen: equal exports are equal bytes, so no clock is asked.
const LAST_CHANGE: &str = "1970-01-01T00:00:00.000Z";

/// What srs_id stands for a plane of unknown place.
const UNDEFINED_PLANE: i32 = -1;

const TABLES: &str = r#"
PRAGMA application_id = 1196444487; -- "GPKG"
PRAGMA user_version = 10300; -- 1.3.0: GDAL before 3.7 warns of later ones
CREATE TABLE gpkg_spatial_ref_sys (
  srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT
);
CREATE TABLE gpkg_contents (
  table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE, description TEXT DEFAULT '',
  last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
  CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id)
);
CREATE TABLE gpkg_geometry_columns (
  table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL,
  z TINYINT NOT NULL, m TINYINT NOT NULL,
  CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
  CONSTRAINT uk_gc_table_name UNIQUE (table_name),
  CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
  CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id)
);
CREATE TABLE gpkg_extensions (
  table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL, definition TEXT NOT NULL, scope TEXT NOT NULL,
  CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name)
);
CREATE TABLE gpkg_ogr_contents (table_name TEXT NOT NULL PRIMARY KEY, feature_count INTEGER DEFAULT NULL);
INSERT INTO gpkg_spatial_ref_sys VALUES
  ('Undefined Cartesian SRS', -1, 'NONE', -1, 'undefined', 'undefined Cartesian coordinate reference system'),
  ('Undefined geographic SRS', 0, 'NONE', 0, 'undefined', 'undefined geographic coordinate reference system');
"#;

/// Makes the tables of an empty file and gives the number that `crs` has in it.
pub fn create(connection: &Connection, crs: &Crs) -> rusqlite::Result<i32> {
    connection.execute_batch(TABLES)?;
    let describe = |code: u32, crs: &Crs| {
        let definition = wkt::of(crs).unwrap_or("undefined");
        let name = definition.split('"').nth(1).map_or_else(|| crs.to_string(), str::to_owned);
        let row = params![name, code, "EPSG", code, definition];
        connection
            .execute("INSERT INTO gpkg_spatial_ref_sys VALUES (?1, ?2, ?3, ?4, ?5, NULL)", row)
    };
    describe(4326, &Crs::Epsg(4326))?; // asked for of every file
    match crs {
        &Crs::Epsg(4326) => Ok(4326),
        &Crs::Epsg(code) => {
            describe(code, crs)?;
            Ok(i32::try_from(code).unwrap_or(UNDEFINED_PLANE)) // codes have six digits
        }
        // scenes are in no others
        Crs::Local | Crs::Proj(_) => Ok(UNDEFINED_PLANE),
    }
}

/// Makes a layer's table.
pub fn create_layer(
    connection: &Connection,
    layer: &Layer<'_>,
    srs_id: i32,
) -> rusqlite::Result<()> {
    let (kind, has_z) = match layer.shape {
        Shape::Point { .. } => ("POINT", true),
        Shape::Line { .. } => ("LINESTRING", true),
        Shape::Disk { .. } => ("POLYGON", false),
    };
    let columns: String = sql_columns(layer.table.columns())
        .map(|(name, kind)| format!(", \"{name}\" {kind} NOT NULL"))
        .collect();
    connection.execute_batch(&format!(
        "CREATE TABLE \"{}\" (fid INTEGER PRIMARY KEY NOT NULL, geom {kind}{columns})",
        layer.name
    ))?;
    connection.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, last_change, srs_id) \
         VALUES (?1, 'features', ?1, ?2, ?3, ?4)",
        params![layer.name, layer.description, LAST_CHANGE, srs_id],
    )?;
    connection.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?1, 'geom', ?2, ?3, ?4, 0)",
        params![layer.name, kind, srs_id, has_z],
    )?;
    Ok(())
}

/// Says how many rows a layer has, how far they reach, and that they have an index.
pub fn describe_layer(
    connection: &Connection,
    layer: &Layer<'_>,
    boxes: &[Bounds],
) -> rusqlite::Result<()> {
    let union =
        |a: Bounds, b: &Bounds| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])];
    if let Some((first, others)) = boxes.split_first() {
        let [west, south, east, north] = others.iter().fold(*first, union);
        connection.execute(
            "UPDATE gpkg_contents SET min_x = ?2, min_y = ?3, max_x = ?4, max_y = ?5 WHERE table_name = ?1",
            params![layer.name, west, south, east, north],
        )?;
    }
    let rows = boxes.len() as i64; // tables have fewer than 2³² rows
    connection
        .execute("INSERT INTO gpkg_ogr_contents VALUES (?1, ?2)", params![layer.name, rows])?;
    connection.execute(
        "INSERT INTO gpkg_extensions VALUES (?1, 'geom', 'gpkg_rtree_index', \
         'http://www.geopackage.org/spec120/#extension_rtree', 'write-only')",
        params![layer.name],
    )?;
    Ok(())
}

/// Makes the triggers that keep index and number of rows when a program edits the layer.
pub fn create_triggers(connection: &Connection, layer: &str) -> rusqlite::Result<()> {
    let is_something = "(NEW.geom NOTNULL AND NOT ST_IsEmpty(NEW.geom))";
    let is_nothing = "(NEW.geom ISNULL OR ST_IsEmpty(NEW.geom))";
    let index = format!("\"rtree_{layer}_geom\"");
    let replace = format!(
        "INSERT OR REPLACE INTO {index} VALUES \
         (NEW.fid, ST_MinX(NEW.geom), ST_MaxX(NEW.geom), ST_MinY(NEW.geom), ST_MaxY(NEW.geom));"
    );
    let remove = format!("DELETE FROM {index} WHERE id = OLD.fid;");
    let remove_both = format!("DELETE FROM {index} WHERE id IN (OLD.fid, NEW.fid);");
    let same_row = |geometry: &str| format!("OLD.fid = NEW.fid AND {geometry}");
    let other_row = |geometry: &str| format!("OLD.fid != NEW.fid AND {geometry}");
    let triggers = [
        ("insert", "INSERT", is_something.to_owned(), replace.clone()),
        ("update1", "UPDATE OF geom", same_row(is_something), replace.clone()),
        ("update2", "UPDATE OF geom", same_row(is_nothing), remove.clone()),
        ("update3", "UPDATE", other_row(is_something), format!("{remove} {replace}")),
        ("update4", "UPDATE", other_row(is_nothing), remove_both),
        ("delete", "DELETE", "OLD.geom NOTNULL".to_owned(), remove),
    ];
    for (name, event, condition, action) in triggers {
        connection.execute_batch(&format!(
            "CREATE TRIGGER \"rtree_{layer}_geom_{name}\" AFTER {event} ON \"{layer}\" \
             WHEN {condition} BEGIN {action} END"
        ))?;
    }
    for (event, step) in [("insert", "+ 1"), ("delete", "- 1")] {
        connection.execute_batch(&format!(
            "CREATE TRIGGER \"trigger_{event}_feature_count_{layer}\" AFTER {event} ON \"{layer}\" BEGIN \
             UPDATE gpkg_ogr_contents SET feature_count = feature_count {step} \
             WHERE lower(table_name) = lower('{layer}'); END"
        ))?;
    }
    Ok(())
}
