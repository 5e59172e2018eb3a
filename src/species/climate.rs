//! A biome's climate: monthly weather at the altitude where it was measured, and soil water facts.

use super::biome::BiomeError;
use super::format;
use crate::raster::MONTHS;

/// Monthly weather of a landscape; January first.
#[derive(Clone, Debug, PartialEq)]
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
#[derive(Clone, Debug, PartialEq)]
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
        format::parse_climate(text)
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
        let text = format!("{STATION}\n[soil]\nsoil_capacity_mm = 90\ninfiltration_none_slope_deg = 45");
        let soil = Climate::from_toml(&text).unwrap().soil;
        assert_eq!((soil.soil_capacity_mm, soil.infiltration_max_mm), (90.0, 100.0));
        assert!((soil.infiltration_none_slope_rad - std::f32::consts::FRAC_PI_4).abs() < 1e-6);
    }

    #[test]
    fn a_climate_file_holds_nothing_else() {
        let message = Climate::from_toml(&format!("{STATION}\n[forest]\nx = 1")).unwrap_err().to_string();
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
}
