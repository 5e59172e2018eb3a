//! A scene's forest over centuries: plants, snags, downed logs and their histories into its folder.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::age_files::{self, Aged};
use super::checkpoint::{self, Checkpoint};
use super::scene_files::read_plants_of;
use super::{Error, biome_file, close_up, grow, import, undergrowth};
use crate::abiotics::{self, AbioticMaps};
use crate::canopy::site::Site as MeanSite;
use crate::io::{self, ParseError};
use crate::plants::Plants;
use crate::plants::deadwood::GrowthRecord;
use crate::progress::{Reporter, Warning};
use crate::raster::{Frame, MONTHS};
use crate::scene::{self, Manifest, Transaction};
use crate::simulation::deadwood::DecayParameters;
use crate::simulation::disturbance::schedule::{self, Schedule};
use crate::simulation::disturbance::{Disturbance, Event};
use crate::simulation::forest::{Forest, RECORDED_HEIGHT_M, Site};
use crate::simulation::{Parameters, Plot};
use crate::species::{Biome, Climate};
use crate::terrain::Terrain;

/// Name of the stage in `scene.toml`.
pub const STAGE: &str = "age";
/// Plants that a scene's forest was aged from.
pub const START_FILE: &str = "plants_at_start.parquet";
/// What a longer run goes on from.
pub(super) const STATE_FILE: &str = "age_state.bin";
/// What an interrupted run goes on from; no stage owns it.
const CHECKPOINT_FILE: &str = "age_checkpoint.bin";
/// Plants for programs that read text, where a scene has them.
const CSV_FILE: &str = "plants.csv";
/// Ids from here on leave no room for seedlings'.
const MOST_ID: u64 = 1 << 62;
/// Most years. chosen: oaks of a thousand years, ten times over.
pub const MOST_YEARS: u16 = 10_000;

/// Whose yearly growth is recorded.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum GrowthOf {
    /// Nobody's.
    #[default]
    None,
    /// Plants of these ids.
    Plants(Vec<u64>),
    /// All that are as high as a breast.
    All,
}

/// Where disturbances come from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Script {
    /// There are none.
    #[default]
    None,
    /// A file.
    File(PathBuf),
    /// The text of one.
    Text(String),
}

/// A forest to age.
#[derive(Clone, Debug)]
pub struct AgeRequest {
    /// The scene.
    pub folder: PathBuf,
    /// Scene folder that the aged forest goes to, if not its own.
    pub output: Option<PathBuf>,
    /// Years from the start.
    pub years: u16,
    /// Whether to begin from bare ground whatever grows there.
    pub is_bare: bool,
    /// Script of disturbances.
    pub events: Script,
    /// The seed; none takes the scene's.
    pub seed: Option<u64>,
    /// Years between checkpoints.
    pub checkpoint_years: u16,
    /// Whose growth is recorded.
    pub growth_of: GrowthOf,
}

impl AgeRequest {
    /// Years of a scene's forest without events.
    pub fn new(folder: PathBuf, years: u16) -> Self {
        Self {
            folder,
            output: None,
            years,
            is_bare: false,
            events: Script::None,
            seed: None,
            checkpoint_years: 25,
            growth_of: GrowthOf::None,
        }
    }
}

/// A scene with what its forest stands on.
pub(super) struct Ground {
    pub terrain: Terrain,
    pub maps: AbioticMaps,
    pub biome: Biome,
    climate: Climate,
    params: abiotics::Params,
}

/// Ages a scene's forest, or does nothing where it is that old; gives the manifest and the folder.
///
/// # Errors
/// Bad input, told before anything is written; a full disk; a cancelled run, which goes on from its last checkpoint when it is
/// started again.
pub fn run(request: &AgeRequest, reporter: &Reporter) -> Result<(Manifest, PathBuf), Error> {
    let usage = |what: String| Err(Error::Usage { what });
    if request.years == 0 || request.years > MOST_YEARS {
        return usage(format!("--years {}: give 1 to {MOST_YEARS}", request.years));
    }
    if request.checkpoint_years == 0 {
        return usage("--checkpoint 0: give a year or more".to_owned());
    }
    let Some(mut manifest) = Manifest::read(&request.folder)? else {
        return usage(format!(
            "{}: no scene folder; make one with wildwood import or wildwood grow",
            request.folder.display()
        ));
    };
    let biome = biome_file::of_scene(&request.folder, &manifest)?;
    let schedule = read_schedule(request, &biome)?;
    let folder = match &request.output {
        Some(output) => output.clone(),
        None => request.folder.clone(),
    };
    // a copy is made once all that it is made from has been read
    let from = match matching(&folder, &manifest, request)? {
        Some(there) => {
            manifest = there;
            folder.clone()
        }
        None => request.folder.clone(),
    };
    let is_copied = from != folder;
    // the scene's own seed stays that of what was grown
    let seed = request.seed.unwrap_or(manifest.scene.seed);

    // what the forest depends on
    let kept = start_file(&from, &manifest)?;
    let start_hash = match kept.filter(|_| !request.is_bare) {
        Some(name) => {
            scene::hash_file(&from.join(name))
                .map_err(|source| scene::Error::Read { path: from.join(name), source })?
                .0
        }
        None => "bare ground".to_owned(),
    };
    let of_stage = |stage: &str| manifest.stages.get(stage).map(|entry| entry.key.clone());
    let (Some(terrain_key), Some(abiotics_key)) = (terrain_key(&manifest), of_stage("abiotics"))
    else {
        return usage(format!(
            "{}: holds no terrain and abiotic maps; make them with wildwood import",
            from.display()
        ));
    };
    let (parameters, decay) = (Parameters::forest(&biome), DecayParameters::peytavie2024());
    let key = import::key(&[
        STAGE,
        &terrain_key,
        &abiotics_key,
        &start_hash,
        &format!("{biome:?} {seed} {parameters:?} {decay:?} {schedule:?} {:?}", request.growth_of),
    ]);
    let stage_key = import::key(&[&key, &request.years.to_string()]);
    if manifest.is_current(&from, STAGE, &stage_key)? {
        if is_copied {
            manifest = copied(&from, &folder, &manifest)?;
        }
        return Ok((manifest, folder));
    }

    // live
    let ground = Ground::read(&from, &manifest, biome, reporter)?;
    let frame = Arc::clone(ground.terrain.elevation_m.frame());
    // plants of the scene stay on file, whatever the forest begins with
    let plants = match kept {
        Some(name) => read_plants_of(&from.join(name), &ground.biome, &frame)?,
        None => Plants::default(),
    };
    if let Some(id) = plants.id.iter().find(|id| **id >= MOST_ID) {
        return usage(format!(
            "plant {id}: seedlings get ids above all others, and there is no room above 2⁶²; number the plants anew"
        ));
    }
    if is_copied {
        manifest = copied(&from, &folder, &manifest)?;
    }
    let nobody = Plants::default();
    let begins_with = if request.is_bare { &nobody } else { &plants };
    let forest = ground.bare_forest(parameters, decay, seed)?;
    let (mut forest, mut growth) =
        resume(&folder, &key, request.years, forest, begins_with, &frame, reporter);
    let events = schedule::drawn(&schedule, request.years, seed);
    let stage = reporter.stage("age", u64::from(request.years));
    stage.advance(u64::from(forest.year()));
    let mut keep = |forest: &Forest| {
        let year = forest.year();
        record_growth(forest, &request.growth_of, &mut growth);
        stage.advance(1);
        let is_due = year.is_multiple_of(request.checkpoint_years) && year < request.years;
        let is_cancelled = reporter.check_cancelled();
        if is_due || is_cancelled.is_err() {
            let bytes = checkpoint::to_bytes(&key, forest, &growth)?;
            scene::write_beside(&folder.join(CHECKPOINT_FILE), &bytes)?;
        }
        is_cancelled.map_err(|_| Error::Stopped { year })
    };
    ground.live(&mut forest, &events, request.years, reporter, &mut keep)?;
    drop(stage);
    tell_of_strangers(&request.growth_of, begins_with, &forest, reporter);

    // write
    let mut transaction = Transaction::begin(&folder)?;
    let state = checkpoint::to_bytes(&key, &forest, &growth)?;
    let aged = Aged {
        forest: &forest,
        growth: &growth,
        events: &events,
        start: &plants,
        ground: &ground,
        site: MeanSite::of(&ground.maps),
    };
    let has_csv = manifest.files().any(|file| file == CSV_FILE);
    let entry = age_files::write(
        &aged,
        (&folder, import::climate_name(&manifest)),
        (&stage_key, age_files::parameters(request, &schedule, seed, &ground.biome)?),
        &state,
        has_csv,
        &mut transaction,
        reporter,
    )?;
    grow::record(&mut manifest, STAGE, entry);
    if let Script::File(path) = &request.events {
        let inputs = import::hash_inputs(std::slice::from_ref(path))?;
        let new = inputs.into_iter().filter(|input| !manifest.inputs.contains(input));
        let new: Vec<scene::Input> = new.collect();
        manifest.inputs.extend(new);
    }
    transaction.commit(&manifest)?;
    discard_checkpoint(&folder);
    close_up::discard(&folder);
    Ok((manifest, folder))
}

/// The schedule of a request, checked whole.
fn read_schedule(request: &AgeRequest, biome: &Biome) -> Result<Schedule, Error> {
    let (text, name) = match &request.events {
        Script::None => return Ok(Schedule::default()),
        Script::Text(text) => (text.clone(), "the script".to_owned()),
        Script::File(path) => {
            let text = fs::read_to_string(path).map_err(|source| match source.kind() {
                std::io::ErrorKind::InvalidData => {
                    ParseError::new("it is no text", "give a script of events in TOML").at(path)
                }
                _ => io::Error::Read { path: path.clone(), source },
            })?;
            (text, path.display().to_string())
        }
    };
    let keys: Vec<String> = biome.species.iter().map(|species| species.key.clone()).collect();
    schedule::parse_within(&text, &keys, request.years)
        .map_err(|e| Error::Usage { what: format!("{name}: {e}") })
}

/// Takes the state away that an interrupted run would go on from.
pub(super) fn discard_checkpoint(folder: &Path) {
    // one that stays harms nobody
    let _ = fs::remove_file(folder.join(CHECKPOINT_FILE));
}

/// The table of plants that a scene's forest is aged from, if it has one.
fn start_file(folder: &Path, manifest: &Manifest) -> Result<Option<&'static str>, Error> {
    let is_aged = manifest.stages.contains_key(STAGE);
    let name = if is_aged { START_FILE } else { close_up::PLANTS_FILE };
    if !manifest.files().any(|file| file == name) {
        return Ok(None);
    }
    let path = folder.join(name);
    if !path.exists() {
        let what = format!(
            "{}: is gone; put it back, grow the forest again, or begin from --bare ground",
            path.display()
        );
        return Err(Error::Usage { what });
    }
    Ok(Some(name))
}

/// What tells a terrain from others: its stage's key, which made-up scenes leave empty, and its file.
fn terrain_key(manifest: &Manifest) -> Option<String> {
    let entry = manifest.stages.get("terrain")?;
    Some(format!("{} {:?}", entry.key, entry.files.get("terrain.tif")))
}

/// The scene that is in the output's folder already, if it is of the same ground.
fn matching(
    to: &Path,
    manifest: &Manifest,
    request: &AgeRequest,
) -> Result<Option<Manifest>, Error> {
    if request.output.is_none() {
        return Ok(None);
    }
    let key_of = |manifest: &Manifest, stage: &str| {
        manifest.stages.get(stage).map(|entry| entry.key.clone())
    };
    if let Some(there) = Manifest::read(to)? {
        let is_same = ["abiotics", grow::STAGE, undergrowth::STAGE]
            .iter()
            .all(|stage| key_of(&there, stage) == key_of(manifest, stage));
        let is_same_ground = terrain_key(&there) == terrain_key(manifest)
            && there.scene.biome == manifest.scene.biome;
        if is_same && is_same_ground {
            return Ok(Some(there));
        }
        let what = format!(
            "-o {}: holds another scene; give a folder that does not exist yet",
            to.display()
        );
        return Err(Error::Usage { what });
    }
    Ok(None)
}

/// A copy of a scene in another folder.
fn copied(from: &Path, to: &Path, manifest: &Manifest) -> Result<Manifest, Error> {
    let mut transaction = Transaction::begin(to)?;
    for name in manifest.files() {
        let path = from.join(name);
        let mut source = fs::File::open(&path)
            .map_err(|source| scene::Error::Read { path: path.clone(), source })?;
        transaction.write(name, |file| std::io::copy(&mut source, file).map(drop))?;
    }
    let mut copy = manifest.clone();
    copy.scene.name = scene::folder_name(to);
    transaction.commit(&copy)?;
    Ok(copy)
}

/// The forest to go on with: from the state of a finished run or a checkpoint, whichever has lived longer, else from its start.
fn resume(
    folder: &Path,
    key: &str,
    years: u16,
    mut bare: Forest,
    plants: &Plants,
    frame: &Frame,
    reporter: &Reporter,
) -> (Forest, Vec<GrowthRecord>) {
    // one that cannot be read is none: the years are lived again
    let read = |name: &str| Checkpoint::from_bytes(&fs::read(folder.join(name)).ok()?);
    let states: Vec<Checkpoint> =
        [STATE_FILE, CHECKPOINT_FILE].into_iter().filter_map(read).collect();
    let most_years = states.iter().map(Checkpoint::year).max();
    let fits = |state: &Checkpoint| state.key == key && state.year() <= years;
    let latest = states.into_iter().filter(fits).max_by_key(Checkpoint::year);
    if let Some(checkpoint) = latest
        && bare.set_state(checkpoint.state)
    {
        return (bare, checkpoint.growth);
    }
    if let Some(most_years) = most_years {
        let text = format!(
            "the forest begins anew: the {most_years} years that it has are of another script, start, seed or --history, or more than are asked for"
        );
        reporter.warn(Warning::Other { text });
    }
    let forest = if plants.is_empty() { bare } else { bare.with_plants(plants, frame) };
    (forest, Vec::new())
}

/// Most ids that a warning names.
const MOST_NAMED: usize = 5;

/// Warns of plants whose growth was asked for and that never lived.
fn tell_of_strangers(of: &GrowthOf, began: &Plants, forest: &Forest, reporter: &Reporter) {
    let GrowthOf::Plants(ids) = of else { return };
    let lived = forest.history().iter().map(|event| event.plant_id);
    let known: BTreeSet<u64> =
        began.id.iter().chain(&forest.community().id).copied().chain(lived).collect();
    let strangers: Vec<String> =
        ids.iter().filter(|id| !known.contains(id)).map(u64::to_string).collect();
    if let Some(named) = strangers.chunks(MOST_NAMED).next() {
        let more = strangers.len() - named.len();
        let and = if more > 0 { format!(" and of {more} others") } else { String::new() };
        let text = format!(
            "--history: no plant of id {}{and} lived in these years; ids are those of plants.parquet",
            named.join(", ")
        );
        reporter.warn(Warning::Other { text });
    }
}

fn record_growth(forest: &Forest, of: &GrowthOf, growth: &mut Vec<GrowthRecord>) {
    let community = forest.community();
    let mut record = |plant: usize| {
        growth.push(GrowthRecord {
            plant_id: community.id[plant],
            year: forest.year(),
            height_m: community.height_m[plant],
            crown_radius_m: community.crown_radius_m[plant],
            dbh_m: community.dbh_m[plant],
            vigor: community.vigor[plant],
            carbon_pool: community.carbon_pool[plant],
        });
    };
    match of {
        GrowthOf::None => {}
        GrowthOf::All => {
            (0..community.len())
                .filter(|p| community.height_m[*p] >= RECORDED_HEIGHT_M)
                .for_each(record);
        }
        GrowthOf::Plants(ids) => {
            let mut ids = ids.clone();
            ids.sort_unstable();
            let is_asked = |p: &usize| ids.binary_search(&community.id[*p]).is_ok();
            (0..community.len()).filter(is_asked).for_each(&mut record);
        }
    }
}

impl Ground {
    /// Terrain in its biome's climate.
    pub(super) fn of(terrain: Terrain, biome: Biome, reporter: &Reporter) -> Result<Self, Error> {
        let (climate, params) = (biome.climate.clone(), abiotics::Params::default());
        let maps = abiotics::run(&terrain, &climate, &params, reporter)?;
        Ok(Self { terrain, maps, biome, climate, params })
    }

    /// Lives through the years up to one, with what of these events falls into them; `after` sees the forest at the end of each.
    pub(super) fn live(
        &self,
        forest: &mut Forest,
        events: &[Event],
        years: u16,
        reporter: &Reporter,
        after: &mut dyn FnMut(&Forest) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let frame = self.terrain.elevation_m.frame();
        let droughts = Droughts::of(events);
        let mut weather = forest.rain_fraction();
        while forest.year() < years {
            let year = forest.year() + 1;
            let rain = droughts.rain_fraction(year);
            if rain != weather {
                let moisture_mm = self.moisture_mm(rain, reporter)?;
                forest.set_moisture(frame, &moisture_mm, rain);
                weather = rain;
            }
            let of_year: Vec<Event> =
                events.iter().filter(|event| event.year == year).cloned().collect();
            forest.live_a_year(&of_year);
            after(forest)?;
        }
        Ok(())
    }

    fn read(
        folder: &Path,
        manifest: &Manifest,
        biome: Biome,
        reporter: &Reporter,
    ) -> Result<Self, Error> {
        let terrain = import::load_terrain(folder, manifest)?;
        let recorded = &manifest.stages.get("abiotics").map(|entry| entry.parameters.clone());
        let recorded = recorded.clone().unwrap_or_default();
        let broken = |e: toml::de::Error| {
            Error::from(scene::Error::Manifest {
                path: folder.join("scene.toml"),
                problem: format!("parameters of abiotics: {}", e.message()),
            })
        };
        let climate = match recorded.get("climate") {
            Some(climate) => climate.clone().try_into().map_err(broken)?,
            None => biome.climate.clone(),
        };
        let params: abiotics::Params = toml::Value::Table(recorded).try_into().map_err(broken)?;
        let maps = abiotics::run(&terrain, &climate, &params, reporter)?;
        Ok(Self { terrain, maps, biome, climate, params })
    }

    pub(super) fn bare_forest(
        &self,
        parameters: Parameters,
        decay: DecayParameters,
        seed: u64,
    ) -> Result<Forest, Error> {
        let frame = self.terrain.elevation_m.frame();
        let cells =
            frame.len() as f64 * (frame.transform.cell_m / f64::from(parameters.cell_m)).powi(2);
        if cells >= f64::from(u32::MAX) {
            let what = "a scene of more than 1,000 km²: age parts of it (import with --bbox)";
            return Err(Error::Usage { what: what.to_owned() });
        }
        let plot = Plot::open(&self.maps, self.maps.river.values(), &self.biome, &parameters);
        let site = Site { plot, elevation_m: &self.terrain.elevation_m, biome: &self.biome };
        Ok(Forest::new(site, parameters, decay, seed))
    }

    /// Soil water of years in which these shares of the usual rain fall, month by month.
    ///
    /// # Departures
    /// The moisture model knows years that repeat: a drought's year is one, its soil as dry in January as it ends in
    /// December. Soils drain within two months, so only the months beside a drought's ends differ.
    fn moisture_mm(
        &self,
        rain_fraction: [f32; MONTHS],
        reporter: &Reporter,
    ) -> Result<crate::raster::MonthlyGrid, Error> {
        let mut climate = self.climate.clone();
        climate.rain_mm.iter_mut().zip(rain_fraction).for_each(|(mm, share)| *mm *= share);
        let maps = &self.maps;
        Ok(abiotics::moisture_of(
            &self.terrain,
            maps,
            &climate,
            &self.params,
            &reporter.silenced(),
        )?)
    }
}

/// Rain of years with droughts.
struct Droughts {
    /// Share of the usual rain by month from January of year 1.
    rain_fractions: Vec<f32>,
}

impl Droughts {
    fn of(events: &[Event]) -> Self {
        let mut rain_fractions = Vec::new();
        for event in events {
            let Disturbance::Drought(drought) = &event.what else { continue };
            let first = (usize::from(event.year) - 1) * MONTHS + usize::from(event.month) - 1;
            for (month, fraction) in (first..).zip(&drought.rain_fractions) {
                if rain_fractions.len() <= month {
                    rain_fractions.resize(month + 1, 1.0);
                }
                rain_fractions[month] = f32::min(rain_fractions[month], *fraction);
            }
        }
        Self { rain_fractions }
    }

    /// Of two droughts at once the drier counts.
    fn rain_fraction(&self, year: u16) -> [f32; MONTHS] {
        let first = (usize::from(year) - 1) * MONTHS;
        std::array::from_fn(|month| self.rain_fractions.get(first + month).copied().unwrap_or(1.0))
    }
}

/// Warns where nothing lives at the end.
pub(super) fn tell_of_nothing(forest: &Forest, reporter: &Reporter) {
    if forest.community().is_empty() {
        let text = "nothing lives: no species of the biome bears this ground".to_owned();
        reporter.warn(Warning::Other { text });
    }
}
