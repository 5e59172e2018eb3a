//! Seeding: trees under the canopy's tops, and in what no crown covers.
//!
//! # Reference
//! Kapp et al. 2020, section 5.2: initial seeds at local maxima, later ones in exposed canopy.
//! # Departures
//! Later seeds are drawn from the uncovered cells themselves, those first whose crown gains most, where the paper tries
//! points on rings around the trees.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use super::cover::Cover;
use super::crown_fit::{CANOPY_WORTH, Fit, best_fit};
use super::crowns::{UNITS_PER_CELL, disk_spans, middle_units};
use super::stand::{Ground, Standing};
use super::tiles::Tiling;
use crate::math;

/// Blur before tops are sought on cells of up to a metre. chosen: single returns between branches make tops of their own
/// on finer surfaces; half a metre is what foresters' tools use on 1 m cells.
const TOP_BLUR_SIGMA_M: f32 = 0.5;

/// How far from a top its trunk may stand, as a share of the species' crown radius. chosen: crowns are lopsided where
/// neighbours press them; at half the radius the top is still well inside the crown.
const TRUNK_REACH_FRACTION: f32 = 0.5;
/// How much lower than the top the canopy over its trunk may be.
const LOWEST_BESIDE_TOP_M: f32 = 1.5;
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
    /// What it is; a tree beside a top has the top's height.
    pub standing: Standing,
}

/// Those of `tops` whose crown is worth at least `least_worth_fraction` of its cells; the tallest first, and each with the
/// crown that fits what those before it leave. `cover` then counts them.
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
        let accept = |(standing, top): (Standing, usize)| {
            let (index, fit) = beside_top(ground, cover, price, &standing, top)?;
            let least = least_worth_fraction * disk_worth(standing.narrowest);
            (fit.worth as f32 >= least).then(|| {
                let [x, y] = place(ground, index);
                cover.add(x, y, fit.radius);
                Seed { index, radius: fit.radius, standing }
            })
        };
        listed.into_iter().filter_map(accept).collect::<Vec<_>>()
    });
    accepted.concat()
}

/// Where around a top its trunk's crown is worth most, and that crown; of equals the nearest to the top.
fn beside_top(
    ground: &Ground<'_>,
    cover: &Cover,
    price: i32,
    standing: &Standing,
    top: usize,
) -> Option<(usize, Fit)> {
    let size = ground.cells.size;
    let [x, y] = place(ground, top);
    let typical = i32::midpoint(standing.narrowest, standing.widest) as f32;
    let reach = (typical * TRUNK_REACH_FRACTION) as i32; // shorter than a crown
    let is_near_enough = |index: usize| {
        let scene = ground.cells.scene_index(index);
        index == top
            || (ground.cells.is_canopy[index]
                && ground.species.values()[scene] == standing.species
                && ground.chm_m.values()[scene] > standing.height_m - LOWEST_BESIDE_TOP_M)
    };
    disk_spans(x, y, reach, size)
        .flat_map(|span| (span.first_col..span.end_col).map(move |col| span.row * size.cols + col))
        .filter(|&index| is_near_enough(index))
        .map(|index| {
            let at = place(ground, index);
            let fit = best_fit(ground, cover, at, [standing.narrowest, standing.widest], 0, price);
            let (dx, dy) = (at[0] - x, at[1] - y);
            (index, fit, dx * dx + dy * dy)
        })
        .max_by_key(|&(index, fit, squared)| (fit.worth, Reverse(squared), Reverse(index)))
        .map(|(index, fit, _)| (index, fit))
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

/// New trees for canopy that no crown covers: the most worth first, each with the crown that fits what those before it
/// leave, until none is worth `least_worth`. `cover` then counts them.
pub fn openings(
    ground: &Ground<'_>,
    tiling: Tiling,
    cover: &Cover,
    price: i32,
    least_worth: i32,
) -> Vec<Seed> {
    let size = ground.cells.size;
    let fit_at = |index: usize| {
        let standing = ground.standing(index)?;
        let fit = best_fit(
            ground,
            cover,
            place(ground, index),
            [standing.narrowest, standing.widest],
            0,
            price,
        );
        let least = (LEAST_SHOWN_FRACTION * disk_worth(fit.radius)) as i32;
        (fit.worth >= least_worth.max(least)).then_some((fit, standing))
    };
    let is_open = |index: usize| ground.cells.is_canopy[index] && cover.count(index) == 0;
    let candidates: Vec<(i32, usize)> = (0..size.rows * size.cols)
        .into_par_iter()
        .with_min_len(size.cols)
        .filter(|&index| is_open(index))
        .filter_map(|index| Some((fit_at(index)?.0.worth, index)))
        .collect();
    let by_tile = tiling.sorted(candidates.iter().map(|&(_, index)| place(ground, index).into()));
    let found = tiling.run(|tile| {
        // worths only fall as others take their cells: the one on top, if it still is worth as much, is the best
        let mut heap: BinaryHeap<(i32, Reverse<usize>)> = by_tile[tile]
            .iter()
            .map(|&at| candidates[at as usize])
            .map(|(worth, index)| (worth, Reverse(index)))
            .collect();
        let mut seeds = Vec::new();
        while let Some((worth, Reverse(index))) = heap.pop() {
            let Some((fit, standing)) = fit_at(index) else { continue };
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
