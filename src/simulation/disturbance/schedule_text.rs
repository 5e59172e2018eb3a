//! The scripts of disturbances that the authors of Peytavie et al. 2024 wrote: numbers, one event a line.
//!
//! A line is `year month type` and what the type asks for: 1, a wildfire (wind x, wind y, number of ignitions, then x, y
//! and radius of each); 2, a wind storm (wind x, wind y); 3, a disease (x, y, species, radius, chance to spread, severity,
//! months contagious, to recover, immune); 4, a drought (number of months, then each month's share of rain, which may run
//! over several lines). Speeds are in m/s, radii in metres, places in shares of the terrain. `#` begins a remark.
//!
//! Their years count from 0, ours from 1. Their x runs east and their y **south**: the paper tells where three storms of
//! its script come from (section 7.2), and all three agree with a wind blowing towards (x, −y) only. Fires and diseases
//! are placed on the same axes: their program spreads fire along the wind by differences of the grid positions that it
//! starts fires at. So a place x, y is x of the way east and 1 − y of the way north.
//!
//! # Reference
//! Peytavie et al. 2024, doi:10.1145/3641816, and the scripts published with it.

use super::disease::Disease;
use super::fire::{Ignition, Wildfire};
use super::schedule::{
    Disturbance, Drought, Event, FIRST_INFECTED_FRACTION, MAX_DROUGHT_MONTHS, MAX_IGNITIONS,
    MAX_RADIUS_M, MAX_WIND_M_S, MIN_SPREAD_RADIUS_M, Schedule, ScheduleError, species_index,
    within,
};
use super::schedule_keys::shown;
use super::storm::WindStorm;

/// Keys of their species, by their number.
const SPECIES: [&str; 8] = [
    "toothwort",
    "boxwood",
    "snowy-mespilus",
    "mountain-pine",
    "silver-fir",
    "silver-birch",
    "sessile-oak",
    "european-beech",
];
const TYPES: &str = "1 (wildfire), 2 (wind storm), 3 (disease), 4 (drought)";
const WILDFIRE: &str = "year month 1 wind-x wind-y count, then x y radius of each ignition";
const WIND_STORM: &str = "year month 2 wind-x wind-y";
const DISEASE: &str =
    "year month 3 x y species radius spread severity months-contagious -to-recover -immune";
const DROUGHT: &str = "year month 4 count, then the share of rain of each month";

/// Whether a script is the authors': its first word begins like a number.
pub(super) fn is_authors(text: &str) -> bool {
    let mut words = text.lines().filter_map(|line| without_remark(line).split_whitespace().next());
    words.next().is_some_and(|word| {
        word.starts_with(|first: char| first.is_ascii_digit() || matches!(first, '-' | '+' | '.'))
    })
}

fn without_remark(line: &str) -> &str {
    line.split('#').next().unwrap_or("")
}

/// The schedule of the authors' text; events in the order of the script.
///
/// # Errors
/// Values that are missing, superfluous, of the wrong kind or out of range, unknown types and species, events after the
/// last year.
pub(super) fn parse(
    text: &str,
    species_keys: &[String],
    years: u16,
) -> Result<Schedule, ScheduleError> {
    let mut schedule = Schedule::default();
    let mut words = Words::new(text);
    while words.is_more() {
        schedule.events.push(event(&mut words, species_keys, years)?);
    }
    Ok(schedule)
}

fn event(
    words: &mut Words<'_>,
    species_keys: &[String],
    years: u16,
) -> Result<Event, ScheduleError> {
    const ANY: &str = "year month type and what the type asks for";
    let year = words.value("year", ANY)?;
    // theirs counts from 0
    let simulated = year.whole(0, u16::MAX - 1)? + 1;
    let month = words.value("month", ANY)?.whole(1, 12)? as u8; // at most 12
    within(year.line, &year.key, simulated, years)?;
    let kind = words.value("type", ANY)?;
    let (what, expected) = match kind.text {
        "1" => (Disturbance::Wildfire(wildfire(words)?), WILDFIRE),
        "2" => {
            let (wind_east_m_s, wind_north_m_s) = wind(words, WIND_STORM)?;
            (Disturbance::WindStorm(WindStorm { wind_east_m_s, wind_north_m_s }), WIND_STORM)
        }
        "3" => (Disturbance::Disease(disease(words, species_keys)?), DISEASE),
        "4" => (Disturbance::Drought(drought(words)?), DROUGHT),
        other => {
            return Err(ScheduleError::UnknownType {
                line: kind.line,
                key: kind.key,
                found: shown(other),
                known: TYPES.to_owned(),
            });
        }
    };
    words.end(expected)?;
    Ok(Event { year: simulated, month, what })
}

/// Speed of the air eastward and northward, in m/s.
fn wind(words: &mut Words<'_>, expected: &str) -> Result<(f32, f32), ScheduleError> {
    let x = words.value("wind x in m/s", expected)?.number(-MAX_WIND_M_S, MAX_WIND_M_S)?;
    let y = words.value("wind y in m/s", expected)?.number(-MAX_WIND_M_S, MAX_WIND_M_S)?;
    // 0 − y: no negative zero
    Ok((x, 0.0 - y))
}

/// A place, in shares of the terrain eastward and northward.
fn place(words: &mut Words<'_>, name: &str, expected: &str) -> Result<(f32, f32), ScheduleError> {
    let x = words.value(&format!("x{name}"), expected)?.number(0.0, 1.0)?;
    let y = words.value(&format!("y{name}"), expected)?.number(0.0, 1.0)?;
    Ok((x, 1.0 - y))
}

fn wildfire(words: &mut Words<'_>) -> Result<Wildfire, ScheduleError> {
    let (wind_east_m_s, wind_north_m_s) = wind(words, WILDFIRE)?;
    let count = words.value("number of ignitions", WILDFIRE)?.whole(0, MAX_IGNITIONS)?;
    let mut ignitions = Vec::new();
    for number in 1..=count {
        let of = format!(" of ignition {number}");
        let (east_fraction, north_fraction) = place(words, &of, WILDFIRE)?;
        let radius = words.value(&format!("radius in m{of}"), WILDFIRE)?;
        let radius_m = radius.number(0.0, MAX_RADIUS_M)?;
        ignitions.push(Ignition { east_fraction, north_fraction, radius_m });
    }
    Ok(Wildfire { wind_east_m_s, wind_north_m_s, ignitions })
}

fn disease(words: &mut Words<'_>, species_keys: &[String]) -> Result<Disease, ScheduleError> {
    let (east_fraction, north_fraction) = place(words, "", DISEASE)?;
    let species = species(&words.value("species", DISEASE)?, species_keys)?;
    let radius = words.value("radius in m", DISEASE)?;
    let spread_radius_m = radius.number(MIN_SPREAD_RADIUS_M, MAX_RADIUS_M)?;
    let mut share = |name| words.value(name, DISEASE)?.number(0.0, 1.0);
    let spread_probability_per_month = share("chance to spread")?;
    let severity_per_month = share("severity")?;
    let mut months = |name, low| words.value(name, DISEASE)?.whole(low, u16::MAX);
    Ok(Disease {
        species,
        east_fraction,
        north_fraction,
        spread_radius_m,
        spread_probability_per_month,
        severity_per_month,
        contagious_months: months("months contagious", 1)?,
        recovery_months: months("months to recover", 1)?,
        immune_months: months("months immune", 0)?,
        first_infected_fraction: FIRST_INFECTED_FRACTION,
    })
}

/// Our index of their species.
fn species(value: &Value<'_>, species_keys: &[String]) -> Result<u16, ScheduleError> {
    let number = value.whole(0, SPECIES.len() as u16 - 1)?; // eight
    let key = SPECIES[usize::from(number)];
    species_index(species_keys, key).ok_or_else(|| ScheduleError::UnknownSpecies {
        line: value.line,
        key: value.key.clone(),
        found: format!("{number} ({key})"),
        known: species_keys.join(", "),
    })
}

fn drought(words: &mut Words<'_>) -> Result<Drought, ScheduleError> {
    let count = words.value("number of months", DROUGHT)?;
    let months = count.whole(1, MAX_DROUGHT_MONTHS)?;
    let mut rain_fractions = Vec::new();
    for month in 1..=months {
        words.go_on_next_line();
        let name = format!("rain of month {month} of the {months} from line {}", count.line);
        rain_fractions.push(words.value(&name, DROUGHT)?.number(0.0, 1.0)?);
    }
    Ok(Drought { rain_fractions })
}

/// Words of a script, line by line.
struct Words<'t> {
    /// Lines that have words, with their number.
    lines: Vec<(usize, Vec<&'t str>)>,
    line: usize,
    word: usize,
}

impl<'t> Words<'t> {
    fn new(text: &'t str) -> Self {
        let lines = text.lines().enumerate().map(|(index, line)| {
            (index + 1, without_remark(line).split_whitespace().collect::<Vec<_>>())
        });
        Self { lines: lines.filter(|(_, words)| !words.is_empty()).collect(), line: 0, word: 0 }
    }

    fn is_more(&self) -> bool {
        self.line < self.lines.len()
    }

    /// Where the line has no more words, the next one goes on.
    fn go_on_next_line(&mut self) {
        let is_at_end =
            self.lines.get(self.line).is_some_and(|(_, words)| words.len() <= self.word);
        if is_at_end && self.line + 1 < self.lines.len() {
            self.line += 1;
            self.word = 0;
        }
    }

    /// The next value of the line.
    fn value(&mut self, name: &str, expected: &str) -> Result<Value<'t>, ScheduleError> {
        let line = self.lines.get(self.line);
        let number = line.map_or(1, |(number, _)| *number);
        let key = format!("value {} ({name})", self.word + 1);
        match line.and_then(|(_, words)| words.get(self.word)) {
            Some(text) => {
                self.word += 1;
                Ok(Value { text, line: number, key })
            }
            None => {
                Err(ScheduleError::Missing { line: number, key, expected: expected.to_owned() })
            }
        }
    }

    /// The event is complete: so should the line be.
    fn end(&mut self, expected: &str) -> Result<(), ScheduleError> {
        if let Some((line, words)) = self.lines.get(self.line)
            && let Some(word) = words.get(self.word)
        {
            return Err(ScheduleError::TooMany {
                line: *line,
                key: format!("value {} ({})", self.word + 1, shown(word)),
                expected: expected.to_owned(),
            });
        }
        self.line += 1;
        self.word = 0;
        Ok(())
    }
}

/// A word, where it stands and what it should be.
struct Value<'t> {
    text: &'t str,
    line: usize,
    key: String,
}

impl Value<'_> {
    fn number(&self, low: f32, high: f32) -> Result<f32, ScheduleError> {
        match self.text.parse::<f32>() {
            // false for NaN
            Ok(value) if (low..=high).contains(&value) => Ok(value),
            Ok(_) => Err(self.outside(low, high)),
            Err(_) => Err(self.wrong_kind(&format!("a number in {low}..={high}"))),
        }
    }

    fn whole(&self, low: u16, high: u16) -> Result<u16, ScheduleError> {
        match self.text.parse::<i64>() {
            Ok(value) => match u16::try_from(value) {
                Ok(value) if (low..=high).contains(&value) => Ok(value),
                _ => Err(self.outside(f32::from(low), f32::from(high))),
            },
            Err(_) => Err(self.wrong_kind(&format!("a whole number in {low}..={high}"))),
        }
    }

    fn outside(&self, low: f32, high: f32) -> ScheduleError {
        let (line, key, value) = (self.line, self.key.clone(), shown(self.text));
        ScheduleError::OutOfRange { line, key, value, low, high }
    }

    fn wrong_kind(&self, expected: &str) -> ScheduleError {
        ScheduleError::WrongKind {
            line: self.line,
            key: self.key.clone(),
            found: shown(self.text),
            expected: expected.to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SCRIPT: &str = "\
# an example
250 1  3 0.5 0.25 3 50 0.3 0.25 12 13 14
349 12 2 -18 -18

399 1  4 5 0.7 0.5 # going on
           0.3
           0.2 0
504 8  1 15.0 -5 2 0.65 0.4 30 0 1 50
";

    fn keys() -> Vec<String> {
        ["silver-fir", "mountain-pine"].map(str::to_owned).to_vec()
    }

    fn parsed(text: &str) -> Result<Schedule, ScheduleError> {
        parse(text, &keys(), 1000)
    }

    #[test]
    fn every_type_is_read() {
        let events = parsed(SCRIPT).unwrap().events;
        let whens: Vec<_> = events.iter().map(|event| (event.year, event.month)).collect();
        assert_eq!(whens, [(251, 1), (350, 12), (400, 1), (505, 8)]);
        let Disturbance::Disease(disease) = &events[0].what else { panic!("{events:?}") };
        assert_eq!((disease.species, disease.spread_radius_m), (1, 50.0));
        assert_eq!((disease.east_fraction, disease.north_fraction), (0.5, 0.75));
        assert_eq!(disease.spread_probability_per_month, 0.3);
        assert_eq!(disease.severity_per_month, 0.25);
        let months = [disease.contagious_months, disease.recovery_months, disease.immune_months];
        assert_eq!(months, [12, 13, 14]);
        let drought = Drought { rain_fractions: vec![0.7, 0.5, 0.3, 0.2, 0.0] };
        assert_eq!(events[2].what, Disturbance::Drought(drought));
        let place = |east_fraction, north_fraction, radius_m| Ignition {
            east_fraction,
            north_fraction,
            radius_m,
        };
        let fire = Wildfire {
            wind_east_m_s: 15.0,
            wind_north_m_s: 5.0,
            ignitions: vec![place(0.65, 0.6, 30.0), place(0.0, 0.0, 50.0)],
        };
        assert_eq!(events[3].what, Disturbance::Wildfire(fire));
    }

    #[test]
    fn storms_come_from_where_the_paper_says() {
        // Peytavie et al. 2024, section 7.2: year, km/h, and the corner of the sky it comes from
        let cases = [
            ("349 12 2 -18 -18", 350, 92.0, (1.0, -1.0)), // south-east
            ("469 12 2 23 23", 470, 117.0, (-1.0, 1.0)),  // north-west
            ("589 1 2 -20 20", 590, 102.0, (1.0, 1.0)),   // north-east
        ];
        for (line, year, km_h, (from_east, from_north)) in cases {
            let events = parsed(line).unwrap().events;
            let Disturbance::WindStorm(storm) = &events[0].what else { panic!("{events:?}") };
            let (east, north) = (storm.wind_east_m_s, storm.wind_north_m_s);
            assert_eq!(events[0].year, year);
            assert!((3.6 * (east * east + north * north).sqrt() - km_h).abs() < 0.5, "{line}");
            assert_eq!((-east.signum(), -north.signum()), (from_east, from_north), "{line}");
        }
    }

    #[test]
    fn every_number_has_its_species() {
        let known: Vec<String> = SPECIES.map(str::to_owned).to_vec();
        for number in 0..8 {
            let line = format!("1 1 3 0.5 0.5 {number} 50 0.3 0.25 12 12 12");
            let events = parse(&line, &known, 10).unwrap().events;
            let Disturbance::Disease(disease) = &events[0].what else { panic!("{events:?}") };
            assert_eq!(disease.species, number);
        }
    }

    #[test]
    fn the_format_is_told_by_its_first_word() {
        assert!(is_authors(SCRIPT) && is_authors(" \n-1 2"));
        for text in ["", "# 3\n", "[[event]]", "event = [1]", "year = 3"] {
            assert!(!is_authors(text), "{text}");
        }
    }

    #[test]
    fn trouble_is_told_with_line_and_value() {
        let cases = [
            ("250 1", "-1 1", 2, "value 1 (year) = -1 is outside 0..=65534; give a number within"),
            ("250 1", "65535 1", 2, "value 1 (year) = 65535 is outside"),
            ("250 1", "1000 1", 2, "value 1 (year): the event is in year 1001, of which 1000"),
            ("250 1", "250 0", 2, "value 2 (month) = 0 is outside 1..=12"),
            ("250 1", "250 1.5", 2, "value 2 (month) = 1.5 cannot be read; give a whole number"),
            ("1  3", "1  5", 2, "value 3 (type) = 5 is no disturbance; known are 1 (wildfire), 2"),
            ("1  3", "1  fire", 2, "value 3 (type) = fire is no disturbance"),
            ("0.5 0.25", "0.5 2", 2, "value 5 (y) = 2 is outside 0..=1"),
            ("0.25 3", "0.25 4.5", 2, "value 6 (species) = 4.5 cannot be read; give a whole"),
            ("0.25 3", "0.25 8", 2, "value 6 (species) = 8 is outside 0..=7"),
            ("0.25 3", "0.25 6", 2, "6 (sessile-oak) is not among the species; known are silver"),
            ("50 0.3", "-50 0.3", 2, "value 7 (radius in m) = -50 is outside 0.1..=10000"),
            ("50 0.3", "nan 0.3", 2, "value 7 (radius in m) = nan is outside"),
            ("50 0.3", "50 1.3", 2, "value 8 (chance to spread) = 1.3 is outside 0..=1"),
            ("12 13 14", "12 13", 2, "value 12 (months immune) is missing; give year month 3 x y"),
            ("12 13 14", "0 13 14", 2, "value 10 (months contagious) = 0 is outside"),
            ("12 13 14", "12 13 14 15", 2, "value 13 (15) is one too many; write year month 3"),
            ("-18 -18", "-18", 3, "value 5 (wind y in m/s) is missing; give year month 2"),
            ("-18 -18", "-18 -18 9", 3, "value 6 (9) is one too many"),
            ("-18 -18", "inf -18", 3, "value 4 (wind x in m/s) = inf is outside -150..=150"),
            ("-18 -18", "-18 west", 3, "value 5 (wind y in m/s) = west cannot be read"),
            ("4 5 0.7", "4 0 0.7", 5, "value 4 (number of months) = 0 is outside 1..=1200"),
            ("           0.3", "  3", 6, "value 1 (rain of month 3 of the 5 from line 5) = 3 is"),
            ("0.2 0\n", "0.2\n", 8, "value 1 (rain of month 5 of the 5 from line 5) = 504 is"),
            ("0.2 0\n", "0.2 0 0\n", 7, "value 3 (0) is one too many; write year month 4"),
            ("-5 2 0.65", "-5 3 0.65", 8, "value 13 (x of ignition 3) is missing; give year"),
            ("-5 2 0.65", "-5 1 0.65", 8, "value 10 (0) is one too many"),
            ("-5 2 0.65", "-5 2 -0.65", 8, "value 7 (x of ignition 1) = -0.65 is outside 0..=1"),
            ("0 1 50", "0 1 -50", 8, "value 12 (radius in m of ignition 2) = -50 is outside"),
            ("1 50\n", "1 50\n1 1 4 9 0.5", 9, "value 6 (rain of month 2 of the 9 from line 9) is"),
        ];
        for (old, new, line, named) in cases {
            assert!(SCRIPT.contains(old), "{old}");
            let error = parsed(&SCRIPT.replacen(old, new, 1)).unwrap_err();
            let message = error.to_string();
            assert_eq!(error.line(), Some(line), "{new}: {message}");
            assert!(message.contains(named), "{new}: {message}");
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
            let _ = is_authors(&text);
            if let Err(error) = parsed(&text) {
                let line = error.line().unwrap_or(1);
                prop_assert!(line >= 1 && line <= text.lines().count(), "{error}");
            }
        }
    }
}
