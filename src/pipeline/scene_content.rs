//! What a scene folder holds for exports, pictures and reports: terrain, plants and deadwood, each table checked against the scene's own record.

use std::path::Path;

use super::scene_files::{read_deadwood, read_plants};
use super::{Error, age, biome_file, close_up, import};
use crate::export::selection::SceneContent;
use crate::plants::Plants;
use crate::progress::{Reporter, Warning};
use crate::scene::{self, Manifest};

/// What a scene folder says of itself.
///
/// # Errors
/// If it holds no scene.
pub fn read_manifest(folder: &Path) -> Result<Manifest, Error> {
    Manifest::read(folder)?.ok_or_else(|| {
        let folder = folder.display();
        Error::Usage { what: format!("{folder}: no scene there; name a folder from wildwood grow") }
    })
}

/// Terrain, plants and deadwood of a scene.
///
/// # Errors
/// If a file cannot be read or is damaged.
pub fn read_scene(
    folder: &Path,
    manifest: &Manifest,
    reporter: &Reporter,
) -> Result<SceneContent, Error> {
    let stage = reporter.stage("read scene", 2);
    let biome = biome_file::of_scene(folder, manifest)?;
    let elevation_m = import::load_terrain(folder, manifest)?.elevation_m;
    reporter.check_cancelled()?;
    stage.advance(1);
    let frame = elevation_m.frame();
    check_whole(folder, manifest, reporter)?;
    let plants = if folder.join(close_up::PLANTS_FILE).exists() {
        read_plants(folder, &biome, frame)?
    } else {
        Plants::default()
    };
    let deadwood = read_deadwood(folder, &biome, frame)?;
    reporter.check_cancelled()?;
    stage.advance(1);
    let name = manifest.scene.name.clone();
    let years = manifest.stages.get(age::STAGE).and_then(|stage| stage.figures.get("years"));
    let years = years.and_then(toml::Value::as_integer).unwrap_or(0);
    let years = u32::try_from(years).unwrap_or(0);
    Ok(SceneContent { name, biome, elevation_m, plants, deadwood, years })
}

/// Tables of a scene that others may edit.
const TABLES: [&str; 3] = [close_up::PLANTS_FILE, "snags.parquet", "downed_logs.parquet"];

/// Refuses a scene that lost a table, and tells of tables that are not the ones it was written with.
fn check_whole(folder: &Path, manifest: &Manifest, reporter: &Reporter) -> Result<(), Error> {
    for (file, recorded) in manifest.stages.values().flat_map(|stage| &stage.files) {
        let path = folder.join(file);
        if !TABLES.contains(&file.as_str()) {
            continue;
        }
        match scene::hash_file(&path) {
            Ok((hash, _)) if hash == *recorded => {}
            Ok(_) => {
                let text = format!(
                    "{}: is not the file that the scene was written with, but edited since or of another scene; it is taken as it is",
                    path.display()
                );
                reporter.warn(Warning::Other { text });
            }
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                let what = format!(
                    "{}: is gone; put it back, or grow or age the forest again",
                    path.display()
                );
                return Err(Error::Usage { what });
            }
            Err(source) => return Err(crate::io::Error::Read { path, source }.into()),
        }
    }
    Ok(())
}
