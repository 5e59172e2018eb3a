//! Any bytes through the readers of GeoJSON and shapefiles: shapes or an error, never a panic.
#![no_main]
use libfuzzer_sys::fuzz_target;
use wildwood::io::{Limits, vector};

fuzz_target!(|bytes: &[u8]| {
    let limits = Limits { max_cells: 4_000_000, max_points: 1_000_000 };
    let _ = vector::parse_geojson(bytes, &limits);
    let _ = vector::parse_shapefile(bytes, None, &limits);
});
