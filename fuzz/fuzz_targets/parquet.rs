//! Any bytes through the readers of a scene's tables: rows within the scene, or an error, never a panic.
#![no_main]
use std::sync::{Arc, LazyLock};

use libfuzzer_sys::fuzz_target;
use wildwood::plants::{downed_logs_table, snags_table, table};
use wildwood::raster::Frame;
use wildwood::species::Biome;

const MOST_ROWS: usize = 100_000;

static BIOME: LazyLock<Biome> = LazyLock::new(|| Biome::builtin("sonoma").expect("a built-in biome"));

fuzz_target!(init: {
    // the reader turns panics of the parquet crate into errors: only those that it lets through end a run
    std::panic::set_hook(Box::new(|_| {}));
}, |bytes: &[u8]| {
    let frame = Frame::local(64, 64, 2.0);
    let source: Arc<[u8]> = bytes.into();
    if let Ok(plants) = table::read(Arc::clone(&source), &BIOME, &frame, MOST_ROWS) {
        assert!(plants.species.iter().all(|species| usize::from(*species) < BIOME.species.len()));
        assert!(plants.height_m.iter().all(|height_m| *height_m >= 0.0));
    }
    let _ = snags_table::read_snags(Arc::clone(&source), &BIOME, &frame, MOST_ROWS);
    let _ = downed_logs_table::read_downed_logs(source, &BIOME, &frame, MOST_ROWS);
});
