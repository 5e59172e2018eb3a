//! The biome file: TOML text to checked values. Units stand in the keys; degrees, km and MPa end here.

use serde::Deserialize;

use super::biome::{Biome, BiomeError, ForestFloor, SubBiome};
use super::checks::{LawTable, Place, all_differ, count};
use super::climate::{Climate, Soil};
use super::niche::{Niche, Tolerance, Trapezoid};
use super::species::{
    Crown, CrownShape, Decay, DecayResistance, Form, GrowingSeason, Leaf, LeafHabit, Species, Stem, Wood,
};
use crate::raster::MONTHS;

/// Longest text read. chosen: the shipped files are 30 KB; a hundred times that is no biome.
const MAX_TEXT_BYTES: usize = 4 << 20;
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
    species: Vec<SpeciesTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ClimateFile {
    climate: ClimateTable,
    #[serde(default)]
    soil: SoilTable,
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
struct ClimateTable {
    latitude_deg: f64,
    station_altitude_m: f32,
    /// 6.5: standard lapse rate of both papers (PAPER_NOTES §3).
    lapse_rate_c_per_km: Option<f32>,
    temperature_c: Vec<f32>,
    clear_sky_fraction: Vec<f32>,
    rain_mm: Vec<f32>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct SoilTable {
    evaporated_rain_fraction: Option<f32>,
    infiltration_max_mm_per_month: Option<f32>,
    infiltration_full_slope_deg: Option<f32>,
    infiltration_none_slope_deg: Option<f32>,
    soil_capacity_mm: Option<f32>,
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
    let climate = climate(file.climate, file.soil)?;
    let forest_floor = forest_floor(file.forest_floor)?;
    // Names before what refers to them
    count("species", file.species.len(), MAX_SPECIES)?;
    count("sub_biomes", file.sub_biomes.len(), MAX_SUB_BIOMES)?;
    let sub_biome_keys: Vec<String> = file.sub_biomes.iter().map(|table| table.key.clone()).collect();
    all_differ("sub_biomes", &sub_biome_keys)?;
    let species_keys: Vec<String> = file.species.iter().map(|table| table.key.clone()).collect();
    all_differ("species", &species_keys)?;
    let mut species = Vec::with_capacity(file.species.len());
    for table in file.species {
        species.push(one_species(table, &sub_biome_keys)?);
    }
    let sub_biomes = sub_biomes(file.sub_biomes, &mut species, &species_keys)?;
    Ok(Biome { key: file.biome.key, name: file.biome.name, climate, sub_biomes, forest_floor, species })
}

/// A climate from TOML text.
pub(super) fn parse_climate(text: &str) -> Result<Climate, BiomeError> {
    let file: ClimateFile = parse(text)?;
    climate(file.climate, file.soil)
}

fn parse<T: for<'de> Deserialize<'de>>(text: &str) -> Result<T, BiomeError> {
    if text.len() > MAX_TEXT_BYTES {
        return Err(BiomeError::TooLarge { bytes: text.len(), limit: MAX_TEXT_BYTES });
    }
    toml::from_str(text).map_err(|error| BiomeError::Syntax { message: error.to_string() })
}

fn climate(table: ClimateTable, soil: SoilTable) -> Result<Climate, BiomeError> {
    let place = Place("climate".to_owned());
    if !(-90.0..=90.0).contains(&table.latitude_deg) {
        return Err(place.outside("latitude_deg", table.latitude_deg, -90.0, 90.0));
    }
    Ok(Climate {
        latitude_deg: table.latitude_deg,
        station_altitude_m: place.range("station_altitude_m", table.station_altitude_m, -500.0, 9000.0)?,
        temperature_c: place.months("temperature_c", &table.temperature_c, -80.0, 60.0)?,
        clear_sky_fraction: place.months("clear_sky_fraction", &table.clear_sky_fraction, 0.0, 1.0)?,
        rain_mm: place.months("rain_mm", &table.rain_mm, 0.0, 10_000.0)?,
        lapse_rate_c_per_m: place.range(
            "lapse_rate_c_per_km",
            table.lapse_rate_c_per_km.unwrap_or(6.5),
            0.0,
            15.0,
        )? / 1000.0,
        soil: self::soil(&soil)?,
    })
}

fn soil(table: &SoilTable) -> Result<Soil, BiomeError> {
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

fn forest_floor(table: ForestFloorTable) -> Result<ForestFloor, BiomeError> {
    let place = Place("forest_floor".to_owned());
    let trapezoid = |key: &str, t: TrapezoidTable, low, high| {
        let corners = [t.lowest, t.full_from, t.full_to, t.highest];
        for corner in corners {
            place.range(key, corner, low, high)?;
        }
        place.rising(key, &corners, false)?;
        Ok(Trapezoid { lowest: t.lowest, full_from: t.full_from, full_to: t.full_to, highest: t.highest })
    };
    Ok(ForestFloor {
        max_grass_height_m: place.range("max_grass_height_m", table.max_grass_height_m, 0.01, 5.0)?,
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
        place.key("key", &table.key)?;
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
        let members = (0..species.len()).filter(|&i| species[i].sub_biomes.contains(&index)).collect();
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
        if (1..=12).contains(&month) { Ok(month) } else { Err(place.outside(key, f64::from(month), 1.0, 12.0)) }
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
            ideal: place.range("niche.temperature_ideal_c", table.temperature_ideal_c, -40.0, 60.0)?,
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
    place.rising("crown.base_fraction_dense", &[base_fraction_isolated, base_fraction_dense], false)?;
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
        deathspan_years: place.range("decay.deathspan_years", table.deathspan_years, 0.5, 2000.0)?,
        log_seeding_multiplier: place.range(
            "decay.log_seeding_multiplier",
            table.log_seeding_multiplier,
            0.0,
            1000.0,
        )?,
        resistance: table.resistance,
    })
}
