//! The schedule of disturbances: what a script says happens in which month, and what recurs by chance.
//!
//! A script is TOML (`schedule_toml`, `schedule_recurring`) or the numbers that the authors of Peytavie et al. 2024 wrote
//! (`schedule_text`); the whole of it is read and checked before anything runs. `schedule_drawn` turns chance into events.
//!
//! # Reference
//! Peytavie et al. 2024, section 5.3, doi:10.1145/3641816: disturbances are "either scripted according to a timeline
//! scenario or triggered based on a stochastic distribution".

use serde::{Deserialize, Serialize};

use super::disease::Disease;
use super::fire::Wildfire;
pub use super::schedule_drawn::drawn;
use super::storm::WindStorm;
use super::{schedule_text, schedule_toml};
use crate::math;

/// Longest script read. chosen: an event takes about 200 bytes, so 20,000 events; no scenario has as many.
const MAX_TEXT_BYTES: usize = 4 << 20;

/// Most speed of wind, in m/s. chosen: above the strongest tornadoes measured (135 m/s).
pub(super) const MAX_WIND_M_S: f32 = 150.0;
/// Largest radius of an ignition or of a disease's spread, in metres. chosen: wider than the terrains simulated.
pub(super) const MAX_RADIUS_M: f32 = 10_000.0;
/// Least radius of a disease's spread, in metres. chosen: above 0, which the density of infected neighbours divides by.
pub(super) const MIN_SPREAD_RADIUS_M: f32 = 0.1;
/// Most places where a fire starts. chosen: a thousand lightning strokes.
pub(super) const MAX_IGNITIONS: u16 = 1000;
/// Longest drought, in months. chosen: a century; what lasts longer is another climate.
pub(super) const MAX_DROUGHT_MONTHS: u16 = 1200;
/// Radius of an ignition where a script gives none, in metres (the authors' scripts have 20 to 50).
pub(super) const IGNITION_RADIUS_M: f32 = 30.0;
/// Share of the species' plants about the place that are ill from the start, where a script gives none.
/// chosen: enough to spread from; the paper has "a random subsample", its program one plant.
pub(super) const FIRST_INFECTED_FRACTION: f32 = 0.3;

/// Less rain than usual, month by month.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Drought {
    /// Share of the month's usual rain that falls, in 0..=1, from the drought's first month on.
    pub rain_fractions: Vec<f32>,
}

/// What happens to the forest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Disturbance {
    /// Fire, over within its month. Of a schedule, one without ignitions: [`drawn`] chooses where it starts.
    Wildfire(Wildfire),
    /// Storm, over within its month.
    WindStorm(WindStorm),
    /// Outbreak of a disease, which lasts as long as plants infect each other.
    Disease(Disease),
    /// Drought, as long as its list of months.
    Drought(Drought),
}

/// A disturbance and when it begins.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Year of the simulation, the first being 1.
    pub year: u16,
    /// Month of the year, 1–12.
    pub month: u8,
    /// What happens.
    pub what: Disturbance,
}

/// Values from `low` to `high`, both included, each as likely.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Interval<T> {
    /// Least value.
    pub low: T,
    /// Greatest value.
    pub high: T,
}

impl<T: Copy> Interval<T> {
    /// One value alone.
    pub fn only(value: T) -> Self {
        Self { low: value, high: value }
    }
}

/// What a recurring disturbance is like: every interval is drawn from anew each time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "as in the disturbances drawn from it")]
pub enum Recipe {
    /// A fire that starts anywhere.
    Wildfire {
        wind_m_s: Interval<f32>,
        /// Where the wind comes from, clockwise from north, from `low` clockwise to `high`.
        wind_from_rad: Interval<f32>,
        ignition_count: Interval<u16>,
        ignition_radius_m: Interval<f32>,
    },
    /// A storm.
    WindStorm {
        speed_m_s: Interval<f32>,
        /// Where the wind comes from, clockwise from north, from `low` clockwise to `high`.
        from_rad: Interval<f32>,
    },
    /// An outbreak.
    Disease {
        species: u16,
        east_fraction: Interval<f32>,
        north_fraction: Interval<f32>,
        spread_radius_m: Interval<f32>,
        spread_probability_per_month: Interval<f32>,
        severity_per_month: Interval<f32>,
        contagious_months: u16,
        recovery_months: u16,
        immune_months: u16,
        first_infected_fraction: Interval<f32>,
    },
    /// A drought; each month's share of rain is drawn for itself.
    Drought { duration_months: Interval<u16>, rain_fraction: Interval<f32> },
}

/// A disturbance that happens by chance, at most once a year.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recurring {
    /// Mean time between two of them, in years, from 1: each year has a chance of 1/`return_years`.
    pub return_years: f32,
    /// First year in which it can happen.
    pub first_year: u16,
    /// Last year in which it can happen.
    pub last_year: u16,
    /// Months in which it can begin, 1–12, each as likely; where there are none, it never happens.
    pub months: Vec<u8>,
    /// What happens.
    pub what: Recipe,
}

/// What a script says.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Schedule {
    /// What happens for certain, by year, month and place in the script.
    pub events: Vec<Event>,
    /// What happens by chance, in the order of the script.
    pub stochastic: Vec<Recurring>,
}

/// What is wrong with a script of disturbances. Lines count from 1.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum ScheduleError {
    #[error("the script has {bytes} bytes; at most {limit} are read: is this the right file?")]
    TooLarge { bytes: usize, limit: usize },
    #[error("line {line}: {problem}; mend the TOML there")]
    Syntax { line: usize, problem: String },
    #[error("line {line}: `{key}` is not known; known here are {known}")]
    UnknownKey { line: usize, key: String, known: String },
    #[error("line {line}: {key} is missing; give {expected}")]
    Missing { line: usize, key: String, expected: String },
    #[error("line {line}: {key} = {found} cannot be read; give {expected}")]
    WrongKind { line: usize, key: String, found: String, expected: String },
    #[error("line {line}: {key} = {value} is outside {low}..={high}; give a number within")]
    OutOfRange { line: usize, key: String, value: String, low: f32, high: f32 },
    #[error("line {line}: {key} is out of order: {high} comes after {low}; give the smaller first")]
    OutOfOrder { line: usize, key: String, low: String, high: String },
    #[error("line {line}: {key} has {count} entries; give {low} to {high}")]
    Count { line: usize, key: String, count: usize, low: usize, high: usize },
    #[error("line {line}: {key} = {found} is no disturbance; known are {known}")]
    UnknownType { line: usize, key: String, found: String, known: String },
    #[error("line {line}: {key} = {found} is not among the species; known are {known}")]
    UnknownSpecies { line: usize, key: String, found: String, known: String },
    #[error("line {line}: {key} and {other} say the same; give one of them")]
    Both { line: usize, key: String, other: String },
    #[error("line {line}: {key} is one too many; write {expected}, each event on lines of its own")]
    TooMany { line: usize, key: String, expected: String },
    #[error(
        "line {line}: {key}: the event is in year {year}, of which {years} are simulated; simulate more, or take it out"
    )]
    AfterEnd { line: usize, key: String, year: u16, years: u16 },
}

impl ScheduleError {
    /// The line of the script it is about, from 1; none where it is about the whole.
    pub fn line(&self) -> Option<usize> {
        match self {
            Self::TooLarge { .. } => None,
            Self::Syntax { line, .. }
            | Self::UnknownKey { line, .. }
            | Self::Missing { line, .. }
            | Self::WrongKind { line, .. }
            | Self::OutOfRange { line, .. }
            | Self::OutOfOrder { line, .. }
            | Self::Count { line, .. }
            | Self::UnknownType { line, .. }
            | Self::UnknownSpecies { line, .. }
            | Self::Both { line, .. }
            | Self::TooMany { line, .. }
            | Self::AfterEnd { line, .. } => Some(*line),
        }
    }
}

/// The schedule of a script, TOML or the authors' numbers: where the first word is a number, it is theirs.
///
/// # Errors
/// Text over 4 MiB, bad TOML, unknown types, species and keys, missing or superfluous values, values out of range:
/// the message names line, key, value and what is allowed.
pub fn parse(text: &str, species_keys: &[String]) -> Result<Schedule, ScheduleError> {
    parse_within(text, species_keys, u16::MAX)
}

/// The schedule of a script for a simulation of so many years.
///
/// # Errors
/// As [`parse`], and where a scripted event lies after the last year.
pub fn parse_within(
    text: &str,
    species_keys: &[String],
    years: u16,
) -> Result<Schedule, ScheduleError> {
    if text.len() > MAX_TEXT_BYTES {
        return Err(ScheduleError::TooLarge { bytes: text.len(), limit: MAX_TEXT_BYTES });
    }
    // a mark of UTF-8 in front belongs to no word
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut schedule = if schedule_text::is_authors(text) {
        schedule_text::parse(text, species_keys, years)?
    } else {
        schedule_toml::parse(text, species_keys, years)?
    };
    // stable: events of a month stay as the script has them
    schedule.events.sort_by_key(|event| (event.year, event.month));
    Ok(schedule)
}

/// Speed of the air eastward and northward, in m/s, of a wind from `from_rad`, clockwise from north.
pub fn wind_from(speed_m_s: f32, from_rad: f32) -> (f32, f32) {
    let (speed, from) = (f64::from(speed_m_s), f64::from(from_rad));
    // back to the rasters' precision
    (-(speed * math::sin_f64(from)) as f32, -(speed * math::cos_f64(from)) as f32)
}

/// Index of the species with this key.
pub(super) fn species_index(species_keys: &[String], key: &str) -> Option<u16> {
    species_keys.iter().position(|known| known == key).and_then(|index| u16::try_from(index).ok())
}

/// A year that is simulated.
pub(super) fn within(line: usize, key: &str, year: u16, years: u16) -> Result<u16, ScheduleError> {
    if year <= years {
        return Ok(year);
    }
    Err(ScheduleError::AfterEnd { line, key: key.to_owned(), year, years })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys() -> Vec<String> {
        ["silver-fir", "mountain-pine"].map(str::to_owned).to_vec()
    }

    /// The same scenario twice.
    const TOML: &str = r#"
        [[event]]
        year = 505
        month = 8
        type = "wildfire"
        wind_m_s = 15
        wind_from_deg = 270
        ignitions = [{ east_fraction = 0.75, north_fraction = 0.25, radius_m = 20 }]
        [[event]]
        type = "drought"
        year = 504
        month = 1
        rain_fractions = [0.5, 0.25, 1]
        [[event]]
        type = "wind-storm"
        year = 350
        month = 12
        speed_km_h = 108
        from_deg = 360
        [[event]]
        type = "disease"
        species = "mountain-pine"
        year = 251
        month = 1
    "#;
    const NUMBERS: &str = "504 8 1 15 0 1 0.75 0.75 20\n503 1 4 3 0.5\n 0.25 1\n349 12 2 0 30\n\
        250 1 3 0.5 0.5 3 50 0.3 0.25 12 12 12";

    #[test]
    fn both_formats_say_the_same() {
        let toml = parse(TOML, &keys()).unwrap();
        let mut numbers = parse(NUMBERS, &keys()).unwrap();
        let whens: Vec<_> = toml.events.iter().map(|event| (event.year, event.month)).collect();
        assert_eq!(whens, [(251, 1), (350, 12), (504, 1), (505, 8)]);
        // sine and cosine of right angles are right to 1e-6 of the speed
        for (from_deg, from_axes) in toml.events.iter().zip(&mut numbers.events) {
            match (&from_deg.what, &mut from_axes.what) {
                (Disturbance::Wildfire(a), Disturbance::Wildfire(b)) => {
                    assert!((a.wind_east_m_s - b.wind_east_m_s).abs() < 2e-5);
                    assert!((a.wind_north_m_s - b.wind_north_m_s).abs() < 2e-5);
                    (b.wind_east_m_s, b.wind_north_m_s) = (a.wind_east_m_s, a.wind_north_m_s);
                }
                (Disturbance::WindStorm(a), Disturbance::WindStorm(b)) => {
                    assert!((a.wind_east_m_s - b.wind_east_m_s).abs() < 2e-5);
                    assert!((a.wind_north_m_s - b.wind_north_m_s).abs() < 2e-5);
                    *b = *a;
                }
                _ => {}
            }
        }
        assert_eq!(toml, numbers);
    }

    #[test]
    fn schedules_come_back_as_they_were_stored() {
        let recurring = "[[recurring]]\ntype = \"wind-storm\"\nreturn_years = 80\n";
        let schedule = parse(&format!("{TOML}\n{recurring}"), &keys()).unwrap();
        assert_eq!((schedule.events.len(), schedule.stochastic.len()), (4, 1));
        let stored = toml::to_string(&schedule).unwrap();
        assert_eq!(toml::from_str::<Schedule>(&stored).unwrap(), schedule);
    }

    #[test]
    fn wind_blows_away_from_where_it_comes() {
        let cases = [
            (0.0, (0.0, -10.0)), // from the north: southward
            (90.0, (-10.0, 0.0)),
            (180.0, (0.0, 10.0)),
            (270.0, (10.0, 0.0)),
            (315.0, (7.071_068, -7.071_068)),
        ];
        for (from_deg, (east, north)) in cases {
            let (found_east, found_north) = wind_from(10.0, f32::to_radians(from_deg));
            assert!((found_east - east).abs() < 1e-5, "{from_deg}: east {found_east}");
            assert!((found_north - north).abs() < 1e-5, "{from_deg}: north {found_north}");
        }
    }

    #[test]
    fn events_of_a_month_keep_the_order_of_the_script() {
        let schedule = parse("1 2 2 3 0\n1 2 2 1 0\n1 2 2 2 0\n0 9 2 9 0", &[]).unwrap();
        let east: Vec<f32> = schedule
            .events
            .iter()
            .map(|event| match &event.what {
                Disturbance::WindStorm(storm) => storm.wind_east_m_s,
                _ => f32::NAN,
            })
            .collect();
        assert_eq!(east, [9.0, 3.0, 1.0, 2.0]);
    }

    #[test]
    fn events_after_the_end_are_refused() {
        for text in [TOML, NUMBERS] {
            assert!(parse_within(text, &keys(), 505).is_ok());
            let error = parse_within(text, &keys(), 504).unwrap_err();
            assert!(error.to_string().contains("in year 505, of which 504 are simulated"));
        }
        assert_eq!(parse_within(TOML, &keys(), 504).unwrap_err().line(), Some(3));
        assert_eq!(parse_within(NUMBERS, &keys(), 504).unwrap_err().line(), Some(1));
    }

    #[test]
    fn nothing_is_an_empty_schedule() {
        for text in ["", "\u{feff}", "\n \n", "# nothing yet\n"] {
            assert_eq!(parse(text, &[]), Ok(Schedule::default()));
        }
    }

    #[test]
    fn long_scripts_are_refused_unread() {
        let error = parse(&" ".repeat(MAX_TEXT_BYTES + 1), &[]).unwrap_err();
        assert_eq!(
            error,
            ScheduleError::TooLarge { bytes: MAX_TEXT_BYTES + 1, limit: MAX_TEXT_BYTES }
        );
        assert_eq!(error.line(), None);
    }
}
