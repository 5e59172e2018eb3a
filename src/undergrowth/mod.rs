//! Undergrowth under a canopy: synthesised within a second from statistics of offline simulations.
//!
//! Reading order: `conditions` (light under the canopy, seeds), `clustering` (ground that is alike), `disks` and
//! `disk_distance` (plants from above, and how they lie to each other), `measures` (counts of both), `statistics` (the file),
//! `analysis` (from simulated plots to statistics), `sampling` (plants on new ground), `refinement` (until they lie to each
//! other as the statistics say).
//!
//! # Reference
//! Kapp et al. 2020, section 6.2, doi:10.1145/3414685.3417848.

pub mod analysis;
pub mod clustering;
pub mod conditions;
pub mod disk_distance;
pub mod disks;
pub mod measures;
pub mod refinement;
pub mod sampling;
pub mod statistics;

use rayon::prelude::*;

pub use conditions::Conditions;
pub use sampling::{Trees, Undergrowth};
pub use statistics::Statistics;

use crate::plants::{Layer, Plants};
use crate::raster::Grid;
use crate::species::Biome;

/// The plants of undergrowth, in its order.
///
/// # Panics
/// If it does not stand on the ground's cells.
pub fn plants(
    undergrowth: &Undergrowth,
    conditions: &Conditions<'_>,
    elevation_m: &Grid<f32>,
    biome: &Biome,
) -> Plants {
    let frame = elevation_m.frame();
    let side_m = |cells: usize| (cells as f64 * frame.transform.cell_m) as f32; // rounded as positions are
    let (scene_width_m, scene_height_m) = (side_m(frame.cols), side_m(frame.rows));
    let Undergrowth { disks, id, cell, .. } = undergrowth;
    let measure = |of: &(dyn Fn(usize) -> f32 + Sync)| -> Vec<f32> {
        (0..disks.len()).into_par_iter().map(of).collect()
    };
    let species = |plant: usize| &biome.species[usize::from(disks.species[plant])];
    Plants {
        id: id.clone(),
        species: disks.species.clone(),
        layer: vec![Layer::Undergrowth; disks.len()],
        // sums of f32 may end a hair beyond the edge
        east_m: measure(&|plant| disks.east_m[plant].clamp(0.0, scene_width_m)),
        north_m: measure(&|plant| {
            (scene_height_m - disks.south_m[plant]).clamp(0.0, scene_height_m)
        }),
        z_m: measure(&|plant| elevation_m.values()[cell[plant] as usize]),
        height_m: disks.height_m.clone(),
        crown_radius_m: disks.radius_m.clone(),
        dbh_m: measure(&|plant| species(plant).dbh_m(disks.height_m[plant])),
        age_years: measure(&|plant| species(plant).age_at_height_years(disks.height_m[plant], 1.0)),
        vigor: measure(&|plant| {
            let [sun_h, moisture_mm, temperature_c, slope_rad] =
                conditions.abiotics(cell[plant] as usize);
            species(plant).niche.vigor(sun_h, moisture_mm, temperature_c, slope_rad)
        }),
    }
}
