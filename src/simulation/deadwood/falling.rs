//! Where wood falls: the direction of a stem, on slopes and beside trunks that stand in its way.

use crate::math;
use crate::plants::buckets::Buckets;

/// Directions that a falling stem may take around the one it leans to. chosen: enough to find a gap between trunks.
const TRIES: usize = 8;
/// Half of the sector that they lie in, radians. chosen: a stem glances off a trunk by some tens of degrees.
const TRY_SECTOR_RAD: f32 = 0.6;

/// Standing trunks that stems fall between.
pub struct StandingTrunks {
    east_m: Vec<f32>,
    south_m: Vec<f32>,
    radius_m: Vec<f32>,
    id: Vec<u64>,
    buckets: Buckets,
}

impl StandingTrunks {
    /// Trunks: id, place, and diameter at breast height in m.
    pub fn new(trunks: impl Iterator<Item = (u64, [f32; 2], f32)>) -> Self {
        let (mut id, mut east_m, mut south_m, mut radius_m) = (vec![], vec![], vec![], vec![]);
        for (trunk, at, dbh_m) in trunks {
            id.push(trunk);
            east_m.push(at[0]);
            south_m.push(at[1]);
            radius_m.push(0.5 * dbh_m);
        }
        let buckets = Buckets::new(&east_m, &south_m, 8.0);
        Self { east_m, south_m, radius_m, id, buckets }
    }

    /// Number of trunks, but its own, that a stem would lie across.
    pub(in crate::simulation) fn crossed(
        &self,
        own: u64,
        [east_m, south_m]: [f32; 2],
        azimuth_rad: f32,
        length_m: f32,
    ) -> usize {
        let (ahead_east, ahead_south) = (math::sin(azimuth_rad), -math::cos(azimuth_rad));
        let middle = [east_m + 0.5 * length_m * ahead_east, south_m + 0.5 * length_m * ahead_south];
        let mut crossed = 0;
        self.buckets.near(middle, 0.5 * length_m + 1.0, |trunk| {
            let (east, south) = (self.east_m[trunk] - east_m, self.south_m[trunk] - south_m);
            let along_m = east * ahead_east + south * ahead_south;
            let aside_m = (east * ahead_south - south * ahead_east).abs();
            let is_hit = (0.0..length_m).contains(&along_m) && aside_m < self.radius_m[trunk];
            crossed += usize::from(is_hit && self.id[trunk] != own);
        });
        crossed
    }

    /// Azimuth in radians, clockwise from north, that a stem falls to which leans to `azimuth_rad`: the nearest to it of
    /// those that cross the fewest trunks.
    pub fn direction(&self, own: u64, at: [f32; 2], azimuth_rad: f32, length_m: f32) -> f32 {
        let step_rad = TRY_SECTOR_RAD / (TRIES / 2) as f32;
        let (mut best_rad, mut fewest) = (azimuth_rad, usize::MAX);
        for turn in 0..=TRIES {
            // 0, 1, −1, 2, −2 …
            let steps = turn.div_ceil(2) as f32 * if turn.is_multiple_of(2) { -1.0 } else { 1.0 };
            let tried_rad = azimuth_rad + steps * step_rad;
            let crossed = self.crossed(own, at, tried_rad, length_m);
            if crossed < fewest {
                (best_rad, fewest) = (tried_rad, crossed);
            }
            if fewest == 0 {
                break;
            }
        }
        best_rad
    }
}

/// Azimuth in radians, clockwise from north, that a stem leans to which no wind throws: any on level ground, the steeper
/// the likelier downhill.
///
/// # Reference
/// chosen: the sum of a vector downhill, 2 sin(slope) long, and one of length 1 anywhere, so that from 30° on no stem falls
/// uphill.
pub fn lean_rad(slope_rad: f32, downhill_azimuth_rad: f32, draw: f32) -> f32 {
    let chance_rad = std::f32::consts::TAU * draw;
    let downhill = 2.0 * math::sin(slope_rad);
    let east = math::sin(chance_rad) + downhill * math::sin(downhill_azimuth_rad);
    let north = math::cos(chance_rad) + downhill * math::cos(downhill_azimuth_rad);
    math::atan2(east, north)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stem_falls_beside_trunks_not_through_them() {
        // north of it two trunks stand in a row
        let trunks = [(1, [50.0, 50.0], 0.4), (2, [50.0, 45.0], 0.6), (3, [50.0, 40.0], 0.6)];
        let standing = StandingTrunks::new(trunks.into_iter());
        assert_eq!(standing.crossed(1, [50.0, 50.0], 0.0, 20.0), 2);
        let azimuth_rad = standing.direction(1, [50.0, 50.0], 0.0, 20.0);
        assert!(azimuth_rad.abs() > 0.1 && azimuth_rad.abs() <= TRY_SECTOR_RAD);
        assert_eq!(standing.crossed(1, [50.0, 50.0], azimuth_rad, 20.0), 0);
        // short stems do not reach them
        assert_eq!(standing.direction(1, [50.0, 50.0], 0.0, 4.0), 0.0);
    }

    #[test]
    fn stems_fall_downhill_on_slopes_and_anywhere_on_level_ground() {
        let within = |slope_rad: f32| {
            (0..1000).filter(|i| lean_rad(slope_rad, 0.0, *i as f32 / 1000.0).abs() < 1.571).count()
        };
        assert!((495..=505).contains(&within(0.0)), "{}", within(0.0));
        assert!(within(0.35) > 650 && within(0.8) == 1000, "{} {}", within(0.35), within(0.8));
    }
}
