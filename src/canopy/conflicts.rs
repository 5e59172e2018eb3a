//! Conflicts: trees too close to each other, and crowns inside another crown.
//!
//! Each tree looks at those its own crown reaches, found through a hash of places, all trees at once.

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use super::crowns::UNITS_PER_CELL;
use super::stand::{NO_TOP, Stand};
use super::working_cells::WorkingCells;

/// No two trunks are closer. chosen: as in Kapp's program (PAPER_NOTES §6).
pub const LEAST_SPACING_M: f32 = 1.0;

/// Width of a bucket of the hash. chosen: about a narrow crown's width, a handful of trees.
const BUCKET_M: f32 = 4.0;

/// Drops the lower of two trees that stand within [`LEAST_SPACING_M`], and trees whose crown lies within another's. A tree
/// that overtops the crown around it stays, and that crown shrinks, where its species allows and `may_shrink`. Gives how
/// many were dropped. Shrunk crowns may come to lie within others: without `may_shrink` no conflict is left.
pub fn resolve(cells: &WorkingCells<'_>, stand: &mut Stand, may_shrink: bool) -> usize {
    let places = Places::of(cells, stand);
    let spacing = (LEAST_SPACING_M * cells.units_per_m()).ceil() as i32; // tens
    let is_dropped: Vec<AtomicBool> = (0..stand.len()).map(|_| AtomicBool::new(false)).collect();
    let radii: Vec<i32> = (0..stand.len())
        .into_par_iter()
        .map(|tree| {
            let mut radius = stand.crowns.radius[tree];
            places.within(stand, tree, radius.max(spacing), |other| {
                let too_close = distance_squared(stand, tree, other) < spacing * spacing
                    && is_before(stand, tree, other);
                if too_close {
                    is_dropped[other].store(true, Ordering::Relaxed);
                    return;
                }
                let Some(room) = room_beside(stand, tree, other) else { return };
                let overtopped = stand.height_m[other] > stand.height_m[tree];
                if may_shrink && overtopped && room >= stand.narrowest[tree] {
                    radius = radius.min(room);
                } else {
                    is_dropped[other].store(true, Ordering::Relaxed);
                }
            });
            radius
        })
        .collect();
    for (tree, radius) in radii.into_iter().enumerate() {
        if radius != stand.crowns.radius[tree] {
            stand.resize(tree, radius);
        }
    }
    let is_kept: Vec<bool> = is_dropped.into_iter().map(|dropped| !dropped.into_inner()).collect();
    let before = stand.len();
    stand.keep(&is_kept);
    before - stand.len()
}

fn distance_squared(stand: &Stand, a: usize, b: usize) -> i32 {
    let (dx, dy) = (stand.crowns.x[a] - stand.crowns.x[b], stand.crowns.y[a] - stand.crowns.y[b]);
    dx * dx + dy * dy
}

/// Whether `a` goes before `b`: tops first, then the taller, then the one seeded earlier.
fn is_before(stand: &Stand, a: usize, b: usize) -> bool {
    let rank = |tree: usize| (stand.top[tree] != NO_TOP, stand.height_m[tree]);
    let ((a_top, a_height), (b_top, b_height)) = (rank(a), rank(b));
    (a_top, a_height) > (b_top, b_height) || ((a_top, a_height) == (b_top, b_height) && a < b)
}

/// Widest radius of `tree` with which `other`'s crown is not within its own, if it is within it now.
fn room_beside(stand: &Stand, tree: usize, other: usize) -> Option<i32> {
    let (radius, inner) = (stand.crowns.radius[tree], stand.crowns.radius[other]);
    let slack = radius - inner;
    let squared = distance_squared(stand, tree, other);
    if slack < 0 || squared > slack * slack || (slack == 0 && !is_before(stand, tree, other)) {
        return None;
    }
    Some(inner + super::crowns::whole_root(squared) - 1)
}

/// Trees by the bucket that their trunk lies in.
struct Places {
    bucket_units: i32,
    cols: usize,
    rows: usize,
    /// Where each bucket's trees begin in `trees`; one more at the end.
    starts: Vec<u32>,
    trees: Vec<u32>,
}

impl Places {
    fn of(cells: &WorkingCells<'_>, stand: &Stand) -> Self {
        let bucket_units = (BUCKET_M * cells.units_per_m()) as i32; // hundreds
        let buckets = |cells: usize| cells * UNITS_PER_CELL as usize / bucket_units as usize + 1;
        let (rows, cols) = (buckets(cells.size.rows), buckets(cells.size.cols));
        let mut places =
            Self { bucket_units, cols, rows, starts: vec![0; rows * cols + 1], trees: Vec::new() };
        // counting sort; trees of a bucket stay in order
        let bucket: Vec<usize> = (0..stand.len())
            .map(|tree| {
                let [row, col] =
                    [stand.crowns.y[tree], stand.crowns.x[tree]].map(|at| places.along(at));
                row.min(rows - 1) * cols + col.min(cols - 1)
            })
            .collect();
        for &at in &bucket {
            places.starts[at + 1] += 1;
        }
        for at in 0..rows * cols {
            places.starts[at + 1] += places.starts[at];
        }
        let mut next = places.starts.clone();
        places.trees = vec![0; stand.len()];
        for (tree, &at) in (0_u32..).zip(&bucket) {
            places.trees[next[at] as usize] = tree;
            next[at] += 1;
        }
        places
    }

    fn along(&self, at: i32) -> usize {
        (at.max(0) / self.bucket_units) as usize // not negative
    }

    /// Calls `found` for every other tree at most `reach` from `tree`, and some beyond.
    fn within(&self, stand: &Stand, tree: usize, reach: i32, mut found: impl FnMut(usize)) {
        let (x, y) = (stand.crowns.x[tree], stand.crowns.y[tree]);
        for row in self.along(y - reach)..=self.along(y + reach).min(self.rows - 1) {
            let first = row * self.cols + self.along(x - reach);
            let last = row * self.cols + self.along(x + reach).min(self.cols - 1);
            let trees = self.starts[first] as usize..self.starts[last + 1] as usize;
            for &other in &self.trees[trees] {
                if other as usize != tree {
                    found(other as usize);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::stand::fixture::on_ground;
    use super::super::stand::{Ground, Stand};
    use super::*;
    use crate::raster::Cell;

    /// Canopy that falls by half a metre a column.
    fn with_stand(test: impl FnOnce(&Ground<'_>, &mut Stand)) {
        let slope = |cell: Cell| 30.0 - 0.5 * cell.col as f32;
        on_ground([30, 40], slope, "redwood", |ground| test(ground, &mut Stand::default()));
    }

    #[test]
    fn of_two_trunks_too_close_the_lower_goes_unless_it_makes_a_top() {
        with_stand(|ground, stand| {
            stand.plant(ground, [5, 10], 100, false);
            stand.plant(ground, [5, 10], 100, false);
            stand.crowns.x[1] += 31; // 31/32 m
            stand.height_m[1] -= 1.0;
            stand.plant(ground, [20, 10], 100, false);
            stand.plant(ground, [20, 10], 100, true);
            stand.crowns.x[3] += 20;
            stand.height_m[3] -= 1.0;
            stand.plant(ground, [20, 30], 60, false);
            stand.plant(ground, [20, 30], 60, false);
            stand.crowns.x[5] += 32; // a metre apart
            let heights =
                [stand.height_m[0], stand.height_m[3], stand.height_m[4], stand.height_m[5]];
            assert_eq!(resolve(ground.cells, stand, false), 2);
            assert_eq!(stand.height_m, heights);
        });
    }

    #[test]
    fn a_crown_within_another_goes_or_the_outer_one_shrinks_below_a_taller() {
        with_stand(|ground, stand| {
            // a low tree within a tall one's crown
            stand.plant(ground, [10, 5], 150, false);
            stand.plant(ground, [10, 7], 70, false);
            // a tall tree within a low one's crown, which may be narrower
            stand.plant(ground, [20, 30], 130, false);
            stand.plant(ground, [20, 28], 60, false);
            assert!(stand.narrowest[2] < 60 + 2 * 32);
            let mut strict = stand.clone();
            assert_eq!(resolve(ground.cells, stand, true), 1);
            assert_eq!(stand.crowns.radius, [150, 60 + 2 * 32 - 1, 60]);
            assert_eq!(resolve(ground.cells, &mut strict, false), 2);
            assert_eq!(strict.crowns.radius, [150, 130]);
        });
    }

    #[test]
    fn of_equal_crowns_at_nearly_one_place_one_stays() {
        with_stand(|ground, stand| {
            for _ in 0..3 {
                stand.plant(ground, [10, 10], 90, false);
            }
            assert_eq!(resolve(ground.cells, stand, true), 2);
            assert_eq!(resolve(ground.cells, &mut Stand::default(), true), 0);
        });
    }
}
