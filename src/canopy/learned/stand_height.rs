//! Stand height: how tall the canopy is around each place, which a sketch does not tell.

use rayon::prelude::*;

use super::coarse::CoarseCells;
use super::detail::CANOPY_M;
use crate::math;
use crate::raster::Grid;
use crate::rng::{self, Key, Process};

/// Stand height where none is asked for, m. chosen: that of the closed forest that networks were trained on.
pub const DEFAULT_M: f32 = 16.0;
/// Stand heights that can be asked for, m. chosen: above tall shrubs, below the tallest stands known.
pub const RANGE_M: std::ops::RangeInclusive<f32> = 3.5..=100.0;
/// Stand heights that networks are asked for, m: those of their training. Others are theirs, stretched.
const TRAINED_M: [f32; 2] = [4.5, 24.0];
/// Deviation of stand heights from place to place, as a share. chosen: 0.14 and 0.16 at the two sites of training, a
/// little less because low stands are open ones too.
const DEVIATION_FRACTION: f32 = 0.12;
/// Wavelengths of that deviation, cells, and their parts of it.
const WAVES: [(i64, f32); 2] = [(64, 0.8), (24, 0.6)];

/// A smooth random field around a mean: stand height in m on coarse cells, as far as the range allows.
pub fn around(mean_m: f32, cells: &CoarseCells, seed: u64) -> Vec<f32> {
    let (rows, cols) = (cells.frame.rows, cells.frame.cols);
    let height_m = |index: usize| {
        // maps have fewer than 2⁶³ cells
        let east = cells.first_east + (index % cols) as i64;
        let south = cells.first_south + (index / cols) as i64;
        let waves = WAVES.iter().enumerate();
        let deviation: f32 =
            waves.map(|(i, (cells, part))| part * wave(east, south, *cells, i, seed)).sum();
        let (low, high) = (*RANGE_M.start(), *RANGE_M.end());
        (mean_m * math::exp(DEVIATION_FRACTION * deviation)).clamp(low, high)
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

/// A network's canopy height where `stand_m` was wanted: stretched above 3 m as far as the stand lies beyond training.
pub fn stretched_m(height_m: f32, stand_m: f32) -> f32 {
    let asked_m = trained_m(stand_m);
    if height_m <= CANOPY_M || asked_m == stand_m {
        return height_m;
    }
    // canopy stays canopy
    let above_m = (height_m - CANOPY_M) * (stand_m - CANOPY_M) / (asked_m - CANOPY_M);
    (CANOPY_M + above_m).max(CANOPY_M.next_up())
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
    fn tall_stands_are_stretched_and_canopy_stays_canopy() {
        assert_eq!(stretched_m(20.0, 16.0), 20.0);
        assert!((stretched_m(24.0, 45.0) - 45.0).abs() < 1e-4);
        assert_eq!(stretched_m(2.0, 45.0), 2.0);
        assert!(stretched_m(3.0001, 3.5) > 3.0);
    }
}
