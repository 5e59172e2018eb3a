//! `wildwood demo`: a landscape of its own, its maps, its trees and its picture.

use std::path::PathBuf;

use clap::Args;

use super::{Outcome, Shared, grow, import};
use crate::pipeline::demo;
use crate::pipeline::import::DEFAULT_BIOME;
use crate::pipeline::import::DEFAULT_SEED;
use crate::progress::Reporter;
use crate::terrain::generate::GenerateParams;

/// What `wildwood demo` takes.
#[derive(Args)]
pub struct DemoArguments {
    /// Scene folder to make.
    #[arg(long, short, value_name = "FOLDER", default_value = "demo-forest")]
    output: PathBuf,
    /// Biome whose climate the landscape gets: sonoma, pyrenees.
    #[arg(long, default_value = DEFAULT_BIOME)]
    biome: String,
    /// Cells along a side; a cell is 2 m.
    #[arg(long, value_name = "CELLS", default_value_t = 512, value_parser = clap::value_parser!(u16).range(16..=8192))]
    size: u16,
}

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
    Ok(())
}
