//! `wildwood bench`: standard workloads, one JSON line each.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::{Outcome, bench_forest, terminal};
use crate::canopy::learned::coarse::CoarseCells;
use crate::canopy::learned::generator::{self, CoarseGround, Generators};
use crate::canopy::learned::sketch::Density;
use crate::canopy::learned::stand_height;
use crate::canopy::shares::Shares;
use crate::canopy::site::Site;
use crate::gpu::GpuChoice;
use crate::inference::{ModelSource, RuntimeChoice, TileLayout};
use crate::pipeline::grow::{self, CanopyInput, CanopyRequest};
use crate::pipeline::{Error, import};
use crate::plants::Plants;
use crate::progress::{Reporter, peak_memory_mib, reset_peak_memory};
use crate::raster::{Grid, MONTHS};
use crate::simulation::forest::Forest;
use crate::simulation::{CellWindow, Community, Parameters, Plot};
use crate::species::Biome;
use crate::terrain::Terrain;
use crate::terrain::generate::{self as landscape, GenerateParams};
use crate::terrain::point_cloud::synthetic;
use crate::undergrowth::{Conditions, Statistics, Synthesis, Trees, refinement, sampling};
use crate::{abiotics, canopy};

/// What `wildwood bench` takes.
#[derive(Args)]
pub struct BenchArguments {
    /// Workload to run [default: all, each in a process of its own so that peak memory is its own].
    workload: Option<Workload>,
    /// Times each workload is run; the line gives the fastest and the median.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=100))]
    repeat: u16,
    /// Terrain tile for `import-dem` and the forests of `age-*` instead of a generated one.
    #[arg(long)]
    dem: Option<PathBuf>,
    /// Point cloud for `import-laz` instead of a generated one.
    #[arg(long)]
    laz: Option<PathBuf>,
    /// Program that runs the networks of `learned-1km` and `learned-10km`.
    #[arg(long, value_name = "auto|rten|ort", default_value_t)]
    onnx: RuntimeChoice,
}

#[derive(Clone, Copy, ValueEnum)]
enum Workload {
    #[value(name = "abiotics-512")]
    Abiotics512,
    #[value(name = "abiotics-1024")]
    Abiotics1024,
    #[value(name = "abiotics-2048")]
    Abiotics2048,
    #[value(name = "abiotics-4096")]
    Abiotics4096,
    /// Species map and placement of about 70,000 trees (Kapp 2020, Table 1).
    #[value(name = "canopy-1024")]
    Canopy1024,
    /// The same of about 357,000 trees.
    #[value(name = "canopy-2048")]
    Canopy2048,
    /// The same of about 745,000 trees.
    #[value(name = "canopy-3072")]
    Canopy3072,
    /// Sketch to footprint to canopy height by both networks, 1 km² at 4 m.
    #[value(name = "learned-1km")]
    Learned1Km,
    /// The same, 10 × 10 km.
    #[value(name = "learned-10km")]
    Learned10Km,
    /// A year of undergrowth, 256 × 256 m in cells of 20 cm under a closed canopy, once it is dense.
    #[value(name = "simulation-256")]
    Simulation256,
    /// A year of a whole forest on 512 × 512 m in cells of 50 cm, young and dense (Peytavie 2024, Table 4); --dem takes Gresolet.
    #[value(name = "age-512-young")]
    Age512Young,
    /// The same after three centuries.
    #[value(name = "age-512")]
    Age512,
    /// Four of them beside each other, about 1 km².
    #[value(name = "age-1km")]
    Age1Km,
    /// Sixteen of them, about 4 km².
    #[value(name = "age-2km")]
    Age2Km,
    /// Undergrowth of 1 km² at 1 m under a generated canopy (Kapp 2020, Table 1: 499,000 plants).
    #[value(name = "undergrowth-1km")]
    Undergrowth1Km,
    /// The same, 3 × 3 km (Table 1: 4.6 million plants).
    #[value(name = "undergrowth-3km")]
    Undergrowth3Km,
    /// Refinement of 256 × 256 m of it, until it converges.
    #[value(name = "refinement-256")]
    Refinement256,
    /// 1 km² at 1 m: file to terrain, and file to whole scene folder.
    ImportDem,
    /// 4 million points over 1 km²: file to terrain and canopy, and file to whole scene folder.
    ImportLaz,
}

/// Side and density of the generated cloud of `import-laz`: 4 million points over 1 km².
const CLOUD_SIDE_M: f64 = 1000.0;
const CLOUD_POINTS_PER_M2: f64 = 4.0;

pub fn run(arguments: &BenchArguments, reporter: &Reporter) -> Outcome {
    let Some(workload) = arguments.workload else {
        return run_all(arguments, reporter);
    };
    let name = workload.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned());
    let folder = tempfile::tempdir().map_err(|source| failed("temporary folder", source))?;
    let prepared = prepare(workload, arguments, folder.path(), reporter)?;
    let mut runs = Vec::new();
    for _ in 0..arguments.repeat {
        runs.push(match &prepared {
            Prepared::Terrain(terrain) => abiotic_maps(terrain, reporter)?,
            Prepared::Canopy(canopy) => canopy_trees(canopy, reporter)?,
            Prepared::Ground(ground) => learned(ground, arguments.onnx, reporter)?,
            Prepared::Community(community) => simulated_year(community),
            Prepared::Forest(forest) => bench_forest::year(forest),
            Prepared::Undergrowth(canopy, refines) => undergrowth(canopy, *refines, reporter)?,
            Prepared::File(input) => whole_import(input, folder.path(), reporter)?,
        });
    }
    runs.sort_by(|a, b| seconds(a).total_cmp(&seconds(b)));
    let median = &runs[runs.len() / 2];
    terminal::line(&json!({
        "workload": name,
        "threads": rayon::current_num_threads(),
        "runs": runs.len(),
        "fastest_s": seconds(&runs[0]),
        "median": median,
        "peak_memory_mib": peak_memory_mib(),
    }));
    Ok(())
}

/// What a workload works on; its making is not counted.
enum Prepared {
    Terrain(Terrain),
    Canopy(Box<PreparedCanopy>),
    Ground(Terrain),
    Community(Box<Community>),
    Forest(Box<Forest>),
    /// A canopy, and whether what grows beneath it is refined.
    Undergrowth(Box<GrownGround>, bool),
    File(PathBuf),
}

/// A canopy height model, and what trees need to know of its place.
struct PreparedCanopy {
    terrain: Terrain,
    site: Site,
    chm_m: Grid<f32>,
    biome: Biome,
}

/// Cell width of Kapp 2020, Table 1.
const KAPP_CELL_M: f64 = 0.914;

impl PreparedCanopy {
    fn new(
        size: usize,
        trees_per_ha: f32,
        stand_height_m: f32,
        biome: Biome,
        reporter: &Reporter,
    ) -> Result<Self, Error> {
        let reporter = reporter.silenced();
        let params = GenerateParams {
            rows: size,
            cols: size,
            cell_m: KAPP_CELL_M,
            ..GenerateParams::default()
        };
        let terrain = landscape::generate(&params, &reporter)?;
        let params = abiotics::Params::default();
        let maps = abiotics::run(&terrain, &biome.climate, &params, &reporter)?;
        let site = Site::of(&maps);
        // low stands: crowns of Sonoma's species as tall as the generator's are wider than Table 1 leaves room for
        let canopy = canopy::generate::GenerateParams {
            stand_height_m,
            ..canopy::generate::GenerateParams::dense(trees_per_ha)
        };
        let chm_m = canopy::generate::generate(&terrain, &site, &canopy, &reporter)?;
        Ok(Self { terrain, site, chm_m, biome })
    }
}

/// Species map and placement on the CPU.
fn canopy_trees(prepared: &PreparedCanopy, reporter: &Reporter) -> Result<Value, Error> {
    let PreparedCanopy { terrain, site, chm_m, biome } = prepared;
    let input = CanopyInput::made_up(terrain, site, chm_m, biome);
    let request = CanopyRequest { gpu: GpuChoice::Off, ..CanopyRequest::default() };
    let reporter = reporter.silenced();
    reset_peak_memory();
    let started = Instant::now();
    let grown = grow::grow(&input, Shares::default(), 1, &request, &reporter)?;
    let seconds = started.elapsed().as_secs_f64();
    let cells = chm_m.frame().len();
    Ok(json!({
        "seconds": seconds, "cells": cells, "ns_per_cell": seconds * 1e9 / cells as f64,
        "trees": grown.plants.len(), "fit": grown.quality,
        "peak_bytes_per_cell": peak_memory_mib().map(|mib| mib * 1_048_576.0 / cells as f64),
        "stages_s": stages(&reporter),
    }))
}

/// Ground under a canopy of grown trees.
struct GrownGround {
    site: Site,
    trees: Plants,
    biome: Biome,
    statistics: Statistics,
}

impl GrownGround {
    fn new(size: usize, reporter: &Reporter) -> Result<Self, Error> {
        let reporter = reporter.silenced();
        let params =
            GenerateParams { rows: size, cols: size, cell_m: 1.0, ..GenerateParams::default() };
        let terrain = landscape::generate(&params, &reporter)?;
        let biome = Biome::builtin(import::DEFAULT_BIOME)?;
        let maps =
            abiotics::run(&terrain, &biome.climate, &abiotics::Params::default(), &reporter)?;
        let site = Site::of(&maps);
        let canopy = canopy::generate::GenerateParams::default();
        let chm_m = canopy::generate::generate(&terrain, &site, &canopy, &reporter)?;
        let input = CanopyInput::made_up(&terrain, &site, &chm_m, &biome);
        let request = CanopyRequest { gpu: GpuChoice::Off, ..CanopyRequest::default() };
        let trees = grow::grow(&input, Shares::default(), 1, &request, &reporter)?.plants;
        let statistics = Statistics::builtin(&biome)
            .map_err(|e| Error::Failed { what: format!("built-in statistics: {e}") })?;
        Ok(Self { site, trees, biome, statistics })
    }
}

/// Conditions under the canopy and the plants they give; then their refinement, if that is what is timed.
fn undergrowth(ground: &GrownGround, refines: bool, reporter: &Reporter) -> Result<Value, Error> {
    let GrownGround { site, trees, biome, statistics } = ground;
    let (reporter, frame) = (reporter.silenced(), site.slope_rad.frame());
    let allowed = site.slope_rad.mask();
    reset_peak_memory();
    let started = Instant::now();
    let conditions = Conditions::under(trees, site, biome, &Parameters::undergrowth(biome));
    let trees = Trees::of(trees, frame.rows as f32 * frame.cell_m());
    let synthesis =
        Synthesis { conditions: &conditions, allowed, trees: &trees, statistics, biome, seed: 1 };
    let mut grown = sampling::sample(&synthesis, &reporter)?;
    let seconds = started.elapsed().as_secs_f64();
    let (plants, canopy) = (grown.disks.len(), trees.disks.len());
    if !refines {
        let ns_per_plant = seconds * 1e9 / plants as f64;
        return Ok(json!({
            "seconds": seconds, "plants": plants, "canopy_trees": canopy,
            "ns_per_plant": ns_per_plant,
        }));
    }
    let started = Instant::now();
    let figures = refinement::refine(&mut grown, &synthesis, None, &reporter)?;
    let seconds = started.elapsed().as_secs_f64();
    let sweeps = figures.differences.len() - 1;
    Ok(json!({
        "seconds": seconds, "plants": plants, "sweeps": sweeps,
        "ms_per_plant_and_sweep": seconds * 1e3 / (plants * sweeps.max(1)) as f64,
        "pair_differences": figures.differences,
    }))
}

/// Both networks and all around them, on stripes of every density; opening them is counted too.
fn learned(terrain: &Terrain, onnx: RuntimeChoice, reporter: &Reporter) -> Result<Value, Error> {
    let reporter = reporter.silenced();
    let runtimes = super::grow::runtimes(onnx, None);
    reset_peak_memory();
    let started = Instant::now();
    let generators = Generators::open(&ModelSource::BuiltIn, &runtimes, |_| ())?;
    let elevation_m = terrain.elevation_m.clone();
    let cells = CoarseCells::of(elevation_m.frame());
    let stand_m = stand_height::around(stand_height::DEFAULT_M, &cells, 1);
    let count = cells.frame.len();
    let density = |index: usize| Density::ALL[(index % cells.frame.cols) / 20 % 3];
    let densities = (0..count).map(density).collect();
    let sketch = generator::whole(&cells, Density::Empty).with_values(densities);
    let ground = CoarseGround::new(cells, elevation_m, vec![false; count], stand_m);
    let layout = TileLayout::default();
    let footprint = generators.footprint(&ground, &sketch, 1, layout, &reporter)?;
    generators.height_m(&ground, &footprint, 1, layout, &reporter)?;
    let seconds = started.elapsed().as_secs_f64();
    Ok(json!({
        "seconds": seconds, "cells": count, "ns_per_cell": seconds * 1e9 / count as f64,
        "runtime": generators.runtime_name(), "stages_s": stages(&reporter),
    }))
}

fn run_all(arguments: &BenchArguments, reporter: &Reporter) -> Outcome {
    let program = std::env::current_exe().map_err(|e| failed("own program", e))?;
    for workload in Workload::value_variants() {
        reporter.check_cancelled()?;
        let Some(value) = workload.to_possible_value() else { continue };
        let mut command = Command::new(&program);
        command.args(["bench", value.get_name(), "--repeat", &arguments.repeat.to_string()]);
        command.args(["--onnx", arguments.onnx.name()]);
        command.args(["--threads", &rayon::current_num_threads().to_string()]);
        for (flag, path) in [("--dem", &arguments.dem), ("--laz", &arguments.laz)] {
            if let Some(path) = path {
                command.arg(flag).arg(path);
            }
        }
        let status = command.status().map_err(|e| failed("bench", e))?;
        if !status.success() {
            return Err(Error::Failed { what: format!("workload {} failed", value.get_name()) });
        }
    }
    Ok(())
}

fn failed(what: &str, e: std::io::Error) -> Error {
    Error::Failed { what: format!("{what}: {e}") }
}

fn seconds(run: &Value) -> f64 {
    run["seconds"].as_f64().unwrap_or(f64::INFINITY)
}

fn prepare(
    workload: Workload,
    arguments: &BenchArguments,
    folder: &Path,
    reporter: &Reporter,
) -> Result<Prepared, Error> {
    let generated = |size: usize, cell_m: f64| {
        let params = GenerateParams { rows: size, cols: size, cell_m, ..GenerateParams::default() };
        landscape::generate(&params, &reporter.silenced())
    };
    let forest = |is_young: bool, side: usize| {
        let prepared = bench_forest::prepare(arguments.dem.as_ref(), is_young, side, reporter);
        Ok::<_, Error>(Prepared::Forest(prepared?.into()))
    };
    Ok(match workload {
        Workload::Abiotics512 => Prepared::Terrain(generated(512, 2.0)?),
        Workload::Abiotics1024 => Prepared::Terrain(generated(1024, 2.0)?),
        Workload::Abiotics2048 => Prepared::Terrain(generated(2048, 2.0)?),
        Workload::Abiotics4096 => Prepared::Terrain(generated(4096, 2.0)?),
        Workload::Canopy1024 => Prepared::Canopy(
            PreparedCanopy::new(1024, 799.0, 9.0, default_biome()?, reporter)?.into(),
        ),
        Workload::Canopy2048 => Prepared::Canopy(
            PreparedCanopy::new(2048, 1018.0, 7.2, default_biome()?, reporter)?.into(),
        ),
        Workload::Canopy3072 => Prepared::Canopy(
            PreparedCanopy::new(3072, 944.0, 7.5, default_biome()?, reporter)?.into(),
        ),
        Workload::Learned1Km => Prepared::Ground(generated(250, 4.0)?),
        Workload::Learned10Km => Prepared::Ground(generated(2500, 4.0)?),
        Workload::Simulation256 => Prepared::Community(dense_undergrowth(reporter)?.into()),
        Workload::Age512Young => forest(true, 1)?,
        Workload::Age512 => forest(false, 1)?,
        Workload::Age1Km => forest(false, 2)?,
        Workload::Age2Km => forest(false, 4)?,
        Workload::Undergrowth1Km => {
            Prepared::Undergrowth(GrownGround::new(1000, reporter)?.into(), false)
        }
        Workload::Undergrowth3Km => {
            Prepared::Undergrowth(GrownGround::new(3000, reporter)?.into(), false)
        }
        Workload::Refinement256 => {
            Prepared::Undergrowth(GrownGround::new(256, reporter)?.into(), true)
        }
        Workload::ImportLaz => Prepared::File(match &arguments.laz {
            Some(path) => path.clone(),
            None => {
                let path = folder.join("bench.laz");
                let cloud = synthetic::forest(1, CLOUD_SIDE_M, CLOUD_POINTS_PER_M2);
                crate::io::las::write_laz(&cloud, &path)?;
                path
            }
        }),
        Workload::ImportDem => Prepared::File(match &arguments.dem {
            Some(path) => path.clone(),
            None => {
                let scene = folder.join("dem");
                import::write_terrain_only(&generated(1000, 1.0)?, &scene)?;
                scene.join("terrain.tif")
            }
        }),
    })
}

fn default_biome() -> Result<Biome, Error> {
    Ok(Biome::builtin(import::DEFAULT_BIOME)?)
}

/// Years that undergrowth is given to become dense.
const DENSE_AFTER_YEARS: usize = 60;
/// Rain of the simulated plot, as a multiple of the biome's. chosen: half a million plants live on it, 8 a square metre, as
/// under the conifers of a wet real plot.
const WET_FRACTION: f32 = 3.0;

/// Undergrowth of a plot of 256 m under closed conifers, after some decades.
fn dense_undergrowth(reporter: &Reporter) -> Result<Community, Error> {
    let mut biome = default_biome()?;
    biome.climate = biome.climate.with_rain_scaled([WET_FRACTION; MONTHS]);
    let PreparedCanopy { terrain, site, chm_m, biome } =
        PreparedCanopy::new(280, 250.0, 16.0, biome, reporter)?;
    let input = CanopyInput::made_up(&terrain, &site, &chm_m, &biome);
    let request = CanopyRequest { gpu: GpuChoice::Off, ..CanopyRequest::default() };
    let reporter = reporter.silenced();
    let grown = grow::grow(&input, Shares::default(), 1, &request, &reporter)?;
    let maps = abiotics::run(&terrain, &biome.climate, &abiotics::Params::default(), &reporter)?;
    let parameters = Parameters::kapp2020();
    let plot = Plot::of(
        &maps,
        &grown.plants,
        &biome,
        &parameters,
        &CellWindow::all(maps.slope_rad.frame()),
    );
    let mut community = Community::new(plot, &biome, parameters, 1);
    for _ in 0..DENSE_AFTER_YEARS {
        reporter.check_cancelled()?;
        community.live_a_year();
    }
    Ok(community)
}

/// The year after, the same one each time.
fn simulated_year(community: &Community) -> Value {
    let mut community = community.clone();
    let started = Instant::now();
    let figures = community.live_a_year();
    let seconds = started.elapsed().as_secs_f64();
    let cells = community.plot().cells();
    json!({
        "seconds": seconds, "plants": figures.plants, "deaths": figures.deaths,
        "sprouted": figures.sprouted, "plant_months_per_s": 12.0 * figures.plants as f64 / seconds,
        "cells": cells,
        "bytes_per_plant": community.plant_bytes() as f64 / community.len() as f64,
        "bytes_per_cell": community.plot().bytes() as f64 / cells as f64,
    })
}

/// All four maps.
fn abiotic_maps(terrain: &Terrain, reporter: &Reporter) -> Result<Value, Error> {
    let climate = Biome::builtin(import::DEFAULT_BIOME)?.climate;
    let reporter = reporter.silenced();
    let started = Instant::now();
    let maps = abiotics::run(terrain, &climate, &abiotics::Params::default(), &reporter)?;
    let seconds = started.elapsed().as_secs_f64();
    let cells = maps.slope_rad.frame().len();
    let ns_per_cell = seconds * 1e9 / cells as f64;
    Ok(
        json!({"seconds": seconds, "cells": cells, "ns_per_cell": ns_per_cell, "stages_s": stages(&reporter)}),
    )
}

fn stages(reporter: &Reporter) -> Value {
    reporter
        .records()
        .iter()
        .map(|r| (r.stage.to_owned(), json!(r.seconds)))
        .collect::<serde_json::Map<_, _>>()
        .into()
}

fn whole_import(input: &Path, folder: &Path, reporter: &Reporter) -> Result<Value, Error> {
    let scene = folder.join("scene");
    let request = import::ImportRequest::new(vec![input.to_path_buf()], scene.clone());
    let started = Instant::now();
    let imported = import::read_terrain(&request, &reporter.silenced())?;
    let seconds = started.elapsed().as_secs_f64();
    let cells = imported.terrain.elevation_m.frame().len();
    drop(imported);
    let reporter = reporter.silenced();
    let started = Instant::now();
    import::run(&request, &reporter)?;
    let scene_s = started.elapsed().as_secs_f64();
    let _ = std::fs::remove_dir_all(&scene);
    Ok(
        json!({"seconds": seconds, "cells": cells, "scene_folder_s": scene_s, "stages_s": stages(&reporter)}),
    )
}
