//! Trees: placed crowns become plants, with stem, age and vigor, so that a simulation can start from them.

use rayon::prelude::*;

use super::crowns::{UNITS_PER_CELL, cell_of_units};
use super::site::Site;
use super::stand::{Ground, Stand};
use crate::plants::{Layer, Plants};
use crate::species::Species;

/// Plants of a stand, in the order of their trunks' cells from the north-west, whose numbers from 0 are their ids.
///
/// A crown's place in its species' envelope tells how crowded the tree grew: narrow crowns among others, wide ones alone.
/// Stem and age follow from it.
///
/// # Reference
/// Peytavie et al. 2024, Eqs. 1–2, doi:10.1145/3641816: dense and isolated envelopes by the share of shade.
pub fn plants(ground: &Ground<'_>, site: &Site, stand: &Stand) -> Plants {
    let cells = ground.cells;
    let mut order: Vec<usize> = (0..stand.len()).collect();
    order.par_sort_unstable_by_key(|&tree| {
        let (x, y) = (stand.crowns.x[tree], stand.crowns.y[tree]);
        (cell_of_units(y), x, y, tree)
    });
    // in f64 from the scene's own cell, so that no tree at an edge comes to lie beyond it
    let frame = ground.chm_m.frame();
    let m_per_unit = frame.transform.cell_m / (cells.per_cell as f64 * f64::from(UNITS_PER_CELL));
    let height_m = frame.rows as f64 * frame.transform.cell_m;
    let [most_east_m, most_north_m] =
        [frame.cols, frame.rows].map(|n| (n as f64 * frame.transform.cell_m) as f32);
    let measured: Vec<Measures> = order
        .par_iter()
        .map(|&tree| {
            let species = &ground.biome.species[usize::from(stand.species[tree])];
            let index = cells.index_at(stand.crowns.x[tree], stand.crowns.y[tree]);
            // radii are a few metres
            let radius_m = (f64::from(stand.crowns.radius[tree]) * m_per_unit) as f32;
            let scene = cells.scene_index(index);
            measures(species, site, scene, stand.height_m[tree], radius_m)
        })
        .collect();
    let by_order = |value: &dyn Fn(usize) -> f32| order.iter().map(|&tree| value(tree)).collect();
    Plants {
        id: (0..order.len() as u64).collect(),
        species: order.iter().map(|&tree| u16::from(stand.species[tree])).collect(),
        layer: vec![Layer::Canopy; order.len()],
        // positions in a scene fit f32 to the millimetre up to 10 km
        east_m: by_order(&|tree| {
            ((f64::from(stand.crowns.x[tree]) * m_per_unit) as f32).clamp(0.0, most_east_m)
        }),
        north_m: by_order(&|tree| {
            let north_m = height_m - f64::from(stand.crowns.y[tree]) * m_per_unit;
            (north_m as f32).clamp(0.0, most_north_m)
        }),
        z_m: by_order(&|tree| {
            let index = cells.index_at(stand.crowns.x[tree], stand.crowns.y[tree]);
            ground.elevation_m.values()[cells.scene_index(index)]
        }),
        height_m: by_order(&|tree| stand.height_m[tree]),
        crown_radius_m: measured.iter().map(|m| m.crown_radius_m).collect(),
        dbh_m: measured.iter().map(|m| m.dbh_m).collect(),
        age_years: measured.iter().map(|m| m.age_years).collect(),
        vigor: measured.iter().map(|m| m.vigor).collect(),
    }
}

struct Measures {
    crown_radius_m: f32,
    dbh_m: f32,
    age_years: f32,
    vigor: f32,
}

fn measures(
    species: &Species,
    site: &Site,
    scene: usize,
    height_m: f32,
    crown_radius_m: f32,
) -> Measures {
    let shade = shade_fraction(species, height_m, crown_radius_m);
    Measures {
        crown_radius_m,
        dbh_m: species.dbh_in_shade_m(height_m, shade),
        age_years: species.age_at_height_years(height_m, shade),
        vigor: species.niche.vigor(
            site.sun_h.values()[scene],
            site.moisture_mm.values()[scene],
            site.temperature_c.values()[scene],
            site.slope_rad.values()[scene],
        ),
    }
}

/// How crowded a tree grew, in 0 (alone) ..= 1 (among others), by its crown's radius.
fn shade_fraction(species: &Species, height_m: f32, crown_radius_m: f32) -> f32 {
    let alone_m = species.crown_radius_in_shade_m(height_m, 0.0);
    let among_others_m = species.crown_radius_in_shade_m(height_m, 1.0);
    if alone_m <= among_others_m {
        return 0.5; // crowns of this species do not tell
    }
    ((alone_m - crown_radius_m) / (alone_m - among_others_m)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::species::Biome;

    #[test]
    fn narrow_crowns_grew_among_others_and_have_slender_stems() {
        let sonoma = Biome::builtin("sonoma").unwrap();
        let redwood = sonoma.species_by_key("redwood").unwrap();
        let radius_m = redwood.crown_radius_m(30.0);
        // dense and isolated are 0.65 and 1.35 times the typical radius
        let shade = |factor: f32| shade_fraction(redwood, 30.0, factor * radius_m);
        assert!((shade(0.65) - 1.0).abs() < 1e-3 && shade(1.35).abs() < 1e-3);
        assert!((shade(1.0) - 0.5).abs() < 1e-3);
        let dbh_m = |factor: f32| redwood.dbh_in_shade_m(30.0, shade(factor));
        assert!(dbh_m(0.7) < dbh_m(1.3));
    }
}
