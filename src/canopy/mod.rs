//! Canopy trees: which species stand where, and the trees that make up a canopy height model.
//!
//! Reading order: [`site`] (what a place offers over the year), [`species_map`] (who stands where) with [`shares`] and
//! [`brush`] (what is asked) and [`limits`] (what cannot be had); [`working_cells`] and [`crowns`] (the grid and the
//! spheres of placement), [`visibility`] (which crown the sky sees at each cell), [`stand`] (trees under way),
//! [`placement`] with [`seeding`], [`crown_fit`] and [`conflicts`]; [`trees`] (from crowns to plants), [`quality`] (how
//! well they fit); [`generate`] (a canopy where none was measured); [`learned`] (heights from networks).
//!
//! # Reference
//! Kapp et al. 2020, section 5, doi:10.1145/3414685.3417848.

mod assignment;
pub mod brush;
pub mod conflicts;
pub mod cover;
pub mod crown_fit;
pub mod crowns;
pub mod envelopes;
pub mod generate;
pub mod learned;
pub mod limits;
mod mosaic;
pub mod placement;
pub mod quality;
mod region;
pub mod renderer;
pub mod seeding;
mod share_solver;
pub mod shares;
pub mod site;
pub mod species_map;
mod specks;
pub mod stand;
mod suitability;
pub mod tiles;
pub mod trees;
pub mod visibility;
#[cfg(feature = "gpu")]
pub mod visibility_gpu;
pub mod working_cells;
