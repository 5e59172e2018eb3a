//! The networks' files: built in, or of a folder that the user names.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::{Card, InferenceError};

/// Where networks come from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ModelSource {
    /// The ones that wildwood was built with.
    #[default]
    BuiltIn,
    /// `<name>.onnx` and `<name>.toml` of a folder.
    Folder(PathBuf),
}

/// A network's card and its file as bytes, known to belong together.
#[derive(Clone, Debug)]
pub struct Model {
    /// What it takes and gives.
    pub card: Card,
    /// The ONNX file.
    pub bytes: Cow<'static, [u8]>,
    /// What errors call it.
    pub place: String,
}

/// The built-in networks: name, card, weights.
const BUILT_IN: [(&str, &str, &[u8]); 2] = [
    (
        "footprint",
        include_str!("../../models/footprint.toml"),
        include_bytes!("../../models/footprint.onnx"),
    ),
    (
        "height",
        include_str!("../../models/height.toml"),
        include_bytes!("../../models/height.onnx"),
    ),
];

impl Model {
    /// The network called `name`, which takes `channels`.
    ///
    /// # Errors
    /// If a file is missing, was altered, or describes another network.
    pub fn load(
        source: &ModelSource,
        name: &'static str,
        channels: &[&str],
    ) -> Result<Self, InferenceError> {
        let (text, bytes, card_place, place) = match source {
            ModelSource::BuiltIn => {
                let found = BUILT_IN.iter().find(|(built_in, ..)| *built_in == name);
                let (_, card, bytes) = found.expect("asked for networks that are built in");
                let place = format!("built-in {name}.onnx");
                (
                    Cow::Borrowed(*card),
                    Cow::Borrowed(*bytes),
                    format!("built-in {name}.toml"),
                    place,
                )
            }
            ModelSource::Folder(folder) => {
                let file = |extension: &str| folder.join(format!("{name}.{extension}"));
                let missing = |path: &Path| {
                    let path = path.to_owned();
                    move |source| InferenceError::Missing { path, name, source }
                };
                let (card, onnx) = (file("toml"), file("onnx"));
                let text = std::fs::read_to_string(&card).map_err(missing(&card))?;
                let bytes = std::fs::read(&onnx).map_err(missing(&onnx))?;
                (text.into(), bytes.into(), card.display().to_string(), onnx.display().to_string())
            }
        };
        let card = Card::parse(&text, &card_place, name, channels)?;
        let found = hexadecimal(&Sha256::digest(&bytes));
        if found != card.sha256 {
            return Err(InferenceError::Altered { place, expected: card.sha256, found });
        }
        Ok(Self { card, bytes, place })
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_networks_are_as_their_cards_say() {
        for (name, card, _) in BUILT_IN {
            let channels: toml::Table = toml::from_str(card).unwrap();
            let channels = channels["channels"].as_array().unwrap().clone();
            let names: Vec<&str> = channels.iter().filter_map(|c| c["name"].as_str()).collect();
            let model = Model::load(&ModelSource::BuiltIn, name, &names).unwrap();
            assert_eq!(model.card.name, name);
        }
    }

    #[test]
    fn missing_truncated_and_altered_files_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let source = ModelSource::Folder(folder.path().to_owned());
        let (_, card, bytes) = BUILT_IN[1];
        let channels = ["footprint", "relief", "gradient_east", "gradient_north", "stand_height"];
        let load =
            || Model::load(&source, "height", &channels).map(|_| ()).unwrap_err().to_string();
        assert!(load().contains("height.toml"));
        std::fs::write(folder.path().join("height.toml"), card).unwrap();
        assert!(load().contains("height.onnx"));
        std::fs::write(folder.path().join("height.onnx"), &bytes[..bytes.len() / 2]).unwrap();
        assert!(load().contains("damaged or altered"));
        let mut altered = bytes.to_vec();
        altered[bytes.len() / 2] ^= 1;
        std::fs::write(folder.path().join("height.onnx"), &altered).unwrap();
        assert!(load().contains("damaged or altered"));
        std::fs::write(folder.path().join("height.onnx"), bytes).unwrap();
        Model::load(&source, "height", &channels).unwrap();
    }
}
