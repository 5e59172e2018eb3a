//! Any text through the biome and climate loaders: a biome or an error, never a panic.
#![no_main]
use libfuzzer_sys::fuzz_target;
use wildwood::species::{Biome, Climate};

fuzz_target!(|text: &str| {
    let _ = Biome::from_toml(text);
    let _ = Climate::from_toml(text);
});
