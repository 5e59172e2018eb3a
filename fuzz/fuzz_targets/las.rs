//! Any bytes through the LAS, LAZ and COPC reader: a cloud or an error, never a panic.
//!
//! Damaged bits inside a chunk make the `laz` crate panic; the reader catches that and gives an error.
//! Every other panic ends the run.
#![no_main]
use std::io::Cursor;
use std::panic;

use libfuzzer_sys::fuzz_target;
use wildwood::io::{Limits, las};

fuzz_target!(
    init: {
        let fatal = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !las::is_caught_panic(info) {
                fatal(info);
            }
        }));
    },
    |bytes: &[u8]| {
        let limits = Limits { max_cells: 4_000_000, max_points: 1_000_000 };
        let _ = las::parse(Cursor::new(bytes), bytes.len() as u64, None, &limits);
    }
);
