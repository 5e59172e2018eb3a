//! Biomes by name or from a file of one's own, of which each scene keeps a copy.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::Error;
use crate::io::{self, ParseError};
use crate::scene::Manifest;
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
        let is_file = path.exists() || path.extension().is_some_and(|ending| ending == "toml");
        if Biome::BUILTIN_NAMES.contains(&name_or_file) || !is_file {
            return Ok(Self { biome: Biome::builtin(name_or_file)?, own_text: None });
        }
        let text = read_text(path, "a biome file")?;
        Ok(Self { biome: parse(&text, path)?, own_text: Some(text) })
    }
}

/// The biome of a scene: its own copy of one, else the built-in one that it names.
pub(super) fn of_scene(folder: &Path, manifest: &Manifest) -> Result<Biome, Error> {
    if !manifest.files().any(|file| file == COPY) {
        return Ok(Biome::builtin(&manifest.scene.biome)?);
    }
    let path = folder.join(COPY);
    parse(&read_text(&path, "a biome file")?, &path)
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
