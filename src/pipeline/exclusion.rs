//! Ground that a user keeps free of trees: roads, buildings, fields, as a raster or as shapes.

use std::path::Path;

use super::Error;
use super::onto_scene::{projector, read_nearest};
use crate::io::vector;
use crate::io::{Limits, ParseError};
use crate::progress::{Reporter, Warning};
use crate::raster::burn::{self, Shape};
use crate::raster::{Crs, Frame, Mask};

/// Width that lines and points are given, metres. chosen: a lane and its verges.
pub const DEFAULT_WIDTH_M: f64 = 6.0;
/// Greatest width, metres. chosen: more is a mistyped number.
const MOST_WIDTH_M: f64 = 10_000.0;

/// The cells of `frame` that an exclusion file leaves to trees: valid where they may stand.
///
/// Excluded are cells whose centre lies in a valid raster cell with a value other than 0, in a polygon, or within half of
/// `width_m` of a line or a point.
///
/// # Errors
/// If the width is no width, the file cannot be read, or its place on Earth is not clear.
pub fn read_exclusion(
    path: &Path,
    width_m: f64,
    frame: &Frame,
    limits: &Limits,
    reporter: &Reporter,
) -> Result<Mask, Error> {
    if !(0.0..=MOST_WIDTH_M).contains(&width_m) {
        let what =
            format!("--exclude-width is {width_m}; give metres between 0 and {MOST_WIDTH_M}");
        return Err(Error::Usage { what });
    }
    let excluded = if vector::is_vector(path) {
        let layer = vector::read(path, limits)?;
        let shapes = onto_scene(path, layer, frame, reporter)?;
        burn::covered(&shapes, width_m, frame)
    } else {
        let raster = read_nearest(path, frame, limits, reporter)?;
        raster
            .values
            .iter()
            .zip(&raster.valid)
            .map(|(value, valid)| *valid && *value != 0.0)
            .collect()
    };
    if !excluded.contains(&true) {
        let text = format!(
            "{}: it excludes no cell of the scene; does it lie where the scene does?",
            path.display()
        );
        reporter.warn(Warning::Other { text });
    }
    Ok(Mask::new(excluded.into_iter().map(|excluded| !excluded).collect()))
}

/// The shapes in the scene's coordinates.
fn onto_scene(
    path: &Path,
    layer: vector::VectorLayer,
    frame: &Frame,
    reporter: &Reporter,
) -> Result<Vec<Shape>, Error> {
    let Some(of_file) = &layer.crs else {
        projector(path, &frame.crs, None, &frame.crs, reporter)?;
        return Ok(layer.shapes);
    };
    if frame.crs == Crs::Local && *of_file == Crs::Epsg(4326) {
        let hint =
            "give the scene its CRS (--crs EPSG:n), or exclude with a raster of its own cells";
        let what = "it is in longitude and latitude, and the scene has no place on Earth";
        return Err(ParseError::new(what, hint).at(path).into());
    }
    let Some(projector) = projector(path, of_file, Some(of_file), &frame.crs, reporter)? else {
        return Ok(layer.shapes);
    };
    // what has no place in the scene's CRS lies on another side of the Earth
    let moved = layer.shapes.iter().filter_map(|shape| shape.moved(|p| projector.project(p)));
    Ok(moved.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::{Cell, GeoTransform, Projector};

    const ASC: &str = "ncols 4\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 5\nNODATA_value -9999\n0 1 -9999 0\n7 0 0 0\n";

    fn read(
        name: &str,
        content: &str,
        width_m: f64,
        frame: &Frame,
    ) -> (Result<Mask, Error>, Vec<Warning>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        let reporter = Reporter::silent();
        let mask = read_exclusion(&path, width_m, frame, &Limits::default(), &reporter);
        (mask, reporter.warnings())
    }

    #[test]
    fn rasters_exclude_where_they_are_not_zero() {
        let frame = Frame::local(10, 20, 1.0);
        let mask = read("mask.asc", ASC, 6.0, &frame).0.unwrap();
        let open = |row: usize, col: usize| mask.is_valid(frame.index(Cell { row, col }));
        assert_eq!(mask.valid_count(), 200 - 50);
        assert!(
            open(0, 0) && !open(0, 5) && !open(4, 9) && open(2, 12) && !open(7, 2) && open(7, 7)
        );
    }

    fn utm() -> Frame {
        let transform = GeoTransform { west_m: 500_000.0, north_m: 5_100_200.0, cell_m: 1.0 };
        Frame { transform, crs: Crs::Epsg(32633), ..Frame::local(200, 200, 1.0) }
    }

    #[test]
    fn a_road_in_degrees_is_excluded_with_its_width() {
        let frame = utm();
        let to_degrees = Projector::new(&frame.crs, &Crs::Epsg(4326)).unwrap();
        let at = |east: f64, north: f64| {
            let [x, y] = to_degrees.project([500_000.0 + east, 5_100_000.0 + north]).unwrap();
            format!("[{x:.9}, {y:.9}]")
        };
        let road = format!(
            r#"{{"type": "LineString", "coordinates": [{}, {}]}}"#,
            at(-50.0, 40.3),
            at(250.0, 100.3)
        );
        let (mask, warnings) = read("road.geojson", &road, 8.0, &frame);
        let excluded = 40_000 - mask.unwrap().valid_count();
        // 8 m across, along 200 m eastward: 8 · 200 · √(1 + 0.2²)
        assert!((excluded as f64 / (1600.0 * 1.04_f64.sqrt()) - 1.0).abs() < 0.02, "{excluded}");
        assert_eq!(warnings, []);
        let (mask, warnings) =
            read("far.geojson", r#"{"type": "Point", "coordinates": [0, 0]}"#, 6.0, &frame);
        assert!(mask.unwrap().is_all_valid() && warnings[0].to_string().contains("far.geojson"));
    }

    #[test]
    fn what_cannot_be_placed_is_told() {
        let point = r#"{"type": "Point", "coordinates": [14, 46]}"#;
        let message = |content: &str, width_m: f64, frame: &Frame| {
            read("a.geojson", content, width_m, frame).0.unwrap_err().to_string()
        };
        let local = message(point, 6.0, &Frame::local(9, 9, 1.0));
        assert!(local.contains("a.geojson") && local.contains("--crs"), "{local}");
        assert!(message(point, -1.0, &utm()).contains("--exclude-width"));
        assert!(message(point, f64::NAN, &utm()).contains("--exclude-width"));
        assert!(message("{}", 6.0, &utm()).contains("a.geojson"));
    }
}
