//! Canopy trees: which species stand where, and the trees that make up a canopy height model.
//!
//! Reading order: [`site`] (what a place offers over the year), [`species_map`] (who stands where) with [`shares`] and
//! [`brush`] (what is asked) and [`limits`] (what cannot be had), [`crowns`] and
//! [`visibility`] (which crown the sky sees at each cell).
//!
//! # Reference
//! Kapp et al. 2020, section 5, doi:10.1145/3414685.3417848.

mod assignment;
pub mod brush;
pub mod crowns;
pub mod limits;
mod mosaic;
mod region;
mod share_solver;
pub mod shares;
pub mod site;
pub mod species_map;
mod specks;
mod suitability;
pub mod visibility;
