//! Quality: how well placed trees make up the canopy height model.

use rayon::prelude::*;

use super::crowns::{middle_units, whole_root};
use super::stand::{Ground, Stand};
use super::visibility::{NO_CROWN, Visibility};

/// How well trees fit the canopy, on working cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Quality {
    /// Share of the canopy that lies under some crown.
    pub coverage_fraction: f64,
    /// Share of the ground under crowns that is no canopy.
    pub overhang_fraction: f64,
    /// Share of the canopy on which no species can stand.
    pub unsuitable_fraction: f64,
    /// Root mean square of tree height less the canopy's height at the trunk, m.
    pub height_rmse_m: f64,
    /// Root mean square of the crowns' upper surface less the canopy's height, over canopy under crowns, m. Crowns are
    /// spheres here, so this also holds how much real crowns differ from them.
    pub surface_rmse_m: f64,
}

/// How well `stand` fits the canopy; `visibility` is what the sky sees of it.
pub fn measure(ground: &Ground<'_>, stand: &Stand, visibility: &Visibility) -> Quality {
    let cells = ground.cells;
    let counts = (0..cells.size.rows)
        .into_par_iter()
        .map(|row| row_counts(ground, stand, visibility, row))
        // in the order of rows, so that sums have the same bits for any number of threads
        .collect::<Vec<_>>()
        .into_iter()
        .fold(Counts::default(), Counts::plus);
    // from 0.0, for the sum of nothing is −0.0
    let squares: f64 = (0..stand.len())
        .map(|tree| {
            let index = cells.index_at(stand.crowns.x[tree], stand.crowns.y[tree]);
            let difference_m =
                stand.height_m[tree] - ground.chm_m.values()[cells.scene_index(index)];
            f64::from(difference_m).powi(2)
        })
        .fold(0.0, |sum, square| sum + square);
    let share = |part: u64, of: u64| if of == 0 { 0.0 } else { part as f64 / of as f64 };
    Quality {
        coverage_fraction: if counts.canopy == 0 {
            1.0
        } else {
            share(counts.covered, counts.canopy)
        },
        overhang_fraction: share(counts.overhanging, counts.overhanging + counts.covered),
        unsuitable_fraction: share(counts.unsuitable, counts.canopy),
        height_rmse_m: (squares / stand.len().max(1) as f64).sqrt(),
        surface_rmse_m: (counts.surface_squares / counts.covered.max(1) as f64).sqrt(),
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    canopy: u64,
    covered: u64,
    overhanging: u64,
    unsuitable: u64,
    surface_squares: f64,
}

impl Counts {
    fn plus(self, other: Self) -> Self {
        Self {
            canopy: self.canopy + other.canopy,
            covered: self.covered + other.covered,
            overhanging: self.overhanging + other.overhanging,
            unsuitable: self.unsuitable + other.unsuitable,
            surface_squares: self.surface_squares + other.surface_squares,
        }
    }
}

fn row_counts(ground: &Ground<'_>, stand: &Stand, visibility: &Visibility, row: usize) -> Counts {
    let cells = ground.cells;
    let m_per_unit = 1.0 / cells.units_per_m();
    let mut counts = Counts::default();
    for col in 0..cells.size.cols {
        let index = row * cells.size.cols + col;
        let owner = visibility.owner[index];
        if !cells.is_canopy[index] {
            counts.overhanging += u64::from(owner != NO_CROWN);
            continue;
        }
        counts.canopy += 1;
        counts.unsuitable += u64::from(!cells.is_plantable(index, ground.species));
        if owner == NO_CROWN {
            continue;
        }
        counts.covered += 1;
        // the sphere's upper surface over this cell
        let tree = owner as usize;
        let (dx, dy) =
            (middle_units(col) - stand.crowns.x[tree], middle_units(row) - stand.crowns.y[tree]);
        let radius = stand.crowns.radius[tree];
        let drop = radius - whole_root(radius * radius - dx * dx - dy * dy);
        let surface_m = stand.height_m[tree] - drop as f32 * m_per_unit; // thousands of units
        let difference_m = surface_m - ground.chm_m.values()[cells.scene_index(index)];
        counts.surface_squares += f64::from(difference_m).powi(2);
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::super::stand::fixture::on_ground;
    use super::super::visibility::{CpuVisibility, RenderVisibility};
    use super::*;
    use crate::raster::Cell;

    #[test]
    fn one_crown_is_counted_by_hand() {
        // canopy in the west half; a crown of 2.5 m with its trunk on the last column of it
        let height_m = |cell: Cell| if cell.col < 10 { 12.0 } else { 0.0 };
        on_ground([20, 20], height_m, "redwood", |ground| {
            let mut stand = Stand::default();
            stand.plant(ground, [10, 9], 80, false);
            stand.height_m[0] += 1.5;
            let mut visibility = Visibility::default();
            CpuVisibility.render(&stand.crowns, ground.cells.canopy(), &mut visibility).unwrap();
            let quality = measure(ground, &stand, &visibility);
            // columns of 5, 5, 3 cells on the canopy, 5 and 3 beyond it
            assert_eq!(quality.coverage_fraction, 13.0 / 200.0);
            assert_eq!(quality.overhang_fraction, 8.0 / 21.0);
            assert_eq!(quality.unsuitable_fraction, 0.0);
            assert!((quality.height_rmse_m - 1.5).abs() < 1e-6);
            // 1.5 m over the canopy in the middle, lower outwards by the sphere
            assert!(quality.surface_rmse_m < 1.5 && quality.surface_rmse_m > 0.3);
        });
    }
}
