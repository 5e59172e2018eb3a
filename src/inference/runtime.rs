//! Which program runs the networks.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use super::rten_runtime::RtenRuntime;
use super::{Card, InferenceError, LibrarySearch, Model};

/// A part of a map as a network takes it: channel by channel, row-major.
pub struct Tile {
    /// Number of channels of `conditions`.
    pub channels: usize,
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
    /// `channels` × `rows` × `cols` values.
    pub conditions: Vec<f32>,
    /// `rows` × `cols` values.
    pub noise: Vec<f32>,
    /// Cells at each side that the network only looks at.
    pub halo: usize,
}

impl Tile {
    /// Rows and columns inside the halo, which the network gives values for.
    pub fn inside(&self) -> [usize; 2] {
        [self.rows, self.cols].map(|cells| cells.saturating_sub(2 * self.halo))
    }
}

/// A program that runs one network, on many threads at once. Its result depends on the tile alone.
pub trait Runtime: Send + Sync {
    /// Name, as the scene records it: two runtimes differ in the last bits.
    fn name(&self) -> &str;

    /// What the network gives for a tile: values inside its halo, row-major.
    ///
    /// # Errors
    /// If the program fails.
    fn run(&self, tile: Tile) -> Result<Vec<f32>, InferenceError>;
}

/// Which program is wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RuntimeChoice {
    /// ONNX Runtime where its library is found, else the built-in one.
    #[default]
    Auto,
    /// The built-in one.
    Rten,
    /// ONNX Runtime; fail where its library is not found.
    Ort,
}

impl RuntimeChoice {
    /// All choices, in the order they are told to users.
    pub const ALL: [Self; 3] = [Self::Auto, Self::Rten, Self::Ort];

    /// The choice's name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Rten => "rten",
            Self::Ort => "ort",
        }
    }
}

impl fmt::Display for RuntimeChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A word that names no [`RuntimeChoice`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is none of auto, rten, ort")]
pub struct UnknownRuntime(String);

impl FromStr for RuntimeChoice {
    type Err = UnknownRuntime;

    fn from_str(name: &str) -> Result<Self, UnknownRuntime> {
        let found = Self::ALL.into_iter().find(|choice| choice.name() == name);
        found.ok_or_else(|| UnknownRuntime(name.to_owned()))
    }
}

/// The choice of program, and where ONNX Runtime is looked for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Runtimes {
    /// Which one.
    pub choice: RuntimeChoice,
    /// Where its library may lie.
    pub search: LibrarySearch,
}

/// A network with the program that runs it.
pub struct Network {
    /// What it takes and gives.
    pub card: Card,
    /// The program.
    pub(super) runtime: Box<dyn Runtime>,
}

impl Network {
    /// Name of the program that runs it.
    pub fn runtime_name(&self) -> &str {
        self.runtime.name()
    }
}

impl Runtimes {
    /// Opens a network. A library that nobody named and that cannot be used is passed over; `tell` hears why.
    ///
    /// # Errors
    /// If the program or the network cannot be used.
    pub fn open(&self, model: &Model, tell: impl Fn(String)) -> Result<Network, InferenceError> {
        let runtime = self.runtime(model, tell)?;
        Ok(Network { card: model.card.clone(), runtime })
    }

    fn runtime(
        &self,
        model: &Model,
        tell: impl Fn(String),
    ) -> Result<Box<dyn Runtime>, InferenceError> {
        let rten = || RtenRuntime::open(model).map(|runtime| Box::new(runtime) as Box<dyn Runtime>);
        match self.choice {
            RuntimeChoice::Rten => rten(),
            RuntimeChoice::Ort => self.ort(model),
            RuntimeChoice::Auto if self.search.is_named() => self.ort(model),
            RuntimeChoice::Auto => match self.ort(model) {
                Ok(runtime) => Ok(runtime),
                Err(InferenceError::NoLibrary { .. } | InferenceError::NotBuilt) => rten(),
                Err(error) => {
                    tell(format!("{error}; the built-in runtime does its work"));
                    rten()
                }
            },
        }
    }

    #[cfg(feature = "ort")]
    fn ort(&self, model: &Model) -> Result<Box<dyn Runtime>, InferenceError> {
        let library = self.library()?;
        Ok(Box::new(super::ort_runtime::OrtRuntime::open(model, &library)?))
    }

    #[cfg(not(feature = "ort"))]
    fn ort(&self, _: &Model) -> Result<Box<dyn Runtime>, InferenceError> {
        Err(InferenceError::NotBuilt)
    }

    #[cfg(feature = "ort")]
    fn library(&self) -> Result<PathBuf, InferenceError> {
        self.search.find().map_err(|looked| InferenceError::NoLibrary { looked })
    }

    /// What this machine has, for `wildwood doctor`.
    pub fn found(&self) -> FoundRuntimes {
        #[cfg(feature = "ort")]
        let ort = self.library().and_then(|library| {
            super::ort_runtime::load(&library)?;
            Ok(library)
        });
        #[cfg(not(feature = "ort"))]
        let ort = Err::<PathBuf, _>(InferenceError::NotBuilt);
        FoundRuntimes { rten: super::rten_runtime::NAME, ort }
    }
}

/// The programs a machine has.
#[derive(Debug)]
pub struct FoundRuntimes {
    /// The built-in one.
    pub rten: &'static str,
    /// ONNX Runtime's library, or why there is none.
    pub ort: Result<PathBuf, InferenceError>,
}
