//! A generated landscape into a scene folder.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::Error;
use super::import::{self, ImportRequest, ReadTerrain};
use crate::abiotics;
use crate::progress::Reporter;
use crate::scene::{self, Manifest, SceneHead, Transaction};
use crate::species::Biome;
use crate::terrain::generate::{self, GenerateParams};

/// Generates a landscape, makes its maps and its picture, and gives its manifest.
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
    let climate = Biome::builtin(biome)?.climate;
    let request = ImportRequest {
        biome: biome.to_owned(),
        seed: terrain.seed,
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
    let entry = import::write_abiotics(
        &read.terrain,
        &maps,
        &mut transaction,
        key,
        &request,
        &climate,
        reporter,
    )?;
    stages.insert("abiotics".to_owned(), entry);
    let scene = SceneHead::new(&request.folder, &read.terrain, biome, terrain.seed);
    let manifest = Manifest { scene, inputs: Vec::new(), stages };
    reporter.check_cancelled()?;
    transaction.commit(&manifest)?;
    Ok(manifest)
}
