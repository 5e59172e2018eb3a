//! Undergrowth under a canopy: synthesised within a second from statistics of offline simulations.
//!
//! Reading order: `conditions` (light under the canopy, seeds), `clustering` (ground that is alike), `disks` and
//! `disk_distance` (plants from above, and how they lie to each other), `measures` (counts of both), `statistics` (the file),
//! `analysis` (from simulated plots to statistics), `sampling` (plants on new ground), `refinement` (until they lie to each
//! other as the statistics say), `plants` (as a scene has them).
//!
//! # Reference
//! Kapp et al. 2020, section 6.2, doi:10.1145/3414685.3417848.

pub mod analysis;
pub mod clustering;
pub mod conditions;
pub mod disk_distance;
pub mod disks;
pub mod measures;
mod plants;
pub mod refinement;
pub mod sampling;
pub mod statistics;

pub use conditions::Conditions;
pub use plants::plants;
pub use sampling::{Trees, Undergrowth};
pub use statistics::Statistics;

use crate::raster::Mask;
use crate::species::Biome;

/// What undergrowth is synthesised on and from.
#[derive(Clone, Copy)]
pub struct Synthesis<'a> {
    /// What the canopy leaves of the site.
    pub conditions: &'a Conditions<'a>,
    /// Where plants may stand.
    pub allowed: &'a Mask,
    /// The canopy.
    pub trees: &'a Trees,
    /// The statistics.
    pub statistics: &'a Statistics,
    /// The species.
    pub biome: &'a Biome,
    /// Another seed, other plants.
    pub seed: u64,
}
