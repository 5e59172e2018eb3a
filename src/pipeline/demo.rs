//! A generated landscape and its trees into a scene folder.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::biome_file::ChosenBiome;
use super::grow::{self, CanopyInput, CanopyRequest};
use super::import::{self, ImportRequest, MadeMaps, ReadTerrain};
use super::undergrowth::{self, UndergrowthInput, UndergrowthRequest};
use super::{Error, close_up};
use crate::canopy::shares::Shares;
use crate::canopy::site::Site;
use crate::forest_floor::grass;
use crate::progress::Reporter;
use crate::scene::{self, Manifest, SceneHead, Transaction};
use crate::terrain::generate::{self, GenerateParams};
use crate::{abiotics, canopy};

/// Generates a landscape, makes its maps, its trees and its picture, and gives its manifest.
///
/// # Errors
/// If the folder cannot be written, or the run is cancelled.
pub fn run(
    folder: PathBuf,
    biome: &str,
    terrain: &GenerateParams,
    reporter: &Reporter,
) -> Result<Manifest, Error> {
    if Manifest::read(&folder)?.is_some_and(|scene| !scene.inputs.is_empty()) {
        return Err(scene::Error::RealScene { path: folder }.into());
    }
    let chosen = ChosenBiome::read(biome)?;
    let climate = chosen.biome.climate.clone();
    let request = ImportRequest {
        biome: biome.to_owned(),
        seed: Some(terrain.seed),
        ..ImportRequest::new(Vec::new(), folder)
    };
    let generated = GenerateParams { latitude_deg: climate.latitude_deg, ..terrain.clone() };
    let mut transaction = Transaction::begin(&request.folder)?;
    let read = ReadTerrain { terrain: generate::generate(&generated, reporter)?, canopy: None };
    let maps = abiotics::run(&read.terrain, &climate, &request.abiotics, reporter)?;
    let mut parameters = toml::Table::new();
    parameters.insert("generated_relief_m".to_owned(), f64::from(terrain.relief_m).into());
    let key = String::new(); // generated anew each time: it takes a second
    let entry = import::write_terrain(&read, &mut transaction, key.clone(), parameters)?;
    let mut stages = BTreeMap::new();
    stages.insert("terrain".to_owned(), entry);
    let made = MadeMaps {
        terrain: &read.terrain,
        climate: &climate,
        own_biome: chosen.own_text.as_deref(),
        maps: &maps,
    };
    let entry = import::write_abiotics(&made, &mut transaction, key, &request, reporter)?;
    stages.insert("abiotics".to_owned(), entry);
    let scene = SceneHead::new(&request.folder, &read.terrain, &chosen.biome.key, terrain.seed);
    let mut manifest = Manifest { scene, inputs: Vec::new(), stages };

    // trees on a canopy of its own
    let species = chosen.biome;
    let site = Site::of(&maps);
    let canopy = canopy::generate::GenerateParams { seed: terrain.seed, ..Default::default() };
    let chm_m = canopy::generate::generate(&read.terrain, &site, &canopy, reporter)?;
    let input = CanopyInput::made_up(&read.terrain, &site, &chm_m, &species);
    let text = shares(biome);
    let shares =
        text.map_or_else(|| Ok(Shares::default()), |text| Shares::parse(text, &species))?;
    let canopy_request = CanopyRequest::default();
    let grown = grow::grow(&input, shares, terrain.seed, &canopy_request, reporter)?;
    let mut parameters = import::parameters(&canopy)?;
    if let Some(text) = text {
        parameters.insert("shares".to_owned(), text.into());
    }
    let suitability =
        grass::suitability(&maps, &species.forest_floor, &grass::GrassParams::default());
    let beneath = UndergrowthInput {
        terrain: &read.terrain,
        site: &site,
        grass_suitability: &maps.slope_rad.with_values(suitability),
        discharge_m3_s: &maps.discharge_m3_s,
        allowed: read.terrain.elevation_m.mask(),
        biome: &species,
        canopy: &grown.plants,
    };
    let undergrowth_request = UndergrowthRequest::default();
    let statistics = undergrowth_request.read_statistics(&species, reporter)?;
    let undergrowth = undergrowth::grow(
        &beneath,
        statistics.as_ref().map(|s| &s.0),
        None,
        terrain.seed,
        reporter,
    )?;
    let entry = grow::write(
        &input,
        &grown,
        &maps.discharge_m3_s,
        (&request.folder, import::climate_name(&manifest)),
        &mut transaction,
        (String::new(), parameters),
        reporter,
    )?;
    grow::record(&mut manifest, grow::STAGE, entry);
    let entries = undergrowth::write(
        &beneath,
        &undergrowth,
        &undergrowth_request,
        canopy_request.table,
        "",
        &mut transaction,
        reporter,
    )?;
    entries.into_iter().for_each(|(stage, entry)| grow::record(&mut manifest, stage, entry));
    reporter.check_cancelled()?;
    transaction.commit(&manifest)?;
    close_up::discard(&request.folder);
    Ok(manifest)
}

/// Shares that show the biome's species; `None` leaves them to their vigor.
fn shares(biome: &str) -> Option<&'static str> {
    (biome == "sonoma").then_some(
        "redwood=0.3,douglas-fir=0.2,coast-live-oak=0.2,pacific-madrone=0.1,california-black-oak=0.1",
    )
}
