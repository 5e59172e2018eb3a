//! Downed logs as a table: GeoParquet in and out, comma-separated values out. Rows stand in the order of ids.
//!
//! A log is a line from its thick end along its azimuth, as long on the map as the column `length_m` says.

use std::borrow::Cow;
use std::io::{self, Write};
use std::ops::Range;
use std::sync::Arc;

use super::checks::{self, EDIT_AGAIN, Place};
use super::deadwood::{Cause, DownedLogKind, DownedLogs};
use super::table::{FRACTION, LENGTH, THICKNESS, TableFormat, YEARS, map_coordinates, write_table};
use crate::io::geotiff::ByteSource;
use crate::io::table::{Column, Kind, RowOrder, Table, Values};
use crate::io::{ParseError, geoparquet};
use crate::math;
use crate::raster::{Frame, MapPoint};
use crate::species::Biome;

/// How far outside the scene a thick end may lie. chosen: more than any tree is high that stood inside.
const MARGIN_M: f32 = 150.0;

/// How far a thin end may lie from where length and azimuth put it. chosen: more than any rounding of the columns.
const THIN_END_ERROR_M: f64 = 0.01;

/// The columns, a contract with everyone outside: more may follow, none changes its meaning.
pub const COLUMNS: [Column; 14] = [
    Column { name: "id", kind: Kind::Integer },
    Column { name: "parent_id", kind: Kind::Integer },
    Column { name: "species", kind: Kind::Word },
    Column { name: "kind", kind: Kind::Word },
    Column { name: "geometry", kind: Kind::Line },
    Column { name: "z_m", kind: LENGTH },
    Column { name: "length_m", kind: LENGTH },
    Column { name: "diameter_base_m", kind: THICKNESS },
    Column { name: "diameter_tip_m", kind: THICKNESS },
    // at 50 m a thousandth of a degree is less than a millimetre
    Column { name: "azimuth_deg", kind: Kind::Real { decimals: 3 } },
    Column { name: "years_down", kind: YEARS },
    Column { name: "decay_class", kind: Kind::Integer },
    Column { name: "density_fraction", kind: FRACTION },
    Column { name: "cause", kind: Kind::Word },
];

/// Writes downed logs of a scene on `frame`, in the order of their ids.
///
/// # Errors
/// Whatever writing gives.
///
/// # Panics
/// If an id is 2⁶³ or more, or a species is none of the biome's.
pub fn write_downed_logs<W: Write + Send>(
    out: W,
    logs: &DownedLogs,
    biome: &Biome,
    frame: &Frame,
    format: TableFormat,
) -> io::Result<()> {
    write_table(out, &DownedLogsTable::new(logs, biome, frame), &frame.crs, format)
}

/// Downed logs as the table of [`COLUMNS`], rows in the order of ids, places in map coordinates of a scene on `frame`.
///
/// # Panics
/// If an id is 2⁶³ or more, or a species is none of the biome's.
pub fn as_table<'a>(logs: &'a DownedLogs, biome: &'a Biome, frame: &Frame) -> Box<dyn Table + 'a> {
    Box::new(DownedLogsTable::new(logs, biome, frame))
}

/// Downed logs seen as a table.
struct DownedLogsTable<'a> {
    logs: &'a DownedLogs,
    species: Vec<Cow<'a, str>>,
    south_west: MapPoint,
    order: RowOrder,
}

impl<'a> DownedLogsTable<'a> {
    fn new(logs: &'a DownedLogs, biome: &'a Biome, frame: &Frame) -> Self {
        checks::assert_ids(logs.id.iter().copied(), "downed log");
        checks::assert_ids(logs.parent_id.iter().copied(), "plant");
        Self {
            logs,
            species: checks::species_words(logs.species.iter().copied(), biome),
            south_west: frame.south_west(),
            order: RowOrder::by_key(logs.len(), |index| logs.id[index]),
        }
    }
}

impl Table for DownedLogsTable<'_> {
    fn rows(&self) -> usize {
        self.logs.len()
    }

    fn columns(&self) -> &[Column] {
        &COLUMNS
    }

    fn values(&self, column: usize, rows: Range<usize>) -> Values<'_> {
        let (logs, order) = (self.logs, &self.order);
        let numbers = match COLUMNS[column].name {
            "id" => {
                let ids = order.values(rows, |i| logs.id[i].cast_signed());
                return Values::Integers(ids.into());
            }
            "parent_id" => {
                let ids = order.values(rows, |i| logs.parent_id[i].cast_signed());
                return Values::Integers(ids.into());
            }
            "decay_class" => {
                let classes = order.values(rows, |i| i64::from(logs.decay_class[i]));
                return Values::Integers(classes.into());
            }
            "species" => {
                let indices = order.values(rows, |i| logs.species[i]).into();
                return Values::Words { indices, words: self.species.as_slice().into() };
            }
            "kind" => {
                let indices = order.values(rows, |i| logs.kind[i] as u16).into();
                let words = DownedLogKind::ALL.map(|kind| kind.name().into()).to_vec().into();
                return Values::Words { indices, words };
            }
            "cause" => {
                let indices = order.values(rows, |i| logs.cause[i] as u16).into();
                let words = Cause::ALL.map(|cause| cause.name().into()).to_vec().into();
                return Values::Words { indices, words };
            }
            "geometry" => {
                let line = |i: usize| ends_map_m(logs, i, self.south_west);
                return Values::Lines(order.values(rows, line).into());
            }
            "azimuth_deg" => {
                let azimuths = order.values(rows, |i| azimuth_deg(logs.azimuth_rad[i]));
                return Values::Reals(azimuths.into());
            }
            "z_m" => &logs.z_m,
            "length_m" => &logs.length_m,
            "diameter_base_m" => &logs.diameter_base_m,
            "diameter_tip_m" => &logs.diameter_tip_m,
            "years_down" => &logs.years_down,
            "density_fraction" => &logs.density_fraction,
            other => unreachable!("column {other} has no values"),
        };
        Values::Reals(order.values(rows, |i| numbers[i]).into())
    }
}

/// Easting and northing of both ends of a log, the thick one first.
fn ends_map_m(logs: &DownedLogs, index: usize, south_west: MapPoint) -> [[f64; 2]; 2] {
    let [x, y] = map_coordinates(south_west, logs.east_m[index], logs.north_m[index]);
    let length_m = f64::from(logs.length_m[index]);
    let azimuth_rad = f64::from(logs.azimuth_rad[index]);
    let thin_end =
        [x + length_m * math::sin_f64(azimuth_rad), y + length_m * math::cos_f64(azimuth_rad)];
    [[x, y], thin_end]
}

/// A direction in degrees clockwise from north, in 0..=360.
fn azimuth_deg(azimuth_rad: f32) -> f32 {
    f64::from(azimuth_rad).to_degrees().rem_euclid(360.0) as f32 // files hold single floats
}

/// The downed logs of a GeoParquet file that [`write_downed_logs`] or a program after it wrote, in the file's order.
///
/// # Errors
/// If the file is damaged or lacks a column, if a log is of a species that is not the biome's, lies outside the scene
/// by more than a tree's height or otherwise than its length and azimuth say, has a measure that no log can have or
/// another's id, or if there are more than `max_logs`.
pub fn read_downed_logs<S>(
    source: Arc<S>,
    biome: &Biome,
    frame: &Frame,
    max_logs: usize,
) -> Result<DownedLogs, ParseError>
where
    S: ByteSource + Send + ?Sized + 'static,
{
    let mut logs = DownedLogs::default();
    let place = Place::new(frame);
    geoparquet::read(source, &COLUMNS, &frame.crs, max_logs, &mut |run| {
        let start = logs.len();
        let lines = append(&mut logs, run, biome, &place)?;
        check_thin_ends(&logs, start, &lines, frame.south_west())
    })?;
    checks::check_ids(&logs.id, "downed log")?;
    Ok(logs)
}

/// Adds a run of rows, whose columns are [`COLUMNS`], and returns their lines.
fn append(
    logs: &mut DownedLogs,
    run: Vec<Values<'static>>,
    biome: &Biome,
    place: &Place,
) -> Result<Cow<'static, [[[f64; 2]; 2]]>, ParseError> {
    const OF: &str = "downed log";
    let start = logs.len();
    let mut all_lines = Cow::default();
    for (column, values) in COLUMNS.iter().zip(run) {
        match (column.name, values) {
            ("id", Values::Integers(ids)) => checks::append_ids(&mut logs.id, &ids, OF)?,
            ("parent_id", Values::Integers(ids)) => {
                checks::append_ids(&mut logs.parent_id, &ids, "plant")?;
            }
            ("decay_class", Values::Integers(classes)) => {
                checks::append_decay_classes(&mut logs.decay_class, &classes, OF)?;
            }
            ("species", Values::Words { indices, words }) => {
                let index = |key: &str| checks::species_index(biome, key);
                checks::append_words(&mut logs.species, &indices, &words, index)?;
            }
            ("kind", Values::Words { indices, words }) => {
                checks::append_words(&mut logs.kind, &indices, &words, kind)?;
            }
            ("cause", Values::Words { indices, words }) => {
                checks::append_words(&mut logs.cause, &indices, &words, checks::cause)?;
            }
            ("geometry", Values::Lines(lines)) => {
                for (row, [thick_end, _]) in (start..).zip(lines.iter()) {
                    let position = place.position_within(*thick_end, MARGIN_M);
                    let (east_m, north_m) = position.ok_or_else(|| {
                        let [x, y] = thick_end;
                        let what = format!(
                            "the {OF} of row {row} begins at ({x}, {y}), outside the scene"
                        );
                        ParseError::new(what, EDIT_AGAIN)
                    })?;
                    logs.east_m.push(east_m);
                    logs.north_m.push(north_m);
                }
                all_lines = lines;
            }
            ("azimuth_deg", Values::Reals(azimuths_deg)) => {
                let into = &mut logs.azimuth_rad;
                let allowed = f32::MIN..=f32::MAX;
                checks::append_reals(into, &azimuths_deg, allowed, OF, "azimuth_deg")?;
                for azimuth in &mut into[start..] {
                    *azimuth = f64::from(*azimuth).to_radians() as f32; // fits: smaller than before
                }
            }
            (name, Values::Reals(numbers)) => {
                let (into, allowed) = match name {
                    "z_m" => (&mut logs.z_m, f32::MIN..=f32::MAX),
                    "length_m" => (&mut logs.length_m, 0.0..=f32::MAX),
                    "diameter_base_m" => (&mut logs.diameter_base_m, 0.0..=f32::MAX),
                    "diameter_tip_m" => (&mut logs.diameter_tip_m, 0.0..=f32::MAX),
                    "years_down" => (&mut logs.years_down, 0.0..=f32::MAX),
                    _ => (&mut logs.density_fraction, 0.0..=1.0),
                };
                checks::append_reals(into, &numbers, allowed, OF, name)?;
            }
            (name, _) => unreachable!("column {name} was read as another kind"),
        }
    }
    Ok(all_lines)
}

fn kind(name: &str) -> Result<DownedLogKind, ParseError> {
    DownedLogKind::from_name(name).ok_or_else(|| {
        let known = DownedLogKind::ALL.map(DownedLogKind::name);
        checks::unknown_word(name, "kind of downed log", &known)
    })
}

/// Refuses lines that say something else than the columns length and azimuth of the logs from `start` on.
fn check_thin_ends(
    logs: &DownedLogs,
    start: usize,
    lines: &[[[f64; 2]; 2]],
    south_west: MapPoint,
) -> Result<(), ParseError> {
    for (index, [_, found]) in (start..).zip(lines) {
        let [_, expected] = ends_map_m(logs, index, south_west);
        let away = |axis: usize| (found[axis] - expected[axis]).abs();
        // written so that NaN is refused too
        if !(away(0) <= THIN_END_ERROR_M && away(1) <= THIN_END_ERROR_M) {
            let what = format!(
                "the downed log of row {index} ends at ({}, {}), elsewhere than its length and azimuth say",
                found[0], found[1]
            );
            return Err(ParseError::new(what, EDIT_AGAIN));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::raster::{Crs, GeoTransform};

    fn biome() -> Biome {
        Biome::builtin("sonoma").unwrap()
    }

    /// 4 × 6 km whose south-west corner is the given one.
    fn frame(west_m: f64, south_m: f64) -> Frame {
        let transform = GeoTransform { west_m, north_m: south_m + 4000.0, cell_m: 2.0 };
        Frame { rows: 2000, cols: 3000, transform, crs: Crs::Epsg(32611) }
    }

    fn utm_frame() -> Frame {
        frame(723_456.5, 4_712_345.25)
    }

    /// Logs all over the frame and a little beyond, of every species, kind, class and cause, in all directions.
    fn logs(count: usize) -> DownedLogs {
        let fraction = |i: usize, step: usize| (i * step % 65_521) as f32 / 65_521.0;
        let all = |value: &dyn Fn(usize) -> f32| (0..count).map(value).collect::<Vec<f32>>();
        DownedLogs {
            id: (0..count as u64).map(|i| 3 * i + 1).collect(),
            parent_id: (0..count as u64).map(|i| 7 * i % 1001).collect(),
            species: (0..count).map(|i| (i % 16) as u16).collect(),
            kind: (0..count).map(|i| DownedLogKind::ALL[i % 4]).collect(),
            east_m: all(&|i| 1.0 + fraction(i, 7919) * 6020.0),
            north_m: all(&|i| 1.0 + fraction(i, 104_729) * 4020.0),
            z_m: all(&|i| 500.0 * fraction(i, 31) - 20.0),
            length_m: all(&|i| 60.0 * fraction(i, 37)),
            diameter_base_m: all(&|i| 2.0 * fraction(i, 41)),
            diameter_tip_m: all(&|i| 0.5 * fraction(i, 43)),
            azimuth_rad: all(&|i| std::f32::consts::TAU * fraction(i, 47)),
            years_down: all(&|i| 90.0 * fraction(i, 53)),
            decay_class: (0..count).map(|i| 1 + (i % 5) as u8).collect(),
            density_fraction: all(&|i| fraction(i, 59)),
            cause: (0..count).map(|i| Cause::ALL[i % 8]).collect(),
        }
    }

    fn written(logs: &DownedLogs, format: TableFormat) -> Vec<u8> {
        let mut bytes = Vec::new();
        write_downed_logs(&mut bytes, logs, &biome(), &utm_frame(), format).unwrap();
        bytes
    }

    fn read_again(logs: &DownedLogs) -> Result<DownedLogs, ParseError> {
        let bytes = Arc::<[u8]>::from(written(logs, TableFormat::Parquet));
        read_downed_logs(bytes, &biome(), &utm_frame(), 1_000_000)
    }

    /// Degrees in the file cost azimuths their last bits, and nothing else its own.
    #[test]
    fn downed_logs_read_back() {
        for count in [0, 1, 1000, 140_000] {
            let (expected, mut again) = (logs(count), read_again(&logs(count)).unwrap());
            for (found, azimuth) in again.azimuth_rad.iter_mut().zip(&expected.azimuth_rad) {
                assert!((*found - azimuth).abs() < 1e-6, "{found} for {azimuth}");
                *found = *azimuth;
            }
            assert!(again == expected, "{count} logs");
        }
    }

    #[test]
    fn rows_stand_in_the_order_of_ids() {
        let mut swapped = logs(3);
        swapped.id = vec![7, 4, 1];
        let again = read_again(&swapped).unwrap();
        assert_eq!((again.id, again.parent_id), (vec![1, 4, 7], vec![14, 7, 0]));
        assert_eq!(again.kind, [DownedLogKind::Branch, DownedLogKind::Top, DownedLogKind::Trunk]);
        assert_eq!(again.east_m, [swapped.east_m[2], swapped.east_m[1], swapped.east_m[0]]);
    }

    #[test]
    fn text_has_lines_in_map_coordinates() {
        let mut one = logs(1);
        (one.east_m[0], one.north_m[0], one.length_m[0]) = (10.125, 3999.0, 20.0);
        one.azimuth_rad[0] = -std::f32::consts::FRAC_PI_2;
        let expected = format!(
            "id,parent_id,species,kind,wkt,z_m,length_m,diameter_base_m,diameter_tip_m,azimuth_deg,years_down,\
             decay_class,density_fraction,cause\r\n\
             1,0,{},trunk,\"LINESTRING (723466.6250 4716344.2500, 723446.6250 4716344.2500)\",\
             -20.000,20.000,0.0000,0.0000,270.000,0.00,1,0.0000,age\r\n",
            biome().species[0].key
        );
        assert_eq!(String::from_utf8(written(&one, TableFormat::Csv)).unwrap(), expected);
        assert_eq!(written(&logs(0), TableFormat::Csv).split(|b| *b == b'\n').count(), 2);
    }

    #[test]
    fn what_no_downed_log_can_be_is_refused() {
        let trouble = |change: &dyn Fn(&mut DownedLogs)| {
            let mut logs = logs(10);
            change(&mut logs);
            read_again(&logs).unwrap_err().to_string()
        };
        for (problem, names) in [
            (trouble(&|l| l.east_m[3] = -151.0), "outside the scene"),
            (trouble(&|l| l.north_m[3] = f32::NAN), "row 3"),
            (trouble(&|l| l.length_m[4] = -1.0), "the downed log of row 4 has length_m = -1"),
            (trouble(&|l| l.azimuth_rad[4] = f32::NAN), "azimuth_deg = NaN"),
            (trouble(&|l| l.diameter_tip_m[5] = f32::INFINITY), "diameter_tip_m = inf"),
            (trouble(&|l| l.density_fraction[5] = 1.25), "density_fraction = 1.25"),
            (trouble(&|l| l.decay_class[6] = 9), "decay_class = 9"),
            (trouble(&|l| l.id[5] = l.id[4]), "two downed logs have the id 13"),
        ] {
            assert!(problem.contains(names), "{problem}");
        }
    }

    #[test]
    fn lines_that_contradict_their_columns_are_refused() {
        let logs = logs(10);
        let corner = utm_frame().south_west();
        let mut lines: Vec<[[f64; 2]; 2]> = (0..10).map(|i| ends_map_m(&logs, i, corner)).collect();
        assert_eq!(check_thin_ends(&logs, 0, &lines, corner), Ok(()));
        assert!(check_thin_ends(&logs, 1, &lines, corner).is_err());
        for wrong in [lines[7][1][0] + 0.02, f64::NAN] {
            lines[7][1][0] = wrong;
            let problem = check_thin_ends(&logs, 0, &lines, corner).unwrap_err();
            assert!(problem.what.contains("row 7 ends at"), "{problem}");
        }
    }

    proptest! {
        #[test]
        fn lines_are_as_long_and_point_where_the_columns_say(
            west in -8e6..8e6_f64, south in -8e6..8e6_f64, east in 0.0..6000_f32, north in 0.0..4000_f32,
            length in 0.0..120_f32, azimuth in -7.0..14_f32,
        ) {
            let mut logs = logs(1);
            (logs.east_m[0], logs.north_m[0]) = (east, north);
            (logs.length_m[0], logs.azimuth_rad[0]) = (length, azimuth);
            let (biome, frame) = (biome_once(), frame(west, south));
            let table = DownedLogsTable::new(&logs, biome, &frame);
            let column = |name: &str| {
                let at = COLUMNS.iter().position(|column| column.name == name).unwrap();
                table.values(at, 0..1)
            };
            let Values::Lines(lines) = column("geometry") else { panic!("no lines") };
            let [[x, y], [x2, y2]] = lines[0];
            let (dx, dy) = (x2 - x, y2 - y);
            let found_m = (dx * dx + dy * dy).sqrt();
            let [Values::Reals(length_m), Values::Reals(azimuth_deg)] =
                ["length_m", "azimuth_deg"].map(column) else { panic!("no numbers") };
            prop_assert!((found_m - f64::from(length_m[0])).abs() < 1e-3);
            prop_assert!((0.0..=360.0).contains(&azimuth_deg[0]));
            // how far the thin end is off the direction that the column gives
            let along = f64::from(azimuth_deg[0]).to_radians();
            let aside_m = dx * math::cos_f64(along) - dy * math::sin_f64(along);
            let ahead_m = dx * math::sin_f64(along) + dy * math::cos_f64(along);
            prop_assert!(aside_m.abs() < 1e-3 && ahead_m > -1e-3, "{} m, {} m", aside_m, ahead_m);
        }
    }

    fn biome_once() -> &'static Biome {
        static BIOME: std::sync::LazyLock<Biome> = std::sync::LazyLock::new(biome);
        &BIOME
    }
}
