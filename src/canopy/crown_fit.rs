//! Crown fit: how wide each crown is, and where its trunk stands, by the canopy around it.
//!
//! A crown is wide enough where one step more would lie more over what is no canopy than over canopy that no other crown
//! covers. The species' envelope bounds it. A trunk moves where its crown is worth more.
//!
//! # Departures
//! Kapp et al. 2020, Eq. 2 gives the radius by height alone: then crowns leave gaps where real ones are wide and hang far
//! over edges where real ones are narrow. The allometry is the middle of the envelope here.

use super::cover::Cover;
use super::crowns::{UNITS_PER_CELL, disk_spans, middle_units};
use super::stand::{Ground, Stand, UNSETTLED};
use super::tiles::Tiling;

/// Radii between the narrowest and the widest that are tried, at most. chosen: steps of a few hundredths of the radius.
const STEPS: usize = 32;
/// How far a trunk moves at once: half a cell. chosen: small crowns cover whole cells only from between them.
const MOVE_UNITS: i32 = UNITS_PER_CELL / 2;

/// Worth of a cell of canopy that no other crown covers: what prices are measured in.
pub const CANOPY_WORTH: i32 = 10;

/// A crown at a place: the radius of the greatest worth, and that worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fit {
    /// Radius in units.
    pub radius: i32,
    /// Canopy that it alone covers less the price of what is no canopy, in [`CANOPY_WORTH`] a cell.
    pub worth: i32,
}

/// The cells around a place that no crown covers, by which crowns there are fitted. Kept and refilled.
#[derive(Debug, Default)]
pub struct Surroundings {
    /// From the place to the cell's middle, units.
    dx: Vec<f32>,
    dy: Vec<f32>,
    /// Worth of the cell, in [`CANOPY_WORTH`].
    worth: Vec<i32>,
    /// Which step each cell lies in.
    steps: Vec<i32>,
    /// How much wider than it must be a crown is made where that costs nothing.
    free_units: i32,
}

impl Surroundings {
    /// Looks around (`x`, `y`) as far as `reach`; `price` is what a cell that is no canopy costs. `cover` counts all crowns
    /// but the one to be fitted.
    pub fn look(
        &mut self,
        ground: &Ground<'_>,
        cover: &Cover,
        [x, y]: [i32; 2],
        reach: i32,
        price: i32,
    ) {
        let size = ground.cells.size;
        // middles of working cells are but samples of wider scene cells
        self.free_units = if ground.cells.per_cell > 1 { UNITS_PER_CELL / 2 } else { 0 };
        self.dx.clear();
        self.dy.clear();
        self.worth.clear();
        for span in disk_spans(x, y, reach, size) {
            let dy = (middle_units(span.row) - y) as f32; // thousands
            let cells = span.row * size.cols + span.first_col..span.row * size.cols + span.end_col;
            let covers = cover.counts(cells.clone());
            for ((col, count), &is_canopy) in
                (span.first_col..).zip(covers).zip(&ground.cells.is_canopy[cells])
            {
                // what another crown covers too is neither gained nor lost
                if count == 0 {
                    self.dx.push((middle_units(col) - x) as f32);
                    self.dy.push(dy);
                    self.worth.push(if is_canopy { CANOPY_WORTH } else { -price });
                }
            }
        }
    }

    /// The best crown with its trunk (`dx`, `dy`) from the place, of those that end within reach.
    pub fn best_fit(&mut self, [dx, dy]: [i32; 2], [narrowest, widest]: [i32; 2]) -> Fit {
        // steps inwards from the widest crown; the innermost holds all that the narrowest covers, the one before the first
        // what lies outside
        let range = widest - narrowest;
        let step_log2 = (range / STEPS as i32 + 1).ilog2() + 1; // 2^step_log2 > range / STEPS
        let innermost = range >> step_log2;
        // whole numbers below 2²⁴ and quotients by powers of two: exact, but for the root, whose rounding crosses no radius
        let (dx, dy) = (dx as f32, dy as f32);
        let past_widest = (widest + (1 << step_log2)) as f32;
        let steps_per_unit = 1.0 / (1 << step_log2) as f32;
        let last = (innermost + 1) as f32;
        self.steps.clear();
        self.steps.extend(self.dx.iter().zip(&self.dy).map(|(cell_dx, cell_dy)| {
            let (dx, dy) = (cell_dx - dx, cell_dy - dy);
            let step = (past_widest - (dx * dx + dy * dy).sqrt()) * steps_per_unit;
            let step = if step < last { step } else { last };
            (if step > 0.0 { step } else { 0.0 }) as i32 // 0..=innermost + 1
        }));
        let mut worth_of = [0_i32; STEPS + 2];
        for (&step, worth) in self.steps.iter().zip(&self.worth) {
            worth_of[step as usize] += worth; // 0..STEPS + 2
        }

        // the radius of the greatest worth; of equals the one nearest to the middle of the envelope
        let middle = i32::midpoint(narrowest, widest);
        let mut best = (i32::MIN, 0, 0);
        let mut worth = 0;
        for step in (0..=innermost).rev() {
            worth += worth_of[step as usize + 1]; // not negative
            worth_of[step as usize + 1] = worth;
            let radius = widest - (step << step_log2);
            best = best.max((worth, -(radius - middle).abs(), radius));
        }

        // then wider, for what lies between the cells' middles
        let (worth, _, narrow) = best;
        let wider = (0..=innermost).rev().map(|step| (step, widest - (step << step_log2)));
        let radius = wider
            .filter(|&(_, radius)| (narrow..=narrow + self.free_units).contains(&radius))
            .take_while(|&(step, _)| worth_of[step as usize + 1] == worth)
            .last()
            .map_or(narrow, |(_, radius)| radius);
        Fit { radius, worth }
    }
}

/// Fits every crown once, one after the other among neighbours, and drops trees whose crown is worth less than
/// `least_worth` says for the tree. Gives how many were dropped.
pub fn fit(
    ground: &Ground<'_>,
    tiling: Tiling,
    cover: &Cover,
    price: i32,
    least_worth: impl Fn(usize, &Stand) -> i32 + Sync,
    stand: &mut Stand,
) -> usize {
    let trees = tiling.sorted(stand.crowns.x.iter().copied().zip(stand.crowns.y.iter().copied()));
    let fits = tiling.run(|tile| {
        let mut around = Surroundings::default();
        let fit = |&tree: &u32| {
            let tree = tree as usize;
            let (x, y) = (stand.crowns.x[tree], stand.crowns.y[tree]);
            cover.remove(x, y, stand.crowns.radius[tree]);
            let (at, fit) = best_place(ground, cover, &mut around, price, stand, tree);
            if fit.worth < least_worth(tree, stand) {
                return None;
            }
            cover.add(at[0], at[1], fit.radius);
            Some((at, fit))
        };
        trees[tile].iter().map(fit).collect::<Vec<_>>()
    });
    let mut is_kept = vec![true; stand.len()];
    for (&tree, fit) in trees.iter().flatten().zip(fits.into_iter().flatten()) {
        let tree = tree as usize;
        if let Some(([x, y], Fit { radius, worth })) = fit {
            let stays = [x, y, radius]
                == [stand.crowns.x[tree], stand.crowns.y[tree], stand.crowns.radius[tree]];
            stand.move_to(ground, tree, x, y);
            stand.resize(tree, radius);
            stand.settled_worth[tree] = if stays { worth } else { UNSETTLED };
        } else {
            is_kept[tree] = false;
        }
    }
    let before = stand.len();
    stand.keep(&is_kept);
    before - stand.len()
}

/// Where around its place a tree's crown is worth most, and that crown; where it is, if nowhere more.
fn best_place(
    ground: &Ground<'_>,
    cover: &Cover,
    around: &mut Surroundings,
    price: i32,
    stand: &Stand,
    tree: usize,
) -> ([i32; 2], Fit) {
    let here = [stand.crowns.x[tree], stand.crowns.y[tree]];
    let envelope = [stand.narrowest[tree], stand.widest[tree]];
    if stand.settled_worth[tree] != UNSETTLED {
        around.look(ground, cover, here, envelope[1], price);
        let fit = around.best_fit([0, 0], envelope);
        if fit.worth == stand.settled_worth[tree] && fit.radius == stand.crowns.radius[tree] {
            return (here, fit); // a shortcut: as it was when no place around was better
        }
    }
    let moves = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, 1), (1, -1), (-1, 1)]
        .map(|(dx, dy)| [dx * MOVE_UNITS, dy * MOVE_UNITS]);
    let envelopes = moves.map(|[dx, dy]| {
        let standing = stand.standing_at(ground, tree, [here[0] + dx, here[1] + dy])?;
        Some([standing.narrowest, standing.widest])
    });
    let widest = envelopes.iter().flatten().map(|envelope| envelope[1]).fold(envelope[1], i32::max);
    around.look(ground, cover, here, widest + 2 * MOVE_UNITS, price);
    let stays = (here, around.best_fit([0, 0], envelope));
    let fits = moves.iter().zip(envelopes).filter_map(|(&[dx, dy], envelope)| {
        Some(([here[0] + dx, here[1] + dy], around.best_fit([dx, dy], envelope?)))
    });
    let better = |best: ([i32; 2], Fit), other: ([i32; 2], Fit)| {
        if other.1.worth > best.1.worth { other } else { best }
    };
    fits.fold(stays, better)
}

#[cfg(test)]
mod tests {
    use super::super::stand::fixture::on_ground;
    use super::*;
    use crate::raster::Cell;

    /// Canopy within `radius` cells of the middle of a 41 × 41 m map.
    fn disk(radius: f32) -> impl Fn(Cell) -> f32 {
        move |Cell { row, col }| {
            let (dy, dx) = (row as f32 - 20.0, col as f32 - 20.0);
            if dx * dx + dy * dy <= radius * radius { 12.0 } else { 0.0 }
        }
    }

    /// Worth of a crown, cell by cell.
    fn worth(ground: &Ground<'_>, cover: &Cover, [x, y]: [i32; 2], radius: i32, price: i32) -> i32 {
        let cols = ground.cells.size.cols;
        disk_spans(x, y, radius, ground.cells.size)
            .flat_map(|span| span.row * cols + span.first_col..span.row * cols + span.end_col)
            .filter(|&index| cover.count(index) == 0)
            .map(|index| if ground.cells.is_canopy[index] { CANOPY_WORTH } else { -price })
            .sum()
    }

    #[test]
    fn the_best_crown_is_the_best_of_all_its_radii() {
        on_ground([41, 41], disk(9.0), "redwood", |ground| {
            let cover = Cover::new(ground.cells.size);
            cover.add(500, 700, 130);
            let mut around = Surroundings::default();
            let place = [middle_units(20) + 5, middle_units(22) - 11];
            for (moved, envelope, price) in [
                ([0, 0], [100, 420], 9),
                ([16, -16], [100, 420], 9),
                ([0, 16], [60, 61], 3),
                ([-16, 0], [1, 400], 20),
                ([0, 0], [200, 200], 5),
            ] {
                let at = [place[0] + moved[0], place[1] + moved[1]];
                around.look(ground, &cover, place, 460, price);
                let fit = around.best_fit(moved, envelope);
                assert_eq!(fit.worth, worth(ground, &cover, at, fit.radius, price));
                assert!((envelope[0]..=envelope[1]).contains(&fit.radius));
                // radii are tried in steps of a sixteenth of the envelope at most
                let step = ((envelope[1] - envelope[0]) / 16).max(1) as usize;
                for radius in (0..).map(|i| envelope[1] - (i * step) as i32) {
                    if radius < envelope[0] {
                        break;
                    }
                    let cells_of_a_step = 2 * radius * step as i32 / 160 + 10;
                    let other = worth(ground, &cover, at, radius, price);
                    assert!(fit.worth >= other - cells_of_a_step * CANOPY_WORTH, "{radius}");
                }
            }
        });
    }

    #[test]
    fn a_trunk_climbs_to_where_its_crown_fits() {
        on_ground([41, 41], disk(2.5), "redwood", |ground| {
            let mut stand = Stand::default();
            stand.plant(
                ground,
                [18, 19],
                ground.envelopes.at(stand_species(ground), 12.0)[0],
                false,
            );
            let cover = Cover::new(ground.cells.size);
            cover.count_all(&stand.crowns);
            let tiling = Tiling::new(ground.cells.size, ground.envelopes.widest());
            for _ in 0..8 {
                assert_eq!(fit(ground, tiling, &cover, 9, |_, _| 10, &mut stand), 0);
            }
            let middle = middle_units(20);
            let (dx, dy) = (stand.crowns.x[0] - middle, stand.crowns.y[0] - middle);
            assert!(dx.abs() <= 16 && dy.abs() <= 16, "({dx}, {dy})");
            assert_ne!(stand.settled_worth[0], UNSETTLED);
            assert_eq!(cover.covered_fraction(&ground.cells.is_canopy), 1.0);
            // a canopy that others cover keeps no tree
            let many = |_: usize, _: &Stand| 22 * CANOPY_WORTH;
            assert_eq!(fit(ground, tiling, &cover, 9, many, &mut stand), 1);
            assert_eq!(cover.covered_fraction(&ground.cells.is_canopy), 0.0);
        });
    }

    fn stand_species(ground: &Ground<'_>) -> u8 {
        ground.species.values()[0]
    }
}
