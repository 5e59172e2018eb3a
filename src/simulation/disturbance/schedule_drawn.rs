//! What happens in a run: scripted disturbances, and those that chance adds.

use std::collections::BTreeMap;

use super::disease::Disease;
use super::fire::{Ignition, Wildfire};
use super::schedule::{
    Disturbance, Drought, Event, IGNITION_RADIUS_M, Interval, Recipe, Recurring, Schedule,
    wind_from,
};
use super::storm::WindStorm;
use crate::math;
use crate::rng::{self, Key, Process};

/// Everything that happens in years 1 to `years`, by year and month; within a month scripted events come first.
///
/// Each year and recurring disturbance has draws of its own, so the events of the first years depend neither on how many
/// years are simulated, nor on entries that follow in the script. A scripted fire without a place gets one.
pub fn drawn(schedule: &Schedule, years: u16, seed: u64) -> Vec<Event> {
    let mut events = Vec::new();
    // Scripted: numbered within their month
    let mut numbers: BTreeMap<(u16, u8), u64> = BTreeMap::new();
    for event in &schedule.events {
        let Event { year, month, .. } = *event;
        let number = numbers.entry((year, month)).or_default();
        let mut event = event.clone();
        if let Disturbance::Wildfire(fire) = &mut event.what
            && fire.ignitions.is_empty()
        {
            let mut draws = Draws::new(seed, year, month, *number);
            fire.ignitions.push(draws.ignition(Interval::only(IGNITION_RADIUS_M)));
        }
        *number += 1;
        if year <= years {
            events.push(event);
        }
    }
    // By chance: month 0 keeps their keys apart from those above
    for year in 1..=years {
        for (number, entry) in (0..).zip(&schedule.stochastic) {
            events.extend(chance(entry, year, Draws::new(seed, year, 0, number)));
        }
    }
    // stable
    events.sort_by_key(|event| (event.year, event.month));
    events
}

/// The event of a recurring disturbance in a year, if it happens.
fn chance(entry: &Recurring, year: u16, mut draws: Draws) -> Option<Event> {
    let is_its_time = (entry.first_year..=entry.last_year).contains(&year);
    if !is_its_time || draws.uniform() >= 1.0 / entry.return_years {
        return None;
    }
    let months = u16::try_from(entry.months.len()).ok()?;
    let which = draws.whole(Interval { low: 0, high: months.checked_sub(1)? });
    let month = *entry.months.get(usize::from(which))?;
    Some(Event { year, month, what: made_from(&entry.what, &mut draws) })
}

/// A disturbance of a recipe; every interval takes one draw, however wide it is.
fn made_from(recipe: &Recipe, draws: &mut Draws) -> Disturbance {
    match recipe {
        Recipe::Wildfire { wind_m_s, wind_from_rad, ignition_count, ignition_radius_m } => {
            let speed_m_s = draws.between(*wind_m_s);
            let (wind_east_m_s, wind_north_m_s) =
                wind_from(speed_m_s, draws.between(*wind_from_rad));
            let count = draws.whole(*ignition_count);
            let ignitions = (0..count).map(|_| draws.ignition(*ignition_radius_m)).collect();
            Disturbance::Wildfire(Wildfire { wind_east_m_s, wind_north_m_s, ignitions })
        }
        Recipe::WindStorm { speed_m_s, from_rad } => {
            let speed_m_s = draws.between(*speed_m_s);
            let (wind_east_m_s, wind_north_m_s) = wind_from(speed_m_s, draws.between(*from_rad));
            Disturbance::WindStorm(WindStorm { wind_east_m_s, wind_north_m_s })
        }
        Recipe::Disease {
            species,
            east_fraction,
            north_fraction,
            spread_radius_m,
            spread_probability_per_month,
            severity_per_month,
            contagious_months,
            recovery_months,
            immune_months,
            first_infected_fraction,
        } => Disturbance::Disease(Disease {
            species: *species,
            east_fraction: draws.between(*east_fraction),
            north_fraction: draws.between(*north_fraction),
            spread_radius_m: draws.between(*spread_radius_m),
            spread_probability_per_month: draws.between(*spread_probability_per_month),
            severity_per_month: draws.between(*severity_per_month),
            contagious_months: *contagious_months,
            recovery_months: *recovery_months,
            immune_months: *immune_months,
            first_infected_fraction: draws.between(*first_infected_fraction),
        }),
        Recipe::Drought { duration_months, rain_fraction } => {
            let months = draws.whole(*duration_months);
            let rain_fractions = (0..months).map(|_| draws.between(*rain_fraction)).collect();
            Disturbance::Drought(Drought { rain_fractions })
        }
    }
}

/// Draws of one event, one after the other.
struct Draws {
    key: Key,
    four: [f32; 4],
    used: usize,
}

impl Draws {
    fn new(seed: u64, year: u16, month: u8, number: u64) -> Self {
        // the low half counts the blocks of four draws
        let entity = number << 32;
        let key = Key { seed, process: Process::DisturbanceSchedule, year, month, entity };
        Self { key, four: rng::uniforms(key), used: 0 }
    }

    /// Uniform in 0..1.
    fn uniform(&mut self) -> f32 {
        if self.used == self.four.len() {
            self.key.entity += 1;
            self.four = rng::uniforms(self.key);
            self.used = 0;
        }
        self.used += 1;
        self.four[self.used - 1]
    }

    fn between(&mut self, range: Interval<f32>) -> f32 {
        // rounding may pass the end
        math::lerp(range.low, range.high, self.uniform()).min(range.high)
    }

    fn whole(&mut self, range: Interval<u16>) -> u16 {
        let values = f32::from(range.high.saturating_sub(range.low)) + 1.0;
        // below 65,536
        range.low.saturating_add((self.uniform() * values) as u16).min(range.high)
    }

    /// A place anywhere.
    fn ignition(&mut self, radius_m: Interval<f32>) -> Ignition {
        Ignition {
            east_fraction: self.uniform(),
            north_fraction: self.uniform(),
            radius_m: self.between(radius_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::schedule::parse;
    use super::*;

    const MIXED: &str = r#"
        [[event]]
        year = 40
        type = "wildfire"
        [[event]]
        year = 12
        month = 1
        type = "drought"
        rain_fractions = [0.5, 0.2]
        [[recurring]]
        type = "wind-storm"
        return_years = 10
        speed_m_s = [22, 35]
        from_deg = [300, 60]
        [[recurring]]
        type = "wildfire"
        return_years = 5
        ignition_count = [1, 3]
        ignition_radius_m = [10, 20]
        [[recurring]]
        type = "disease"
        return_years = 30
        species = "oak"
        severity_per_month = [0.1, 0.3]
        [[recurring]]
        type = "drought"
        return_years = 1
        first_year = 50
        last_year = 59
        months = [3]
        duration_months = [2, 4]
    "#;

    fn schedule(text: &str) -> Schedule {
        parse(text, &["oak".to_owned()]).unwrap()
    }

    #[test]
    fn the_first_years_do_not_depend_on_how_many_follow() {
        let schedule = schedule(MIXED);
        let all = drawn(&schedule, 2000, 7);
        assert!(all.is_sorted_by_key(|event| (event.year, event.month)));
        for years in [0, 1, 11, 12, 40, 55, 500, 1999] {
            let first: Vec<Event> =
                all.iter().filter(|event| event.year <= years).cloned().collect();
            assert_eq!(drawn(&schedule, years, 7), first, "{years} years");
        }
        assert_eq!(drawn(&schedule, 2000, 7), all);
        assert_ne!(drawn(&schedule, 2000, 8), all);
    }

    #[test]
    fn entries_that_follow_change_nothing_before_them() {
        let storm = "[[recurring]]\ntype = \"wind-storm\"\nreturn_years = 10\n";
        let drought = "[[recurring]]\ntype = \"drought\"\nreturn_years = 10\n";
        let alone = drawn(&schedule(storm), 1000, 3);
        let mut with = drawn(&schedule(&format!("{storm}{drought}")), 1000, 3);
        with.retain(|event| matches!(event.what, Disturbance::WindStorm(_)));
        assert_eq!(alone, with);
    }

    #[test]
    fn recurring_events_come_as_often_as_they_should() {
        let text =
            "[[recurring]]\ntype = \"wind-storm\"\nreturn_years = 20\nmonths = [11, 12, 1]\n";
        let events = drawn(&schedule(text), u16::MAX, 1);
        // binomial: 65,535 years at 1/20, standard deviation 56
        assert!((events.len() as f64 - 3276.75).abs() < 250.0, "{}", events.len());
        for month in [11, 12, 1] {
            let count = events.iter().filter(|event| event.month == month).count();
            assert!((count as f64 - 1092.25).abs() < 150.0, "month {month}: {count}");
        }
        let every_year = drawn(&schedule(&text.replace("20", "1")), 300, 1);
        assert!(every_year.iter().map(|event| event.year).eq(1..=300));
    }

    #[test]
    fn what_is_drawn_lies_in_its_ranges() {
        let (mut storms, mut fires, mut diseases, mut droughts) = (0, 0, 0, 0);
        for event in drawn(&schedule(MIXED), 2000, 11) {
            match event.what {
                Disturbance::WindStorm(storm) => {
                    storms += 1;
                    let WindStorm { wind_east_m_s: east, wind_north_m_s: north } = storm;
                    assert!((21.999..=35.001).contains(&east.hypot(north)));
                    // from 300° through north to 60°: southward, by half its speed at least
                    assert!(-north >= 0.499 * east.hypot(north), "{east} {north}");
                    assert!([11, 12, 1, 2].contains(&event.month));
                }
                Disturbance::Wildfire(fire) if event.year == 40 && event.month == 8 => {
                    assert_eq!(fire.ignitions.len().min(1), 1);
                }
                Disturbance::Wildfire(fire) => {
                    fires += 1;
                    assert!((1..=3).contains(&fire.ignitions.len()));
                    for place in fire.ignitions {
                        assert!((10.0..=20.0).contains(&place.radius_m));
                        assert!((0.0..1.0).contains(&place.east_fraction));
                        assert!((0.0..1.0).contains(&place.north_fraction));
                    }
                }
                Disturbance::Disease(disease) => {
                    diseases += 1;
                    assert!((0.1..=0.3).contains(&disease.severity_per_month));
                    assert_eq!(disease.spread_radius_m, 50.0);
                }
                Disturbance::Drought(drought) if event.year == 12 => {
                    assert_eq!(drought.rain_fractions, [0.5, 0.2]);
                }
                Disturbance::Drought(drought) => {
                    droughts += 1;
                    assert!((50..=59).contains(&event.year) && event.month == 3);
                    assert!((2..=4).contains(&drought.rain_fractions.len()));
                    assert!(drought.rain_fractions.iter().all(|f| (0.2..=0.6).contains(f)));
                }
            }
        }
        assert!(storms > 150 && fires > 300 && diseases > 40, "{storms} {fires} {diseases}");
        assert_eq!(droughts, 10);
    }

    #[test]
    fn a_fire_without_a_place_gets_one_of_its_own() {
        let text = "[[event]]\nyear = 3\ntype = \"wildfire\"\n".repeat(2);
        let places: Vec<Vec<Ignition>> = drawn(&schedule(&text), 3, 5)
            .into_iter()
            .map(|event| match event.what {
                Disturbance::Wildfire(fire) => fire.ignitions,
                _ => Vec::new(),
            })
            .collect();
        assert_eq!(places.iter().map(Vec::len).collect::<Vec<_>>(), [1, 1]);
        assert_ne!(places[0], places[1]);
        assert_eq!(places[0][0].radius_m, IGNITION_RADIUS_M);
    }

    #[test]
    fn odd_schedules_of_ones_own_do_not_panic() {
        let storm = Recipe::WindStorm {
            speed_m_s: Interval { low: 9.0, high: 1.0 },
            from_rad: Interval::only(0.0),
        };
        let entry = |return_years, months| Recurring {
            return_years,
            first_year: 1,
            last_year: u16::MAX,
            months,
            what: storm.clone(),
        };
        let stochastic = vec![entry(0.0, vec![]), entry(f32::NAN, vec![1]), entry(1.0, vec![0])];
        assert!(!drawn(&Schedule { events: vec![], stochastic }, 20, 1).is_empty());
    }
}
