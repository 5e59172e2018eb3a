//! Bare ground: where no tree stands whatever is painted, because ground is too steep or under water.

use super::coarse::CoarseCells;
use crate::raster::{Cell, Grid};

/// Slope from which ground is a cliff, as rise per run at coarse cells: 50°. chosen: few trees hold on steeper ground.
pub const CLIFF_SLOPE: f32 = 1.192;
/// Width of a river at a mean discharge of 1 m³/s, m; it grows with the root of discharge.
///
/// # Reference
/// Leopold & Maddock 1953, USGS Professional Paper 252: widths go with discharge to the power 0.5; the factor is chosen
/// from the 5–8 m that streams of that size have.
pub const RIVER_WIDTH_M: f32 = 6.0;

/// Coarse cells that rivers of these discharges (m³/s) take up at least half of. On wider scene cells a river is as wide as
/// they are: where in them it runs is not known.
pub fn under_rivers(discharge_m3_s: &Grid<f32>, cells: &CoarseCells) -> Vec<bool> {
    let (frame, coarse) = (discharge_m3_s.frame(), &cells.frame);
    let (from, to) = (frame.transform, coarse.transform);
    let mut bare = vec![false; coarse.len()];
    // channels of wide cells touch those of the next ones, also of diagonal ones
    let joined_m = if from.cell_m > to.cell_m { from.cell_m * f64::sqrt(0.5) } else { 0.0 };
    let width_m = |discharge: f32| RIVER_WIDTH_M * discharge.max(0.0).sqrt();
    for (index, discharge) in discharge_m3_s.values().iter().enumerate() {
        let width_m = width_m(*discharge);
        // cells fit f32
        if width_m < 0.5 * to.cell_m as f32 || !discharge_m3_s.mask().is_valid(index) {
            continue;
        }
        let at = from.center(frame.cell(index));
        let (east, south) =
            ((at.east_m - to.west_m) / to.cell_m, (to.north_m - at.north_m) / to.cell_m);
        // coarse cells whose centres lie within the river's half width, and the one that the channel is in
        let reach = (f64::from(width_m) / 2.0).max(joined_m) / to.cell_m;
        let span = |at: f64, count: usize| {
            // `as` cuts negatives to 0
            let first = (at - reach).floor() as usize;
            first..((at + reach).ceil().max(0.0) as usize).min(count)
        };
        for row in span(south, coarse.rows) {
            for col in span(east, coarse.cols) {
                let away = f64::hypot(row as f64 + 0.5 - south, col as f64 + 0.5 - east);
                let holds = row == south as usize && col == east as usize;
                bare[coarse.index(Cell { row, col })] |= holds || away < reach;
            }
        }
    }
    bare
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bare_columns(discharge: f32) -> usize {
        let river = Grid::from_fn(40, 200, 1.0, |c| if c.col == 101 { discharge } else { 0.0 });
        let cells = CoarseCells::of(river.frame());
        let bare = under_rivers(&river, &cells);
        bare[5 * 50..6 * 50].iter().filter(|bare| **bare).count()
    }

    #[test]
    fn rivers_of_wide_cells_are_not_dotted() {
        let river = Grid::from_fn(30, 30, 10.0, |c| if c.row == c.col { 2.0 } else { 0.0 });
        let cells = CoarseCells::of(river.frame());
        let bare = under_rivers(&river, &cells);
        let rows = bare.chunks_exact(cells.frame.cols);
        let counts: Vec<usize> = rows.map(|row| row.iter().filter(|bare| **bare).count()).collect();
        assert!(counts.iter().all(|count| (1..=5).contains(count)), "{counts:?}");
    }

    #[test]
    fn brooks_run_under_trees_and_rivers_do_not() {
        assert_eq!(bare_columns(0.05), 0);
        assert_eq!(bare_columns(0.2), 1);
        // 30 m wide
        assert!((7..=9).contains(&bare_columns(25.0)), "{}", bare_columns(25.0));
    }
}
