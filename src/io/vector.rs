//! Points, lines and polygons of vector files: GeoJSON and ESRI shapefiles.
//!
//! # Reference
//! RFC 7946 (GeoJSON) and its predecessor of 2008 for the `crs` member; ESRI Shapefile Technical Description, 1998.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use geojson::{GeoJson, Geometry, GeometryValue, JsonObject, JsonValue};

use super::{Error, Limits, ParseError, ParseErrorKind, raster_file, wkt};
use crate::raster::Crs;
use crate::raster::burn::Shape;

/// Bytes read of a vector file at most. chosen: a county's roads take some ten million; in memory GeoJSON is several
/// times as large as its text.
const MAX_BYTES: u64 = 512 << 20;
/// Bytes read of a `.prj` file at most.
const MAX_PRJ_BYTES: u64 = 1 << 20;
/// The first four bytes of a shapefile.
const SHAPEFILE_MAGIC: [u8; 4] = [0, 0, 0x27, 0x0a];
/// Bytes of a shapefile's header.
const SHAPEFILE_HEADER: usize = 100;

/// Shapes in the coordinates of their file.
#[derive(Clone, Debug, PartialEq)]
pub struct VectorLayer {
    /// The shapes.
    pub shapes: Vec<Shape>,
    /// The CRS of their coordinates, `[x, y]` or degrees `[east, north]`; `None` if nothing tells it.
    pub crs: Option<Crs>,
}

/// Whether a file is a vector file, by its first bytes; one that cannot be read is none.
pub fn is_vector(path: &Path) -> bool {
    let mut start = Vec::new();
    let read = File::open(path).and_then(|file| file.take(512).read_to_end(&mut start));
    read.is_ok() && format(&start).is_some()
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    GeoJson,
    Shapefile,
    GeoPackage,
}

fn format(start: &[u8]) -> Option<Format> {
    if start.starts_with(&SHAPEFILE_MAGIC) {
        return Some(Format::Shapefile);
    }
    if start.starts_with(b"SQLite format 3\0") {
        return Some(Format::GeoPackage);
    }
    let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    text.trim_ascii_start().starts_with(b"{").then_some(Format::GeoJson)
}

/// The shapes of a vector file; a shapefile's CRS is that of the `.prj` beside it.
///
/// # Errors
/// If the file cannot be read, is of an unknown format, or its content cannot be used.
pub fn read(path: &Path, limits: &Limits) -> Result<VectorLayer, Error> {
    let bytes = read_up_to(path, MAX_BYTES)?;
    let parsed = match format(&bytes) {
        Some(Format::GeoJson) => parse_geojson(&bytes, limits),
        Some(Format::Shapefile) => {
            let prj = raster_file::beside(path).pop();
            let prj = prj.map(|prj| read_up_to(&prj, MAX_PRJ_BYTES)).transpose()?;
            parse_shapefile(&bytes, prj.as_deref(), limits)
        }
        Some(Format::GeoPackage) => Err(ParseError::new(
            "the file is a GeoPackage, which is not read",
            "write the layer as GeoJSON: ogr2ogr out.geojson in.gpkg",
        )
        .of_kind(ParseErrorKind::Unsupported)),
        None => Err(ParseError::new(
            "the file is neither GeoJSON nor a shapefile (.shp)",
            "write it as GeoJSON: ogr2ogr out.geojson IN",
        )
        .of_kind(ParseErrorKind::Unsupported)),
    };
    parsed.map_err(|e| e.at(path))
}

fn read_up_to(path: &Path, most: u64) -> Result<Vec<u8>, Error> {
    let failed = |source| Error::Read { path: path.to_path_buf(), source };
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(failed)?;
    file.take(most + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > most {
        let what = format!("the file has more than {most} bytes");
        return Err(ParseError::new(what, "cut it to the scene: ogr2ogr -clipsrc").at(path));
    }
    Ok(bytes)
}

/// Shapes gathered up to the limit of vertices.
struct Gathered {
    shapes: Vec<Shape>,
    vertices: usize,
    most_vertices: usize,
}

impl Gathered {
    fn new(limits: &Limits) -> Self {
        Self { shapes: Vec::new(), vertices: 0, most_vertices: limits.max_points }
    }

    fn push(&mut self, shape: Shape) -> Result<(), ParseError> {
        let at = self.shapes.len();
        for point in shape.parts().flatten() {
            if !(point[0].is_finite() && point[1].is_finite()) {
                let what = format!("shape {at}: a coordinate is no finite number");
                return Err(ParseError::new(what, "mend the file, or leave that shape out"));
            }
            self.vertices += 1;
        }
        if self.vertices > self.most_vertices {
            let what = format!("more than {} vertices", self.most_vertices);
            return Err(ParseError::new(what, "cut the file to the scene: ogr2ogr -clipsrc"));
        }
        self.shapes.push(shape);
        Ok(())
    }
}

/// The shapes of a GeoJSON text; in WGS 84 longitude and latitude unless its `crs` member says otherwise.
///
/// # Errors
/// If it is no GeoJSON, names a CRS that is not understood, or passes the limit of vertices.
pub fn parse_geojson(bytes: &[u8], limits: &Limits) -> Result<VectorLayer, ParseError> {
    let text = std::str::from_utf8(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes))
        .map_err(|_| ParseError::new("the text is not UTF-8", "write it anew with ogr2ogr"))?;
    let content: GeoJson = text.parse().map_err(|e: geojson::Error| {
        ParseError::new(format!("no GeoJSON: {e}"), "write it anew: ogr2ogr out.geojson IN")
    })?;
    let mut gathered = Gathered::new(limits);
    let crs = match &content {
        GeoJson::Geometry(geometry) => {
            gather(geometry, &mut gathered)?;
            &geometry.foreign_members
        }
        GeoJson::Feature(feature) => {
            feature.geometry.iter().try_for_each(|g| gather(g, &mut gathered))?;
            &feature.foreign_members
        }
        GeoJson::FeatureCollection(collection) => {
            let geometries = collection.features.iter().filter_map(|f| f.geometry.as_ref());
            geometries.into_iter().try_for_each(|g| gather(g, &mut gathered))?;
            &collection.foreign_members
        }
    };
    let crs = crs_member(crs.as_ref())?;
    if crs.is_none() {
        let beyond = |p: &[f64; 2]| p[0].abs() > 360.0 || p[1].abs() > 90.0;
        let vertices = || gathered.shapes.iter().flat_map(Shape::parts).flatten();
        if let Some([x, y]) = vertices().find(|p| beyond(p)) {
            return Err(ParseError::new(
                format!(
                    "({x}, {y}) is no longitude and latitude, and no `crs` member says what it is"
                ),
                "write it in WGS 84: ogr2ogr -t_srs EPSG:4326 out.geojson IN",
            ));
        }
    }
    let crs = crs.unwrap_or(Crs::Epsg(4326));
    Ok(VectorLayer { shapes: gathered.shapes, crs: Some(crs) })
}

fn gather(geometry: &Geometry, gathered: &mut Gathered) -> Result<(), ParseError> {
    let point = |position: &geojson::Position| match position.as_slice() {
        [x, y, ..] => Ok([*x, *y]),
        _ => Err(ParseError::new("a position has fewer than two numbers", "mend the file")),
    };
    let line = |positions: &[geojson::Position]| {
        positions.iter().map(point).collect::<Result<Vec<_>, _>>()
    };
    let rings = |rings: &[Vec<geojson::Position>]| {
        rings.iter().map(|ring| line(ring)).collect::<Result<Vec<_>, _>>()
    };
    match &geometry.value {
        GeometryValue::Point { coordinates } => gathered.push(Shape::Point(point(coordinates)?)),
        GeometryValue::MultiPoint { coordinates } => {
            coordinates.iter().try_for_each(|p| gathered.push(Shape::Point(point(p)?)))
        }
        GeometryValue::LineString { coordinates } => gathered.push(Shape::Line(line(coordinates)?)),
        GeometryValue::MultiLineString { coordinates } => {
            coordinates.iter().try_for_each(|l| gathered.push(Shape::Line(line(l)?)))
        }
        GeometryValue::Polygon { coordinates } => {
            gathered.push(Shape::Polygon(rings(coordinates)?))
        }
        GeometryValue::MultiPolygon { coordinates } => {
            coordinates.iter().try_for_each(|p| gathered.push(Shape::Polygon(rings(p)?)))
        }
        // the JSON reader bounds how deep they nest
        GeometryValue::GeometryCollection { geometries } => {
            geometries.iter().try_for_each(|g| gather(g, gathered))
        }
    }
}

/// The CRS that a `crs` member names: `EPSG:25832`, `urn:ogc:def:crs:EPSG::25832`, `urn:ogc:def:crs:OGC:1.3:CRS84`.
fn crs_member(members: Option<&JsonObject>) -> Result<Option<Crs>, ParseError> {
    let member = match members.and_then(|members| members.get("crs")) {
        None | Some(JsonValue::Null) => return Ok(None),
        Some(member) => member,
    };
    let name = member.pointer("/properties/name").and_then(JsonValue::as_str);
    let crs = name.and_then(|name| match name.rsplit(':').next()? {
        code if code.eq_ignore_ascii_case("CRS84") => Some(Crs::Epsg(4326)),
        code if name.to_ascii_uppercase().contains("EPSG") => code.parse().ok().map(Crs::Epsg),
        _ => None,
    });
    match crs {
        Some(crs) => Ok(Some(crs)),
        None => {
            let shown: String = name.unwrap_or("no name").chars().take(80).collect();
            let what = format!("the `crs` member names `{shown}`, which is not understood");
            let hint = "write it in WGS 84: ogr2ogr -t_srs EPSG:4326 out.geojson IN";
            Err(ParseError::new(what, hint))
        }
    }
}

/// The shapes of a shapefile's main file (`.shp`); `prj` is the text of the `.prj` beside it.
///
/// # Errors
/// If a record's counts do not fit its length, a kind of shape is not known, or the limit of vertices is passed.
pub fn parse_shapefile(
    bytes: &[u8],
    prj: Option<&[u8]>,
    limits: &Limits,
) -> Result<VectorLayer, ParseError> {
    if bytes.len() < SHAPEFILE_HEADER || !bytes.starts_with(&SHAPEFILE_MAGIC) {
        let hint = "give the .shp file itself; copy it again if it is cut short";
        return Err(ParseError::new("no shapefile header", hint));
    }
    let crs = prj.and_then(|prj| wkt::parse(&String::from_utf8_lossy(prj)).0);
    if prj.is_some() && crs.is_none() {
        let hint = "write it as GeoJSON in WGS 84: ogr2ogr -t_srs EPSG:4326 out.geojson IN";
        return Err(ParseError::new("its .prj names no CRS that is understood", hint));
    }
    let mut gathered = Gathered::new(limits);
    let mut rest = &bytes[SHAPEFILE_HEADER..];
    let mut record = 0_usize;
    while !rest.is_empty() {
        record += 1;
        let cut = || {
            let what = format!("record {record} does not fit the file or its own counts");
            ParseError::new(
                what,
                "the file is damaged: copy it again, or write it anew with ogr2ogr",
            )
        };
        let words = rest.get(4..8).map(|b| i32::from_be_bytes([b[0], b[1], b[2], b[3]]));
        let length = words.and_then(|words| usize::try_from(words).ok()).ok_or_else(cut)?;
        let content = length.checked_mul(2).and_then(|length| rest.get(8..8 + length));
        let content = content.ok_or_else(cut)?;
        rest = &rest[8 + content.len()..];
        let kind = int_at(content, 0).ok_or_else(cut)?;
        // kinds with z (1…) and measures (2…) begin with the flat part
        match kind {
            0 => {}
            1 | 11 | 21 => gathered.push(Shape::Point(point_at(content, 4).ok_or_else(cut)?))?,
            8 | 18 | 28 => {
                let count = int_at(content, 36).ok_or_else(cut)?;
                for point in points_at(content, 40, count).ok_or_else(cut)? {
                    gathered.push(Shape::Point(point))?;
                }
            }
            3 | 13 | 23 => {
                let parts = parts(content).ok_or_else(cut)?;
                parts.into_iter().try_for_each(|part| gathered.push(Shape::Line(part)))?;
            }
            5 | 15 | 25 => gathered.push(Shape::Polygon(parts(content).ok_or_else(cut)?))?,
            _ => {
                let what = format!("record {record} is a shape of kind {kind}, which is not read");
                let hint = "points, lines and polygons are; convert it with ogr2ogr -nlt";
                return Err(ParseError::new(what, hint).of_kind(ParseErrorKind::Unsupported));
            }
        }
    }
    Ok(VectorLayer { shapes: gathered.shapes, crs })
}

/// The number at a place, where it is not negative.
fn int_at(content: &[u8], at: usize) -> Option<usize> {
    let bytes: [u8; 4] = content.get(at..at + 4)?.try_into().ok()?;
    usize::try_from(i32::from_le_bytes(bytes)).ok()
}

fn point_at(content: &[u8], at: usize) -> Option<[f64; 2]> {
    let number = |at: usize| -> Option<f64> {
        Some(f64::from_le_bytes(content.get(at..at + 8)?.try_into().ok()?))
    };
    Some([number(at)?, number(at + 8)?])
}

/// So many points from a place on; none of it is believed before it is there.
fn points_at(content: &[u8], at: usize, count: usize) -> Option<Vec<[f64; 2]>> {
    content.get(at..at.checked_add(count.checked_mul(16)?)?)?;
    (0..count).map(|i| point_at(content, at + 16 * i)).collect()
}

/// The parts of a line or polygon: counts at 36 and 40, then where each part begins, then all points.
fn parts(content: &[u8]) -> Option<Vec<Vec<[f64; 2]>>> {
    let (part_count, point_count) = (int_at(content, 36)?, int_at(content, 40)?);
    let points_from = part_count.checked_mul(4)?.checked_add(44)?;
    let points = points_at(content, points_from, point_count)?;
    let starts: Vec<usize> =
        (0..part_count).map(|i| int_at(content, 44 + 4 * i)).collect::<Option<_>>()?;
    let ends = starts.iter().skip(1).copied().chain([point_count]);
    starts.iter().zip(ends).map(|(&start, end)| Some(points.get(start..end)?.to_vec())).collect()
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use proptest::prelude::*;
    use shapefile::{
        Multipoint, Point, PointZ, Polygon, PolygonRing, Polyline, PolylineZ, Shape as Esri,
    };

    use super::*;

    const COLLECTION: &str = r#"{"type": "FeatureCollection",
        "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}},
        "features": [
            {"type": "Feature", "properties": {"name": "road"}, "geometry":
                {"type": "LineString", "coordinates": [[500000, 5e6], [500100, 5000100, 312.5]]}},
            {"type": "Feature", "properties": null, "geometry": null},
            {"type": "Feature", "properties": {}, "geometry": {"type": "GeometryCollection", "geometries": [
                {"type": "MultiPoint", "coordinates": [[1, 2], [3, 4]]},
                {"type": "MultiPolygon", "coordinates": [[[[0, 0], [9, 0], [0, 9], [0, 0]]]]}]}}]}"#;

    fn json(text: &str) -> Result<VectorLayer, ParseError> {
        parse_geojson(text.as_bytes(), &Limits::default())
    }

    #[test]
    fn geojson_is_read_with_its_crs() {
        let layer = json(COLLECTION).unwrap();
        assert_eq!(layer.crs, Some(Crs::Epsg(25832)));
        assert_eq!(
            layer.shapes,
            [
                Shape::Line(vec![[500_000.0, 5e6], [500_100.0, 5_000_100.0]]),
                Shape::Point([1.0, 2.0]),
                Shape::Point([3.0, 4.0]),
                Shape::Polygon(vec![vec![[0.0, 0.0], [9.0, 0.0], [0.0, 9.0], [0.0, 0.0]]]),
            ]
        );
        let bare = json(r#"{"type": "Point", "coordinates": [14.5, 46.0]}"#).unwrap();
        assert_eq!(
            (bare.crs, bare.shapes),
            (Some(Crs::Epsg(4326)), vec![Shape::Point([14.5, 46.0])])
        );
        let crs84 = COLLECTION.replace("EPSG::25832", "OGC:1.3:CRS84");
        assert_eq!(json(&crs84).unwrap().crs, Some(Crs::Epsg(4326)));
    }

    #[test]
    fn geojson_errors_say_what_is_wrong() {
        let message = |text: &str| json(text).unwrap_err().to_string();
        assert!(message("{").contains("no GeoJSON"));
        assert!(message(&COLLECTION.replace("25832", "x")).contains("`urn:ogc:def:crs:EPSG::x`"));
        assert!(message(&COLLECTION.replace("\"crs\"", "\"crs2\"")).contains("longitude"));
        assert!(message(r#"{"type": "Point", "coordinates": [1]}"#).contains("no GeoJSON"));
        let deep = "{\"type\":\"GeometryCollection\",\"geometries\":[".repeat(100_000);
        assert!(message(&deep).contains("no GeoJSON"));
        let limits = Limits { max_points: 3, ..Limits::default() };
        let error = parse_geojson(COLLECTION.as_bytes(), &limits).unwrap_err().to_string();
        assert!(error.contains("more than 3 vertices"), "{error}");
    }

    fn shapefile_of<S: shapefile::record::EsriShape>(shapes: &[S]) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        {
            let mut writer = shapefile::ShapeWriter::new(&mut bytes);
            shapes.iter().for_each(|shape| writer.write_shape(shape).unwrap());
        }
        bytes.into_inner()
    }

    /// Written by the crate `shapefile`.
    fn polygons() -> Vec<u8> {
        let ring = |points: &[(f64, f64)]| points.iter().map(|&(x, y)| Point::new(x, y)).collect();
        shapefile_of(&[Polygon::with_rings(vec![
            PolygonRing::Outer(ring(&[(0.0, 0.0), (0.0, 9.0), (9.0, 9.0), (9.0, 0.0)])),
            PolygonRing::Inner(ring(&[(2.0, 2.0), (4.0, 2.0), (4.0, 4.0)])),
        ])])
    }

    #[test]
    fn shapefiles_are_read_as_another_program_writes_them() {
        let read = |bytes: &[u8]| parse_shapefile(bytes, None, &Limits::default()).unwrap();
        let layer = read(&polygons());
        let Shape::Polygon(rings) = &layer.shapes[0] else { panic!("{layer:?}") };
        assert_eq!((rings.len(), rings[0].len(), rings[1].len()), (2, 5, 4));
        assert!(rings[0].contains(&[9.0, 9.0]) && layer.crs.is_none());
        let (a, b, c) = (Point::new(1.0, 2.0), Point::new(3.0, 4.0), Point::new(5.0, 6.0));
        let lines = read(&shapefile_of(&[Polyline::with_parts(vec![vec![a, b], vec![b, c, a]])]));
        assert_eq!(lines.shapes[0], Shape::Line(vec![[1.0, 2.0], [3.0, 4.0]]));
        assert_eq!(lines.shapes[1], Shape::Line(vec![[3.0, 4.0], [5.0, 6.0], [1.0, 2.0]]));
        let points = read(&shapefile_of(&[Multipoint::new(vec![a, c])]));
        assert_eq!(points.shapes, [Shape::Point([1.0, 2.0]), Shape::Point([5.0, 6.0])]);
        let z = |x: f64| PointZ::new(x, 2.0, 300.0, 0.0);
        let line = read(&shapefile_of(&[PolylineZ::new(vec![z(1.0), z(2.0)])]));
        assert_eq!(line.shapes, [Shape::Line(vec![[1.0, 2.0], [2.0, 2.0]])]);
        // the crate reads the same
        let mut reader = shapefile::ShapeReader::new(Cursor::new(polygons())).unwrap();
        let Some(Ok(Esri::Polygon(other))) = reader.iter_shapes().next() else { panic!() };
        let rings_of =
            other.rings().iter().map(|r| r.points().iter().map(|p| [p.x, p.y]).collect());
        assert_eq!(*rings, rings_of.collect::<Vec<Vec<_>>>());
    }

    #[test]
    fn shapefile_errors_say_what_is_wrong() {
        let limits = Limits::default();
        let message = |bytes: &[u8]| parse_shapefile(bytes, None, &limits).unwrap_err().to_string();
        let whole = polygons();
        assert!(message(&whole[..60]).contains("header"));
        assert!(message(&whole[..whole.len() - 8]).contains("record 1"));
        let with = |at: usize, byte: u8| {
            let mut bytes = whole.clone();
            bytes[at] = byte;
            message(&bytes)
        };
        assert!(with(108, 31).contains("kind 31"));
        assert!(with(108 + 43, 0x7f).contains("record 1"));
        assert!(with(108 + 39, 0xff).contains("record 1"));
        let prj = parse_shapefile(&whole, Some(b"nonsense"), &limits).unwrap_err().to_string();
        assert!(prj.contains(".prj"), "{prj}");
    }

    #[test]
    fn files_are_told_by_their_first_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, content: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, content).unwrap();
            path
        };
        let geojson = write("roads.txt", format!("\u{feff}\n{COLLECTION}").as_bytes());
        assert!(is_vector(&geojson) && !is_vector(&folder.path().join("none")));
        assert_eq!(read(&geojson, &Limits::default()).unwrap().shapes.len(), 4);
        let shp = write("roads.shp", &polygons());
        let utm = r#"PROJCS["WGS_1984_UTM_Zone_10N",GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["False_Easting",500000.0],PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",-123.0],PARAMETER["Scale_Factor",0.9996],PARAMETER["Latitude_Of_Origin",0.0],UNIT["Meter",1.0]]"#;
        write("roads.prj", utm.as_bytes());
        assert_eq!(read(&shp, &Limits::default()).unwrap().crs, Some(Crs::Epsg(32610)));
        let package = read(&write("a.gpkg", b"SQLite format 3\0rest"), &Limits::default());
        assert!(package.unwrap_err().to_string().contains("ogr2ogr"));
        let other = read(&write("a.txt", b"roads"), &Limits::default()).unwrap_err().to_string();
        assert!(other.contains("a.txt") && other.contains("neither"), "{other}");
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(cut in 0..400_usize, flip in 0..400_usize, bit in 0..8_u32) {
            for (whole, is_json) in [(COLLECTION.as_bytes().to_vec(), true), (polygons(), false)] {
                let parse = |bytes: &[u8]| match is_json {
                    true => parse_geojson(bytes, &Limits::default()).is_ok(),
                    false => parse_shapefile(bytes, None, &Limits::default()).is_ok(),
                };
                let mut damaged = whole.clone();
                let at = flip % damaged.len();
                damaged[at] ^= 1 << bit;
                parse(&damaged);
                parse(&damaged[..cut % whole.len()]);
            }
        }
    }
}
