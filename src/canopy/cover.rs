//! Cover: how many crowns lie over each working cell.

use std::sync::atomic::{AtomicU16, Ordering};

use rayon::prelude::*;

use super::crowns::{Crowns, GridSize, disk_spans};

/// Crowns over each cell. Threads may change cells of their own at the same time; see [`super::tiles`].
#[derive(Debug)]
pub struct Cover {
    size: GridSize,
    counts: Vec<AtomicU16>,
}

impl Cover {
    /// No crown anywhere.
    pub fn new(size: GridSize) -> Self {
        let counts = (0..size.rows * size.cols).map(|_| AtomicU16::new(0)).collect();
        Self { size, counts }
    }

    /// Counts `crowns` and nothing else.
    pub fn count_all(&self, crowns: &Crowns) {
        self.counts.par_iter().for_each(|count| count.store(0, Ordering::Relaxed));
        // whole numbers added up: the same in any order
        (0..crowns.len()).into_par_iter().for_each(|i| {
            for span in disk_spans(crowns.x[i], crowns.y[i], crowns.radius[i], self.size) {
                let start = span.row * self.size.cols;
                for count in &self.counts[start + span.first_col..start + span.end_col] {
                    count.fetch_add(1, Ordering::Relaxed);
                }
            }
        });
    }

    /// Share of the cells marked so that lie under some crown; 1 if none is marked.
    pub fn covered_fraction(&self, is_marked: &[bool]) -> f64 {
        let marked = self.counts.par_iter().zip(is_marked).filter(|(_, marked)| **marked);
        let (all, covered) = marked
            .map(|(count, _)| (1_u64, u64::from(count.load(Ordering::Relaxed) > 0)))
            .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        if all == 0 { 1.0 } else { covered as f64 / all as f64 }
    }

    /// Number of crowns over a cell.
    #[inline]
    pub fn count(&self, index: usize) -> u16 {
        self.counts[index].load(Ordering::Relaxed)
    }

    /// Adds a crown.
    pub fn add(&self, x: i32, y: i32, radius: i32) {
        self.change(x, y, radius, |count| count + 1);
    }

    /// Takes a crown away that was added before.
    pub fn remove(&self, x: i32, y: i32, radius: i32) {
        self.change(x, y, radius, |count| count - 1);
    }

    fn change(&self, x: i32, y: i32, radius: i32, changed: impl Fn(u16) -> u16) {
        for span in disk_spans(x, y, radius, self.size) {
            let start = span.row * self.size.cols;
            for count in &self.counts[start + span.first_col..start + span.end_col] {
                // loads and stores, not one step: a cell is changed by one thread at a time
                count.store(changed(count.load(Ordering::Relaxed)), Ordering::Relaxed);
            }
        }
    }
}
