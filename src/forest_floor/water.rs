//! Open water: cells that a river takes up at least half of, where neither grass nor litter is.

use crate::abiotics::MoistureParams;
use crate::canopy::learned::bare::RIVER_WIDTH_M;
use crate::raster::{Cell, Grid, Mask};

/// Valid cells without those under open water. A river is as wide as its discharge has it; brooks narrower than half a
/// cell leave their cell to the ground beside them.
pub fn dry_land(discharge_m3_s: &Grid<f32>) -> Mask {
    let least_m3_s = MoistureParams::default().river_discharge_m3_s;
    let frame = discharge_m3_s.frame();
    let mut dry = discharge_m3_s.mask().as_slice().to_vec();
    for (index, &discharge) in discharge_m3_s.values().iter().enumerate() {
        if discharge < least_m3_s || !discharge_m3_s.mask().is_valid(index) {
            continue;
        }
        let width = RIVER_WIDTH_M * discharge.max(0.0).sqrt() / frame.cell_m();
        if width < 0.5 {
            continue;
        }
        // cells whose middles lie within half the width, and the river's own
        let reach = width / 2.0;
        let Cell { row, col } = frame.cell(index);
        let steps = reach as usize; // whole cells, cut
        for other_row in row.saturating_sub(steps)..=(row + steps).min(frame.rows - 1) {
            for other_col in col.saturating_sub(steps)..=(col + steps).min(frame.cols - 1) {
                let (down, right) =
                    (row.abs_diff(other_row) as f32, col.abs_diff(other_col) as f32);
                if down * down + right * right <= reach * reach {
                    dry[frame.index(Cell { row: other_row, col: other_col })] = false;
                }
            }
        }
    }
    Mask::new(dry)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wet_columns(discharge: f32) -> usize {
        let flow = Grid::from_fn(30, 60, 1.0, |c| if c.col == 31 { discharge } else { 0.0 });
        let dry = dry_land(&flow);
        dry.as_slice()[15 * 60..16 * 60].iter().filter(|dry| !**dry).count()
    }

    #[test]
    fn brooks_have_banks_of_grass_and_rivers_their_width_of_water() {
        assert_eq!(wet_columns(0.002), 0);
        assert_eq!(wet_columns(0.02), 1);
        // 12 m wide
        assert_eq!(wet_columns(4.0), 13);
    }
}
