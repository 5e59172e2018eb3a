//! A forest's state in a file: what an interrupted or a longer run goes on from.

use super::Error;
use crate::plants::deadwood::GrowthRecord;
use crate::simulation::forest::{Forest, State, StateRef};

/// What a file begins with; the digit is its layout's.
const MAGIC: &[u8; 16] = b"wildwood state 2";
/// Bytes of the BLAKE3 of what follows.
const HASH_BYTES: usize = 32;

/// A state and what it is the state of, as it is read.
#[derive(Clone, Debug, serde::Deserialize)]
pub struct Checkpoint {
    /// Hash of all that the forest depends on.
    pub key: String,
    /// The forest.
    pub state: State,
    /// Growth that is recorded.
    pub growth: Vec<GrowthRecord>,
    year: u16,
}

/// The same as it is written: nothing is copied but into the file's content.
#[derive(serde::Serialize)]
struct Written<'a> {
    key: &'a str,
    state: StateRef<'a>,
    growth: &'a [GrowthRecord],
    year: u16,
}

/// The content of a file that holds a forest's state.
///
/// # Errors
/// If it cannot be written.
pub fn to_bytes(key: &str, forest: &Forest, growth: &[GrowthRecord]) -> Result<Vec<u8>, Error> {
    let head = [&MAGIC[..], &[0; HASH_BYTES]].concat();
    let written = Written { key, state: forest.state(), growth, year: forest.year() };
    let mut bytes = postcard::to_extend(&written, head)
        .map_err(|e| Error::Failed { what: format!("the forest's state: {e}") })?;
    let (head, content) = bytes.split_at_mut(MAGIC.len() + HASH_BYTES);
    head[MAGIC.len()..].copy_from_slice(blake3::hash(content).as_bytes());
    Ok(bytes)
}

impl Checkpoint {
    /// Years simulated.
    pub fn year(&self) -> u16 {
        self.year
    }

    /// The checkpoint of a file's content; none if it is damaged or of another layout.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (magic, rest) = bytes.split_at_checked(MAGIC.len())?;
        let (hash, content) = rest.split_at_checked(HASH_BYTES)?;
        let is_whole = magic == MAGIC && blake3::hash(content).as_bytes() == hash;
        if is_whole { postcard::from_bytes(content).ok() } else { None }
    }
}
