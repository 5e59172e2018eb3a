//! LAS, LAZ and COPC point clouds.
//!
//! Reading order: this file (the cloud), `header` (layout and records), `points` (records to columns), `write`;
//! `attributed` (points with measures of their own).

mod attributed;
mod header;
mod points;
mod write;

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

pub use attributed::{Attribute, AttributeValues, AttributedPoints, write_attributed};
pub use write::write_laz;

use rayon::prelude::*;

use super::{Error, Limits, ParseError, geokeys, wkt};
use crate::raster::{Crs, LengthUnit, MapWindow, Projector};

/// Step of projected coordinates, metres; chosen: a tenth of the accuracy of the best scanners.
const PROJECTED_STEP_M: f64 = 0.001;
/// Points whose median stands for the middle of all. chosen: off by 1 % of the cloud's width at most.
const MIDDLE_SAMPLE: usize = 10_000;

/// How stored integers become coordinates: `offset + scale · integer`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantization {
    /// Map units a step.
    pub scale: f64,
    /// Map coordinate of integer 0.
    pub offset: f64,
}

impl Quantization {
    /// The coordinate of a stored integer, in the cloud's unit.
    #[inline]
    pub fn coordinate(&self, step: i32) -> f64 {
        self.offset + self.scale * f64::from(step)
    }

    fn times(self, factor: f64) -> Self {
        Self { scale: self.scale * factor, offset: self.offset * factor }
    }

    /// The nearest step, `None` where it is beyond 32 bits.
    #[inline]
    fn step(&self, coordinate: f64) -> Option<i32> {
        let step = ((coordinate - self.offset) / self.scale).round();
        (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&step).then_some(step as i32) // in range
    }

    /// These steps if they reach from `low` to `high`; else wider ones, as wide as is needed.
    fn reaching(self, low: f64, high: f64) -> Self {
        if self.step(low).is_some() && self.step(high).is_some() {
            return self;
        }
        // half a step at either end is lost to rounding
        let steps = f64::from(i32::MAX - 1);
        Self { scale: self.scale.max((high - low) / steps), offset: low }
    }
}

/// Points a column each, in the order of the file.
#[derive(Clone, Debug, Default)]
struct Columns {
    x: Vec<i32>,
    y: Vec<i32>,
    z: Vec<i32>,
    class: Vec<u8>,
    /// Withheld and noise points left out.
    dropped: u64,
}

impl Columns {
    fn append(&mut self, mut other: Self) {
        self.x.append(&mut other.x);
        self.y.append(&mut other.y);
        self.z.append(&mut other.z);
        self.class.append(&mut other.class);
        self.dropped += other.dropped;
    }

    /// Keeps the points marked.
    fn retain(&mut self, kept: &[bool]) {
        fn retain<T>(column: &mut Vec<T>, kept: &[bool]) {
            let mut marks = kept.iter();
            column.retain(|_| marks.next().is_some_and(|kept| *kept));
        }
        for column in [&mut self.x, &mut self.y, &mut self.z] {
            retain(column, kept);
        }
        retain(&mut self.class, kept);
    }
}

/// A classified point cloud, 13 bytes a point: coordinates stay the integers of the file.
#[derive(Clone, Debug)]
pub struct PointCloud {
    columns: Columns,
    /// x, y, z
    axes: [Quantization; 3],
    /// The CRS the file names, if any.
    pub crs: Option<Crs>,
    /// Why the CRS that the file means to name cannot be told; of no account where the user names it.
    pub crs_problem: Option<ParseError>,
    /// The vertical unit the file names, if any.
    pub vertical_unit: Option<LengthUnit>,
}

/// Smallest and largest coordinates of a cloud, in its units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest x, y, z.
    pub min: [f64; 3],
    /// Largest x, y, z.
    pub max: [f64; 3],
}

impl PointCloud {
    /// A cloud without points, to be filled by [`push`](Self::push).
    pub fn new(
        axes: [Quantization; 3],
        crs: Option<Crs>,
        vertical_unit: Option<LengthUnit>,
    ) -> Self {
        Self { columns: Columns::default(), axes, crs, crs_problem: None, vertical_unit }
    }

    /// Appends a point, rounded to the cloud's steps; coordinates beyond their reach are clamped to it.
    pub fn push(&mut self, position: [f64; 3], class: u8) {
        let step = |axis: usize| {
            let q = self.axes[axis];
            ((position[axis] - q.offset) / q.scale).round() as i32 // `as` saturates
        };
        let steps = [step(0), step(1), step(2)];
        self.columns.x.push(steps[0]);
        self.columns.y.push(steps[1]);
        self.columns.z.push(steps[2]);
        self.columns.class.push(class);
    }

    /// Appends another cloud's points, whose heights must be in the same unit. They are rounded to this
    /// cloud's steps, which widen where 32 bits do not reach over both.
    pub fn append(&mut self, mut other: Self) {
        if self.axes != other.axes
            && let Some(added) = other.bounds()
        {
            let own = self.bounds().unwrap_or(added);
            let axes = std::array::from_fn(|axis| {
                let (low, high) =
                    (own.min[axis].min(added.min[axis]), own.max[axis].max(added.max[axis]));
                self.axes[axis].reaching(low, high)
            });
            self.change_axes(axes);
            other.change_axes(axes);
        }
        self.columns.append(other.columns);
    }

    /// Rounds coordinates to other steps, which must reach over all points.
    fn change_axes(&mut self, axes: [Quantization; 3]) {
        let c = &mut self.columns;
        for (axis, steps) in [&mut c.x, &mut c.y, &mut c.z].into_iter().enumerate() {
            let (old, new) = (self.axes[axis], axes[axis]);
            if old != new {
                steps.par_iter_mut().for_each(|step| {
                    let moved = new.step(old.coordinate(*step));
                    *step = moved.unwrap_or(if *step < 0 { i32::MIN } else { i32::MAX });
                });
            }
        }
        self.axes = axes;
    }

    /// The same cloud with heights in another unit, given the one they are in. No point is touched.
    pub fn with_heights_in(mut self, unit: LengthUnit, own_unit: LengthUnit) -> Self {
        self.axes[2] = self.axes[2].times(own_unit.metres() / unit.metres());
        self.vertical_unit = Some(unit);
        self
    }

    /// The points of a window, its edges included.
    pub fn within(mut self, window: &MapWindow) -> Self {
        let c = &self.columns;
        let [x, y, _] = self.axes;
        let inside = |(east, north): (&i32, &i32)| {
            let (east, north) = (x.coordinate(*east), y.coordinate(*north));
            (window.west..=window.east).contains(&east)
                && (window.south..=window.north).contains(&north)
        };
        let kept: Vec<bool> = c.x.par_iter().zip(&c.y).map(inside).collect();
        if kept.contains(&false) {
            self.columns.retain(&kept);
        }
        self
    }

    /// The cloud in another CRS, rounded to millimetres there, and how many points have no place in it
    /// or lie 2000 km from the rest: they are left out. Heights stay.
    pub fn projected(mut self, projector: &Projector, crs: Crs) -> (Self, usize) {
        let places = self.middle().and_then(|middle| projector.project(middle));
        let Some([middle_x, middle_y]) = places else {
            let lost = self.len();
            self.columns = Columns { dropped: self.columns.dropped, ..Columns::default() };
            return (Self { crs: Some(crs), ..self }, lost);
        };
        let axis = |middle: f64| Quantization { scale: PROJECTED_STEP_M, offset: middle.round() };
        let [old_x, old_y, z] = self.axes;
        let [x, y] = [axis(middle_x), axis(middle_y)];
        let c = &mut self.columns;
        let moved = |(east, north): (&mut i32, &mut i32)| {
            let place = projector.project([old_x.coordinate(*east), old_y.coordinate(*north)]);
            let steps = place.and_then(|[px, py]| Some([x.step(px)?, y.step(py)?]));
            if let Some([px, py]) = steps {
                (*east, *north) = (px, py);
            }
            steps.is_some()
        };
        let kept: Vec<bool> = c.x.par_iter_mut().zip(&mut c.y).map(moved).collect();
        let lost = kept.iter().filter(|kept| !**kept).count();
        if lost > 0 {
            c.retain(&kept);
        }
        self.axes = [x, y, z];
        (Self { crs: Some(crs), ..self }, lost)
    }

    /// Map coordinates amid the points: the medians of a sample, which stray points do not move.
    pub fn middle(&self) -> Option<[f64; 2]> {
        let median = |steps: &[i32]| {
            let every = steps.len().div_ceil(MIDDLE_SAMPLE).max(1);
            let mut sample: Vec<i32> = steps.iter().step_by(every).copied().collect();
            let middle = sample.len() / 2;
            (!sample.is_empty()).then(|| *sample.select_nth_unstable(middle).1)
        };
        let (x, y) = (median(&self.columns.x)?, median(&self.columns.y)?);
        Some([self.axes[0].coordinate(x), self.axes[1].coordinate(y)])
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.columns.x.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.columns.x.is_empty()
    }

    /// x, y and z of a point, in the cloud's units.
    #[inline]
    pub fn position(&self, index: usize) -> [f64; 3] {
        let c = &self.columns;
        [
            self.axes[0].coordinate(c.x[index]),
            self.axes[1].coordinate(c.y[index]),
            self.axes[2].coordinate(c.z[index]),
        ]
    }

    /// ASPRS class of a point.
    #[inline]
    pub fn class(&self, index: usize) -> u8 {
        self.columns.class[index]
    }

    /// Number of points left out when reading: withheld, or of the noise classes 7 and 18.
    pub fn dropped_points(&self) -> u64 {
        self.columns.dropped
    }

    /// Smallest and largest coordinates, `None` without points.
    pub fn bounds(&self) -> Option<Bounds> {
        let c = &self.columns;
        let mut bounds = Bounds { min: [0.0; 3], max: [0.0; 3] };
        for (axis, steps) in [&c.x, &c.y, &c.z].into_iter().enumerate() {
            bounds.min[axis] = self.axes[axis].coordinate(*steps.iter().min()?);
            bounds.max[axis] = self.axes[axis].coordinate(*steps.iter().max()?);
        }
        Some(bounds)
    }

    /// The same cloud with coordinates in metres, given the units they are in.
    /// Only the steps change: no point is touched or rounded.
    pub fn to_metres(mut self, horizontal: LengthUnit, vertical: LengthUnit) -> Self {
        let [x, y, z] = self.axes;
        let factor = horizontal.metres();
        self.axes = [x.times(factor), y.times(factor), z.times(vertical.metres())];
        self.vertical_unit = Some(LengthUnit::Metre);
        self
    }
}

/// Reads a cloud from bytes: points of `window` (all, if none is given) that are neither withheld
/// nor of the noise classes 7 and 18. It is empty where the window misses it.
///
/// # Errors
/// If the bytes are no LAS, LAZ or COPC, are damaged or cut short, hold more points than the limit,
/// or none at all.
pub fn parse<R: Read + Seek>(
    mut reader: R,
    length_bytes: u64,
    window: Option<MapWindow>,
    limits: &Limits,
) -> Result<PointCloud, ParseError> {
    let (header, records) = header::parse(&mut reader, length_bytes)?;
    let Reference { crs, crs_problem, vertical_unit } = reference(&records);
    let columns =
        points::parse(&mut reader, length_bytes, &header, &records.laszip, window, limits)?;
    let axes = std::array::from_fn(|axis| Quantization {
        scale: header.scale[axis],
        offset: header.offset[axis],
    });
    if columns.x.is_empty() && (window.is_none() || header.points == 0) {
        return Err(ParseError::new(
            "it holds no points, or only withheld and noise points",
            "give another cloud",
        ));
    }
    Ok(PointCloud { columns, axes, crs, crs_problem, vertical_unit })
}

/// What a header tells of the place and the units of its points.
#[derive(Debug, Default)]
struct Reference {
    crs: Option<Crs>,
    crs_problem: Option<ParseError>,
    vertical_unit: Option<LengthUnit>,
}

/// CRS and vertical unit: the WKT's, and from the GeoTIFF keys what it does not say.
fn reference(records: &header::Records) -> Reference {
    let (crs, vertical_unit) = wkt::parse(&records.wkt);
    let mut found = Reference { crs, crs_problem: None, vertical_unit };
    if !records.geo_keys.is_empty() && (found.crs.is_none() || found.vertical_unit.is_none()) {
        match geokeys::parse(&records.geo_keys, &records.geo_doubles, &records.geo_ascii) {
            Ok(keys) => {
                found.crs = found.crs.or(keys.crs);
                found.vertical_unit = found.vertical_unit.or(keys.vertical_unit);
            }
            Err(problem) => found.crs_problem = found.crs.is_none().then_some(problem),
        }
    }
    found
}

/// Whether a panic comes from decompressing damaged bits, which [`parse`] catches and tells as an error.
/// For panic hooks, which see it before it is caught.
pub fn is_caught_panic(info: &std::panic::PanicHookInfo<'_>) -> bool {
    info.location().is_some_and(|location| location.file().contains("/laz-"))
}

/// The CRS a cloud's header names, `None` where it is silent; no point is read.
///
/// # Errors
/// If the file cannot be read, its header is damaged, or it names a CRS that is not understood.
pub fn header_crs(path: &Path) -> Result<Option<Crs>, Error> {
    let failed = |source| Error::Read { path: path.to_path_buf(), source };
    let file = File::open(path).map_err(failed)?;
    let length_bytes = file.metadata().map_err(failed)?.len();
    let (_, records) =
        header::parse(&mut BufReader::new(file), length_bytes).map_err(|e| e.at(path))?;
    let Reference { crs, crs_problem, .. } = reference(&records);
    crs_problem.map_or(Ok(crs), |problem| Err(problem.at(path)))
}

/// Reads a LAS, LAZ or COPC file; see [`parse`].
///
/// # Errors
/// If the file cannot be read, or as [`parse`].
pub fn read(path: &Path, window: Option<MapWindow>, limits: &Limits) -> Result<PointCloud, Error> {
    let failed = |source| Error::Read { path: path.to_path_buf(), source };
    let file = File::open(path).map_err(failed)?;
    let length_bytes = file.metadata().map_err(failed)?.len();
    parse(BufReader::new(file), length_bytes, window, limits).map_err(|e| e.at(path))
}

#[cfg(test)]
pub(crate) mod tests {
    use std::io::Cursor;

    use las::point::{Classification, Format};
    use proptest::prelude::*;

    use super::*;

    fn cloud(points: usize) -> PointCloud {
        let axis = |offset| Quantization { scale: 0.01, offset };
        let axes = [axis(400_000.0), axis(5_000_000.0), axis(0.0)];
        let mut cloud = PointCloud::new(axes, Some(Crs::Epsg(3794)), Some(LengthUnit::Metre));
        for i in 0..points {
            let t = i as f64;
            let class = [1, 2, 5, 6][i % 4];
            cloud.push([400_000.0 + t % 97.0, 5_000_000.0 + t / 97.0, 300.0 + t % 13.0], class);
        }
        cloud
    }

    fn parse_bytes(bytes: &[u8]) -> Result<PointCloud, ParseError> {
        let length = bytes.len() as u64;
        parse(Cursor::new(bytes), length, None, &Limits::default())
    }

    fn laz(cloud: &PointCloud) -> Vec<u8> {
        write::write(cloud, Cursor::new(Vec::new())).unwrap().into_inner()
    }

    /// A file as `las` writes it point by point, in the given format.
    fn written(format: u8, compressed: bool, points: &[las::Point]) -> Vec<u8> {
        let mut format = Format::new(format).unwrap();
        format.is_compressed = compressed;
        let mut builder = las::Builder::from((1, 4));
        builder.point_format = format;
        let mut writer =
            las::Writer::new(Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
        for point in points {
            writer.write_point(point.clone()).unwrap();
        }
        writer.into_inner().unwrap().into_inner()
    }

    fn point(format: u8, x: f64, class: Classification) -> las::Point {
        las::Point {
            x,
            y: 2.0 * x,
            z: 3.0 * x,
            classification: class,
            gps_time: (![0, 2].contains(&format)).then_some(x),
            color: [2, 3, 7].contains(&format).then(las::Color::default),
            return_number: 1,
            number_of_returns: 1,
            ..Default::default()
        }
    }

    #[test]
    fn what_is_written_is_read_back() {
        let cloud = cloud(120_001); // three chunks
        let back = parse_bytes(&laz(&cloud)).unwrap();
        assert_eq!(back.axes, cloud.axes);
        assert_eq!((&back.columns.x, &back.columns.y), (&cloud.columns.x, &cloud.columns.y));
        assert_eq!(
            (&back.columns.z, &back.columns.class),
            (&cloud.columns.z, &cloud.columns.class)
        );
        assert_eq!(
            (back.crs.clone(), back.vertical_unit),
            (cloud.crs.clone(), cloud.vertical_unit)
        );
        assert_eq!(back.bounds(), cloud.bounds());
    }

    #[test]
    fn a_written_file_is_whole_and_nothing_else_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("forest.laz");
        write_laz(&cloud(1000), &path).unwrap();
        assert_eq!(read(&path, None, &Limits::default()).unwrap().len(), 1000);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        let error = read(&folder.path().join("none.laz"), None, &Limits::default()).unwrap_err();
        assert!(matches!(error, Error::Read { .. }));
    }

    #[test]
    fn every_layout_gives_the_same_points() {
        use Classification::{Ground, HighVegetation, LowPoint};
        for format in [0, 1, 2, 3, 6, 7] {
            for compressed in [false, true] {
                let mut points: Vec<_> =
                    (0..300).map(|i| point(format, f64::from(i), Ground)).collect();
                points[7].is_withheld = true;
                points[8].classification = LowPoint;
                points[9].classification = HighVegetation;
                points[10].is_synthetic = true;
                points[10].is_key_point = true;
                let read = parse_bytes(&written(format, compressed, &points)).unwrap();
                assert_eq!(read.len(), 298, "format {format}, compressed {compressed}");
                assert_eq!(read.dropped_points(), 2);
                assert_eq!(read.class(7), 5, "the point after those dropped");
                assert_eq!((read.class(8), read.position(8)[0]), (2, 10.0));
                let [x, y, z] = read.position(250);
                assert!((x - 252.0).abs() < 1e-9 && (y - 504.0).abs() < 1e-9, "{x} {y}");
                assert!((z - 756.0).abs() < 1e-9, "{z}");
            }
        }
    }

    #[test]
    fn a_window_keeps_what_is_in_it_edges_included() {
        let bytes = laz(&cloud(5000));
        let read = |west, east| {
            let window = MapWindow { west, south: 5_000_000.0, east, north: 5_000_010.0 };
            parse(Cursor::new(&bytes), bytes.len() as u64, Some(window), &Limits::default())
        };
        let part = read(400_010.0, 400_012.0).unwrap();
        let bounds = part.bounds().unwrap();
        assert_eq!((bounds.min[0], bounds.max[0]), (400_010.0, 400_012.0));
        assert!(read(0.0, 10.0).unwrap().is_empty());
    }

    #[test]
    fn issue_2_joined_clouds_are_not_clamped() {
        let tile = |west: f64, class: u8| {
            let axes = [(1e-6, west), (1e-6, 5e6), (0.01, 0.0)];
            let axes = axes.map(|(scale, offset)| Quantization { scale, offset });
            let mut cloud = PointCloud::new(axes, None, None);
            cloud.push([west, 5_000_000.0, 100.0], class);
            cloud.push([west + 1000.0, 5_001_000.0, 120.5], class);
            cloud
        };
        let mut joined = tile(400_000.0, 2);
        joined.append(tile(403_000.0, 5)); // 1e-6 · 2³¹ reaches 2147 m
        joined.append(tile(390_000.0, 6));
        let expected = [(400_000.0, 2), (401_000.0, 2), (403_000.0, 5), (404_000.0, 5)];
        for (index, (x, class)) in
            expected.into_iter().chain([(390_000.0, 6), (391_000.0, 6)]).enumerate()
        {
            let [east, north, z] = joined.position(index);
            assert!((east - x).abs() < 1e-5, "{index}: {east}");
            assert!((north - 5_000_000.0 - 1000.0 * (index % 2) as f64).abs() < 1e-5);
            assert!((z - 100.0 - 20.5 * (index % 2) as f64).abs() < 1e-9);
            assert_eq!(joined.class(index), class);
        }
    }

    #[test]
    fn heights_change_their_unit() {
        let feet = cloud(3).with_heights_in(LengthUnit::Metre, LengthUnit::Foot);
        assert!((feet.position(2)[2] - 302.0 * 0.3048).abs() < 1e-9);
        assert_eq!(feet.vertical_unit, Some(LengthUnit::Metre));
    }

    #[test]
    fn projected_points_lie_where_the_projector_puts_them() {
        let (from, to) = (Crs::Epsg(3794), Crs::Epsg(32633));
        let projector = Projector::new(&from, &to).unwrap();
        let before = cloud(2000);
        let (after, lost) = before.clone().projected(&projector, to.clone());
        assert_eq!((after.len(), lost, after.crs.clone()), (2000, 0, Some(to)));
        for index in [0, 999, 1999] {
            let ([x, y, z], [px, py, pz]) = (before.position(index), after.position(index));
            let [ex, ey] = projector.project([x, y]).unwrap();
            assert!((px - ex).abs() <= 0.0006 && (py - ey).abs() <= 0.0006 && pz == z);
        }
    }

    #[test]
    fn the_middle_is_where_most_points_are() {
        let mut cloud = cloud(5000);
        cloud.push([900_000.0, 5_000_000.0, 0.0], 2);
        let [x, y] = cloud.middle().unwrap();
        assert!((x - 400_048.0).abs() < 3.0 && (y - 5_000_025.0).abs() < 3.0, "{x} {y}");
        assert_eq!(PointCloud::new(cloud.axes, None, None).middle(), None);
    }

    /// A LAS file whose records are `(record_id, data)` of `LASF_Projection`.
    pub(crate) fn with_records(records: &[(u16, Vec<u8>)]) -> Vec<u8> {
        let mut builder = las::Builder::from((1, 4));
        builder.point_format = Format::new(6).unwrap();
        for (record_id, data) in records {
            builder.vlrs.push(las::Vlr {
                user_id: "LASF_Projection".to_owned(),
                record_id: *record_id,
                description: String::new(),
                data: data.clone(),
            });
        }
        let header = builder.into_header().unwrap();
        let mut writer = las::Writer::new(Cursor::new(Vec::new()), header).unwrap();
        writer.write_point(point(6, 1.0, Classification::Ground)).unwrap();
        writer.into_inner().unwrap().into_inner()
    }

    #[test]
    fn issue_2_keys_that_are_not_understood_wait_for_who_needs_them() {
        // projected, but which system is not said
        let keys: Vec<u8> =
            [1_u16, 1, 0, 1, 1024, 0, 1, 1].iter().flat_map(|k| k.to_le_bytes()).collect();
        let wkt = br#"PROJCS["UTM 33N",UNIT["metre",1],AUTHORITY["EPSG","32633"]]"#.to_vec();
        let cloud = parse_bytes(&with_records(&[(34735, keys.clone()), (2112, wkt)])).unwrap();
        assert_eq!((cloud.crs, cloud.crs_problem), (Some(Crs::Epsg(32633)), None));
        let cloud = parse_bytes(&with_records(&[(34735, keys)])).unwrap();
        assert_eq!(cloud.crs, None);
        assert!(cloud.crs_problem.unwrap().hint.contains("--crs"));
    }

    #[test]
    fn feet_become_metres_without_touching_a_point() {
        let cloud = cloud(50);
        let metric = cloud.clone().to_metres(LengthUnit::UsSurveyFoot, LengthUnit::Foot);
        let (feet, metres) = (cloud.position(9), metric.position(9));
        assert!((metres[0] - feet[0] * 1200.0 / 3937.0).abs() < 1e-8);
        assert!((metres[2] - feet[2] * 0.3048).abs() < 1e-9);
        assert_eq!(metric.columns.x, cloud.columns.x);
    }

    #[test]
    fn clouds_are_joined_in_the_first_ones_steps() {
        let mut first = cloud(10);
        let axis = |offset| Quantization { scale: 0.001, offset };
        let mut second =
            PointCloud::new([axis(399_000.0), axis(5_000_000.0), axis(100.0)], None, None);
        second.push([400_002.503, 5_000_001.0, 250.25], 9);
        first.append(second);
        let [x, y, z] = first.position(10);
        assert!(
            (x - 400_002.5).abs() < 1e-9
                && (y - 5_000_001.0).abs() < 1e-9
                && (z - 250.25).abs() < 1e-9
        );
        assert_eq!((first.len(), first.class(10)), (11, 9));
    }

    /// The file with some bytes of its header replaced.
    fn altered(bytes: &[u8], at: usize, with: &[u8]) -> Result<PointCloud, ParseError> {
        let mut bytes = bytes.to_vec();
        bytes[at..at + with.len()].copy_from_slice(with);
        parse_bytes(&bytes)
    }

    #[test]
    fn impossible_headers_are_refused() {
        for compressed in [false, true] {
            let points: Vec<_> =
                (0..100).map(|i| point(1, f64::from(i), Classification::Ground)).collect();
            let bytes = written(1, compressed, &points);
            assert!(parse_bytes(&bytes).is_ok());
            for (at, with) in [
                (0, b"LASx".to_vec()),
                (25, vec![9]),
                (94, 9_u16.to_le_bytes().to_vec()),
                (96, u32::MAX.to_le_bytes().to_vec()),
                (100, u32::MAX.to_le_bytes().to_vec()),
                (104, vec![0x3f]),
                (105, 3_u16.to_le_bytes().to_vec()),
                (107, u32::MAX.to_le_bytes().to_vec()),
                (131, 0_f64.to_le_bytes().to_vec()),
                (139, (-0.01_f64).to_le_bytes().to_vec()),
                (147, f64::NAN.to_le_bytes().to_vec()),
                (155, f64::INFINITY.to_le_bytes().to_vec()),
            ] {
                let read = altered(&bytes, at, &with);
                assert!(
                    read.is_err(),
                    "byte {at}, compressed {compressed}: {:?}",
                    read.map(|c| c.len())
                );
            }
        }
        let few = Limits { max_points: 99, ..Limits::default() };
        let bytes = laz(&cloud(100));
        assert!(parse(Cursor::new(&bytes), bytes.len() as u64, None, &few).is_err());
    }

    /// Which point format of the damaged files, and whether compressed.
    fn sample(kind: usize) -> &'static [u8] {
        static SAMPLES: std::sync::LazyLock<[Vec<u8>; 4]> = std::sync::LazyLock::new(|| {
            let points = |format| -> Vec<las::Point> {
                (0..400).map(|i| point(format, f64::from(i % 37), Classification::Ground)).collect()
            };
            [
                written(1, false, &points(1)),
                written(3, true, &points(3)),
                written(7, true, &points(7)),
                laz(&cloud(900)),
            ]
        });
        &SAMPLES[kind]
    }

    proptest! {
        #![proptest_config(ProptestConfig::default())]

        #[test]
        fn a_file_cut_short_is_an_error(kind in 0..4_usize, share in 0.0..1.0_f64) {
            let whole = sample(kind);
            let cut = (whole.len() as f64 * share) as usize;
            prop_assert!(parse_bytes(&whole[..cut]).is_err());
        }

        #[test]
        fn damage_anywhere_is_survived(
            kind in 0..4_usize,
            flips in prop::collection::vec((0.0..1.0_f64, any::<u8>()), 1..6),
            header_only: bool,
        ) {
            let mut bytes = sample(kind).to_vec();
            let reach = if header_only { bytes.len().min(600) } else { bytes.len() } as f64;
            for (share, value) in flips {
                bytes[(reach * share) as usize] = value;
            }
            let _ = parse_bytes(&bytes);
        }
    }

    #[test]
    fn real_clouds_are_read() {
        let Some(folder) = data() else { return };
        for (name, points, epsg) in [
            ("bcts_1.laz", 531_662, 3005),
            ("osbs.laz", 217_216, 32617),
            ("quebec_topography.laz", 73_403, 2949),
        ] {
            let cloud = read(&folder.join(name), None, &Limits::default()).unwrap();
            assert_eq!((cloud.len(), cloud.crs), (points, Some(Crs::Epsg(epsg))), "{name}");
        }
    }

    /// The folder of real clouds, where there is one.
    pub(crate) fn data() -> Option<std::path::PathBuf> {
        let root = std::env::var_os("WILDWOOD_DATA").map_or_else(
            || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
            Into::into,
        );
        let folder = root.join("clouds");
        if !folder.is_dir() {
            eprintln!("skipped: ../shared/data is missing");
            return None;
        }
        Some(folder)
    }
}
