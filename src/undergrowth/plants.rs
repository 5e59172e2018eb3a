//! Plants of a scene from its undergrowth: places on the map, stems, ages, vigor.

use rayon::prelude::*;

use super::{Conditions, Undergrowth};
use crate::plants::{Layer, Plants};
use crate::raster::{Cell, Grid};
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
            ground_m(elevation_m, disks.east_m[plant], disks.south_m[plant])
                .unwrap_or(elevation_m.values()[cell[plant] as usize])
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

/// Elevation of the ground at a place, between the four cells around it; none where one of them is masked or missing.
fn ground_m(elevation_m: &Grid<f32>, east_m: f32, south_m: f32) -> Option<f32> {
    let frame = elevation_m.frame();
    let (x, y) = (east_m / frame.cell_m() - 0.5, south_m / frame.cell_m() - 0.5);
    if x < 0.0 || y < 0.0 {
        return None;
    }
    let (row, col) = (y as usize, x as usize); // whole cells
    let at = |row, col| elevation_m.get(Cell { row, col }).copied();
    let [a, b] = [at(row, col)?, at(row, col + 1)?];
    let [c, d] = [at(row + 1, col)?, at(row + 1, col + 1)?];
    let (along, down) = (x - col as f32, y - row as f32);
    let (north, south) = (a + (b - a) * along, c + (d - c) * along);
    Some(north + (south - north) * down)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ground_between_cells_is_a_plane_where_they_lie_in_one() {
        let grid = Grid::from_fn(5, 6, 2.0, |c| 100.0 + 3.0 * c.row as f32 - c.col as f32);
        let at = ground_m(&grid, 4.4, 3.8).unwrap();
        assert!((at - (100.0 + 3.0 * 1.4 - 1.7)).abs() < 1e-4, "{at}");
        assert_eq!(ground_m(&grid, 0.3, 3.0), None);
        assert_eq!(ground_m(&grid, 11.8, 3.0), None);
    }
}
