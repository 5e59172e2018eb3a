//! Seeding: trees under the canopy's tops, and in what no crown covers.
//!
//! # Reference
//! Kapp et al. 2020, section 5.2: initial seeds at local maxima, later ones in exposed canopy.
//! # Departures
//! Later seeds are drawn from all canopy under at most one crown, those first whose crown gains most, where the paper
//! tries points on rings around the trees.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use super::cover::{Cover, OpenCells};
use super::crown_fit::{CANOPY_WORTH, Surroundings};
use super::crowns::{CenteredDisks, UNITS_PER_CELL, middle_units};
use super::stand::{Ground, Standing};
use super::tiles::Tiling;
use crate::math;

/// Blur before tops are sought on cells of up to a metre. chosen: single returns between branches make tops of their own
/// on finer surfaces; half a metre is what foresters' tools use on 1 m cells.
const TOP_BLUR_SIGMA_M: f32 = 0.5;

/// Share of a new crown's cells that must be its gain. chosen: above the share at
/// which trees starve, so that a seed outlives its round.
const LEAST_SHOWN_FRACTION: f32 = 0.25;

/// Working cells that stand above all their eight neighbours, where a tree can stand; of equals the first in order.
pub fn tops(ground: &Ground<'_>) -> Vec<usize> {
    let cells = ground.cells;
    let (rows, cols) = (cells.size.rows, cells.size.cols);
    // interpolated surfaces are smooth already
    let blurred;
    let surface: &[f32] = if cells.per_cell == 1 {
        blurred = blur(&cells.surface_m, cols, TOP_BLUR_SIGMA_M / cells.cell_m);
        &blurred
    } else {
        &cells.surface_m
    };
    let is_top = |row: usize, col: usize| {
        let index = row * cols + col;
        let height = surface[index];
        let neighbors = (row.saturating_sub(1)..(row + 2).min(rows))
            .flat_map(|r| (col.saturating_sub(1)..(col + 2).min(cols)).map(move |c| r * cols + c));
        neighbors
            .filter(|&n| n != index)
            .all(|n| surface[n] < height || (surface[n] == height && index < n))
    };
    let in_row = |row: usize| {
        (0..cols)
            .filter(move |&col| {
                cells.is_plantable(row * cols + col, ground.species) && is_top(row, col)
            })
            .map(move |col| row * cols + col)
            .collect::<Vec<_>>()
    };
    (0..rows).into_par_iter().flat_map_iter(in_row).collect()
}

/// Gaussian blur along rows, then along columns; beyond the edges the edge's values go on.
fn blur(values: &[f32], cols: usize, sigma_cells: f32) -> Vec<f32> {
    let reach = (3.0 * sigma_cells).ceil() as isize; // a few cells
    let weight = |at: isize| math::exp(-(at * at) as f32 / (2.0 * sigma_cells * sigma_cells));
    let sum: f32 = (-reach..=reach).map(weight).sum();
    let kernel: Vec<f32> = (-reach..=reach).map(|at| weight(at) / sum).collect();
    let rows = values.len() / cols;
    let clamped = |at: isize, len: usize| at.clamp(0, len as isize - 1) as usize;
    let mut along_rows = vec![0.0; values.len()];
    along_rows.par_chunks_mut(cols).zip(values.par_chunks(cols)).for_each(|(out, row)| {
        for (col, out) in out.iter_mut().enumerate() {
            let taps = (-reach..=reach).zip(&kernel);
            *out = taps.map(|(at, w)| w * row[clamped(col as isize + at, cols)]).sum();
        }
    });
    let mut blurred = vec![0.0; values.len()];
    blurred.par_chunks_mut(cols).enumerate().for_each(|(row, out)| {
        for (at, w) in (-reach..=reach).zip(&kernel) {
            let source = &along_rows[clamped(row as isize + at, rows) * cols..][..cols];
            for (out, value) in out.iter_mut().zip(source) {
                *out += w * value;
            }
        }
    });
    blurred
}

/// A tree to be: the working cell of its trunk, and its crown's radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seed {
    /// Index of the working cell.
    pub index: usize,
    /// Radius in units.
    pub radius: i32,
    /// What it is.
    pub standing: Standing,
}

/// Those of `tops` whose crown is worth at least `least_worth_fraction` of the narrowest that it may have; within a tile the
/// tallest first, and each with the crown that fits what those before it leave. `cover` then counts them.
pub fn accepted_tops(
    ground: &Ground<'_>,
    tiling: Tiling,
    cover: &Cover,
    tops: &[usize],
    price: i32,
    least_worth_fraction: f32,
) -> Vec<Seed> {
    let by_tile = tiling.sorted(tops.iter().map(|&index| place(ground, index).into()));
    let accepted = tiling.run(|tile| {
        let mut listed: Vec<(Standing, usize)> = by_tile[tile]
            .iter()
            .filter_map(|&at| Some((ground.standing(tops[at as usize])?, tops[at as usize])))
            .collect();
        listed.sort_by(|(a, a_index), (b, b_index)| {
            b.height_m.total_cmp(&a.height_m).then(a_index.cmp(b_index))
        });
        let mut around = Surroundings::default();
        let accept = |(standing, index): (Standing, usize)| {
            let [x, y] = place(ground, index);
            around.look(ground, cover, [x, y], standing.widest, price);
            let fit = around.best_fit([0, 0], [standing.narrowest, standing.widest]);
            let least = least_worth_fraction * disk_worth(standing.narrowest);
            (fit.worth as f32 >= least).then(|| {
                cover.add(x, y, fit.radius);
                Seed { index, radius: fit.radius, standing }
            })
        };
        listed.into_iter().filter_map(accept).collect::<Vec<_>>()
    });
    accepted.concat()
}

/// Middle of a working cell, in units.
fn place(ground: &Ground<'_>, index: usize) -> [i32; 2] {
    let cols = ground.cells.size.cols;
    [middle_units(index % cols), middle_units(index / cols)]
}

/// Worth of a disk full of canopy.
fn disk_worth(radius: i32) -> f32 {
    let cells = radius as f32 / UNITS_PER_CELL as f32;
    (std::f32::consts::PI * cells * cells).max(1.0) * CANOPY_WORTH as f32
}

/// New trees that reach canopy which no crown covers: the most worth first, each with the crown that fits what those
/// before it leave, until none is worth `least_worth`. `cover` then counts them.
pub fn openings(
    ground: &Ground<'_>,
    tiling: Tiling,
    cover: &Cover,
    price: i32,
    least_worth: i32,
) -> Vec<Seed> {
    let size = ground.cells.size;
    let open = OpenCells::of(cover, &ground.cells.is_canopy);
    let disks = CenteredDisks::new(ground.envelopes.widest());
    let fit_at = |index: usize, around: &mut Surroundings| {
        // most candidates find too little: counted before anything else, in the widest crown that may stand here
        let [narrowest, widest] = ground.widest_envelope(index)?;
        let least_gain = least_worth.max((LEAST_SHOWN_FRACTION * disk_worth(narrowest)) as i32);
        let (row, col) = (index / size.cols, index % size.cols);
        let most_cells = open.count_in_disk(row, col, disks.half_widths(widest));
        if (most_cells as i32) * CANOPY_WORTH < least_gain {
            return None;
        }
        let standing = ground.standing(index)?;
        let [x, y] = place(ground, index);
        around.look(ground, cover, [x, y], standing.widest, price);
        let fit = around.best_fit([0, 0], [standing.narrowest, standing.widest]);
        let least = (LEAST_SHOWN_FRACTION * disk_worth(fit.radius)) as i32;
        (fit.worth >= least_worth.max(least)).then_some((fit, standing))
    };
    let candidates: Vec<(i32, usize)> = (0..size.rows)
        .into_par_iter()
        .flat_map_iter(|row| {
            let mut around = Surroundings::default();
            let cells = row * size.cols..(row + 1) * size.cols;
            let counts = cover.counts(cells.clone());
            // from higher canopy beside an opening, which a crown covers already, a wider one reaches into it
            let near_openings = cells.zip(counts).filter(|&(_, count)| count <= 1);
            near_openings
                .filter_map(move |(index, _)| Some((fit_at(index, &mut around)?.0.worth, index)))
        })
        .collect();
    let by_tile = tiling.sorted(candidates.iter().map(|&(_, index)| place(ground, index).into()));
    let found = tiling.run(|tile| {
        // worths fall as others take their cells: the one on top, if it still is worth as much, is the best, but for few
        // that rose because others took what they paid for
        let mut heap: BinaryHeap<(i32, Reverse<usize>)> = by_tile[tile]
            .iter()
            .map(|&at| candidates[at as usize])
            .map(|(worth, index)| (worth, Reverse(index)))
            .collect();
        let mut around = Surroundings::default();
        let mut seeds = Vec::new();
        while let Some((worth, Reverse(index))) = heap.pop() {
            let Some((fit, standing)) = fit_at(index, &mut around) else { continue };
            if fit.worth < worth {
                heap.push((fit.worth, Reverse(index)));
                continue;
            }
            let [x, y] = place(ground, index);
            cover.add(x, y, fit.radius);
            seeds.push(Seed { index, radius: fit.radius, standing });
        }
        seeds
    });
    found.concat()
}

#[cfg(test)]
mod tests {
    use super::super::stand::fixture::on_ground;
    use super::*;
    use crate::raster::Cell;

    /// Cones of 15 m on bare ground, 14 m apart.
    fn cones(slope: f32) -> impl Fn(Cell) -> f32 {
        let off = |at: usize| (at % 14) as f32 - 7.0;
        move |Cell { row, col }| (15.0 - slope * f32::hypot(off(row), off(col))).max(0.0)
    }

    #[test]
    fn every_cone_has_one_top_and_a_plateau_its_first_cell() {
        on_ground([56, 42], cones(2.0), "redwood", |ground| {
            let expected: Vec<usize> = (0..4)
                .flat_map(|row| (0..3).map(move |col| (7 + 14 * row) * 42 + 7 + 14 * col))
                .collect();
            assert_eq!(tops(ground), expected);
        });
        on_ground([9, 9], |_| 10.0, "redwood", |ground| assert_eq!(tops(ground), [0]));
        on_ground([9, 9], |_| 2.9, "redwood", |ground| assert_eq!(tops(ground), [0_usize; 0]));
    }

    #[test]
    fn tops_come_before_their_flanks_and_openings_fill_what_is_left() {
        // as wide as a crown
        on_ground([56, 42], cones(4.0), "redwood", |ground| {
            let tiling = Tiling::new(ground.cells.size, ground.envelopes.widest());
            let cover = Cover::new(ground.cells.size);
            let mut listed = tops(ground);
            listed.push(listed[0] + 1); // a branch beside the first top
            let seeds = accepted_tops(ground, tiling, &cover, &listed, 9, 0.4);
            let mut places: Vec<usize> = seeds.iter().map(|seed| seed.index).collect();
            places.sort_unstable();
            assert_eq!(places, tops(ground));
        });
        // wider than a crown
        on_ground([56, 42], cones(2.0), "redwood", |ground| {
            let tiling = Tiling::new(ground.cells.size, ground.envelopes.widest());
            let cover = Cover::new(ground.cells.size);
            accepted_tops(ground, tiling, &cover, &tops(ground), 9, 0.4);
            let covered = cover.covered_fraction(&ground.cells.is_canopy);
            let seeds = openings(ground, tiling, &cover, 9, 2 * CANOPY_WORTH);
            assert!(!seeds.is_empty());
            assert!(cover.covered_fraction(&ground.cells.is_canopy) > covered);
            for seed in &seeds {
                assert!(ground.cells.is_canopy[seed.index]);
                assert!(seed.radius >= seed.standing.narrowest);
                assert!(seed.radius <= seed.standing.widest);
            }
            // nothing is left that is worth as much
            assert!(openings(ground, tiling, &cover, 9, 2 * CANOPY_WORTH).is_empty());
        });
    }

    #[test]
    fn blur_keeps_level_surfaces_and_sums() {
        let level = blur(&[4.0; 63], 9, 1.0);
        assert!(level.iter().all(|v| (v - 4.0).abs() < 1e-5));
        let mut spike = vec![0.0; 21 * 21];
        spike[10 * 21 + 10] = 1.0;
        let blurred = blur(&spike, 21, 1.5);
        assert!((blurred.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        // the normal density, cut off at three sigma
        assert!((blurred[10 * 21 + 10] - 1.0 / (2.0 * std::f32::consts::PI * 2.25)).abs() < 1e-3);
        assert!((blurred[10 * 21 + 7] - blurred[7 * 21 + 10]).abs() < 1e-7);
    }
}
