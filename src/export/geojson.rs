//! A selection as GeoJSON: one collection of all rows in longitude and latitude, each with its table's name.
//!
//! # Reference
//! RFC 7946.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use super::WriteError;
use super::selection::Selection;
use crate::io::table::{Kind, Table, Values};
use crate::progress::Reporter;
use crate::raster::{Crs, CrsError, Projector};

/// Most rows that are written. chosen: some 60 MB of text, about what browsers still draw.
pub const MOST_ROWS: usize = 200_000;

/// Digits behind the point of degrees: a centimetre. chosen: finer than stems are thick.
const DEGREE_DECIMALS: usize = 7;

/// Rows that become text in one piece. chosen: a megabyte.
const PIECE_ROWS: usize = 4096;

/// Longitude and latitude, as the format asks for.
const WGS84: Crs = Crs::Epsg(4326);

/// Writes a file.
///
/// # Errors
/// If there are more than [`MOST_ROWS`], the scene has no place on Earth, the file cannot be written, or the run was cancelled.
pub fn write(path: &Path, selection: &Selection, reporter: &Reporter) -> Result<(), WriteError> {
    if selection.len() > MOST_ROWS {
        let what = format!(
            "{} rows are too many for GeoJSON, which takes {MOST_ROWS} here; choose fewer by --bbox, --layers or --min-height, or export to gpkg",
            selection.len()
        );
        return Err(WriteError::Refused { what });
    }
    let projector = Projector::new(&selection.frame.crs, &WGS84).map_err(|e| {
        let what = match e {
            CrsError::NoPlace => {
                "GeoJSON is in longitude and latitude, and the scene is in local metres; import its terrain with --crs, or export to gpkg".to_owned()
            }
            other => other.to_string(),
        };
        WriteError::Refused { what }
    })?;
    let stage = reporter.stage("geojson", selection.len() as u64);
    let mut out = BufWriter::new(File::create(path)?);
    out.write_all(b"{\"type\":\"FeatureCollection\",\"features\":[")?;
    let mut is_first = true;
    let mut number = 0;
    for of in selection.tables() {
        let table = selection.table(of);
        let table = table.as_ref();
        let starts: Vec<usize> = (0..table.rows()).step_by(PIECE_ROWS).collect();
        let pieces: Vec<Vec<u8>> = starts
            .into_par_iter()
            .map(|start| {
                let rows = start..table.rows().min(start + PIECE_ROWS);
                features(table, of.name(), rows, number, &projector)
            })
            .collect::<Result<_, _>>()?;
        for piece in pieces {
            // each feature begins with the comma behind the one before
            let text = if is_first { &piece[1..] } else { &piece[..] };
            is_first = false;
            out.write_all(text)?;
        }
        number += table.rows();
        stage.advance(table.rows() as u64);
        reporter.check_cancelled()?;
    }
    out.write_all(b"\n]}\n")?;
    out.flush()?;
    Ok(())
}

/// The features of some rows, one a line, each behind a comma; `before` features are in the tables before.
///
/// Features have a number of their own, as ids of rows are unique in their table only.
fn features(
    table: &dyn Table,
    name: &str,
    rows: Range<usize>,
    before: usize,
    projector: &Projector,
) -> Result<Vec<u8>, WriteError> {
    let columns = table.columns();
    let values: Vec<Values<'_>> =
        (0..columns.len()).map(|column| table.values(column, rows.clone())).collect();
    let mut text = Vec::with_capacity(320 * rows.len());
    for row in 0..rows.len() {
        let number = before + rows.start + row + 1;
        write!(text, ",\n{{\"type\":\"Feature\",\"id\":{number},\"geometry\":")?;
        for (column, values) in columns.iter().zip(&values) {
            match values {
                Values::Points(points) if column.kind == Kind::Point => {
                    text.extend_from_slice(b"{\"type\":\"Point\",\"coordinates\":");
                    position(&mut text, points[row], projector)?;
                    text.extend_from_slice(b"}");
                }
                Values::Lines(lines) => {
                    let [thick_end, thin_end] = lines[row];
                    text.extend_from_slice(b"{\"type\":\"LineString\",\"coordinates\":[");
                    position(&mut text, thick_end, projector)?;
                    text.push(b',');
                    position(&mut text, thin_end, projector)?;
                    text.extend_from_slice(b"]}");
                }
                _ => {}
            }
        }
        write!(text, ",\"properties\":{{\"table\":\"{name}\"")?;
        for (column, values) in columns.iter().zip(&values) {
            match values {
                Values::Integers(numbers) => write!(text, ",\"{}\":{}", column.name, numbers[row])?,
                // the fewest digits that read back as the same single float
                Values::Reals(numbers) => write!(text, ",\"{}\":{}", column.name, numbers[row])?,
                Values::Words { indices, words } => {
                    let word: &str = &words[usize::from(indices[row])];
                    let quoted = serde_json::Value::from(word);
                    write!(text, ",\"{}\":{quoted}", column.name)?;
                }
                Values::Points(_) | Values::Lines(_) => {}
            }
        }
        text.extend_from_slice(b"}}");
    }
    Ok(text)
}

/// Longitude and latitude of a place on the map.
fn position(text: &mut Vec<u8>, place: [f64; 2], projector: &Projector) -> Result<(), WriteError> {
    let Some([longitude_deg, latitude_deg]) = projector.project(place) else {
        let [x, y] = place;
        let what = format!("({x}, {y}) has no longitude and latitude; is the scene's CRS right?");
        return Err(WriteError::Refused { what });
    };
    write!(text, "[{longitude_deg:.DEGREE_DECIMALS$},{latitude_deg:.DEGREE_DECIMALS$}]")?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::selection::tests::scene;
    use crate::export::selection::{Filter, Selection};

    #[test]
    fn rows_are_features_in_degrees() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("a.geojson");
        let mut content = scene();
        // the middle of zone 11 at the equator
        let frame = content.elevation_m.frame().as_ref().clone();
        let transform =
            crate::raster::GeoTransform { west_m: 500_000.0, north_m: 20.0, cell_m: 2.0 };
        let frame = crate::raster::Frame { transform, ..frame };
        content.elevation_m = crate::raster::Grid::new(
            frame.into(),
            content.elevation_m.mask().clone(),
            content.elevation_m.values().to_vec(),
        );
        let selection = Selection::new(content, &Filter::default()).unwrap();
        write(&path, &selection, &Reporter::silent()).unwrap();
        let read: serde_json::Value =
            serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
        let features = read["features"].as_array().unwrap();
        assert_eq!(features.len(), 6);
        assert!(features.iter().map(|f| f["id"].as_u64().unwrap()).eq(1..=6));
        let first = &features[0];
        assert_eq!(first["geometry"]["coordinates"], serde_json::json!([-117.0, 0.0]));
        assert_eq!(first["properties"]["table"], "plants");
        assert_eq!(first["properties"]["height_m"], 20.0);
        let log = &features[5];
        assert_eq!(log["geometry"]["type"], "LineString");
        assert_eq!(log["properties"]["azimuth_deg"], 90.0);
    }
}
