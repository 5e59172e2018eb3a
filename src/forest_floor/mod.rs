//! Forest floor: grass, and what lies under trees, as maps of the terrain's resolution.
//!
//! Reading order: [`shading`] (what the crowns over a cell take of its light), [`grass`], [`litterfall`], [`water`] (where
//! neither can be). [`poisson_tile`] turns the maps into places of patches, with `dart_throwing` (points no nearer than a
//! distance, until no place is left).
//!
//! # Reference
//! Kapp et al. 2020, section 6.3, doi:10.1145/3414685.3417848.

mod dart_throwing;
pub mod grass;
pub mod litterfall;
pub mod poisson_tile;
pub mod shading;
pub mod water;

use std::sync::Arc;

use crate::plants::Plants;
use crate::progress::{Cancelled, Reporter};
use crate::raster::{Grid, Mask};
use crate::species::Biome;

pub use grass::GrassParams;
pub use litterfall::LitterfallParams;
pub use poisson_tile::{FloorPoint, PoissonTiles, TilePoint};

/// How the forest floor is made.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Params {
    /// Grass.
    pub grass: GrassParams,
    /// Litterfall.
    pub litterfall: LitterfallParams,
}

/// What covers the ground between plants. Both maps are masked where the terrain is, and under open water.
#[derive(Clone, Debug)]
pub struct ForestFloor {
    /// Height of grass and herbs, m.
    pub grass_height_m: Grid<f32>,
    /// Share of the ground that fallen leaves and twigs cover, 0..1.
    pub litterfall: Grid<f32>,
}

/// The forest floor of a site under all its plants, canopy and undergrowth. `suitability` is that for grass
/// ([`grass::suitability`]); land that is not `dry` ([`water::dry_land`]) is masked, and what is not `allowed` (roads) is bare.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
///
/// # Panics
/// If a plant has no place, no radius, or a species the biome does not have.
pub fn run(
    suitability: &Grid<f32>,
    dry: &Arc<Mask>,
    allowed: &Mask,
    plants: &Plants,
    biome: &Biome,
    params: &Params,
    reporter: &Reporter,
) -> Result<ForestFloor, Cancelled> {
    let stage = reporter.stage("forest floor", plants.len() as u64);
    let frame = suitability.frame();
    let shade = shading::ground_shade(frame, plants, biome);
    reporter.check_cancelled()?;
    let mut grass_height_m =
        grass::heights_m(suitability, shade.light_fraction, &biome.forest_floor);
    reporter.check_cancelled()?;
    let mut litterfall = litterfall::densities(shade.cumulative_absorption, &params.litterfall);
    for values in [&mut grass_height_m, &mut litterfall] {
        let cells = values.iter_mut().zip(allowed.as_slice());
        cells.filter(|(_, allowed)| !**allowed).for_each(|(value, _)| *value = 0.0);
    }
    stage.advance(plants.len() as u64);
    Ok(ForestFloor {
        grass_height_m: Grid::new(Arc::clone(frame), Arc::clone(dry), grass_height_m),
        litterfall: Grid::new(Arc::clone(frame), Arc::clone(dry), litterfall),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::abiotics::{self, AbioticMaps};
    use crate::raster::Cell;
    use crate::terrain::Terrain;
    use crate::terrain::generate::{GenerateParams, generate};

    fn maps_of(elevation_m: Grid<f32>, biome: &Biome) -> AbioticMaps {
        let terrain = Terrain { elevation_m, latitude_rad: 0.67, grid_convergence_rad: 0.0 };
        let params = abiotics::Params::default();
        abiotics::run(&terrain, &biome.climate, &params, &Reporter::silent()).unwrap()
    }

    fn floor(maps: &AbioticMaps, plants: &Plants, biome: &Biome) -> ForestFloor {
        let params = Params::default();
        let suitability = grass::suitability(maps, &biome.forest_floor, &params.grass);
        let suitability = maps.slope_rad.with_values(suitability);
        let (dry, reporter) = (Arc::new(water::dry_land(&maps.discharge_m3_s)), Reporter::silent());
        let allowed = maps.slope_rad.mask();
        run(&suitability, &dry, allowed, plants, biome, &params, &reporter).unwrap()
    }

    #[test]
    fn crowns_turn_grass_to_litter() {
        let biome = Biome::builtin("sonoma").unwrap();
        let maps = maps_of(Grid::from_fn(60, 60, 1.0, |c| 200.0 + 0.05 * c.col as f32), &biome);
        let tree = shading::strewn_plants::plants_at(9, &[[30.5, 20.5, 5.0]]);
        let floor = floor(&maps, &tree, &biome);
        let (open, shaded) = (Cell { row: 5, col: 30 }, Cell { row: 39, col: 30 });
        let alpha = biome.species[9].absorbed_light_fraction;
        let (tall, low) = (floor.grass_height_m[open], floor.grass_height_m[shaded]);
        assert!(tall > 0.3 && tall <= biome.forest_floor.max_grass_height_m, "{tall}");
        assert!((low / tall - (1.0 - alpha)).abs() < 0.05, "{low} {tall}");
        assert_eq!(floor.litterfall[open], 0.0);
        let expected = litterfall::density(alpha, &LitterfallParams::default());
        assert!((floor.litterfall[shaded] - expected).abs() < 1e-6);
    }

    #[test]
    fn ground_that_is_kept_free_is_bare() {
        let biome = Biome::builtin("sonoma").unwrap();
        let maps = maps_of(Grid::from_fn(20, 20, 1.0, |c| 200.0 + 0.05 * c.col as f32), &biome);
        let params = Params::default();
        let suitability = grass::suitability(&maps, &biome.forest_floor, &params.grass);
        let suitability = maps.slope_rad.with_values(suitability);
        let dry = Arc::new(water::dry_land(&maps.discharge_m3_s));
        let allowed = Mask::new((0..400).map(|cell| cell % 20 != 7).collect::<Vec<bool>>());
        let (plants, reporter) = (Plants::default(), Reporter::silent());
        let floor = run(&suitability, &dry, &allowed, &plants, &biome, &params, &reporter).unwrap();
        let grass = |col: usize| floor.grass_height_m[Cell { row: 10, col }];
        assert!(grass(7) == 0.0 && grass(6) > 0.3 && grass(8) > 0.3);
    }

    #[test]
    fn cliffs_are_too_dry_for_grass() {
        let biome = Biome::builtin("sonoma").unwrap();
        let ramp = |rise: f32| {
            let maps = maps_of(Grid::from_fn(40, 40, 1.0, |c| 100.0 + rise * c.col as f32), &biome);
            floor(&maps, &Plants::default(), &biome).grass_height_m[Cell { row: 20, col: 20 }]
        };
        let (meadow, cliff) = (ramp(0.2), ramp(1.9));
        assert!(meadow > 0.4 && cliff < 0.02, "{meadow} {cliff}");
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let biome = Biome::builtin("pyrenees").unwrap();
        let params = GenerateParams { rows: 150, cols: 170, ..GenerateParams::default() };
        let terrain = generate(&params, &Reporter::silent()).unwrap();
        let maps = maps_of(terrain.elevation_m, &biome);
        let plants = shading::strewn_plants::strewn(4000, 160.0, 2, |size| 0.2 + 3.0 * size * size);
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let floor = pool.install(|| floor(&maps, &plants, &biome));
            let bits = |grid: &Grid<f32>| -> Vec<u32> {
                grid.values().iter().map(|value| value.to_bits()).collect()
            };
            (bits(&floor.grass_height_m), bits(&floor.litterfall))
        };
        assert_eq!(with(1), with(3));
    }

    #[test]
    #[ignore = "a measurement: run by name with --release and --nocapture"]
    fn seconds_of_a_square_kilometre() {
        let biome = Biome::builtin("sonoma").unwrap();
        let params = GenerateParams { rows: 1000, cols: 1000, cell_m: 1.0, ..Default::default() };
        let terrain = generate(&params, &Reporter::silent()).unwrap();
        let maps = maps_of(terrain.elevation_m, &biome);
        let plants = shading::strewn_plants::trees_and_herbs();
        for _ in 0..5 {
            let started = std::time::Instant::now();
            let floor = floor(&maps, &plants, &biome);
            let seconds = started.elapsed().as_secs_f64();
            println!("{seconds:.3} s, {:?} m of grass", floor.grass_height_m.range());
        }
    }
}
