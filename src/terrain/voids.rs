//! Holes in the terrain: small ones are filled from their rims, the rest stay masked.

use rayon::prelude::*;

use crate::progress::{Cancelled, Reporter};

/// Holes up to this area are filled unless the caller says otherwise, m².
///
/// chosen: buildings cut from bare-earth models and canopy that let no pulse through leave holes of
/// tens to a few hundred m², and ground is there; open water above 400 m² (20 m × 20 m) is a pond or
/// a lake, where trees must not grow.
pub const HOLE_MAX_AREA_M2: f64 = 400.0;

/// A void of this few cells is a defect of the raster, whatever its area, and even at the grid's
/// edge. chosen: 2 × 2 cells; a lake as small is not resolved by such a raster.
pub const SPECK_MAX_CELLS: usize = 4;

/// What became of invalid cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VoidCounts {
    /// Cells given a height.
    pub filled_cells: usize,
    /// Cells left masked.
    pub kept_cells: usize,
}

/// Invalid cells of one row, side by side.
#[derive(Clone, Copy)]
struct Run {
    row: usize,
    first_col: usize,
    end_col: usize,
}

/// Gives heights to the cells of small holes; returns what was filled and what was kept.
///
/// A hole is a set of invalid cells joined by their sides. Filled are holes of at most
/// `max_area_m2` that do not touch the grid's edge (those may go on beyond it), and specks of up to
/// [`SPECK_MAX_CELLS`]. Nothing is filled where `max_area_m2` is 0.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
pub fn fill_holes(
    cols: usize,
    cell_m: f64,
    max_area_m2: f64,
    values: &mut [f32],
    valid: &mut [bool],
    reporter: &Reporter,
) -> Result<VoidCounts, Cancelled> {
    let invalid_cells = valid.iter().filter(|v| !**v).count();
    let mut counts = VoidCounts { filled_cells: 0, kept_cells: invalid_cells };
    if invalid_cells == 0 || max_area_m2 <= 0.0 {
        return Ok(counts);
    }
    let rows = valid.len() / cols;
    let at_edge = |run: &Run| {
        run.row == 0 || run.row + 1 == rows || run.first_col == 0 || run.end_col == cols
    };
    let holes: Vec<Vec<usize>> = holes(cols, valid)
        .into_iter()
        .filter(|runs| {
            let cells: usize = runs.iter().map(|run| run.end_col - run.first_col).sum();
            let small = cells as f64 * cell_m * cell_m <= max_area_m2;
            cells <= SPECK_MAX_CELLS || (small && !runs.iter().any(at_edge))
        })
        .map(|runs| {
            let cells = |run: Run| (run.first_col..run.end_col).map(move |c| run.row * cols + c);
            runs.into_iter().flat_map(cells).collect()
        })
        .collect();

    let stage = reporter.stage("fill holes", holes.len() as u64);
    let filled: Vec<Option<Vec<f32>>> = holes
        .par_iter()
        .map(|cells| {
            reporter.check_cancelled()?;
            let heights = membrane(cols, cells, values, valid);
            stage.advance(1);
            Ok(heights)
        })
        .collect::<Result<_, Cancelled>>()?;
    for (cells, heights) in holes.iter().zip(filled) {
        let Some(heights) = heights else { continue };
        for (&cell, height_m) in cells.iter().zip(heights) {
            (values[cell], valid[cell]) = (height_m, true);
        }
        counts.filled_cells += cells.len();
        counts.kept_cells -= cells.len();
    }
    Ok(counts)
}

/// The sets of invalid cells joined by their sides, each as its runs from the north-west.
fn holes(cols: usize, valid: &[bool]) -> Vec<Vec<Run>> {
    let mut runs: Vec<Run> = Vec::new();
    let mut parents: Vec<usize> = Vec::new();
    let mut above = 0..0;
    for (row, valid) in valid.chunks(cols).enumerate() {
        let row_start = runs.len();
        let mut col = 0;
        while col < cols {
            if valid[col] {
                col += 1;
                continue;
            }
            let first_col = col;
            while col < cols && !valid[col] {
                col += 1;
            }
            parents.push(runs.len());
            runs.push(Run { row, first_col, end_col: col });
        }
        join_rows(&runs, above, row_start..runs.len(), &mut parents);
        above = row_start..runs.len();
    }

    let mut hole_of_root = vec![usize::MAX; runs.len()];
    let mut holes: Vec<Vec<Run>> = Vec::new();
    for (i, run) in runs.iter().enumerate() {
        let root = root_of(&mut parents, i);
        if hole_of_root[root] == usize::MAX {
            hole_of_root[root] = holes.len();
            holes.push(Vec::new());
        }
        holes[hole_of_root[root]].push(*run);
    }
    holes
}

/// Joins runs of neighbouring rows that share columns.
fn join_rows(
    runs: &[Run],
    above: std::ops::Range<usize>,
    here: std::ops::Range<usize>,
    parents: &mut [usize],
) {
    let (mut a, mut b) = (above.start, here.start);
    while a < above.end && b < here.end {
        if runs[a].first_col < runs[b].end_col && runs[b].first_col < runs[a].end_col {
            let (root_a, root_b) = (root_of(parents, a), root_of(parents, b));
            parents[root_a.max(root_b)] = root_a.min(root_b);
        }
        if runs[a].end_col < runs[b].end_col { a += 1 } else { b += 1 }
    }
}

fn root_of(parents: &mut [usize], mut run: usize) -> usize {
    while parents[run] != run {
        parents[run] = parents[parents[run]];
        run = parents[run];
    }
    run
}

/// Most residual of a filled hole, metres: errors stay below a millimetre in holes 100 cells wide.
const MEMBRANE_RESIDUAL_M: f64 = 1e-7;

/// Heights of a membrane stretched over a hole's rim; `None` without a rim.
///
/// Solves Laplace's equation on the hole's `cells` (ascending indices) by conjugate gradients: each
/// height is the mean of its four neighbours'. Over the grid's edge the membrane is level. It has no
/// plateau and stays between the rim's lowest and highest.
fn membrane(cols: usize, cells: &[usize], values: &[f32], valid: &[bool]) -> Option<Vec<f32>> {
    let rows = valid.len() / cols;
    let neighbours = |cell: usize| {
        let (row, col) = (cell / cols, cell % cols);
        [
            (row > 0).then(|| cell - cols),
            (col > 0).then(|| cell - 1),
            (col + 1 < cols).then(|| cell + 1),
            (row + 1 < rows).then(|| cell + cols),
        ]
    };
    let rim: Vec<f64> = cells
        .iter()
        .flat_map(|&cell| neighbours(cell).into_iter().flatten())
        .filter(|&n| valid[n])
        .map(|n| f64::from(values[n]))
        .collect();
    if rim.is_empty() {
        return None;
    }
    let level_m = rim.iter().sum::<f64>() / rim.len() as f64;

    let mut inner: Vec<[Option<usize>; 4]> = Vec::with_capacity(cells.len());
    let mut degrees: Vec<f64> = Vec::with_capacity(cells.len());
    let mut residuals: Vec<f64> = Vec::with_capacity(cells.len());
    for &cell in cells {
        let around = neighbours(cell);
        inner.push(around.map(|n| n.and_then(|n| cells.binary_search(&n).ok())));
        degrees.push(around.iter().flatten().count() as f64);
        let rim = around.into_iter().flatten().filter(|&n| valid[n]);
        residuals.push(rim.map(|n| f64::from(values[n]) - level_m).sum());
    }
    let applied = |x: &[f64], i: usize| {
        degrees[i] * x[i] - inner[i].iter().flatten().map(|&j| x[j]).sum::<f64>()
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();

    let mut heights = vec![0.0; cells.len()];
    let mut direction = residuals.clone();
    let mut squared = dot(&residuals, &residuals);
    // exact arithmetic needs one step a cell; rounding a few more
    for _ in 0..4 * cells.len() + 16 {
        if residuals.iter().all(|r| r.abs() <= MEMBRANE_RESIDUAL_M) {
            break;
        }
        let pushed: Vec<f64> = (0..cells.len()).map(|i| applied(&direction, i)).collect();
        let step = squared / dot(&direction, &pushed);
        for i in 0..cells.len() {
            heights[i] += step * direction[i];
            residuals[i] -= step * pushed[i];
        }
        let before = std::mem::replace(&mut squared, dot(&residuals, &residuals));
        for (d, r) in direction.iter_mut().zip(&residuals) {
            *d = r + squared / before * *d;
        }
    }
    Some(heights.into_iter().map(|h| (level_m + h) as f32).collect()) // heights fit f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane on `size` × `size` cells with the cells of `is_hole` missing.
    fn plane(size: usize, is_hole: impl Fn(usize, usize) -> bool) -> (Vec<f32>, Vec<bool>) {
        let height = |i: usize| 3000.0 + 0.7 * (i % size) as f32 - 0.3 * (i / size) as f32;
        let valid: Vec<bool> = (0..size * size).map(|i| !is_hole(i / size, i % size)).collect();
        let values = (0..size * size).map(|i| if valid[i] { height(i) } else { 0.0 }).collect();
        (values, valid)
    }

    fn fill(
        size: usize,
        cell_m: f64,
        up_to_m2: f64,
        grid: &mut (Vec<f32>, Vec<bool>),
    ) -> VoidCounts {
        fill_holes(size, cell_m, up_to_m2, &mut grid.0, &mut grid.1, &Reporter::silent()).unwrap()
    }

    #[test]
    fn a_hole_in_a_plane_is_filled_to_the_plane() {
        let disk = |row: usize, col: usize| (row as f64 - 20.0).hypot(col as f64 - 18.0) < 11.0;
        let mut grid = plane(40, disk);
        let counts = fill(40, 1.0, HOLE_MAX_AREA_M2, &mut grid);
        assert!(counts.filled_cells > 300 && counts.kept_cells == 0, "{counts:?}");
        let (whole, _) = plane(40, |_, _| false);
        for (found, expected) in grid.0.iter().zip(&whole) {
            assert!((found - expected).abs() < 1e-3, "{found} for {expected}");
        }
    }

    #[test]
    fn the_membrane_stays_within_its_rim() {
        let hole = |row: usize, col: usize| (5..12).contains(&row) && (4..15).contains(&col);
        let mut grid = plane(20, hole);
        for (i, v) in grid.0.iter_mut().enumerate() {
            *v += ((i * 7919) % 13) as f32;
        }
        let rim = |i: usize| (4..13).contains(&(i / 20)) && (3..16).contains(&(i % 20));
        let heights = |grid: &(Vec<f32>, Vec<bool>)| {
            let kept = (0..400).filter(|&i| rim(i) && grid.1[i]).map(|i| grid.0[i]);
            kept.fold((f32::MAX, f32::MIN), |(lo, hi), v| (lo.min(v), hi.max(v)))
        };
        let before = heights(&grid);
        fill(20, 1.0, 400.0, &mut grid);
        let after = heights(&grid);
        assert!(grid.1.iter().all(|v| *v));
        assert_eq!(before, after);
    }

    #[test]
    fn lakes_and_edges_stay_masked() {
        let lake = |row: usize, col: usize| (10..31).contains(&row) && (10..30).contains(&col);
        let mut grid = plane(40, lake);
        assert_eq!(
            fill(40, 1.0, 400.0, &mut grid),
            VoidCounts { filled_cells: 0, kept_cells: 420 }
        );
        // the same cells at half the size are a hole
        assert_eq!(fill(40, 0.5, 400.0, &mut grid).filled_cells, 420);
        let mut grid = plane(40, |row, col| row < 2 && col > 30);
        assert_eq!(fill(40, 1.0, 400.0, &mut grid).kept_cells, 18);
    }

    #[test]
    fn specks_are_filled_at_any_cell_size_and_at_the_edge() {
        let mut grid = plane(12, |row, col| (row == 5 && col == 5) || (row == 0 && col < 2));
        assert_eq!(fill(12, 90.0, 400.0, &mut grid), VoidCounts { filled_cells: 3, kept_cells: 0 });
        let mut grid = plane(12, |row, col| row == 5 && col == 5);
        assert_eq!(fill(12, 90.0, 0.0, &mut grid), VoidCounts { filled_cells: 0, kept_cells: 1 });
        // nothing to go by
        let mut nothing = (vec![0.0; 4], vec![false; 4]);
        assert_eq!(fill(2, 1.0, 400.0, &mut nothing).kept_cells, 4);
    }

    #[test]
    fn cells_that_touch_at_corners_are_two_holes_and_bends_are_one() {
        let diagonal = plane(6, |row, col| (row, col) == (2, 2) || (row, col) == (3, 3));
        assert_eq!(holes(6, &diagonal.1).len(), 2);
        let horseshoe = plane(7, |row, col| {
            (row == 4 && (1..6).contains(&col)) || ((1..4).contains(&row) && (col == 1 || col == 5))
        });
        assert_eq!(holes(7, &horseshoe.1).len(), 1);
    }
}
