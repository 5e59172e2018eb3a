//! Pictures and files for others: one format a file.
//!
//! Reading order: [`preview`] (a map sheet as PNG), its parts [`layout`], [`relief`], [`ramp`], [`rivers`], [`scale`],
//! [`fit`]; of forests [`crown_layer`], [`deadwood_layer`], [`species_panel`], [`species_legend`]; [`close_up`] (a square of the forest from above and
//! from the side); [`timeline`] (its years) with [`chart`]; what draws: [`canvas`], [`strokes`], [`lettering`], [`furniture`]. Of 3D formats:
//! [`instances`]. [`render`]: pictures in sun and shade. Of tables: [`selection`] (what of a scene is exported), [`tables`], [`geopackage`], [`geojson`],
//! [`tree_cloud`]; of other forest programs [`iland`] and [`ecoviz`], with [`species_code`].

pub mod canvas;
pub mod chart;
pub mod close_up;
pub mod crown_layer;
pub mod deadwood_layer;
pub mod ecoviz;
pub mod fit;
pub mod furniture;
pub mod geojson;
pub mod geopackage;
pub mod iland;
pub mod instances;
pub mod layout;
pub mod lettering;
pub mod preview;
pub mod ramp;
pub mod relief;
pub mod render;
pub mod report;
pub mod rivers;
pub mod scale;
pub mod selection;
pub mod species_code;
pub mod species_legend;
pub mod species_panel;
pub mod strokes;
pub mod tables;
pub mod timeline;
pub mod tree_cloud;

use crate::progress::Cancelled;

/// Why an export was not written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum WriteError {
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The format cannot hold what is selected.
    #[error("{what}")]
    Refused { what: String },
}
