//! What single and recurring disturbances of a TOML script share: their types, and keys that read alike.

use super::schedule::{ScheduleError, species_index};
use super::schedule_keys::{Entry, Table, shown};

/// A disease unless told: that of the authors' scripts, after the pine processionary moth. Radius in metres.
pub(super) const SPREAD_RADIUS_M: f32 = 50.0;
/// Chance to catch it within a month, all within the radius being ill.
pub(super) const SPREAD_PROBABILITY_PER_MONTH: f32 = 0.3;
/// Carbon pool lost in a month of illness.
pub(super) const SEVERITY_PER_MONTH: f32 = 0.25;
/// Months contagious, to recover, and immune.
const SICK_MONTHS: u16 = 12;

const DISEASE_KEYS: [&str; 10] = [
    "species",
    "east_fraction",
    "north_fraction",
    "spread_radius_m",
    "spread_probability_per_month",
    "severity_per_month",
    "contagious_months",
    "recovery_months",
    "immune_months",
    "first_infected_fraction",
];

/// Type of a disturbance.
#[derive(Clone, Copy)]
pub(super) enum Kind {
    Wildfire,
    WindStorm,
    Disease,
    Drought,
}

impl Kind {
    const KNOWN: &str = "wildfire, wind-storm, disease, drought";

    /// The `type` of a table.
    pub(super) fn of(table: &Table<'_>) -> Result<Self, ScheduleError> {
        let expected = format!("one of {}", Self::KNOWN);
        let entry = table.need("type", &expected)?;
        match entry.text(&expected)? {
            "wildfire" => Ok(Self::Wildfire),
            "wind-storm" => Ok(Self::WindStorm),
            "disease" => Ok(Self::Disease),
            "drought" => Ok(Self::Drought),
            other => Err(ScheduleError::UnknownType {
                line: entry.line(),
                key: entry.key().to_owned(),
                found: shown(other),
                known: Self::KNOWN.to_owned(),
            }),
        }
    }

    /// Month in which it begins unless told. chosen: typical of the northern middle latitudes.
    pub(super) fn month(self) -> u8 {
        match self {
            Self::Wildfire => 8,
            Self::WindStorm => 1,
            Self::Disease | Self::Drought => 5,
        }
    }

    /// Months in which it can recur unless told. chosen: the seasons around [`Self::month`].
    pub(super) fn months(self) -> &'static [u8] {
        match self {
            Self::Wildfire => &[7, 8, 9],
            Self::WindStorm => &[11, 12, 1, 2],
            Self::Disease | Self::Drought => &[4, 5, 6],
        }
    }

    /// Keys of an event, besides those of all types.
    pub(super) fn event_keys(self) -> &'static [&'static str] {
        match self {
            Self::Wildfire => &["wind_m_s", "wind_from_deg", "ignitions"],
            Self::WindStorm => &["speed_m_s", "speed_km_h", "from_deg"],
            Self::Disease => &DISEASE_KEYS,
            Self::Drought => &["rain_fractions"],
        }
    }

    /// Keys of a recurring one, besides those of all types.
    pub(super) fn recurring_keys(self) -> &'static [&'static str] {
        match self {
            Self::Wildfire => &["wind_m_s", "wind_from_deg", "ignition_count", "ignition_radius_m"],
            Self::WindStorm => &["speed_m_s", "speed_km_h", "from_deg"],
            Self::Disease => &DISEASE_KEYS,
            Self::Drought => &["duration_months", "rain_fraction"],
        }
    }
}

/// A month of the year.
pub(super) fn month(entry: &Entry<'_>) -> Result<u8, ScheduleError> {
    entry.whole(1, 12).map(|month| month as u8) // at most 12
}

/// The speed of a storm, in whichever unit, and how many of that unit are 1 m/s.
pub(super) fn storm_speed<'t>(
    table: &Table<'t>,
) -> Result<Option<(Entry<'t>, f32)>, ScheduleError> {
    match (table.get("speed_m_s"), table.get("speed_km_h")) {
        (Some(one), Some(other)) => Err(ScheduleError::Both {
            line: one.line().max(other.line()),
            key: one.key().to_owned(),
            other: other.key().to_owned(),
        }),
        (Some(entry), None) => Ok(Some((entry, 1.0))),
        (None, Some(entry)) => Ok(Some((entry, 3.6))),
        (None, None) => Ok(None),
    }
}

/// Index of the species that falls ill.
pub(super) fn species(table: &Table<'_>, species_keys: &[String]) -> Result<u16, ScheduleError> {
    let entry = table.need("species", "the key of the species that falls ill")?;
    let key = entry.text("the key of a species, in quotes")?;
    species_index(species_keys, key).ok_or_else(|| ScheduleError::UnknownSpecies {
        line: entry.line(),
        key: entry.key().to_owned(),
        found: shown(key),
        known: species_keys.join(", "),
    })
}

/// A number of months, 12 unless told.
pub(super) fn months_or(table: &Table<'_>, key: &str, low: u16) -> Result<u16, ScheduleError> {
    table.get(key).map_or(Ok(SICK_MONTHS), |entry| entry.months(low))
}
