//! `wildwood grow`: terrain and a painted or measured canopy become a forest.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::import::{self, TerrainArguments, Unit};
use super::{Outcome, Shared, terminal};
use crate::canopy::learned::sketch::Density;
use crate::export::close_up::area::{self, Area};
use crate::gpu::GpuChoice;
use crate::inference::{LibrarySearch, ModelSource, RuntimeChoice, Runtimes};
use crate::pipeline::age::{self, AgeRequest};
use crate::pipeline::close_up::PLANTS_FILE;
use crate::pipeline::grow::{self, CanopyRequest, GroundSource, GrowRequest, STAGE};
use crate::pipeline::learned_canopy::{LearnedRequest, PaintSource, StandHeight};
use crate::pipeline::undergrowth::{self, Refine, UndergrowthRequest};
use crate::pipeline::{Error, close_up};
use crate::plants::table::TableFormat;
use crate::progress::Reporter;
use crate::raster::{MapPoint, MapWindow};
use crate::scene::Manifest;

/// What `wildwood grow` takes.
#[derive(Args)]
pub struct GrowArguments {
    /// Terrain (GeoTIFF, COG, ESRI ASCII grid, .elv), a point cloud (LAS, LAZ, COPC), or a scene folder.
    #[arg(required = true, value_name = "DEM|LAZ|FOLDER")]
    inputs: Vec<PathBuf>,
    /// Scene folder to make or to bring up to date [default: the scene folder given].
    #[arg(long, short, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Measured canopy height model: a raster of heights above ground. Point clouds bring their own.
    #[arg(long, value_name = "RASTER")]
    chm: Option<PathBuf>,
    /// Painted density, from which trained networks make a canopy: a PNG stretched over the terrain (black empty, grey
    /// #808080 sparse, white dense; or #f4e7c5, #90ee90, #006400), or a raster of 0, 1, 2.
    #[arg(long, value_name = "PNG|RASTER", conflicts_with = "chm")]
    sketch: Option<PathBuf>,
    /// One density for all ground, in place of a sketch.
    #[arg(long, value_name = "sparse|dense", conflicts_with_all = ["chm", "sketch"], value_parser = density)]
    density: Option<Density>,
    /// Canopy's footprint in place of a sketch, such as a scene's footprint.tif edited: 1 (white) canopy, 0 (black) open.
    #[arg(long, value_name = "PNG|RASTER", conflicts_with_all = ["chm", "sketch", "density"])]
    footprint: Option<PathBuf>,
    /// Mean height of the canopy's stands in metres, or a raster of it [default: the metres that
    /// the scene's canopy was last painted with, else 16].
    #[arg(long, value_name = "METRES|RASTER", allow_negative_numbers = true)]
    stand_height: Option<String>,
    /// Program that runs the networks: auto takes ONNX Runtime where its library is found, else the built-in one
    /// [default: auto].
    #[arg(long, value_name = "auto|rten|ort")]
    onnx: Option<RuntimeChoice>,
    /// ONNX Runtime's library.
    #[arg(long, value_name = "FILE")]
    ort_lib: Option<PathBuf>,
    /// Folder with networks of your own: footprint.onnx, height.onnx and their cards.
    #[arg(long, value_name = "FOLDER")]
    models: Option<PathBuf>,
    /// Unit of the canopy's heights, where the file's header is silent or wrong.
    #[arg(long, value_enum)]
    chm_unit: Option<Unit>,
    /// Target shares of the canopy, as redwood=0.4,douglas-fir=0.3; what is left over goes to the best suited.
    #[arg(long, value_name = "SPECIES=SHARE,…")]
    shares: Option<String>,
    /// Raster of region numbers (0: unpainted), with shares of their own by --brush-regions.
    #[arg(long, value_name = "RASTER", requires = "brush_regions")]
    brush: Option<PathBuf>,
    /// TOML file that says what the brush's region numbers mean.
    #[arg(long, value_name = "TOML", requires = "brush")]
    brush_regions: Option<PathBuf>,
    /// Ground without trees, as a raster (not 0) or shapes (GeoJSON, shapefile): roads, buildings. May be given again.
    #[arg(long, value_name = "FILE")]
    exclude: Vec<PathBuf>,
    /// Width that lines and points of --exclude get.
    #[arg(long, value_name = "METRES", requires = "exclude", default_value_t = CanopyRequest::default().exclude_width_m)]
    exclude_width: f64,
    /// Cells at least this high are canopy.
    #[arg(long, value_name = "METRES", default_value_t = CanopyRequest::default().placement.canopy_min_height_m)]
    min_height: f32,
    /// Grow canopy trees and forest floor only.
    #[arg(long, conflicts_with_all = ["undergrowth_statistics", "refine", "refine_area"])]
    no_undergrowth: bool,
    /// Statistics of your own for the undergrowth, from `wildwood statistics` [default: the biome's, built in].
    #[arg(long, value_name = "FILE")]
    undergrowth_statistics: Option<PathBuf>,
    /// Move undergrowth about until plants stand to each other as simulated ones do; takes some seconds a million plants.
    #[arg(long)]
    refine: bool,
    /// The same in a square only: its middle in map coordinates, and its side in metres.
    #[arg(long, value_name = "EAST,NORTH,SIZE", conflicts_with = "refine", value_parser = square, allow_hyphen_values = true)]
    refine_area: Option<MapWindow>,
    /// Then age the forest by these years, as wildwood age does: snags and downed logs come about.
    #[arg(long, value_name = "YEARS", value_parser = clap::value_parser!(u16).range(1..=i64::from(age::MOST_YEARS)))]
    age: Option<u16>,
    /// Format of the table of plants; csv is written besides parquet, which later runs read.
    #[arg(long, value_name = "FORMAT", default_value = "parquet", value_parser = table_format)]
    table: TableFormat,
    /// Graphics card: auto uses one where there is one, require fails without. Results are the same.
    #[arg(long, value_name = "auto|off|require", default_value_t)]
    gpu: GpuChoice,
    /// Square of the map to picture from above and from the side, as close_up.png: its middle's map coordinates and its
    /// side in metres (10–200). With a scene folder and no other option, nothing is grown, only pictured.
    #[arg(long, value_name = "EAST,NORTH,SIZE", allow_hyphen_values = true)]
    preview_area: Option<Area>,
    #[command(flatten)]
    terrain: TerrainArguments,
}

impl GrowArguments {
    /// Whether nothing is asked that could change a scene; its seed aside.
    fn grows_nothing(&self) -> bool {
        let Self {
            inputs,
            output,
            chm,
            sketch,
            density,
            footprint,
            stand_height,
            onnx,
            ort_lib,
            models,
            chm_unit,
            shares,
            brush,
            brush_regions,
            exclude,
            exclude_width,
            min_height,
            no_undergrowth,
            undergrowth_statistics,
            refine,
            refine_area,
            age,
            table,
            gpu: _,
            preview_area: _,
            terrain,
        } = self;
        let files =
            [chm, sketch, footprint, ort_lib, models, brush, brush_regions, undergrowth_statistics];
        let default = CanopyRequest::default();
        inputs.len() == 1
            && output.as_ref().is_none_or(|output| is_same(output, &inputs[0]))
            && files.into_iter().all(Option::is_none)
            && (density.is_none() && stand_height.is_none() && onnx.is_none())
            && (chm_unit.is_none() && shares.is_none() && exclude.is_empty())
            && !(*no_undergrowth || *refine || refine_area.is_some() || age.is_some())
            && *exclude_width == default.exclude_width_m
            && *min_height == default.placement.canopy_min_height_m
            && *table == default.table
            && terrain.is_default()
    }
}

fn table_format(name: &str) -> Result<TableFormat, String> {
    TableFormat::from_name(name).ok_or_else(|| "give parquet or csv".to_owned())
}

fn density(name: &str) -> Result<Density, String> {
    let painted = Density::from_name(name).filter(|density| *density != Density::Empty);
    painted.ok_or_else(|| "give sparse or dense".to_owned())
}

/// A square around a place, as EAST,NORTH,SIZE.
fn square(text: &str) -> Result<MapWindow, String> {
    let (MapPoint { east_m, north_m }, size_m) = area::square(text).map_err(|e| e.to_string())?;
    if size_m <= 0.0 {
        return Err("give a side above 0".to_owned());
    }
    let half_m = 0.5 * size_m;
    Ok(MapWindow {
        west: east_m - half_m,
        south: north_m - half_m,
        east: east_m + half_m,
        north: north_m + half_m,
    })
}

/// The canopy to generate, if one is asked for.
fn learned(arguments: &GrowArguments) -> Result<Option<LearnedRequest>, Error> {
    let GrowArguments { sketch, density, footprint, .. } = arguments;
    let paint = match (sketch, density, footprint) {
        (Some(path), ..) => PaintSource::Sketch(path.clone()),
        (_, Some(density), _) => PaintSource::Density(*density),
        (.., Some(path)) => PaintSource::Footprint(path.clone()),
        (None, None, None) => {
            let given = [
                ("--stand-height", arguments.stand_height.is_some()),
                ("--onnx", arguments.onnx.is_some()),
                ("--ort-lib", arguments.ort_lib.is_some()),
                ("--models", arguments.models.is_some()),
            ];
            if let Some((option, _)) = given.iter().find(|(_, given)| *given) {
                let what = format!(
                    "{option} needs a canopy to be made: give --sketch, --density or --footprint"
                );
                return Err(Error::Usage { what });
            }
            return Ok(None);
        }
    };
    let stand_height = arguments.stand_height.as_deref().map(stand_height).transpose()?;
    let models = arguments.models.clone().map_or(ModelSource::BuiltIn, ModelSource::Folder);
    let runtimes = runtimes(arguments.onnx.unwrap_or_default(), arguments.ort_lib.clone());
    Ok(Some(LearnedRequest { paint, stand_height, models, runtimes }))
}

/// Metres, or a raster of them.
fn stand_height(text: &str) -> Result<StandHeight, Error> {
    if let Ok(m) = text.parse() {
        return Ok(StandHeight::About(m));
    }
    if Path::new(text).exists() {
        return Ok(StandHeight::Raster(PathBuf::from(text)));
    }
    let what = format!("--stand-height {text}: neither a number of metres nor a file that exists");
    Err(Error::Usage { what })
}

/// The choice of program on this machine.
pub fn runtimes(choice: RuntimeChoice, library: Option<PathBuf>) -> Runtimes {
    let program = std::env::current_exe().ok();
    let variable = |name: &str| std::env::var_os(name);
    let search = LibrarySearch::of_machine(library, program.as_deref(), variable);
    Runtimes { choice, search }
}

pub fn run(arguments: &GrowArguments, shared: &Shared, reporter: &Reporter) -> Outcome {
    if let (Some(area), true) = (&arguments.preview_area, arguments.grows_nothing())
        && let (folder, None) = (&arguments.inputs[0], shared.seed)
        && let Some(manifest) = grown(folder)?
    {
        return picture(folder, &manifest, area, shared, reporter);
    }
    let (ground, folder) = ground(arguments, shared.seed)?;
    if let (Some(area), GroundSource::Scene { .. }) = (&arguments.preview_area, &ground)
        && let Some(manifest) = Manifest::read(&folder)?
    {
        close_up::check(&manifest, area)?; // better told before a forest is grown
    }
    let mut canopy = CanopyRequest {
        shares: arguments.shares.clone(),
        brush: arguments.brush.clone().zip(arguments.brush_regions.clone()).map(Into::into),
        exclude: arguments.exclude.clone(),
        exclude_width_m: arguments.exclude_width,
        table: arguments.table,
        gpu: arguments.gpu,
        ..CanopyRequest::default()
    };
    canopy.placement.canopy_min_height_m = arguments.min_height;
    let chm_unit = arguments.chm_unit.map(Unit::length);
    let (chm, learned) = (arguments.chm.clone(), learned(arguments)?);
    let refine = match (arguments.refine, arguments.refine_area) {
        (true, _) => Some(Refine::All),
        (false, window) => window.map(Refine::Within),
    };
    let undergrowth = UndergrowthRequest {
        is_off: arguments.no_undergrowth,
        statistics: arguments.undergrowth_statistics.clone(),
        refine,
    };
    let request = GrowRequest { ground, chm, learned, chm_unit, canopy, undergrowth };
    let manifest = grow::run(&request, reporter)?;
    import::report(&folder, &manifest, shared);
    report_trees(&manifest, shared);
    let mut manifest = manifest;
    if let Some(years) = arguments.age {
        let request = AgeRequest { seed: shared.seed, ..AgeRequest::new(folder.clone(), years) };
        (manifest, _) = age::run(&request, reporter)?;
        super::age::report(&folder, &manifest, shared);
    }
    match &arguments.preview_area {
        Some(area) => picture(&folder, &manifest, area, shared, reporter),
        None => Ok(()),
    }
}

/// The manifest of a scene folder that has plants.
fn grown(folder: &Path) -> Result<Option<Manifest>, Error> {
    if !folder.is_dir() {
        return Ok(None);
    }
    let has_plants = |manifest: &Manifest| manifest.files().any(|file| file == PLANTS_FILE);
    Ok(Manifest::read(folder)?.filter(has_plants))
}

/// Draws a close-up and says where it is.
fn picture(
    folder: &Path,
    manifest: &Manifest,
    area: &Area,
    shared: &Shared,
    reporter: &Reporter,
) -> Outcome {
    let path = close_up::write(folder, manifest, area, reporter)?;
    let path = path.display().to_string();
    if shared.json {
        terminal::line(&json!({"event": "close-up", "file": path}));
    } else if !shared.quiet {
        terminal::say(&format!("look at {path}"));
    }
    Ok(())
}

/// The ground to grow on, and the scene folder.
fn ground(arguments: &GrowArguments, seed: Option<u64>) -> Result<(GroundSource, PathBuf), Error> {
    let usage = |what: String| Err(Error::Usage { what });
    let given = &arguments.inputs[0];
    if !given.is_dir() {
        let Some(output) = &arguments.output else {
            if !given.exists() {
                return usage(format!("{}: no such file or folder", given.display()));
            }
            return usage("name the scene folder to make with -o FOLDER".to_owned());
        };
        let import = import::request(&arguments.inputs, output, &arguments.terrain, seed)?;
        return Ok((GroundSource::Files(Box::new(import)), output.clone()));
    }
    if arguments.inputs.len() > 1 {
        return usage("give one scene folder, or terrain files".to_owned());
    }
    let is_elsewhere = |output: &&PathBuf| !is_same(output, given);
    if let Some(output) = arguments.output.as_ref().filter(is_elsewhere) {
        let (given, output) = (given.display(), output.display());
        return usage(format!(
            "a scene folder is grown in place: leave -o {output} out, or copy {given}"
        ));
    }
    if !arguments.terrain.is_default() {
        let given = given.display();
        return usage(format!(
            "{given} has its terrain and climate already; options of those need the terrain files (wildwood grow DEM --chm CHM …)"
        ));
    }
    Ok((GroundSource::Scene { folder: given.clone(), seed }, given.clone()))
}

fn is_same(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => a == b,
    }
}

/// One line of what grew.
pub fn report_trees(manifest: &Manifest, shared: &Shared) {
    let Some(entry) = manifest.stages.get(STAGE) else { return };
    if shared.json || shared.quiet {
        return;
    }
    let number = |key: &str| entry.figures.get(key).and_then(toml::Value::as_float).unwrap_or(0.0);
    let trees = entry.figures.get("trees").and_then(toml::Value::as_integer).unwrap_or(0);
    if trees == 0 {
        terminal::say("no canopy trees");
        return;
    }
    terminal::say(&format!(
        "{trees} canopy trees: {:.1} % of the canopy under crowns, {:.1} % of crowns off it; heights within {:.1} m of the canopy",
        100.0 * number("coverage_fraction"),
        100.0 * number("overhang_fraction"),
        number("height_rmse_m"),
    ));
    let Some(entry) = manifest.stages.get(undergrowth::STAGE) else { return };
    if entry.parameters.get("undergrowth").and_then(toml::Value::as_bool) == Some(false) {
        return;
    }
    let plants = entry.figures.get("plants").and_then(toml::Value::as_integer).unwrap_or(0);
    let per_ha = entry.figures.get("plants_per_ha").and_then(toml::Value::as_float);
    terminal::say(&format!("{plants} undergrowth plants, {:.0} a hectare", per_ha.unwrap_or(0.0)));
}
