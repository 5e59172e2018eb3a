//! `wildwood statistics`: what undergrowth is synthesised from.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::{Outcome, Shared, terminal};
use crate::pipeline::import::DEFAULT_BIOME;
use crate::pipeline::statistics::{self, StatisticsRequest};
use crate::progress::Reporter;

/// What `wildwood statistics` takes.
#[derive(Args)]
pub struct StatisticsArguments {
    /// Biome whose undergrowth is simulated: sonoma, pyrenees, or a file of your own (wildwood biome).
    #[arg(long, value_name = "NAME|FILE", default_value = DEFAULT_BIOME)]
    biome: String,
    /// File to write, for --undergrowth-statistics.
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    /// Folder that keeps plots once they are simulated, so that a run that was stopped goes on [default: FILE.plots].
    #[arg(long, value_name = "FOLDER")]
    work: Option<PathBuf>,
    /// Years that each plot is simulated.
    #[arg(long, default_value_t = 200)]
    years: u16,
}

pub fn run(arguments: &StatisticsArguments, shared: &Shared, reporter: &Reporter) -> Outcome {
    let output = arguments.output.clone();
    let beside = || {
        let mut name = output.clone().into_os_string();
        name.push(".plots");
        PathBuf::from(name)
    };
    let work = arguments.work.clone().unwrap_or_else(beside);
    let mut request = StatisticsRequest::new(&arguments.biome, output.clone(), work);
    request.years = arguments.years;
    request.seed = shared.seed.unwrap_or(request.seed);
    let made = statistics::run(&request, reporter)?;
    let (clusters, plants) = (made.clusters.len(), made.source.plants);
    if shared.json {
        terminal::line(&json!({
            "file": output, "clusters": clusters, "plots": made.source.plots, "plants": plants,
        }));
    } else if !shared.quiet {
        terminal::say(&format!(
            "{}: {clusters} clusters from {} plots and {plants} plants",
            output.display(),
            made.source.plots
        ));
    }
    Ok(())
}
