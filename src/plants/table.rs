//! Plants as a table: GeoParquet in and out, comma-separated values out.
//!
//! Rows stand in the order of ids. Map coordinates are the scene's south-west corner plus the position, in `f64`. Within
//! ±2²³ m (8,388 km) of the system's origin every position reads back to the bit that is 0 or at least 1/64 m; smaller
//! ones read back within 2⁻³¹ m, because the map coordinate has no digits for more.

use std::borrow::Cow;
use std::io::{self, Write};
use std::ops::Range;
use std::sync::Arc;

use super::checks::{self, EDIT_AGAIN, Place};
use super::{Layer, Plants};
use crate::io::geotiff::ByteSource;
use crate::io::table::{Column, Kind, RowOrder, Table, Values};
use crate::io::{ParseError, csv, geoparquet};
use crate::raster::{Crs, Frame, MapPoint};
use crate::species::Biome;

/// Most plants that are read. chosen: 5 GB of them, as many trees as stand on 1000 km².
pub const MAX_PLANTS: usize = 100_000_000;

/// Digits of lengths in texts: millimetres. chosen: a tenth of what any instrument tells of a tree.
pub(super) const LENGTH: Kind = Kind::Real { decimals: 3 };

/// Digits of diameters in texts: a tenth of a millimetre, as seedlings are thin.
pub(super) const THICKNESS: Kind = Kind::Real { decimals: 4 };

/// Digits of years in texts: enough to tell months apart.
pub(super) const YEARS: Kind = Kind::Real { decimals: 2 };

/// Digits of shares of one in texts.
pub(super) const FRACTION: Kind = Kind::Real { decimals: 4 };

/// The columns, a contract with everyone outside: more may follow, none changes its meaning.
pub const COLUMNS: [Column; 10] = [
    Column { name: "id", kind: Kind::Integer },
    Column { name: "species", kind: Kind::Word },
    Column { name: "layer", kind: Kind::Word },
    Column { name: "geometry", kind: Kind::Point },
    Column { name: "z_m", kind: LENGTH },
    Column { name: "height_m", kind: LENGTH },
    Column { name: "crown_radius_m", kind: LENGTH },
    Column { name: "dbh_m", kind: THICKNESS },
    Column { name: "age_years", kind: YEARS },
    Column { name: "vigor", kind: FRACTION },
];

/// Formats of a table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TableFormat {
    /// GeoParquet, which later runs read.
    #[default]
    Parquet,
    /// Comma-separated values, which everything reads.
    Csv,
}

impl TableFormat {
    /// The format's name in flags, and the ending of its files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Parquet => "parquet",
            Self::Csv => "csv",
        }
    }

    /// The format of a name in a flag.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Parquet, Self::Csv].into_iter().find(|format| format.name() == name)
    }
}

/// Writes plants of a scene on `frame`, in the order of their ids.
///
/// # Errors
/// Whatever writing gives.
///
/// # Panics
/// If an id is 2⁶³ or more, or a species is none of the biome's.
pub fn write<W: Write + Send>(
    out: W,
    plants: &Plants,
    biome: &Biome,
    frame: &Frame,
    format: TableFormat,
) -> io::Result<()> {
    write_table(out, &PlantsTable::new(plants, biome, frame.south_west()), &frame.crs, format)
}

/// Plants as the table of [`COLUMNS`], rows in the order of ids, places in map coordinates of a scene on `frame`.
///
/// # Panics
/// If an id is 2⁶³ or more, or a species is none of the biome's.
pub fn as_table<'a>(plants: &'a Plants, biome: &'a Biome, frame: &Frame) -> Box<dyn Table + 'a> {
    Box::new(PlantsTable::new(plants, biome, frame.south_west()))
}

/// Writes any table whose places, if it has some, are in `crs`.
pub(super) fn write_table<W: Write + Send>(
    out: W,
    table: &dyn Table,
    crs: &Crs,
    format: TableFormat,
) -> io::Result<()> {
    match format {
        TableFormat::Parquet => geoparquet::write(out, table, crs),
        TableFormat::Csv => csv::write(out, table),
    }
}

/// Easting and northing of a position in the scene.
pub(super) fn map_coordinates(south_west: MapPoint, east_m: f32, north_m: f32) -> [f64; 2] {
    [south_west.east_m + f64::from(east_m), south_west.north_m + f64::from(north_m)]
}

/// Plants seen as a table.
struct PlantsTable<'a> {
    plants: &'a Plants,
    species: Vec<Cow<'a, str>>,
    south_west: MapPoint,
    order: RowOrder,
}

impl<'a> PlantsTable<'a> {
    fn new(plants: &'a Plants, biome: &'a Biome, south_west: MapPoint) -> Self {
        checks::assert_ids(plants.id.iter().copied(), "plant");
        let species = checks::species_words(plants.species.iter().copied(), biome);
        let order = RowOrder::by_key(plants.len(), |index| plants.id[index]);
        Self { plants, species, south_west, order }
    }
}

impl Table for PlantsTable<'_> {
    fn rows(&self) -> usize {
        self.plants.len()
    }

    fn columns(&self) -> &[Column] {
        &COLUMNS
    }

    fn values(&self, column: usize, rows: Range<usize>) -> Values<'_> {
        let plants = self.plants;
        let numbers = match COLUMNS[column].name {
            "id" => {
                let ids = self.order.values(rows, |i| plants.id[i].cast_signed());
                return Values::Integers(ids.into());
            }
            "species" => {
                let indices = self.order.values(rows, |i| plants.species[i]);
                return Values::Words {
                    indices: indices.into(),
                    words: self.species.as_slice().into(),
                };
            }
            "layer" => {
                let indices = self.order.values(rows, |i| plants.layer[i] as u16);
                let words = Layer::ALL.map(|layer| layer.name().into()).to_vec();
                return Values::Words { indices: indices.into(), words: words.into() };
            }
            "geometry" => {
                let points = self.order.values(rows, |i| {
                    map_coordinates(self.south_west, plants.east_m[i], plants.north_m[i])
                });
                return Values::Points(points.into());
            }
            "z_m" => &plants.z_m,
            "height_m" => &plants.height_m,
            "crown_radius_m" => &plants.crown_radius_m,
            "dbh_m" => &plants.dbh_m,
            "age_years" => &plants.age_years,
            "vigor" => &plants.vigor,
            other => unreachable!("column {other} has no values"),
        };
        Values::Reals(self.order.values(rows, |i| numbers[i]).into())
    }
}

/// The plants of a GeoParquet file that [`write()`] or a program after it wrote, in the order of the file.
///
/// # Errors
/// If the file is damaged or lacks a column, if a plant is of a species that is not the biome's, stands outside the
/// scene, has a measure that no plant can have or another's id, or if there are more than `max_plants`.
pub fn read<S>(
    source: Arc<S>,
    biome: &Biome,
    frame: &Frame,
    max_plants: usize,
) -> Result<Plants, ParseError>
where
    S: ByteSource + Send + ?Sized + 'static,
{
    let mut plants = Plants::default();
    let place = Place::new(frame);
    geoparquet::read(source, &COLUMNS, &frame.crs, max_plants, &mut |run| {
        append(&mut plants, run, biome, &place)
    })?;
    checks::check_ids(&plants.id, "plant")?;
    Ok(plants)
}

/// Adds a run of rows, whose columns are [`COLUMNS`].
fn append(
    plants: &mut Plants,
    run: Vec<Values<'static>>,
    biome: &Biome,
    place: &Place,
) -> Result<(), ParseError> {
    let start = plants.id.len();
    for (column, values) in COLUMNS.iter().zip(run) {
        match (column.name, values) {
            ("id", Values::Integers(ids)) => {
                checks::append_ids(&mut plants.id, &ids, "plant")?;
            }
            ("species", Values::Words { indices, words }) => {
                let index = |key: &str| checks::species_index(biome, key);
                checks::append_words(&mut plants.species, &indices, &words, index)?;
            }
            ("layer", Values::Words { indices, words }) => {
                let layer = |name: &str| {
                    Layer::from_name(name).ok_or_else(|| {
                        checks::unknown_word(name, "layer", &Layer::ALL.map(Layer::name))
                    })
                };
                checks::append_words(&mut plants.layer, &indices, &words, layer)?;
            }
            ("geometry", Values::Points(points)) => {
                for (row, point) in (start..).zip(points.iter()) {
                    let (east_m, north_m) = place.position(*point).ok_or_else(|| {
                        let [x, y] = point;
                        let what = format!(
                            "the plant of row {row} stands at ({x}, {y}), outside the scene"
                        );
                        ParseError::new(what, EDIT_AGAIN)
                    })?;
                    plants.east_m.push(east_m);
                    plants.north_m.push(north_m);
                }
            }
            (name, Values::Reals(numbers)) => {
                let (into, least) = match name {
                    "z_m" => (&mut plants.z_m, f32::MIN),
                    "height_m" => (&mut plants.height_m, 0.0),
                    "crown_radius_m" => (&mut plants.crown_radius_m, 0.0),
                    "dbh_m" => (&mut plants.dbh_m, 0.0),
                    "age_years" => (&mut plants.age_years, 0.0),
                    _ => (&mut plants.vigor, f32::MIN),
                };
                checks::append_reals(into, &numbers, least..=f32::MAX, "plant", name)?;
            }
            (name, _) => unreachable!("column {name} was read as another kind"),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::io::ParseErrorKind;
    use crate::raster::GeoTransform;

    fn biome() -> Biome {
        Biome::builtin("sonoma").unwrap()
    }

    /// 4 × 6 km whose south-west corner is the given one.
    fn frame(west_m: f64, south_m: f64, crs: Crs) -> Frame {
        let transform = GeoTransform { west_m, north_m: south_m + 4000.0, cell_m: 2.0 };
        Frame { rows: 2000, cols: 3000, transform, crs }
    }

    fn utm_frame() -> Frame {
        frame(723_456.5, 4_712_345.25, Crs::Epsg(32611))
    }

    /// Plants all over the frame, of every species and layer.
    fn plants(count: usize) -> Plants {
        let fraction = |i: usize, step: usize| (i * step % 65_521) as f32 / 65_521.0;
        let all = |value: &dyn Fn(usize) -> f32| (0..count).map(value).collect::<Vec<f32>>();
        Plants {
            id: (0..count as u64).map(|i| 3 * i + 1).collect(),
            species: (0..count).map(|i| (i % 16) as u16).collect(),
            layer: (0..count).map(|i| Layer::ALL[i % 2]).collect(),
            east_m: all(&|i| fraction(i, 7919) * 6000.0),
            north_m: all(&|i| fraction(i, 104_729) * 4000.0),
            z_m: all(&|i| 500.0 * fraction(i, 31) - 20.0),
            height_m: all(&|i| 60.0 * fraction(i, 37)),
            crown_radius_m: all(&|i| 8.0 * fraction(i, 41)),
            dbh_m: all(&|i| 2.0 * fraction(i, 43)),
            age_years: all(&|i| 900.0 * fraction(i, 47)),
            vigor: all(&|i| 1.2 * fraction(i, 53) - 0.2),
        }
    }

    fn written(plants: &Plants, frame: &Frame) -> Vec<u8> {
        let mut bytes = Vec::new();
        write(&mut bytes, plants, &biome(), frame, TableFormat::Parquet).unwrap();
        bytes
    }

    fn read_bytes(bytes: &[u8], frame: &Frame) -> Result<Plants, ParseError> {
        read(Arc::<[u8]>::from(bytes), &biome(), frame, MAX_PLANTS)
    }

    #[test]
    fn plants_read_back_to_the_bit() {
        for count in [0, 1, 1000, 140_000] {
            let mut plants = plants(count);
            // nearer to the edge than 1/64 m coordinates have no digits for every bit
            for position in plants.east_m.iter_mut().chain(&mut plants.north_m) {
                *position = if *position < 1.0 / 64.0 { 0.0 } else { *position };
            }
            assert_eq!(read_bytes(&written(&plants, &utm_frame()), &utm_frame()), Ok(plants));
        }
    }

    #[test]
    fn rows_stand_in_the_order_of_ids() {
        let sorted = plants(100);
        let mut reversed = sorted.clone();
        let Plants {
            id,
            species,
            layer,
            east_m,
            north_m,
            z_m,
            height_m,
            crown_radius_m,
            dbh_m,
            age_years,
            vigor,
        } = &mut reversed;
        id.reverse();
        species.reverse();
        layer.reverse();
        for numbers in [east_m, north_m, z_m, height_m, crown_radius_m, dbh_m, age_years, vigor] {
            numbers.reverse();
        }
        assert!(sorted != reversed);
        assert!(written(&sorted, &utm_frame()) == written(&reversed, &utm_frame()));
    }

    #[test]
    fn same_bytes_for_one_thread_and_two() {
        let of_threads = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut csv = Vec::new();
                let plants = plants(140_000);
                write(&mut csv, &plants, &biome(), &utm_frame(), TableFormat::Csv).unwrap();
                (written(&plants, &utm_frame()), csv)
            })
        };
        assert!(of_threads(1) == of_threads(2));
    }

    #[test]
    fn text_has_the_columns_in_map_coordinates() {
        let mut text = Vec::new();
        let mut plants = plants(1);
        (plants.east_m[0], plants.north_m[0]) = (10.125, 3999.0);
        write(&mut text, &plants, &biome(), &utm_frame(), TableFormat::Csv).unwrap();
        let key = &biome().species[0].key;
        let expected = format!(
            "id,species,layer,x,y,z_m,height_m,crown_radius_m,dbh_m,age_years,vigor\r\n\
             1,{key},canopy,723466.6250,4716344.2500,-20.000,0.000,0.000,0.0000,0.00,-0.2000\r\n"
        );
        assert_eq!(String::from_utf8(text).unwrap(), expected);
    }

    /// What reading says of plants that were changed after they were valid.
    fn trouble(change: impl Fn(&mut Plants)) -> String {
        let mut plants = plants(10);
        change(&mut plants);
        read_bytes(&written(&plants, &utm_frame()), &utm_frame()).unwrap_err().to_string()
    }

    #[test]
    fn what_no_plant_can_be_is_refused() {
        for (problem, names) in [
            (trouble(|p| p.east_m[3] = -0.5), "outside the scene"),
            (trouble(|p| p.north_m[3] = 4000.5), "row 3"),
            (trouble(|p| p.east_m[3] = f32::NAN), "outside the scene"),
            (trouble(|p| p.height_m[4] = -1.0), "height_m = -1"),
            (trouble(|p| p.vigor[5] = f32::NAN), "vigor = NaN"),
            (trouble(|p| p.z_m[5] = f32::INFINITY), "z_m = inf"),
            (trouble(|p| p.id[5] = p.id[4]), "the id 13"),
        ] {
            assert!(problem.contains(names), "{problem}");
        }
    }

    #[test]
    fn plants_of_another_biome_or_place_are_refused() {
        let bytes = written(&plants(100), &utm_frame());
        let pyrenees = Biome::builtin("pyrenees").unwrap();
        let shared = || Arc::<[u8]>::from(bytes.as_slice());
        let problem = read(shared(), &pyrenees, &utm_frame(), 1000).unwrap_err().to_string();
        let key = &biome().species[0].key;
        assert!(problem.starts_with(&format!("`{key}` is no species of the biome")), "{problem}");
        for elsewhere in [
            frame(723_456.5, 4_712_345.25, Crs::Epsg(32612)),
            frame(723_456.5, 4_712_345.25, Crs::Local),
            frame(823_456.5, 4_712_345.25, Crs::Epsg(32611)),
        ] {
            assert!(read(shared(), &biome(), &elsewhere, 1000).is_err());
        }
        let problem = read(shared(), &biome(), &utm_frame(), 99).unwrap_err();
        assert!(problem.what.contains("more than 99 rows"), "{problem}");
    }

    #[test]
    fn what_is_no_table_is_refused() {
        for bytes in [&b""[..], b"PAR1", b"PAR1PAR1", b"PAR1\0\0\0\0PAR1", &[0xff; 100]] {
            let problem = read_bytes(bytes, &utm_frame()).unwrap_err();
            assert_eq!(problem.kind, ParseErrorKind::Content, "{problem}");
        }
    }

    #[test]
    fn formats_keep_their_names() {
        for format in [TableFormat::Parquet, TableFormat::Csv] {
            assert_eq!(TableFormat::from_name(format.name()), Some(format));
        }
        assert_eq!(TableFormat::from_name("xlsx"), None);
    }

    proptest! {
        #[test]
        fn damaged_files_are_refused_or_read(
            cut in 0..20_000_usize, flips in prop::collection::vec((0..20_000_usize, 1..=255_u8), 0..4),
        ) {
            static BYTES: std::sync::LazyLock<Vec<u8>> = std::sync::LazyLock::new(|| written(&plants(300), &utm_frame()));
            let mut bytes = BYTES.clone();
            let length = bytes.len();
            for (at, flip) in flips {
                bytes[at % length] ^= flip;
            }
            if cut < length {
                // the directory lies at the end: cut out of the middle, so that it is met as well
                bytes.drain(cut..cut + (length - cut) / 7 * (cut % 2));
            }
            let _ = read_bytes(&bytes, &utm_frame());
        }
    }

    /// Prints what a million plants take; run it alone, in release mode.
    #[test]
    #[ignore = "measures"]
    fn a_million_plants_in_a_second() {
        let plants = plants(1_000_000);
        let frame = utm_frame();
        for _ in 0..3 {
            let start = std::time::Instant::now();
            let bytes = written(&plants, &frame);
            let writing = start.elapsed();
            let mut csv = Vec::new();
            let start = std::time::Instant::now();
            write(&mut csv, &plants, &biome(), &frame, TableFormat::Csv).unwrap();
            let as_text = start.elapsed();
            let start = std::time::Instant::now();
            let length = bytes.len();
            let again = read(Arc::<[u8]>::from(bytes), &biome(), &frame, MAX_PLANTS).unwrap();
            println!(
                "parquet {writing:?} for {length} bytes, csv {as_text:?} for {} bytes, read {:?} for {} plants",
                csv.len(),
                start.elapsed(),
                again.len()
            );
        }
    }
}
