//! `wildwood import`: terrain rasters or point clouds become a scene.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::json;

use super::{Outcome, Shared, terminal};
use crate::pipeline::Error;
use crate::pipeline::import::{self, ImportRequest};
use crate::progress::Reporter;
use crate::raster::{Crs, LengthUnit, MapWindow};
use crate::scene::Manifest;
use crate::terrain::import::Resampling;

/// What `wildwood import` takes.
#[derive(Args)]
pub struct ImportArguments {
    /// GeoTIFF, COG, ESRI ASCII grid, .elv, LAS, LAZ or COPC; several tiles are joined.
    #[arg(required = true, value_name = "DEM|LAZ")]
    inputs: Vec<PathBuf>,
    /// Scene folder to make or to bring up to date.
    #[arg(long, short, value_name = "FOLDER")]
    output: PathBuf,
    #[command(flatten)]
    terrain: TerrainArguments,
}

/// How terrain files become a scene.
#[derive(Args, Default)]
pub struct TerrainArguments {
    /// Biome whose climate and species the scene gets: sonoma, pyrenees, or a file of your own (wildwood biome) [default: sonoma].
    #[arg(long, value_name = "NAME|FILE")]
    biome: Option<String>,
    /// TOML file with a `[climate]` table, and if wanted `[soil]`, instead of the biome's.
    #[arg(long, value_name = "FILE")]
    climate: Option<PathBuf>,
    /// CRS of the input's coordinates, where it names none or a wrong one: EPSG:n or a PROJ string.
    #[arg(long)]
    crs: Option<String>,
    /// Unit of the input's coordinates, where no CRS tells it.
    #[arg(long, value_enum)]
    horizontal_unit: Option<Unit>,
    /// Unit of the input's heights, where its header is silent or wrong.
    #[arg(long, value_enum)]
    vertical_unit: Option<Unit>,
    /// Part to import, in the scene's CRS (the input's own where it is metric, else its UTM zone).
    #[arg(
        long,
        value_name = "WEST,SOUTH,EAST,NORTH",
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true
    )]
    bbox: Option<Vec<f64>>,
    /// Cell width of the scene in metres [default: the input's].
    #[arg(long, value_name = "METRES", allow_hyphen_values = true)]
    cell: Option<f64>,
    /// Latitude in degrees north where no CRS tells it; a CRS always does [default: the climate's].
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true)]
    latitude: Option<f64>,
    /// Fill inner holes up to this area; larger voids (lakes, sea) stay masked.
    #[arg(long, value_name = "M2")]
    fill_holes: Option<f64>,
    /// How heights are drawn where cells differ from the input's.
    #[arg(long, value_enum, default_value_t)]
    resampling: ResamplingArgument,
    /// Keep single cells that stand far off all their neighbours.
    #[arg(long)]
    keep_spikes: bool,
}

impl TerrainArguments {
    /// Whether nothing was asked.
    pub fn is_default(&self) -> bool {
        let Self {
            biome,
            climate,
            crs,
            horizontal_unit,
            vertical_unit,
            bbox,
            cell,
            latitude,
            fill_holes,
            resampling,
            keep_spikes,
        } = self;
        biome.is_none()
            && climate.is_none()
            && crs.is_none()
            && horizontal_unit.is_none()
            && vertical_unit.is_none()
            && bbox.is_none()
            && cell.is_none()
            && latitude.is_none()
            && fill_holes.is_none()
            && matches!(resampling, ResamplingArgument::Auto)
            && !keep_spikes
    }
}

/// The window of a `--bbox`.
pub fn window(bbox: &[f64]) -> Result<MapWindow, Error> {
    let usage = |what: String| Error::Usage { what };
    let &[west, south, east, north] = bbox else {
        return Err(usage("--bbox takes four numbers: WEST,SOUTH,EAST,NORTH".to_owned()));
    };
    if !(west < east && south < north) {
        let what = "--bbox: west must be less than east and south less than north";
        return Err(usage(format!("{what}: give WEST,SOUTH,EAST,NORTH")));
    }
    Ok(MapWindow { west, south, east, north })
}

/// A unit of length on the command line.
#[derive(Clone, Copy, ValueEnum)]
pub enum Unit {
    /// Metres.
    M,
    /// International feet.
    Ft,
    /// US survey feet.
    UsFt,
}

impl Unit {
    /// The unit itself.
    pub fn length(self) -> LengthUnit {
        match self {
            Self::M => LengthUnit::Metre,
            Self::Ft => LengthUnit::Foot,
            Self::UsFt => LengthUnit::UsSurveyFoot,
        }
    }
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum ResamplingArgument {
    /// Average where cells grow, bicubic otherwise.
    #[default]
    Auto,
    Bilinear,
    Bicubic,
}

pub fn run(arguments: &ImportArguments, shared: &Shared, reporter: &Reporter) -> Outcome {
    let manifest = import::run(
        &request(&arguments.inputs, &arguments.output, &arguments.terrain, shared.seed)?,
        reporter,
    )?;
    report(&arguments.output, &manifest, shared);
    Ok(())
}

/// Tells what the scene holds.
pub fn report(folder: &Path, manifest: &Manifest, shared: &Shared) {
    let head = &manifest.scene;
    if shared.json {
        terminal::line(
            &json!({"event": "done", "folder": folder.display().to_string(), "scene": head, "stages": manifest.stages}),
        );
    } else if !shared.quiet {
        let [width, height] = head.extent_m;
        terminal::say(&format!(
            "{}: {} × {} cells of {} m ({:.0} × {:.0} m), {}, biome {}; look at {}",
            folder.display(),
            head.cols,
            head.rows,
            head.cell_m,
            width,
            height,
            head.crs,
            head.biome,
            folder.join("preview.png").display(),
        ));
    }
}

/// The request of a command line.
pub fn request(
    inputs: &[PathBuf],
    output: &Path,
    arguments: &TerrainArguments,
    seed: Option<u64>,
) -> Result<ImportRequest, Error> {
    let usage = |what: String| Error::Usage { what };
    let mut request = ImportRequest::new(inputs.to_vec(), output.to_path_buf());
    if let Some(biome) = &arguments.biome {
        request.biome.clone_from(biome);
    }
    request.climate_file.clone_from(&arguments.climate);
    request.seed = seed;
    let terrain = &mut request.terrain;
    if let Some(text) = &arguments.crs {
        terrain.crs = Some(Crs::parse(text).map_err(|e| usage(format!("--crs {text}: {e}")))?);
    }
    terrain.horizontal_unit = arguments.horizontal_unit.map(Unit::length);
    terrain.vertical_unit = arguments.vertical_unit.map(Unit::length);
    terrain.bbox = arguments.bbox.as_deref().map(window).transpose()?;
    terrain.cell_m = arguments.cell;
    terrain.latitude_deg = arguments.latitude;
    if let Some(area_m2) = arguments.fill_holes {
        terrain.fill_holes_up_to_m2 = area_m2;
    }
    terrain.resampling = match arguments.resampling {
        ResamplingArgument::Auto => Resampling::Auto,
        ResamplingArgument::Bilinear => Resampling::Bilinear,
        ResamplingArgument::Bicubic => Resampling::Bicubic,
    };
    terrain.remove_spikes = !arguments.keep_spikes;
    Ok(request)
}
