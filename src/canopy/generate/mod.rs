//! A canopy of its own: a plausible canopy height model for terrain without a measured one, for demonstrations,
//! measurements and tests.
//!
//! Reading order: `stands` (where woods stand, how tall and of which kind), `planting` (places of trees), `trees`
//! (their sizes, and which of them make up the cover asked for), `surface` (crowns as the height model shows them).
//!
//! Draws are keyed by absolute map position: the lattice, the noise and each tree's form are the same in any window.
//! What is spread over the whole map is not: moisture counts by its range there, and so does the cover asked for.

mod planting;
mod stands;
mod surface;
mod trees;

use crate::canopy::site::Site;
use crate::progress::{Cancelled, Reporter};
use crate::raster::Grid;
use crate::terrain::Terrain;

pub use trees::GeneratedTree;

/// What a generated canopy is to be like.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct GenerateParams {
    /// Another seed, another canopy.
    pub seed: u64,
    /// Share of the land under crowns, 0..=1; of more than about 0.93, what all trees together cover.
    pub cover_fraction: f32,
    /// Height of trees in a grown stand on middling ground.
    pub stand_height_m: f32,
    /// Trees on a hectare of land, open land included; sets their spacing, and by it the width of crowns.
    pub trees_per_ha: f32,
}

impl Default for GenerateParams {
    /// Chosen: a temperate forest with clearings.
    fn default() -> Self {
        Self { seed: 1, cover_fraction: 0.75, stand_height_m: 24.0, trees_per_ha: 300.0 }
    }
}

impl GenerateParams {
    /// A canopy as dense as those of Kapp 2020, Table 1: about 800 trees a hectare (70,000 on 1024² cells of 0.914 m,
    /// 357,000 on 2048², 745,000 on 3072²).
    pub fn dense(trees_per_ha: f32) -> Self {
        Self { cover_fraction: 0.88, stand_height_m: 22.0, trees_per_ha, ..Self::default() }
    }
}

/// A canopy that was made up.
#[derive(Clone, Debug)]
pub struct GeneratedCanopy {
    /// Canopy height, m.
    pub chm_m: Grid<f32>,
    /// The trees drawn into it, from north to south; those at the rim may stand outside the map.
    pub trees: Vec<GeneratedTree>,
}

/// A canopy height model on the terrain's frame and mask, in metres: closed stands, open woodland, gaps, meadows, wooded
/// river banks. Equal parameters give equal bits, whatever the number of threads. Meant for cells of 0.5–5 m.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
///
/// # Panics
/// If the site is not on the terrain's frame, or a parameter is no sensible number.
pub fn generate(
    terrain: &Terrain,
    site: &Site,
    params: &GenerateParams,
    reporter: &Reporter,
) -> Result<Grid<f32>, Cancelled> {
    Ok(generate_with_trees(terrain, site, params, reporter)?.chm_m)
}

/// Like [`generate`], with the trees that were drawn.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
///
/// # Panics
/// If the site is not on the terrain's frame, or a parameter is no sensible number.
pub fn generate_with_trees(
    terrain: &Terrain,
    site: &Site,
    params: &GenerateParams,
    reporter: &Reporter,
) -> Result<GeneratedCanopy, Cancelled> {
    let frame = terrain.elevation_m.frame();
    assert_eq!(frame.len(), site.moisture_mm.values().len(), "site and terrain differ in size");
    assert!((0.0..=1.0).contains(&params.cover_fraction), "cover {}", params.cover_fraction);
    assert!(params.trees_per_ha > 0.0 && params.trees_per_ha.is_finite(), "no trees");
    assert!(params.stand_height_m > 0.0 && params.stand_height_m.is_finite(), "no height");
    let stage = reporter.stage("canopy", 4);
    let lattice = planting::Lattice::new(frame, params);
    let stands = stands::Stands::new(frame, site, lattice.reach_m(), params);
    stage.advance(1);
    reporter.check_cancelled()?;
    let places = planting::places(&lattice, &stands, &terrain.elevation_m, params.seed);
    stage.advance(1);
    reporter.check_cancelled()?;
    let planted = trees::grown(&lattice, &places, &stands, params.seed);
    let cover = surface::cover_values(&terrain.elevation_m, &lattice, &planted);
    let planted =
        trees::standing(planted, &cover, terrain.elevation_m.mask(), params.cover_fraction);
    stage.advance(1);
    reporter.check_cancelled()?;
    let chm_m = surface::draw(&terrain.elevation_m, &lattice, &planted, params.seed);
    stage.advance(1);
    Ok(GeneratedCanopy { chm_m, trees: planted.canopy() })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::math;
    use crate::raster::Mask;

    /// Square hills of `size` cells.
    pub fn hills(size: usize, cell_m: f64) -> Terrain {
        let elevation_m = Grid::from_fn(size, size, cell_m, |c| {
            let (x, y) = (c.col as f32 * cell_m as f32, c.row as f32 * cell_m as f32);
            300.0 + 30.0 * math::sin(x / 90.0) * math::cos(y / 70.0)
        });
        Terrain { elevation_m, latitude_rad: 0.7, grid_convergence_rad: 0.0 }
    }

    /// A site alike everywhere.
    pub fn flat_site(
        terrain: &Terrain,
        moisture_mm: f32,
        temperature_c: f32,
        slope_rad: f32,
    ) -> Site {
        let all = |value: f32| {
            let cells = terrain.elevation_m.frame().len();
            terrain.elevation_m.with_values(vec![value; cells])
        };
        Site {
            sun_h: all(7.0),
            moisture_mm: all(moisture_mm),
            temperature_c: all(temperature_c),
            slope_rad: all(slope_rad),
        }
    }

    fn made(size: usize, cell_m: f64, params: &GenerateParams) -> GeneratedCanopy {
        let terrain = hills(size, cell_m);
        let site = flat_site(&terrain, 50.0, 12.0, 0.2);
        generate_with_trees(&terrain, &site, params, &Reporter::silent()).unwrap()
    }

    fn share_above(chm_m: &Grid<f32>, limit_m: f32) -> f64 {
        let above = chm_m.valid_values().filter(|h| **h > limit_m).count();
        above as f64 / chm_m.mask().valid_count() as f64
    }

    #[test]
    fn the_canopy_is_the_same_for_any_number_of_threads() {
        let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        let draw = || made(150, 1.0, &GenerateParams::default());
        let (one, two) = (pool(1).install(draw), pool(2).install(draw));
        assert!(one.chm_m.values() == two.chm_m.values() && one.trees == two.trees);
    }

    #[test]
    fn cover_comes_out_as_asked() {
        for (cell_m, size) in [(0.5, 400), (1.0, 300), (4.0, 150)] {
            for cover_fraction in [0.0, 0.2, 0.6, 0.9] {
                let params = GenerateParams { cover_fraction, ..GenerateParams::default() };
                let got = share_above(&made(size, cell_m, &params).chm_m, 1.8);
                // pits lie below, and a level cuts whole crowns
                let error = got - f64::from(cover_fraction);
                assert!(error.abs() < 0.02, "cells of {cell_m} m, cover {cover_fraction}: {got}");
            }
        }
    }

    #[test]
    fn density_comes_out_as_asked() {
        // Kapp 2020, Table 1: 70,000 trees on 1024² cells of 0.914 m are 799 a hectare
        for (params, size) in [
            (GenerateParams::dense(799.0), 500),
            (GenerateParams::default(), 700),
            (
                GenerateParams {
                    cover_fraction: 0.3,
                    trees_per_ha: 60.0,
                    ..GenerateParams::default()
                },
                900,
            ),
        ] {
            let canopy = made(size, 1.0, &params);
            let side_m = size as f32;
            let inside = canopy.trees.iter().filter(|t| {
                (0.0..side_m).contains(&t.east_m) && (0.0..side_m).contains(&t.north_m)
            });
            let per_ha = inside.count() as f64 / (f64::from(side_m) * f64::from(side_m) / 1e4);
            let ratio = per_ha / f64::from(params.trees_per_ha);
            assert!((0.85..1.15).contains(&ratio), "{params:?}: {per_ha} trees a hectare");
        }
    }

    #[test]
    fn heights_are_finite_and_about_those_of_the_stand() {
        let params = GenerateParams::default();
        let canopy = made(400, 1.0, &params);
        let (low, high) = canopy.chm_m.range().unwrap();
        assert!(
            low >= 0.0 && high > 0.9 * params.stand_height_m && high < 1.8 * params.stand_height_m
        );
        let mean = canopy.trees.iter().map(|t| f64::from(t.height_m)).sum::<f64>()
            / canopy.trees.len() as f64;
        let ratio = mean / f64::from(params.stand_height_m);
        assert!((0.65..1.2).contains(&ratio), "mean height {mean}");
    }

    #[test]
    fn masked_ground_bears_no_trees() {
        let terrain = hills(80, 1.0);
        let grid = &terrain.elevation_m;
        let valid = (0..6400).map(|i| i % 80 < 40).collect();
        let masked = Terrain {
            elevation_m: Grid::new(
                Arc::clone(grid.frame()),
                Arc::new(Mask::new(valid)),
                grid.values().to_vec(),
            ),
            ..terrain.clone()
        };
        let site = flat_site(&masked, 50.0, 12.0, 0.2);
        let params = GenerateParams { cover_fraction: 0.9, ..GenerateParams::default() };
        let canopy = generate_with_trees(&masked, &site, &params, &Reporter::silent()).unwrap();
        assert!(canopy.trees.iter().all(|t| t.east_m < 40.0));
        assert_eq!(canopy.chm_m.mask().valid_count(), 3200);
        assert!((share_above(&canopy.chm_m, 1.8) - 0.9).abs() < 0.03);
    }
}
