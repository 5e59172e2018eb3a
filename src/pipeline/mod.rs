//! The order of stages: reads inputs, runs what is out of date, writes the scene folder.
//!
//! Reading order: [`biome_file`] (whose climate and species), [`import`] (real terrain), [`demo`] (generated terrain), `scene_files` (what both write);
//! [`grow`] (canopy trees), `measured_canopy` and [`learned_canopy`] with `paint` (what they are fitted to), [`exclusion`] and [`brush`] (what a user keeps free or paints);
//! [`undergrowth`] (and the forest floor), [`statistics`] (what undergrowth is synthesised from),
//! [`age`] with `age_files` and `checkpoint` (centuries of growth, disturbance, death and decay),
//! [`validation`] and [`gresolet`] (what comes of it, beside what should), [`close_up`] (a picture of a square of what grew),
//! [`export`] with [`export_format`] and `export_output` (a scene in the formats of other programs),
//! [`render`] (pictures of it), [`scene_report`] (its figures), all of what `scene_content` reads.

pub mod age;
mod age_files;
pub mod biome_file;
pub mod brush;
mod checkpoint;
pub mod close_up;
pub mod demo;
pub mod exclusion;
pub mod export;
mod export_3d;
pub mod export_format;
mod export_output;
pub mod gresolet;
pub mod grow;
pub mod import;
pub mod learned_canopy;
mod measured_canopy;
mod onto_scene;
mod paint;
pub mod render;
mod scene_content;
mod scene_files;
pub mod scene_report;
pub mod statistics;
pub mod undergrowth;
pub mod validation;

use crate::canopy::shares::ShareError;
use crate::export::close_up::area::AreaError;
use crate::export::selection::SelectionError;
use crate::inference::InferenceError;
use crate::progress::Cancelled;
use crate::{io, scene, species, terrain};

/// Why a run ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum Error {
    #[error(transparent)]
    Io(#[from] io::Error),
    #[error(transparent)]
    Scene(#[from] scene::Error),
    #[error(transparent)]
    Biome(#[from] species::BiomeError),
    #[error(transparent)]
    Terrain(#[from] terrain::import::ImportError),
    #[error(transparent)]
    Shares(#[from] ShareError),
    #[error("--preview-area: {0}")]
    Area(#[from] AreaError),
    #[error(transparent)]
    Selection(#[from] SelectionError),
    #[error(transparent)]
    Inference(InferenceError),
    #[error("{what}")]
    Usage { what: String },
    #[error("{what}")]
    Failed { what: String },
    #[error("cancelled; nothing was written")]
    Cancelled,
    #[error("cancelled after year {year}; the same command goes on from there")]
    Stopped { year: u16 },
}

impl From<Cancelled> for Error {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<InferenceError> for Error {
    fn from(error: InferenceError) -> Self {
        match error {
            InferenceError::Cancelled(_) => Self::Cancelled,
            other => Self::Inference(other),
        }
    }
}

impl Error {
    /// Whether the input is to blame (exit code 2) rather than the machine (exit code 1).
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Io(e) => !e.is_machine_failure(),
            Self::Scene(e) => !e.is_machine_failure(),
            Self::Inference(e) => e.is_bad_input(),
            Self::Failed { .. } | Self::Cancelled | Self::Stopped { .. } => false,
            _ => true,
        }
    }
}
