//! Any bytes through the GeoTIFF reader: a raster or an error, never a panic.
#![no_main]
use libfuzzer_sys::fuzz_target;
use wildwood::io::{Limits, geotiff};

fuzz_target!(|bytes: &[u8]| {
    let limits = Limits { max_cells: 4_000_000, max_points: 1_000_000 };
    let _ = geotiff::parse(bytes, None, &limits);
});
