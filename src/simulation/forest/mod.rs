//! Whole forests over centuries: growth, seeding, disturbance, death and decay, year by year.
//!
//! Reading order: `ground` (what does not live), `run` (the forest and its year), `seeds`, `fuel`, `storms`, `outbreaks` (what disturbances meet
//! there), `deaths` (what becomes of dead plants), `tally` (its figures), `state` (what a run goes on from), `results` (what a scene
//! gets of it).
//!
//! # Reference
//! Peytavie et al. 2024, section 5, doi:10.1145/3641816.

mod deaths;
mod fuel;
mod ground;
mod outbreaks;
mod results;
mod run;
mod seeds;
mod state;
mod storms;
mod tally;
#[cfg(test)]
mod tests;

pub use run::{Forest, Site};
pub use state::{State, StateRef};
pub use tally::{LEAST_DBH_M, RECORDED_HEIGHT_M, Tally};
