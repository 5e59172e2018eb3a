//! A biome's climate: monthly weather at the altitude where it was measured, and soil water facts.

use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};

use super::biome::BiomeError;
use super::checks::{Place, parse};
use crate::raster::MONTHS;

/// Monthly weather of a landscape; January first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Climate {
    /// Latitude of the station, degrees north; used where the terrain's own is unknown.
    pub latitude_deg: f64,
    /// Altitude of the station, metres above sea level.
    pub station_altitude_m: f32,
    /// Mean temperature, °C, at the station.
    pub temperature_c: [f32; MONTHS],
    /// Share of daylight with the sun unclouded, 0–1.
    pub clear_sky_fraction: [f32; MONTHS],
    /// Rain, mm a month.
    pub rain_mm: [f32; MONTHS],
    /// Cooling with altitude, °C per metre.
    pub lapse_rate_c_per_m: f32,
    /// Soil water facts.
    pub soil: Soil,
}

/// How soil takes up and holds water.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Soil {
    /// Share of rain that evaporates before it reaches the soil, 0–1.
    pub evaporated_rain_fraction: f32,
    /// Most water that infiltrates on gentle slopes, mm a month.
    pub infiltration_max_mm: f32,
    /// Slope up to which infiltration is at its most.
    pub infiltration_full_slope_rad: f32,
    /// Slope from which nothing infiltrates.
    pub infiltration_none_slope_rad: f32,
    /// Most water the soil holds, mm.
    pub soil_capacity_mm: f32,
}

impl Default for Soil {
    /// The soil of both papers' programs (PAPER_NOTES §3), taken where a file says nothing else.
    fn default() -> Self {
        Self {
            evaporated_rain_fraction: 0.25,
            infiltration_max_mm: 100.0,
            infiltration_full_slope_rad: 5f32.to_radians(),
            infiltration_none_slope_rad: 55f32.to_radians(),
            soil_capacity_mm: 180.0,
        }
    }
}

impl Climate {
    /// The climate of a TOML text with a `[climate]` table and, if its soil is not the usual one, a `[soil]` table.
    /// Missing soil keys take the values of [`Soil::default`], a missing lapse rate is 6.5 °C per km.
    ///
    /// # Errors
    /// Text over 4 MiB, bad TOML, unknown or missing keys, not twelve months, values out of range.
    pub fn from_toml(text: &str) -> Result<Self, BiomeError> {
        let file: ClimateFile = parse(text)?;
        checked_climate(file.climate, file.soil)
    }

    /// The same climate with each month's rain times that month's fraction: a drought below 1, a wet year above.
    pub fn with_rain_scaled(&self, fractions: [f32; MONTHS]) -> Self {
        let mut scaled = self.clone();
        for (rain_mm, fraction) in scaled.rain_mm.iter_mut().zip(fractions) {
            *rain_mm *= fraction.max(0.0);
        }
        scaled
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ClimateFile {
    climate: ClimateTable,
    #[serde(default)]
    soil: SoilTable,
    /// What else a biome file has, so that one can serve as a climate file.
    #[serde(default, rename = "biome")]
    _biome: Option<IgnoredAny>,
    #[serde(default, rename = "sub_biomes")]
    _sub_biomes: Option<IgnoredAny>,
    #[serde(default, rename = "forest_floor")]
    _forest_floor: Option<IgnoredAny>,
    #[serde(default, rename = "undergrowth")]
    _undergrowth: Option<IgnoredAny>,
    #[serde(default, rename = "species")]
    _species: Option<IgnoredAny>,
}

/// A `[climate]` table.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ClimateTable {
    latitude_deg: f64,
    station_altitude_m: f32,
    /// 6.5: standard lapse rate of both papers (PAPER_NOTES §3).
    lapse_rate_c_per_km: Option<f32>,
    temperature_c: Vec<f32>,
    clear_sky_fraction: Vec<f32>,
    rain_mm: Vec<f32>,
}

/// A `[soil]` table.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SoilTable {
    evaporated_rain_fraction: Option<f32>,
    infiltration_max_mm_per_month: Option<f32>,
    infiltration_full_slope_deg: Option<f32>,
    infiltration_none_slope_deg: Option<f32>,
    soil_capacity_mm: Option<f32>,
}

/// Climate and soil with every value checked and in the units of the code.
pub(super) fn checked_climate(table: ClimateTable, soil: SoilTable) -> Result<Climate, BiomeError> {
    let place = Place("climate".to_owned());
    if !(-90.0..=90.0).contains(&table.latitude_deg) {
        return Err(place.outside("latitude_deg", table.latitude_deg, -90.0, 90.0));
    }
    Ok(Climate {
        latitude_deg: table.latitude_deg,
        station_altitude_m: place.range(
            "station_altitude_m",
            table.station_altitude_m,
            -500.0,
            9000.0,
        )?,
        temperature_c: place.months("temperature_c", &table.temperature_c, -80.0, 60.0)?,
        clear_sky_fraction: place.months(
            "clear_sky_fraction",
            &table.clear_sky_fraction,
            0.0,
            1.0,
        )?,
        rain_mm: place.months("rain_mm", &table.rain_mm, 0.0, 10_000.0)?,
        lapse_rate_c_per_m: place.range(
            "lapse_rate_c_per_km",
            table.lapse_rate_c_per_km.unwrap_or(6.5),
            0.0,
            15.0,
        )? / 1000.0,
        soil: checked_soil(&soil)?,
    })
}

fn checked_soil(table: &SoilTable) -> Result<Soil, BiomeError> {
    let place = Place("soil".to_owned());
    let usual = Soil::default();
    let or_usual = |key, value: Option<f32>, usual: f32, low, high| match value {
        Some(value) => place.range(key, value, low, high),
        None => Ok(usual),
    };
    let radians = |key, degrees: Option<f32>, usual_rad: f32| match degrees {
        Some(degrees) => place.range(key, degrees, 0.0, 90.0).map(f32::to_radians),
        None => Ok(usual_rad),
    };
    let soil = Soil {
        evaporated_rain_fraction: or_usual(
            "evaporated_rain_fraction",
            table.evaporated_rain_fraction,
            usual.evaporated_rain_fraction,
            0.0,
            1.0,
        )?,
        infiltration_max_mm: or_usual(
            "infiltration_max_mm_per_month",
            table.infiltration_max_mm_per_month,
            usual.infiltration_max_mm,
            0.0,
            10_000.0,
        )?,
        infiltration_full_slope_rad: radians(
            "infiltration_full_slope_deg",
            table.infiltration_full_slope_deg,
            usual.infiltration_full_slope_rad,
        )?,
        infiltration_none_slope_rad: radians(
            "infiltration_none_slope_deg",
            table.infiltration_none_slope_deg,
            usual.infiltration_none_slope_rad,
        )?,
        soil_capacity_mm: or_usual(
            "soil_capacity_mm",
            table.soil_capacity_mm,
            usual.soil_capacity_mm,
            1.0,
            5000.0,
        )?,
    };
    let (full, none) = (soil.infiltration_full_slope_rad, soil.infiltration_none_slope_rad);
    place.rising("infiltration_none_slope_deg", &[full.to_degrees(), none.to_degrees()], true)?;
    Ok(soil)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATION: &str = "
        [climate]
        latitude_deg = 42.25
        station_altitude_m = 1386
        temperature_c = [2.7, 1.9, 4.5, 7.3, 10.8, 14.9, 17.8, 17.6, 13.9, 10.2, 5.4, 3.4]
        clear_sky_fraction = [0.63, 0.65, 0.66, 0.57, 0.58, 0.65, 0.71, 0.65, 0.62, 0.58, 0.56, 0.61]
        rain_mm = [38.3, 40.1, 94.5, 126.9, 121.3, 90.4, 93.8, 82.1, 87.0, 88.0, 119.6, 27.7]
    ";

    #[test]
    fn a_climate_file_needs_no_soil() {
        let climate = Climate::from_toml(STATION).unwrap();
        assert_eq!(climate.soil, Soil::default());
        assert_eq!(climate.rain_mm[11], 27.7);
        assert!((climate.lapse_rate_c_per_m - 0.0065).abs() < 1e-9);
    }

    #[test]
    fn a_climate_file_may_state_part_of_the_soil() {
        let text =
            format!("{STATION}\n[soil]\nsoil_capacity_mm = 90\ninfiltration_none_slope_deg = 45");
        let soil = Climate::from_toml(&text).unwrap().soil;
        assert_eq!((soil.soil_capacity_mm, soil.infiltration_max_mm), (90.0, 100.0));
        assert!((soil.infiltration_none_slope_rad - std::f32::consts::FRAC_PI_4).abs() < 1e-6);
    }

    #[test]
    fn a_climate_file_holds_nothing_else() {
        let message =
            Climate::from_toml(&format!("{STATION}\n[forest]\nx = 1")).unwrap_err().to_string();
        assert!(message.contains("forest"), "{message}");
    }

    #[test]
    fn drought_scales_rain_month_by_month_and_nothing_else() {
        let climate = Climate::from_toml(STATION).unwrap();
        let mut fractions = [1.0; MONTHS];
        fractions[6] = 0.1;
        fractions[7] = -3.0;
        let dry = climate.with_rain_scaled(fractions);
        assert!((dry.rain_mm[6] - 9.38).abs() < 1e-4);
        assert_eq!((dry.rain_mm[7], dry.rain_mm[5]), (0.0, climate.rain_mm[5]));
        assert_eq!(dry.temperature_c, climate.temperature_c);
    }

    #[test]
    fn each_number_is_refused_outside_its_range_by_name() {
        let whole = format!(
            "{STATION}\nlapse_rate_c_per_km = 6.5\n[soil]\nevaporated_rain_fraction = 0.25\n\
             infiltration_max_mm_per_month = 100\ninfiltration_full_slope_deg = 5\n\
             infiltration_none_slope_deg = 55\nsoil_capacity_mm = 180"
        );
        assert!(Climate::from_toml(&whole).is_ok());
        let cases = [
            ("latitude_deg", "91", "climate: latitude_deg = 91 is outside -90..=90"),
            ("latitude_deg", "nan", "latitude_deg = NaN"),
            ("station_altitude_m", "9001", "station_altitude_m = 9001 is outside -500..=9000"),
            ("lapse_rate_c_per_km", "-1", "lapse_rate_c_per_km = -1 is outside 0..=15"),
            ("temperature_c", "[1,2,3,4,5,6,7,8,9,10,11,99]", "temperature_c[12] = 99"),
            ("temperature_c", "[1,2,3]", "temperature_c has 3 values"),
            ("clear_sky_fraction", "[2,0,0,0,0,0,0,0,0,0,0,0]", "clear_sky_fraction[1] = 2"),
            ("clear_sky_fraction", "[]", "clear_sky_fraction has 0 values"),
            ("rain_mm", "[0,0,-1,0,0,0,0,0,0,0,0,0]", "rain_mm[3] = -1"),
            ("rain_mm", "[0,0,0,0,0,0,0,0,0,0,0,0,0]", "rain_mm has 13 values"),
            (
                "evaporated_rain_fraction",
                "1.5",
                "soil: evaporated_rain_fraction = 1.5 is outside 0..=1",
            ),
            ("infiltration_max_mm_per_month", "-1", "infiltration_max_mm_per_month = -1"),
            ("infiltration_full_slope_deg", "91", "infiltration_full_slope_deg = 91"),
            ("infiltration_none_slope_deg", "-1", "infiltration_none_slope_deg = -1"),
            ("infiltration_none_slope_deg", "4", "infiltration_none_slope_deg is out of order"),
            ("infiltration_none_slope_deg", "5", "infiltration_none_slope_deg is out of order"),
            ("soil_capacity_mm", "0", "soil_capacity_mm = 0 is outside 1..=5000"),
        ];
        for (key, value, named) in cases {
            let edit = |line: &str| {
                if line.trim_start().starts_with(key) {
                    format!("{key} = {value}")
                } else {
                    line.to_owned()
                }
            };
            let text: Vec<String> = whole.lines().map(edit).collect();
            let message = Climate::from_toml(&text.join("\n")).unwrap_err().to_string();
            assert!(message.contains(named), "{key} = {value}: {message}");
        }
    }
}
