//! `wildwood demo`: a landscape of its own, its maps, its forest and what decades and a storm make of it.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::{Outcome, Shared, grow, import, terminal};
use crate::pipeline::age::{self, AgeRequest, Script};
use crate::pipeline::demo;
use crate::pipeline::import::DEFAULT_BIOME;
use crate::pipeline::import::DEFAULT_SEED;
use crate::pipeline::render::{self, RenderRequest, ViewRequest};
use crate::progress::Reporter;
use crate::terrain::generate::GenerateParams;

/// What `wildwood demo` takes.
#[derive(Args)]
pub struct DemoArguments {
    /// Scene folder to make.
    #[arg(long, short, value_name = "FOLDER", default_value = "demo-forest")]
    output: PathBuf,
    /// Biome whose climate and species the landscape gets: sonoma, pyrenees, or a file of your own (wildwood biome).
    #[arg(long, value_name = "NAME|FILE", default_value = DEFAULT_BIOME)]
    biome: String,
    /// Cells along a side; a cell is 2 m.
    #[arg(long, value_name = "CELLS", default_value_t = 512, value_parser = clap::value_parser!(u16).range(16..=8192))]
    size: u16,
    /// Years that the forest is aged by, with a storm five years before the end; 0 leaves it as it grew.
    #[arg(long, value_name = "YEARS", default_value_t = 60, value_parser = clap::value_parser!(u16).range(0..=1000))]
    age: u16,
    /// Draw no pictures of the forest (view.png, forest_floor.png).
    #[arg(long)]
    no_pictures: bool,
}

/// A gale from the west.
const STORM: &str = r#"
[[event]]
type = "wind-storm"
year = YEAR
month = 1
speed_m_s = 32
from_deg = 260
"#;
/// Picture from the air.
const OVERVIEW: &str = "view.png";
/// Picture from the forest floor.
const FOREST_FLOOR: &str = "forest_floor.png";
/// Years that the storm's downed logs lie at the end.
const YEARS_AFTER_STORM: u16 = 5;

pub fn run(arguments: &DemoArguments, shared: &Shared, reporter: &Reporter) -> Outcome {
    let size = usize::from(arguments.size);
    let params = GenerateParams {
        rows: size,
        cols: size,
        seed: shared.seed.unwrap_or(DEFAULT_SEED),
        ..GenerateParams::default()
    };
    let manifest = demo::run(arguments.output.clone(), &arguments.biome, &params, reporter)?;
    import::report(&arguments.output, &manifest, shared);
    grow::report_trees(&manifest, shared);
    if arguments.age > 0 {
        age(arguments, shared, reporter)?;
    }
    if arguments.no_pictures {
        return Ok(());
    }
    picture(&arguments.output, shared, reporter)
}

/// Lets years pass, with a storm near their end.
fn age(arguments: &DemoArguments, shared: &Shared, reporter: &Reporter) -> Outcome {
    let storm_year = arguments.age.saturating_sub(YEARS_AFTER_STORM).max(1);
    let request = AgeRequest {
        events: Script::Text(STORM.replace("YEAR", &storm_year.to_string())),
        ..AgeRequest::new(arguments.output.clone(), arguments.age)
    };
    let (manifest, folder) = age::run(&request, reporter)?;
    super::age::report(&folder, &manifest, shared);
    Ok(())
}

/// Draws the forest from the air and from its floor, and says what to open next.
fn picture(folder: &Path, shared: &Shared, reporter: &Reporter) -> Outcome {
    let views = [(ViewRequest::Overview, OVERVIEW), (ViewRequest::ForestFloor, FOREST_FLOOR)];
    let mut pictures = Vec::new();
    for (view, file) in views {
        let request = RenderRequest::new(folder.to_path_buf(), folder.join(file), view);
        pictures.extend(render::run(&request, reporter)?.files);
    }
    if shared.json {
        terminal::line(&json!({ "event": "pictures", "files": pictures }));
    } else if !shared.quiet {
        let folder = folder.display();
        terminal::say(&format!("look at {folder}/{OVERVIEW} and {folder}/{FOREST_FLOOR}, then"));
        terminal::say(&format!("  wildwood export {folder} -o demo.gpkg     # for QGIS"));
        terminal::say(&format!("  wildwood export {folder} -o demo.usda     # for Blender"));
        terminal::say(&format!(
            "  wildwood validate {folder}                # a report on the forest"
        ));
    }
    Ok(())
}
