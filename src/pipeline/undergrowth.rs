//! Undergrowth and forest floor of a scene, under the canopy trees that were grown for it.

use std::path::PathBuf;
use std::sync::Arc;

use super::Error;
use super::scene_files::{StageFiles, mean};
use crate::canopy::learned::bare::CLIFF_SLOPE;
use crate::canopy::site::Site;
use crate::forest_floor::{self, ForestFloor, water};
use crate::io;
use crate::math;
use crate::plants::Plants;
use crate::plants::table::{MAX_PLANTS, TableFormat};
use crate::progress::{Reporter, Warning};
use crate::raster::{Frame, Grid, MapWindow, Mask};
use crate::scene::{StageEntry, Transaction};
use crate::simulation::Parameters;
use crate::species::Biome;
use crate::terrain::Terrain;
use crate::undergrowth::refinement::{self, Area, RefinementFigures};
use crate::undergrowth::statistics::StatisticsError;
use crate::undergrowth::{self, Conditions, Statistics, Synthesis, Trees, Undergrowth, sampling};

/// Name of the stage in `scene.toml`.
pub const STAGE: &str = "undergrowth";
/// Name of the stage of grass and litterfall.
pub const FLOOR_STAGE: &str = "forest_floor";

/// What undergrowth is refined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refine {
    /// All of it.
    All,
    /// What stands in a window of the map.
    Within(MapWindow),
}

/// How undergrowth is grown.
#[derive(Clone, Debug, Default)]
pub struct UndergrowthRequest {
    /// Whether there is to be none.
    pub is_off: bool,
    /// Statistics of one's own, from `wildwood statistics`; else the biome's built-in ones.
    pub statistics: Option<PathBuf>,
    /// What is refined, if anything.
    pub refine: Option<Refine>,
}

/// What undergrowth and floor are grown on, all on one frame.
pub struct UndergrowthInput<'a> {
    /// The ground.
    pub terrain: &'a Terrain,
    /// What it offers over the year.
    pub site: &'a Site,
    /// How it suits grass.
    pub grass_suitability: &'a Grid<f32>,
    /// Where water runs.
    pub discharge_m3_s: &'a Grid<f32>,
    /// Where plants may stand.
    pub allowed: &'a Mask,
    /// The species.
    pub biome: &'a Biome,
    /// The canopy trees.
    pub canopy: &'a Plants,
}

/// Grown undergrowth, and the floor under all plants.
#[derive(Clone, Debug)]
pub struct GrownUndergrowth {
    /// All plants of the scene: the canopy first.
    pub plants: Plants,
    /// How many of them are undergrowth.
    pub undergrowth: usize,
    /// What refinement did, if it was asked for.
    pub refinement: Option<RefinementFigures>,
    /// Grass and litterfall.
    pub floor: ForestFloor,
}

impl UndergrowthRequest {
    /// The statistics, and the hash of their text; none where there is to be no undergrowth, or, with a warning, where none of those
    /// that are built in fit a biome of one's own.
    ///
    /// # Errors
    /// A file that cannot be read, or that is of another biome.
    pub fn read_statistics(
        &self,
        biome: &Biome,
        reporter: &Reporter,
    ) -> Result<Option<(Statistics, String)>, Error> {
        if self.is_off {
            return Ok(None);
        }
        let parse = |text: &str| Ok((Statistics::parse(text, biome)?, super::import::key(&[text])));
        if let Some(path) = &self.statistics {
            let text = std::fs::read_to_string(path)
                .map_err(|source| io::Error::Read { path: path.clone(), source })?;
            let in_file = |e: StatisticsError| format!("{}: {e}", path.display());
            return parse(&text).map(Some).map_err(|e| Error::Usage { what: in_file(e) });
        }
        let built_in = Statistics::builtin_json(biome).and_then(parse);
        if is_built_in(biome) {
            let of_program = |e| Error::Usage { what: format!("built-in statistics: {e}") };
            return built_in.map(Some).map_err(of_program);
        }
        let text = if built_in.is_ok() { OF_OTHERS } else { NONE_FIT };
        reporter.warn(Warning::Other { text: text.to_owned() });
        Ok(built_in.ok())
    }
}

/// Warnings where a biome of one's own has no statistics of its own: its species are built in, with other values, or they are not.
const OF_OTHERS: &str = "undergrowth is that of the built-in species; make statistics of your own (wildwood statistics --biome FILE -o statistics.json, some minutes) and give them with --undergrowth-statistics";
const NONE_FIT: &str = "no undergrowth: no statistics of these species are built in; make them (wildwood statistics --biome FILE -o statistics.json, some minutes) and give them with --undergrowth-statistics";

/// Whether a biome's plants are those of a built-in one; its climate may be another.
fn is_built_in(biome: &Biome) -> bool {
    Biome::builtin(&biome.key).is_ok_and(|origin| {
        origin.species == biome.species && origin.sub_biomes == biome.sub_biomes
    })
}

/// Grows undergrowth, and the forest floor under all plants.
///
/// # Errors
/// A cancelled run, or an area to refine that is not in the scene.
pub fn grow(
    input: &UndergrowthInput<'_>,
    statistics: Option<&Statistics>,
    refine: Option<Refine>,
    seed: u64,
    reporter: &Reporter,
) -> Result<GrownUndergrowth, Error> {
    let mut plants = input.canopy.clone();
    let (mut count, mut refinement) = (0, None);
    let dry = Arc::new(water::dry_land(input.discharge_m3_s));
    if let Some(statistics) = statistics {
        let biome = input.biome;
        let conditions =
            Conditions::under(input.canopy, input.site, biome, &Parameters::undergrowth(biome));
        let frame = input.terrain.elevation_m.frame();
        let trees = Trees::of(input.canopy, frame.rows as f32 * frame.cell_m());
        let may_grow = |cell: usize| {
            let is_cliff = math::tan(input.site.slope_rad.values()[cell]) >= CLIFF_SLOPE;
            input.allowed.is_valid(cell) && dry.is_valid(cell) && !is_cliff
        };
        let allowed = Mask::new((0..frame.len()).map(may_grow).collect());
        let synthesis = Synthesis {
            conditions: &conditions,
            allowed: &allowed,
            trees: &trees,
            statistics,
            biome,
            seed,
        };
        let mut grown = sampling::sample(&synthesis, reporter)?;
        if let Some(refine) = refine {
            let area = match refine {
                Refine::All => None,
                Refine::Within(window) => Some(area(&window, frame)?),
            };
            refinement = Some(refinement::refine(&mut grown, &synthesis, area, reporter)?);
        }
        tell_of_nothing(&grown, input, reporter);
        count = grown.disks.len();
        if plants.len() + count > MAX_PLANTS {
            let what = format!(
                "{count} undergrowth plants: more than the {MAX_PLANTS} of a scene; grow parts of it (--bbox), or leave undergrowth out (--no-undergrowth)"
            );
            return Err(Error::Usage { what });
        }
        plants.append(undergrowth::plants(grown, &conditions, &input.terrain.elevation_m, biome));
    }
    let floor = forest_floor::run(
        input.grass_suitability,
        &dry,
        input.allowed,
        &plants,
        input.biome,
        &forest_floor::Params::default(),
        reporter,
    )?;
    Ok(GrownUndergrowth { plants, undergrowth: count, refinement, floor })
}

fn tell_of_nothing(grown: &Undergrowth, input: &UndergrowthInput<'_>, reporter: &Reporter) {
    if grown.disks.is_empty() && !input.canopy.is_empty() {
        let text = "no undergrowth: nothing of the biome grows under this canopy".to_owned();
        reporter.warn(Warning::Other { text });
    }
}

/// Refuses an area to refine that is not in the scene.
///
/// # Errors
/// If it is not.
pub(super) fn check(refine: Option<Refine>, frame: &Frame) -> Result<(), Error> {
    match refine {
        Some(Refine::Within(window)) => area(&window, frame).map(drop),
        _ => Ok(()),
    }
}

/// The part of a scene that a window shows.
fn area(window: &MapWindow, frame: &Frame) -> Result<Area, Error> {
    let transform = frame.transform;
    let (width_m, height_m) =
        (frame.cols as f64 * transform.cell_m, frame.rows as f64 * transform.cell_m);
    let scene = MapWindow {
        west: transform.west_m,
        south: transform.north_m - height_m,
        east: transform.west_m + width_m,
        north: transform.north_m,
    };
    let Some(inside) = window.intersection(&scene) else {
        let what = format!("--refine-area {window} lies outside the scene, which is {scene}");
        return Err(Error::Usage { what });
    };
    // within a scene f32 holds millimetres
    Ok(Area {
        west_m: (inside.west - scene.west) as f32,
        north_m: (scene.north - inside.north) as f32,
        east_m: (inside.east - scene.west) as f32,
        south_m: (scene.north - inside.south) as f32,
    })
}

/// Writes plants, grass and litterfall; gives the entries of both stages.
pub(super) fn write(
    input: &UndergrowthInput<'_>,
    grown: &GrownUndergrowth,
    request: &UndergrowthRequest,
    table: TableFormat,
    key: &str,
    transaction: &mut Transaction,
    reporter: &Reporter,
) -> Result<[(&'static str, StageEntry); 2], Error> {
    let stage = reporter.stage("write plants", 3);
    let frame = input.terrain.elevation_m.frame();
    let mut files = StageFiles::new(transaction);
    // later stages read GeoParquet
    files.plants(&grown.plants, input.biome, frame, TableFormat::Parquet)?;
    if table != TableFormat::Parquet {
        files.plants(&grown.plants, input.biome, frame, table)?;
    }
    stage.advance(1);
    let mut parameters = toml::Table::new();
    parameters.insert("undergrowth".to_owned(), (grown.undergrowth > 0).into());
    if let Some(path) = &request.statistics {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        parameters.insert("statistics".to_owned(), name.into());
    }
    match request.refine.filter(|_| grown.refinement.is_some()) {
        None => {}
        Some(Refine::All) => drop(parameters.insert("refine".to_owned(), "all".into())),
        Some(Refine::Within(window)) => {
            parameters.insert("refine".to_owned(), window.to_string().into());
        }
    }
    let undergrowth = files.into_entry(key.to_owned(), parameters, figures(input, grown));

    let ForestFloor { grass_height_m, litterfall } = &grown.floor;
    let mut files = StageFiles::new(transaction);
    files.grid("grass.tif", "grass height", "m", grass_height_m)?;
    stage.advance(1);
    files.grid("litterfall.tif", "ground covered by litter", "", litterfall)?;
    stage.advance(1);
    let mut figures = toml::Table::new();
    for (name, map) in
        [("grass_height_mean_m", grass_height_m), ("litterfall_mean_fraction", litterfall)]
    {
        figures.insert(name.to_owned(), mean(map.values(), map.mask()).into());
    }
    let parameters = super::import::parameters(&forest_floor::Params::default())?;
    let floor = files.into_entry(key.to_owned(), parameters, figures);
    Ok([(STAGE, undergrowth), (FLOOR_STAGE, floor)])
}

fn figures(input: &UndergrowthInput<'_>, grown: &GrownUndergrowth) -> toml::Table {
    let whole = |count: usize| i64::try_from(count).unwrap_or(i64::MAX);
    let mut figures = toml::Table::new();
    let mut add = |name: &str, value: toml::Value| figures.insert(name.to_owned(), value);
    add("plants", whole(grown.undergrowth).into());
    let land = input.terrain.elevation_m.mask().valid_count().max(1) as f64;
    let cell_m = input.terrain.elevation_m.frame().transform.cell_m;
    add("plants_per_ha", (grown.undergrowth as f64 * 1e4 / (land * cell_m * cell_m)).into());
    let mut counts = vec![0; input.biome.species.len()];
    let undergrowth = &grown.plants.species[grown.plants.len() - grown.undergrowth..];
    undergrowth.iter().for_each(|species| counts[usize::from(*species)] += 1);
    let by_key: toml::Table = (input.biome.species.iter().zip(counts))
        .filter(|(_, count)| *count > 0)
        .map(|(species, count)| (species.key.clone(), whole(count).into()))
        .collect();
    add("plants_by_species", by_key.into());
    if let Some(refinement) = &grown.refinement {
        add("refined_plants", whole(refinement.plants).into());
        let differences = refinement.differences.iter().map(|d| toml::Value::from(*d));
        add("pair_differences_by_sweep", differences.collect::<Vec<_>>().into());
    }
    figures
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changed_species_are_told_of_and_new_ones_have_no_statistics() {
        let read = |text: &str| {
            let reporter = Reporter::silent();
            let biome = Biome::from_toml(text).unwrap();
            let read = UndergrowthRequest::default().read_statistics(&biome, &reporter).unwrap();
            let warnings: Vec<String> =
                reporter.warnings().iter().map(ToString::to_string).collect();
            (read.is_some(), warnings)
        };
        let changed = |from: &str, to: &str| {
            let text = Biome::builtin_toml("pyrenees").unwrap();
            assert!(text.contains(from), "{from} is gone");
            text.replace(from, to)
        };
        let drier = changed("soil_capacity_mm = 180.0", "soil_capacity_mm = 90.0");
        assert_eq!(read(&drier), (true, vec![]), "another climate has the same plants");
        let lower = changed("max_height_m = 9.0", "max_height_m = 8.0");
        assert_eq!(read(&lower), (true, vec![OF_OTHERS.to_owned()]));
        let renamed = changed("\"silver-birch\"", "\"downy-birch\"");
        assert_eq!(read(&renamed), (false, vec![NONE_FIT.to_owned()]));
    }
}
