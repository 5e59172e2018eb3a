//! Bytes to data and back: one format a file. Parsers take bytes and limits, know no paths, and never panic.

pub mod ascii_grid;
pub mod csv;
pub mod elv;
#[cfg(feature = "gdal")]
pub mod gdal;
pub mod geokeys;
pub mod geopackage;
pub mod geoparquet;
pub mod geotiff;
pub mod las;
mod number_text;
pub mod projjson;
pub mod raster_file;
pub mod table;
pub mod vector;
mod window;
pub mod wkt;

use std::path::{Path, PathBuf};

/// Trouble with a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum Error {
    /// The file could not be read.
    #[error("{path}: cannot read: {source}; {hint}", path = path.display(), hint = reading_hint(source))]
    Read { path: PathBuf, source: std::io::Error },
    /// The file could not be written.
    #[error("{path}: cannot write: {source}; check free space and permissions", path = path.display())]
    Write { path: PathBuf, source: std::io::Error },
    /// The file's content cannot be used.
    #[error("{path}: {problem}", path = path.display())]
    Content { path: PathBuf, problem: ParseError },
}

impl Error {
    /// Whether the file is sound, but nothing of it is asked for or holds a value.
    pub fn is_nothing(&self) -> bool {
        matches!(self, Self::Content { problem, .. } if problem.kind == ParseErrorKind::Nothing)
    }

    /// Whether the machine failed (exit code 1) rather than the input (exit code 2).
    /// A path that names no file is the user's to mend: bad input.
    pub fn is_machine_failure(&self) -> bool {
        match self {
            Self::Read { source, .. } => !names_no_file(source),
            Self::Write { .. } => true,
            Self::Content { .. } => false,
        }
    }
}

/// Whether reading failed because the path names nothing, or something that is no file.
fn names_no_file(source: &std::io::Error) -> bool {
    use std::io::ErrorKind::{InvalidFilename, IsADirectory, NotADirectory, NotFound};
    matches!(source.kind(), NotFound | IsADirectory | NotADirectory | InvalidFilename)
}

fn reading_hint(source: &std::io::Error) -> &'static str {
    match source.kind() {
        std::io::ErrorKind::PermissionDenied => "check its permissions",
        _ if names_no_file(source) => "check the path; it must name a file",
        _ => "check the disk and the connection it lies behind",
    }
}

/// Kinds of trouble that callers answer differently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ParseErrorKind {
    /// The content cannot be used.
    Content,
    /// Sound, but nothing of it is asked for or holds a value: the window misses it, or all is nodata.
    Nothing,
    /// Sound, but stored in a way this reader does not know; another reader may.
    Unsupported,
    /// The device failed, not the content.
    Device(std::io::ErrorKind),
}

/// What is wrong with some bytes, and what the user can do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}; {hint}")]
pub struct ParseError {
    /// What is wrong.
    pub what: String,
    /// What to do.
    pub hint: String,
    /// What kind of trouble it is.
    pub kind: ParseErrorKind,
}

impl ParseError {
    /// `what` is wrong, do `hint`.
    pub fn new(what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { what: what.into(), hint: hint.into(), kind: ParseErrorKind::Content }
    }

    /// The same trouble as one of another kind.
    #[must_use]
    pub fn of_kind(self, kind: ParseErrorKind) -> Self {
        Self { kind, ..self }
    }

    /// Names the file.
    pub fn at(self, path: &Path) -> Error {
        let path = path.to_path_buf();
        match self.kind {
            ParseErrorKind::Device(kind) => {
                Error::Read { path, source: std::io::Error::new(kind, self.what) }
            }
            _ => Error::Content { path, problem: self },
        }
    }
}

/// How large an input may be before it is refused rather than read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Most cells of a raster (or of its requested window).
    pub max_cells: usize,
    /// Most points of a cloud.
    pub max_points: usize,
}

impl Default for Limits {
    fn default() -> Self {
        // chosen: abiotic maps take about 160 bytes a cell, so 10,000² cells need 16 GB;
        // 500 million points are 6.5 GB of coordinates
        Self { max_cells: 100_000_000, max_points: 500_000_000 }
    }
}
