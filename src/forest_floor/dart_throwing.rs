//! Dart throwing: points no nearer to each other than a distance, until no place is left for one more.
//!
//! A region is cut into small rectangles. Round after round a dart is thrown into each, in an order drawn anew, and stays
//! unless a point is too near; then rectangles that points cover are dropped and the others cut into four.
//!
//! # Reference
//! Ebeida et al. 2012, "A simple algorithm for maximal Poisson-disk sampling in high dimensions", Computer Graphics Forum
//! 31(2), doi:10.1111/j.1467-8659.2012.03059.x: throwing into what is left of a grid that is refined.

use crate::rng::{Key, unit_interval, words};

/// Rounds after which a gap too narrow to matter is left. chosen: rectangles are then a 2¹³th of the distance wide.
const ROUNDS: u16 = 12;

/// A rectangle: west, south, east, north.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rectangle {
    pub low: [f64; 2],
    pub high: [f64; 2],
}

/// A point and a draw of its own, uniform in 0..1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Dart {
    pub at: [f64; 2],
    pub draw: f32,
}

/// Points sorted into square cells as wide as the distance, so that a place's neighbours lie in nine of them.
struct Neighbours {
    low: [f64; 2],
    distance: f64,
    cols: usize,
    rows: usize,
    cells: Vec<Vec<[f64; 2]>>,
}

impl Neighbours {
    fn around(region: &[Rectangle], distance: f64) -> Self {
        let fold = |pick: fn(&Rectangle) -> [f64; 2], keep: fn(f64, f64) -> f64, start: f64| {
            region.iter().map(pick).fold([start; 2], |a, b| [keep(a[0], b[0]), keep(a[1], b[1])])
        };
        let low = fold(|r| r.low, f64::min, f64::INFINITY).map(|v| v - distance);
        let high = fold(|r| r.high, f64::max, f64::NEG_INFINITY).map(|v| v + distance);
        let [cols, rows] = [0, 1].map(|i| ((high[i] - low[i]) / distance) as usize + 1);
        Self { low, distance, cols, rows, cells: vec![Vec::new(); cols * rows] }
    }

    /// Column and row of a place's cell; nothing beyond the distance from the region.
    fn cell(&self, at: [f64; 2]) -> Option<[usize; 2]> {
        let [col, row] = [0, 1].map(|i| ((at[i] - self.low[i]) / self.distance).floor());
        let inside = col >= 0.0 && row >= 0.0 && col < self.cols as f64 && row < self.rows as f64;
        inside.then_some([col as usize, row as usize]) // whole and in range
    }

    fn add(&mut self, at: [f64; 2]) {
        if let Some([col, row]) = self.cell(at) {
            self.cells[row * self.cols + col].push(at);
        }
    }

    /// Whether some point within the distance of a place's cell meets a condition.
    fn any(&self, at: [f64; 2], condition: impl Fn([f64; 2]) -> bool) -> bool {
        let Some([col, row]) = self.cell(at) else { return false };
        (row.saturating_sub(1)..=(row + 1).min(self.rows - 1)).any(|row| {
            let cols = col.saturating_sub(1)..=(col + 1).min(self.cols - 1);
            cols.into_iter()
                .any(|col| self.cells[row * self.cols + col].iter().any(|point| condition(*point)))
        })
    }

    fn is_free(&self, at: [f64; 2]) -> bool {
        !self.any(at, |point| {
            square(point[0] - at[0], point[1] - at[1]) < self.distance * self.distance
        })
    }

    /// Whether one point lies within the distance of all of a rectangle.
    fn is_covered(&self, r: &Rectangle) -> bool {
        let middle = [0, 1].map(|i| 0.5 * (r.low[i] + r.high[i]));
        self.any(middle, |point| {
            let [x, y] =
                [0, 1].map(|i| (point[i] - r.low[i]).abs().max((r.high[i] - point[i]).abs()));
            square(x, y) < self.distance * self.distance
        })
    }
}

fn square(x: f64, y: f64) -> f64 {
    x * x + y * y
}

/// New points of a region, at least `distance` from each other and from `standing` points, so many that no place of the
/// region is left farther than that from all of them. Draws are keyed by round and rectangle under `key`.
pub(super) fn fill(
    region: &[Rectangle],
    standing: impl Iterator<Item = [f64; 2]>,
    distance: f64,
    key: Key,
) -> Vec<Dart> {
    let mut near = Neighbours::around(region, distance);
    standing.for_each(|at| near.add(at));
    let mut open: Vec<Rectangle> = region.iter().flat_map(|r| cut(r, 0.5 * distance)).collect();
    let mut darts = Vec::new();
    for round in 0..ROUNDS {
        open.retain(|r| !near.is_covered(r));
        if open.is_empty() {
            break;
        }
        // The order of this round
        let draw = |number: usize| {
            // a region has far fewer than 2³² rectangles; the key's entity stands above them
            let entity = key.entity << 32 | number as u64;
            words(Key { month: round as u8, entity, ..key }) // 12 rounds
        };
        let mut order: Vec<(u32, usize)> = (0..open.len()).map(|n| (draw(n)[2], n)).collect();
        order.sort_unstable();

        // One dart each
        for (_, number) in order {
            let r = &open[number];
            let drawn = draw(number).map(unit_interval);
            let at = [0, 1].map(|i| r.low[i] + (r.high[i] - r.low[i]) * f64::from(drawn[i]));
            if near.is_free(at) {
                near.add(at);
                darts.push(Dart { at, draw: drawn[3] });
            }
        }
        open = open.iter().flat_map(quarters).collect();
    }
    darts
}

/// A rectangle in equal parts no wider than `side`.
fn cut(r: &Rectangle, side: f64) -> Vec<Rectangle> {
    let [cols, rows] = [0, 1].map(|i| ((r.high[i] - r.low[i]) / side).ceil().max(1.0) as usize);
    let part = |number: usize| {
        let [col, row] = [(number % cols) as f64, (number / cols) as f64];
        let [east, north] = [0, 1].map(|i| r.high[i] - r.low[i]);
        let corner = |col: f64, row: f64| {
            [r.low[0] + east * col / cols as f64, r.low[1] + north * row / rows as f64]
        };
        Rectangle { low: corner(col, row), high: corner(col + 1.0, row + 1.0) }
    };
    (0..cols * rows).map(part).collect()
}

fn quarters(r: &Rectangle) -> [Rectangle; 4] {
    let middle = [0, 1].map(|i| 0.5 * (r.low[i] + r.high[i]));
    [[0, 0], [1, 0], [0, 1], [1, 1]].map(|half: [usize; 2]| {
        let side = |i: usize| {
            if half[i] == 0 { [r.low[i], middle[i]] } else { [middle[i], r.high[i]] }
        };
        let (x, y) = (side(0), side(1));
        Rectangle { low: [x[0], y[0]], high: [x[1], y[1]] }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Process;

    const KEY: Key = Key { seed: 5, process: Process::PoissonTile, year: 0, month: 0, entity: 77 };

    #[test]
    fn points_keep_their_distance_and_leave_no_hole() {
        let region = [
            Rectangle { low: [0.0, 0.0], high: [1.0, 0.4] },
            Rectangle { low: [0.0, 0.4], high: [0.3, 1.0] },
        ];
        let standing = [[0.5, 0.2], [0.35, 0.45]];
        let darts = fill(&region, standing.into_iter(), 0.05, KEY);
        let all: Vec<[f64; 2]> = standing.into_iter().chain(darts.iter().map(|d| d.at)).collect();
        for (i, a) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|b| square(a[0] - b[0], a[1] - b[1]) >= 0.05 * 0.05));
        }
        for sample in 0..90_000 {
            let [x, y] = [f64::from(sample % 300) / 300.0, f64::from(sample / 300) / 300.0];
            if y < 0.4 || x < 0.3 {
                let nearest = all.iter().map(|p| square(p[0] - x, p[1] - y)).fold(1.0, f64::min);
                assert!(nearest < 0.0501 * 0.0501, "hole at {x} {y}");
            }
        }
        // a saturated strewing covers 54.7 % of the ground by disks of half the distance
        let inner = all
            .iter()
            .filter(|p| p[1] > 0.05 && p[1] < 0.35)
            .filter(|p| p[0] > 0.05 && p[0] < 0.95);
        let covered = inner.count() as f64 * std::f64::consts::PI * 0.025 * 0.025 / (0.9 * 0.3);
        assert!((0.5..0.6).contains(&covered), "{covered}");
    }
}
