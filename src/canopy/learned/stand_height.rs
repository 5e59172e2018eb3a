//! Stand height: how tall the canopy is around each place, which a sketch does not tell.

use rayon::prelude::*;

use super::coarse::CoarseCells;
use super::conditions::box_mean;
use super::detail::CANOPY_M;
use crate::math;
use crate::raster::Grid;
use crate::rng::{self, Key, Process};

/// Stand height where none is asked for, m. chosen: that of the closed forest that networks were trained on.
pub const DEFAULT_M: f32 = 16.0;
/// Stand heights that can be asked for, m. chosen: above tall shrubs, below the tallest stands known.
pub const RANGE_M: std::ops::RangeInclusive<f32> = 3.5..=100.0;
/// Stands vary down to this, m. chosen: just canopy.
const LOWEST_M: f32 = 3.1;
/// Stand heights that networks are asked for, m: those of their training; `follow` brings what they give to others.
const TRAINED_M: [f32; 2] = [4.5, 24.0];
/// Deviation of stand heights from place to place, as a share. chosen: 0.14 and 0.16 at the two sites of training, a
/// little less because low stands are open ones too.
const DEVIATION_FRACTION: f32 = 0.12;
/// Wavelengths of that deviation, cells, and their parts of it.
const WAVES: [(i64, f32); 2] = [(64, 0.8), (24, 0.6)];

/// Radius of the box, cells, whose three passes come near the blur over which training takes stand heights.
const BOX_RADIUS_CELLS: usize = 8;
/// Least height above 3 m that canopy counts with, m.
const LEAST_ABOVE_M: f64 = 1e-3;
/// Share of what was asked, above 3 m, down to which canopies keep their form when they are made taller. chosen: half; at
/// held-out Harvard Forest, canopies that lack a tenth lost rumple by more.
const FORM_KEPT_FRACTION: f64 = 0.5;
/// Share of that, below which a canopy is treated as if it had this. chosen: a sixth.
const LEAST_FOUND_FRACTION: f64 = 0.16;
/// The tallest cells lie at most so far above 3 m in the lowest stands, m. chosen with the next: a little above 999 of 1000
/// cells of the training's canopies, which lie up to 17 m above 3 m in stands of 6–7 m, and 23 m in stands of 15–18 m.
const TALLEST_ABOVE_M: f64 = 14.0;
/// What each metre of the stand's own height above 3 m adds to that.
const TALLEST_ABOVE_STANDS: f64 = 1.6;

/// A smooth random field around a mean: stand height in m on coarse cells.
pub fn around(mean_m: f32, cells: &CoarseCells, seed: u64) -> Vec<f32> {
    let (rows, cols) = (cells.frame.rows, cells.frame.cols);
    let height_m = |index: usize| {
        // maps have fewer than 2⁶³ cells
        let east = cells.first_east + (index % cols) as i64;
        let south = cells.first_south + (index / cols) as i64;
        let waves = WAVES.iter().enumerate();
        let deviation: f32 =
            waves.map(|(i, (cells, part))| part * wave(east, south, *cells, i, seed)).sum();
        (mean_m * math::exp(DEVIATION_FRACTION * deviation)).max(LOWEST_M)
    };
    (0..rows * cols).into_par_iter().map(height_m).collect()
}

/// Smooth noise of one wavelength, deviation about 1.
fn wave(east: i64, south: i64, cells: i64, octave: usize, seed: u64) -> f32 {
    let corner = |east: i64, south: i64| {
        let entity = rng::entity_of_cell(east, -south);
        let key = Key { seed, process: Process::StandHeight, year: 0, month: octave as u8, entity }; // 0 or 1
        rng::centred_uniform(key)
    };
    let share = |at: i64| math::smoothstep(at.rem_euclid(cells) as f32 / cells as f32); // small
    let (col, row) = (east.div_euclid(cells), south.div_euclid(cells));
    let (x, y) = (share(east), share(south));
    let north = math::lerp(corner(col, row), corner(col + 1, row), x);
    let below = math::lerp(corner(col, row + 1), corner(col + 1, row + 1), x);
    // the mean of four corners deviates less: two thirds on the average
    1.5 * math::lerp(north, below, y)
}

/// The stand height to ask a network for where `stand_m` is wanted.
pub fn trained_m(stand_m: f32) -> f32 {
    stand_m.clamp(TRAINED_M[0], TRAINED_M[1])
}

/// Brings canopy heights in m to the stand heights that were asked for. Twin of `at_stand_height` in training/dataset.py.
///
/// Networks know few open stands that are tall, and none beyond their training. What lies above 3 m is scaled, place by
/// place, until its mean is the one asked for; a lone cell becomes as tall as the stand. Where a network's canopy is lower
/// than half a stand of its training that was asked for, cells draw nearer to the mean as they are made taller, those above it
/// more: as from the savanna to the closed forest of the training. Beyond the training forests keep their form.
///
/// # Panics
/// If the maps are not of one size.
pub fn follow(height_m: &mut [f32], canopy: &[bool], stand_m: &[f32], cols: usize) {
    assert!(height_m.len() == canopy.len() && canopy.len() == stand_m.len(), "maps differ in size");
    let weights: Vec<f64> = canopy.iter().map(|canopy| f64::from(u8::from(*canopy))).collect();
    let above = |(height_m, canopy): (&f32, &bool)| {
        if *canopy { f64::from(height_m - CANOPY_M).max(LEAST_ABOVE_M) } else { 0.0 }
    };
    let above_m: Vec<f64> = height_m.iter().zip(canopy).map(above).collect();
    let around_m = box_mean(&above_m, &weights, cols, BOX_RADIUS_CELLS);
    let above_canopy_m = |stand_m: f32| f64::from(stand_m - CANOPY_M).max(LEAST_ABOVE_M);
    let shape = |index: usize| {
        if !canopy[index] {
            return 0.0;
        }
        let mean_m = around_m[index].max(LEAST_ABOVE_M);
        let found = mean_m / (FORM_KEPT_FRACTION * above_canopy_m(trained_m(stand_m[index])));
        let (ratio, power) = (above_m[index] / mean_m, found.clamp(LEAST_FOUND_FRACTION, 1.0));
        math::powf_f64(ratio, if ratio > 1.0 { power * power.sqrt() } else { power.sqrt() })
    };
    let shapes: Vec<f64> = (0..canopy.len()).into_par_iter().map(shape).collect();
    let around = box_mean(&shapes, &weights, cols, BOX_RADIUS_CELLS);
    let cells = height_m.iter_mut().zip(canopy).enumerate().filter(|(_, (_, canopy))| **canopy);
    for (index, (height_m, _)) in cells {
        let wanted_m = above_canopy_m(stand_m[index]);
        let above_m = wanted_m * shapes[index] / around[index].max(LEAST_ABOVE_M);
        // at most some hundred metres; canopy stays canopy
        let above_m = above_m.min(TALLEST_ABOVE_M + TALLEST_ABOVE_STANDS * wanted_m);
        *height_m = (CANOPY_M + above_m as f32).max(CANOPY_M.next_up());
    }
}

/// Stand heights of a raster brought into the range that can be asked for; the default where it has none.
pub fn of_raster(raster_m: &Grid<f32>) -> Vec<f32> {
    let cells = raster_m.values().iter().zip(raster_m.mask().as_slice());
    let (low, high) = (*RANGE_M.start(), *RANGE_M.end());
    cells.map(|(m, valid)| if *valid { m.clamp(low, high) } else { DEFAULT_M }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Frame;

    #[test]
    fn a_field_has_about_its_mean_and_deviation() {
        let cells = CoarseCells::of(&Frame::local(2000, 2000, 4.0));
        let field = around(16.0, &cells, 3);
        let n = field.len() as f64;
        let mean = field.iter().map(|m| f64::from(*m)).sum::<f64>() / n;
        let variance = field.iter().map(|m| (f64::from(*m) - mean).powi(2)).sum::<f64>() / n;
        assert!((mean / 16.0 - 1.0).abs() < 0.03, "{mean}");
        let deviation = variance.sqrt() / mean;
        assert!((deviation / f64::from(DEVIATION_FRACTION) - 1.0).abs() < 0.2, "{deviation}");
        assert_ne!(field, around(16.0, &cells, 4));
    }

    #[test]
    fn a_window_of_the_field_is_the_field() {
        let whole = CoarseCells::of(&Frame::local(40, 40, 4.0));
        let mut part = whole.clone();
        part.first_east += 10;
        let (a, b) = (around(16.0, &whole, 1), around(16.0, &part, 1));
        assert_eq!(a[40 + 25], b[40 + 15]);
    }

    #[test]
    fn a_few_tall_cells_in_low_canopy_grow_no_towers() {
        // a tenth of 15 m in canopy of 3.1 m; none at all; a lone cell
        let canopy = vec![true; 3600];
        let mut heights_m: Vec<f32> =
            (0..3600_usize).map(|i| if i.is_multiple_of(10) { 15.0 } else { 3.1 }).collect();
        follow(&mut heights_m, &canopy, &[100.0; 3600], 60);
        assert!(heights_m.iter().all(|h| *h > CANOPY_M && *h < 180.0), "{heights_m:?}");
        let mut none_m = vec![0.5; 9];
        follow(&mut none_m, &[false; 9], &[16.0; 9], 3);
        assert_eq!(none_m, [0.5; 9]);
        let mut lone_m = vec![0.0; 9];
        lone_m[4] = 3.1;
        follow(&mut lone_m, &std::array::from_fn::<bool, 9, _>(|i| i == 4), &[16.0; 9], 3);
        assert!((lone_m[4] - 16.0).abs() < 1e-3);
    }

    #[test]
    fn forests_beyond_training_keep_their_form() {
        let drawn: Vec<f32> = (0..3600).map(|i| 18.0 + (i * 7 % 13) as f32).collect();
        let mut heights_m = drawn.clone();
        follow(&mut heights_m, &[true; 3600], &[45.0; 3600], 60);
        let spread = |values: &[f32]| {
            let (low, high) =
                values.iter().fold((f32::MAX, 0.0_f32), |(a, b), v| (a.min(*v), b.max(*v)));
            (high - CANOPY_M) / (low - CANOPY_M)
        };
        assert!((spread(&heights_m) / spread(&drawn) - 1.0).abs() < 0.15);
    }

    #[test]
    fn stands_are_as_tall_as_asked_and_canopy_stays_canopy() {
        let canopy: Vec<bool> = (0..3600_usize).map(|i| i.is_multiple_of(3)).collect();
        let draw =
            |i: usize| if i.is_multiple_of(3) { 3.1 + (i * 7 % 31) as f32 * 0.4 } else { 1.0 };
        let drawn: Vec<f32> = (0..3600).map(draw).collect();
        for wanted_m in [4.0, 9.0, 20.0, 45.0] {
            let mut heights_m = drawn.clone();
            follow(&mut heights_m, &canopy, &[wanted_m; 3600], 60);
            let of_canopy = heights_m.iter().zip(&canopy).filter(|(_, c)| **c).map(|(h, _)| *h);
            let mean_m = of_canopy.clone().sum::<f32>() / 1200.0;
            assert!((mean_m / wanted_m - 1.0).abs() < 0.03, "{mean_m} for {wanted_m}");
            assert!(of_canopy.clone().all(|h| h > CANOPY_M));
            assert!(of_canopy.fold(0.0, f32::max) < 2.2 * wanted_m);
            assert!(heights_m.iter().zip(&canopy).all(|(h, canopy)| *canopy || *h == 1.0));
        }
    }
}
