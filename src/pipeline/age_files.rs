//! The files of an aged forest, as stages of a scene.

use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use super::Error;
use super::age::{self, AgeRequest, Ground, GrowthOf, Script};
use super::scene_files::{StageFiles, mean};
use crate::canopy::site::Site;
use crate::canopy::species_map::NO_SPECIES;
use crate::export::preview::{self, CanopyLayer, PreviewMaps, PreviewOptions};
use crate::export::timeline::{self, TimelineMark};
use crate::forest_floor::{self, grass, water};
use crate::plants::deadwood::GrowthRecord;
use crate::plants::table::{self, TableFormat};
use crate::plants::{Layer, Plants, downed_logs_table, history_tables, snags_table};
use crate::progress::Reporter;
use crate::raster::{Grid, Mask};
use crate::scene::{self, StageEntry, Transaction};
use crate::simulation::Parameters;
use crate::simulation::deadwood::DecayParameters;
use crate::simulation::disturbance::schedule::Schedule;
use crate::simulation::disturbance::{Disturbance, Event};
use crate::simulation::forest::Forest;
use crate::species::Biome;

/// How far the surface of a crown has fallen at its edge, as a share of the plant's height. chosen: between a beech's dome and
/// a fir's cone.
const CROWN_FALL_FRACTION: f32 = 0.3;

/// A forest that has been aged.
pub struct Aged<'a> {
    pub forest: &'a Forest,
    pub growth: &'a [GrowthRecord],
    pub events: &'a [Event],
    /// Plants that it began with.
    pub start: &'a Plants,
    pub ground: &'a Ground,
    pub site: Site,
}

/// Parameters as the manifest records them.
pub fn parameters(
    request: &AgeRequest,
    schedule: &Schedule,
    seed: u64,
    biome: &Biome,
) -> Result<toml::Table, Error> {
    let mut parameters = toml::Table::new();
    let mut add = |key: &str, value: toml::Value| parameters.insert(key.to_owned(), value);
    add("years", i64::from(request.years).into());
    add("seed", seed.to_string().into());
    add("bare_ground", request.is_bare.into());
    add("simulation", format!("{:?}", Parameters::forest(biome)).into());
    add("decay", format!("{:?}", DecayParameters::peytavie2024()).into());
    let recorded = match &request.growth_of {
        GrowthOf::None => "none".to_owned(),
        GrowthOf::All => "full".to_owned(),
        GrowthOf::Plants(ids) => format!("{} plants", ids.len()),
    };
    add("growth_of", recorded.into());
    if request.events != Script::None {
        let name = match &request.events {
            Script::File(path) => {
                path.file_name().unwrap_or_default().to_string_lossy().into_owned()
            }
            _ => "built in".to_owned(),
        };
        add("events", name.into());
        add("scripted_events", (schedule.events.len() as i64).into()); // some thousands
        add("recurring_events", (schedule.stochastic.len() as i64).into());
    }
    Ok(parameters)
}

/// Writes plants, deadwood, histories, pictures and forest floor; gives the stage's entry.
pub fn write(
    aged: &Aged<'_>,
    (folder, climate): (&Path, Option<String>),
    (key, parameters): (&str, toml::Table),
    state: &[u8],
    has_csv: bool,
    transaction: &mut Transaction,
    reporter: &Reporter,
) -> Result<StageEntry, Error> {
    let stage = reporter.stage("write forest", 4);
    let Aged { forest, ground, .. } = aged;
    let elevation_m = &ground.terrain.elevation_m;
    let (biome, frame) = (&ground.biome, elevation_m.frame());
    let format = TableFormat::Parquet;
    let plants = forest.plants(elevation_m);
    let deadwood = forest.deadwood(elevation_m);
    age::tell_of_nothing(forest, reporter);

    // tables
    let mut files = StageFiles::new(transaction);
    files.plants(&plants, biome, frame, format)?;
    if has_csv {
        files.plants(&plants, biome, frame, TableFormat::Csv)?;
    }
    if !aged.start.is_empty() {
        files.file(age::START_FILE, |f| table::write(f, aged.start, biome, frame, format))?;
    }
    files.file("snags.parquet", |f| {
        snags_table::write_snags(f, &deadwood.snags, biome, frame, format)
    })?;
    files.file("downed_logs.parquet", |f| {
        downed_logs_table::write_downed_logs(f, &deadwood.downed_logs, biome, frame, format)
    })?;
    let histories = forest.life_histories();
    files.file("history.parquet", |f| history_tables::write_history(f, &histories, format))?;
    files.file("timeline.parquet", |f| {
        history_tables::write_timeline(f, forest.timeline(), biome, format)
    })?;
    if !aged.growth.is_empty() {
        files.file("growth.parquet", |f| history_tables::write_growth(f, aged.growth, format))?;
    }
    files.file(age::STATE_FILE, |f| f.write_all(state))?;
    stage.advance(1);

    // pictures
    let png = |picture: &image::RgbImage| {
        preview::encode_png(picture).map_err(|e| Error::Failed { what: e.to_string() })
    };
    let picture = png(&timeline::timeline(forest.timeline(), biome, &marks(aged.events, biome)))?;
    files.file("timeline.png", |f| f.write_all(&picture))?;
    let (chm_m, species) = canopy(&plants, elevation_m);
    let maps = PreviewMaps {
        sunlight_h: Some(aged.site.sun_h.clone()),
        moisture_mm: Some(aged.site.moisture_mm.clone()),
        discharge_m3_s: Some(ground.maps.discharge_m3_s.clone()),
        canopy: Some(CanopyLayer {
            plants: &plants,
            biome,
            chm_m: &chm_m,
            species: &species,
            deadwood: Some(&deadwood),
        }),
        ..PreviewMaps::default()
    };
    let options = PreviewOptions { title: scene::folder_name(folder), climate };
    files.picture(&options, &ground.terrain, &maps)?;
    stage.advance(1);

    // floor
    let suitability =
        grass::suitability(&ground.maps, &biome.forest_floor, &grass::GrassParams::default());
    let floor_params = forest_floor::Params::default();
    let floor = forest_floor::run(
        &elevation_m.with_values(suitability),
        &Arc::new(water::dry_land(&ground.maps.discharge_m3_s)),
        elevation_m.mask(),
        &plants,
        biome,
        &floor_params,
        &reporter.silenced(),
    )?;
    stage.advance(1);
    files.grid("grass.tif", "grass height", "m", &floor.grass_height_m)?;
    files.grid("litterfall.tif", "ground covered by litter", "", &floor.litterfall)?;
    stage.advance(1);
    let mut figures = figures(aged, &plants);
    for (name, map) in [
        ("grass_height_mean_m", &floor.grass_height_m),
        ("litterfall_mean_fraction", &floor.litterfall),
    ] {
        figures.insert(name.to_owned(), mean(map.values(), map.mask()).into());
    }
    Ok(files.into_entry(key.to_owned(), parameters, figures))
}

/// What the timeline says of events.
pub fn marks(events: &[Event], biome: &Biome) -> Vec<TimelineMark> {
    let mark = |event: &Event| {
        let label = match &event.what {
            Disturbance::Wildfire(_) => "Fire".to_owned(),
            Disturbance::WindStorm(storm) => {
                format!("Storm, {:.0} km/h", 3.6 * storm.speed_m_s())
            }
            Disturbance::Disease(disease) => {
                format!("Disease: {}", biome.species[usize::from(disease.species)].common_name)
            }
            Disturbance::Drought(drought) => {
                format!("Drought, {} months", drought.rain_fractions.len())
            }
        };
        TimelineMark { year: event.year, month: event.month, label }
    };
    events.iter().map(mark).collect()
}

/// Height of the canopy over each cell, and the species of the highest crown there.
fn canopy(plants: &Plants, elevation_m: &Grid<f32>) -> (Grid<f32>, Grid<u8>) {
    let frame = elevation_m.frame();
    let cell_m = frame.cell_m();
    let mut height_m = vec![0.0_f32; frame.len()];
    let mut species = vec![NO_SPECIES; frame.len()];
    let scene_m = frame.rows as f32 * cell_m;
    for plant in (0..plants.len()).filter(|plant| plants.layer[*plant] == Layer::Canopy) {
        let (east_m, south_m) = (plants.east_m[plant], scene_m - plants.north_m[plant]);
        let radius_m = plants.crown_radius_m[plant];
        let span = |at_m: f32, cells: usize| {
            // `as` cuts negatives to 0
            let first = ((at_m - radius_m) / cell_m) as usize;
            first..(((at_m + radius_m) / cell_m) as usize + 1).min(cells)
        };
        for row in span(south_m, frame.rows) {
            for col in span(east_m, frame.cols) {
                let x = ((col as f32 + 0.5) * cell_m - east_m) / radius_m;
                let y = ((row as f32 + 0.5) * cell_m - south_m) / radius_m;
                let away = x * x + y * y;
                let top_m = plants.height_m[plant] * (1.0 - CROWN_FALL_FRACTION * away);
                let cell = row * frame.cols + col;
                if away <= 1.0 && top_m > height_m[cell] {
                    height_m[cell] = top_m;
                    species[cell] = plants.species[plant] as u8; // biomes have some dozens
                }
            }
        }
    }
    let chm_m = elevation_m.with_values(height_m);
    let mask: &Arc<Mask> = elevation_m.mask();
    (chm_m, Grid::new(Arc::clone(frame), Arc::clone(mask), species))
}

fn figures(aged: &Aged<'_>, plants: &Plants) -> toml::Table {
    let forest = aged.forest;
    let mut figures = toml::Table::new();
    let mut add = |key: &str, value: toml::Value| figures.insert(key.to_owned(), value);
    let whole = |n: usize| toml::Value::from(i64::try_from(n).unwrap_or(i64::MAX));
    let last = forest.timeline().iter().filter(|row| row.year == forest.year());
    let (mut live, mut snags, mut downed_logs) = (0.0, 0.0, 0.0);
    for row in last {
        live += f64::from(row.live_m2_ha);
        snags += f64::from(row.snag_m2_ha);
        downed_logs += f64::from(row.downed_log_m2_ha);
    }
    let trees = plants.layer.iter().filter(|layer| **layer == Layer::Canopy).count();
    add("years", i64::from(forest.year()).into());
    add("plants", whole(plants.len()));
    add("trees", whole(trees));
    add("snags", whole(forest.stock().snags.len()));
    add("downed_logs", whole(forest.stock().downed_logs.len()));
    add("live_basal_area_m2_ha", live.into());
    add("snag_basal_area_m2_ha", snags.into());
    add("downed_log_basal_area_m2_ha", downed_logs.into());
    let burnt = forest.burnt_m2().iter();
    let burnt_ha = burnt.map(|(_, m2)| toml::Value::from(f64::from(*m2) / 10_000.0));
    add("burnt_ha", burnt_ha.collect::<Vec<_>>().into());
    let tally = forest.tally();
    add("sprouted", whole(usize::try_from(tally.sprouted).unwrap_or(usize::MAX)));
    add("died", whole(usize::try_from(tally.died).unwrap_or(usize::MAX)));
    figures
}
