//! Any text through the reader of a scene folder's manifest: a manifest that can be written and read again, or an error, never a panic.
#![no_main]
use libfuzzer_sys::fuzz_target;
use wildwood::scene::Manifest;

fuzz_target!(|text: &str| {
    if let Ok(manifest) = Manifest::parse(text) {
        let _ = manifest.scene.crs();
        let written = toml::to_string(&manifest).expect("a manifest is a TOML table");
        let again = Manifest::parse(&written).expect("reads what it wrote");
        assert_eq!(toml::to_string(&again).as_deref(), Ok(&written[..]));
    }
});
