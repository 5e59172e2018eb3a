//! `wildwood doctor`: what was found on this machine.

use serde_json::json;

use super::{Outcome, terminal};

pub fn run(json: bool) -> Outcome {
    let threads = rayon::current_num_threads();
    let gdal = cfg!(feature = "gdal");
    if json {
        terminal::line(&json!({
            "version": env!("CARGO_PKG_VERSION"), "threads": threads, "gdal": gdal,
            "biomes": crate::species::Biome::BUILTIN_NAMES,
        }));
    } else {
        terminal::say(&format!("wildwood   {}", env!("CARGO_PKG_VERSION")));
        terminal::say(&format!("threads    {threads}"));
        terminal::say(&format!("biomes     {}", crate::species::Biome::BUILTIN_NAMES.join(", ")));
        let gdal =
            if gdal { "built in" } else { "not built in (cargo build --release --features gdal)" };
        terminal::say(&format!("GDAL       {gdal}"));
    }
    Ok(())
}
