//! Plants of a scene from its undergrowth: places on the map, stems, ages, vigor.

use rayon::prelude::*;

use super::{Conditions, Undergrowth};
use crate::plants::{Layer, Plants};
use crate::raster::Grid;
use crate::raster::resample::{CellPosition, Samples};
use crate::species::Biome;

/// The plants of undergrowth, in its order.
///
/// # Panics
/// If it does not stand on the ground's cells.
/// # Departures
/// Age is that of a scene's plants: years of unhindered growth by Peytavie 2024, Eq. 2. Simulated woody plants grew by Kapp 2020,
/// Eq. 3, and are older at the same height.
pub fn plants(
    undergrowth: Undergrowth,
    conditions: &Conditions<'_>,
    elevation_m: &Grid<f32>,
    biome: &Biome,
) -> Plants {
    let frame = elevation_m.frame();
    let side_m = |cells: usize| (cells as f64 * frame.transform.cell_m) as f32; // rounded as positions are
    let (scene_width_m, scene_height_m) = (side_m(frame.cols), side_m(frame.rows));
    let valid = elevation_m.mask().as_slice();
    let ground_m = Samples::new(frame.rows, frame.cols, elevation_m.values(), valid);
    let Undergrowth { disks, id, cell, .. } = undergrowth;
    let measure = |of: &(dyn Fn(usize) -> f32 + Sync)| -> Vec<f32> {
        (0..disks.len()).into_par_iter().map(of).collect()
    };
    let species = |plant: usize| &biome.species[usize::from(disks.species[plant])];
    Plants {
        layer: vec![Layer::Undergrowth; disks.len()],
        // sums of f32 may end a hair beyond the edge
        east_m: measure(&|plant| disks.east_m[plant].clamp(0.0, scene_width_m)),
        north_m: measure(&|plant| {
            (scene_height_m - disks.south_m[plant]).clamp(0.0, scene_height_m)
        }),
        z_m: measure(&|plant| {
            let [col, row] = [disks.east_m[plant], disks.south_m[plant]]
                .map(|m| f64::from(m) / frame.transform.cell_m);
            let own = elevation_m.values()[cell[plant] as usize];
            ground_m.bilinear(CellPosition { row, col }).unwrap_or(own)
        }),
        dbh_m: measure(&|plant| species(plant).dbh_m(disks.height_m[plant])),
        age_years: measure(&|plant| species(plant).age_at_height_years(disks.height_m[plant], 1.0)),
        vigor: measure(&|plant| {
            let (cell, site) = (cell[plant] as usize, conditions.site());
            let sun_h = site.sun_h.values()[cell] * conditions.light_fraction(cell);
            let [moisture_mm, temperature_c, slope_rad] =
                [&site.moisture_mm, &site.temperature_c, &site.slope_rad]
                    .map(|map| map.values()[cell]);
            species(plant).niche.vigor(sun_h, moisture_mm, temperature_c, slope_rad)
        }),
        id,
        species: disks.species,
        height_m: disks.height_m,
        crown_radius_m: disks.radius_m,
    }
}
