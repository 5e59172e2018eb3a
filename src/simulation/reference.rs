//! A plain version of a year's shares and growth, cell by cell and month by month, that the fast one is held to.

use super::plot::GroundCell;
use super::{CanopyTree, Community, GrowthCurve, Parameters, Plot, traits};
use crate::raster::MONTHS;
use crate::rng::{self, Key, Process};
use crate::species::Biome;

/// A plant after a year.
struct Grown {
    carbon_pool: f64,
    idealized_age_years: f64,
}

/// Twelve months of all plants, with lists of plants in every cell; checks that no cell hands out more than it has.
fn year(community: &Community, biome: &Biome, parameters: &Parameters) -> Vec<Grown> {
    let plot = community.plot();
    let count = community.len();
    let mut in_cell: Vec<Vec<usize>> = vec![Vec::new(); plot.rows * plot.cols];
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| {
        let taller = community.height_m[*b].total_cmp(&community.height_m[*a]);
        taller.then(community.id[*a].cmp(&community.id[*b]))
    });
    for plant in order {
        let [own_row, own_col] = plot.cell_at(community.east_m[plant], community.south_m[plant]);
        let radius_m = community.crown_radius_m[plant];
        for row in 0..plot.rows {
            for col in 0..plot.cols {
                let south_m = (row as f32 + 0.5) * plot.cell_m - community.south_m[plant];
                let east_m = (col as f32 + 0.5) * plot.cell_m - community.east_m[plant];
                let is_own = row == own_row && col == own_col;
                if is_own || south_m * south_m + east_m * east_m < radius_m * radius_m {
                    in_cell[row * plot.cols + col].push(plant);
                }
            }
        }
    }
    let mut grown: Vec<Grown> = (0..count)
        .map(|plant| Grown {
            carbon_pool: f64::from(community.carbon_pool[plant]),
            idealized_age_years: f64::from(community.idealized_age_years[plant]),
        })
        .collect();
    for month in 0..MONTHS {
        let mut light = vec![0.0; count];
        let mut water_mm = vec![0.0; count];
        let mut cells = vec![0.0; count];
        for (cell, plants) in in_cell.iter().enumerate() {
            let ground = &plot.ground[plot.ground_of(cell / plot.cols, cell % plot.cols)];
            let canopy = plot.canopy_at(cell);
            let there_mm = f64::from(ground.moisture_mm[month]);
            let mut light_left = f64::from(canopy.light_fraction);
            let (mut left_mm, mut handed_out_mm) = (there_mm, 0.0);
            for &plant in plants {
                let species = &biome.species[usize::from(community.species[plant])];
                light[plant] += light_left;
                light_left *= 1.0 - f64::from(species.absorbed_light_fraction);
                let got_mm = left_mm.min(f64::from(traits::least_water_mm(&species.niche)));
                left_mm -= got_mm;
                handed_out_mm += got_mm;
                water_mm[plant] += got_mm;
                cells[plant] += 1.0;
            }
            let share_mm = left_mm / (plants.len() as f64 + 1.0);
            for &plant in plants {
                water_mm[plant] += share_mm;
                handed_out_mm += share_mm;
            }
            assert!(handed_out_mm <= there_mm + 1e-9, "{handed_out_mm} of {there_mm} mm");
            assert!((0.0..=1.0).contains(&light_left));
        }
        for plant in 0..count {
            assert!(cells[plant] > 0.0, "plant {plant} escapes competition");
            let species = &biome.species[usize::from(community.species[plant])];
            let [row, col] = plot.cell_at(community.east_m[plant], community.south_m[plant]);
            let ground = &plot.ground[plot.ground_of(row, col)];
            let vigor = f64::from(species.niche.vigor(
                (f64::from(ground.sun_h[month]) * light[plant] / cells[plant]) as f32,
                (water_mm[plant] / cells[plant]) as f32,
                ground.temperature_c[month],
                ground.slope_rad,
            ));
            let capacity = f64::from(parameters.pool_capacity_of(community.height_m[plant]));
            let filled = grown[plant].carbon_pool + vigor;
            if species.growing_season.contains(month as u8 + 1) {
                let months = f64::from(species.growing_season.months());
                grown[plant].idealized_age_years += (filled - capacity).clamp(0.0, 1.0) / months;
            }
            grown[plant].carbon_pool = filled.clamp(-1.0, capacity);
        }
    }
    grown
}

fn ground() -> GroundCell {
    let month = |m: usize| m as f32;
    GroundCell {
        sun_h: std::array::from_fn(|m| 5.0 + 0.8 * (month(m) - 6.0).abs()),
        moisture_mm: std::array::from_fn(|m| 150.0 - 9.0 * month(m)),
        temperature_c: std::array::from_fn(|m| 14.0 + 0.6 * month(m)),
        slope_rad: 0.1,
    }
}

/// A plot of `side_m` metres under two trees, with ground that differs from cell to cell.
fn plot(side_m: usize, biome: &Biome, parameters: &Parameters) -> Plot {
    let cells = (0..side_m * side_m).map(|i| {
        let mut cell = ground();
        cell.moisture_mm.iter_mut().for_each(|mm| *mm *= 0.6 + (i % 17) as f32 / 20.0);
        cell.sun_h.iter_mut().for_each(|h| *h *= 0.8 + (i % 5) as f32 / 20.0);
        cell
    });
    let tree = |sub_biome: usize, east_m: f32, south_m: f32| CanopyTree {
        species: biome.sub_biomes[sub_biome % biome.sub_biomes.len()].canopy[0] as u16,
        east_m,
        south_m,
        crown_radius_m: 2.5,
        height_m: 14.0,
        crown_base_m: 5.0,
    };
    let side = side_m as f32;
    let trees = [tree(0, 0.3 * side, 0.4 * side), tree(1, 0.7 * side, 0.6 * side)];
    Plot::new([side_m; 2], 1.0, cells.collect(), &trees, biome, parameters)
}

/// Strewn plants of all species and sizes.
fn strewn(community: &mut Community, biome: &Biome, count: u64) {
    let side_m = community.plot().cols as f32 * community.plot().cell_m;
    for entity in 0..count {
        let key = Key { seed: 3, process: Process::StrewnPoints, year: 0, month: 0, entity };
        let [east, south, kind, age] = rng::uniforms(key);
        let species = (kind * biome.species.len() as f32) as usize;
        // herbs of any age, trees young: no crown wider than the plot
        let oldest_years = biome.species[species].max_age_years.min(25.0);
        community.plant(
            entity,
            species as u16,
            [east * side_m, south * side_m],
            age * oldest_years,
        );
    }
}

#[test]
fn the_fast_year_is_the_plain_one() {
    for (name, parameters) in
        [("sonoma", Parameters::kapp2020()), ("pyrenees", Parameters::peytavie2024())]
    {
        let biome = Biome::builtin(name).unwrap();
        // wider than a tile, so that crowns lie on borders
        let side_m = if parameters.cell_m < 0.3 { 30 } else { 70 };
        let mut community =
            Community::new(plot(side_m, &biome, &parameters), &biome, parameters, 5);
        strewn(&mut community, &biome, 1500);
        let plain = year(&community, &biome, &parameters);
        let ids = community.id.clone();
        community.live_a_year();
        let mut compared = 0;
        for (plant, id) in community.id.iter().enumerate() {
            let Some(before) = ids.iter().position(|other| other == id) else { continue };
            let (pool, age) = (plain[before].carbon_pool, plain[before].idealized_age_years);
            assert!((f64::from(community.carbon_pool[plant]) - pool).abs() < 2e-3, "{name} {id}");
            let grown = f64::from(community.idealized_age_years[plant]);
            assert!((grown - age).abs() < 2e-3, "{name} {id}: {grown} for {age}");
            compared += 1;
        }
        assert!(compared > 500, "{name}: {compared}");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let biome = Biome::builtin("sonoma").unwrap();
    let parameters = Parameters { seed_chance_per_year: 0.02, ..Parameters::kapp2020() };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let plot = plot(30, &biome, &parameters);
            let mut community = Community::new(plot, &biome, parameters, 9);
            (0..25).for_each(|_| {
                community.live_a_year();
            });
            (community.id, community.height_m, community.carbon_pool)
        })
    };
    let (one, three) = (run(1), run(3));
    assert!(one.0.len() > 300, "{}", one.0.len());
    assert!(one == three);
}

#[test]
fn nothing_grows_through_the_canopy() {
    let biome = Biome::builtin("sonoma").unwrap();
    let parameters = Parameters::kapp2020();
    let mut community = Community::new(plot(30, &biome, &parameters), &biome, parameters, 9);
    let tallest = (0..biome.species.len())
        .max_by(|a, b| biome.species[*a].max_height_m.total_cmp(&biome.species[*b].max_height_m))
        .unwrap();
    let age_years = 0.5 * biome.species[tallest].max_age_years;
    community.plant(1, tallest as u16, [9.0, 12.0], age_years);
    assert!(community.height_m[0] > 5.0);
    community.live_a_year();
    assert!(!community.id.contains(&1));
}

#[test]
fn growth_curves_differ_where_the_papers_do() {
    let biome = Biome::builtin("sonoma").unwrap();
    // herbs saturate under both
    let index = biome.species_index("tanoak").unwrap();
    let size = |growth| {
        let parameters = Parameters { growth, ..Parameters::kapp2020() };
        let age_years = 0.2 * biome.species[index].max_age_years;
        traits::Traits::of(&biome, &parameters)[index].size_m(age_years)[0]
    };
    assert!(size(GrowthCurve::Saturating) > 1.5 * size(GrowthCurve::Smoothstep));
}
