//! Deadwood from above: downed logs as lines in their length, snags as dots, as a layer to lay over a map.
//!
//! On a map of a square kilometre most downed logs are thinner than a pixel. Each is drawn one pixel wide and the paler for it,
//! so that what a storm laid down side by side reads as grain, and no downed log hides the map.

use super::ramp::Rgb;
use super::strokes::{Ends, Stroke};
use crate::plants::deadwood::{Deadwood, DownedLogs, Snags};
use crate::raster::Frame;

/// Colours of downed logs by decay class, 1–5: bark is dark, rotten wood pale.
const DOWNED_LOG_COLORS: [[f32; 3]; 5] = [
    [70.0, 40.0, 22.0],
    [100.0, 62.0, 36.0],
    [132.0, 92.0, 58.0],
    [164.0, 128.0, 92.0],
    [190.0, 162.0, 130.0],
];
/// What of a pixel downed logs cover at most, by decay class. chosen: rotten ones fade into the ground.
const DOWNED_LOG_ALPHA: [f32; 5] = [0.95, 0.85, 0.7, 0.55, 0.4];
/// Snags: their middle, and the rim that sets them off crowns.
const SNAG: [f32; 3] = [232.0, 232.0, 230.0];
const SNAG_RIM: [f32; 3] = [62.0, 62.0, 66.0];
const SNAG_ALPHA: f32 = 0.85;
/// Radius of a snag's dot, pixels, for trees of this diameter; thinner ones are smaller, down to a least.
const SNAG_PX: f32 = 1.5;
const SNAG_DBH_M: f32 = 0.5;
const LEAST_SNAG_PX: f32 = 0.7;
/// Least snags that are shown: dead saplings are many, and stumps low. chosen: the least stem of an inventory, a tall man's reach.
const LEAST_SHOWN_DBH_M: f32 = 0.1;
const LEAST_SHOWN_M: f32 = 2.5;
/// Rim of a snag's dot.
const RIM_PX: f32 = 0.8;
/// What crowns over it leave of a downed log's line. chosen: downed logs shine through, gaps are where they stand out.
const UNDER_CROWNS: f32 = 0.6;

/// Colour of a downed log by its decay class.
pub fn downed_log_color(decay_class: u8) -> [f32; 3] {
    DOWNED_LOG_COLORS[step(decay_class)]
}

/// A decay class as an index.
fn step(decay_class: u8) -> usize {
    usize::from(decay_class.clamp(1, 5)) - 1
}

/// Downed logs from the most decayed to the freshest, which lie on top.
pub fn lowest_first(downed_logs: &DownedLogs, some: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut order: Vec<usize> = some.collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(downed_logs.decay_class[i]), downed_logs.id[i]));
    order
}

/// Deadwood over a map's pixels, row-major from the north-west.
#[derive(Clone, Debug, PartialEq)]
pub struct DeadwoodLayer {
    /// Light of what is covered: squares of code values, times the cover.
    light: Vec<[f32; 3]>,
    /// Share of the pixel that is covered.
    pub cover: Vec<f32>,
    rows: usize,
    cols: usize,
}

impl DeadwoodLayer {
    /// Deadwood over a map of `rows` × `cols` pixels that shows the ground of `frame`; `crowns` is the share of each
    /// pixel under living crowns.
    pub fn draw(
        deadwood: &Deadwood,
        frame: &Frame,
        crowns: &[f32],
        [rows, cols]: [usize; 2],
    ) -> Self {
        let mut layer =
            Self { light: vec![[0.0; 3]; rows * cols], cover: vec![0.0; rows * cols], rows, cols };
        let Deadwood { snags, downed_logs } = deadwood;
        let height_m = frame.rows as f32 * frame.cell_m();
        let px_per_m = cols as f32 / (frame.cols as f32 * frame.cell_m());
        let place = |[east_m, north_m]: [f32; 2]| {
            [east_m * px_per_m, (height_m - north_m) * (rows as f32 / height_m)]
        };
        for i in lowest_first(downed_logs, 0..downed_logs.len()) {
            layer.downed_log(downed_logs, i, place, px_per_m, crowns);
        }
        let is_shown =
            |i: &usize| snags.dbh_m[*i] >= LEAST_SHOWN_DBH_M && snags.height_m[*i] >= LEAST_SHOWN_M;
        let mut standing: Vec<usize> = (0..snags.len()).filter(is_shown).collect();
        standing.sort_by_key(|&i| snags.id[i]);
        for i in standing {
            layer.snag(snags, i, place([snags.east_m[i], snags.north_m[i]]));
        }
        layer
    }

    /// A colour of the map under this layer.
    pub fn over(&self, pixel: usize, below: [f32; 3]) -> [f32; 3] {
        let (light, cover) = (self.light[pixel], self.cover[pixel]);
        std::array::from_fn(|c| (light[c] + (1.0 - cover) * below[c] * below[c]).max(0.0).sqrt())
    }

    fn downed_log(
        &mut self,
        downed_logs: &DownedLogs,
        i: usize,
        place: impl Fn([f32; 2]) -> [f32; 2],
        px_per_m: f32,
        crowns: &[f32],
    ) {
        let widths =
            [downed_logs.diameter_base_m[i], downed_logs.diameter_tip_m[i]].map(|d| d * px_per_m);
        let stroke = Stroke {
            from: place([downed_logs.east_m[i], downed_logs.north_m[i]]),
            to: place(downed_logs.thin_end_m(i)),
            half_width: widths.map(|width| 0.5 * width.max(1.0)),
            ends: Ends::Square,
        };
        let step = step(downed_logs.decay_class[i]);
        // a downed log half as wide as its line is 0.7 as strong, not half: few would be seen
        let thin = (0.5 * (widths[0] + widths[1])).clamp(0.0, 1.0).sqrt();
        self.lay(&stroke, DOWNED_LOG_COLORS[step], |pixel| {
            DOWNED_LOG_ALPHA[step] * thin * (1.0 - (1.0 - UNDER_CROWNS) * crowns[pixel])
        });
    }

    fn snag(&mut self, snags: &Snags, i: usize, at: [f32; 2]) {
        let radius = (SNAG_PX * snags.dbh_m[i] / SNAG_DBH_M).clamp(LEAST_SNAG_PX, 2.0 * SNAG_PX);
        for (radius, color) in [(radius + RIM_PX, SNAG_RIM), (radius, SNAG)] {
            let dot = Stroke { from: at, to: at, half_width: [radius; 2], ends: Ends::Round };
            self.lay(&dot, color, |_| SNAG_ALPHA);
        }
    }

    /// Lays a colour over what a stroke covers.
    fn lay(&mut self, stroke: &Stroke, color: [f32; 3], alpha: impl Fn(usize) -> f32) {
        let [[left, top], [right, bottom]] = stroke.bounds();
        // `as` cuts negatives to 0
        let span = |low: f32, high: f32, end: usize| {
            (low.max(0.0) as usize).min(end)..((high + 1.0).max(0.0) as usize).min(end)
        };
        for row in span(top, bottom, self.rows) {
            for col in span(left, right, self.cols) {
                let coverage = stroke.touch([col as f32 + 0.5, row as f32 + 0.5]).coverage;
                if coverage > 0.0 {
                    let pixel = row * self.cols + col;
                    let alpha = alpha(pixel) * coverage;
                    for (light, code) in self.light[pixel].iter_mut().zip(color) {
                        *light += alpha * (code * code - *light);
                    }
                    self.cover[pixel] += alpha * (1.0 - self.cover[pixel]);
                }
            }
        }
    }
}

/// Colours of a legend: a snag's rim and middle, a fresh downed log.
pub const LEGEND: [Rgb; 3] = [[62, 62, 66], [232, 232, 230], [70, 40, 22]];

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::plants::deadwood::{Cause, DownedLogKind};

    /// Logs of a scene: thick end east and north, length, thick diameter, azimuth, decay class.
    pub fn downed_logs(some: &[(f32, f32, f32, f32, f32, u8)]) -> DownedLogs {
        let mut downed_logs = DownedLogs::default();
        for (id, &(east_m, north_m, length_m, diameter_m, azimuth_rad, class)) in (0..).zip(some) {
            downed_logs.id.push(id);
            downed_logs.parent_id.push(id);
            downed_logs.species.push(14);
            downed_logs.kind.push(if id % 4 == 3 {
                DownedLogKind::Uprooted
            } else {
                DownedLogKind::Trunk
            });
            downed_logs.east_m.push(east_m);
            downed_logs.north_m.push(north_m);
            downed_logs.z_m.push(300.0);
            downed_logs.length_m.push(length_m);
            downed_logs.diameter_base_m.push(diameter_m);
            downed_logs.diameter_tip_m.push(0.4 * diameter_m);
            downed_logs.azimuth_rad.push(azimuth_rad);
            downed_logs.years_down.push(f32::from(class) * 10.0);
            downed_logs.decay_class.push(class);
            downed_logs.density_fraction.push(1.0);
            downed_logs.cause.push(Cause::Storm);
        }
        downed_logs
    }

    /// Snags of a scene: east, north, height, height at death, diameter, share of branches, decay class.
    pub fn snags(some: &[(f32, f32, f32, f32, f32, f32, u8)]) -> Snags {
        let mut snags = Snags::default();
        for (id, &(east_m, north_m, height_m, at_death_m, dbh_m, branches, class)) in
            (0..).zip(some)
        {
            snags.id.push(id);
            snags.species.push(14);
            snags.east_m.push(east_m);
            snags.north_m.push(north_m);
            snags.z_m.push(300.0);
            snags.height_m.push(height_m);
            snags.height_at_death_m.push(at_death_m);
            snags.dbh_m.push(dbh_m);
            snags.years_dead.push(f32::from(class) * 8.0);
            snags.decay_class.push(class);
            snags.density_fraction.push(1.0);
            snags.branch_fraction.push(branches);
            snags.cause.push(Cause::Age);
        }
        snags
    }

    fn draw(deadwood: &Deadwood, crown: f32, size: usize) -> DeadwoodLayer {
        DeadwoodLayer::draw(
            deadwood,
            &Frame::local(100, 100, 1.0),
            &vec![crown; size * size],
            [size, size],
        )
    }

    #[test]
    fn logs_lie_in_their_direction_and_are_seen_in_any_scale() {
        // from the middle to the east, 30 m long
        let east = std::f32::consts::FRAC_PI_2;
        let deadwood = Deadwood {
            downed_logs: downed_logs(&[(50.0, 50.0, 30.0, 0.5, east, 1)]),
            ..Deadwood::default()
        };
        for size in [50, 100, 800] {
            let layer = draw(&deadwood, 0.0, size);
            let at = |east: f32, north: f32| {
                let place = |share: f32| (share / 100.0 * size as f32) as usize;
                layer.cover[place(100.0 - north) * size + place(east)]
            };
            assert!(at(65.0, 50.0).max(at(65.0, 50.9)) > 0.15, "{size}");
            assert_eq!([at(45.0, 50.0), at(85.0, 50.0), at(65.0, 55.0)], [0.0; 3], "{size}");
        }
    }

    #[test]
    fn fresh_logs_are_darker_and_crowns_dim_what_lies_below() {
        let cover = |class: u8, crown: f32| {
            let downed_logs = downed_logs(&[(20.0, 50.0, 40.0, 0.5, 1.0, class)]);
            let layer = draw(&Deadwood { downed_logs, ..Deadwood::default() }, crown, 100);
            layer.cover.iter().sum::<f32>()
        };
        for class in 1..5 {
            assert!(cover(class, 0.0) > cover(class + 1, 0.0));
            let sum = |class| downed_log_color(class).iter().sum::<f32>();
            assert!(sum(class) < sum(class + 1));
        }
        assert!((cover(1, 1.0) / cover(1, 0.0) - UNDER_CROWNS).abs() < 1e-3);
    }

    #[test]
    fn snags_are_pale_dots_and_nothing_dead_covers_nothing() {
        let deadwood = Deadwood {
            snags: snags(&[(30.5, 69.5, 20.0, 20.0, 0.5, 1.0, 1)]),
            ..Deadwood::default()
        };
        let layer = draw(&deadwood, 0.0, 100);
        let seen = layer.over(30 * 100 + 30, [0.0; 3]);
        assert!(seen[0] > 200.0, "{seen:?}");
        assert_eq!(layer.over(99 * 100 + 99, [33.0, 66.0, 99.0]), [33.0, 66.0, 99.0]);
        let none = draw(&Deadwood::default(), 0.0, 20);
        assert!(none.cover.iter().all(|cover| *cover == 0.0));
    }
}
