//! Pictures and files for others: one format a file.
//!
//! Reading order: [`preview`] (a map sheet as PNG), its parts [`layout`], [`relief`], [`ramp`], [`rivers`], [`scale`],
//! [`fit`]; of forests [`crown_layer`], [`deadwood_layer`], [`species_panel`], [`species_legend`]; [`close_up`] (a square of the forest from above and
//! from the side); [`timeline`] (its years) with [`chart`]; what draws: [`canvas`], [`strokes`], [`lettering`], [`furniture`]. Of 3D formats:
//! [`instances`] and [`terrain_mesh`] (what is written), [`scene3d`] (both, with what the tables say), [`instance_bounds`], [`materials`],
//! [`decimal_text`], [`text_pieces`]; [`usd`], [`gltf`], [`tiles3d`] with [`globe`], [`mitsuba`], [`points`]. Of tables: [`selection`] (what of a
//! scene is exported), [`tables`], [`geopackage`], [`geojson`], [`tree_cloud`]; of other forest programs [`iland`] and [`ecoviz`], with [`species_code`].
//! Pictures in sun and shade: [`render`]. What a scene is like: [`report`].

pub mod canvas;
pub mod chart;
pub mod close_up;
pub mod crown_layer;
pub mod deadwood_layer;
pub mod decimal_text;
pub mod ecoviz;
#[cfg(test)]
mod example3d;
pub mod fit;
pub mod furniture;
pub mod geojson;
pub mod geopackage;
pub mod globe;
pub mod gltf;
pub mod iland;
pub mod instance_bounds;
pub mod instances;
pub mod layout;
pub mod lettering;
pub mod materials;
pub mod mitsuba;
pub mod points;
pub mod preview;
pub mod ramp;
pub mod relief;
pub mod render;
pub mod report;
pub mod rivers;
pub mod scale;
pub mod scene3d;
pub mod selection;
pub mod species_code;
pub mod species_legend;
pub mod species_panel;
pub mod strokes;
pub mod tables;
pub mod terrain_mesh;
pub mod text_pieces;
pub mod tiles3d;
pub mod timeline;
pub mod tree_cloud;
pub mod usd;

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
