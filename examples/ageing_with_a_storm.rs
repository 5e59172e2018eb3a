//! A forest grows older, and a winter storm breaks and uproots its trees: what stands and lies dead before it and after.
//!
//! `cargo run --release --example ageing_with_a_storm [FOLDER] [YEARS] [CELLS]`
//!
//! FOLDER, `storm-forest` if not given, may be any scene with plants, such as one from `wildwood grow`. If there is
//! none, a generated landscape of CELLS × CELLS cells of 2 m is grown. The storm comes after YEARS years.

use std::error::Error;
use std::path::PathBuf;

use wildwood::export::render::figures::Colour;
use wildwood::export::render::world::Season;
use wildwood::export::selection::Filter;
use wildwood::gpu::GpuChoice;
use wildwood::pipeline::age::{self, AgeRequest, Script};
use wildwood::pipeline::demo;
use wildwood::pipeline::render::{self, RenderRequest, ViewRequest};
use wildwood::progress::Reporter;
use wildwood::scene::Manifest;
use wildwood::terrain::generate::GenerateParams;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "storm-forest".to_owned()));
    let years: u16 = arguments.next().as_deref().unwrap_or("40").parse()?;
    let cells: usize = arguments.next().as_deref().unwrap_or("96").parse()?;
    let reporter = Reporter::silent();

    // A forest to begin with.
    if Manifest::read(&folder)?.is_none() {
        let relief_m = 0.4 * cells as f32; // hills, not mountains
        let landscape = GenerateParams { rows: cells, cols: cells, relief_m, ..Default::default() };
        demo::run(folder.clone(), "sonoma", &landscape, &reporter)?;
    }

    // Decades of growth, seeding, competition and decay. The aged forest takes the place of the young one.
    let (before, _) = age::run(&AgeRequest::new(folder.clone(), years), &reporter)?;

    // The same decades, then a gale from the south-west and a year after it. A script that differs lets the forest begin
    // again from its start; equal seeds give equal years, so up to the storm nothing changes.
    let storm = format!(
        r#"
        [[event]]
        type = "wind-storm"
        year = {}
        month = 12
        speed_m_s = 34
        from_deg = 225
        "#,
        years.saturating_add(1)
    );
    let request = AgeRequest {
        events: Script::Text(storm), // or Script::File, see events.example.toml
        ..AgeRequest::new(folder.clone(), years.saturating_add(2))
    };
    let (after, folder) = age::run(&request, &reporter)?;

    println!("{:24} {:>12} {:>12}", "", "before", "a year after");
    for (name, key) in [
        ("trees", "trees"),
        ("snags", "snags"),
        ("downed logs", "downed_logs"),
        ("live, m²/ha", "live_basal_area_m2_ha"),
        ("downed logs, m²/ha", "downed_log_basal_area_m2_ha"),
    ] {
        println!("{name:24} {:>12} {:>12}", figure(&before, key)?, figure(&after, key)?);
    }

    // A picture from eye height, where there are tall trees and deadwood to see.
    let request = RenderRequest {
        output: folder.join("after_the_storm.png"),
        folder,
        view: ViewRequest::ForestFloor,
        size_px: [800, 500],
        finer: 1,                  // 2 to 4 for smoother edges
        filter: Filter::default(), // all of the scene
        season: Season::Summer,
        colour: Colour::Natural,
        sun_rad: None, // a summer morning's
        haze: 1.0,
        turntable: None,
        gpu: GpuChoice::Auto,
    };
    let rendered = render::run(&request, &reporter)?;
    println!("{}: {} plants, snags and downed logs", request.output.display(), rendered.instances);
    Ok(())
}

/// A figure that ageing recorded, as text.
fn figure(manifest: &Manifest, key: &str) -> Result<String, String> {
    let stage = manifest.stages.get(age::STAGE);
    match stage.and_then(|stage| stage.figures.get(key)) {
        Some(toml::Value::Float(value)) => Ok(format!("{value:.2}")),
        Some(value) => Ok(value.to_string()),
        None => Err(format!("scene.toml tells no {key}")),
    }
}
