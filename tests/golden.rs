//! Bits of the results: when they change, somebody meant it.
//!
//! A new hash belongs with `RESULTS_VERSION` raised in `src/pipeline/import.rs` (older scenes are then made anew)
//! and a line under "Results" in CHANGELOG.md: which numbers moved, how far, why.

use wildwood::canopy::shares::Shares;
use wildwood::canopy::site::Site;
use wildwood::gpu::GpuChoice;
use wildwood::pipeline::grow::{self, CanopyInput, CanopyRequest};
use wildwood::progress::Reporter;
use wildwood::raster::MONTHS;
use wildwood::species::Biome;
use wildwood::terrain::generate::{self, GenerateParams};
use wildwood::{abiotics, canopy};

fn hash<'a>(values: impl IntoIterator<Item = &'a f32>) -> String {
    let bytes: Vec<u8> = values.into_iter().flat_map(|v| v.to_bits().to_le_bytes()).collect();
    blake3::hash(&bytes).to_hex()[..16].to_owned()
}

#[test]
fn terrain_and_maps_keep_their_bits() {
    let reporter = Reporter::silent();
    let params = GenerateParams { rows: 96, cols: 128, seed: 3, ..GenerateParams::default() };
    let terrain = generate::generate(&params, &reporter).unwrap();
    let climate = Biome::builtin("sonoma").unwrap().climate;
    let maps = abiotics::run(&terrain, &climate, &abiotics::Params::default(), &reporter).unwrap();
    let found = [
        ("terrain", hash(terrain.elevation_m.values())),
        ("slope", hash(maps.slope_rad.values())),
        ("sunlight", hash((0..MONTHS).flat_map(|m| maps.sunlight_h.month(m)))),
        ("moisture", hash((0..MONTHS).flat_map(|m| maps.moisture_mm.month(m)))),
        ("discharge", hash(maps.discharge_m3_s.values())),
    ];
    let expected = [
        ("terrain", "79627d04a4497312"),
        ("slope", "6904f09b1629f437"),
        ("sunlight", "581e87c86978cb4e"),
        ("moisture", "83f725849f904dd3"),
        ("discharge", "50b6e69d477f61bf"),
    ];
    let expected = expected.map(|(name, hash)| (name, hash.to_owned()));
    assert_eq!(found, expected);
}

#[test]
fn trees_keep_their_bits() {
    let reporter = Reporter::silent();
    let params = GenerateParams { rows: 128, cols: 128, seed: 3, ..GenerateParams::default() };
    let terrain = generate::generate(&params, &reporter).unwrap();
    let biome = Biome::builtin("sonoma").unwrap();
    let params = abiotics::Params::default();
    let maps = abiotics::run(&terrain, &biome.climate, &params, &reporter).unwrap();
    let site = Site::of(&maps);
    let params = canopy::generate::GenerateParams::default();
    let chm_m = canopy::generate::generate(&terrain, &site, &params, &reporter).unwrap();
    let input = CanopyInput {
        terrain: &terrain,
        site: &site,
        chm_m: &chm_m,
        learned: None,
        allowed: terrain.elevation_m.mask(),
        biome: &biome,
        brush: None,
    };
    let shares = Shares::parse("redwood=0.4,coast-live-oak=0.3", &biome).unwrap();
    let request = CanopyRequest { gpu: GpuChoice::Off, ..CanopyRequest::default() };
    let grown = grow::grow(&input, shares, 1, &request, &reporter).unwrap();
    let plants = &grown.plants;
    let species: Vec<f32> = plants.species.iter().map(|s| f32::from(*s)).collect();
    let found = [
        ("canopy height", hash(chm_m.values())),
        ("places", hash(plants.east_m.iter().chain(&plants.north_m).chain(&plants.z_m))),
        ("sizes", hash(plants.height_m.iter().chain(&plants.crown_radius_m).chain(&plants.dbh_m))),
        ("species", hash(&species)),
    ];
    let expected = [
        ("canopy height", "0f4aa3c1562bbb21"),
        ("places", "fcbdc99f46d797dd"),
        ("sizes", "b8dfa50416c368cd"),
        ("species", "b8224e9be0424e94"),
    ];
    let expected = expected.map(|(name, hash)| (name, hash.to_owned()));
    assert_eq!((plants.len(), found), (1832, expected));
}
