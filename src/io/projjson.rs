//! PROJJSON: a coordinate reference system spelled out, as GeoParquet asks for it.
//!
//! Names, datum and axes come from the registry's well-known text, the projection from its PROJ string.
//!
//! # Reference
//! The PROJJSON schema 0.7 (proj.org/schemas); EPSG dataset for the codes of methods and parameters.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::wkt::{self, Node};
use crate::raster::Crs;
use crate::raster::registry::Definition;

/// A parameter of a projection: PROJ's name, the registry's name and code, and the value where PROJ's name is absent.
type Parameter = (&'static str, &'static str, u32, f64);

/// A method of projection: the registry's name and code, and its parameters.
struct Method {
    name: &'static str,
    epsg: u32,
    parameters: &'static [Parameter],
}

const NATURAL_LATITUDE: Parameter = ("lat_0", "Latitude of natural origin", 8801, 0.0);
const NATURAL_LONGITUDE: Parameter = ("lon_0", "Longitude of natural origin", 8802, 0.0);
const NATURAL_SCALE: Parameter = ("k", "Scale factor at natural origin", 8805, 1.0);
const FALSE_EASTING: Parameter = ("x_0", "False easting", 8806, 0.0);
const FALSE_NORTHING: Parameter = ("y_0", "False northing", 8807, 0.0);

const SCALED: &[Parameter] =
    &[NATURAL_LATITUDE, NATURAL_LONGITUDE, NATURAL_SCALE, FALSE_EASTING, FALSE_NORTHING];
const UNSCALED: &[Parameter] =
    &[NATURAL_LATITUDE, NATURAL_LONGITUDE, FALSE_EASTING, FALSE_NORTHING];
const TWO_PARALLELS: &[Parameter] = &[
    ("lat_0", "Latitude of false origin", 8821, 0.0),
    ("lon_0", "Longitude of false origin", 8822, 0.0),
    ("lat_1", "Latitude of 1st standard parallel", 8823, 0.0),
    ("lat_2", "Latitude of 2nd standard parallel", 8824, 0.0),
    ("x_0", "Easting at false origin", 8826, 0.0),
    ("y_0", "Northing at false origin", 8827, 0.0),
];
const ONE_PARALLEL: &[Parameter] = &[
    ("lat_ts", "Latitude of 1st standard parallel", 8823, 0.0),
    NATURAL_LONGITUDE,
    FALSE_EASTING,
    FALSE_NORTHING,
];
const OBLIQUE_FROM_ORIGIN: &[Parameter] = &[
    CENTER_LATITUDE,
    CENTER_LONGITUDE,
    CENTER_AZIMUTH,
    SKEW,
    CENTER_SCALE,
    FALSE_EASTING,
    FALSE_NORTHING,
];
const OBLIQUE_FROM_CENTER: &[Parameter] = &[
    CENTER_LATITUDE,
    CENTER_LONGITUDE,
    CENTER_AZIMUTH,
    SKEW,
    CENTER_SCALE,
    ("x_0", "Easting at projection centre", 8816, 0.0),
    ("y_0", "Northing at projection centre", 8817, 0.0),
];
const CENTER_LATITUDE: Parameter = ("lat_0", "Latitude of projection centre", 8811, 0.0);
const CENTER_LONGITUDE: Parameter = ("lonc", "Longitude of projection centre", 8812, 0.0);
const CENTER_AZIMUTH: Parameter = ("alpha", "Azimuth at projection centre", 8813, 0.0);
const SKEW: Parameter = ("gamma", "Angle from Rectified to Skew Grid", 8814, 0.0);
const CENTER_SCALE: Parameter = ("k", "Scale factor at projection centre", 8815, 1.0);

/// What of a PROJ string is no parameter of the projection.
const NOT_OF_PROJECTION: [&str; 5] = ["a", "rf", "to_meter", "vto_meter", "pm"];

/// Words that say nothing about the projection, or that the method's name says.
const KNOWN_WORDS: [&str; 9] =
    ["proj", "datum", "ellps", "nadgrids", "geoidgrids", "vunits", "pm", "no_uoff", "no_off"];

/// The system as PROJJSON; null for local metres, and for what cannot be told: systems in degrees, and PROJ strings
/// that are not in metres or have flags of their own.
///
/// # Departures
/// Shifts to WGS 84 (`+towgs84`) are left out: programs take them from the datum's name, which PROJ strings lack.
pub fn of(crs: &Crs) -> Value {
    let spelled_out = match crs {
        Crs::Local => None,
        Crs::Proj(text) => of_proj(text),
        Crs::Epsg(code) => of_epsg(*code),
    };
    spelled_out.unwrap_or(Value::Null)
}

fn of_epsg(code: u32) -> Option<Value> {
    let known = crs_definitions::from_code(u16::try_from(code).ok()?)?;
    let Some(node) = wkt::horizontal(known.wkt) else {
        // a few definitions lack their text
        let mut crs = of_proj(known.proj4)?;
        crs["id"] = id(code);
        return Some(crs);
    };
    let name = *node.values.first()?;
    let definition = Definition::of(known.proj4)?;
    let mut crs = projected(name, base(&node)?, conversion(&definition)?, axes(&node));
    // of a compound system it is the horizontal part that has places
    crs["id"] = id(node.epsg().unwrap_or(code));
    Some(crs)
}

fn of_proj(text: &str) -> Option<Value> {
    let definition = Definition::of(text)?;
    let numbers = &definition.numbers;
    if numbers.contains_key("to_meter") || numbers.contains_key("pm") {
        return None;
    }
    let datum_name = match text.split_whitespace().find_map(|w| w.strip_prefix("+datum=")) {
        Some("WGS84") => "World Geodetic System 1984",
        Some("NAD83") => "North American Datum 1983",
        _ => "unknown",
    };
    let ellipsoid = ellipsoid("unknown", *numbers.get("a")?, *numbers.get("rf")?);
    let datum =
        json!({ "type": "GeodeticReferenceFrame", "name": datum_name, "ellipsoid": ellipsoid });
    let base = json!({
        "name": "unknown", "datum": datum, "coordinate_system": geographic_axes(&json!("degree")),
    });
    Some(projected("unknown", base, conversion(&definition)?, vec![EAST, NORTH]))
}

fn projected(name: &str, base: Value, conversion: Value, axes: Vec<Axis>) -> Value {
    let axes: Vec<Value> = axes.into_iter().map(|axis| axis.json(&json!("metre"))).collect();
    json!({
        "$schema": "https://proj.org/schemas/v0.7/projjson.schema.json",
        "type": "ProjectedCRS",
        "name": name,
        "base_crs": base,
        "conversion": conversion,
        "coordinate_system": { "subtype": "Cartesian", "axis": axes },
    })
}

fn id(epsg: u32) -> Value {
    json!({ "authority": "EPSG", "code": epsg })
}

/// An axis: name, abbreviation, direction.
#[derive(Clone, Copy)]
struct Axis(&'static str, &'static str, &'static str);

const EAST: Axis = Axis("Easting", "E", "east");
const NORTH: Axis = Axis("Northing", "N", "north");

impl Axis {
    fn json(self, unit: &Value) -> Value {
        json!({ "name": self.0, "abbreviation": self.1, "direction": self.2, "unit": unit })
    }
}

/// The axes in the registry's order; GeoParquet's own order is x, y whatever they say.
fn axes(node: &Node<'_>) -> Vec<Axis> {
    let directions = node.children.iter().filter(|child| child.is(&["AXIS"]));
    let known: Option<Vec<Axis>> = directions
        .map(|axis| match axis.values.last()?.to_ascii_lowercase().as_str() {
            "east" => Some(EAST),
            "north" => Some(NORTH),
            "south" => Some(Axis("Southing", "S", "south")),
            "west" => Some(Axis("Westing", "W", "west")),
            _ => None,
        })
        .collect();
    // the texts leave the axes out where the registry has northing first
    known.filter(|axes| axes.len() == 2).unwrap_or_else(|| vec![NORTH, EAST])
}

fn geographic_axes(unit: &Value) -> Value {
    let latitude = Axis("Geodetic latitude", "Lat", "north");
    let longitude = Axis("Geodetic longitude", "Lon", "east");
    json!({ "subtype": "ellipsoidal", "axis": [latitude.json(unit), longitude.json(unit)] })
}

/// The geographic system under a projected one.
fn base(projected: &Node<'_>) -> Option<Value> {
    let base = projected.child(&["GEOGCS", "BASEGEOGCRS", "BASEGEODCRS"])?;
    let datum_node = base.child(&["DATUM", "ENSEMBLE"])?;
    let spheroid = datum_node.child(&["SPHEROID", "ELLIPSOID"])?;
    let number = |node: &Node<'_>, index: usize| node.values.get(index)?.parse::<f64>().ok();
    let ellipsoid = ellipsoid(spheroid.values.first()?, number(spheroid, 1)?, number(spheroid, 2)?);
    let mut datum = json!({
        "type": "GeodeticReferenceFrame", "name": datum_node.values.first()?, "ellipsoid": ellipsoid,
    });
    if let Some(code) = datum_node.epsg() {
        datum["id"] = id(code);
    }
    if let Some(meridian) = base.child(&["PRIMEM"])
        && let Some(longitude) = number(meridian, 1)
        && longitude != 0.0
    {
        datum["prime_meridian"] =
            json!({ "name": meridian.values.first()?, "longitude": longitude });
    }
    let unit = match base.child(&["UNIT", "ANGLEUNIT"]) {
        Some(unit) if unit.values.first() != Some(&"degree") => json!({
            "type": "AngularUnit", "name": unit.values.first()?, "conversion_factor": number(unit, 1)?,
        }),
        _ => json!("degree"),
    };
    let mut crs = json!({
        "name": base.values.first()?, "datum": datum, "coordinate_system": geographic_axes(&unit),
    });
    if let Some(code) = base.epsg() {
        crs["id"] = id(code);
    }
    Some(crs)
}

fn ellipsoid(name: &str, axis_m: f64, inverse_flattening: f64) -> Value {
    if inverse_flattening == 0.0 {
        json!({ "name": name, "radius": axis_m })
    } else {
        json!({ "name": name, "semi_major_axis": axis_m, "inverse_flattening": inverse_flattening })
    }
}

/// The projection: a method of the registry where its parameters say all, else one that goes by PROJ's own names.
fn conversion(definition: &Definition) -> Option<Value> {
    let words = &definition.words;
    if words.keys().any(|word| !KNOWN_WORDS.contains(&word.as_str())) {
        return None;
    }
    let mut numbers: BTreeMap<&str, f64> =
        definition.numbers.iter().map(|(key, value)| (key.as_str(), *value)).collect();
    numbers.retain(|key, _| !NOT_OF_PROJECTION.contains(key));
    let proj = words.get("proj")?.as_str();
    if let Some(method) = method(proj, words, &mut numbers)
        && numbers.keys().all(|key| method.parameters.iter().any(|p| p.0 == *key))
    {
        let parameters: Vec<Value> = method
            .parameters
            .iter()
            .map(|&(key, name, epsg, default)| {
                let value = numbers.get(key).copied().unwrap_or(default);
                json!({ "name": name, "value": value, "unit": unit(key), "id": id(epsg) })
            })
            .collect();
        return Some(json!({
            "name": "unnamed",
            "method": { "name": method.name, "id": id(method.epsg) },
            "parameters": parameters,
        }));
    }
    let parameters: Vec<Value> = numbers
        .iter()
        .map(|(key, value)| json!({ "name": key, "value": value, "unit": unit(key) }))
        .collect();
    Some(json!({
        "name": "unnamed", "method": { "name": format!("PROJ {proj}") }, "parameters": parameters,
    }))
}

fn unit(key: &str) -> &'static str {
    match key {
        "x_0" | "y_0" => "metre",
        "k" => "unity",
        _ => "degree",
    }
}

/// The registry's method for a projection of PROJ; `numbers` are brought to what the method asks for.
fn method(
    proj: &str,
    words: &BTreeMap<String, String>,
    numbers: &mut BTreeMap<&str, f64>,
) -> Option<Method> {
    let method = |name, epsg, parameters| Some(Method { name, epsg, parameters });
    match proj {
        "tmerc" => method("Transverse Mercator", 9807, SCALED),
        "lcc" if numbers.get("lat_1") == numbers.get("lat_2") => {
            let parallel = numbers.remove("lat_1")?;
            numbers.remove("lat_2");
            if parallel == numbers.get("lat_0").copied().unwrap_or(0.0) {
                return method("Lambert Conic Conformal (1SP)", 9801, SCALED);
            }
            numbers.extend([("lat_1", parallel), ("lat_2", parallel)]);
            method("Lambert Conic Conformal (2SP)", 9802, TWO_PARALLELS)
        }
        "lcc" => method("Lambert Conic Conformal (2SP)", 9802, TWO_PARALLELS),
        "aea" => method("Albers Equal Area", 9822, TWO_PARALLELS),
        "laea" => method("Lambert Azimuthal Equal Area", 9820, UNSCALED),
        "sterea" => method("Oblique Stereographic", 9809, SCALED),
        "cass" => method("Cassini-Soldner", 9806, UNSCALED),
        "poly" => method("American Polyconic", 9818, UNSCALED),
        "nzmg" => method("New Zealand Map Grid", 9811, UNSCALED),
        "merc" if words.get("nadgrids").is_some_and(|grids| grids == "@null") => {
            numbers.remove("lat_ts");
            method("Popular Visualisation Pseudo Mercator", 1024, UNSCALED)
        }
        "merc" if numbers.contains_key("lat_ts") => {
            method("Mercator (variant B)", 9805, ONE_PARALLEL)
        }
        "merc" => method("Mercator (variant A)", 9804, SCALED),
        "omerc" | "somerc" => {
            // the Swiss variant is the one whose line runs due east
            if let Some(longitude) = numbers.remove("lon_0") {
                numbers.insert("lonc", longitude);
            }
            let azimuth = if proj == "somerc" { 90.0 } else { *numbers.get("alpha")? };
            numbers.insert("alpha", azimuth);
            numbers.entry("gamma").or_insert(azimuth);
            if words.contains_key("no_uoff") || words.contains_key("no_off") {
                method("Hotine Oblique Mercator (variant A)", 9812, OBLIQUE_FROM_ORIGIN)
            } else {
                method("Hotine Oblique Mercator (variant B)", 9815, OBLIQUE_FROM_CENTER)
            }
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Projection;

    fn value(crs: &Value, name: &str) -> f64 {
        let parameters = crs["conversion"]["parameters"].as_array().unwrap();
        parameters.iter().find(|p| p["name"] == name).unwrap()["value"].as_f64().unwrap()
    }

    #[test]
    fn a_utm_zone_is_spelled_out() {
        let crs = of(&Crs::Epsg(32611));
        assert_eq!(crs["name"], "WGS 84 / UTM zone 11N");
        assert_eq!(crs["id"], json!({ "authority": "EPSG", "code": 32611 }));
        assert_eq!(crs["base_crs"]["id"]["code"], 4326);
        assert_eq!(crs["conversion"]["method"]["name"], "Transverse Mercator");
        assert_eq!(value(&crs, "Longitude of natural origin"), -117.0);
        assert_eq!(value(&crs, "Scale factor at natural origin"), 0.9996);
        assert_eq!(value(&crs, "False northing"), 0.0);
        assert_eq!(value(&of(&Crs::Epsg(32711)), "False northing"), 1e7);
    }

    #[test]
    fn every_metric_system_of_the_registry_is_spelled_out() {
        let metric = |code: &u32| Projection::new(&Crs::Epsg(*code)).is_ok_and(|p| p.is_metric());
        let (mut known, mut by_proj_name, mut untold) = (0, 0, Vec::new());
        for code in (0..=u32::from(u16::MAX)).filter(metric) {
            match of(&Crs::Epsg(code))["conversion"]["method"]["name"].as_str() {
                None => untold.push(code),
                Some(method) => {
                    known += 1;
                    by_proj_name += usize::from(method.starts_with("PROJ "));
                }
            }
        }
        // Guam's projection of 1963 is a flag of PROJ's
        assert_eq!(untold, [3993]);
        assert!(known > 4000 && by_proj_name < 70, "{known}, {by_proj_name}");
    }

    #[test]
    fn proj_strings_are_spelled_out() {
        let crs = of(&Crs::Proj("+proj=laea +lat_0=46.5 +lon_0=11.5 +ellps=GRS80".to_owned()));
        assert_eq!(crs["conversion"]["method"]["name"], "Lambert Azimuthal Equal Area");
        assert_eq!(value(&crs, "Latitude of natural origin"), 46.5);
        assert_eq!(crs.get("id"), None);
        let crs = of(&Crs::Proj("+proj=eqc +lat_ts=40 +datum=WGS84".to_owned()));
        assert_eq!(crs["conversion"]["method"]["name"], "PROJ eqc");
        assert_eq!(value(&crs, "lat_ts"), 40.0);
    }

    #[test]
    fn what_has_no_place_or_cannot_be_told_is_null() {
        assert_eq!(of(&Crs::Local), Value::Null);
        assert_eq!(of(&Crs::Epsg(4326)), Value::Null);
        assert_eq!(of(&Crs::Epsg(1)), Value::Null);
        for text in ["+proj=utm +zone=11 +datum=WGS84 +units=ft", "+proj=tmerc +a=6378137", ""] {
            assert_eq!(of(&Crs::Proj(text.to_owned())), Value::Null, "{text}");
        }
    }
}
