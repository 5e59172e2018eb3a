//! A made-up classified cloud: conifers on noisy hills, as an airborne scanner would see them.
//!
//! For measurements and tests where real clouds are too small or not there.

use crate::io::las::{PointCloud, Quantization};
use crate::math;
use crate::raster::{Crs, LengthUnit, MapPoint};
use crate::rng::{self, Key, Process};

/// South-west corner of the cloud: a place in EPSG:32633 where no cell of 1 km divides it.
pub const CORNER: MapPoint = MapPoint { east_m: 400_250.0, north_m: 5_100_130.0 };

/// Distance between scan lines and pulses at one point a m², m.
const SPACING_M: f64 = 1.0;
/// Trees stand in squares of this width, one in each at most, m.
const TREE_SQUARE_M: f64 = 5.0;
/// Squares that hold a tree.
const TREE_FRACTION: f32 = 0.75;
/// Pulses under a crown that reach the ground, and pulses beside crowns that do.
const GROUND_FRACTION: [f32; 2] = [0.2, 0.75];
/// Measuring error, m, largest.
const NOISE_M: f32 = 0.05;

/// Made-up ground at a map position, m: hills of 1 km, 180 m and 25 m.
pub fn ground_elevation_m(place: MapPoint) -> f64 {
    let wave = |length_m: f64, height_m: f64, turn: f64| {
        let along = place.east_m * math::cos_f64(turn) + place.north_m * math::sin_f64(turn);
        height_m * math::sin_f64(along * std::f64::consts::TAU / length_m)
    };
    500.0 + wave(1000.0, 60.0, 0.4) + wave(180.0, 8.0, 1.9) + wave(25.0, 0.6, 2.6)
}

/// A tree of the made-up forest: a cone on the ground.
#[derive(Clone, Copy, Debug)]
struct Tree {
    foot: MapPoint,
    height_m: f64,
    radius_m: f64,
}

/// The tree of a square, if it has one. Squares are counted from the corner.
fn tree(seed: u64, col: i64, row: i64) -> Option<Tree> {
    let key = key(seed, Process::SyntheticTree, rng::entity_of_cell(col, row));
    let [there, east, north, size] = rng::uniforms(key);
    let at =
        |square: i64, share: f32| (square as f64 + 0.2 + 0.6 * f64::from(share)) * TREE_SQUARE_M;
    (there < TREE_FRACTION).then(|| Tree {
        foot: MapPoint {
            east_m: CORNER.east_m + at(col, east),
            north_m: CORNER.north_m + at(row, north),
        },
        height_m: 8.0 + 20.0 * f64::from(size),
        radius_m: 1.6 + 1.0 * f64::from(size),
    })
}

fn key(seed: u64, process: Process, entity: u64) -> Key {
    Key { seed, process, year: 0, month: 0, entity }
}

/// Height of the crowns above ground at a map position, m; 0 beside them.
fn crown_height_m(seed: u64, place: MapPoint) -> f64 {
    let square = |m: f64| (m / TREE_SQUARE_M).floor() as i64;
    let (col, row) = (square(place.east_m - CORNER.east_m), square(place.north_m - CORNER.north_m));
    let mut top_m = 0.0_f64;
    for tree in
        (row - 1..=row + 1).flat_map(|r| (col - 1..=col + 1).filter_map(move |c| tree(seed, c, r)))
    {
        let (e, n) = (place.east_m - tree.foot.east_m, place.north_m - tree.foot.north_m);
        let share = 1.0 - (e * e + n * n).sqrt() / tree.radius_m;
        // the crown is the upper 70 % of the tree
        if share > 0.0 {
            top_m = top_m.max(tree.height_m * (0.3 + 0.7 * share));
        }
    }
    top_m
}

/// A forest's cloud on a square, in scan order: about 40 % ground (class 2), the rest vegetation (3, 5).
pub fn forest(seed: u64, side_m: f64, points_per_m2: f64) -> PointCloud {
    let axis = |offset| Quantization { scale: 0.01, offset };
    let axes = [axis(CORNER.east_m), axis(CORNER.north_m), axis(0.0)];
    let mut cloud = PointCloud::new(axes, Some(Crs::Epsg(32633)), Some(LengthUnit::Metre));
    let pulses = (side_m * points_per_m2.sqrt() / SPACING_M).round() as i64;
    let step_m = side_m / pulses as f64;
    for line in 0..pulses {
        for pulse in 0..pulses {
            // every other line runs back, as the scanner's mirror does
            let col = if line % 2 == 0 { pulse } else { pulses - 1 - pulse };
            let draws =
                rng::uniforms(key(seed, Process::SyntheticPulse, rng::entity_of_cell(col, line)));
            let at = |corner: f64, index: i64, share: f32| {
                corner + (index as f64 + f64::from(share)) * step_m
            };
            let place = MapPoint {
                east_m: at(CORNER.east_m, col, draws[0]),
                north_m: at(CORNER.north_m, line, draws[1]),
            };
            let crown_m = crown_height_m(seed, place);
            let beside = usize::from(crown_m <= 0.0);
            let (hit, depth) = (draws[2], f64::from(draws[3]));
            let (above_ground_m, class) = if hit < GROUND_FRACTION[beside] {
                (f64::from(NOISE_M * (2.0 * draws[3] - 1.0)), 2)
            } else if crown_m > 0.0 {
                (crown_m * (1.0 - 0.6 * depth * depth * depth), 5)
            } else {
                (0.4 * depth, 3)
            };
            let z_m = ground_elevation_m(place) + above_ground_m;
            cloud.push([place.east_m, place.north_m, z_m], class);
        }
    }
    cloud
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_forest_has_the_points_and_shares_it_says() {
        let cloud = forest(7, 100.0, 4.0);
        assert_eq!(cloud.len(), 40_000);
        let ground = (0..cloud.len()).filter(|i| cloud.class(*i) == 2).count() as f64 / 40_000.0;
        assert!((0.35..0.55).contains(&ground), "{ground}");
        let bounds = cloud.bounds().unwrap();
        assert!(bounds.max[0] - bounds.min[0] > 99.0 && bounds.min[1] >= CORNER.north_m);
    }

    #[test]
    fn equal_seeds_give_equal_forests() {
        let (a, b, c) = (forest(1, 20.0, 4.0), forest(1, 20.0, 4.0), forest(2, 20.0, 4.0));
        assert_eq!(a.position(777), b.position(777));
        assert_ne!(a.position(777), c.position(777));
    }
}
