//! Biomes by name or from a file of one's own, of which each scene keeps a copy.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::Error;
use super::export_output::check_file;
use crate::io::{self, ParseError};
use crate::scene::{self, Manifest};
use crate::species::Biome;

/// A scene's copy of a biome that is not built in.
pub(super) const COPY: &str = "biome.toml";
/// Bytes read of a file at most. chosen: above what the parser takes, so that it tells.
const MAX_BYTES: u64 = 16 << 20;

/// A biome that a user asked for.
#[derive(Clone, Debug)]
pub struct ChosenBiome {
    /// The biome.
    pub biome: Biome,
    /// Its text, where it comes from a file.
    pub own_text: Option<String>,
}

impl ChosenBiome {
    /// The biome of a built-in name or, where there is none of that name, of a TOML file.
    ///
    /// # Errors
    /// If there is neither, or the file holds no sound biome; the message names file, key and value.
    pub fn read(name_or_file: &str) -> Result<Self, Error> {
        let path = Path::new(name_or_file);
        let is_path = path.exists() || path.extension().is_some_and(|ending| ending == "toml");
        if Biome::BUILTIN_NAMES.contains(&name_or_file) || !is_path {
            return Ok(Self { biome: Biome::builtin(name_or_file)?, own_text: None });
        }
        let text = read_text(path, "a biome file")?;
        Ok(Self { biome: parse(&text, path)?, own_text: Some(text) })
    }
}

/// Writes a biome's text to a new file.
///
/// # Errors
/// If something is there already, which may have been edited, or it cannot be written.
pub fn write_new(path: &Path, text: &str) -> Result<(), Error> {
    check_file(path, "biome", |_| false)?;
    Ok(scene::write_beside(path, text.as_bytes())?)
}

/// The biome of a scene: its own copy of one, else the built-in one that it names.
///
/// # Errors
/// If the copy is missing, or is not as it was when maps and forest were made with it.
pub fn of_scene(folder: &Path, manifest: &Manifest) -> Result<Biome, Error> {
    let mut entries = manifest.stages.values();
    let Some(hash) = entries.find_map(|entry| entry.files.get(COPY)) else {
        return Ok(Biome::builtin(&manifest.scene.biome)?);
    };
    let path = folder.join(COPY);
    let text = read_text(&path, "a biome file")?;
    if blake3::hash(text.as_bytes()).to_hex().as_str() != hash {
        let what = format!(
            "{}: was changed since the scene's maps were made with it; copy it elsewhere and import the terrain again with --biome FILE",
            path.display()
        );
        return Err(Error::Usage { what });
    }
    parse(&text, &path)
}

fn parse(text: &str, path: &Path) -> Result<Biome, Error> {
    Biome::from_toml(text).map_err(|e| Error::Usage { what: format!("{}: {e}", path.display()) })
}

/// The text of a TOML file.
pub(super) fn read_text(path: &Path, what_to_give: &str) -> Result<String, Error> {
    let failed = |source| io::Error::Read { path: path.to_path_buf(), source };
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MAX_BYTES).read_to_end(&mut bytes))
        .map_err(failed)?;
    Ok(String::from_utf8(bytes)
        .map_err(|_| ParseError::new("it is no text", format!("give {what_to_give}")).at(path))?)
}
