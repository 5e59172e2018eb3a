//! Real terrain into a scene folder: read, make terrain, make abiotic maps, write.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::Error;
use super::scene_files::{StageFiles, mean};
use crate::abiotics::{self, AbioticMaps};
use crate::io::{self, Limits, ParseError, las, raster_file};
use crate::progress::{Reporter, Stage};
use crate::raster::{Crs, Frame, GeoTransform, Grid, MONTHS, MapWindow, Mask};
use crate::scene::{self, Input, Manifest, SceneHead, StageEntry, Transaction, hash_file};
use crate::species::{Biome, Climate};
use crate::terrain::framing::Placement;
use crate::terrain::import::{self as terrain_import, ImportParams};
use crate::terrain::mosaic::NamedRaster;
use crate::terrain::{Terrain, cloud_import};

/// Raised whenever a stage's results change, so that older scenes are made anew; `tests/golden.rs` tells when.
pub const RESULTS_VERSION: u32 = 1;

/// Bytes read of a climate file at most; chosen: above what the parser takes, so that it tells.
const MAX_CLIMATE_BYTES: u64 = 16 << 20;

/// What to import, from where, to where.
#[derive(Clone, Debug)]
pub struct ImportRequest {
    /// Rasters, or point clouds; several are joined.
    pub inputs: Vec<PathBuf>,
    /// The scene folder.
    pub folder: PathBuf,
    /// A built-in biome's name.
    pub biome: String,
    /// A climate file instead of the biome's own climate.
    pub climate_file: Option<PathBuf>,
    /// Seed recorded in the scene for every later stage.
    pub seed: u64,
    /// How rasters become terrain.
    pub terrain: ImportParams,
    /// How abiotic maps are made.
    pub abiotics: abiotics::Params,
}

impl ImportRequest {
    /// A request with every setting at its default.
    pub fn new(inputs: Vec<PathBuf>, folder: PathBuf) -> Self {
        Self {
            inputs,
            folder,
            biome: DEFAULT_BIOME.to_owned(),
            climate_file: None,
            seed: 1,
            terrain: ImportParams::default(),
            abiotics: abiotics::Params::default(),
        }
    }
}

/// The biome of scenes that name none.
pub const DEFAULT_BIOME: &str = "sonoma";

/// Terrain read from files, and the canopy that a point cloud measured with it.
#[derive(Clone, Debug)]
pub struct ReadTerrain {
    /// The terrain.
    pub terrain: Terrain,
    /// Canopy and surface heights, from clouds.
    pub canopy: Option<MeasuredCanopy>,
}

/// What a point cloud tells of the canopy, on the terrain's frame.
#[derive(Clone, Debug)]
pub struct MeasuredCanopy {
    /// Height above ground, metres.
    pub chm_m: Grid<f32>,
    /// Elevation of the highest surface, metres.
    pub dsm_m: Grid<f32>,
}

/// Imports, or does nothing where the scene is up to date; gives its manifest.
///
/// # Errors
/// Bad input, a full disk, a cancelled run; the folder is then as it was.
pub fn run(request: &ImportRequest, reporter: &Reporter) -> Result<Manifest, Error> {
    let existing = Manifest::read(&request.folder)?;
    let climate = climate(request)?;
    let mut files = request.inputs.clone();
    files.extend(request.inputs.iter().flat_map(|path| raster_file::beside(path)));
    let mut inputs = hash_inputs(&files)?;
    refuse_copies(&request.inputs, &inputs)?;

    let climate_text = format!("{climate:?}");
    let keys = |is_local: bool| {
        // the climate tells the latitude where nothing else does
        let from_climate = is_local && request.terrain.latitude_deg.is_none();
        let latitude_deg = from_climate.then_some(climate.latitude_deg);
        let terrain =
            key(&["terrain", &format!("{inputs:?} {:?} {latitude_deg:?}", request.terrain)]);
        let abiotics =
            key(&["abiotics", &terrain, &climate_text, &format!("{:?}", request.abiotics)]);
        (terrain, abiotics)
    };
    let (terrain_key, abiotics_key) =
        keys(existing.as_ref().is_some_and(|m| m.scene.crs == scene::LOCAL));
    let head_is_current = existing
        .as_ref()
        .is_some_and(|m| m.scene.biome == request.biome && m.scene.seed == request.seed);
    let current = |stage: &str, key: &str| match &existing {
        Some(manifest) => manifest.is_current(&request.folder, stage, key),
        None => Ok(false),
    };
    let terrain_is_current = current("terrain", &terrain_key)?;
    let abiotics_are_current = terrain_is_current && current("abiotics", &abiotics_key)?;
    if let Some(manifest) = existing.as_ref().filter(|_| abiotics_are_current && head_is_current) {
        return Ok(manifest.clone());
    }

    let kept = existing.filter(|_| terrain_is_current);
    let read = match &kept {
        Some(manifest) => {
            ReadTerrain { terrain: load_terrain(&request.folder, manifest)?, canopy: None }
        }
        None => read_terrain_in(request, &climate, reporter)?,
    };
    let scene = SceneHead::new(&request.folder, &read.terrain, &request.biome, request.seed);
    let (terrain_key, abiotics_key) = keys(scene.crs == scene::LOCAL);
    inputs.extend(hash_inputs(request.climate_file.as_slice())?);
    let mut manifest =
        Manifest { scene, inputs, stages: kept.map(|m| m.stages).unwrap_or_default() };
    reporter.check_cancelled()?;
    let mut transaction = Transaction::begin(&request.folder)?;
    if !terrain_is_current {
        let entry =
            write_terrain(&read, &mut transaction, terrain_key, parameters(&request.terrain)?)?;
        manifest.stages.insert("terrain".to_owned(), entry);
    }
    if !abiotics_are_current {
        let maps = abiotics::run(&read.terrain, &climate, &request.abiotics, reporter)?;
        let entry = write_abiotics(
            &read.terrain,
            &maps,
            &mut transaction,
            abiotics_key,
            request,
            reporter,
        )?;
        manifest.stages.insert("abiotics".to_owned(), entry);
    }
    reporter.check_cancelled()?;
    transaction.commit(&manifest)?;
    Ok(manifest)
}

/// Reads the request's files into terrain, and canopy where they are clouds.
///
/// # Errors
/// Bad input or a cancelled run.
pub fn read_terrain(request: &ImportRequest, reporter: &Reporter) -> Result<ReadTerrain, Error> {
    read_terrain_in(request, &climate(request)?, reporter)
}

/// Writes a scene folder that holds terrain alone.
///
/// # Errors
/// If it cannot be written.
pub fn write_terrain_only(terrain: &Terrain, folder: &Path) -> Result<(), Error> {
    let mut transaction = Transaction::begin(folder)?;
    let read = ReadTerrain { terrain: terrain.clone(), canopy: None };
    let entry = write_terrain(&read, &mut transaction, String::new(), toml::Table::new())?;
    let stages = [("terrain".to_owned(), entry)].into();
    let scene = SceneHead::new(folder, terrain, DEFAULT_BIOME, 1);
    transaction.commit(&Manifest { scene, inputs: Vec::new(), stages })?;
    Ok(())
}

fn read_terrain_in(
    request: &ImportRequest,
    climate: &Climate,
    reporter: &Reporter,
) -> Result<ReadTerrain, Error> {
    let stage = reporter.stage("read", request.inputs.len() as u64);
    let limits = Limits { max_cells: request.terrain.max_cells, ..Limits::default() };
    let cloud = request.inputs.iter().find(|path| is_cloud(path));
    let raster = request.inputs.iter().find(|path| !is_cloud(path));
    if let (Some(cloud), Some(raster)) = (cloud, raster) {
        let (cloud, raster) = (cloud.display(), raster.display());
        let what = format!(
            "{cloud} is a point cloud, {raster} is none; give either elevation rasters or point clouds"
        );
        return Err(Error::Usage { what });
    }
    if cloud.is_some() {
        let cloud = read_clouds(request, &limits, reporter, &stage)?;
        drop(stage);
        let path = &request.inputs[0];
        let read =
            cloud_import::run(cloud, path, &request.terrain, Some(climate.latitude_deg), reporter)?;
        let canopy = MeasuredCanopy { chm_m: read.chm_m, dsm_m: read.dsm_m };
        return Ok(ReadTerrain { terrain: read.terrain, canopy: Some(canopy) });
    }
    let mut tiles = Vec::with_capacity(request.inputs.len());
    for path in &request.inputs {
        reporter.check_cancelled()?;
        let window = match request.terrain.bbox {
            Some(_) => window_in_file(request, raster_file::geotiff_crs(path)?),
            None => None,
        };
        let raster = raster_file::read(path, window.as_ref(), &limits)?;
        tiles.push(NamedRaster { path: path.clone(), raster });
        stage.advance(1);
    }
    drop(stage);
    let terrain =
        terrain_import::run(tiles, &request.terrain, Some(climate.latitude_deg), reporter)?;
    Ok(ReadTerrain { terrain, canopy: None })
}

/// The window to read of a file whose header names `header_crs` (`None`: all of it). The user's window is in the
/// scene's CRS, so it can cut the file only where that is the file's own.
fn window_in_file(request: &ImportRequest, header_crs: Option<Crs>) -> Option<MapWindow> {
    let bbox = request.terrain.bbox?;
    let crs = request.terrain.crs.clone().or(header_crs)?;
    let stays =
        Placement::new(&crs, bbox.middle()).is_ok_and(|placement| placement.to_scene.is_none());
    stays.then_some(bbox)
}

/// All clouds as one.
fn read_clouds(
    request: &ImportRequest,
    limits: &Limits,
    reporter: &Reporter,
    stage: &Stage<'_>,
) -> Result<las::PointCloud, Error> {
    let mut joined: Option<las::PointCloud> = None;
    for path in &request.inputs {
        reporter.check_cancelled()?;
        let window = match request.terrain.bbox {
            Some(_) => window_in_file(request, Some(las::header_crs(path)?.unwrap_or(Crs::Local))),
            None => None,
        };
        let cloud = las::read(path, window, limits)?;
        stage.advance(1);
        match &mut joined {
            None => joined = Some(cloud),
            Some(first) if request.terrain.crs.is_none() && first.crs != cloud.crs => {
                let name = |crs: &Option<Crs>| {
                    crs.as_ref().map_or_else(|| "no CRS".to_owned(), Crs::to_string)
                };
                return Err(Error::Usage {
                    what: format!(
                        "{} is in {}, {} in {}; give clouds of one CRS, or reproject one",
                        request.inputs[0].display(),
                        name(&first.crs),
                        path.display(),
                        name(&cloud.crs)
                    ),
                });
            }
            Some(first) => first.append(cloud),
        }
    }
    joined.ok_or_else(|| Error::Usage { what: "no input given; name at least one file".to_owned() })
}

/// Whether a file is a point cloud, by its first bytes or its name.
fn is_cloud(path: &Path) -> bool {
    let mut start = [0; 4];
    let begins_as_one = File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok()
        && start == *b"LASF";
    let named = |wanted: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(wanted));
    begins_as_one || named("las") || named("laz")
}

fn climate(request: &ImportRequest) -> Result<Climate, Error> {
    let biome = Biome::builtin(&request.biome)?;
    let Some(path) = &request.climate_file else {
        return Ok(biome.climate);
    };
    let failed = |source| io::Error::Read { path: path.clone(), source };
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MAX_CLIMATE_BYTES).read_to_end(&mut bytes))
        .map_err(failed)?;
    let text = String::from_utf8(bytes).map_err(|_| {
        ParseError::new("it is no text", "give a TOML file with a [climate] table").at(path)
    })?;
    let in_file =
        |e: crate::species::BiomeError| Error::Usage { what: format!("{}: {e}", path.display()) };
    Climate::from_toml(&text).map_err(in_file)
}

fn hash_inputs(paths: &[PathBuf]) -> Result<Vec<Input>, Error> {
    let mut inputs: Vec<Input> = Vec::with_capacity(paths.len());
    for path in paths {
        let failed = |source| io::Error::Read { path: path.clone(), source };
        // a pipe or a device would be read for ever, and only once
        if !std::fs::metadata(path).map_err(failed)?.is_file() {
            let problem = ParseError::new("it is no file", "name the raster or cloud itself");
            return Err(problem.at(path).into());
        }
        let (blake3, bytes) = hash_file(path).map_err(failed)?;
        let file = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        inputs.push(Input { file, bytes, blake3 });
    }
    Ok(inputs)
}

/// Refuses rasters and clouds given twice: twice the points would halve the cells' width. Files beside them,
/// such as the `.prj` of each tile, may well be copies.
fn refuse_copies(paths: &[PathBuf], inputs: &[Input]) -> Result<(), Error> {
    for (at, (second, input)) in paths.iter().zip(inputs).enumerate() {
        let copied = inputs[..at].iter().position(|earlier| earlier.blake3 == input.blake3);
        if let Some(first) = copied {
            let (first, second) = (paths[first].display(), second.display());
            let what = format!("{first} and {second} are the same file; give each file once");
            return Err(Error::Usage { what });
        }
    }
    Ok(())
}

fn key(parts: &[&str]) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&RESULTS_VERSION.to_le_bytes());
    for part in parts {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part.as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}

fn load_terrain(folder: &Path, manifest: &Manifest) -> Result<Terrain, Error> {
    let path = folder.join("terrain.tif");
    let head = &manifest.scene;
    let broken = |problem: String| {
        Error::from(crate::scene::Error::Manifest { path: folder.join("scene.toml"), problem })
    };
    let crs = head.crs().map_err(|e| broken(e.to_string()))?;
    let raster = raster_file::read(&path, None, &Limits::default())?;
    if (raster.rows, raster.cols) != (head.rows, head.cols) {
        return Err(broken("terrain.tif has another size than it says".to_owned()));
    }
    let transform = GeoTransform {
        west_m: raster.affine.origin_x,
        north_m: raster.affine.origin_y,
        cell_m: raster.affine.col_dx,
    };
    let frame = Frame { rows: raster.rows, cols: raster.cols, transform, crs };
    Ok(Terrain {
        elevation_m: Grid::new(frame.into(), Mask::new(raster.valid).into(), raster.values),
        latitude_rad: head.latitude_rad,
        grid_convergence_rad: head.grid_convergence_rad,
    })
}

pub(super) fn write_terrain(
    read: &ReadTerrain,
    transaction: &mut Transaction,
    key: String,
    parameters: toml::Table,
) -> Result<StageEntry, Error> {
    let elevation = &read.terrain.elevation_m;
    let mut files = StageFiles::new(transaction);
    files.grid("terrain.tif", "elevation", "m", elevation)?;
    let mut figures = toml::Table::new();
    if let Some(canopy) = &read.canopy {
        files.grid("chm.tif", "canopy height", "m", &canopy.chm_m)?;
        files.grid("dsm.tif", "surface elevation", "m", &canopy.dsm_m)?;
        figures.insert(
            "canopy_height_mean_m".to_owned(),
            mean(canopy.chm_m.values(), canopy.chm_m.mask()).into(),
        );
    }
    if let Some((lowest, highest)) = elevation.range() {
        figures.insert("elevation_min_m".to_owned(), f64::from(lowest).into());
        figures.insert("elevation_max_m".to_owned(), f64::from(highest).into());
    }
    figures
        .insert("elevation_mean_m".to_owned(), mean(elevation.values(), elevation.mask()).into());
    let masked = elevation.frame().len() - elevation.mask().valid_count();
    figures.insert("masked_cells".to_owned(), i64::try_from(masked).unwrap_or(i64::MAX).into());
    Ok(files.into_entry(key, parameters, figures))
}

pub(super) fn write_abiotics(
    terrain: &Terrain,
    maps: &AbioticMaps,
    transaction: &mut Transaction,
    key: String,
    request: &ImportRequest,
    reporter: &Reporter,
) -> Result<StageEntry, Error> {
    let mut files = StageFiles::new(transaction);
    files.abiotics(maps, reporter)?;
    let name = crate::scene::folder_name(&request.folder);
    files.preview(&name, terrain, maps, reporter)?;
    let mut parameters = parameters(&request.abiotics)?;
    parameters.insert("biome".to_owned(), request.biome.clone().into());
    Ok(files.into_entry(key, parameters, abiotic_figures(maps)))
}

fn abiotic_figures(maps: &AbioticMaps) -> toml::Table {
    let mut figures = toml::Table::new();
    let mut add = |name: &str, value: f64| figures.insert(name.to_owned(), value.into());
    let yearly =
        |months: &dyn Fn(usize) -> f64| (0..MONTHS).map(months).sum::<f64>() / MONTHS as f64;
    let mask = maps.slope_rad.mask();
    add("sunlight_mean_h_per_day", yearly(&|m| mean(maps.sunlight_h.month(m), mask)));
    add("moisture_mean_mm", yearly(&|m| mean(maps.moisture_mm.month(m), mask)));
    add("slope_mean_deg", mean(maps.slope_rad.values(), mask).to_degrees());
    add("temperature_mean_c", mean(maps.temperature_c.yearly_mean().values(), mask));
    let sum = |pick: fn(&crate::abiotics::WaterBalance) -> f64| {
        maps.balance.iter().map(pick).sum::<f64>()
    };
    add("rain_mm_per_year", sum(|b| b.rain_mm));
    add("evaporation_mm_per_year", sum(|b| b.evaporation_mm));
    add("transpiration_mm_per_year", sum(|b| b.transpiration_mm));
    add("outflow_mm_per_year", sum(|b| b.outflow_mm));
    figures
}

/// Parameters as the manifest records them.
fn parameters<P: serde::Serialize>(params: &P) -> Result<toml::Table, Error> {
    toml::Table::try_from(params).map_err(|e| Error::Failed { what: format!("parameters: {e}") })
}
