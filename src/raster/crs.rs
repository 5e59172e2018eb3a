//! Coordinate reference systems: their names, and the metric one that suits a place.
//!
//! What a system *does* with coordinates is [`projection`](super::projection)'s business.

use std::fmt;
use std::str::FromStr;

use super::projection::Projection;
use super::registry;

/// The coordinate reference system of map coordinates.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Crs {
    /// An entry of the EPSG registry.
    Epsg(u32),
    /// A PROJ string, for systems without an EPSG code. Inputs may have one; scenes never do.
    Proj(String),
    /// Metres in a plane of unknown place on Earth.
    Local,
}

/// Trouble with a coordinate reference system or with a point in it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum CrsError {
    /// The text names no system.
    #[error(
        "`{text}` names no coordinate reference system; give EPSG:n, or a PROJ string such as \"+proj=utm +zone=11 +datum=WGS84\""
    )]
    Unreadable { text: String },
    /// The code is not among the definitions that wildwood carries.
    #[error("EPSG:{code} is not among the built-in definitions; give its PROJ string instead")]
    UnknownEpsg { code: u32 },
    /// The system is known, but its formulas are not.
    #[error("{crs}: {problem}; reproject the file first (gdalwarp -t_srs EPSG:n in.tif out.tif)")]
    Unsupported { crs: String, problem: String },
    /// Local metres have no place on Earth.
    #[error("local metres have no place on Earth; give --crs EPSG:n")]
    NoPlace,
    /// The point lies where the system is not defined.
    #[error("({x}, {y}) does not lie where {crs} is defined; is the CRS right?")]
    OutsideDomain { crs: String, x: f64, y: f64 },
}

impl Crs {
    /// The registry's system that a PROJ string describes, else the string itself.
    pub fn of_proj(text: String) -> Self {
        registry::epsg_of(&text).map_or(Self::Proj(text), Self::Epsg)
    }

    /// The system that `text` names: `EPSG:32611`, `32611`, `local`, or a PROJ string.
    ///
    /// # Errors
    /// [`CrsError`] where nothing is named, or something that wildwood has no formulas for.
    pub fn parse(text: &str) -> Result<Self, CrsError> {
        let text = text.trim();
        if text.eq_ignore_ascii_case("local") {
            return Ok(Self::Local);
        }
        let digits = match text.split_once(':') {
            Some((authority, code)) if authority.eq_ignore_ascii_case("EPSG") => code,
            _ => text,
        };
        let crs = if text.starts_with('+') {
            Self::of_proj(text.to_owned())
        } else {
            let code = digits.trim().parse();
            Self::Epsg(code.map_err(|_| CrsError::Unreadable { text: text.to_owned() })?)
        };
        Projection::new(&crs).map(|_| crs)
    }
}

impl serde::Serialize for Crs {
    /// As text, the way users write it.
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl fmt::Display for Crs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Epsg(code) => write!(f, "EPSG:{code}"),
            Self::Proj(text) => f.write_str(text),
            Self::Local => f.write_str("local metres"),
        }
    }
}

impl FromStr for Crs {
    type Err = CrsError;

    fn from_str(text: &str) -> Result<Self, CrsError> {
        Self::parse(text)
    }
}

/// The metric system that suits a place: WGS 84 / UTM, beyond its limits Universal Polar Stereographic.
///
/// # Reference
/// NGA.STND.0037 (2014), §5 and §10: zones of 6°, widened for south-west Norway and Svalbard; UTM
/// from 80° S to 84° N.
///
/// # Errors
/// [`CrsError::OutsideDomain`] if longitude or latitude is not one.
pub fn utm_zone_for(longitude_deg: f64, latitude_deg: f64) -> Result<Crs, CrsError> {
    if !(longitude_deg.abs() <= 360.0 && latitude_deg.abs() <= 90.0) {
        let crs = "longitude and latitude".to_owned();
        return Err(CrsError::OutsideDomain { crs, x: longitude_deg, y: latitude_deg });
    }
    if latitude_deg >= 84.0 {
        return Ok(Crs::Epsg(5041));
    }
    if latitude_deg < -80.0 {
        return Ok(Crs::Epsg(5042));
    }
    let east_of_date_line_deg = (longitude_deg + 180.0).rem_euclid(360.0);
    // 0..60: the quotient is finite and below 60 by rem_euclid
    let regular_zone = (east_of_date_line_deg / 6.0) as u32 % 60 + 1;
    let longitude_deg = east_of_date_line_deg - 180.0;
    let zone = if (56.0..64.0).contains(&latitude_deg) && (3.0..12.0).contains(&longitude_deg) {
        32
    } else if latitude_deg >= 72.0 && (0.0..42.0).contains(&longitude_deg) {
        match longitude_deg {
            ..9.0 => 31,
            ..21.0 => 33,
            ..33.0 => 35,
            _ => 37,
        }
    } else {
        regular_zone
    };
    Ok(Crs::Epsg(if latitude_deg >= 0.0 { 32600 } else { 32700 } + zone))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_and_written() {
        for text in ["EPSG:32611", "32611", " epsg:32611 "] {
            assert_eq!(Crs::parse(text), Ok(Crs::Epsg(32611)));
        }
        assert_eq!(Crs::Epsg(32611).to_string(), "EPSG:32611");
        let utm = "+proj=utm +zone=11 +datum=WGS84";
        assert_eq!(Crs::parse(utm), Ok(Crs::Epsg(32611)));
        let tilted = "+proj=tmerc +lon_0=11.5 +datum=WGS84";
        assert_eq!(Crs::parse(tilted), Ok(Crs::Proj(tilted.to_owned())));
        assert_eq!("local".parse(), Ok(Crs::Local));
    }

    #[test]
    fn what_cannot_be_used_is_refused() {
        assert!(matches!(Crs::parse("WGS 84 / UTM"), Err(CrsError::Unreadable { .. })));
        assert!(matches!(Crs::parse(""), Err(CrsError::Unreadable { .. })));
        assert!(matches!(Crs::parse("EPSG:999999"), Err(CrsError::UnknownEpsg { code: 999_999 })));
        assert!(matches!(Crs::parse("EPSG:1"), Err(CrsError::UnknownEpsg { code: 1 })));
        assert!(matches!(Crs::parse("+proj=nonesuch"), Err(CrsError::Unsupported { .. })));
        // geocentric: three axes through the Earth's middle are no map
        assert!(matches!(Crs::parse("EPSG:4978"), Err(CrsError::Unsupported { .. })));
    }

    #[test]
    fn zones_follow_longitude_and_the_northern_exceptions() {
        let zone = |longitude, latitude| match utm_zone_for(longitude, latitude) {
            Ok(Crs::Epsg(code)) => code,
            other => panic!("no zone: {other:?}"),
        };
        assert_eq!(zone(-119.7, 37.1), 32611);
        assert_eq!(zone(15.0, 46.0), 32633);
        assert_eq!(zone(151.0, -33.0), 32756);
        assert_eq!(
            (zone(-180.0, 10.0), zone(180.0, 10.0), zone(179.9, 10.0)),
            (32601, 32601, 32660)
        );
        assert_eq!((zone(5.0, 60.0), zone(5.0, 50.0)), (32632, 32631));
        assert_eq!((zone(8.0, 78.0), zone(10.0, 78.0), zone(40.0, 78.0)), (32631, 32633, 32637));
        assert_eq!((zone(0.0, 85.0), zone(0.0, -85.0)), (5041, 5042));
        assert!(utm_zone_for(f64::NAN, 0.0).is_err());
        assert!(utm_zone_for(0.0, 91.0).is_err());
    }
}
