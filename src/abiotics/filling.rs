//! Filling: depressions become level, but for a hair that leads their water to the spill point.
//!
//! # Reference
//! Barnes, Lehman & Mulla 2014, "Priority-flood: An optimal depression-filling and
//! watershed-labeling algorithm for digital elevation models", Computers & Geosciences 62,
//! doi:10.1016/j.cageo.2013.04.024 (the variant that leaves a gradient on flats).
//! Queue: Ahuja, Mehlhorn, Orlin & Tarjan 1990, "Faster algorithms for the shortest path problem",
//! Journal of the ACM 37(2), doi:10.1145/77600.77615 (radix heap).
//! # Departures
//! The gradient on flats is one unit in the last place of an `f32` a step (0.06 mm at 1000 m above
//! sea level), so a flat 1000 cells wide rises by some centimetres; nearer to sea level than 8 m it is
//! [`LEAST_RISE_M`].

use crate::progress::{Cancelled, Reporter};

use super::drainage::{neighbour_offsets, step};

/// Cells between two looks at the cancel flag.
const CANCEL_INTERVAL: usize = 1 << 20;

/// Rise of a flat from a cell to the next, metres, where the last place of an `f32` is less.
/// chosen: the last place at 8 m. At 0 m it is 1e-45 m, and a share of such a fall is none: water would vanish.
const LEAST_RISE_M: f32 = 1.0 / (1_u32 << 20) as f32;

/// Fills every depression of `height_m`, which has a rim (see `drainage`). Water leaves where a cell
/// touches an infinitely high one.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
pub(super) fn fill(
    height_m: &mut [f32],
    stride: usize,
    reporter: &Reporter,
) -> Result<(), Cancelled> {
    let offsets = neighbour_offsets(stride);

    // edges keep their height: there the water leaves
    let mut reached: Vec<bool> = height_m.iter().map(|&h| h == f32::INFINITY).collect();
    let mut queue = RadixHeap::default();
    let inner = stride + 1..height_m.len().saturating_sub(stride + 1);
    let edges: Vec<usize> =
        inner.filter(|&p| !reached[p] && offsets.iter().any(|&o| reached[step(p, o)])).collect();
    for p in edges {
        reached[p] = true;
        queue.push(height_m[p], p);
    }

    // inland from the lowest shore, each cell at least a hair above the one it was reached from
    let mut count = 0;
    while let Some(p) = queue.pop() {
        count += 1;
        if count % CANCEL_INTERVAL == 0 {
            reporter.check_cancelled()?;
        }
        let least = height_m[p].next_up().max(height_m[p] + LEAST_RISE_M);
        for o in offsets {
            let n = step(p, o);
            if !reached[n] {
                reached[n] = true;
                height_m[n] = height_m[n].max(least);
                queue.push(height_m[n], n);
            }
        }
    }
    Ok(())
}

/// Priority queue for keys that never fall below the last one taken out.
/// Bucket b holds keys that differ from the last in bit b − 1 and in none above.
struct RadixHeap {
    last_key: u32,
    buckets: [Vec<(u32, u32)>; 33],
}

impl Default for RadixHeap {
    fn default() -> Self {
        Self { last_key: 0, buckets: std::array::from_fn(|_| Vec::new()) }
    }
}

impl RadixHeap {
    fn bucket(&self, key: u32) -> usize {
        (u32::BITS - (key ^ self.last_key).leading_zeros()) as usize
    }

    #[inline]
    fn push(&mut self, height_m: f32, index: usize) {
        let key = ordered_bits(height_m);
        debug_assert!(key >= self.last_key, "keys must not fall");
        let bucket = self.bucket(key);
        self.buckets[bucket].push((key, index as u32)); // cells are limited to 400 million
    }

    #[inline]
    fn pop(&mut self) -> Option<usize> {
        if self.buckets[0].is_empty() {
            let source = self.buckets.iter().position(|b| !b.is_empty())?;
            let mut entries = std::mem::take(&mut self.buckets[source]);
            self.last_key = entries.iter().map(|&(key, _)| key).min()?;
            for entry in entries.drain(..) {
                let bucket = self.bucket(entry.0);
                self.buckets[bucket].push(entry);
            }
            self.buckets[source] = entries; // keep the allocation
        }
        self.buckets[0].pop().map(|(_, index)| index as usize)
    }
}

/// Bits that order as the numbers do.
#[inline]
fn ordered_bits(x: f32) -> u32 {
    let bits = x.to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::drainage::{NEIGHBOURS, padded, rimmed};
    use super::*;
    use crate::math::sin;
    use crate::raster::{Cell, Frame, Grid, Mask};

    /// Rough heights without any pattern.
    fn rough(cell: Cell) -> f32 {
        let (r, c) = (cell.row as f32, cell.col as f32);
        100.0 + 10.0 * sin(r * 12.9898 + c * 78.233) + 7.0 * sin(r * 0.31) * sin(c * 0.23)
    }

    /// Fills by lowering a flood until nothing changes (Planchon & Darboux 2002 without gradient).
    fn naive_fill(elevation_m: &Grid<f32>) -> Vec<f32> {
        let (rows, cols) = (elevation_m.frame().rows, elevation_m.frame().cols);
        let valid = |r: isize, c: isize| {
            r >= 0 && c >= 0 && elevation_m.get(Cell { row: r as usize, col: c as usize }).is_some()
        };
        let mut filled = vec![f32::INFINITY; rows * cols];
        loop {
            let mut changed = false;
            for i in 0..rows * cols {
                let (r, c) = ((i / cols) as isize, (i % cols) as isize);
                if !valid(r, c) {
                    continue;
                }
                let mut level = f32::INFINITY;
                for (dr, dc) in NEIGHBOURS {
                    level = level.min(if valid(r + dr, c + dc) {
                        filled[((r + dr) * cols as isize + c + dc) as usize]
                    } else {
                        f32::NEG_INFINITY
                    });
                }
                let new = elevation_m.values()[i].max(level);
                changed |= new < filled[i];
                filled[i] = filled[i].min(new);
            }
            if !changed {
                return filled;
            }
        }
    }

    #[test]
    fn fills_as_the_naive_flood_does() {
        let whole = Grid::from_fn(37, 41, 1.0, rough);
        let valid = (0..37 * 41).map(|i| i % 97 != 5).collect();
        let holed = Grid::new(
            Arc::new(Frame::local(37, 41, 1.0)),
            Arc::new(Mask::new(valid)),
            whole.values().to_vec(),
        );
        for elevation_m in [whole, holed] {
            let naive = naive_fill(&elevation_m);
            let mut filled_m = rimmed(&elevation_m);
            fill(&mut filled_m, 43, &Reporter::silent()).unwrap();
            let mut raised = 0;
            for (i, &expected) in naive.iter().enumerate() {
                if !elevation_m.mask().is_valid(i) {
                    continue;
                }
                let filled = filled_m[padded(43, i / 41, i % 41)];
                raised += usize::from(expected > elevation_m.values()[i]);
                // up to one unit in the last place a step: 100 steps of 8e-6 m
                assert!(filled >= expected && filled - expected < 8e-4, "cell {i}");
            }
            assert!(raised > 100, "the test terrain has pits");
        }
    }

    #[test]
    fn heap_gives_rising_heights_across_zero() {
        let mut heap = RadixHeap::default();
        let heights = [3.5, -2.0, 0.0, 1e-3, -1e6, 8848.0, -0.5];
        for (i, &h) in heights.iter().enumerate() {
            heap.push(h, i);
        }
        let popped: Vec<f32> = std::iter::from_fn(|| heap.pop()).map(|i| heights[i]).collect();
        assert_eq!(popped, [-1e6, -2.0, -0.5, 0.0, 1e-3, 3.5, 8848.0]);
    }
}
