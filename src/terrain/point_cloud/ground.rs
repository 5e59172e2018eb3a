//! Which ground points make the terrain: one a cell, without those far off their surroundings.

use rayon::prelude::*;

use super::Error;
use super::layout::cell_index;
use crate::io::las::PointCloud;
use crate::progress::{Reporter, Warning};
use crate::raster::Frame;

/// Classes of the ground: ground, model key-points (LAS 1.4 R15, tables 9 and 17).
const GROUND: [u8; 2] = [2, 8];
/// Class of water surfaces. They carry the ground to the shore, and over brooks; wider water is masked.
pub(super) const WATER: u8 = 9;

/// Blocks in which ground points are judged are at least this wide, m. chosen: a few crowns across.
/// In sparse clouds the width doubles until they hold enough.
const BLOCK_M: f64 = 5.0;
/// Ground points a block holds on average at least. chosen: a median of four outvotes one bad point.
const POINTS_PER_BLOCK: f64 = 4.0;
/// Neighbouring blocks with points without which a block is not judged.
const MIN_NEIGHBOURS: usize = 4;
/// Least distance from the surroundings that is suspicious, m. chosen: ditches, banks and boulders
/// that a few points hit stay below.
const TOLERANCE_M: f64 = 2.0;
/// The same as a multiple of the surroundings' own roughness. chosen: six standard deviations.
const TOLERANCE_SIGMA: f64 = 6.0;
/// Standard deviations in one median absolute deviation of a normal distribution.
const SIGMA_PER_MAD: f64 = 1.4826;
/// Points that stick out together and still count as errors. chosen: real cliffs, pits and
/// sinkholes hold more.
const MAX_COMPANIONS: usize = 3;
/// Rounds of removal: what hid behind a worse point is found in the next.
const ROUNDS: usize = 3;

/// How far points bear on which others are kept, m: each round looks two blocks about. Blocks of twice
/// the least width are reckoned with.
pub(super) const REACH_M: f64 = 2.0 * 2.0 * BLOCK_M * ROUNDS as f64;

/// A ground point, in metres east and south of the frame's north-west corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GroundPoint {
    pub east_m: f64,
    pub south_m: f64,
    pub z_m: f64,
}

/// Ground points in row-major order of their cells, one a cell at most.
///
/// Of a cell's points the one of median height is kept, which neither leftover undergrowth nor a low
/// outlier reaches; of an even number, that of the middle two which stands nearer to the centre.
pub(super) fn points(
    cloud: &PointCloud,
    frame: &Frame,
    reporter: &Reporter,
) -> Result<Vec<GroundPoint>, Error> {
    let stage = reporter.stage("ground points", cloud.len() as u64);
    if !(0..cloud.len()).any(|index| GROUND.contains(&cloud.class(index))) {
        return Err(Error::NoGround { points: cloud.len() });
    }
    let (starts, members) = by_cell(cloud, frame);
    let mut points: Vec<GroundPoint> = (0..frame.len())
        .into_par_iter()
        .filter_map(|cell| {
            let of_cell = &members[starts[cell] as usize..starts[cell + 1] as usize];
            median_point(cloud, frame, cell, of_cell)
        })
        .collect();
    let before = points.len();
    for _ in 0..ROUNDS {
        reporter.check_cancelled()?;
        let outlying = outliers(&points, frame);
        if outlying.is_empty() {
            break;
        }
        let mut next = outlying.into_iter().peekable();
        let mut index = 0;
        points.retain(|_| {
            let out = next.next_if_eq(&index).is_some();
            index += 1;
            !out
        });
    }
    stage.advance(cloud.len() as u64);
    let removed = before - points.len();
    if removed > 0 {
        reporter.warn(Warning::GroundOutliers { points: removed });
    }
    Ok(points)
}

/// Ground points sorted by cell: where each cell's begin, and the points' indices.
fn by_cell(cloud: &PointCloud, frame: &Frame) -> (Vec<u32>, Vec<u32>) {
    assert!(cloud.len() < u32::MAX as usize, "points are counted in 32 bits");
    let is_ground = |index: &usize| {
        let class = cloud.class(*index);
        class == WATER || GROUND.contains(&class)
    };
    let cell_of = |index: usize| {
        let [x, y, _] = cloud.position(index);
        cell_index(frame, x, y)
    };
    let ground: Vec<(u32, u32)> = (0..cloud.len())
        .into_par_iter()
        .filter(is_ground)
        .map(|index| (cell_of(index) as u32, index as u32)) // cells: ≤ max_cells; points: asserted
        .collect();
    sorted(&ground, frame.len())
}

/// (key, value) pairs sorted by key, in order within a key: where each key begins, and the values.
fn sorted(pairs: &[(u32, u32)], keys: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0_u32; keys + 1];
    for (key, _) in pairs {
        starts[*key as usize + 1] += 1;
    }
    for key in 0..keys {
        starts[key + 1] += starts[key];
    }
    let mut next = starts.clone();
    let mut values = vec![0; pairs.len()];
    for (key, value) in pairs {
        let slot = &mut next[*key as usize];
        values[*slot as usize] = *value;
        *slot += 1;
    }
    (starts, values)
}

fn median_point(
    cloud: &PointCloud,
    frame: &Frame,
    cell: usize,
    members: &[u32],
) -> Option<GroundPoint> {
    let t = &frame.transform;
    let center = t.center(frame.cell(cell));
    let point = |index: u32| {
        let [x, y, z] = cloud.position(index as usize);
        GroundPoint { east_m: x - t.west_m, south_m: t.north_m - y, z_m: z }
    };
    if let [only] = members {
        return Some(point(*only));
    }
    let mut points: Vec<GroundPoint> = members.iter().map(|i| point(*i)).collect();
    points.sort_by(|a, b| a.z_m.total_cmp(&b.z_m));
    let (lower, upper) =
        (points.get(members.len().checked_sub(1)? / 2)?, points.get(members.len() / 2)?);
    let off_center = |p: &GroundPoint| {
        let east = p.east_m - (center.east_m - t.west_m);
        let south = p.south_m - (t.north_m - center.north_m);
        east * east + south * south
    };
    Some(if off_center(upper) < off_center(lower) { *upper } else { *lower })
}

/// A plane over the ground: height at a point, and slopes.
#[derive(Clone, Copy, Debug)]
struct Plane {
    at: GroundPoint,
    per_east: f64,
    per_south: f64,
}

impl Plane {
    /// A point's height above the plane.
    fn above(&self, p: &GroundPoint) -> f64 {
        let rise = self.per_east * (p.east_m - self.at.east_m)
            + self.per_south * (p.south_m - self.at.south_m);
        p.z_m - self.at.z_m - rise
    }

    /// The plane of least squares through points, `None` if they lie on a line.
    fn through(points: &[GroundPoint]) -> Option<Self> {
        let n = points.len() as f64;
        let mean = |of: fn(&GroundPoint) -> f64| points.iter().map(of).sum::<f64>() / n;
        let at = GroundPoint {
            east_m: mean(|p| p.east_m),
            south_m: mean(|p| p.south_m),
            z_m: mean(|p| p.z_m),
        };
        let (mut ee, mut es, mut ss, mut ez, mut sz) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for p in points {
            let (e, s, z) = (p.east_m - at.east_m, p.south_m - at.south_m, p.z_m - at.z_m);
            ee += e * e;
            es += e * s;
            ss += s * s;
            ez += e * z;
            sz += s * z;
        }
        let determinant = ee * ss - es * es;
        // the spread across the line must be a tenth of the spread along it
        if determinant <= 0.01 * (ee + ss) * (ee + ss) {
            return None;
        }
        let per_east = (ez * ss - sz * es) / determinant;
        let per_south = (sz * ee - ez * es) / determinant;
        Some(Self { at, per_east, per_south })
    }
}

/// Indices of points that stand alone far above or below their surroundings, ascending.
///
/// Each block's points are measured against the plane through the medians of the eight blocks around
/// it; how rough the nine blocks are about that plane sets the tolerance, so cliffs make it wide.
fn outliers(points: &[GroundPoint], frame: &Frame) -> Vec<usize> {
    let t = &frame.transform;
    let area_m2 = frame.len() as f64 * t.cell_m * t.cell_m;
    let least_m = (POINTS_PER_BLOCK * area_m2 / points.len().max(1) as f64).sqrt();
    // doubled widths and lines at their multiples: a part of the cloud has the blocks of the whole
    let mut block_m = BLOCK_M;
    while block_m < least_m {
        block_m *= 2.0;
    }
    let (east_m, south_m) = (t.west_m.rem_euclid(block_m), (-t.north_m).rem_euclid(block_m));
    let blocks = |cells: usize| (cells as f64 * t.cell_m / block_m) as usize + 2;
    let (rows, cols) = (blocks(frame.rows), blocks(frame.cols));
    let block_of = |p: &GroundPoint| {
        let col = ((p.east_m + east_m) / block_m) as usize;
        let row = ((p.south_m + south_m) / block_m) as usize;
        row.min(rows - 1) * cols + col.min(cols - 1)
    };
    let pairs: Vec<(u32, u32)> =
        points.iter().enumerate().map(|(i, p)| (block_of(p) as u32, i as u32)).collect();
    let (starts, members) = sorted(&pairs, rows * cols);
    let of_block = |block: usize| &members[starts[block] as usize..starts[block + 1] as usize];
    let medians: Vec<Option<GroundPoint>> = (0..rows * cols)
        .into_par_iter()
        .map(|block| {
            let mut of_block: Vec<GroundPoint> =
                of_block(block).iter().map(|i| points[*i as usize]).collect();
            of_block.sort_by(|a, b| a.z_m.total_cmp(&b.z_m));
            of_block.get(of_block.len() / 2).copied()
        })
        .collect();

    let judge = |block: usize| -> Vec<usize> {
        let (row, col) = (block / cols, block % cols);
        let around: Vec<usize> = (row.saturating_sub(1)..=(row + 1).min(rows - 1))
            .flat_map(|r| {
                (col.saturating_sub(1)..=(col + 1).min(cols - 1)).map(move |c| r * cols + c)
            })
            .collect();
        let neighbours: Vec<GroundPoint> =
            around.iter().filter(|b| **b != block).filter_map(|b| medians[*b]).collect();
        if neighbours.len() < MIN_NEIGHBOURS || of_block(block).is_empty() {
            return Vec::new();
        }
        let Some(plane) = Plane::through(&neighbours) else { return Vec::new() };
        let above: Vec<f64> = around
            .iter()
            .flat_map(|b| of_block(*b))
            .map(|i| plane.above(&points[*i as usize]))
            .collect();
        let mut deviations: Vec<f64> = above.iter().map(|a| a.abs()).collect();
        let middle = deviations.len() / 2;
        let (_, mad, _) = deviations.select_nth_unstable_by(middle, f64::total_cmp);
        let tolerance = TOLERANCE_M.max(TOLERANCE_SIGMA * SIGMA_PER_MAD * *mad);
        // companions are counted from half the tolerance: the rim of a real pit is there as well
        let high = above.iter().filter(|a| **a > tolerance / 2.0).count();
        let low = above.iter().filter(|a| **a < -tolerance / 2.0).count();
        of_block(block)
            .iter()
            .map(|i| *i as usize)
            .filter(|i| {
                let a = plane.above(&points[*i]);
                (a > tolerance && high <= MAX_COMPANIONS)
                    || (a < -tolerance && low <= MAX_COMPANIONS)
            })
            .collect()
    };
    let mut found: Vec<usize> = (0..rows * cols).into_par_iter().flat_map_iter(judge).collect();
    found.sort_unstable();
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::las::Quantization;

    fn cloud(points: &[([f64; 3], u8)]) -> PointCloud {
        let mut cloud =
            PointCloud::new([Quantization { scale: 0.001, offset: 0.0 }; 3], None, None);
        for (position, class) in points {
            cloud.push(*position, *class);
        }
        cloud
    }

    /// A rough slope of 60 × 60 m, one ground point a m², changed by `height`.
    fn slope(height: impl Fn(f64, f64, f64) -> f64) -> (PointCloud, Frame) {
        let points: Vec<_> = (0..3600)
            .map(|i| {
                let (x, y) = (f64::from(i % 60) + 0.5, f64::from(i / 60) + 0.5);
                let z = 100.0 + 0.8 * x + 0.1 * f64::from(i * 7919 % 11);
                ([x, y, height(x, y, z)], 2)
            })
            .collect();
        (cloud(&points), Frame::local(60, 60, 1.0))
    }

    /// How many points of such a slope are left out.
    fn left_out(height: impl Fn(f64, f64, f64) -> f64) -> usize {
        let (cloud, frame) = slope(height);
        let reporter = Reporter::silent();
        let kept = points(&cloud, &frame, &reporter).unwrap().len();
        assert_eq!(reporter.warnings().len(), usize::from(kept < 3600));
        3600 - kept
    }

    #[test]
    fn the_median_of_a_cell_is_kept() {
        let frame = Frame::local(1, 2, 1.0);
        let cloud = cloud(&[
            ([0.1, 0.5, 9.0], 2),
            ([0.6, 0.5, 10.0], 2),
            ([0.9, 0.5, 3.0], 2),
            ([0.5, 0.5, 20.0], 5), // no ground
            ([1.9, 0.5, 1.0], 8),
            ([1.6, 0.5, 2.0], 9), // of two, the nearer to the centre
        ]);
        let kept = points(&cloud, &frame, &Reporter::silent()).unwrap();
        let seen: Vec<_> = kept.iter().map(|p| (p.east_m, p.south_m, p.z_m)).collect();
        assert_eq!(seen, [(0.1, 0.5, 9.0), (1.6, 0.5, 2.0)]);
    }

    #[test]
    fn issue_2_water_alone_is_no_ground() {
        let cloud = cloud(&[([0.5, 0.5, 1.0], 9), ([0.6, 0.5, 1.0], 5)]);
        let error = points(&cloud, &Frame::local(1, 1, 1.0), &Reporter::silent()).unwrap_err();
        assert_eq!(error, Error::NoGround { points: 2 });
    }

    #[test]
    fn no_ground_class_is_an_error_that_says_what_to_do() {
        let cloud = cloud(&[([0.5, 0.5, 1.0], 1), ([0.6, 0.5, 1.0], 5)]);
        let error = points(&cloud, &Frame::local(1, 1, 1.0), &Reporter::silent()).unwrap_err();
        assert_eq!(error, Error::NoGround { points: 2 });
        assert!(error.to_string().contains("pdal ground"), "{error}");
    }

    #[test]
    fn lone_pits_and_spikes_go() {
        assert_eq!(left_out(|_, _, z| z), 0);
        let at = |x: f64, y: f64, cx: f64, cy: f64| x == cx + 0.5 && y == cy + 0.5;
        assert_eq!(left_out(|x, y, z| if at(x, y, 30.0, 31.0) { z - 5.0 } else { z }), 1);
        assert_eq!(left_out(|x, y, z| if at(x, y, 30.0, 31.0) { z + 4.0 } else { z }), 1);
        assert_eq!(left_out(|x, y, z| if at(x, y, 30.0, 31.0) { z - 700.0 } else { z }), 1);
        let pair = |x, y| at(x, y, 12.0, 40.0) || at(x, y, 13.0, 40.0) || at(x, y, 50.0, 9.0);
        assert_eq!(left_out(|x, y, z| if pair(x, y) { z - 6.0 } else { z }), 3);
    }

    #[test]
    fn real_forms_stay() {
        // a cliff, a ditch, a sinkhole of 5 m, a ridge
        assert_eq!(left_out(|x, _, z| if x > 31.0 { z + 20.0 } else { z }), 0);
        assert_eq!(left_out(|x, _, z| if (30.0..32.0).contains(&x) { z - 3.0 } else { z }), 0);
        let hole = |x: f64, y: f64| (x - 30.0).hypot(y - 30.0) < 2.5;
        assert_eq!(left_out(|x, y, z| if hole(x, y) { z - 5.0 } else { z }), 0);
        assert_eq!(left_out(|x, _, z| z - 2.0 * (x - 30.0).abs()), 0);
    }
}
