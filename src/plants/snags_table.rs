//! Snags as a table: GeoParquet in and out, comma-separated values out. Rows stand in the order of ids.

use std::borrow::Cow;
use std::io::{self, Write};
use std::ops::Range;
use std::sync::Arc;

use super::checks::{self, EDIT_AGAIN, Place};
use super::deadwood::{Cause, Snags};
use super::table::{FRACTION, LENGTH, THICKNESS, TableFormat, YEARS, map_coordinates, write_table};
use crate::io::geotiff::ByteSource;
use crate::io::table::{Column, Kind, RowOrder, Table, Values};
use crate::io::{ParseError, geoparquet};
use crate::raster::{Frame, MapPoint};
use crate::species::Biome;

/// The columns, a contract with everyone outside: more may follow, none changes its meaning.
pub const COLUMNS: [Column; 12] = [
    Column { name: "id", kind: Kind::Integer },
    Column { name: "species", kind: Kind::Word },
    Column { name: "geometry", kind: Kind::Point },
    Column { name: "z_m", kind: LENGTH },
    Column { name: "height_m", kind: LENGTH },
    Column { name: "height_at_death_m", kind: LENGTH },
    Column { name: "dbh_m", kind: THICKNESS },
    Column { name: "years_dead", kind: YEARS },
    Column { name: "decay_class", kind: Kind::Integer },
    Column { name: "density_fraction", kind: FRACTION },
    Column { name: "branch_fraction", kind: FRACTION },
    Column { name: "cause", kind: Kind::Word },
];

/// Writes snags of a scene on `frame`, in the order of their ids.
///
/// # Errors
/// Whatever writing gives.
///
/// # Panics
/// If an id is 2⁶³ or more, or a species is none of the biome's.
pub fn write_snags<W: Write + Send>(
    out: W,
    snags: &Snags,
    biome: &Biome,
    frame: &Frame,
    format: TableFormat,
) -> io::Result<()> {
    write_table(out, &SnagsTable::new(snags, biome, frame), &frame.crs, format)
}

/// Snags as the table of [`COLUMNS`], rows in the order of ids, places in map coordinates of a scene on `frame`.
///
/// # Panics
/// If an id is 2⁶³ or more, or a species is none of the biome's.
pub fn as_table<'a>(snags: &'a Snags, biome: &'a Biome, frame: &Frame) -> Box<dyn Table + 'a> {
    Box::new(SnagsTable::new(snags, biome, frame))
}

/// Snags seen as a table.
struct SnagsTable<'a> {
    snags: &'a Snags,
    species: Vec<Cow<'a, str>>,
    south_west: MapPoint,
    order: RowOrder,
}

impl<'a> SnagsTable<'a> {
    fn new(snags: &'a Snags, biome: &'a Biome, frame: &Frame) -> Self {
        checks::assert_ids(snags.id.iter().copied(), "snag");
        Self {
            snags,
            species: checks::species_words(snags.species.iter().copied(), biome),
            south_west: frame.south_west(),
            order: RowOrder::by_key(snags.len(), |index| snags.id[index]),
        }
    }
}

impl Table for SnagsTable<'_> {
    fn rows(&self) -> usize {
        self.snags.len()
    }

    fn columns(&self) -> &[Column] {
        &COLUMNS
    }

    fn values(&self, column: usize, rows: Range<usize>) -> Values<'_> {
        let (snags, order) = (self.snags, &self.order);
        let numbers = match COLUMNS[column].name {
            "id" => {
                let ids = order.values(rows, |i| snags.id[i].cast_signed());
                return Values::Integers(ids.into());
            }
            "decay_class" => {
                let classes = order.values(rows, |i| i64::from(snags.decay_class[i]));
                return Values::Integers(classes.into());
            }
            "species" => {
                let indices = order.values(rows, |i| snags.species[i]).into();
                return Values::Words { indices, words: self.species.as_slice().into() };
            }
            "cause" => {
                let indices = order.values(rows, |i| snags.cause[i] as u16).into();
                let words = Cause::ALL.map(|cause| cause.name().into()).to_vec().into();
                return Values::Words { indices, words };
            }
            "geometry" => {
                let point =
                    |i: usize| map_coordinates(self.south_west, snags.east_m[i], snags.north_m[i]);
                return Values::Points(order.values(rows, point).into());
            }
            "z_m" => &snags.z_m,
            "height_m" => &snags.height_m,
            "height_at_death_m" => &snags.height_at_death_m,
            "dbh_m" => &snags.dbh_m,
            "years_dead" => &snags.years_dead,
            "density_fraction" => &snags.density_fraction,
            "branch_fraction" => &snags.branch_fraction,
            other => unreachable!("column {other} has no values"),
        };
        Values::Reals(order.values(rows, |i| numbers[i]).into())
    }
}

/// The snags of a GeoParquet file that [`write_snags`] or a program after it wrote, in the order of the file.
///
/// # Errors
/// If the file is damaged or lacks a column, if a snag is of a species that is not the biome's, stands outside the
/// scene, has a measure that no snag can have or another's id, or if there are more than `max_snags`.
pub fn read_snags<S>(
    source: Arc<S>,
    biome: &Biome,
    frame: &Frame,
    max_snags: usize,
) -> Result<Snags, ParseError>
where
    S: ByteSource + Send + ?Sized + 'static,
{
    let mut snags = Snags::default();
    let place = Place::new(frame);
    geoparquet::read(source, &COLUMNS, &frame.crs, max_snags, &mut |run| {
        append(&mut snags, run, biome, &place)
    })?;
    checks::check_ids(&snags.id, "snag")?;
    Ok(snags)
}

/// Adds a run of rows, whose columns are [`COLUMNS`].
fn append(
    snags: &mut Snags,
    run: Vec<Values<'static>>,
    biome: &Biome,
    place: &Place,
) -> Result<(), ParseError> {
    let start = snags.id.len();
    for (column, values) in COLUMNS.iter().zip(run) {
        match (column.name, values) {
            ("id", Values::Integers(ids)) => checks::append_ids(&mut snags.id, &ids, "snag")?,
            ("decay_class", Values::Integers(classes)) => {
                checks::append_decay_classes(&mut snags.decay_class, &classes, "snag")?;
            }
            ("species", Values::Words { indices, words }) => {
                let index = |key: &str| checks::species_index(biome, key);
                checks::append_words(&mut snags.species, &indices, &words, index)?;
            }
            ("cause", Values::Words { indices, words }) => {
                checks::append_words(&mut snags.cause, &indices, &words, checks::cause)?;
            }
            ("geometry", Values::Points(points)) => {
                for (row, point) in (start..).zip(points.iter()) {
                    let (east_m, north_m) = place.position(*point).ok_or_else(|| {
                        let [x, y] = point;
                        let what = format!(
                            "the snag of row {row} stands at ({x}, {y}), outside the scene"
                        );
                        ParseError::new(what, EDIT_AGAIN)
                    })?;
                    snags.east_m.push(east_m);
                    snags.north_m.push(north_m);
                }
            }
            (name, Values::Reals(numbers)) => {
                let (into, allowed) = match name {
                    "z_m" => (&mut snags.z_m, f32::MIN..=f32::MAX),
                    "height_m" => (&mut snags.height_m, 0.0..=f32::MAX),
                    "height_at_death_m" => (&mut snags.height_at_death_m, 0.0..=f32::MAX),
                    "dbh_m" => (&mut snags.dbh_m, 0.0..=f32::MAX),
                    "years_dead" => (&mut snags.years_dead, 0.0..=f32::MAX),
                    "density_fraction" => (&mut snags.density_fraction, 0.0..=1.0),
                    _ => (&mut snags.branch_fraction, 0.0..=1.0),
                };
                checks::append_reals(into, &numbers, allowed, "snag", name)?;
            }
            (name, _) => unreachable!("column {name} was read as another kind"),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::{Crs, GeoTransform};

    fn biome() -> Biome {
        Biome::builtin("sonoma").unwrap()
    }

    fn frame() -> Frame {
        let transform = GeoTransform { west_m: 723_456.5, north_m: 4_716_345.25, cell_m: 2.0 };
        Frame { rows: 2000, cols: 3000, transform, crs: Crs::Epsg(32611) }
    }

    /// Snags all over the frame, of every species, class and cause.
    fn snags(count: usize) -> Snags {
        let fraction = |i: usize, step: usize| (i * step % 65_521) as f32 / 65_521.0;
        let all = |value: &dyn Fn(usize) -> f32| (0..count).map(value).collect::<Vec<f32>>();
        Snags {
            id: (0..count as u64).map(|i| 3 * i + 1).collect(),
            species: (0..count).map(|i| (i % 16) as u16).collect(),
            east_m: all(&|i| 1.0 + fraction(i, 7919) * 5990.0),
            north_m: all(&|i| 1.0 + fraction(i, 104_729) * 3990.0),
            z_m: all(&|i| 500.0 * fraction(i, 31) - 20.0),
            height_m: all(&|i| 40.0 * fraction(i, 37)),
            height_at_death_m: all(&|i| 60.0 * fraction(i, 41)),
            dbh_m: all(&|i| 2.0 * fraction(i, 43)),
            years_dead: all(&|i| 90.0 * fraction(i, 47)),
            decay_class: (0..count).map(|i| 1 + (i % 5) as u8).collect(),
            density_fraction: all(&|i| fraction(i, 53)),
            branch_fraction: all(&|i| fraction(i, 59)),
            cause: (0..count).map(|i| Cause::ALL[i % 8]).collect(),
        }
    }

    fn written(snags: &Snags, format: TableFormat) -> Vec<u8> {
        let mut bytes = Vec::new();
        write_snags(&mut bytes, snags, &biome(), &frame(), format).unwrap();
        bytes
    }

    fn read_again(snags: &Snags) -> Result<Snags, ParseError> {
        let bytes = Arc::<[u8]>::from(written(snags, TableFormat::Parquet));
        read_snags(bytes, &biome(), &frame(), 1_000_000)
    }

    #[test]
    fn snags_read_back_to_the_bit() {
        for count in [0, 1, 1000, 140_000] {
            assert!(read_again(&snags(count)).unwrap() == snags(count), "{count} snags");
        }
    }

    #[test]
    fn rows_stand_in_the_order_of_ids() {
        let mut swapped = snags(3);
        swapped.id = vec![7, 4, 1];
        let again = read_again(&swapped).unwrap();
        assert_eq!(again.id, [1, 4, 7]);
        assert_eq!((again.species, again.decay_class), (vec![2, 1, 0], vec![3, 2, 1]));
        assert_eq!(again.cause, [Cause::Drought, Cause::Competition, Cause::Age]);
    }

    #[test]
    fn text_has_the_columns_in_map_coordinates() {
        let mut one = snags(1);
        (one.east_m[0], one.north_m[0]) = (10.125, 3999.0);
        let expected = format!(
            "id,species,x,y,z_m,height_m,height_at_death_m,dbh_m,years_dead,decay_class,density_fraction,\
             branch_fraction,cause\r\n\
             1,{},723466.6250,4716344.2500,-20.000,0.000,0.000,0.0000,0.00,1,0.0000,0.0000,age\r\n",
            biome().species[0].key
        );
        assert_eq!(String::from_utf8(written(&one, TableFormat::Csv)).unwrap(), expected);
        assert_eq!(written(&snags(0), TableFormat::Csv).split(|b| *b == b'\n').count(), 2);
    }

    #[test]
    fn what_no_snag_can_be_is_refused() {
        let trouble = |change: &dyn Fn(&mut Snags)| {
            let mut snags = snags(10);
            change(&mut snags);
            read_again(&snags).unwrap_err().to_string()
        };
        for (problem, names) in [
            (trouble(&|s| s.east_m[3] = -0.5), "outside the scene"),
            (trouble(&|s| s.north_m[3] = f32::NAN), "row 3"),
            (trouble(&|s| s.height_m[4] = -1.0), "the snag of row 4 has height_m = -1"),
            (trouble(&|s| s.branch_fraction[5] = 1.5), "branch_fraction = 1.5"),
            (trouble(&|s| s.density_fraction[5] = f32::NAN), "density_fraction = NaN"),
            (trouble(&|s| s.decay_class[6] = 0), "the snag of row 6 has decay_class = 0"),
            (trouble(&|s| s.decay_class[6] = 6), "decay_class = 6"),
            (trouble(&|s| s.id[5] = s.id[4]), "two snags have the id 13"),
        ] {
            assert!(problem.contains(names), "{problem}");
        }
        let bytes = Arc::<[u8]>::from(written(&snags(100), TableFormat::Parquet));
        let pyrenees = Biome::builtin("pyrenees").unwrap();
        let problem = read_snags(bytes, &pyrenees, &frame(), 1000).unwrap_err();
        assert!(problem.what.contains("is no species of the biome"), "{problem}");
    }
}
