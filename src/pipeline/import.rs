//! Real terrain into a scene folder: read, make terrain, make abiotic maps, write.

use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use super::biome_file::{self, ChosenBiome};
use super::scene_files::{StageFiles, mean};
use super::{Error, age, grow, undergrowth};
use crate::abiotics::{self, AbioticMaps};
use crate::export::preview::PreviewOptions;
use crate::io::raster_file::RasterHead;
use crate::io::{self, Limits, ParseError, las, raster_file};
use crate::progress::{Reporter, Stage, Warning};
use crate::raster::{Crs, Frame, GeoTransform, Grid, LengthUnit, MONTHS, MapWindow, Mask};
use crate::scene::{self, Input, Manifest, SceneHead, StageEntry, Transaction, hash_file};
use crate::species::Climate;
use crate::terrain::framing::Placement;
use crate::terrain::import::{self as terrain_import, ImportParams};
use crate::terrain::mosaic::NamedRaster;
use crate::terrain::{Terrain, cloud_import};

/// Raised whenever a stage's results change, so that older scenes are made anew; `tests/golden.rs` tells when.
pub const RESULTS_VERSION: u32 = 3;

/// The parameter of the abiotic stage that names its climate.
const CLIMATE_NAME: &str = "climate_name";

/// What to import, from where, to where.
#[derive(Clone, Debug)]
pub struct ImportRequest {
    /// Rasters, or point clouds; several are joined.
    pub inputs: Vec<PathBuf>,
    /// The scene folder.
    pub folder: PathBuf,
    /// A built-in biome's name, or the path of a biome file.
    pub biome: String,
    /// A climate file instead of the biome's own climate.
    pub climate_file: Option<PathBuf>,
    /// Seed recorded in the scene for every later stage; none leaves a scene its own.
    pub seed: Option<u64>,
    /// How rasters become terrain.
    pub terrain: ImportParams,
    /// How abiotic maps are made.
    pub abiotics: abiotics::Params,
}

/// Seed of a scene that is given none.
pub const DEFAULT_SEED: u64 = 1;

impl ImportRequest {
    /// A request with every setting at its default.
    pub fn new(inputs: Vec<PathBuf>, folder: PathBuf) -> Self {
        Self {
            inputs,
            folder,
            biome: DEFAULT_BIOME.to_owned(),
            climate_file: None,
            seed: None,
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
    let chosen = ChosenBiome::read(&request.biome)?;
    let climate = climate(request, &chosen)?;
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
        let params = format!("{:?}", request.abiotics);
        let mut parts = vec!["abiotics", &terrain, &climate_text, &params];
        parts.extend(chosen.own_text.as_deref());
        let abiotics = key(&parts);
        (terrain, abiotics)
    };
    let (terrain_key, abiotics_key) =
        keys(existing.as_ref().is_some_and(|m| m.scene.crs == scene::LOCAL));
    let own_seed = existing.as_ref().map(|manifest| manifest.scene.seed);
    let seed = request.seed.or(own_seed).unwrap_or(DEFAULT_SEED);
    let head_is_current = existing
        .as_ref()
        .is_some_and(|m| m.scene.biome == chosen.biome.key && m.scene.seed == seed);
    let current = |stage: &str, key: &str| match &existing {
        Some(manifest) => manifest.is_current(&request.folder, stage, key),
        None => Ok(false),
    };
    let terrain_is_current = current("terrain", &terrain_key)?;
    // trees of another biome or seed go, and with them the sheet that shows them: maps and sheet are then made anew
    let has_trees = existing.as_ref().is_some_and(|m| m.stages.contains_key(grow::STAGE));
    let abiotics_are_current = terrain_is_current
        && (head_is_current || !has_trees)
        && current("abiotics", &abiotics_key)?;
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
    let scene = SceneHead::new(&request.folder, &read.terrain, &chosen.biome.key, seed);
    let (terrain_key, abiotics_key) = keys(scene.crs == scene::LOCAL);
    inputs.extend(hash_inputs(request.climate_file.as_slice())?);
    let mut manifest =
        Manifest { scene, inputs, stages: kept.map(|m| m.stages).unwrap_or_default() };
    let trees = manifest.stages.remove(grow::STAGE);
    // what grew beneath them goes with them
    for stage in [undergrowth::STAGE, undergrowth::FLOOR_STAGE, age::STAGE] {
        manifest.stages.remove(stage);
    }
    if has_trees {
        let text = "trees grown here on other terrain, maps, species or another seed are removed";
        reporter.warn(Warning::Other { text: text.to_owned() });
    }
    // the canopy that they were fitted to is the terrain's
    let chm = trees.and_then(|trees| {
        trees.files.get_key_value("chm.tif").map(|(name, hash)| (name.clone(), hash.clone()))
    });
    if let (Some(terrain), Some((name, hash))) = (manifest.stages.get_mut("terrain"), chm) {
        terrain.files.entry(name).or_insert(hash);
    }
    reporter.check_cancelled()?;
    let mut transaction = Transaction::begin(&request.folder)?;
    if !terrain_is_current {
        let entry =
            write_terrain(&read, &mut transaction, terrain_key, parameters(&request.terrain)?)?;
        manifest.stages.insert("terrain".to_owned(), entry);
    }
    if !abiotics_are_current {
        warn_of_climate_from_elsewhere(&read.terrain, &climate, reporter);
        let maps = abiotics::run(&read.terrain, &climate, &request.abiotics, reporter)?;
        let made = MadeMaps {
            terrain: &read.terrain,
            climate: &climate,
            own_biome: chosen.own_text.as_deref(),
            maps: &maps,
        };
        let entry = write_abiotics(&made, &mut transaction, abiotics_key, request, reporter)?;
        manifest.stages.insert("abiotics".to_owned(), entry);
    }
    reporter.check_cancelled()?;
    transaction.commit(&manifest)?;
    age::discard_checkpoint(&request.folder);
    Ok(manifest)
}

/// Distance in latitude from which a climate is another place's. chosen: 5°, about 550 km.
const ELSEWHERE_DEG: f64 = 5.0;

fn warn_of_climate_from_elsewhere(terrain: &Terrain, climate: &Climate, reporter: &Reporter) {
    let scene_latitude_deg = terrain.latitude_rad.to_degrees();
    let climate_latitude_deg = climate.latitude_deg;
    if (scene_latitude_deg - climate_latitude_deg).abs() > ELSEWHERE_DEG {
        reporter.warn(Warning::ClimateFromElsewhere { climate_latitude_deg, scene_latitude_deg });
    }
}

/// Reads the request's files into terrain, and canopy where they are clouds.
///
/// # Errors
/// Bad input or a cancelled run.
pub fn read_terrain(request: &ImportRequest, reporter: &Reporter) -> Result<ReadTerrain, Error> {
    let climate = climate(request, &ChosenBiome::read(&request.biome)?)?;
    read_terrain_in(request, &climate, reporter)
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
    // tiles without a valid cell, or outside the window, are left out; an error only if none remains
    let mut tiles = Vec::with_capacity(request.inputs.len());
    let mut nothing = None;
    let windows = windows_in_files(request)?;
    for (path, window) in request.inputs.iter().zip(windows) {
        reporter.check_cancelled()?;
        match raster_file::read(path, window.as_ref(), &limits) {
            Ok(raster) => tiles.push(NamedRaster { path: path.clone(), raster }),
            Err(error) if error.is_nothing() => nothing = nothing.or(Some(error)),
            Err(error) => return Err(error.into()),
        }
        stage.advance(1);
    }
    drop(stage);
    if let (true, Some(error)) = (tiles.is_empty(), nothing) {
        return Err(error.into());
    }
    let terrain =
        terrain_import::run(tiles, &request.terrain, Some(climate.latitude_deg), reporter)?;
    Ok(ReadTerrain { terrain, canopy: None })
}

/// The window to read of a file whose header names `header_crs` (`None`: all of it). The user's window is in the
/// scene's CRS, so it can cut the file only where that is the file's own.
fn window_in_file(request: &ImportRequest, header_crs: Option<Crs>) -> Option<MapWindow> {
    let bbox = request.terrain.bbox?;
    let crs = request.terrain.crs.clone().or(header_crs)?;
    // local coordinates may be in another unit than the window's metres
    let in_metres = crs != Crs::Local || request.terrain.horizontal_unit.is_none();
    let stays =
        Placement::new(&crs, bbox.middle()).is_ok_and(|placement| placement.to_scene.is_none());
    (in_metres && stays).then_some(bbox)
}

/// Cells beyond the window's edge that its cells lean on: kernels reach two of the scene's cells, spikes are told by
/// their neighbours, and a window is rounded to whole cells.
const MARGIN_SCENE_CELLS: f64 = 2.0;
/// The same in cells of the file, where they are wider.
const MARGIN_FILE_CELLS: f64 = 3.0;

/// The window to read of each file (`None`: all of it), with a margin, so that cells are those of the whole file.
fn windows_in_files(request: &ImportRequest) -> Result<Vec<Option<MapWindow>>, Error> {
    let paths = &request.inputs;
    if request.terrain.bbox.is_none() {
        return Ok(vec![None; paths.len()]);
    }
    let heads = paths.iter().map(|path| raster_file::head(path)).collect::<Result<Vec<_>, _>>()?;
    // tiles of several systems are refused later, and a window means nothing in all of them
    let crs = |head: &Option<RasterHead>| head.as_ref().and_then(|head| head.crs.clone());
    let is_one_crs = heads.iter().all(|head| crs(head) == crs(&heads[0]));
    if request.terrain.crs.is_none() && !is_one_crs {
        return Ok(vec![None; paths.len()]);
    }
    let window = |head: &Option<RasterHead>| {
        let head = head.as_ref()?;
        let window = window_in_file(request, head.crs.clone())?;
        let a = &head.affine;
        let file_cell = (a.col_dx.abs() + a.row_dx.abs()).max(a.col_dy.abs() + a.row_dy.abs());
        let margin = MARGIN_FILE_CELLS * file_cell
            + MARGIN_SCENE_CELLS * request.terrain.cell_m.unwrap_or(file_cell);
        Some(MapWindow {
            west: window.west - margin,
            south: window.south - margin,
            east: window.east + margin,
            north: window.north + margin,
        })
    };
    Ok(heads.iter().map(window).collect())
}

/// All clouds as one, without those that the window misses.
fn read_clouds(
    request: &ImportRequest,
    limits: &Limits,
    reporter: &Reporter,
    stage: &Stage<'_>,
) -> Result<las::PointCloud, Error> {
    let given = &request.terrain;
    let mut joined: Option<(&Path, las::PointCloud)> = None;
    for path in &request.inputs {
        reporter.check_cancelled()?;
        let in_metres = given.horizontal_unit.is_none_or(|unit| unit == LengthUnit::Metre);
        let window = match (given.bbox.filter(|_| in_metres), &given.crs) {
            (None, _) => None,
            (Some(_), Some(_)) => window_in_file(request, None),
            (Some(_), None) => {
                window_in_file(request, Some(las::header_crs(path)?.unwrap_or(Crs::Local)))
            }
        };
        let window = window.map(|bbox| cloud_import::window_of_points(&bbox, given));
        let read = joined.as_ref().map_or(0, |(_, cloud)| cloud.len());
        let limits = Limits { max_points: limits.max_points - read, ..*limits };
        let cloud = las::read(path, window, &limits)?;
        stage.advance(1);
        if cloud.is_empty() {
            continue;
        }
        if let (None, Some(problem)) = (&given.crs, &cloud.crs_problem) {
            return Err(problem.clone().at(path).into());
        }
        match &mut joined {
            None => joined = Some((path, cloud)),
            Some((first_path, first)) => {
                let cloud = in_units_of(first, first_path, cloud, path, given)?;
                first.append(cloud);
            }
        }
    }
    joined.map(|(_, cloud)| cloud).ok_or_else(|| {
        let what = match (request.inputs.first(), given.bbox) {
            (Some(path), Some(bbox)) => {
                let others = if request.inputs.len() > 1 { " and the other clouds" } else { "" };
                format!(
                    "{}{others}: no point lies in the window {bbox}; check --bbox (west,south,east,north in the cloud's own map coordinates)",
                    path.display()
                )
            }
            _ => "no input given; name at least one file".to_owned(),
        };
        Error::Usage { what }
    })
}

/// A cloud that is to be joined to the first, heights in the first one's unit.
fn in_units_of(
    first: &las::PointCloud,
    first_path: &Path,
    cloud: las::PointCloud,
    path: &Path,
    given: &ImportParams,
) -> Result<las::PointCloud, Error> {
    let (first_name, name) = (first_path.display(), path.display());
    if given.crs.is_none() && first.crs != cloud.crs {
        let crs =
            |crs: &Option<Crs>| crs.as_ref().map_or_else(|| "no CRS".to_owned(), Crs::to_string);
        let (first_crs, crs) = (crs(&first.crs), crs(&cloud.crs));
        let what = format!(
            "{first_name} is in {first_crs}, {name} in {crs}; give clouds of one CRS, or reproject one"
        );
        return Err(Error::Usage { what });
    }
    match (first.vertical_unit, cloud.vertical_unit) {
        _ if given.vertical_unit.is_some() => Ok(cloud),
        (first_unit, unit) if first_unit == unit => Ok(cloud),
        (Some(first_unit), Some(unit)) => Ok(cloud.with_heights_in(first_unit, unit)),
        (first_unit, _) => {
            let (named, silent) =
                if first_unit.is_some() { (first_name, name) } else { (name, first_name) };
            let what = format!(
                "{named} names its unit of height, {silent} does not; give --vertical-unit if they are the same, or import them one by one"
            );
            Err(Error::Usage { what })
        }
    }
}

/// Whether a file is a point cloud, by its first bytes or its name.
pub(super) fn is_cloud(path: &Path) -> bool {
    let mut start = [0; 4];
    let begins_as_one = File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok()
        && start == *b"LASF";
    let named = |wanted: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(wanted));
    begins_as_one || named("las") || named("laz")
}

fn climate(request: &ImportRequest, chosen: &ChosenBiome) -> Result<Climate, Error> {
    let Some(path) = &request.climate_file else {
        return Ok(chosen.biome.climate.clone());
    };
    let text = biome_file::read_text(path, "a TOML file with a [climate] table")?;
    let in_file =
        |e: crate::species::BiomeError| Error::Usage { what: format!("{}: {e}", path.display()) };
    Climate::from_toml(&text).map_err(in_file)
}

pub(super) fn hash_inputs(paths: &[PathBuf]) -> Result<Vec<Input>, Error> {
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

pub(super) fn key(parts: &[&str]) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&RESULTS_VERSION.to_le_bytes());
    for part in parts {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part.as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}

pub(super) fn load_terrain(folder: &Path, manifest: &Manifest) -> Result<Terrain, Error> {
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

/// Abiotic maps, and what they were made from.
pub(super) struct MadeMaps<'a> {
    pub terrain: &'a Terrain,
    pub climate: &'a Climate,
    /// Text of a biome that is not built in.
    pub own_biome: Option<&'a str>,
    pub maps: &'a AbioticMaps,
}

pub(super) fn write_abiotics(
    made: &MadeMaps<'_>,
    transaction: &mut Transaction,
    key: String,
    request: &ImportRequest,
    reporter: &Reporter,
) -> Result<StageEntry, Error> {
    let MadeMaps { terrain, climate, own_biome, maps } = *made;
    let mut files = StageFiles::new(transaction);
    files.abiotics(maps, reporter)?;
    if let Some(text) = own_biome {
        files.file(biome_file::COPY, |file| file.write_all(text.as_bytes()))?;
    }
    let climate_file = request.climate_file.as_deref().unwrap_or(Path::new(&request.biome));
    let climate_name = climate_file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let title = scene::folder_name(&request.folder);
    let options = PreviewOptions { title, climate: Some(climate_name.clone()) };
    files.preview(&options, terrain, maps, reporter)?;
    let mut parameters = parameters(&request.abiotics)?;
    parameters.insert(CLIMATE_NAME.to_owned(), climate_name.into());
    parameters.insert("climate".to_owned(), self::parameters(climate)?.into());
    Ok(files.into_entry(key, parameters, abiotic_figures(maps)))
}

/// Where the climate of a scene's maps comes from.
pub(super) fn climate_name(manifest: &Manifest) -> Option<String> {
    let parameters = &manifest.stages.get("abiotics")?.parameters;
    Some(parameters.get(CLIMATE_NAME)?.as_str()?.to_owned())
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
pub(super) fn parameters<P: serde::Serialize>(params: &P) -> Result<toml::Table, Error> {
    toml::Table::try_from(params).map_err(|e| Error::Failed { what: format!("parameters: {e}") })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::las::{PointCloud, Quantization};

    /// 100 points on a line eastward from `west`.
    fn cloud(west: f64, vertical_unit: Option<LengthUnit>) -> PointCloud {
        let axes = [Quantization { scale: 0.01, offset: 0.0 }; 3];
        let mut cloud = PointCloud::new(axes, Some(Crs::Epsg(32633)), vertical_unit);
        (0..100).for_each(|i| cloud.push([west + f64::from(i), 5_000_000.0, 30.0], 2));
        cloud
    }

    /// Reads files of such clouds, `wests` apart.
    fn read(
        wests: &[f64],
        limits: &Limits,
        change: impl Fn(&mut ImportRequest),
    ) -> Result<PointCloud, Error> {
        let folder = tempfile::tempdir().unwrap();
        let paths = wests.iter().map(|west| {
            let path = folder.path().join(format!("{west}.laz"));
            las::write_laz(&cloud(*west, None), &path).unwrap();
            path
        });
        let mut request = ImportRequest::new(paths.collect(), PathBuf::new());
        change(&mut request);
        let reporter = Reporter::silent();
        read_clouds(&request, limits, &reporter, &reporter.stage("read", 0))
    }

    #[test]
    fn issue_2_clouds_that_the_window_misses_are_skipped() {
        let wests = [410_000.0, 400_000.0, 420_000.0];
        let window = |west: f64| {
            let (south, north) = (4_999_990.0, 5_000_010.0);
            let bbox = MapWindow { west, south, east: west + 50.0, north };
            read(&wests, &Limits::default(), |r| r.terrain.bbox = Some(bbox))
        };
        assert_eq!(window(400_020.0).unwrap().bounds().unwrap().min[0], 400_000.0);
        let message = window(500_000.0).unwrap_err().to_string();
        assert!(message.contains("--bbox") && message.contains("500000"), "{message}");
    }

    #[test]
    fn issue_2_the_limit_of_points_holds_for_all_clouds_together() {
        let read = |max_points| {
            let limits = Limits { max_points, ..Limits::default() };
            read(&[400_000.0, 400_100.0, 400_200.0], &limits, |_| ())
        };
        assert_eq!(read(300).unwrap().len(), 300);
        let message = read(299).unwrap_err().to_string();
        assert!(message.contains("400200.laz") && message.contains("99"), "{message}");
    }

    #[test]
    fn issue_2_heights_in_other_units_are_converted_or_refused() {
        let (metres, feet) = (Some(LengthUnit::Metre), Some(LengthUnit::Foot));
        let joined = |first, second, given: Option<LengthUnit>| {
            let given = ImportParams { vertical_unit: given, ..ImportParams::default() };
            let (first, second) = (cloud(4e5, first), cloud(5e5, second));
            in_units_of(&first, Path::new("a.laz"), second, Path::new("b.laz"), &given)
                .map(|cloud| cloud.position(0)[2])
        };
        assert!((joined(metres, feet, None).unwrap() - 30.0 * 0.3048).abs() < 1e-9);
        assert!((joined(feet, metres, None).unwrap() - 30.0 / 0.3048).abs() < 1e-9);
        assert_eq!(joined(metres, feet, feet).unwrap(), 30.0);
        assert_eq!(joined(None, None, None).unwrap(), 30.0);
        let message = joined(metres, None, None).unwrap_err().to_string();
        assert!(message.contains("a.laz names") && message.contains("b.laz does not"), "{message}");
    }

    #[test]
    fn issue_2_the_user_s_crs_makes_up_for_keys_that_are_not_understood() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys.las");
        let keys = [1_u16, 1, 0, 1, 1024, 0, 1, 1].iter().flat_map(|k| k.to_le_bytes()).collect();
        std::fs::write(&path, las::tests::with_records(&[(34735, keys)])).unwrap();
        let read = |crs: Option<Crs>| {
            let mut request = ImportRequest::new(vec![path.clone()], PathBuf::new());
            request.terrain.crs = crs;
            let reporter = Reporter::silent();
            read_clouds(&request, &Limits::default(), &reporter, &reporter.stage("read", 0))
        };
        assert!(read(None).unwrap_err().to_string().contains("--crs"));
        assert_eq!(read(Some(Crs::Epsg(32633))).unwrap().len(), 1);
    }
}
