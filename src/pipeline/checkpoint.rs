//! A forest's state in a file: what an interrupted or a longer run goes on from.

use super::Error;
use crate::plants::deadwood::GrowthRecord;
use crate::simulation::forest::{Forest, State};

/// What a file begins with; the digit is its layout's.
const MAGIC: &[u8; 16] = b"wildwood state 1";
/// Bytes of the BLAKE3 of what follows.
const HASH_BYTES: usize = 32;

/// A state and what it is the state of.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Checkpoint {
    /// Hash of all that the forest depends on.
    pub key: String,
    /// The forest.
    pub state: State,
    /// Growth that is recorded.
    pub growth: Vec<GrowthRecord>,
    year: u16,
}

impl Checkpoint {
    /// The state of a forest.
    pub fn of(key: &str, forest: &Forest, growth: &[GrowthRecord]) -> Self {
        let (key, growth) = (key.to_owned(), growth.to_vec());
        Self { key, state: forest.state(), growth, year: forest.year() }
    }

    /// Years simulated.
    pub fn year(&self) -> u16 {
        self.year
    }

    /// The content of a file.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn to_bytes(&self) -> Result<Vec<u8>, Error> {
        let content = postcard::to_stdvec(self)
            .map_err(|e| Error::Failed { what: format!("the forest's state: {e}") })?;
        let hash = blake3::hash(&content);
        Ok([&MAGIC[..], hash.as_bytes(), &content].concat())
    }

    /// The checkpoint of a file's content; none if it is damaged or of another layout.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (magic, rest) = bytes.split_at_checked(MAGIC.len())?;
        let (hash, content) = rest.split_at_checked(HASH_BYTES)?;
        let is_whole = magic == MAGIC && blake3::hash(content).as_bytes() == hash;
        if is_whole { postcard::from_bytes(content).ok() } else { None }
    }
}
