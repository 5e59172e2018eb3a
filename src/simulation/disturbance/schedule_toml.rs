//! The TOML script of disturbances. Units stand in the keys; degrees and km/h end here.
//!
//! `[[event]]` tables happen once, in their `year` and `month`; `[[recurring]]` tables happen by chance, once in
//! `return_years` on average, and take `[low, high]` where an event takes a number. Either has a `type`: `wildfire`,
//! `wind-storm`, `disease` or `drought`. Winds are told by where they come from, in degrees clockwise from north, and
//! places by shares of the terrain's width and height, from its south-west corner.

use toml::de::DeTable;

use super::disease::Disease;
use super::fire::{Ignition, Wildfire};
use super::schedule::{
    Disturbance, Drought, Event, FIRST_INFECTED_FRACTION, IGNITION_RADIUS_M, MAX_DROUGHT_MONTHS,
    MAX_IGNITIONS, MAX_RADIUS_M, MAX_WIND_M_S, MIN_SPREAD_RADIUS_M, Schedule, ScheduleError,
    wind_from, within,
};
use super::schedule_keys::{Script, Table};
use super::schedule_kind::{
    Kind, SEVERITY_PER_MONTH, SPREAD_PROBABILITY_PER_MONTH, SPREAD_RADIUS_M, month, months_or,
    species, storm_speed,
};
use super::schedule_recurring::recurring;
use super::storm::WindStorm;

/// Most events. chosen: as many as the longest script can hold.
const MAX_EVENTS: usize = 20_000;
/// Most recurring disturbances. chosen: each costs a draw a year.
const MAX_RECURRING: usize = 200;
/// Where wind comes from unless told, in degrees: west, where most storms of the middle latitudes come from.
const FROM_DEG: f32 = 270.0;
/// Wind of a fire unless told, in m/s. chosen: a fresh breeze.
const FIRE_WIND_M_S: f32 = 8.0;

/// The schedule of a TOML text; events in the order of the script.
///
/// # Errors
/// Bad TOML, unknown or missing keys, values of the wrong kind or out of range, events after the last year.
pub(super) fn parse(
    text: &str,
    species_keys: &[String],
    years: u16,
) -> Result<Schedule, ScheduleError> {
    let script = Script::new(text);
    let root = DeTable::parse(text).map_err(|error| ScheduleError::Syntax {
        line: script.line(error.span().map_or(0, |span| span.start)),
        problem: error.message().trim().replace('\n', ", "),
    })?;
    let root = Table::root(&script, root.get_ref());
    root.check_keys(&["event", "recurring"])?;
    let mut schedule = Schedule::default();
    if let Some(events) = root.get("event") {
        for table in events.tables(MAX_EVENTS)? {
            schedule.events.push(event(&table, species_keys, years)?);
        }
    }
    if let Some(entries) = root.get("recurring") {
        for table in entries.tables(MAX_RECURRING)? {
            schedule.stochastic.push(recurring(&table, species_keys)?);
        }
    }
    Ok(schedule)
}

fn event(table: &Table<'_>, species_keys: &[String], years: u16) -> Result<Event, ScheduleError> {
    let kind = Kind::of(table)?;
    table.check_keys(&[&["type", "year", "month"], kind.event_keys()].concat())?;
    let entry = table.need("year", "the year of the simulation, from 1")?;
    let year = within(entry.line(), entry.key(), entry.whole(1, u16::MAX)?, years)?;
    let month = table.get("month").map_or(Ok(kind.month()), |entry| month(&entry))?;
    let what = match kind {
        Kind::Wildfire => Disturbance::Wildfire(wildfire(table)?),
        Kind::WindStorm => {
            let (entry, per_m_s) = storm_speed(table)?.ok_or_else(|| {
                table.missing("speed_m_s", "the storm's greatest speed in m/s, or speed_km_h")
            })?;
            let speed_m_s = entry.number(0.0, MAX_WIND_M_S * per_m_s)? / per_m_s;
            let (wind_east_m_s, wind_north_m_s) =
                wind_from(speed_m_s, from_rad(table, "from_deg")?);
            Disturbance::WindStorm(WindStorm { wind_east_m_s, wind_north_m_s })
        }
        Kind::Disease => Disturbance::Disease(disease(table, species_keys)?),
        Kind::Drought => Disturbance::Drought(drought(table)?),
    };
    Ok(Event { year, month, what })
}

/// Where the wind of an event comes from, in radians.
fn from_rad(table: &Table<'_>, key: &str) -> Result<f32, ScheduleError> {
    table.number_or(key, FROM_DEG, 0.0, 360.0).map(f32::to_radians)
}

fn wildfire(table: &Table<'_>) -> Result<Wildfire, ScheduleError> {
    let wind_m_s = table.number_or("wind_m_s", FIRE_WIND_M_S, 0.0, MAX_WIND_M_S)?;
    let (wind_east_m_s, wind_north_m_s) = wind_from(wind_m_s, from_rad(table, "wind_from_deg")?);
    let mut ignitions = Vec::new();
    if let Some(list) = table.get("ignitions") {
        const EXPECTED: &str =
            "a list of places, each { east_fraction = 0.5, north_fraction = 0.5, radius_m = 30 }";
        for place in list.list(1, usize::from(MAX_IGNITIONS), EXPECTED)? {
            let place = place.table(EXPECTED)?;
            place.check_keys(&["east_fraction", "north_fraction", "radius_m"])?;
            let share = |key| place.need(key, "a share in 0..=1")?.number(0.0, 1.0);
            ignitions.push(Ignition {
                east_fraction: share("east_fraction")?,
                north_fraction: share("north_fraction")?,
                radius_m: place.number_or("radius_m", IGNITION_RADIUS_M, 0.0, MAX_RADIUS_M)?,
            });
        }
    }
    Ok(Wildfire { wind_east_m_s, wind_north_m_s, ignitions })
}

fn disease(table: &Table<'_>, species_keys: &[String]) -> Result<Disease, ScheduleError> {
    let share = |key, default| table.number_or(key, default, 0.0, 1.0);
    Ok(Disease {
        species: species(table, species_keys)?,
        east_fraction: share("east_fraction", 0.5)?,
        north_fraction: share("north_fraction", 0.5)?,
        spread_radius_m: table.number_or(
            "spread_radius_m",
            SPREAD_RADIUS_M,
            MIN_SPREAD_RADIUS_M,
            MAX_RADIUS_M,
        )?,
        spread_probability_per_month: share(
            "spread_probability_per_month",
            SPREAD_PROBABILITY_PER_MONTH,
        )?,
        severity_per_month: share("severity_per_month", SEVERITY_PER_MONTH)?,
        contagious_months: months_or(table, "contagious_months", 1)?,
        recovery_months: months_or(table, "recovery_months", 1)?,
        immune_months: months_or(table, "immune_months", 0)?,
        first_infected_fraction: share("first_infected_fraction", FIRST_INFECTED_FRACTION)?,
    })
}

fn drought(table: &Table<'_>) -> Result<Drought, ScheduleError> {
    const EXPECTED: &str =
        "a list of each month's share of the usual rain, such as [0.5, 0.3, 0.2]";
    let list = table.need("rain_fractions", EXPECTED)?;
    let months = list.list(1, usize::from(MAX_DROUGHT_MONTHS), EXPECTED)?;
    let shares: Result<_, _> = months.iter().map(|month| month.number(0.0, 1.0)).collect();
    Ok(Drought { rain_fractions: shares? })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::schedule::drawn;
    use super::*;

    const SCRIPT: &str = r#"# line 1
[[event]]
year = 250
month = 6
type = "disease"
species = "pine"
east_fraction = 0.25
spread_radius_m = 40
spread_probability_per_month = 0.2
recovery_months = inf
immune_months = 24

[[event]]
type = "wildfire"
year = 505
wind_m_s = 15
wind_from_deg = 180
ignitions = [
    { east_fraction = 0.5, north_fraction = 0.4, radius_m = 20 },
    { east_fraction = 0.7, north_fraction = 0.1 },
]
[[event]]
type = "wind-storm"
year = 350
speed_km_h = 72
[[event]]
type = "drought"
year = 504
month = 3
rain_fractions = [
    0.5, 0.3,
    0.2,
]
[[recurring]]
type = "wind-storm"
return_years = 80
speed_m_s = [22, 35]
from_deg = [300, 60]
first_year = 100
last_year = 900
months = [11, 12]
[[recurring]]
type = "drought"
return_years = 35.5
duration_months = 12
rain_fraction = [0.1, 0.4]
"#;

    fn keys() -> Vec<String> {
        ["fir", "pine"].map(str::to_owned).to_vec()
    }

    fn parsed(text: &str) -> Result<Schedule, ScheduleError> {
        parse(text, &keys(), 1000)
    }

    #[test]
    fn events_are_read() {
        let events = parsed(SCRIPT).unwrap().events;
        let whens: Vec<_> = events.iter().map(|event| (event.year, event.month)).collect();
        assert_eq!(whens, [(250, 6), (505, 8), (350, 1), (504, 3)]);
        assert_eq!(
            events[0].what,
            Disturbance::Disease(Disease {
                species: 1,
                east_fraction: 0.25,
                north_fraction: 0.5,
                spread_radius_m: 40.0,
                spread_probability_per_month: 0.2,
                severity_per_month: 0.25,
                contagious_months: 12,
                recovery_months: u16::MAX,
                immune_months: 24,
                first_infected_fraction: 0.3,
            })
        );
        let Disturbance::Wildfire(fire) = &events[1].what else { panic!("{events:?}") };
        // from the south: northward
        assert!(fire.wind_east_m_s.abs() < 1e-5 && (fire.wind_north_m_s - 15.0).abs() < 1e-5);
        let place = |east_fraction, north_fraction, radius_m| Ignition {
            east_fraction,
            north_fraction,
            radius_m,
        };
        assert_eq!(fire.ignitions, [place(0.5, 0.4, 20.0), place(0.7, 0.1, 30.0)]);
        let Disturbance::WindStorm(storm) = &events[2].what else { panic!("{events:?}") };
        // 72 km/h, from the west unless told
        assert!((storm.wind_east_m_s - 20.0).abs() < 1e-5 && storm.wind_north_m_s.abs() < 1e-5);
        let Disturbance::Drought(drought) = &events[3].what else { panic!("{events:?}") };
        assert_eq!(drought.rain_fractions, [0.5, 0.3, 0.2]);
    }

    /// The message when the first line that contains `old` has `new` in its place, after checking its line.
    fn message(old: &str, new: &str) -> String {
        let at = SCRIPT.find(old).unwrap();
        let line = SCRIPT[..at].matches('\n').count() + 1;
        let error = parsed(&SCRIPT.replacen(old, new, 1)).unwrap_err();
        let message = error.to_string();
        assert_eq!(error.line(), Some(line), "{new}: {message}");
        assert!(message.starts_with(&format!("line {line}: ")), "{message}");
        message
    }

    #[test]
    fn trouble_is_told_with_line_and_key() {
        let cases = [
            ("[[event]]", "[[events]]", "`events` is not known; known here are event, recurring"),
            ("year = 250", "year = 0", "year = 0 is outside 1..=65535; give a number within"),
            ("year = 250", "year = 70000", "year = 70000 is outside 1..=65535"),
            ("year = 250", "year = -1", "year = -1 is outside"),
            ("year = 250", "year = 2.5", "year = 2.5 cannot be read; give a whole number"),
            ("year = 250", "year = 1001", "year: the event is in year 1001, of which 1000 are"),
            ("month = 6", "month = 13", "month = 13 is outside 1..=12"),
            ("month = 6", "month = \"June\"", "month = \"June\" cannot be read"),
            ("month = 6", "moth = 6", "`moth` is not known; known here are type, year, month, sp"),
            ("type = \"disease\"", "type = \"flood\"", "type = flood is no disturbance; known are"),
            ("type = \"disease\"", "type = 3", "type = 3 cannot be read; give one of wildfire"),
            ("\"pine\"", "\"oak\"", "species = oak is not among the species; known are fir, pine"),
            ("\"pine\"", "1", "species = 1 cannot be read; give the key of a species"),
            ("east_fraction = 0.25", "east_fraction = 1.5", "east_fraction = 1.5 is outside 0..=1"),
            ("spread_radius_m = 40", "spread_radius_m = -4", "spread_radius_m = -4 is outside 0.1"),
            ("spread_radius_m = 40", "spread_radius_m = nan", "spread_radius_m = nan is outside"),
            ("spread_radius_m = 40", "spread_radius_m = inf", "spread_radius_m = inf is outside"),
            ("per_month = 0.2", "per_month = -0.2", "spread_probability_per_month = -0.2"),
            ("recovery_months = inf", "recovery_months = 0", "recovery_months = 0 is outside 1"),
            ("recovery_months = inf", "recovery_months = -inf", "a whole number of months, or inf"),
            ("immune_months = 24", "immune_months = 99999", "immune_months = 99999 is outside 0"),
            ("wind_m_s = 15", "wind_m_s = 151", "wind_m_s = 151 is outside 0..=150"),
            ("from_deg = 180", "from_deg = 361", "wind_from_deg = 361 is outside 0..=360"),
            ("radius_m = 20", "radius_m = -20", "ignitions[1].radius_m = -20 is outside 0..=10000"),
            ("radius_m = 20", "radius_km = 2", "`ignitions[1].radius_km` is not known; known here"),
            ("th_fraction = 0.1", "th_fraction = 9", "ignitions[2].north_fraction = 9 is outside"),
            (", north_fraction = 0.1", "", "ignitions[2].north_fraction is missing; give a share"),
            (
                "{ east_fraction = 0.7, north_fraction = 0.1 }",
                "0.7",
                "ignitions[2] = 0.7 cannot be",
            ),
            ("speed_km_h = 72", "speed_km_h = 700", "speed_km_h = 700 is outside 0..=540"),
            ("speed_km_h = 72", "speed_km_h = 9; speed_m_s = 9", "mend the TOML there"),
            ("0.2,\n]", "1.2,\n]", "rain_fractions[3] = 1.2 is outside 0..=1"),
            ("return_years = 80", "return_years = 0.5", "return_years = 0.5 is outside 1..=100000"),
            ("[22, 35]", "[35, 22]", "speed_m_s is out of order: 22 comes after 35"),
            ("[22, 35]", "[22, 350]", "speed_m_s[2] = 350 is outside 0..=150"),
            ("[22, 35]", "[22, 35, 50]", "speed_m_s = [22, 35, 50] cannot be read; give a number"),
            ("last_year = 900", "last_year = 9", "last_year is out of order: 9 comes after 100"),
            ("[11, 12]", "[]", "months has 0 entries; give 1 to 12"),
            ("[11, 12]", "[11, 13]", "months[2] = 13 is outside 1..=12"),
            ("months = 12", "months = 0", "duration_months = 0 is outside 1..=1200"),
            ("[0.1, 0.4]", "\"low\"", "rain_fraction = \"low\" cannot be read"),
        ];
        for (old, new, named) in cases {
            let message = message(old, new);
            assert!(message.contains(named), "{new}: {message}");
        }
    }

    #[test]
    fn what_is_missing_is_told_with_the_line_of_its_table() {
        let cases = [
            ("year = 250", 2, "year is missing; give the year of the simulation, from 1"),
            ("type = \"disease\"", 2, "type is missing; give one of wildfire, wind-storm, disease"),
            ("species = \"pine\"", 2, "species is missing; give the key of the species"),
            ("speed_km_h = 72", 22, "speed_m_s is missing; give the storm's greatest speed"),
            ("return_years = 80", 34, "return_years is missing; give the mean time"),
        ];
        for (key, line, named) in cases {
            let error = parsed(&SCRIPT.replacen(key, "", 1)).unwrap_err();
            let message = error.to_string();
            assert_eq!(error.line(), Some(line), "{message}");
            assert!(message.contains(named), "{message}");
        }
        let error = parsed("[[event]]\ntype = \"drought\"\nyear = 1\nrain_fractions = []");
        assert_eq!(
            error.unwrap_err().to_string(),
            "line 4: rain_fractions has 0 entries; give 1 to 1200"
        );
        let twice = SCRIPT.replacen("speed_km_h = 72", "speed_km_h = 72\nspeed_m_s = 20", 1);
        let message = parsed(&twice).unwrap_err().to_string();
        assert_eq!(message, "line 26: speed_m_s and speed_km_h say the same; give one of them");
        let message = parsed("[event]\nyear = 1").unwrap_err().to_string();
        assert!(message.contains("give tables that begin with [[event]], in two brackets"));
    }

    #[test]
    fn deep_nesting_is_an_error_not_an_overflow() {
        for text in
            ["[".repeat(200_000), format!("event = {}", "[".repeat(200_000)), "a.".repeat(200_000)]
        {
            assert!(parsed(&text).is_err());
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn random_edits_never_panic(
            edits in proptest::collection::vec((0..SCRIPT.len(), any::<u8>(), 0..3u8), 1..6)
        ) {
            let mut bytes = SCRIPT.as_bytes().to_vec();
            for (at, byte, kind) in edits {
                let at = at.min(bytes.len() - 1);
                match kind {
                    0 => bytes[at] = byte,
                    1 => bytes.insert(at, byte),
                    _ => { bytes.remove(at); }
                }
            }
            let text = String::from_utf8_lossy(&bytes);
            match parsed(&text) {
                Ok(schedule) => { drawn(&schedule, 300, 1); }
                Err(error) => {
                    let line = error.line().unwrap_or(1);
                    prop_assert!(line >= 1 && line <= text.matches('\n').count() + 1, "{error}");
                }
            }
        }

        #[test]
        fn random_digits_never_panic(at in 0..SCRIPT.len(), digits in "[-+0-9.eE_infax]{1,12}") {
            let mut text = SCRIPT.to_owned();
            let at = (at..text.len()).find(|&i| text.as_bytes()[i].is_ascii_digit()).unwrap_or(0);
            text.replace_range(at..=at, &digits);
            if let Ok(schedule) = parsed(&text) {
                drawn(&schedule, 300, 1);
            }
        }
    }
}
