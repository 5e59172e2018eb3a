//! Buckets: the search for plants near a place.

/// Buckets of one size over a rectangle, each with the indices of what stands in it.
#[derive(Clone, Debug)]
pub struct Buckets {
    west_m: f32,
    north_m: f32,
    bucket_m: f32,
    rows: usize,
    cols: usize,
    /// Where each bucket's indices begin, and after them the end of the last.
    starts: Vec<u32>,
    indices: Vec<u32>,
}

impl Buckets {
    /// Buckets of `bucket_m` for places; they cover all of them.
    pub fn new(east_m: &[f32], south_m: &[f32], bucket_m: f32) -> Self {
        let least = |values: &[f32]| values.iter().copied().fold(f32::INFINITY, f32::min);
        let most = |values: &[f32]| values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let (west_m, north_m) = (least(east_m), least(south_m));
        let count = |low: f32, high: f32| ((high - low).max(0.0) / bucket_m) as usize + 1;
        let (rows, cols) = if east_m.is_empty() {
            (0, 0)
        } else {
            (count(north_m, most(south_m)), count(west_m, most(east_m)))
        };
        let mut buckets = Self {
            west_m,
            north_m,
            bucket_m,
            rows,
            cols,
            starts: vec![0; rows * cols + 1],
            indices: vec![0; east_m.len()],
        };
        let of: Vec<usize> = (east_m.iter().zip(south_m))
            .map(|(east_m, south_m)| {
                buckets.line(*south_m, north_m, rows) * cols + buckets.line(*east_m, west_m, cols)
            })
            .collect();
        of.iter().for_each(|bucket| buckets.starts[bucket + 1] += 1);
        for bucket in 1..buckets.starts.len() {
            buckets.starts[bucket] += buckets.starts[bucket - 1];
        }
        let mut next = buckets.starts.clone();
        for (index, bucket) in of.into_iter().enumerate() {
            buckets.indices[next[bucket] as usize] = index as u32; // far fewer than 2³²
            next[bucket] += 1;
        }
        buckets
    }

    #[inline]
    fn line(&self, at_m: f32, from_m: f32, count: usize) -> usize {
        // `as` cuts negatives to 0
        (((at_m - from_m) / self.bucket_m) as usize).min(count.saturating_sub(1))
    }

    /// Visits whatever may stand within `reach_m` of a place, row by row; some of it stands a little farther.
    #[inline]
    pub fn near(&self, [east_m, south_m]: [f32; 2], reach_m: f32, mut visit: impl FnMut(usize)) {
        if self.rows == 0 {
            return;
        }
        let first = self.line(east_m - reach_m, self.west_m, self.cols);
        let last = self.line(east_m + reach_m, self.west_m, self.cols);
        let top = self.line(south_m - reach_m, self.north_m, self.rows);
        let bottom = self.line(south_m + reach_m, self.north_m, self.rows);
        for row in top..=bottom {
            let begin = self.starts[row * self.cols + first] as usize;
            let end = self.starts[row * self.cols + last + 1] as usize;
            self.indices[begin..end].iter().for_each(|index| visit(*index as usize));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{self, Key, Process};

    #[test]
    fn all_that_is_near_is_found_once() {
        let draw = |entity| {
            rng::uniforms(Key {
                seed: 1,
                process: Process::StrewnPoints,
                year: 0,
                month: 0,
                entity,
            })
        };
        let places: Vec<[f32; 2]> =
            (0..500).map(|entity| [draw(entity)[0] * 40.0 - 7.0, draw(entity)[1] * 25.0]).collect();
        let (east_m, south_m): (Vec<f32>, Vec<f32>) = places.iter().map(|p| (p[0], p[1])).unzip();
        let buckets = Buckets::new(&east_m, &south_m, 3.0);
        for at in [[0.0, 0.0], [10.0, 12.0], [-30.0, 2.0], [33.0, 25.0]] {
            let mut found = Vec::new();
            buckets.near(at, 4.0, |index| found.push(index));
            found.sort_unstable();
            let all: Vec<usize> = (0..500)
                .filter(|i| (places[*i][0] - at[0]).hypot(places[*i][1] - at[1]) <= 4.0)
                .collect();
            assert!(all.iter().all(|index| found.contains(index)));
            assert!(found.windows(2).all(|pair| pair[0] < pair[1]));
        }
        Buckets::new(&[], &[], 1.0).near([0.0, 0.0], 5.0, |_| unreachable!());
    }
}
