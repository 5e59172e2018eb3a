//! Trained networks: their files, the programs that run them, and maps of any size through them. The only users of ONNX
//! runtimes.
//!
//! Reading order: `card` (what a network takes and gives), `models` (the built-in ones, or a folder's), `runtime` (the
//! choice of program), `rten_runtime` (built in), `ort_runtime` and `library` (ONNX Runtime, where its library is found),
//! `tiling` (maps by overlapping tiles).

mod card;
mod library;
mod models;
#[cfg(feature = "ort")]
mod ort_runtime;
mod rten_runtime;
mod runtime;
mod tiling;

use std::path::PathBuf;

use crate::progress::Cancelled;

pub use card::{CELL_M, Card};
pub use library::LibrarySearch;
pub use models::{Model, ModelSource};
pub use runtime::{FoundRuntimes, Network, RuntimeChoice, Runtimes, UnknownRuntime};
pub use tiling::{MapPlanes, TileLayout};

/// Why a network cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum InferenceError {
    #[error("{}: {source}; a folder of models holds {name}.toml and {name}.onnx", path.display())]
    Missing { path: PathBuf, name: &'static str, source: std::io::Error },
    #[error("{place}: {problem}")]
    Card { place: String, problem: String },
    #[error(
        "{place}: not the file its card describes (sha256 {found}, the card says {expected}): damaged or altered; fetch it anew, or write the card with training/export.py"
    )]
    Altered { place: String, expected: String, found: String },
    #[error("{place}: not a network that {runtime} can run: {problem}")]
    Model { place: String, runtime: String, problem: String },
    #[error(
        "no ONNX Runtime library found (looked {}); name one with --ort-lib FILE, install it (pip install onnxruntime), or give --onnx rten",
        looked.join(", ")
    )]
    NoLibrary { looked: Vec<String> },
    #[error("{}: not an ONNX Runtime library that can be used: {problem}", path.display())]
    Library { path: PathBuf, problem: String },
    #[error(
        "this wildwood was built without the feature `ort`: build it with `cargo build --release`, or give --onnx rten"
    )]
    NotBuilt,
    #[error("{runtime} failed on a tile of {rows} x {cols} cells: {problem}")]
    Run { runtime: String, rows: usize, cols: usize, problem: String },
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl InferenceError {
    /// Whether what was given is to blame rather than the machine.
    pub fn is_bad_input(&self) -> bool {
        !matches!(self, Self::Run { .. } | Self::Cancelled(_))
    }
}
