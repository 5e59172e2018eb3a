//! GeoKeys: the coordinate reference system in GeoTIFF and LAS headers.
//!
//! # Reference
//! OGC GeoTIFF Standard 1.1 (OGC 19-008r4), Annex B (keys) and Clause 7; EPSG dataset for the codes.

use geotiff_core::{GeoKeyDirectory, GeoKeyValue};

use super::ParseError;
use crate::raster::{Crs, LengthUnit};

/// Citation of files whose place on Earth is unknown; what is written is what is recognised.
pub const LOCAL_CITATION: &str = "LOCAL metres";

/// Keys of the standard, by the names it gives them.
mod key {
    pub const MODEL_TYPE: u16 = 1024;
    pub const RASTER_TYPE: u16 = 1025;
    pub const CITATION: u16 = 1026;
    pub const GEODETIC_CRS: u16 = 2048;
    pub const GEODETIC_DATUM: u16 = 2050;
    pub const PRIME_MERIDIAN: u16 = 2051;
    pub const ANGULAR_UNITS: u16 = 2054;
    pub const ELLIPSOID: u16 = 2056;
    pub const SEMI_MAJOR_AXIS: u16 = 2057;
    pub const SEMI_MINOR_AXIS: u16 = 2058;
    pub const INVERSE_FLATTENING: u16 = 2059;
    pub const PRIME_MERIDIAN_LONGITUDE: u16 = 2061;
    pub const PROJECTED_CRS: u16 = 3072;
    pub const PROJECTION: u16 = 3074;
    pub const PROJECTION_METHOD: u16 = 3075;
    pub const LINEAR_UNITS: u16 = 3076;
    pub const LINEAR_UNIT_SIZE: u16 = 3077;
    pub const STANDARD_PARALLEL_1: u16 = 3078;
    pub const STANDARD_PARALLEL_2: u16 = 3079;
    pub const NATURAL_ORIGIN_LONGITUDE: u16 = 3080;
    pub const NATURAL_ORIGIN_LATITUDE: u16 = 3081;
    pub const FALSE_EASTING: u16 = 3082;
    pub const FALSE_NORTHING: u16 = 3083;
    pub const FALSE_ORIGIN_LONGITUDE: u16 = 3084;
    pub const FALSE_ORIGIN_LATITUDE: u16 = 3085;
    pub const FALSE_ORIGIN_EASTING: u16 = 3086;
    pub const FALSE_ORIGIN_NORTHING: u16 = 3087;
    pub const CENTER_LONGITUDE: u16 = 3088;
    pub const CENTER_LATITUDE: u16 = 3089;
    pub const CENTER_EASTING: u16 = 3090;
    pub const CENTER_NORTHING: u16 = 3091;
    pub const SCALE_AT_NATURAL_ORIGIN: u16 = 3092;
    pub const SCALE_AT_CENTER: u16 = 3093;
    pub const STRAIGHT_POLE_LONGITUDE: u16 = 3095;
    pub const VERTICAL_CRS: u16 = 4096;
    pub const VERTICAL_UNITS: u16 = 4099;
}

/// The value that says "not from the EPSG registry: read the parameters".
const USER_DEFINED: u16 = 32767;

/// What the keys say about a file's place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GeoReference {
    /// The horizontal CRS, if the keys name one.
    pub crs: Option<Crs>,
    /// The unit of heights, if the keys name one.
    pub vertical_unit: Option<LengthUnit>,
    /// Whether the tie point marks the first cell's centre rather than its corner.
    pub pixel_is_point: bool,
}

/// The georeference of a GeoKey directory (tag 34735) and its two value tags (34736, 34737).
///
/// An empty directory gives no CRS; keys that no reader needs are skipped.
///
/// # Errors
/// If the directory is damaged, or if it describes a user-defined CRS in a way that is not understood.
pub fn parse(directory: &[u16], doubles: &[f64], ascii: &str) -> Result<GeoReference, ParseError> {
    let (reference, problem) = parse_understood(directory, doubles, ascii);
    problem.map_or(Ok(reference), Err)
}

/// What of a GeoKey directory is understood, and the trouble with its CRS, which the user may name instead.
pub fn parse_understood(
    directory: &[u16],
    doubles: &[f64],
    ascii: &str,
) -> (GeoReference, Option<ParseError>) {
    if directory.is_empty() {
        return (GeoReference::default(), None);
    }
    let Some(keys) = GeoKeyDirectory::parse(directory, doubles, ascii) else {
        let what = "the GeoKey directory is damaged (too short, or of an unknown version)";
        return (GeoReference::default(), Some(unknown_crs(what)));
    };
    let (crs, problem) = match horizontal(&keys) {
        Ok(Some(Crs::Proj(text))) => (Some(Crs::of_proj(text)), None),
        Ok(crs) => (crs, None),
        Err(problem) => (None, Some(problem)),
    };
    let reference = GeoReference {
        crs,
        vertical_unit: vertical_unit(&keys),
        pixel_is_point: keys.get_short(key::RASTER_TYPE) == Some(2),
    };
    (reference, problem)
}

fn unknown_crs(what: impl Into<String>) -> ParseError {
    ParseError::new(what, "give the CRS yourself: --crs EPSG:n")
}

/// A key's EPSG code; undefined (0) counts as absent.
fn code(keys: &GeoKeyDirectory, id: u16) -> Option<u16> {
    keys.get_short(id).filter(|code| *code != 0)
}

fn horizontal(keys: &GeoKeyDirectory) -> Result<Option<Crs>, ParseError> {
    let model = keys.get_short(key::MODEL_TYPE);
    if model == Some(3) {
        return Err(ParseError::new(
            "coordinates are geocentric (x, y, z from the Earth's middle)",
            "reproject the file to a map projection first, e.g. with gdalwarp -t_srs EPSG:n",
        ));
    }
    match code(keys, key::PROJECTED_CRS) {
        Some(USER_DEFINED) => return user_projected(keys).map(Some),
        Some(code) => return Ok(Some(registered(u32::from(code), keys)?)),
        None => {}
    }
    if model != Some(2)
        && (keys.get(key::PROJECTION).is_some() || keys.get(key::PROJECTION_METHOD).is_some())
    {
        return user_projected(keys).map(Some);
    }
    if model == Some(1) {
        return Err(unknown_crs("the file says its CRS is projected, but not which it is"));
    }
    match code(keys, key::GEODETIC_CRS) {
        Some(USER_DEFINED) => {
            Ok(Some(Crs::Proj(format!("+proj=longlat {} +no_defs", datum(keys)?))))
        }
        Some(code) => Ok(Some(Crs::Epsg(u32::from(code)))),
        None if keys.get_ascii(key::CITATION).is_some_and(|c| c.starts_with(LOCAL_CITATION)) => {
            Ok(Some(Crs::Local))
        }
        None => Ok(None),
    }
}

/// The registered CRS, or its PROJ string in another unit where the file overrides the unit: files of
/// American surveys name a metric code and give coordinates in feet.
fn registered(code: u32, keys: &GeoKeyDirectory) -> Result<Crs, ParseError> {
    let definition = u16::try_from(code).ok().and_then(crs_definitions::from_code);
    let (Some(definition), Some(_)) = (definition, code_of_linear_units(keys)) else {
        return Ok(Crs::Epsg(code));
    };
    let stated = linear_unit_m(keys)?;
    let registered = proj_unit_m(definition.proj4);
    match registered {
        Some(registered) if (registered / stated - 1.0).abs() > 1e-7 => {
            let rest: Vec<&str> = definition
                .proj4
                .split_whitespace()
                .filter(|w| !w.starts_with("+units=") && !w.starts_with("+to_meter="))
                .collect();
            Ok(Crs::Proj(format!("{} {}", rest.join(" "), proj_unit(stated))))
        }
        _ => Ok(Crs::Epsg(code)),
    }
}

/// Metres in a unit of a PROJ string's coordinates; none for degrees and units not known here.
fn proj_unit_m(proj: &str) -> Option<f64> {
    if proj.contains("+proj=longlat") {
        return None;
    }
    for word in proj.split_whitespace() {
        if let Some(unit) = word.strip_prefix("+units=") {
            return match unit {
                "m" => Some(1.0),
                "ft" => Some(LengthUnit::Foot.metres()),
                "us-ft" => Some(LengthUnit::UsSurveyFoot.metres()),
                _ => None,
            };
        }
        if let Some(size) = word.strip_prefix("+to_meter=") {
            return size.parse().ok();
        }
    }
    Some(1.0)
}

fn proj_unit(metres: f64) -> String {
    if metres == 1.0 {
        "+units=m".into()
    } else if metres == LengthUnit::Foot.metres() {
        "+units=ft".into()
    } else if metres == LengthUnit::UsSurveyFoot.metres() {
        "+units=us-ft".into()
    } else {
        format!("+to_meter={metres}")
    }
}

fn code_of_linear_units(keys: &GeoKeyDirectory) -> Option<u16> {
    code(keys, key::LINEAR_UNITS)
}

/// Metres in one unit of the projected coordinates; 1 where the file is silent.
fn linear_unit_m(keys: &GeoKeyDirectory) -> Result<f64, ParseError> {
    match code_of_linear_units(keys) {
        None => Ok(1.0),
        Some(USER_DEFINED) => number(keys, &[key::LINEAR_UNIT_SIZE])?
            .filter(|size| *size > 0.0)
            .ok_or_else(|| unknown_crs("the file's own unit of length has no size")),
        Some(code) => length_unit(code)
            .map(LengthUnit::metres)
            .ok_or_else(|| unknown_crs(format!("the unit of length EPSG:{code} is not known"))),
    }
}

/// The unit of an EPSG unit code.
fn length_unit(code: u16) -> Option<LengthUnit> {
    match code {
        9001 => Some(LengthUnit::Metre),
        9002 => Some(LengthUnit::Foot),
        9003 => Some(LengthUnit::UsSurveyFoot),
        _ => None,
    }
}

/// The unit of heights: the key that names it, else the unit of the vertical CRS.
fn vertical_unit(keys: &GeoKeyDirectory) -> Option<LengthUnit> {
    code(keys, key::VERTICAL_UNITS).and_then(length_unit).or_else(|| {
        match code(keys, key::VERTICAL_CRS)? {
            // EPSG dataset, vertical CRSs whose axis is not in metres
            5614 | 6130 | 6131 | 6132 | 8050 | 8051 | 8228 | 8897 => Some(LengthUnit::Foot),
            5702 | 6358 | 6359 | 6360 | 8052 | 8053 | 10919 => Some(LengthUnit::UsSurveyFoot),
            // British feet of 1936 (5754), ellipsoids and datums misused as CRS (5001–5199): unknown
            5754 | 5001..=5199 | USER_DEFINED => None,
            _ => Some(LengthUnit::Metre),
        }
    })
}

/// The first of the keys that has a number.
fn number(keys: &GeoKeyDirectory, ids: &[u16]) -> Result<Option<f64>, ParseError> {
    for &id in ids {
        let value = match keys.get(id).map(|k| &k.value) {
            Some(GeoKeyValue::Double(values)) => values.first().copied(),
            Some(GeoKeyValue::Short(value)) => Some(f64::from(*value)),
            _ => None,
        };
        match value {
            Some(value) if value.is_finite() => return Ok(Some(value)),
            Some(value) => return Err(unknown_crs(format!("GeoKey {id} is {value}"))),
            None => {}
        }
    }
    Ok(None)
}

/// Degrees in one unit of the angles.
fn angular_unit_deg(keys: &GeoKeyDirectory) -> Result<f64, ParseError> {
    match code(keys, key::ANGULAR_UNITS) {
        None | Some(9102 | 9122) => Ok(1.0),
        Some(9101) => Ok(180.0 / std::f64::consts::PI),
        Some(9105 | 9106) => Ok(0.9),
        Some(code) => Err(unknown_crs(format!("the unit of angles EPSG:{code} is not known"))),
    }
}

/// PROJ words for the datum, or the ellipsoid where the datum is not known.
fn datum(keys: &GeoKeyDirectory) -> Result<String, ParseError> {
    // 1. a registered geodetic CRS, or the one whose datum is named (EPSG numbers them 2000 apart)
    let by_crs = code(keys, key::GEODETIC_CRS).filter(|code| *code != USER_DEFINED);
    let by_datum = code(keys, key::GEODETIC_DATUM)
        .filter(|code| (6001..=6999).contains(code))
        .map(|code| code - 2000);
    for code in [by_crs, by_datum].into_iter().flatten() {
        let Some(definition) = crs_definitions::from_code(code) else { continue };
        if definition.proj4.contains("+proj=longlat") {
            let words: Vec<&str> = definition
                .proj4
                .split_whitespace()
                .filter(|word| !matches!(*word, "+proj=longlat" | "+no_defs" | "+type=crs"))
                .collect();
            return Ok(words.join(" "));
        }
    }
    // 2. an ellipsoid by its axes or code
    let major_m = number(keys, &[key::SEMI_MAJOR_AXIS])?.filter(|a| *a > 0.0);
    let minor_m = number(keys, &[key::SEMI_MINOR_AXIS])?.filter(|b| *b > 0.0);
    let inverse_flattening = number(keys, &[key::INVERSE_FLATTENING])?;
    let ellipsoid = match (major_m, minor_m, inverse_flattening) {
        (Some(a), _, Some(0.0)) => format!("+a={a} +b={a}"), // a sphere, as some writers say it
        (Some(a), _, Some(rf)) if rf > 1.0 => format!("+a={a} +rf={rf}"),
        (Some(a), Some(b), _) => format!("+a={a} +b={b}"),
        _ => match code(keys, key::ELLIPSOID) {
            Some(7030) => "+ellps=WGS84".into(),
            Some(7019) => "+ellps=GRS80".into(),
            Some(7008) => "+ellps=clrk66".into(),
            Some(7004) => "+ellps=bessel".into(),
            Some(7022) => "+ellps=intl".into(),
            Some(7024) => "+ellps=krass".into(),
            Some(7001) => "+ellps=airy".into(),
            _ => return Err(unknown_crs("the file names neither a known datum nor an ellipsoid")),
        },
    };
    // 3. the meridian that longitudes count from
    match (number(keys, &[key::PRIME_MERIDIAN_LONGITUDE])?, code(keys, key::PRIME_MERIDIAN)) {
        (Some(0.0), _) | (None, None | Some(8901)) => Ok(ellipsoid),
        (Some(longitude), _) => {
            Ok(format!("{ellipsoid} +pm={}", longitude * angular_unit_deg(keys)?))
        }
        (None, Some(code)) => {
            Err(unknown_crs(format!("the prime meridian EPSG:{code} is not known")))
        }
    }
}

/// The PROJ string of a projection given by its parameters.
fn user_projected(keys: &GeoKeyDirectory) -> Result<Crs, ParseError> {
    let datum = datum(keys)?;
    let unit_m = linear_unit_m(keys)?;
    let unit = proj_unit(unit_m);
    // Zones of UTM are projections with codes of their own: 160zz north, 161zz south.
    if let Some(projection @ (16001..=16060 | 16101..=16160)) = code(keys, key::PROJECTION) {
        let south = if projection > 16100 { " +south" } else { "" };
        let zone = projection % 100;
        return Ok(Crs::Proj(format!("+proj=utm +zone={zone}{south} {datum} {unit} +no_defs")));
    }
    let angle_deg = angular_unit_deg(keys)?;
    let degrees = |ids: &[u16]| Ok::<_, ParseError>(number(keys, ids)?.map(|v| v * angle_deg));
    let lon_0 = degrees(&[
        key::NATURAL_ORIGIN_LONGITUDE,
        key::FALSE_ORIGIN_LONGITUDE,
        key::CENTER_LONGITUDE,
        key::STRAIGHT_POLE_LONGITUDE,
    ])?
    .unwrap_or(0.0);
    let lat_0 =
        degrees(&[key::NATURAL_ORIGIN_LATITUDE, key::FALSE_ORIGIN_LATITUDE, key::CENTER_LATITUDE])?;
    let lat_1 = degrees(&[key::STANDARD_PARALLEL_1])?;
    let lat_2 = degrees(&[key::STANDARD_PARALLEL_2])?;
    let k_0 = number(keys, &[key::SCALE_AT_NATURAL_ORIGIN, key::SCALE_AT_CENTER])?;
    if k_0.is_some_and(|k| k <= 0.0) {
        return Err(unknown_crs("the projection's scale is not positive"));
    }
    let k = k_0.unwrap_or(1.0);
    // PROJ takes false eastings in metres whatever the unit of the coordinates.
    let easting =
        number(keys, &[key::FALSE_EASTING, key::FALSE_ORIGIN_EASTING, key::CENTER_EASTING])?;
    let northing =
        number(keys, &[key::FALSE_NORTHING, key::FALSE_ORIGIN_NORTHING, key::CENTER_NORTHING])?;
    let x_0 = easting.unwrap_or(0.0) * unit_m;
    let y_0 = northing.unwrap_or(0.0) * unit_m;
    let lat_0_or_equator = lat_0.unwrap_or(0.0);
    let parallel = |value: Option<f64>| {
        value.ok_or_else(|| unknown_crs("the conic projection lacks a standard parallel"))
    };

    // Codes of GeoTIFF 1.0, section 6.3.3.3
    let method = match code(keys, key::PROJECTION_METHOD) {
        Some(1) => format!("+proj=tmerc +lat_0={lat_0_or_equator} +lon_0={lon_0} +k={k}"),
        Some(7) => match lat_1 {
            Some(lat_ts) => format!("+proj=merc +lat_ts={lat_ts} +lon_0={lon_0}"),
            None => format!("+proj=merc +lon_0={lon_0} +k={k}"),
        },
        Some(8) => format!(
            "+proj=lcc +lat_0={lat_0_or_equator} +lon_0={lon_0} +lat_1={} +lat_2={}",
            parallel(lat_1)?,
            parallel(lat_2)?
        ),
        Some(9) => {
            let lat = parallel(lat_0.or(lat_1))?;
            format!("+proj=lcc +lat_1={lat} +lat_0={lat} +lon_0={lon_0} +k_0={k}")
        }
        Some(10) => format!("+proj=laea +lat_0={lat_0_or_equator} +lon_0={lon_0}"),
        Some(11) => format!(
            "+proj=aea +lat_0={lat_0_or_equator} +lon_0={lon_0} +lat_1={} +lat_2={}",
            parallel(lat_1)?,
            parallel(lat_2)?
        ),
        Some(15) => {
            // away from the pole the latitude of origin is the standard parallel, and the scale follows from it
            let pole = if lat_0_or_equator < 0.0 { -90 } else { 90 };
            match lat_0 {
                Some(lat_ts) if lat_ts.abs() < 90.0 => {
                    format!("+proj=stere +lat_0={pole} +lat_ts={lat_ts} +lon_0={lon_0}")
                }
                _ => format!("+proj=stere +lat_0={pole} +lon_0={lon_0} +k={k}"),
            }
        }
        Some(method) => {
            return Err(unknown_crs(format!(
                "the file describes its own projection by method {method}, which is not known"
            )));
        }
        None => return Err(unknown_crs("the file's own projection names no method")),
    };
    Ok(Crs::Proj(format!("{method} +x_0={x_0} +y_0={y_0} {datum} {unit} +no_defs")))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A directory of short keys and double keys, as a writer lays it out.
    fn directory(shorts: &[(u16, u16)], doubles: &[(u16, f64)]) -> (Vec<u16>, Vec<f64>) {
        let count = shorts.len() + doubles.len();
        let mut words = vec![1, 1, 0, u16::try_from(count).unwrap()];
        for (id, value) in shorts {
            words.extend([*id, 0, 1, *value]);
        }
        for (index, (id, _)) in doubles.iter().enumerate() {
            words.extend([*id, 34736, 1, u16::try_from(index).unwrap()]);
        }
        (words, doubles.iter().map(|d| d.1).collect())
    }

    fn read(shorts: &[(u16, u16)], doubles: &[(u16, f64)]) -> Result<GeoReference, ParseError> {
        let (words, values) = directory(shorts, doubles);
        parse(&words, &values, "")
    }

    fn proj_string(reference: GeoReference) -> String {
        match reference.crs {
            Some(Crs::Proj(text)) => text,
            Some(Crs::Epsg(code)) => crs_definitions::from_code(code as u16).unwrap().proj4.into(),
            other => panic!("no PROJ string but {other:?}"),
        }
    }

    #[test]
    fn registered_codes_come_before_geographic_ones() {
        let both = read(&[(1024, 1), (2048, 4765), (3072, 3794)], &[]).unwrap();
        assert_eq!(both.crs, Some(Crs::Epsg(3794)));
        let geographic = read(&[(1024, 2), (2048, 4326), (1025, 2)], &[]).unwrap();
        assert_eq!(geographic.crs, Some(Crs::Epsg(4326)));
        assert!(geographic.pixel_is_point && !both.pixel_is_point);
    }

    #[test]
    fn nothing_named_is_no_crs() {
        assert_eq!(parse(&[], &[], ""), Ok(GeoReference::default()));
        assert_eq!(read(&[(1025, 1)], &[]).unwrap().crs, None);
    }

    #[test]
    fn vertical_units_come_from_the_unit_key_or_the_vertical_crs() {
        let unit = |shorts: &[(u16, u16)]| read(shorts, &[]).unwrap().vertical_unit;
        assert_eq!(unit(&[(3072, 32611)]), None);
        assert_eq!(unit(&[(4099, 9001)]), Some(LengthUnit::Metre));
        assert_eq!(unit(&[(4096, 6360)]), Some(LengthUnit::UsSurveyFoot));
        assert_eq!(unit(&[(4096, 8228)]), Some(LengthUnit::Foot));
        assert_eq!(unit(&[(4096, 5703)]), Some(LengthUnit::Metre));
        assert_eq!(unit(&[(4096, 5703), (4099, 9003)]), Some(LengthUnit::UsSurveyFoot));
        assert_eq!(unit(&[(4096, 5103)]), None);
    }

    #[test]
    fn a_metric_code_in_feet_keeps_its_false_easting() {
        // EPSG:26941 is California zone I in metres: easting 2,000,000 m whatever the unit
        let proj = proj_string(read(&[(3072, 26941), (3076, 9003)], &[]).unwrap());
        assert!(proj.contains("+x_0=2000000") && proj.contains("+units=us-ft"), "{proj}");
        assert!(!proj.contains("+units=m"), "{proj}");
        let same = read(&[(3072, 26941), (3076, 9001)], &[]).unwrap();
        assert_eq!(same.crs, Some(Crs::Epsg(26941)));
    }

    /// EPSG:2229 (California zone V, US feet) written out as parameters lands where the registry's does.
    #[test]
    fn a_conic_given_by_parameters_agrees_with_the_registry() {
        let reference = read(
            &[(1024, 1), (3072, 32767), (3075, 8), (2048, 4269), (3076, 9003)],
            &[
                (3078, 35.466_666_666_666_67),
                (3079, 34.033_333_333_333_33),
                (3084, -118.0),
                (3085, 33.5),
                (3086, 6_561_666.666_666_666),
                (3087, 1_640_416.666_666_667),
            ],
        );
        assert_eq!(reference.as_ref().unwrap().crs, Some(Crs::Epsg(2229)));
        let own = proj4rs::Proj::from_proj_string(&proj_string(reference.unwrap())).unwrap();
        let registered = crs_definitions::from_code(2229).unwrap().proj4;
        let registered = proj4rs::Proj::from_proj_string(registered).unwrap();
        let geographic = proj4rs::Proj::from_proj_string("+proj=longlat +datum=NAD83").unwrap();
        let place = (-119.0_f64.to_radians(), 34.5_f64.to_radians(), 0.0);
        let (mut a, mut b) = (place, place);
        proj4rs::transform::transform(&geographic, &own, &mut a).unwrap();
        proj4rs::transform::transform(&geographic, &registered, &mut b).unwrap();
        assert!((a.0 - b.0).abs() < 1e-3 && (a.1 - b.1).abs() < 1e-3, "{a:?} {b:?}");
    }

    #[test]
    fn common_methods_give_strings_that_proj_reads() {
        let sphere = [(2057, 6_378_137.0), (2059, 298.257)];
        for (method, extra) in [
            (1_u16, vec![(3080, 15.0), (3092, 0.9999), (3082, 500_000.0)]),
            (7, vec![(3080, 0.0)]),
            (8, vec![(3078, 40.0), (3079, 44.0), (3085, 39.0), (3084, 3.0)]),
            (9, vec![(3081, 46.5), (3080, 3.0), (3092, 0.999_877_42)]),
            (10, vec![(3089, 52.0), (3088, 10.0)]),
            (11, vec![(3078, 50.0), (3079, 58.5), (3081, 45.0), (3080, -126.0)]),
            (15, vec![(3081, 71.0), (3095, -45.0)]),
        ] {
            let doubles: Vec<(u16, f64)> = sphere.into_iter().chain(extra).collect();
            let read = read(&[(1024, 1), (3072, 32767), (2048, 32767), (3075, method)], &doubles);
            let text = proj_string(read.unwrap());
            proj4rs::Proj::from_proj_string(&text)
                .unwrap_or_else(|e| panic!("method {method}: {text}: {e}"));
        }
        let utm = read(&[(1024, 1), (3072, 32767), (3074, 16119), (2050, 6326)], &[]).unwrap();
        assert_eq!(utm.crs, Some(Crs::Epsg(32719)));
    }

    #[test]
    fn issue_2_polar_stereographic_standard_parallel() {
        // Antarctic polar stereographic as GDAL writes it: the parallel as latitude of origin, and a scale of 1
        let shorts = [(1024, 1), (3072, 32767), (3075, 15), (2048, 4326)];
        let text = |latitude: f64, scale: f64| {
            proj_string(read(&shorts, &[(3081, latitude), (3095, 0.0), (3092, scale)]).unwrap())
        };
        let antarctic = text(-71.0, 1.0);
        assert!(antarctic.contains("+lat_0=-90 +lat_ts=-71"), "{antarctic}");
        let at_pole = text(90.0, 0.994);
        assert!(at_pole.contains("+lat_0=90 +lon_0=0 +k=0.994"), "{at_pole}");
    }

    #[test]
    fn issue_2_keys_besides_the_crs_are_kept() {
        let (words, values) = directory(&[(1024, 1), (1025, 2), (4099, 9003)], &[]);
        let (reference, problem) = parse_understood(&words, &values, "");
        assert!(problem.is_some_and(|p| p.hint.contains("--crs")));
        assert_eq!(reference.vertical_unit, Some(LengthUnit::UsSurveyFoot));
        assert!(reference.pixel_is_point && reference.crs.is_none());
    }

    #[test]
    fn what_is_not_understood_asks_for_a_crs() {
        for shorts in [
            vec![(1024, 1), (3072, 32767), (3075, 3), (2048, 4326)],
            vec![(1024, 1), (3072, 32767), (2048, 4326)],
            vec![(1024, 1), (3072, 32767), (3075, 1)],
            vec![(1024, 1)],
        ] {
            let error = read(&shorts, &[]).unwrap_err();
            assert!(error.hint.contains("--crs"), "{error}");
        }
        assert!(parse(&[1, 1], &[], "").is_err());
        let nan = read(&[(3072, 32767), (3075, 1), (2048, 4326)], &[(3080, f64::NAN)]);
        assert!(nan.is_err());
    }
}
