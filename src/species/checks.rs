//! Checks on the values of a biome file; each error names place, key, value and what is allowed.

use std::collections::BTreeSet;

use serde::Deserialize;

use super::allometry::{GrownEnvelope, PowerLaw};
use super::biome::BiomeError;
use crate::raster::MONTHS;

/// A power law as the file has it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LawTable {
    pub(super) log_m: f32,
    pub(super) exponent: f32,
}

/// Longest text read. chosen: the shipped files are 30 KB; a hundred times that is no biome.
pub(super) const MAX_TEXT_BYTES: usize = 4 << 20;

/// Values of a TOML text.
pub(super) fn parse<T: for<'de> Deserialize<'de>>(text: &str) -> Result<T, BiomeError> {
    if text.len() > MAX_TEXT_BYTES {
        return Err(BiomeError::TooLarge { bytes: text.len(), limit: MAX_TEXT_BYTES });
    }
    toml::from_str(text).map_err(|error| {
        let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or("");
        let line = before.matches('\n').count() + 1;
        let there = text.lines().nth(line - 1).unwrap_or("").trim();
        BiomeError::Syntax { message: format!("line {line} (`{there}`): {}", error.message()) }
    })
}

/// Between one and `high` entries.
pub(super) fn count(key: &str, count: usize, high: usize) -> Result<(), BiomeError> {
    if (1..=high).contains(&count) {
        return Ok(());
    }
    Err(BiomeError::Count { key: key.to_owned(), count, low: 1, high })
}

/// No key twice.
pub(super) fn all_differ(place: &str, keys: &[String]) -> Result<(), BiomeError> {
    let mut seen = BTreeSet::new();
    for key in keys {
        if !seen.insert(key) {
            return Err(Place(place.to_owned()).duplicate("key", key));
        }
    }
    Ok(())
}

/// Where in the file a check looks, for messages.
pub(super) struct Place(pub(super) String);

impl Place {
    pub(super) fn outside(&self, key: &str, value: f64, low: f64, high: f64) -> BiomeError {
        BiomeError::OutOfRange { place: self.0.clone(), key: key.to_owned(), value, low, high }
    }

    pub(super) fn range(
        &self,
        key: &str,
        value: f32,
        low: f32,
        high: f32,
    ) -> Result<f32, BiomeError> {
        // false for NaN
        if (low..=high).contains(&value) {
            return Ok(value);
        }
        // the shortest decimal of the f32, so that 0.05 does not read 0.05000000074505806
        let shown = |x: f32| x.to_string().parse().unwrap_or(f64::from(x));
        Err(self.outside(key, shown(value), shown(low), shown(high)))
    }

    pub(super) fn months(
        &self,
        key: &str,
        values: &[f32],
        low: f32,
        high: f32,
    ) -> Result<[f32; MONTHS], BiomeError> {
        let Ok(months) = <[f32; MONTHS]>::try_from(values) else {
            let count = values.len();
            return Err(BiomeError::NotTwelve {
                place: self.0.clone(),
                key: key.to_owned(),
                count,
            });
        };
        for (index, value) in months.into_iter().enumerate() {
            self.range(&format!("{key}[{}]", index + 1), value, low, high)?;
        }
        Ok(months)
    }

    pub(super) fn rising(
        &self,
        key: &str,
        values: &[f32],
        strictly: bool,
    ) -> Result<(), BiomeError> {
        for pair in values.windows(2) {
            if pair[1] < pair[0] || (strictly && pair[1] == pair[0]) {
                return Err(BiomeError::OutOfOrder {
                    place: self.0.clone(),
                    key: key.to_owned(),
                    detail: format!("{} comes after {}", pair[1], pair[0]),
                });
            }
        }
        Ok(())
    }

    /// Three laws (typical, dense, isolated), each growing with height and sensible at `max_height_m`.
    pub(super) fn envelope(
        &self,
        laws: [&LawTable; 3],
        names: [&str; 3],
        max_height_m: f32,
        low_m: f32,
        high_m: f32,
    ) -> Result<GrownEnvelope, BiomeError> {
        let mut checked = [PowerLaw { log_m: 0.0, exponent: 1.0 }; 3];
        for ((law, name), out) in laws.into_iter().zip(names).zip(&mut checked) {
            out.log_m = self.range(&format!("{name}.log_m"), law.log_m, -20.0, 5.0)?;
            out.exponent = self.range(&format!("{name}.exponent"), law.exponent, 0.1, 5.0)?;
            self.range(
                &format!("{name} (metres at max_height_m)"),
                out.at_m(max_height_m),
                low_m,
                high_m,
            )?;
        }
        let [typical, dense, isolated] = checked;
        // 0.1 %: room for rounded coefficients
        let widest = isolated.at_m(max_height_m) * 1.001;
        self.rising(names[1], &[dense.at_m(max_height_m), widest], false)?;
        Ok(GrownEnvelope { typical, dense, isolated })
    }

    pub(super) fn bad_text(&self, key: &str, value: &str, problem: &str) -> BiomeError {
        let value = value.chars().take(40).collect();
        BiomeError::BadText {
            place: self.0.clone(),
            key: key.to_owned(),
            value,
            problem: problem.to_owned(),
        }
    }

    pub(super) fn key(&self, key: &str, value: &str) -> Result<(), BiomeError> {
        let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        if !value.is_empty() && value.len() <= 40 && value.chars().all(allowed) {
            return Ok(());
        }
        Err(self.bad_text(key, value, "must be 1–40 of a–z, 0–9 and -"))
    }

    pub(super) fn text(&self, key: &str, value: &str) -> Result<(), BiomeError> {
        if !value.trim().is_empty() && value.chars().count() <= 80 {
            return Ok(());
        }
        Err(self.bad_text(key, value, "must be 1–80 characters"))
    }

    pub(super) fn color(&self, key: &str, value: &str) -> Result<[u8; 3], BiomeError> {
        let bytes = value.as_bytes();
        let digits = bytes
            .strip_prefix(b"#")
            .filter(|d| d.len() == 6 && d.iter().all(u8::is_ascii_hexdigit));
        if digits.is_some()
            && let Ok(rgb) = u32::from_str_radix(&value[1..], 16)
        {
            let [_, r, g, b] = rgb.to_be_bytes();
            return Ok([r, g, b]);
        }
        Err(self.bad_text(key, value, "must be a colour like `#2E7D32`"))
    }

    pub(super) fn reference(
        &self,
        key: &str,
        value: &str,
        known: &[String],
    ) -> Result<usize, BiomeError> {
        known.iter().position(|name| name == value).ok_or_else(|| BiomeError::UnknownReference {
            place: self.0.clone(),
            key: key.to_owned(),
            value: value.to_owned(),
            known: known.join(", "),
        })
    }

    pub(super) fn duplicate(&self, key: &str, value: &str) -> BiomeError {
        BiomeError::Duplicate {
            place: self.0.clone(),
            key: key.to_owned(),
            value: value.to_owned(),
        }
    }
}
