//! Bits of the results: when they change, somebody meant it.
//!
//! A new hash belongs with `RESULTS_VERSION` raised in `src/pipeline/import.rs` (older scenes are then made anew)
//! and a line under "Results" in CHANGELOG.md: which numbers moved, how far, why.

use wildwood::abiotics;
use wildwood::progress::Reporter;
use wildwood::raster::MONTHS;
use wildwood::species::Biome;
use wildwood::terrain::generate::{self, GenerateParams};

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
