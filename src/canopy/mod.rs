//! Canopy trees: which species stand where, and the trees that make up a canopy height model.
//!
//! Reading order: [`site`] (what a place offers over the year), [`species_map`] (who stands where), [`working_cells`] and
//! [`crowns`] (the grid and the spheres of placement), [`visibility`] (which crown the sky sees at each cell), [`stand`]
//! (trees under way), [`placement`] with [`seeding`], [`crown_fit`] and [`conflicts`].
//!
//! # Reference
//! Kapp et al. 2020, section 5, doi:10.1145/3414685.3417848.

pub mod conflicts;
pub mod cover;
pub mod crown_fit;
pub mod crowns;
pub mod placement;
pub mod seeding;
pub mod site;
pub mod species_map;
pub mod stand;
pub mod tiles;
pub mod visibility;
pub mod working_cells;
