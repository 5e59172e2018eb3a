//! Learned canopies: a sketch and a terrain become a canopy footprint, and that a canopy height model, by trained networks.
//!
//! Reading order: [`coarse`] (the networks' cells), [`sketch`] (what is painted), [`stand_height`] (how tall stands are),
//! `conditions` (terrain as networks see it), [`bare`] (ground that stays without trees by rule), [`generator`] (sketch →
//! footprint → height), [`detail`] (from the networks' cells to the terrain's), with `detail_trees` (which trees make up
//! the coarse heights) and `detail_surface` (their crowns as a height model shows them).
//!
//! # Reference
//! Kapp et al. 2020, section 4, doi:10.1145/3414685.3417848.
//!
//! # Departures
//! Terrain counts relative to its surroundings, not by absolute height; networks run without batch statistics and
//! dropout; maps of any size have no seams; stand height and noise are inputs. training/README.md has the reasons.

pub mod bare;
pub mod coarse;
mod conditions;
pub mod detail;
mod detail_surface;
mod detail_trees;
pub mod generator;
pub mod sketch;
pub mod stand_height;
