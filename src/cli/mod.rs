//! The command line: parse, call [`crate::pipeline`], report. One file a subcommand.
//!
//! Exit codes: 0 done, 1 the machine failed or the run was cancelled, 2 bad input or usage.

mod age;
mod bench;
mod bench_forest;
mod biome;
mod demo;
mod doctor;
mod export;
mod grow;
mod import;
mod render;
mod statistics;
mod terminal;
mod validate;

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{Args, Parser, Subcommand};

use crate::gpu;
use crate::io::las;
use crate::pipeline;
use crate::progress::Reporter;
use crate::raster::MapWindow;

/// Grows whole forests, living and dead, on real terrain.
#[derive(Parser)]
#[command(name = "wildwood", version, arg_required_else_help = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    shared: Shared,
}

/// What every subcommand takes.
#[derive(Args)]
struct Shared {
    /// Print JSON lines on standard output instead of text.
    #[arg(long, global = true)]
    json: bool,
    /// Say nothing but errors (and, with --json, the result).
    #[arg(long, short, global = true)]
    quiet: bool,
    /// Threads to work with; results never depend on it [default: all cores].
    #[arg(long, global = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Seed of everything random: same seed, same bits [default: the scene folder's, else 1].
    #[arg(long, global = true)]
    seed: Option<u64>,
}

/// `--bbox` of commands that take a part of a scene.
#[derive(Args)]
struct ScenePart {
    /// Part of the scene, in map coordinates; what stands on its east or north edge is the next box's.
    #[arg(
        long,
        value_name = "WEST,SOUTH,EAST,NORTH",
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true
    )]
    bbox: Option<Vec<f64>>,
}

impl ScenePart {
    /// The part that is asked for; none is the whole scene.
    fn window(&self) -> Result<Option<MapWindow>, pipeline::Error> {
        self.bbox.as_deref().map(import::window).transpose()
    }
}

#[derive(Subcommand)]
enum Command {
    /// Make a small landscape of its own and picture it.
    Demo(demo::DemoArguments),
    /// Turn terrain rasters or point clouds into a scene: terrain and abiotic maps.
    Import(import::ImportArguments),
    /// Grow a forest on terrain: canopy trees from a sketch by trained networks, a measured canopy height model or a point cloud,
    /// then undergrowth, grass and litter beneath them.
    Grow(Box<grow::GrowArguments>),
    /// Age a scene's forest by centuries: growth, seeding, fire, storm, disease, drought, death and decay leave snags and downed
    /// logs.
    Age(age::AgeArguments),
    /// Write a scene, or a part of it, in the formats of GIS, 3D and forest programs.
    Export(Box<export::ExportArguments>),
    /// Draw pictures of a scene in sun, shade and haze: from the air, from the forest floor, as a section or from above.
    Render(Box<render::RenderArguments>),
    /// List a biome's species and check its file, or write a built-in one to start your own from.
    Biome(biome::BiomeArguments),
    /// Simulate a biome's undergrowth on made-up plots and write the statistics that grow synthesises it from (some minutes).
    Statistics(statistics::StatisticsArguments),
    /// Measure simulation and synthesis of undergrowth, and of deadwood, beside what ecology and the papers say (half a minute).
    Validate(validate::ValidateArguments),
    /// Run standard workloads, one JSON line each.
    Bench(bench::BenchArguments),
    /// Say what was found on this machine.
    Doctor,
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    let default_hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if !las::is_caught_panic(info) && !gpu::is_caught_panic(info) {
            default_hook(info);
        }
    }));
    let arguments = Arguments::parse();
    let shared = &arguments.shared;
    if let Some(threads) = shared.threads {
        // fails only if a pool exists already, and none does this early
        let _ = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads)).build_global();
    }
    let cancelled = Arc::new(AtomicBool::new(false));
    let on_interrupt = Arc::clone(&cancelled);
    // without a handler Ctrl-C still ends the process; it only leaves a partial folder to clean up
    let _ = ctrlc::set_handler(move || {
        // whoever asks twice does not want to wait for the next check
        if on_interrupt.swap(true, Ordering::Relaxed) {
            std::process::exit(1);
        }
    });
    let reporter = Reporter::new(terminal::sink(shared.json, shared.quiet), cancelled);
    let done = match &arguments.command {
        Command::Demo(arguments) => demo::run(arguments, shared, &reporter),
        Command::Import(arguments) => import::run(arguments, shared, &reporter),
        Command::Grow(arguments) => grow::run(arguments, shared, &reporter),
        Command::Age(arguments) => age::run(arguments, shared, &reporter),
        Command::Export(arguments) => export::run(arguments, shared, &reporter),
        Command::Render(arguments) => render::run(arguments, shared, &reporter),
        Command::Biome(arguments) => biome::run(arguments, shared),
        Command::Statistics(arguments) => statistics::run(arguments, shared, &reporter),
        Command::Validate(arguments) => validate::run(arguments, shared, &reporter),
        Command::Bench(arguments) => bench::run(arguments, &reporter),
        Command::Doctor => doctor::run(shared.json),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let code = if error.is_bad_input() { 2 } else { 1 };
            terminal::fail(shared.json, &error, code);
            ExitCode::from(code)
        }
    }
}

type Outcome = Result<(), pipeline::Error>;
