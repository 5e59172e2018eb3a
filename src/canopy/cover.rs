//! Cover: how many crowns lie over each working cell.

use std::ops::Range;
use std::sync::atomic::{AtomicU16, Ordering};

use rayon::prelude::*;

use super::crowns::{Crowns, GridSize, Span, disk_spans};

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

    /// Numbers of crowns over consecutive cells.
    #[inline]
    pub fn counts(&self, cells: Range<usize>) -> impl Iterator<Item = u16> {
        self.counts[cells].iter().map(|count| count.load(Ordering::Relaxed))
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

/// Which cells of the canopy lie under no crown, a bit a cell: counted a word at a time.
pub struct OpenCells {
    size: GridSize,
    words_per_row: usize,
    words: Vec<u64>,
}

impl OpenCells {
    /// The cells of `is_canopy` that `cover` counts no crown over.
    pub fn of(cover: &Cover, is_canopy: &[bool]) -> Self {
        let size = cover.size;
        // one more, so that every span can be read from two words
        let words_per_row = size.cols / 64 + 2;
        let mut words = vec![0_u64; size.rows * words_per_row];
        words.par_chunks_mut(words_per_row).enumerate().for_each(|(row, words)| {
            let cells = row * size.cols..(row + 1) * size.cols;
            for (col, (count, &canopy)) in
                cover.counts(cells.clone()).zip(&is_canopy[cells]).enumerate()
            {
                words[col / 64] |= u64::from(canopy && count == 0) << (col % 64);
            }
        });
        Self { size, words_per_row, words }
    }

    /// How many of them the disk around the middle of a cell holds; `half_widths` are its rows'.
    pub fn count_in_disk(&self, row: usize, col: usize, half_widths: &[u8]) -> u32 {
        let mut open = 0;
        for (dy, &half_width) in half_widths.iter().enumerate() {
            let half_width = usize::from(half_width);
            let first_col = col.saturating_sub(half_width);
            let end_col = (col + half_width + 1).min(self.size.cols);
            if row + dy < self.size.rows {
                open += self.count_in_span(Span { row: row + dy, first_col, end_col });
            }
            if dy > 0 && row >= dy {
                open += self.count_in_span(Span { row: row - dy, first_col, end_col });
            }
        }
        open
    }

    /// How many of them a span holds.
    #[inline]
    fn count_in_span(&self, span: Span) -> u32 {
        let mut open = 0;
        let mut first = span.first_col;
        let row = &self.words[span.row * self.words_per_row..][..self.words_per_row];
        while first < span.end_col {
            let bits = (span.end_col - first).min(64);
            let (word, shift) = (first / 64, first % 64);
            // the word's upper bits, then the next one's lower bits: those shifted by 64 in two steps, which is 0 for none
            let window = (row[word] >> shift) | (row[word + 1] << 1 << (63 - shift));
            open += (window << (64 - bits)).count_ones();
            first += bits;
        }
        open
    }
}

#[cfg(test)]
mod tests {
    use super::super::crowns::{CenteredDisks, middle_units};
    use super::*;

    #[test]
    fn crowns_come_and_go_and_open_cells_are_counted() {
        let size = GridSize { rows: 40, cols: 150 };
        let is_canopy: Vec<bool> = (0..size.rows * size.cols).map(|i| i % 7 != 3).collect();
        let cover = Cover::new(size);
        let crowns = [(900, 400, 300), (1000, 500, 200), (4700, 20, 500), (2048, 640, 31)];
        for (x, y, radius) in crowns {
            cover.add(x, y, radius);
        }
        let open = OpenCells::of(&cover, &is_canopy);
        let disks = CenteredDisks::new(2047);
        for (row, col, radius) in [(12, 28, 500), (0, 149, 2047), (18, 64, 900), (39, 0, 5)] {
            let spans = disk_spans(middle_units(col), middle_units(row), radius, size);
            let cells = spans.flat_map(|span| {
                (span.first_col..span.end_col).map(move |col| span.row * size.cols + col)
            });
            let expected = cells.filter(|&i| is_canopy[i] && cover.count(i) == 0).count();
            let found = open.count_in_disk(row, col, disks.half_widths(radius));
            assert_eq!(found as usize, expected);
        }
        assert!(cover.covered_fraction(&is_canopy) > 0.05);
        for (x, y, radius) in crowns {
            cover.remove(x, y, radius);
        }
        assert_eq!(cover.covered_fraction(&is_canopy), 0.0);
        assert_eq!(cover.covered_fraction(&[false; 6000]), 1.0);
    }
}
