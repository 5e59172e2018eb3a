//! The biome file: TOML text to checked values. Units stand in the keys; degrees, km and MPa end here.

use serde::Deserialize;

use super::biome::{Biome, BiomeError, ForestFloor, SubBiome};
use super::checks::{LawTable, Place, all_differ, count, parse};
use super::climate::{ClimateTable, SoilTable, checked_climate};
use super::niche::{Niche, Tolerance, Trapezoid};
use super::species::{
    Crown, CrownShape, Decay, DecayResistance, Form, GrowingSeason, Leaf, LeafHabit, Species, Stem,
    Wood,
};

/// Version of the format. chosen: the first.
const FORMAT_VERSION: u32 = 1;
/// Most species. chosen: species maps hold an index in a byte and keep one value for "none".
const MAX_SPECIES: usize = 255;
/// Most sub-biomes. chosen: undergrowth clusters count every combination, 2^n − 1.
const MAX_SUB_BIOMES: usize = 12;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BiomeFile {
    biome: Header,
    climate: ClimateTable,
    #[serde(default)]
    soil: SoilTable,
    sub_biomes: Vec<SubBiomeTable>,
    forest_floor: ForestFloorTable,
    undergrowth: Option<UndergrowthTable>,
    species: Vec<SpeciesTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    key: String,
    name: String,
    format_version: u32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SubBiomeTable {
    key: String,
    name: String,
    canopy: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ForestFloorTable {
    max_grass_height_m: f32,
    grass_moisture_mm: TrapezoidTable,
    grass_temperature_c: TrapezoidTable,
    grass_sun_h: TrapezoidTable,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct UndergrowthTable {
    most_seedlings_per_m2_year: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TrapezoidTable {
    lowest: f32,
    full_from: f32,
    full_to: f32,
    highest: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SpeciesTable {
    key: String,
    common_name: String,
    scientific_name: String,
    form: Form,
    leaf: Leaf,
    leaf_habit: LeafHabit,
    color_srgb: String,
    sub_biomes: Vec<String>,
    max_age_years: f32,
    max_height_m: f32,
    isolated_height_fraction: f32,
    height_curve_q: f32,
    absorbed_light_fraction: f32,
    growing_first_month: u8,
    growing_last_month: u8,
    niche: NicheTable,
    crown: CrownTable,
    stem: StemTable,
    wood: WoodTable,
    decay: DecayTable,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NicheTable {
    sun_ideal_h: f32,
    sun_half_width_h: f32,
    moisture_ideal_mm: f32,
    moisture_half_width_mm: f32,
    temperature_ideal_c: f32,
    temperature_half_width_c: f32,
    slope_ideal_deg: f32,
    slope_half_width_deg: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CrownTable {
    shape: CrownShape,
    base_fraction_dense: f32,
    base_fraction_isolated: f32,
    radius: LawTable,
    radius_dense: LawTable,
    radius_isolated: LawTable,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StemTable {
    max_trunk_diameter_m: f32,
    dbh: LawTable,
    dbh_dense: LawTable,
    dbh_isolated: LawTable,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WoodTable {
    density_kg_m3: f32,
    modulus_of_rupture_mpa: f32,
    pulling_coefficient_nm_kg: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DecayTable {
    deathspan_years: f32,
    log_seeding_multiplier: f32,
    resistance: DecayResistance,
}

/// A biome from TOML text.
pub(super) fn parse_biome(text: &str) -> Result<Biome, BiomeError> {
    let file: BiomeFile = parse(text)?;
    // Header
    let found = file.biome.format_version;
    if found != FORMAT_VERSION {
        return Err(BiomeError::Version { found, supported: FORMAT_VERSION });
    }
    let place = Place("biome".to_owned());
    place.key("key", &file.biome.key)?;
    place.text("name", &file.biome.name)?;
    let climate = checked_climate(file.climate, file.soil)?;
    let forest_floor = forest_floor(file.forest_floor)?;
    let most_seedlings_per_m2_year = match file.undergrowth {
        None => f32::INFINITY,
        Some(table) => Place("undergrowth".to_owned()).range(
            "most_seedlings_per_m2_year",
            table.most_seedlings_per_m2_year,
            1e-4,
            1e3,
        )?,
    };
    // Names before what refers to them
    count("species", file.species.len(), MAX_SPECIES)?;
    count("sub_biomes", file.sub_biomes.len(), MAX_SUB_BIOMES)?;
    let sub_biome_keys: Vec<String> =
        file.sub_biomes.iter().map(|table| table.key.clone()).collect();
    all_differ("sub_biomes", &sub_biome_keys)?;
    for key in &sub_biome_keys {
        Place(format!("sub-biome `{key}`")).key("key", key)?;
    }
    let species_keys: Vec<String> = file.species.iter().map(|table| table.key.clone()).collect();
    all_differ("species", &species_keys)?;
    let mut species = Vec::with_capacity(file.species.len());
    for table in file.species {
        species.push(one_species(table, &sub_biome_keys)?);
    }
    let sub_biomes = sub_biomes(file.sub_biomes, &mut species, &species_keys)?;
    Ok(Biome {
        key: file.biome.key,
        name: file.biome.name,
        climate,
        sub_biomes,
        forest_floor,
        most_seedlings_per_m2_year,
        species,
    })
}

fn forest_floor(table: ForestFloorTable) -> Result<ForestFloor, BiomeError> {
    let place = Place("forest_floor".to_owned());
    let trapezoid = |key: &str, t: TrapezoidTable, low, high| {
        let corners = [t.lowest, t.full_from, t.full_to, t.highest];
        for corner in corners {
            place.range(key, corner, low, high)?;
        }
        place.rising(key, &corners, false)?;
        Ok(Trapezoid {
            lowest: t.lowest,
            full_from: t.full_from,
            full_to: t.full_to,
            highest: t.highest,
        })
    };
    Ok(ForestFloor {
        max_grass_height_m: place.range(
            "max_grass_height_m",
            table.max_grass_height_m,
            0.01,
            5.0,
        )?,
        moisture_mm: trapezoid("grass_moisture_mm", table.grass_moisture_mm, 0.0, 10_000.0)?,
        temperature_c: trapezoid("grass_temperature_c", table.grass_temperature_c, -80.0, 80.0)?,
        sun_h: trapezoid("grass_sun_h", table.grass_sun_h, 0.0, 24.0)?,
    })
}

/// Sub-biomes with their members; tells canopy species which one is theirs.
fn sub_biomes(
    tables: Vec<SubBiomeTable>,
    species: &mut [Species],
    species_keys: &[String],
) -> Result<Vec<SubBiome>, BiomeError> {
    let names: Vec<String> = tables.iter().map(|table| table.key.clone()).collect();
    let mut sub_biomes = Vec::with_capacity(tables.len());
    for (index, table) in tables.into_iter().enumerate() {
        let place = Place(format!("sub-biome `{}`", table.key));
        place.text("name", &table.name)?;
        let mut canopy = Vec::with_capacity(table.canopy.len());
        for name in &table.canopy {
            let which = place.reference("canopy", name, species_keys)?;
            if canopy.contains(&which) {
                return Err(place.duplicate("canopy", name));
            }
            if !species[which].sub_biomes.contains(&index) {
                return Err(BiomeError::CanopyNotMember {
                    sub_biome: table.key.clone(),
                    species: name.clone(),
                });
            }
            if let Some(first) = species[which].canopy_sub_biome {
                return Err(BiomeError::CanopyTwice {
                    species: name.clone(),
                    first: names[first].clone(),
                    second: table.key.clone(),
                });
            }
            species[which].canopy_sub_biome = Some(index);
            canopy.push(which);
        }
        let members =
            (0..species.len()).filter(|&i| species[i].sub_biomes.contains(&index)).collect();
        sub_biomes.push(SubBiome { key: table.key, name: table.name, canopy, members });
    }
    Ok(sub_biomes)
}

fn one_species(table: SpeciesTable, sub_biome_keys: &[String]) -> Result<Species, BiomeError> {
    let place = Place(format!("species `{}`", table.key));
    place.key("key", &table.key)?;
    place.text("common_name", &table.common_name)?;
    place.text("scientific_name", &table.scientific_name)?;
    let mut sub_biomes = Vec::with_capacity(table.sub_biomes.len());
    for name in &table.sub_biomes {
        let which = place.reference("sub_biomes", name, sub_biome_keys)?;
        if sub_biomes.contains(&which) {
            return Err(place.duplicate("sub_biomes", name));
        }
        sub_biomes.push(which);
    }
    let month = |key, month: u8| -> Result<u8, BiomeError> {
        if (1..=12).contains(&month) {
            Ok(month)
        } else {
            Err(place.outside(key, f64::from(month), 1.0, 12.0))
        }
    };
    // the tallest tree measured stands 116 m
    let max_height_m = place.range("max_height_m", table.max_height_m, 0.05, 130.0)?;
    Ok(Species {
        // the oldest tree counted has 4,850 rings
        max_age_years: place.range("max_age_years", table.max_age_years, 1.0, 6000.0)?,
        isolated_height_fraction: place.range(
            "isolated_height_fraction",
            table.isolated_height_fraction,
            0.2,
            1.0,
        )?,
        height_curve_q: place.range("height_curve_q", table.height_curve_q, -30.0, -0.5)?,
        absorbed_light_fraction: place.range(
            "absorbed_light_fraction",
            table.absorbed_light_fraction,
            0.01,
            0.99,
        )?,
        growing_season: GrowingSeason {
            first_month: month("growing_first_month", table.growing_first_month)?,
            last_month: month("growing_last_month", table.growing_last_month)?,
        },
        color_srgb: place.color("color_srgb", &table.color_srgb)?,
        niche: niche(&place, &table.niche)?,
        crown: crown(&place, &table.crown, max_height_m)?,
        stem: stem(&place, &table.stem, max_height_m)?,
        wood: wood(&place, &table.wood)?,
        decay: decay(&place, &table.decay)?,
        max_height_m,
        sub_biomes,
        canopy_sub_biome: None,
        form: table.form,
        leaf: table.leaf,
        leaf_habit: table.leaf_habit,
        key: table.key,
        common_name: table.common_name,
        scientific_name: table.scientific_name,
    })
}

fn niche(place: &Place, table: &NicheTable) -> Result<Niche, BiomeError> {
    let degrees = |key, value, low| place.range(key, value, low, 90.0).map(f32::to_radians);
    Ok(Niche {
        sun_h: Tolerance {
            ideal: place.range("niche.sun_ideal_h", table.sun_ideal_h, 0.0, 24.0)?,
            half_width: place.range("niche.sun_half_width_h", table.sun_half_width_h, 0.1, 24.0)?,
        },
        moisture_mm: Tolerance {
            ideal: place.range("niche.moisture_ideal_mm", table.moisture_ideal_mm, 0.0, 5000.0)?,
            half_width: place.range(
                "niche.moisture_half_width_mm",
                table.moisture_half_width_mm,
                0.1,
                5000.0,
            )?,
        },
        temperature_c: Tolerance {
            ideal: place.range(
                "niche.temperature_ideal_c",
                table.temperature_ideal_c,
                -40.0,
                60.0,
            )?,
            half_width: place.range(
                "niche.temperature_half_width_c",
                table.temperature_half_width_c,
                0.1,
                100.0,
            )?,
        },
        slope_rad: Tolerance {
            ideal: degrees("niche.slope_ideal_deg", table.slope_ideal_deg, 0.0)?,
            half_width: degrees("niche.slope_half_width_deg", table.slope_half_width_deg, 1.0)?,
        },
    })
}

fn crown(place: &Place, table: &CrownTable, max_height_m: f32) -> Result<Crown, BiomeError> {
    let base_fraction_isolated =
        place.range("crown.base_fraction_isolated", table.base_fraction_isolated, 0.0, 0.95)?;
    let base_fraction_dense =
        place.range("crown.base_fraction_dense", table.base_fraction_dense, 0.0, 0.95)?;
    place.rising(
        "crown.base_fraction_dense",
        &[base_fraction_isolated, base_fraction_dense],
        false,
    )?;
    let laws = [&table.radius, &table.radius_dense, &table.radius_isolated];
    let names = ["crown.radius", "crown.radius_dense", "crown.radius_isolated"];
    // crowns wider than 30 m from the stem are not known
    let radius = place.envelope(laws, names, max_height_m, 0.005, 30.0)?;
    Ok(Crown { shape: table.shape, radius, base_fraction_dense, base_fraction_isolated })
}

fn stem(place: &Place, table: &StemTable, max_height_m: f32) -> Result<Stem, BiomeError> {
    let laws = [&table.dbh, &table.dbh_dense, &table.dbh_isolated];
    let names = ["stem.dbh", "stem.dbh_dense", "stem.dbh_isolated"];
    Ok(Stem {
        // laws may pass the greatest diameter, which then caps them
        dbh: place.envelope(laws, names, max_height_m, 0.0005, 100.0)?,
        max_trunk_diameter_m: place.range(
            "stem.max_trunk_diameter_m",
            table.max_trunk_diameter_m,
            0.001,
            12.0,
        )?,
    })
}

fn wood(place: &Place, table: &WoodTable) -> Result<Wood, BiomeError> {
    let rupture_mpa =
        place.range("wood.modulus_of_rupture_mpa", table.modulus_of_rupture_mpa, 0.1, 300.0)?;
    Ok(Wood {
        // from balsa to lignum vitae, with room for pith
        density_kg_m3: place.range("wood.density_kg_m3", table.density_kg_m3, 50.0, 1400.0)?,
        modulus_of_rupture_pa: rupture_mpa * 1e6,
        pulling_coefficient_nm_kg: place.range(
            "wood.pulling_coefficient_nm_kg",
            table.pulling_coefficient_nm_kg,
            10.0,
            1000.0,
        )?,
    })
}

fn decay(place: &Place, table: &DecayTable) -> Result<Decay, BiomeError> {
    Ok(Decay {
        deathspan_years: place.range(
            "decay.deathspan_years",
            table.deathspan_years,
            0.5,
            2000.0,
        )?,
        log_seeding_multiplier: place.range(
            "decay.log_seeding_multiplier",
            table.log_seeding_multiplier,
            0.0,
            1000.0,
        )?,
        resistance: table.resistance,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::checks::MAX_TEXT_BYTES;
    use super::super::climate::Climate;
    use super::*;

    const SMALL: &str = r##"
        [biome]
        key = "meadow"
        name = "Meadow"
        format_version = 1
        [climate]
        latitude_deg = 45.0
        station_altitude_m = 100
        lapse_rate_c_per_km = 6.5
        temperature_c = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]
        clear_sky_fraction = [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]
        rain_mm = [50, 50, 50, 50, 50, 50, 50, 50, 50, 50, 50, 50]
        [soil]
        evaporated_rain_fraction = 0.25
        infiltration_max_mm_per_month = 100
        infiltration_full_slope_deg = 5
        infiltration_none_slope_deg = 55
        soil_capacity_mm = 180
        [[sub_biomes]]
        key = "grove"
        name = "Grove"
        canopy = ["elm"]
        [[sub_biomes]]
        key = "edge"
        name = "Edge"
        canopy = []
        [forest_floor]
        max_grass_height_m = 0.6
        grass_moisture_mm = { lowest = 20, full_from = 60, full_to = 1000, highest = 1500 }
        grass_temperature_c = { lowest = 5, full_from = 15, full_to = 22, highest = 40 }
        grass_sun_h = { lowest = 1.5, full_from = 4, full_to = 12, highest = 15 }
        [[species]]
        key = "elm"
        common_name = "Elm"
        scientific_name = "Ulmus glabra"
        form = "tree"
        leaf = "broad"
        leaf_habit = "winter-deciduous"
        color_srgb = "#2E7D32"
        sub_biomes = ["grove", "edge"]
        max_age_years = 300
        max_height_m = 40
        isolated_height_fraction = 0.8
        height_curve_q = -5
        absorbed_light_fraction = 0.4
        growing_first_month = 4
        growing_last_month = 10
        [species.niche]
        sun_ideal_h = 6
        sun_half_width_h = 4
        moisture_ideal_mm = 40
        moisture_half_width_mm = 20
        temperature_ideal_c = 15
        temperature_half_width_c = 18
        slope_ideal_deg = 0
        slope_half_width_deg = 70
        [species.crown]
        shape = "ellipsoid"
        base_fraction_dense = 0.5
        base_fraction_isolated = 0.2
        radius = { log_m = -1.5, exponent = 0.9 }
        radius_dense = { log_m = -1.8, exponent = 0.9 }
        radius_isolated = { log_m = -1.2, exponent = 0.9 }
        [species.stem]
        max_trunk_diameter_m = 2
        dbh = { log_m = -5, exponent = 1.5 }
        dbh_dense = { log_m = -5.2, exponent = 1.5 }
        dbh_isolated = { log_m = -4.8, exponent = 1.5 }
        [species.wood]
        density_kg_m3 = 600
        modulus_of_rupture_mpa = 60
        pulling_coefficient_nm_kg = 162
        [species.decay]
        deathspan_years = 40
        log_seeding_multiplier = 1
        resistance = "slight"
    "##;

    /// The small biome with the line that begins with `key` (the `nth` such line) replaced by `line`.
    fn edited(key: &str, nth: usize, line: &str) -> String {
        let mut seen = 0;
        let lines: Vec<String> = SMALL
            .lines()
            .map(|old| {
                let hit = old.trim_start().starts_with(key);
                seen += usize::from(hit);
                if hit && seen == nth + 1 { line.to_owned() } else { old.to_owned() }
            })
            .collect();
        assert!(seen > nth, "no line {key}");
        lines.join("\n")
    }

    #[test]
    fn the_small_biome_is_valid_and_converted() {
        let biome = parse_biome(SMALL).unwrap();
        let elm = &biome.species[0];
        assert_eq!(elm.color_srgb, [0x2E, 0x7D, 0x32]);
        assert_eq!((elm.canopy_sub_biome, elm.wood.modulus_of_rupture_pa), (Some(0), 60e6));
        assert_eq!(elm.niche.slope_rad.half_width, 70f32.to_radians());
        assert_eq!((biome.sub_biomes[0].members.len(), biome.sub_biomes[1].canopy.len()), (1, 0));
    }

    #[test]
    fn each_number_is_refused_outside_its_range_by_name() {
        let nth_is_0 = |cases: &[(&'static str, &'static str, &'static str)]| -> Vec<_> {
            cases.iter().map(|&(key, value, named)| (key, 0, value, named)).collect()
        };
        let mut cases = nth_is_0(&[
            ("max_grass_height_m", "0", "forest_floor: max_grass_height_m = 0"),
            ("max_age_years", "0.5", "species `elm`: max_age_years = 0.5 is outside 1..=6000"),
            ("max_height_m", "-3", "species `elm`: max_height_m = -3 is outside 0.05..=130"),
            ("max_height_m", "inf", "max_height_m = inf"),
            (
                "isolated_height_fraction",
                "1.2",
                "isolated_height_fraction = 1.2 is outside 0.2..=1",
            ),
            ("height_curve_q", "5", "height_curve_q = 5 is outside -30..=-0.5"),
            ("absorbed_light_fraction", "1", "absorbed_light_fraction = 1 is outside 0.01..=0.99"),
            ("growing_first_month", "0", "growing_first_month = 0 is outside 1..=12"),
            ("growing_last_month", "13", "growing_last_month = 13 is outside 1..=12"),
            ("sun_ideal_h", "25", "niche.sun_ideal_h = 25 is outside 0..=24"),
            ("sun_half_width_h", "0", "niche.sun_half_width_h = 0 is outside 0.1..=24"),
            ("moisture_ideal_mm", "-1", "niche.moisture_ideal_mm = -1"),
            ("moisture_half_width_mm", "0", "niche.moisture_half_width_mm = 0"),
            ("temperature_ideal_c", "61", "niche.temperature_ideal_c = 61"),
            ("temperature_half_width_c", "0", "niche.temperature_half_width_c = 0"),
            ("slope_ideal_deg", "-1", "niche.slope_ideal_deg = -1 is outside 0..=90"),
            ("slope_half_width_deg", "0", "niche.slope_half_width_deg = 0 is outside 1..=90"),
            ("base_fraction_dense", "0.99", "crown.base_fraction_dense = 0.99"),
            ("base_fraction_dense", "0.1", "crown.base_fraction_dense is out of order"),
            ("base_fraction_isolated", "-0.1", "crown.base_fraction_isolated = -0.1"),
            ("radius =", "{ log_m = 6, exponent = 1 }", "crown.radius.log_m = 6"),
            (
                "radius =",
                "{ log_m = -1, exponent = 0 }",
                "crown.radius.exponent = 0 is outside 0.1..=5",
            ),
            (
                "radius =",
                "{ log_m = 2, exponent = 1 }",
                "crown.radius (metres at max_height_m) = 295",
            ),
            (
                "radius_dense",
                "{ log_m = -1, exponent = 0.9 }",
                "crown.radius_dense is out of order",
            ),
            (
                "radius_isolated",
                "{ log_m = -1, exponent = 9 }",
                "crown.radius_isolated.exponent = 9",
            ),
            ("max_trunk_diameter_m", "0", "stem.max_trunk_diameter_m = 0"),
            ("dbh =", "{ log_m = -19, exponent = 1 }", "stem.dbh (metres at max_height_m)"),
            ("dbh_dense", "{ log_m = -4, exponent = 1.5 }", "stem.dbh_dense is out of order"),
            ("dbh_isolated", "{ log_m = -21, exponent = 1 }", "stem.dbh_isolated.log_m = -21"),
            ("density_kg_m3", "2000", "wood.density_kg_m3 = 2000 is outside 50..=1400"),
            ("modulus_of_rupture_mpa", "60000000", "wood.modulus_of_rupture_mpa = 60000000"),
            ("pulling_coefficient_nm_kg", "0", "wood.pulling_coefficient_nm_kg = 0"),
            ("deathspan_years", "0", "decay.deathspan_years = 0 is outside 0.5..=2000"),
            ("log_seeding_multiplier", "-1", "decay.log_seeding_multiplier = -1"),
        ]);
        for key in ["grass_moisture_mm", "grass_temperature_c", "grass_sun_h"] {
            cases.push((
                key,
                0,
                "{ lowest = 9, full_from = 8, full_to = 12, highest = 15 }",
                "is out of order",
            ));
            cases.push((
                key,
                0,
                "{ lowest = 1, full_from = 8, full_to = 12, highest = 1e5 }",
                "= 100000",
            ));
        }
        for (key, nth, value, named) in cases {
            let key_alone = key.trim_end_matches([' ', '=']);
            let error =
                parse_biome(&edited(key, nth, &format!("{key_alone} = {value}"))).unwrap_err();
            let message = error.to_string();
            assert!(message.contains(named), "{key} = {value}: {message}");
            assert!(!matches!(error, BiomeError::Syntax { .. }), "{key} = {value}: {message}");
        }
    }

    #[test]
    fn names_are_checked() {
        let cases = [
            ("format_version", 0, "format_version = 2", "format_version = 2 is not supported"),
            ("key", 0, r#"key = "My Meadow""#, "biome: key = `My Meadow`"),
            ("key", 1, r#"key = "Grove""#, "sub-biome `Grove`: key"),
            ("key", 2, r#"key = """#, "sub-biome ``"),
            ("key", 3, r#"key = "elm tree""#, "species `elm tree`: key"),
            ("name", 0, r#"name = " ""#, "biome: name"),
            ("name", 1, r#"name = """#, "sub-biome `grove`: name"),
            ("key", 2, r#"key = "grove""#, "`grove` is used twice"),
            ("common_name", 0, r#"common_name = """#, "common_name"),
            ("scientific_name", 0, r#"scientific_name = """#, "scientific_name"),
            ("color_srgb", 0, r##"color_srgb = "#12345""##, "must be a colour"),
            ("color_srgb", 0, r##"color_srgb = "#12345é""##, "must be a colour"),
            ("color_srgb", 0, r##"color_srgb = "#+12345""##, "must be a colour"),
            (
                "sub_biomes",
                0,
                r#"sub_biomes = ["swamp"]"#,
                "names `swamp`, which is not defined; known are grove, edge",
            ),
            ("sub_biomes", 0, r#"sub_biomes = ["edge", "edge"]"#, "`edge` is used twice"),
            ("sub_biomes", 0, r#"sub_biomes = ["edge"]"#, "do not hold `grove`; add it there"),
            (
                "canopy",
                0,
                r#"canopy = ["ash"]"#,
                "names `ash`, which is not defined; known are elm",
            ),
            ("canopy", 0, r#"canopy = ["elm", "elm"]"#, "`elm` is used twice"),
            ("canopy", 1, r#"canopy = ["elm"]"#, "canopy of both `grove` and `edge`"),
        ];
        for (key, nth, line, named) in cases {
            let message = parse_biome(&edited(key, nth, line)).unwrap_err().to_string();
            assert!(message.contains(named), "{line}: {message}");
        }
    }

    #[test]
    fn lists_have_sensible_lengths() {
        let (head, species) = SMALL.split_at(SMALL.find("[[species]]").unwrap());
        let twice = format!("{SMALL}\n{species}");
        assert!(parse_biome(&twice).unwrap_err().to_string().contains("`elm` is used twice"));
        let none = format!("species = []\n{head}");
        assert!(parse_biome(&none).unwrap_err().to_string().contains("species has 0 entries"));
        let many: String =
            (0..256).map(|i| species.replace("\"elm\"", &format!("\"elm-{i}\""))).collect();
        let message = parse_biome(&format!("{head}{many}")).unwrap_err().to_string();
        assert!(message.contains("species has 256 entries; allowed are 1 to 255"), "{message}");
        let sub_biomes: String = (0..13)
            .map(|i| format!("[[sub_biomes]]\nkey = \"s{i}\"\nname = \"S\"\ncanopy = []\n"))
            .collect();
        let message = parse_biome(&format!("{SMALL}\n{sub_biomes}")).unwrap_err().to_string();
        assert!(message.contains("sub_biomes has 15 entries"), "{message}");
    }

    #[test]
    fn toml_trouble_is_told_with_its_place() {
        let cases = [
            (edited("max_age_years", 0, "max_age_year = 300"), "max_age_year"),
            (edited("max_age_years", 0, ""), "max_age_years"),
            (edited("max_age_years", 0, "max_age_years = \"old\""), "max_age_years"),
            (edited("form =", 0, "form = \"bush\""), "shrub"),
            (edited("growing_first_month", 0, "growing_first_month = -4"), "growing_first_month"),
            ("[biome".to_owned(), "line 1"),
        ];
        for (text, named) in cases {
            let error = parse_biome(&text).unwrap_err();
            let message = error.to_string();
            assert!(
                matches!(error, BiomeError::Syntax { .. }) && message.contains(named),
                "{message}"
            );
        }
    }

    #[test]
    fn long_texts_are_refused_unread() {
        let text = " ".repeat(MAX_TEXT_BYTES + 1);
        assert_eq!(
            Climate::from_toml(&text),
            Err(BiomeError::TooLarge { bytes: MAX_TEXT_BYTES + 1, limit: MAX_TEXT_BYTES })
        );
    }

    #[test]
    fn deep_nesting_is_an_error_not_an_overflow() {
        for text in
            ["[".repeat(200_000), format!("a = {}", "[".repeat(200_000)), "a.".repeat(200_000)]
        {
            assert!(parse_biome(&text).is_err());
            assert!(Climate::from_toml(&text).is_err());
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
            let text = String::from_utf8_lossy(&bytes);
            let _ = parse_biome(&text);
            let _ = Climate::from_toml(&text);
        }

        #[test]
        fn random_edits_never_panic(
            edits in proptest::collection::vec((0..SMALL.len(), any::<u8>(), 0..3u8), 1..6)
        ) {
            let mut bytes = SMALL.as_bytes().to_vec();
            for (at, byte, kind) in edits {
                let at = at.min(bytes.len() - 1);
                match kind {
                    0 => bytes[at] = byte,
                    1 => bytes.insert(at, byte),
                    _ => { bytes.remove(at); }
                }
            }
            if let Ok(biome) = parse_biome(&String::from_utf8_lossy(&bytes)) {
                // whatever passes the checks gives finite sizes
                let species = &biome.species[0];
                for height_m in [0.0, 0.01, species.max_height_m] {
                    prop_assert!(species.crown_radius_in_shade_m(height_m, 0.5).is_finite());
                    prop_assert!(species.dbh_in_shade_m(height_m, 0.5).is_finite());
                    prop_assert!(species.age_at_height_years(height_m, 0.5).is_finite());
                }
                prop_assert!(species.niche.vigor(5.0, 50.0, 10.0, 0.1).is_finite());
            }
        }

        #[test]
        fn random_digits_never_panic(at in 0..SMALL.len(), digits in "[-+0-9.eE_infa]{1,12}") {
            let mut text = SMALL.to_owned();
            let at = (at..text.len()).find(|&i| text.as_bytes()[i].is_ascii_digit()).unwrap_or(0);
            text.replace_range(at..=at, &digits);
            let _ = parse_biome(&text);
        }
    }
}
