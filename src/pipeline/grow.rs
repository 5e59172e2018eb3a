//! Canopy trees into a scene folder: terrain and abiotic maps where they are missing, then species and trees.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::import::{self, ImportRequest};
use super::measured_canopy::MeasuredCanopy;
use super::scene_files::{StageFiles, mean};
use super::{Error, brush, exclusion};
use crate::canopy::brush::Brush;
use crate::canopy::envelopes::Envelopes;
use crate::canopy::limits;
use crate::canopy::placement::{self, Placed, PlacementError, PlacementParams};
use crate::canopy::quality::{self, Quality};
use crate::canopy::renderer;
use crate::canopy::shares::Shares;
use crate::canopy::site::Site;
use crate::canopy::species_map::{self, MOST_MISS_FRACTION, SpeciesOutcome, SpeciesParams};
use crate::canopy::stand::Ground;
use crate::canopy::trees;
use crate::canopy::visibility::CpuVisibility;
use crate::canopy::working_cells::WorkingCells;
use crate::export::preview::{CanopyLayer, PreviewMaps, PreviewOptions};
use crate::gpu::{Device, GpuChoice};
use crate::io::{Limits, raster_file};
use crate::plants::Plants;
use crate::plants::table::TableFormat;
use crate::progress::{Reporter, Warning};
use crate::raster::{Frame, Grid, MONTHS, Mask};
use crate::scene::{self, Manifest, StageEntry, Transaction};
use crate::species::Biome;
use crate::terrain::Terrain;

/// Name of the stage in `scene.toml`.
pub const STAGE: &str = "canopy";

/// Share of the canopy without any suitable species that is worth a warning. chosen: less is no gap that one sees.
const WARN_UNSUITABLE_FRACTION: f64 = 0.02;

/// Canopy that is asked to begin higher is none.
const MOST_MIN_HEIGHT_M: f32 = 100.0;

/// What terrain trees are grown on.
#[derive(Clone, Debug)]
pub enum GroundSource {
    /// Terrain files, imported into the scene where they are not yet.
    Files(Box<ImportRequest>),
    /// A scene folder that has terrain and abiotic maps.
    Scene(PathBuf),
}

/// How canopy trees are grown.
#[derive(Clone, Debug)]
pub struct CanopyRequest {
    /// Target shares of species, as `redwood=0.4,douglas-fir=0.3`.
    pub shares: Option<String>,
    /// Painted regions and what their numbers mean.
    pub brush: Option<[PathBuf; 2]>,
    /// Rasters and shapes that are kept free of trees.
    pub exclude: Vec<PathBuf>,
    /// Width that lines and points of those get, m.
    pub exclude_width_m: f64,
    /// Placement.
    pub placement: PlacementParams,
    /// Format of the table of plants; GeoParquet is written besides any other.
    pub table: TableFormat,
    /// Whether the graphics card is used.
    pub gpu: GpuChoice,
}

impl Default for CanopyRequest {
    fn default() -> Self {
        Self {
            shares: None,
            brush: None,
            exclude: Vec::new(),
            exclude_width_m: exclusion::DEFAULT_WIDTH_M,
            placement: PlacementParams::default(),
            table: TableFormat::default(),
            gpu: GpuChoice::default(),
        }
    }
}

/// A forest to grow.
#[derive(Clone, Debug)]
pub struct GrowRequest {
    /// The ground.
    pub ground: GroundSource,
    /// The measured canopy height model; without it that of the point cloud.
    pub chm: Option<PathBuf>,
    /// Unit of its heights, where its header is silent or wrong.
    pub chm_unit: Option<crate::raster::LengthUnit>,
    /// The trees.
    pub canopy: CanopyRequest,
}

/// What trees are grown on, all on one frame.
pub struct CanopyInput<'a> {
    /// The ground.
    pub terrain: &'a Terrain,
    /// What it offers over the year.
    pub site: &'a Site,
    /// Height of the canopy.
    pub chm_m: &'a Grid<f32>,
    /// Where trees may stand.
    pub allowed: &'a Mask,
    /// The species.
    pub biome: &'a Biome,
    /// Painted regions.
    pub brush: Option<&'a Brush>,
}

/// Grown canopy trees.
#[derive(Clone, Debug)]
pub struct GrownCanopy {
    /// The trees.
    pub plants: Plants,
    /// Who stands where, and how far that is what was asked.
    pub species: SpeciesOutcome,
    /// How well the trees fit the canopy.
    pub quality: Quality,
    /// Rounds of placement.
    pub rounds: usize,
    /// Cells along a scene cell's side that trees were placed on.
    pub working_cells_per_cell: usize,
    /// The graphics card that rendered, if one did.
    pub gpu: Option<String>,
}

/// Grows trees, or does nothing where the scene is up to date; gives its manifest.
///
/// # Errors
/// Bad input, a full disk, a cancelled run. Files that cannot be read and settings that cannot be are told before the folder is
/// touched; a run that fails later leaves terrain and abiotic maps as asked for, without trees that stood on others.
pub fn run(request: &GrowRequest, reporter: &Reporter) -> Result<Manifest, Error> {
    // what can be known to be wrong before anything is written
    let min_height_m = request.canopy.placement.canopy_min_height_m;
    if !(min_height_m > 0.0 && min_height_m < MOST_MIN_HEIGHT_M) {
        let what = format!(
            "--min-height {min_height_m}: give metres above 0 and below {MOST_MIN_HEIGHT_M}"
        );
        return Err(Error::Usage { what });
    }
    let folder = match &request.ground {
        GroundSource::Files(import) => {
            refuse_two_canopies(request, import)?;
            import.folder.clone()
        }
        GroundSource::Scene(folder) => folder.clone(),
    };
    let existing = Manifest::read(&folder)?;
    let biome = Biome::builtin(match (&request.ground, &existing) {
        (GroundSource::Files(import), _) => &import.biome,
        (GroundSource::Scene(_), Some(manifest)) => &manifest.scene.biome,
        (GroundSource::Scene(_), None) => return Err(no_scene(&folder)),
    })?;
    let shares = match &request.canopy.shares {
        Some(text) => Shares::parse(text, &biome)?,
        None => Shares::default(),
    };
    let given: Vec<PathBuf> = (request.chm.iter())
        .chain(&request.canopy.exclude)
        .chain(request.canopy.brush.iter().flatten())
        .cloned()
        .collect();
    let beside = given.iter().flat_map(|path| raster_file::beside(path)).collect::<Vec<_>>();
    let inputs = import::hash_inputs(&[given, beside].concat())?;
    let read = |path: &PathBuf| MeasuredCanopy::read(path, request.chm_unit, reporter);
    let measured = request.chm.as_ref().map(read).transpose()?;
    if let GroundSource::Files(import) = &request.ground {
        let has_cloud = import.inputs.iter().any(|path| import::is_cloud(path));
        let had_canopy = existing.as_ref().is_some_and(has_canopy);
        if measured.is_none() && !has_cloud && !had_canopy {
            return Err(no_canopy(&folder));
        }
    }
    if request.canopy.gpu == GpuChoice::Require {
        Device::open(request.canopy.gpu).map_err(gpu_failed)?;
    }
    let mut manifest = match &request.ground {
        GroundSource::Files(import) => import::run(import, reporter)?,
        GroundSource::Scene(_) => existing.ok_or_else(|| no_scene(&folder))?,
    };

    // what the trees depend on
    let of_stage = |stage: &str| {
        manifest.stages.get(stage).map(|entry| entry.key.clone()).ok_or_else(|| no_scene(&folder))
    };
    let canopy = &request.canopy;
    // without a file given, the canopy is the scene's own: the point cloud's, or what was given before
    let own_canopy = folder.join("chm.tif");
    let own_hash = match &measured {
        Some(_) => Vec::new(),
        None if !has_canopy(&manifest) => return Err(no_canopy(&folder)),
        None => import::hash_inputs(std::slice::from_ref(&own_canopy))?,
    };
    let key = import::key(&[
        STAGE,
        &format!("{own_hash:?}"),
        &of_stage("terrain")?,
        &of_stage("abiotics")?,
        &format!("{biome:?} {} {inputs:?} {:?}", manifest.scene.seed, request.chm_unit),
        &format!(
            "{:?} {:?} {} {:?} {:?}",
            canopy.shares,
            canopy.brush.is_some(),
            canopy.exclude_width_m,
            canopy.placement,
            canopy.table
        ),
    ]);
    if manifest.is_current(&folder, STAGE, &key)? {
        return Ok(manifest);
    }

    // read, grow, write
    let terrain = import::load_terrain(&folder, &manifest)?;
    let frame = Arc::clone(terrain.elevation_m.frame());
    let Frame { rows, cols, .. } = *frame;
    WorkingCells::check(rows, cols, frame.transform.cell_m)
        .map_err(|problem| Error::Usage { what: format!("{}: {problem}", folder.display()) })?;
    let measured = match measured {
        Some(measured) => measured,
        None => MeasuredCanopy::read(&own_canopy, None, reporter)?,
    };
    let chm_m = measured.onto_scene(&frame, terrain.elevation_m.mask().as_slice(), reporter)?;
    drop(measured);
    let allowed = allowed(&terrain, canopy, reporter)?;
    let brush = match &canopy.brush {
        None => None,
        Some([raster, regions]) => {
            Some(brush::read_brush(raster, regions, &frame, &biome, &Limits::default(), reporter)?)
        }
    };
    let site = read_site(&folder, &terrain, reporter)?;
    let input = CanopyInput {
        terrain: &terrain,
        site: &site,
        chm_m: &chm_m,
        allowed: &allowed,
        biome: &biome,
        brush: brush.as_ref(),
    };
    let grown = grow(&input, shares, manifest.scene.seed, canopy, reporter)?;
    let discharge_m3_s = read_band(&folder, "discharge.tif", 0, &terrain)?;
    let mut transaction = Transaction::begin(&folder)?;
    let parameters = parameters(request)?;
    let entry = write(
        &input,
        &grown,
        discharge_m3_s,
        canopy,
        (&folder, import::climate_name(&manifest)),
        &mut transaction,
        (key, parameters),
        reporter,
    )?;
    record(&mut manifest, entry);
    manifest.inputs.extend(
        inputs.into_iter().filter(|input| !manifest.inputs.contains(input)).collect::<Vec<_>>(),
    );
    reporter.check_cancelled()?;
    transaction.commit(&manifest)?;
    Ok(manifest)
}

/// Makes the stage's entry the owner of its files, which earlier stages may have written too (`preview.png`).
pub(super) fn record(manifest: &mut Manifest, entry: StageEntry) {
    for stage in manifest.stages.values_mut() {
        // a cloud's canopy stays its terrain's: if another one was put in its place, both are made anew with the cloud
        stage.files.retain(|file, _| file == "chm.tif" || !entry.files.contains_key(file));
    }
    manifest.stages.insert(STAGE.to_owned(), entry);
}

fn gpu_failed(error: crate::gpu::GpuError) -> Error {
    Error::Failed { what: error.to_string() }
}

fn no_scene(folder: &Path) -> Error {
    let what = format!(
        "{}: holds no terrain and abiotic maps; give a terrain file (wildwood grow DEM --chm CHM -o FOLDER), or import one first",
        folder.display()
    );
    Error::Usage { what }
}

fn refuse_two_canopies(request: &GrowRequest, import: &ImportRequest) -> Result<(), Error> {
    match (&request.chm, import.inputs.iter().find(|path| import::is_cloud(path))) {
        (Some(chm), Some(cloud)) => {
            let what = format!(
                "{} measures the canopy itself; leave --chm {} out",
                cloud.display(),
                chm.display()
            );
            Err(Error::Usage { what })
        }
        _ => Ok(()),
    }
}

/// Grows the canopy trees of a canopy height model.
///
/// # Errors
/// A cancelled run, or a graphics card that is missing or fails.
pub fn grow(
    input: &CanopyInput<'_>,
    shares: Shares,
    seed: u64,
    request: &CanopyRequest,
    reporter: &Reporter,
) -> Result<GrownCanopy, Error> {
    let CanopyInput { terrain, site, chm_m, allowed, biome, brush } = input;
    let device = Device::open(request.gpu).map_err(gpu_failed)?;
    let mut renderer =
        renderer::on_device_or(device.as_ref(), Box::new(CpuVisibility)).map_err(gpu_failed)?;

    // species
    let canopy_min_height_m = request.placement.canopy_min_height_m;
    let params = SpeciesParams { shares, canopy_min_height_m, seed, ..SpeciesParams::default() };
    let species = species_map::run(site, chm_m, allowed, biome, &params, *brush, reporter)?;
    tell_of_species(&species, biome, reporter);

    // trees; ground that is kept free is no canopy
    let cells = WorkingCells::new(chm_m, allowed, canopy_min_height_m);
    let highest_m = chm_m.range().map_or(0.0, |(_, highest)| highest);
    let envelopes = Envelopes::new(biome, cells.units_per_m(), highest_m);
    let lowest_m = terrain.elevation_m.range().map_or(0.0, |(lowest, _)| lowest);
    let ground = Ground {
        cells: &cells,
        chm_m,
        elevation_m: &terrain.elevation_m,
        lowest_m,
        species: &species.map,
        biome,
        envelopes: &envelopes,
    };
    let placed = placement::place(&ground, &request.placement, &mut *renderer, reporter);
    let Placed { stand, visibility, rounds } = placed.map_err(|e| match e {
        PlacementError::Cancelled(_) => Error::Cancelled,
        other => Error::Failed { what: other.to_string() },
    })?;
    if stand.is_empty() {
        let text = format!(
            "no trees: no canopy of {canopy_min_height_m} m or more that a species can stand in"
        );
        reporter.warn(Warning::Other { text });
    }
    let quality = quality::measure(&ground, &stand, &visibility);
    Ok(GrownCanopy {
        plants: trees::plants(&ground, site, &stand),
        quality,
        rounds,
        working_cells_per_cell: cells.per_cell,
        gpu: device.as_ref().map(|device| device.adapter().to_string()),
        species,
    })
}

/// Warns of shares that could not be reached, and of canopy that no species can stand in.
fn tell_of_species(outcome: &SpeciesOutcome, biome: &Biome, reporter: &Reporter) {
    for region in &outcome.regions {
        let place = region.name.as_ref().map_or_else(String::new, |name| format!("{name}: "));
        for share in &region.species {
            let missed = share
                .target_fraction
                .is_some_and(|target| (target - share.reached_fraction).abs() > MOST_MISS_FRACTION);
            if let (true, Some(target)) = (missed, share.target_fraction) {
                let why = share.reason.as_ref().map_or_else(String::new, |why| format!(": {why}"));
                let key = &biome.species[share.species].key;
                let (target, reached) = (100.0 * target, 100.0 * share.reached_fraction);
                let text = format!(
                    "{place}{key} has {reached:.1} % of the canopy where {target:.1} % was asked{why}"
                );
                reporter.warn(Warning::Other { text });
            }
        }
        let empty = region.empty_cells as f64 / region.canopy_cells.max(1) as f64;
        if empty > WARN_UNSUITABLE_FRACTION {
            let why = limits::in_words(&region.empty_by_limit, region.canopy_cells);
            let text = format!(
                "{place}{:.1} % of the canopy stays without trees, because none of the biome's species can stand there ({why}); try another --biome or --climate",
                100.0 * empty
            );
            reporter.warn(Warning::Other { text });
        }
    }
}

fn has_canopy(manifest: &Manifest) -> bool {
    manifest.files().any(|file| file == "chm.tif")
}

fn no_canopy(folder: &Path) -> Error {
    let what = format!(
        "{}: no canopy height; give one with --chm FILE, or grow from a point cloud (LAS, LAZ)",
        folder.display()
    );
    Error::Usage { what }
}

/// Land where trees may stand.
fn allowed(terrain: &Terrain, request: &CanopyRequest, reporter: &Reporter) -> Result<Mask, Error> {
    let frame = terrain.elevation_m.frame();
    let mut allowed = terrain.elevation_m.mask().as_slice().to_vec();
    for path in &request.exclude {
        let limits = Limits::default();
        let free =
            exclusion::read_exclusion(path, request.exclude_width_m, frame, &limits, reporter)?;
        allowed.iter_mut().zip(free.as_slice()).for_each(|(allowed, free)| *allowed &= *free);
    }
    Ok(Mask::new(allowed))
}

/// Yearly means of the scene's maps.
fn read_site(folder: &Path, terrain: &Terrain, reporter: &Reporter) -> Result<Site, Error> {
    let stage = reporter.stage("read maps", 3 * MONTHS as u64);
    let yearly = |file: &str| {
        // one month at a time: twelve would be most of the run's memory
        let mut sums = vec![0.0_f64; terrain.elevation_m.frame().len()];
        for month in 0..MONTHS {
            reporter.check_cancelled()?;
            let grid = read_band(folder, file, month, terrain)?;
            sums.iter_mut().zip(grid.values()).for_each(|(sum, v)| *sum += f64::from(*v));
            stage.advance(1);
        }
        let means = sums.iter().map(|sum| (sum / MONTHS as f64) as f32); // a mean of f32 values
        Ok::<_, Error>(terrain.elevation_m.with_values(means.collect()))
    };
    let slope_deg = read_band(folder, "slope.tif", 0, terrain)?;
    let slope_rad = slope_deg.values().iter().map(|s| s.to_radians()).collect();
    Ok(Site {
        sun_h: yearly("sunlight.tif")?,
        moisture_mm: yearly("moisture.tif")?,
        temperature_c: yearly("temperature.tif")?,
        slope_rad: slope_deg.with_values(slope_rad),
    })
}

fn read_band(
    folder: &Path,
    file: &str,
    band: usize,
    terrain: &Terrain,
) -> Result<Grid<f32>, Error> {
    let path = folder.join(file);
    let raster = raster_file::read_band(&path, band, &Limits::default())?;
    if raster.values.len() != terrain.elevation_m.frame().len() {
        let problem = format!("{file} has another size than the terrain");
        return Err(scene::Error::Manifest { path, problem }.into());
    }
    Ok(terrain.elevation_m.with_values(raster.values))
}

/// Writes the stage's files.
#[allow(clippy::too_many_arguments, reason = "what a stage is made of")]
pub(super) fn write(
    input: &CanopyInput<'_>,
    grown: &GrownCanopy,
    discharge_m3_s: Grid<f32>,
    request: &CanopyRequest,
    (folder, climate): (&Path, Option<String>),
    transaction: &mut Transaction,
    (key, parameters): (String, toml::Table),
    reporter: &Reporter,
) -> Result<StageEntry, Error> {
    let stage = reporter.stage("write trees", 4);
    let mut files = StageFiles::new(transaction);
    files.grid("chm.tif", "canopy height", "m", input.chm_m)?;
    stage.advance(1);
    files.species("species.tif", &grown.species.map, input.biome)?;
    stage.advance(1);
    let frame = input.terrain.elevation_m.frame();
    // later stages read GeoParquet
    files.plants(&grown.plants, input.biome, frame, TableFormat::Parquet)?;
    if request.table != TableFormat::Parquet {
        files.plants(&grown.plants, input.biome, frame, request.table)?;
    }
    stage.advance(1);
    let maps = PreviewMaps {
        sunlight_h: Some(input.site.sun_h.clone()),
        moisture_mm: Some(input.site.moisture_mm.clone()),
        discharge_m3_s: Some(discharge_m3_s),
        canopy: Some(CanopyLayer {
            plants: &grown.plants,
            biome: input.biome,
            chm_m: input.chm_m,
            species: &grown.species.map,
        }),
        ..PreviewMaps::default()
    };
    let options = PreviewOptions { title: scene::folder_name(folder), climate };
    files.picture(&options, input.terrain, &maps)?;
    stage.advance(1);
    Ok(files.into_entry(key, parameters, figures(input, grown)))
}

fn parameters(request: &GrowRequest) -> Result<toml::Table, Error> {
    let canopy = &request.canopy;
    let mut parameters = import::parameters(&canopy.placement)?;
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut add = |key: &str, value: toml::Value| parameters.insert(key.to_owned(), value);
    if let Some(chm) = &request.chm {
        add("chm", name(chm).into());
    }
    if let Some(shares) = &canopy.shares {
        add("shares", shares.clone().into());
    }
    if let Some([raster, regions]) = &canopy.brush {
        add("brush", vec![name(raster), name(regions)].into());
    }
    if !canopy.exclude.is_empty() {
        add("exclude", canopy.exclude.iter().map(|p| name(p)).collect::<Vec<_>>().into());
        add("exclude_width_m", canopy.exclude_width_m.into());
    }
    add("table", canopy.table.name().into());
    Ok(parameters)
}

fn figures(input: &CanopyInput<'_>, grown: &GrownCanopy) -> toml::Table {
    let whole = |n: usize| toml::Value::from(i64::try_from(n).unwrap_or(i64::MAX));
    let mut figures = toml::Table::new();
    let mut add = |key: &str, value: toml::Value| figures.insert(key.to_owned(), value);
    let Quality {
        coverage_fraction,
        overhang_fraction,
        unsuitable_fraction,
        height_rmse_m,
        surface_rmse_m,
    } = grown.quality;
    add("trees", whole(grown.plants.len()));
    add("coverage_fraction", coverage_fraction.into());
    add("overhang_fraction", overhang_fraction.into());
    add("unsuitable_canopy_fraction", unsuitable_fraction.into());
    add("height_rmse_m", height_rmse_m.into());
    add("surface_rmse_m", surface_rmse_m.into());
    add("rounds", whole(grown.rounds));
    add("working_cells_per_cell", whole(grown.working_cells_per_cell));
    add("canopy_height_mean_m", mean(input.chm_m.values(), input.chm_m.mask()).into());
    add("gpu", grown.gpu.clone().unwrap_or_else(|| "none".to_owned()).into());
    let counts = grown.plants.count_by_species(input.biome);
    let by_key: toml::Table = (input.biome.species.iter().zip(counts))
        .filter(|(_, count)| *count > 0)
        .map(|(species, count)| (species.key.clone(), whole(count)))
        .collect();
    add("trees_by_species", by_key.into());
    let regions: Vec<toml::Value> = grown
        .species
        .regions
        .iter()
        .map(|region| {
            let mut table = toml::Table::new();
            let name = region.name.clone().unwrap_or_else(|| "landscape".to_owned());
            table.insert("region".to_owned(), name.into());
            let cells = i64::try_from(region.canopy_cells).unwrap_or(i64::MAX);
            table.insert("canopy_cells".to_owned(), cells.into());
            let reached: toml::Table = (region.species.iter())
                .map(|s| (input.biome.species[s.species].key.clone(), s.reached_fraction.into()))
                .collect();
            table.insert("reached_shares".to_owned(), reached.into());
            let asked: toml::Table = (region.species.iter())
                .filter_map(|s| {
                    Some((input.biome.species[s.species].key.clone(), s.target_fraction?.into()))
                })
                .collect();
            table.insert("asked_shares".to_owned(), asked.into());
            table.into()
        })
        .collect();
    add("regions", regions.into());
    figures
}
