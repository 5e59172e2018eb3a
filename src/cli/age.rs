//! `wildwood age`: centuries of growth, disturbance, death and decay.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::{Outcome, Shared, terminal};
use crate::pipeline::age::{self, AgeRequest, GrowthOf, Script};
use crate::progress::Reporter;
use crate::scene::Manifest;

/// What `wildwood age` takes.
#[derive(Args)]
pub struct AgeArguments {
    /// Scene folder, from wildwood import or wildwood grow.
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// Years from the start of the forest's simulation; more than before go on from there.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=i64::from(age::MOST_YEARS)))]
    years: u16,
    /// Script of fires, storms, diseases and droughts (TOML, or the text of Peytavie's program); see README.
    #[arg(long, value_name = "FILE")]
    events: Option<PathBuf>,
    /// Scene folder for the aged forest, made as a copy [default: the scene folder itself].
    #[arg(long, short, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Begin from bare ground, whatever grows there; a scene without plants does anyway.
    #[arg(long)]
    bare: bool,
    /// Years between checkpoints, from which a run that was stopped goes on.
    #[arg(long, value_name = "YEARS", default_value_t = 25)]
    checkpoint: u16,
    /// Record the yearly growth of plants in growth.parquet: their ids, or full for all that are 1.3 m high.
    #[arg(long, value_name = "full|ID,ID,…", value_parser = growth_of)]
    history: Option<GrowthOf>,
}

fn growth_of(text: &str) -> Result<GrowthOf, String> {
    if text == "full" {
        return Ok(GrowthOf::All);
    }
    let ids = text.split(',').map(|id| id.trim().parse::<u64>());
    let ids: Result<Vec<u64>, _> = ids.collect();
    ids.map(GrowthOf::Plants).map_err(|_| "give full, or ids of plants as 12,15,99".to_owned())
}

pub fn run(arguments: &AgeArguments, shared: &Shared, reporter: &Reporter) -> Outcome {
    let request = AgeRequest {
        output: arguments.output.clone(),
        is_bare: arguments.bare,
        events: arguments.events.clone().map_or(Script::None, Script::File),
        seed: shared.seed,
        checkpoint_years: arguments.checkpoint,
        growth_of: arguments.history.clone().unwrap_or_default(),
        ..AgeRequest::new(arguments.folder.clone(), arguments.years)
    };
    let (manifest, folder) = age::run(&request, reporter)?;
    report(&folder, &manifest, shared);
    Ok(())
}

/// Says what the forest has become.
pub fn report(folder: &Path, manifest: &Manifest, shared: &Shared) {
    let Some(stage) = manifest.stages.get(age::STAGE) else { return };
    let figures = &stage.figures;
    if shared.json {
        terminal::line(&json!({
            "event": "done",
            "folder": folder.display().to_string(),
            "figures": figures,
        }));
        return;
    }
    if shared.quiet {
        return;
    }
    let whole = |key: &str| figures.get(key).and_then(toml::Value::as_integer).unwrap_or(0);
    let real = |key: &str| figures.get(key).and_then(toml::Value::as_float).unwrap_or(0.0);
    terminal::say(&format!(
        "{}: {} years; {} plants, {} of them canopy trees, {:.1} m²/ha; {} snags, {:.1} m²/ha; {} downed logs, {:.1} m²/ha",
        folder.display(),
        whole("years"),
        whole("plants"),
        whole("trees"),
        real("live_basal_area_m2_ha"),
        whole("snags"),
        real("snag_basal_area_m2_ha"),
        whole("downed_logs"),
        real("downed_log_basal_area_m2_ha"),
    ));
    let burnt = figures.get("burnt_ha").and_then(toml::Value::as_array);
    let burnt: Vec<String> = burnt
        .into_iter()
        .flatten()
        .filter_map(toml::Value::as_float)
        .map(|ha| format!("{ha:.1}"))
        .collect();
    if !burnt.is_empty() {
        terminal::say(&format!("fires burnt {} ha", burnt.join(", ")));
    }
    let look = |file: &str| folder.join(file).display().to_string();
    terminal::say(&format!("look at {} and {}", look("preview.png"), look("timeline.png")));
}
