//! The EPSG code of a system that is given by its parameters alone, as `.prj` files and PROJ strings give it.
//!
//! # Departures
//! Datums of the WGS 84 family on one ellipsoid have the same parameters, so their codes cannot be told apart:
//! NAD83 and ETRS89 are taken before their kin. The [projection](super::projection) takes the family as one anyway.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::sync::LazyLock;

use super::LengthUnit;

/// Codes that are taken before others with the same parameters: UTM on WGS 84, NAD83, and ETRS89.
const PREFERRED: [RangeInclusive<u32>; 4] =
    [32_601..=32_660, 32_701..=32_760, 26_901..=26_998, 25_801..=25_899];

/// Semi-major axis in metres and inverse flattening by PROJ's names (PROJ 9, `ellps.cpp`).
const ELLIPSOIDS: [(&str, f64, f64); 11] = [
    ("WGS84", 6_378_137.0, 298.257_223_563),
    ("GRS80", 6_378_137.0, 298.257_222_101),
    ("clrk66", 6_378_206.4, 294.978_698_213_898_2),
    ("bessel", 6_377_397.155, 299.152_812_8),
    ("intl", 6_378_388.0, 297.0),
    ("krass", 6_378_245.0, 298.3),
    ("airy", 6_377_563.396, 299.324_964_6),
    ("mod_airy", 6_377_340.189, 299.324_964_6),
    ("aust_SA", 6_378_160.0, 298.25),
    ("GRS67", 6_378_160.0, 298.247_167_427),
    ("WGS72", 6_378_135.0, 298.26),
];

/// Numbers are one where they differ by less than this share: the digits that headers print. The flattenings of
/// WGS 84 and GRS 80 differ by 5e-9.
const RELATIVE_TOLERANCE: f64 = 1e-9;

/// What a PROJ string says, however it is written.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Definition {
    /// Texts and flags, by PROJ's names; UTM is unfolded to the transverse Mercator projection that it is.
    pub(crate) words: BTreeMap<String, String>,
    /// Numbers that are not at their defaults.
    pub(crate) numbers: BTreeMap<String, f64>,
    /// Parameters to WGS 84, where they are known.
    shift: Option<Vec<f64>>,
}

/// All projected systems of the registry without heights of their own, by code.
static REGISTRY: LazyLock<Vec<(u32, Definition)>> = LazyLock::new(|| {
    let entry = |code: u16| {
        let known = crs_definitions::from_code(code)?;
        let flat = !["+vunits", "+axis", "+geoidgrids"].iter().any(|w| known.proj4.contains(w));
        let current = flat && !known.wkt.contains("(deprecated)");
        current.then(|| Some((u32::from(code), Definition::of(known.proj4)?))).flatten()
    };
    (0..=u16::MAX).filter_map(entry).collect()
});

/// The EPSG code of the projected system that a PROJ string describes, if the registry has it.
pub(super) fn epsg_of(proj: &str) -> Option<u32> {
    let wanted = Definition::of(proj)?;
    let found = REGISTRY.iter().filter(|(_, known)| known.is(&wanted)).map(|(code, _)| *code);
    found.min_by_key(|code| (!PREFERRED.iter().any(|range| range.contains(code)), *code))
}

impl Definition {
    /// `None` for degrees and for what is no definition.
    pub(crate) fn of(proj: &str) -> Option<Self> {
        let mut definition = Self::default();
        let Self { words, numbers, shift } = &mut definition;
        for word in proj.split_whitespace() {
            let (key, value) = word.strip_prefix('+')?.split_once('=').unwrap_or((&word[1..], ""));
            match (key, value) {
                ("no_defs" | "type" | "wktext", _) => {}
                ("datum", "WGS84" | "NAD83") => {
                    let name = if value == "WGS84" { "WGS84" } else { "GRS80" };
                    add_ellipsoid(numbers, name);
                    *shift = Some(vec![0.0; 7]);
                }
                ("ellps", name) if ELLIPSOIDS.iter().any(|e| e.0 == name) => {
                    add_ellipsoid(numbers, name);
                }
                ("towgs84", list) => {
                    let mut parts =
                        list.split(',').map(str::parse).collect::<Result<Vec<f64>, _>>().ok()?;
                    parts.resize(7, 0.0);
                    *shift = Some(parts);
                }
                ("units", unit @ ("m" | "ft" | "us-ft")) => {
                    let unit = match unit {
                        "m" => LengthUnit::Metre,
                        "ft" => LengthUnit::Foot,
                        _ => LengthUnit::UsSurveyFoot,
                    };
                    numbers.insert("to_meter".to_owned(), unit.metres());
                }
                ("k_0", value) => {
                    numbers.insert("k".to_owned(), value.parse().ok()?);
                }
                (key, value) => {
                    match value.parse() {
                        Ok(number) => numbers.insert(key.to_owned(), number).map(drop),
                        Err(_) => words.insert(key.to_owned(), value.to_owned()).map(drop),
                    };
                }
            }
        }
        match words.get("proj")?.as_str() {
            "longlat" | "latlong" | "geocent" => return None,
            "utm" => unfold_utm(words, numbers)?,
            "lcc" => {
                if let Some(&lat_1) = numbers.get("lat_1") {
                    numbers.entry("lat_2".to_owned()).or_insert(lat_1);
                }
            }
            _ => {}
        }
        if let (Some(a), Some(b)) = (numbers.get("a").copied(), numbers.remove("b")) {
            // a sphere has no flattening to invert: 0 stands for it
            numbers.insert("rf".to_owned(), if a == b { 0.0 } else { a / (a - b) });
        }
        let is_wgs84_like = numbers.get("a").is_some_and(|a| is_close(*a, ELLIPSOIDS[0].1))
            && numbers.get("rf").is_some_and(|rf| (rf - ELLIPSOIDS[0].2).abs() < 1e-5);
        if is_wgs84_like && !words.contains_key("nadgrids") {
            shift.get_or_insert_with(|| vec![0.0; 7]);
        }
        numbers.retain(|key, value| match key.as_str() {
            "k" | "to_meter" => *value != 1.0,
            "x_0" | "y_0" | "lat_0" | "lon_0" | "pm" => *value != 0.0,
            _ => true,
        });
        Some(definition)
    }

    fn is(&self, other: &Self) -> bool {
        let same_shift = match (&self.shift, &other.shift) {
            (None, None) => true,
            (Some(a), Some(b)) => a.iter().zip(b).all(|(a, b)| is_close(*a, *b)),
            _ => false,
        };
        same_shift
            && self.words == other.words
            && self.numbers.len() == other.numbers.len()
            && self.numbers.iter().all(|(key, value)| {
                other.numbers.get(key).is_some_and(|other| is_close(*value, *other))
            })
    }
}

fn is_close(a: f64, b: f64) -> bool {
    (a - b).abs() <= RELATIVE_TOLERANCE * a.abs().max(b.abs())
}

fn add_ellipsoid(numbers: &mut BTreeMap<String, f64>, name: &str) {
    if let Some((_, axis_m, inverse_flattening)) = ELLIPSOIDS.iter().find(|e| e.0 == name) {
        numbers.insert("a".to_owned(), *axis_m);
        numbers.insert("rf".to_owned(), *inverse_flattening);
    }
}

/// A zone of UTM as the transverse Mercator projection that it is.
fn unfold_utm(
    words: &mut BTreeMap<String, String>,
    numbers: &mut BTreeMap<String, f64>,
) -> Option<()> {
    let zone = numbers.remove("zone")?;
    let is_south = words.remove("south").is_some();
    words.insert("proj".to_owned(), "tmerc".to_owned());
    let northing_m = if is_south { 1e7 } else { 0.0 };
    for (key, value) in
        [("lon_0", 6.0 * zone - 183.0), ("k", 0.9996), ("x_0", 500_000.0), ("y_0", northing_m)]
    {
        numbers.insert(key.to_owned(), value);
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn issue_2_utm_by_parameters_is_utm_by_code() {
        for (zone, code) in [(1, 32601), (33, 32633), (60, 32660)] {
            let lon_0 = 6 * zone - 183;
            let tmerc = format!(
                "+proj=tmerc +lat_0=0 +lon_0={lon_0}.0 +k=0.9996 +x_0=500000.0 +y_0=0 +units=m \
                 +a=6378137.0 +rf=298.257223563 +towgs84=0,0,0,0,0,0,0"
            );
            assert_eq!(epsg_of(&tmerc), Some(code));
            assert_eq!(
                epsg_of(&format!("+proj=utm +zone={zone} +south +datum=WGS84")),
                Some(code + 100)
            );
        }
        assert_eq!(epsg_of("+proj=utm +zone=11 +ellps=GRS80 +units=m"), Some(26911));
        assert_eq!(epsg_of("+proj=utm +zone=32 +ellps=GRS80 +units=m"), Some(25832));
    }

    #[test]
    fn every_definition_is_its_own_or_that_of_a_twin() {
        for (code, definition) in REGISTRY.iter().step_by(7) {
            let text = crs_definitions::from_code(*code as u16).unwrap().proj4;
            let found = epsg_of(text).unwrap();
            let twin = &REGISTRY.iter().find(|(other, _)| *other == found).unwrap().1;
            assert!(twin.is(definition), "EPSG:{code} became EPSG:{found}");
        }
        assert!(REGISTRY.len() > 3000, "{}", REGISTRY.len());
    }

    #[test]
    fn what_differs_stays_without_code() {
        let utm = |text: &str| epsg_of(&format!("+proj=utm +zone=33 {text}"));
        assert_eq!(utm("+datum=WGS84"), Some(32633));
        assert_eq!(utm("+datum=WGS84 +units=ft"), None);
        assert_eq!(utm("+a=6378137 +rf=298.3 +towgs84=0,0,0"), None);
        assert_eq!(epsg_of("+proj=tmerc +lon_0=15.01 +k=0.9996 +x_0=500000 +datum=WGS84"), None);
        assert_eq!(epsg_of("+proj=longlat +datum=WGS84"), None);
        assert_eq!(epsg_of("nonsense"), None);
        assert_eq!(epsg_of(""), None);
    }
}
