//! Any bytes through the .elv reader: a raster or an error, never a panic.
#![no_main]
use libfuzzer_sys::fuzz_target;
use wildwood::io::{Limits, elv};

fuzz_target!(|bytes: &[u8]| {
    let limits = Limits { max_cells: 4_000_000, max_points: 1_000_000 };
    let _ = elv::parse(bytes, None, &limits);
});
