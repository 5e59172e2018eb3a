//! Single cells that stand far above or below all their neighbours: birds, wires, multipath.

use rayon::prelude::*;

/// A spike stands out by at least this, metres; chosen: taller than stumps, boulders and cars left
/// in ground returns, lower than a bird.
const STAND_OUT_M: f32 = 5.0;

/// A spike stands out by at least this many cell widths: 79° on all sides at once. chosen: no summit
/// of a coarse grid is as steep all round.
const STAND_OUT_CELLS: f32 = 5.0;

/// A spike stands out by at least so many times the range of its neighbours; chosen: on cliffs and
/// towers the neighbours themselves differ by as much as the cell does.
const STAND_OUT_RANGES: f32 = 2.0;

/// Neighbours needed to judge a cell: what a cell on the grid's edge has.
const LEAST_NEIGHBOURS: usize = 5;

/// Replaces spikes and pits by the median of their neighbours; returns how many.
///
/// A cell is one if it lies **beyond all** of its valid neighbours (of eight) by 5 m, by five cell
/// widths, and by twice the neighbours' range. A cliff's edge has neighbours at its own height, and a
/// crag of several cells too: neither is touched.
pub fn replace_spikes(cols: usize, cell_m: f64, values: &mut [f32], valid: &[bool]) -> usize {
    let rows = valid.len() / cols;
    let least_m = STAND_OUT_M.max(STAND_OUT_CELLS * cell_m as f32); // cells are 0.05–1000 m
    let heights: &[f32] = values;
    let spike = |row: usize, col: usize| {
        let here = row * cols + col;
        if !valid[here] {
            return None;
        }
        let mut around = [0.0_f32; 8];
        let mut count = 0;
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for r in row.saturating_sub(1)..(row + 2).min(rows) {
            for c in col.saturating_sub(1)..(col + 2).min(cols) {
                let i = r * cols + c;
                if i != here && valid[i] {
                    (low, high) = (low.min(heights[i]), high.max(heights[i]));
                    around[count] = heights[i];
                    count += 1;
                }
            }
        }
        let beyond = (heights[here] - high).max(low - heights[here]);
        if count < LEAST_NEIGHBOURS || beyond < least_m || beyond < STAND_OUT_RANGES * (high - low)
        {
            return None;
        }
        let around = &mut around[..count];
        around.sort_by(f32::total_cmp);
        Some((here, (around[(count - 1) / 2] + around[count / 2]) / 2.0))
    };
    let spikes: Vec<(usize, f32)> = (0..rows)
        .into_par_iter()
        .flat_map_iter(|row| (0..cols).filter_map(move |col| spike(row, col)))
        .collect();
    for &(cell, median_m) in &spikes {
        values[cell] = median_m;
    }
    spikes.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 20;

    fn terrain(f: impl Fn(f32, f32) -> f32) -> Vec<f32> {
        (0..SIZE * SIZE).map(|i| f((i / SIZE) as f32, (i % SIZE) as f32)).collect()
    }

    fn spikes_in(mut values: Vec<f32>, cell_m: f64) -> usize {
        replace_spikes(SIZE, cell_m, &mut values, &[true; SIZE * SIZE])
    }

    #[test]
    fn spikes_and_pits_become_the_median_of_their_neighbours() {
        let slope = |row: f32, col: f32| 100.0 + 0.2 * row + 0.4 * col;
        let whole = terrain(slope);
        let mut values = whole.clone();
        for (cell, off_m) in [(5 * SIZE + 5, 30.0), (12 * SIZE + 9, -40.0), (3, 25.0)] {
            values[cell] += off_m;
        }
        assert_eq!(replace_spikes(SIZE, 1.0, &mut values, &[true; SIZE * SIZE]), 3);
        for (found, expected) in values.iter().zip(&whole) {
            assert!((found - expected).abs() < 0.5);
        }
    }

    #[test]
    fn real_ground_is_left_alone() {
        // a wall of 80 m, its corner, a sharp summit of a coarse grid, a crag two cells wide
        assert_eq!(spikes_in(terrain(|_, col| if col > 9.0 { 80.0 } else { 0.0 }), 1.0), 0);
        let corner = |row: f32, col: f32| if col > 9.0 && row > 9.0 { 80.0 } else { 0.0 };
        assert_eq!(spikes_in(terrain(corner), 1.0), 0);
        let summit = |row: f32, col: f32| -40.0 * (row - 9.0).hypot(col - 9.0);
        assert_eq!(spikes_in(terrain(summit), 30.0), 0);
        let crag =
            |row: f32, col: f32| if row == 9.0 && (col == 9.0 || col == 10.0) { 50.0 } else { 0.0 };
        assert_eq!(spikes_in(terrain(crag), 1.0), 0);
        // 4 m stand out too little to be judged
        let stump = |row: f32, col: f32| if row == 9.0 && col == 9.0 { 4.0 } else { 0.0 };
        assert_eq!(spikes_in(terrain(stump), 1.0), 0);
    }

    #[test]
    fn missing_neighbours_do_not_judge() {
        let mut values = terrain(|_, _| 0.0);
        values[9 * SIZE + 9] = 50.0;
        let mut valid = vec![true; SIZE * SIZE];
        for col in 8..11 {
            valid[8 * SIZE + col] = false;
        }
        valid[9 * SIZE + 8] = false;
        assert_eq!(replace_spikes(SIZE, 1.0, &mut values, &valid), 0);
        valid[9 * SIZE + 8] = true;
        assert_eq!(replace_spikes(SIZE, 1.0, &mut values, &valid), 1);
    }
}
