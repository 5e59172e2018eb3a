//! From a coarse sketch of valley and ridges to the finest cells: every level is eroded, then halved.

use rayon::prelude::*;

use super::drainage::Drainage;
use super::extent::{Extent, upsample_bent};
use super::noise::{Field, Noise};
use super::plan::Plan;
use super::{GenerateParams, erosion, valley};
use crate::progress::{Cancelled, Reporter};

/// Ground around the map that is worked and then cut off, as a share of the map's shorter side:
/// divides forced by the working edge stay outside.
const MARGIN_FRACTION: f64 = 0.14;
/// Fewest cells of that margin.
const MIN_MARGIN_CELLS: usize = 6;
/// Fewest cells across the coarsest level; chosen: enough for a main valley and its first tributaries.
const COARSEST_CELLS: usize = 40;
/// Length over which creep outdoes rivers, √(D/K): first-order valleys stand about twelve times as far apart
/// (Perron et al. 2009, doi:10.1038/nature08174). Chosen: valleys about 100 m apart, as on soil-mantled hills.
const CREEP_LENGTH_M: f32 = 9.0;
/// Slope at which ground slides (rise over run), 31°; friction of loose rock and soil lies at 30–40°.
const CRITICAL_SLOPE: f32 = 0.6;

/// Largest shift of ground as a level is refined, in its coarse cells; chosen: about what eight directions lack.
const BEND_CELLS: f32 = 1.1;
/// Wavelength of those bends in coarse cells; chosen: at five cells and more the ground does not fold.
const BEND_WAVELENGTH_CELLS: f64 = 7.0;

/// Steps of erosion at a level: many where cells are few.
fn steps_at(levels_to_go: usize) -> (usize, f32) {
    match levels_to_go {
        0 => (4, 0.08),
        1 => (8, 0.12),
        2 => (14, 0.2),
        3 => (24, 0.3),
        _ => (40, 0.4),
    }
}

/// How much steeper than whole slopes the banks of fine cells may stand; chosen: slides set the large slopes,
/// creep the small ones, or they would show the grid.
fn bank_steepening(levels_to_go: usize) -> f32 {
    match levels_to_go {
        0 => 1.6,
        1 => 1.3,
        2 => 1.12,
        _ => 1.0,
    }
}

/// Heights of the map's cells in metres above sea level.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
pub fn heights_m(params: &GenerateParams, reporter: &Reporter) -> Result<Vec<f32>, Cancelled> {
    let (mut extent, levels, margin) = coarsest_extent(params);
    let plan = Plan::new(params);
    let stage = reporter.stage("generate terrain", levels as u64 + 1);

    let mut height_m = plan.first_sketch_m(&extent, params.relief_m);
    // at rest the rivers' fall sums to U χ, where χ = ∫ A^−½ dx is about 5 over a valley's length
    let mut uplift_scale_m = params.relief_m / 5.0;
    let jitter = Noise { seed: params.seed, field: Field::Jitter };
    let mut wobble = Vec::new();
    for level in 0..=levels {
        let outlets = plan.outlets(&extent);
        let uplift = plan.uplift(&extent);
        wobble = jitter.words(level as u16, &extent);
        let cell_m = extent.cell_m as f32;
        let creep_length_m = CREEP_LENGTH_M.max(0.4 * cell_m);
        let steepest = CRITICAL_SLOPE.max(2.0 * params.relief_m / shorter_side_m(params));
        let critical_slope =
            plan.critical_slope(&extent, steepest * bank_steepening(levels - level));
        let (steps, duration) = steps_at(levels - level);
        for _ in 0..steps {
            reporter.check_cancelled()?;
            let drainage = Drainage::of(&height_m, &wobble, &outlets, &extent);
            let uplift_m: Vec<f32> = uplift.par_iter().map(|u| u * uplift_scale_m).collect();
            erosion::uplift_and_incise(
                &mut height_m,
                &uplift_m,
                &critical_slope,
                &drainage,
                &extent,
                duration,
            );
            erosion::creep(
                &mut height_m,
                &outlets,
                &extent,
                creep_length_m * creep_length_m,
                1.3 * steepest,
                duration,
                16,
            );
        }
        // the next level starts from the relief asked for, and lifts so as to keep it
        let correction =
            params.relief_m / relief_m(&map_part(&height_m, &extent, params)).max(1e-3);
        height_m.par_iter_mut().for_each(|z| *z *= correction);
        uplift_scale_m *= correction.clamp(0.5, 2.0);
        if level < levels {
            // valleys found on coarse cells run along the grid's eight directions: bend the ground as it is refined
            let fine = extent.halved();
            let wavelength_m = BEND_WAVELENGTH_CELLS * extent.cell_m;
            let [mut east, mut north] = [Field::BendEast, Field::BendNorth].map(|field| {
                let noise = Noise { seed: params.seed, field };
                noise.gradient(level as u16, wavelength_m, &fine)
            });
            east.iter_mut().chain(&mut north).for_each(|shift| *shift *= BEND_CELLS);
            height_m = upsample_bent(&height_m, &extent, &east, &north);
            extent = extent.halved();
        }
        stage.advance(1);
    }

    let outlets = plan.outlets(&extent);
    let whole_m2 = (extent.len() as f64 * extent.cell_m * extent.cell_m) as f32;
    // chosen: a mountain stream of 1 km² is some metres wide; bed slopes of about 2 · 0.2
    let half_width_m = (0.005 * whole_m2.sqrt()).min(15.0);
    let floor = valley::Floor {
        stream_area_m2: 0.03 * whole_m2,
        max_fill_m: 0.045 * params.relief_m,
        max_bed_m: (0.2 * half_width_m).min(0.01 * params.relief_m),
        max_half_width_m: half_width_m,
    };
    // chosen: bends about twelve widths long, as rivers have (Leopold & Wolman 1960)
    let bends = Noise { seed: params.seed, field: Field::Bends }.fractal(
        24.0 * f64::from(floor.max_half_width_m),
        2,
        0.4,
        &extent,
    );
    valley::shape(&mut height_m, &bends, &wobble, &outlets, &extent, &floor);
    Ok(cut_out(&height_m, &extent, margin, params))
}

fn shorter_side_m(params: &GenerateParams) -> f32 {
    (params.rows.min(params.cols) as f64 * params.cell_m) as f32
}

fn relief_m(height_m: &[f32]) -> f32 {
    let (low, high) =
        height_m.iter().fold((f32::MAX, f32::MIN), |(lo, hi), &z| (lo.min(z), hi.max(z)));
    high - low
}

/// The working extent at its coarsest, the number of times it is halved, and the finest margin in cells.
fn coarsest_extent(params: &GenerateParams) -> (Extent, usize, usize) {
    let shorter = params.rows.min(params.cols);
    let margin = ((MARGIN_FRACTION * shorter as f64) as usize).max(MIN_MARGIN_CELLS);
    let mut levels = 0;
    while (shorter + 2 * margin) >> (levels + 1) >= COARSEST_CELLS {
        levels += 1;
    }
    let (rows, cols) = (params.rows + 2 * margin, params.cols + 2 * margin);
    let extent = Extent {
        rows: rows.div_ceil(1 << levels),
        cols: cols.div_ceil(1 << levels),
        cell_m: params.cell_m * (1_u32 << levels) as f64,
        west_m: -(margin as f64) * params.cell_m,
        north_m: (params.rows + margin) as f64 * params.cell_m,
    };
    (extent, levels, margin)
}

/// The heights of an extent's cells on the map, at any level.
fn map_part(height_m: &[f32], extent: &Extent, params: &GenerateParams) -> Vec<f32> {
    let across = (0.0, params.cols as f64 * params.cell_m);
    let along = (0.0, params.rows as f64 * params.cell_m);
    let within = |place: f64, (from, to): (f64, f64)| place >= from && place <= to;
    (0..extent.rows)
        .filter(|&row| within(extent.center_north_m(row), along))
        .flat_map(|row| (0..extent.cols).map(move |col| (row, col)))
        .filter(|&(_, col)| within(extent.center_east_m(col), across))
        .map(|(row, col)| height_m[row * extent.cols + col])
        .collect()
}

/// The map's cells out of the working extent, scaled to the relief asked for.
fn cut_out(height_m: &[f32], extent: &Extent, margin: usize, params: &GenerateParams) -> Vec<f32> {
    let mut map: Vec<f32> = (0..params.rows)
        .flat_map(|row| &height_m[(row + margin) * extent.cols + margin..][..params.cols])
        .copied()
        .collect();
    let low = map.iter().copied().fold(f32::INFINITY, f32::min);
    let scale = params.relief_m / relief_m(&map).max(1e-6);
    map.par_iter_mut().for_each(|z| *z = params.lowest_m + (*z - low) * scale);
    map
}

#[cfg(test)]
mod tests {
    use super::super::generate;
    use super::*;
    use crate::raster::Cell;

    fn small(seed: u64) -> GenerateParams {
        GenerateParams { rows: 96, cols: 128, cell_m: 8.0, seed, ..GenerateParams::default() }
    }

    fn heights(params: &GenerateParams) -> Vec<f32> {
        generate(params, &Reporter::silent()).unwrap().elevation_m.values().to_vec()
    }

    #[test]
    fn relief_and_altitude_are_as_asked() {
        let params = GenerateParams { relief_m: 120.0, lowest_m: 40.0, ..small(5) };
        let terrain = generate(&params, &Reporter::silent()).unwrap();
        let (low, high) = terrain.elevation_m.range().unwrap();
        assert!((low - 40.0).abs() < 1e-3 && (high - 160.0).abs() < 1e-2, "{low} {high}");
        assert_eq!(terrain.elevation_m.frame().rows, 96);
        assert!(terrain.elevation_m.values().iter().all(|z| z.is_finite()));
    }

    #[test]
    fn seeds_make_landscapes_and_threads_do_not() {
        let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        let one = pool(1).install(|| heights(&small(2)));
        let three = pool(3).install(|| heights(&small(2)));
        assert!(one.iter().zip(&three).all(|(a, b)| a.to_bits() == b.to_bits()));
        let other = heights(&small(3));
        let apart =
            one.iter().zip(&other).map(|(a, b)| (a - b).abs()).sum::<f32>() / one.len() as f32;
        assert!(apart > 10.0, "mean difference {apart} m");
    }

    #[test]
    fn water_finds_its_way_and_the_lowest_cell_lies_on_the_edge() {
        for seed in 0..4 {
            let params = small(seed);
            let height = heights(&params);
            let extent = Extent {
                rows: params.rows,
                cols: params.cols,
                cell_m: params.cell_m,
                west_m: 0.0,
                north_m: params.rows as f64 * params.cell_m,
            };
            let pits = valley::pits(&height, &extent);
            assert!(
                pits * 500 < height.len(),
                "seed {seed}: {pits} pits of {} cells",
                height.len()
            );
            let lowest = (0..height.len()).min_by(|&a, &b| height[a].total_cmp(&height[b]));
            let cell = lowest.map(|i| Cell { row: i / params.cols, col: i % params.cols }).unwrap();
            let on_edge = cell.row == 0
                || cell.col == 0
                || cell.row + 1 == params.rows
                || cell.col + 1 == params.cols;
            assert!(on_edge, "seed {seed}: lowest at {cell:?}");
        }
    }

    #[test]
    fn any_size_works() {
        for (rows, cols, cell_m) in [(1, 1, 1.0), (1, 7, 2.0), (20, 20, 1.0), (10, 300, 5.0)] {
            let params = GenerateParams { rows, cols, cell_m, ..GenerateParams::default() };
            let height = heights(&params);
            assert_eq!(height.len(), rows * cols);
            assert!(height.iter().all(|z| z.is_finite()));
        }
    }

    #[test]
    fn cancelling_stops() {
        use std::sync::Arc;
        use std::sync::atomic::AtomicBool;
        struct Quiet;
        impl crate::progress::Sink for Quiet {
            fn event(&self, _: &crate::progress::Event<'_>) {}
        }
        let reporter = Reporter::new(Box::new(Quiet), Arc::new(AtomicBool::new(true)));
        assert_eq!(generate(&small(1), &reporter).map(|_| ()), Err(Cancelled));
    }
}
