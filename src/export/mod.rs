//! Pictures and files for others: one format a file.
//!
//! Reading order: [`preview`] (a map sheet as PNG), its parts [`layout`], [`relief`], [`ramp`], [`rivers`], [`scale`],
//! [`fit`]; of forests [`crown_layer`], [`species_panel`], [`species_legend`]; and what draws: [`canvas`], [`lettering`].

pub mod canvas;
pub mod crown_layer;
pub mod fit;
pub mod layout;
pub mod lettering;
pub mod preview;
pub mod ramp;
pub mod relief;
pub mod rivers;
pub mod scale;
pub mod species_legend;
pub mod species_panel;
