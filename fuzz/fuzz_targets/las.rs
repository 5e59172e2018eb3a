//! Any bytes through the LAS, LAZ and COPC reader: a cloud or an error, never a panic.
#![no_main]
use std::io::Cursor;

use libfuzzer_sys::fuzz_target;
use wildwood::io::{Limits, las};

fuzz_target!(|bytes: &[u8]| {
    let limits = Limits { max_cells: 4_000_000, max_points: 1_000_000 };
    let _ = las::parse(Cursor::new(bytes), bytes.len() as u64, None, &limits);
});
