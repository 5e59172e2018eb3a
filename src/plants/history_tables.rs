//! What happened in a simulation as tables: life histories, timeline and growth, in Parquet or comma-separated values.
//!
//! None of them has places. Only a run of rows is in memory beside what is written, and the order of rows where it is
//! another.

use std::borrow::Cow;
use std::io::{self, Write};
use std::ops::Range;

use super::checks;
use super::deadwood::{Cause, GrowthRecord, LifeEvent, LifeEventKind, TimelineRow};
use super::table::{FRACTION, LENGTH, THICKNESS, TableFormat, write_table};
use crate::io::table::{Column, Kind, RowOrder, Table, Values};
use crate::raster::Crs;
use crate::species::Biome;

/// The columns of life histories, a contract with everyone outside: more may follow, none changes its meaning.
pub const HISTORY_COLUMNS: [Column; 6] = [
    Column { name: "plant_id", kind: Kind::Integer },
    Column { name: "year", kind: Kind::Integer },
    Column { name: "month", kind: Kind::Integer },
    Column { name: "event", kind: Kind::Word },
    Column { name: "severity", kind: FRACTION },
    Column { name: "cause", kind: Kind::Word },
];

/// Square metres of stems a hectare.
const BASAL_AREA: Kind = Kind::Real { decimals: 4 };

/// The columns of a timeline, likewise.
pub const TIMELINE_COLUMNS: [Column; 22] = [
    Column { name: "year", kind: Kind::Integer },
    Column { name: "species", kind: Kind::Word },
    Column { name: "live", kind: Kind::Integer },
    Column { name: "live_trees", kind: Kind::Integer },
    Column { name: "snags", kind: Kind::Integer },
    Column { name: "downed_logs", kind: Kind::Integer },
    Column { name: "sprouted", kind: Kind::Integer },
    Column { name: "live_m2_ha", kind: BASAL_AREA },
    Column { name: "snag_m2_ha", kind: BASAL_AREA },
    Column { name: "downed_log_m2_ha", kind: BASAL_AREA },
    Column { name: "deaths_age", kind: Kind::Integer },
    Column { name: "deaths_competition", kind: Kind::Integer },
    Column { name: "deaths_drought", kind: Kind::Integer },
    Column { name: "deaths_disease", kind: Kind::Integer },
    Column { name: "deaths_fire", kind: Kind::Integer },
    Column { name: "deaths_storm", kind: Kind::Integer },
    Column { name: "tree_deaths_age", kind: Kind::Integer },
    Column { name: "tree_deaths_competition", kind: Kind::Integer },
    Column { name: "tree_deaths_drought", kind: Kind::Integer },
    Column { name: "tree_deaths_disease", kind: Kind::Integer },
    Column { name: "tree_deaths_fire", kind: Kind::Integer },
    Column { name: "tree_deaths_storm", kind: Kind::Integer },
];

/// The first of the timeline's columns that count deaths, one a cause in the order of [`Cause::ALL`].
const FIRST_DEATHS: usize = 10;

/// Number of causes that kill: the first ones of [`Cause::ALL`]. Decay and self-pruning only bring wood down.
const CAUSES_OF_DEATH: usize = 6;

/// The columns of growth records, likewise.
pub const GROWTH_COLUMNS: [Column; 7] = [
    Column { name: "plant_id", kind: Kind::Integer },
    Column { name: "year", kind: Kind::Integer },
    Column { name: "height_m", kind: LENGTH },
    Column { name: "crown_radius_m", kind: LENGTH },
    Column { name: "dbh_m", kind: THICKNESS },
    Column { name: "vigor", kind: FRACTION },
    Column { name: "carbon_pool", kind: FRACTION },
];

/// Writes life histories in the order of plant ids; what happened to one plant stays in the order given.
///
/// # Errors
/// Whatever writing gives.
///
/// # Panics
/// If an id is 2⁶³ or more.
pub fn write_history<W: Write + Send>(
    out: W,
    events: &[LifeEvent],
    format: TableFormat,
) -> io::Result<()> {
    checks::assert_ids(events.iter().map(|event| event.plant_id), "plant");
    let order = RowOrder::by_key(events.len(), |index| events[index].plant_id);
    write_table(out, &HistoryTable { events, order }, &Crs::Local, format)
}

/// Life histories seen as a table.
struct HistoryTable<'a> {
    events: &'a [LifeEvent],
    order: RowOrder,
}

impl Table for HistoryTable<'_> {
    fn rows(&self) -> usize {
        self.events.len()
    }

    fn columns(&self) -> &[Column] {
        &HISTORY_COLUMNS
    }

    fn values(&self, column: usize, rows: Range<usize>) -> Values<'_> {
        let (events, order) = (self.events, &self.order);
        match HISTORY_COLUMNS[column].name {
            "plant_id" => {
                Values::Integers(order.values(rows, |i| events[i].plant_id.cast_signed()).into())
            }
            "year" => Values::Integers(order.values(rows, |i| i64::from(events[i].year)).into()),
            "month" => Values::Integers(order.values(rows, |i| i64::from(events[i].month)).into()),
            "event" => {
                let indices = order.values(rows, |i| events[i].kind as u16).into();
                let words = LifeEventKind::ALL.map(|kind| kind.name().into()).to_vec().into();
                Values::Words { indices, words }
            }
            "severity" => Values::Reals(order.values(rows, |i| events[i].severity).into()),
            "cause" => {
                let indices = order.values(rows, |i| cause_index(&events[i])).into();
                let words = Cause::ALL.iter().map(|cause| cause.name()).chain([NO_CAUSE]);
                Values::Words { indices, words: words.map(Cow::from).collect() }
            }
            other => unreachable!("column {other} has no values"),
        }
    }
}

/// The word for events that nothing caused: a field without a letter.
const NO_CAUSE: &str = "";

/// Index of an event's cause in [`Cause::ALL`], one past the last for none: only deaths have old age for theirs.
fn cause_index(event: &LifeEvent) -> u16 {
    if event.cause == Cause::Age && event.kind != LifeEventKind::Died {
        Cause::ALL.len() as u16 // eight
    } else {
        event.cause as u16
    }
}

/// Writes a timeline in the order of years and, within them, of the biome's species.
///
/// # Errors
/// Whatever writing gives.
///
/// # Panics
/// If a species is none of the biome's, or if something died of decay or self-pruning, which kill nothing.
pub fn write_timeline<W: Write + Send>(
    out: W,
    rows: &[TimelineRow],
    biome: &Biome,
    format: TableFormat,
) -> io::Result<()> {
    assert!(
        rows.iter().all(|row| row.deaths[CAUSES_OF_DEATH..].iter().all(|deaths| *deaths == 0)),
        "decay and self-pruning kill nothing, so that a timeline counts no such deaths"
    );
    let table = TimelineTable {
        rows,
        species: checks::species_words(rows.iter().map(|row| row.species), biome),
        order: RowOrder::by_key(rows.len(), |index| (rows[index].year, rows[index].species)),
    };
    write_table(out, &table, &Crs::Local, format)
}

/// A timeline seen as a table.
struct TimelineTable<'a> {
    rows: &'a [TimelineRow],
    species: Vec<Cow<'a, str>>,
    order: RowOrder,
}

impl TimelineTable<'_> {
    fn integers(&self, rows: Range<usize>, value: impl Fn(&TimelineRow) -> u32) -> Values<'_> {
        Values::Integers(self.order.values(rows, |i| i64::from(value(&self.rows[i]))).into())
    }

    fn reals(&self, rows: Range<usize>, value: impl Fn(&TimelineRow) -> f32) -> Values<'_> {
        Values::Reals(self.order.values(rows, |i| value(&self.rows[i])).into())
    }
}

impl Table for TimelineTable<'_> {
    fn rows(&self) -> usize {
        self.rows.len()
    }

    fn columns(&self) -> &[Column] {
        &TIMELINE_COLUMNS
    }

    fn values(&self, column: usize, rows: Range<usize>) -> Values<'_> {
        match TIMELINE_COLUMNS[column].name {
            "year" => self.integers(rows, |row| row.year.into()),
            "species" => {
                let indices = self.order.values(rows, |i| self.rows[i].species).into();
                Values::Words { indices, words: self.species.as_slice().into() }
            }
            "live" => self.integers(rows, |row| row.live),
            "live_trees" => self.integers(rows, |row| row.live_trees),
            "snags" => self.integers(rows, |row| row.snags),
            "downed_logs" => self.integers(rows, |row| row.downed_logs),
            "sprouted" => self.integers(rows, |row| row.sprouted),
            "live_m2_ha" => self.reals(rows, |row| row.live_m2_ha),
            "snag_m2_ha" => self.reals(rows, |row| row.snag_m2_ha),
            "downed_log_m2_ha" => self.reals(rows, |row| row.downed_log_m2_ha),
            _ => self.integers(rows, |row| match column - FIRST_DEATHS {
                cause @ 0..CAUSES_OF_DEATH => row.deaths[cause],
                cause => row.tree_deaths[cause - CAUSES_OF_DEATH],
            }),
        }
    }
}

/// Writes growth records in the order of plant ids and, within them, of years.
///
/// # Errors
/// Whatever writing gives.
///
/// # Panics
/// If an id is 2⁶³ or more.
pub fn write_growth<W: Write + Send>(
    out: W,
    records: &[GrowthRecord],
    format: TableFormat,
) -> io::Result<()> {
    checks::assert_ids(records.iter().map(|record| record.plant_id), "plant");
    let key = |index: usize| (records[index].plant_id, records[index].year);
    let order = RowOrder::by_key(records.len(), key);
    write_table(out, &GrowthTable { records, order }, &Crs::Local, format)
}

/// Growth records seen as a table.
struct GrowthTable<'a> {
    records: &'a [GrowthRecord],
    order: RowOrder,
}

impl Table for GrowthTable<'_> {
    fn rows(&self) -> usize {
        self.records.len()
    }

    fn columns(&self) -> &[Column] {
        &GROWTH_COLUMNS
    }

    fn values(&self, column: usize, rows: Range<usize>) -> Values<'_> {
        let (records, order) = (self.records, &self.order);
        let number: fn(&GrowthRecord) -> f32 = match GROWTH_COLUMNS[column].name {
            "plant_id" => {
                let ids = order.values(rows, |i| records[i].plant_id.cast_signed());
                return Values::Integers(ids.into());
            }
            "year" => {
                let years = order.values(rows, |i| i64::from(records[i].year));
                return Values::Integers(years.into());
            }
            "height_m" => |record| record.height_m,
            "crown_radius_m" => |record| record.crown_radius_m,
            "dbh_m" => |record| record.dbh_m,
            "vigor" => |record| record.vigor,
            "carbon_pool" => |record| record.carbon_pool,
            other => unreachable!("column {other} has no values"),
        };
        Values::Reals(order.values(rows, |i| number(&records[i])).into())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::io::geoparquet;

    fn biome() -> Biome {
        Biome::builtin("sonoma").unwrap()
    }

    fn bytes_of(write: impl FnOnce(&mut Vec<u8>) -> io::Result<()>) -> Vec<u8> {
        let mut bytes = Vec::new();
        write(&mut bytes).unwrap();
        bytes
    }

    fn text_of(write: impl FnOnce(&mut Vec<u8>) -> io::Result<()>) -> String {
        String::from_utf8(bytes_of(write)).unwrap()
    }

    /// The integers and reals that a Parquet file holds in a column.
    fn numbers(bytes: &[u8], column: Column) -> Vec<f64> {
        let mut found = Vec::new();
        geoparquet::read(Arc::<[u8]>::from(bytes), &[column], &Crs::Local, 1_000_000, &mut |run| {
            match &run[0] {
                Values::Integers(numbers) => found.extend(numbers.iter().map(|n| *n as f64)),
                Values::Reals(numbers) => found.extend(numbers.iter().map(|n| f64::from(*n))),
                other => panic!("{other:?}"),
            }
            Ok(())
        })
        .unwrap();
        found
    }

    /// The words that a Parquet file holds in a column.
    fn words(bytes: &[u8], column: Column) -> Vec<String> {
        let mut found = Vec::new();
        geoparquet::read(Arc::<[u8]>::from(bytes), &[column], &Crs::Local, 1_000_000, &mut |run| {
            let Values::Words { indices, words } = &run[0] else { panic!("no words") };
            found.extend(indices.iter().map(|index| words[usize::from(*index)].to_string()));
            Ok(())
        })
        .unwrap();
        found
    }

    fn event(plant_id: u64, year: u16, kind: LifeEventKind, cause: Cause) -> LifeEvent {
        LifeEvent { plant_id, year, month: 6, kind, severity: 0.25, cause }
    }

    /// Years one after the other, as a simulation writes them; every plant has something in each.
    fn events(years: u16, plants: u64) -> Vec<LifeEvent> {
        let kind = |year: u16| LifeEventKind::ALL[usize::from(year) % 11];
        let of_year =
            |year| (0..plants).rev().map(move |id| event(id, year, kind(year), Cause::Fire));
        (0..years).flat_map(of_year).collect()
    }

    #[test]
    fn histories_are_sorted_by_plant_and_keep_their_time() {
        let events = events(70, 2000);
        let bytes = bytes_of(|out| write_history(out, &events, TableFormat::Parquet));
        let expected = |value: &dyn Fn(u64, u16) -> f64| -> Vec<f64> {
            (0..2000)
                .flat_map(|id| (0..70).map(move |year| (id, year)))
                .map(|(id, year)| value(id, year))
                .collect()
        };
        assert!(numbers(&bytes, HISTORY_COLUMNS[0]) == expected(&|id, _| id as f64));
        assert!(numbers(&bytes, HISTORY_COLUMNS[1]) == expected(&|_, year| f64::from(year)));
        assert!(numbers(&bytes, HISTORY_COLUMNS[4]) == expected(&|_, _| 0.25));
        let kinds = words(&bytes, HISTORY_COLUMNS[3]);
        assert_eq!(
            kinds[65..75],
            [
                "snag-fell",
                "present",
                "sprouted",
                "infected",
                "recovered",
                "present",
                "sprouted",
                "infected",
                "recovered",
                "burnt"
            ]
        );
    }

    #[test]
    fn history_as_text_names_causes_where_there_are_some() {
        use LifeEventKind::{Died, SnagFell, Sprouted};
        let events = [
            event(9, 2, Died, Cause::Age),
            event(4, 1, Sprouted, Cause::Age),
            event(9, 5, SnagFell, Cause::Decay),
            event(4, 3, Died, Cause::Storm),
        ];
        assert_eq!(
            text_of(|out| write_history(out, &events, TableFormat::Csv)),
            "plant_id,year,month,event,severity,cause\r\n\
             4,1,6,sprouted,0.2500,\r\n4,3,6,died,0.2500,storm\r\n\
             9,2,6,died,0.2500,age\r\n9,5,6,snag-fell,0.2500,decay\r\n"
        );
    }

    #[test]
    fn deaths_have_a_column_a_cause() {
        for (index, cause) in Cause::ALL[..CAUSES_OF_DEATH].iter().enumerate() {
            let column = TIMELINE_COLUMNS[FIRST_DEATHS + index];
            assert_eq!(column.name, format!("deaths_{}", cause.name()));
            let column = TIMELINE_COLUMNS[FIRST_DEATHS + CAUSES_OF_DEATH + index];
            assert_eq!(column.name, format!("tree_deaths_{}", cause.name()));
        }
        assert_eq!(TIMELINE_COLUMNS.len(), FIRST_DEATHS + 2 * CAUSES_OF_DEATH);
    }

    fn timeline() -> Vec<TimelineRow> {
        let row = |year, species| TimelineRow {
            year,
            species,
            live: 1,
            live_trees: 2,
            snags: 3,
            downed_logs: 4,
            sprouted: 5,
            live_m2_ha: 6.0,
            snag_m2_ha: 7.0,
            downed_log_m2_ha: 8.0,
            deaths: [9, 10, 11, 12, 13, 14, 0, 0],
            tree_deaths: [1, 2, 3, 4, 5, 6, 0, 0],
        };
        vec![row(1, 1), row(1, 0), row(0, 1)]
    }

    #[test]
    fn timelines_are_sorted_by_year_and_species() {
        let biome = biome();
        let text = text_of(|out| write_timeline(out, &timeline(), &biome, TableFormat::Csv));
        let [first, second] = [0, 1].map(|index| &biome.species[index].key);
        let rest = "1,2,3,4,5,6.0000,7.0000,8.0000,9,10,11,12,13,14,1,2,3,4,5,6\r\n";
        let expected = format!(
            "year,species,live,live_trees,snags,downed_logs,sprouted,live_m2_ha,snag_m2_ha,downed_log_m2_ha,\
             deaths_age,deaths_competition,deaths_drought,deaths_disease,deaths_fire,deaths_storm,\
             tree_deaths_age,tree_deaths_competition,tree_deaths_drought,tree_deaths_disease,tree_deaths_fire,tree_deaths_storm\r\n\
             0,{second},{rest}1,{first},{rest}1,{second},{rest}"
        );
        assert_eq!(text, expected);
        let bytes = bytes_of(|out| write_timeline(out, &timeline(), &biome, TableFormat::Parquet));
        assert_eq!(numbers(&bytes, TIMELINE_COLUMNS[0]), [0.0, 1.0, 1.0]);
        assert_eq!(numbers(&bytes, TIMELINE_COLUMNS[15]), [14.0; 3]);
        assert_eq!(
            &words(&bytes, TIMELINE_COLUMNS[1]),
            &[second, first, second].map(String::clone)
        );
    }

    #[test]
    #[should_panic(expected = "kill nothing")]
    fn deaths_of_decay_are_a_broken_promise() {
        let mut rows = timeline();
        rows[0].deaths[Cause::Decay as usize] = 1;
        let _ = write_timeline(io::sink(), &rows, &biome(), TableFormat::Csv);
    }

    #[test]
    fn growth_is_sorted_by_plant_and_year() {
        let record = |plant_id, year| GrowthRecord {
            plant_id,
            year,
            height_m: 1.5,
            crown_radius_m: 0.5,
            dbh_m: 0.0125,
            vigor: -0.125,
            carbon_pool: 0.75,
        };
        let records = [record(5, 2), record(3, 2), record(5, 1)];
        assert_eq!(
            text_of(|out| write_growth(out, &records, TableFormat::Csv)),
            "plant_id,year,height_m,crown_radius_m,dbh_m,vigor,carbon_pool\r\n\
             3,2,1.500,0.500,0.0125,-0.1250,0.7500\r\n\
             5,1,1.500,0.500,0.0125,-0.1250,0.7500\r\n\
             5,2,1.500,0.500,0.0125,-0.1250,0.7500\r\n"
        );
        let bytes = bytes_of(|out| write_growth(out, &records, TableFormat::Parquet));
        assert_eq!(numbers(&bytes, GROWTH_COLUMNS[1]), [2.0, 1.0, 2.0]);
        assert_eq!(numbers(&bytes, GROWTH_COLUMNS[6]), [0.75; 3]);
    }

    #[test]
    fn no_rows_are_tables_too() {
        let biome = biome();
        for format in [TableFormat::Parquet, TableFormat::Csv] {
            let tables = [
                bytes_of(|out| write_history(out, &[], format)),
                bytes_of(|out| write_timeline(out, &[], &biome, format)),
                bytes_of(|out| write_growth(out, &[], format)),
            ];
            let columns = [HISTORY_COLUMNS[0], TIMELINE_COLUMNS[0], GROWTH_COLUMNS[0]];
            for (bytes, column) in tables.iter().zip(columns) {
                match format {
                    TableFormat::Parquet => assert!(numbers(bytes, column).is_empty()),
                    TableFormat::Csv => assert_eq!(bytes.split(|b| *b == b'\n').count(), 2),
                }
            }
        }
    }
}
