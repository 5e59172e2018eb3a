//! Recurring disturbances of a TOML script: `[[recurring]]` tables, whose numbers may be ranges.

use std::f32::consts::TAU;

use super::schedule::{
    FIRST_INFECTED_FRACTION, IGNITION_RADIUS_M, Interval, MAX_DROUGHT_MONTHS, MAX_IGNITIONS,
    MAX_RADIUS_M, MAX_WIND_M_S, MIN_SPREAD_RADIUS_M, Recipe, Recurring, ScheduleError,
};
use super::schedule_keys::{Entry, Table};
use super::schedule_kind::{
    Kind, SEVERITY_PER_MONTH, SPREAD_PROBABILITY_PER_MONTH, SPREAD_RADIUS_M, month, months_or,
    species, storm_speed,
};

/// Longest return time, in years. chosen: beyond any simulation.
const MAX_RETURN_YEARS: f32 = 100_000.0;
/// Wind of fires unless told, in m/s. chosen: from a light breeze to a strong one.
const FIRE_WIND_M_S: Interval<f32> = Interval { low: 2.0, high: 12.0 };
/// Speed of storms unless told, in m/s. chosen: from strong gale to hurricane; branches break from 18 on.
const STORM_SPEED_M_S: Interval<f32> = Interval { low: 22.0, high: 35.0 };
/// Any direction, in radians.
const ANY_DIRECTION_RAD: Interval<f32> = Interval { low: 0.0, high: TAU };
/// Anywhere.
const ANY_FRACTION: Interval<f32> = Interval { low: 0.0, high: 1.0 };
/// Length of droughts unless told, in months. chosen: the droughts of the authors' scripts last 12 to 24.
const DROUGHT_MONTHS: Interval<u16> = Interval { low: 6, high: 24 };
/// Share of the usual rain unless told (the authors' have 0.2 to 0.6 in most months).
const DROUGHT_RAIN_FRACTION: Interval<f32> = Interval { low: 0.2, high: 0.6 };

/// A recurring disturbance from its table.
///
/// # Errors
/// Unknown or missing keys, values of the wrong kind, out of range or out of order.
pub(super) fn recurring(
    table: &Table<'_>,
    species_keys: &[String],
) -> Result<Recurring, ScheduleError> {
    let kind = Kind::of(table)?;
    let common = ["type", "return_years", "first_year", "last_year", "months"];
    table.check_keys(&[&common, kind.recurring_keys()].concat())?;
    let return_years = table
        .need("return_years", "the mean time between two of them, in years, from 1")?
        .number(1.0, MAX_RETURN_YEARS)?;
    let year = |key, default| {
        table.get(key).map_or(Ok(default), |entry: Entry<'_>| entry.whole(1, u16::MAX))
    };
    let (first_year, last_year) = (year("first_year", 1)?, year("last_year", u16::MAX)?);
    if let Some(entry) = table.get("last_year") {
        entry.ordered(first_year, last_year)?;
    }
    let months = match table.get("months") {
        None => kind.months().to_vec(),
        Some(list) => {
            let months = list.list(1, 12, "a list of months, such as [11, 12, 1, 2]")?;
            months.iter().map(month).collect::<Result<_, _>>()?
        }
    };
    let what = match kind {
        Kind::Wildfire => Recipe::Wildfire {
            wind_m_s: table.interval_or("wind_m_s", FIRE_WIND_M_S, 0.0, MAX_WIND_M_S)?,
            wind_from_rad: directions_rad(table, "wind_from_deg")?,
            ignition_count: table.whole_interval_or(
                "ignition_count",
                Interval::only(1),
                1,
                MAX_IGNITIONS,
            )?,
            ignition_radius_m: table.interval_or(
                "ignition_radius_m",
                Interval::only(IGNITION_RADIUS_M),
                0.0,
                MAX_RADIUS_M,
            )?,
        },
        Kind::WindStorm => Recipe::WindStorm {
            speed_m_s: match storm_speed(table)? {
                None => STORM_SPEED_M_S,
                Some((entry, per_m_s)) => {
                    let Interval { low, high } = entry.interval(0.0, MAX_WIND_M_S * per_m_s)?;
                    Interval { low: low / per_m_s, high: high / per_m_s }
                }
            },
            from_rad: directions_rad(table, "from_deg")?,
        },
        Kind::Disease => outbreaks(table, species_keys)?,
        Kind::Drought => Recipe::Drought {
            duration_months: table.whole_interval_or(
                "duration_months",
                DROUGHT_MONTHS,
                1,
                MAX_DROUGHT_MONTHS,
            )?,
            rain_fraction: table.interval_or("rain_fraction", DROUGHT_RAIN_FRACTION, 0.0, 1.0)?,
        },
    };
    Ok(Recurring { return_years, first_year, last_year, months, what })
}

fn outbreaks(table: &Table<'_>, species_keys: &[String]) -> Result<Recipe, ScheduleError> {
    let share = |key, default| table.interval_or(key, default, 0.0, 1.0);
    Ok(Recipe::Disease {
        species: species(table, species_keys)?,
        east_fraction: share("east_fraction", ANY_FRACTION)?,
        north_fraction: share("north_fraction", ANY_FRACTION)?,
        spread_radius_m: table.interval_or(
            "spread_radius_m",
            Interval::only(SPREAD_RADIUS_M),
            MIN_SPREAD_RADIUS_M,
            MAX_RADIUS_M,
        )?,
        spread_probability_per_month: share(
            "spread_probability_per_month",
            Interval::only(SPREAD_PROBABILITY_PER_MONTH),
        )?,
        severity_per_month: share("severity_per_month", Interval::only(SEVERITY_PER_MONTH))?,
        contagious_months: months_or(table, "contagious_months", 1)?,
        recovery_months: months_or(table, "recovery_months", 1)?,
        immune_months: months_or(table, "immune_months", 0)?,
        first_infected_fraction: share(
            "first_infected_fraction",
            Interval::only(FIRST_INFECTED_FRACTION),
        )?,
    })
}

/// Where recurring winds come from, in radians, from the first clockwise to the second, through north where need be.
fn directions_rad(table: &Table<'_>, key: &str) -> Result<Interval<f32>, ScheduleError> {
    let Some(entry) = table.get(key) else {
        return Ok(ANY_DIRECTION_RAD);
    };
    let (from, to) = entry.pair(0.0, 360.0)?;
    let to = if to < from { to + 360.0 } else { to };
    Ok(Interval { low: from.to_radians(), high: to.to_radians() })
}

#[cfg(test)]
mod tests {
    use super::super::schedule::{drawn, parse};
    use super::*;

    const SCRIPT: &str = r#"
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

    #[test]
    fn recurring_ones_are_read() {
        let stochastic = parse(SCRIPT, &[]).unwrap().stochastic;
        assert_eq!(
            stochastic[0],
            Recurring {
                return_years: 80.0,
                first_year: 100,
                last_year: 900,
                months: vec![11, 12],
                what: Recipe::WindStorm {
                    speed_m_s: Interval { low: 22.0, high: 35.0 },
                    // through north
                    from_rad: Interval { low: 300f32.to_radians(), high: 420f32.to_radians() },
                },
            }
        );
        assert_eq!(stochastic[1].months, [4, 5, 6]);
        assert_eq!(
            stochastic[1].what,
            Recipe::Drought {
                duration_months: Interval { low: 12, high: 12 },
                rain_fraction: Interval { low: 0.1, high: 0.4 },
            }
        );
        // all but type and return time has a default
        for (kind, more) in [
            ("wildfire", ""),
            ("wind-storm", ""),
            ("drought", ""),
            ("disease", "species = \"fir\"\n"),
        ] {
            let text = format!("[[recurring]]\ntype = \"{kind}\"\nreturn_years = 50\n{more}");
            let schedule = parse(&text, &["fir".to_owned()]).unwrap();
            assert!(!drawn(&schedule, 1000, 1).is_empty());
        }
    }
}
