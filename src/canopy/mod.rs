//! Canopy trees: which species stand where, and the trees that make up a canopy height model.
//!
//! Reading order: [`site`] (what a place offers over the year), [`species_map`] (who stands where), [`crowns`] and
//! [`visibility`] (which crown the sky sees at each cell).
//!
//! # Reference
//! Kapp et al. 2020, section 5, doi:10.1145/3414685.3417848.

pub mod crowns;
pub mod renderer;
pub mod site;
pub mod species_map;
pub mod visibility;
#[cfg(feature = "gpu")]
pub mod visibility_gpu;
