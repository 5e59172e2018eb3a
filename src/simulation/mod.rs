//! Simulation of single plants: monthly growth, yearly germination and death under competition for light and water.
//!
//! One set of processes serves the undergrowth beneath a fixed canopy ([`Parameters::kapp2020`]) and, with other numbers, whole
//! forests ([`Parameters::peytavie2024`]). Plants compete on a fine grid. Crowns enter it once a year, as wide and as tall as
//! they are then: so the shares of a year are worked out by one walk over the plants of a tile, the tallest first.
//!
//! Reading order: `parameters`, `plot` (ground and canopy), `seedbank`, `traits` (what a species asks for), `vigor`, `competition` (shares),
//! `carbon_pool`, `mortality`, `germination`, `community` (the plants, and their year); `intersection` (competition of another
//! kind, for comparison), `ecology` (what emerges).
//!
//! # Reference
//! Kapp et al. 2020, section 6.1, Algorithm 2, doi:10.1145/3414685.3417848; Peytavie et al. 2024, section 5,
//! doi:10.1145/3641816.

pub mod carbon_pool;
pub mod community;
mod competition;
pub mod deadwood;
pub mod disturbance;
pub mod ecology;
pub mod forest;
mod germination;
mod intersection;
pub mod mortality;
pub mod parameters;
pub mod plot;
#[cfg(test)]
mod reference;
pub mod seedbank;
mod traits;
mod vigor;

pub use community::{Community, YearFigures};
pub use parameters::{Competition, GrowthCurve, Parameters};
pub use plot::{CanopyTree, CellWindow, Plot, disk_span};
