//! Wind storms: how much of a storm's speed reaches a tree, and what it breaks.
//!
//! # Reference
//! Seidl et al. 2014, doi:10.1016/j.envsoft.2013.10.003; Hale et al. 2015, doi:10.1016/j.envsoft.2015.01.016; Peytavie et al.
//! 2024, section 5.3.2, Eqs. 14–16, doi:10.1145/3641816.

use std::f32::consts::{PI, TAU};

use crate::math;

/// Branches break in faster wind: 65 km/h, force 8 of Beaufort's scale (Peytavie 2024, section 5.3.2).
pub const BRANCH_BREAKING_M_S: f32 = 65.0 / 3.6;

/// Turning moment per square of wind speed and per dbh² · height, N m (m/s)⁻² m⁻³ (Hale 2015; Peytavie 2024, Eq. 15).
const TURNING_MOMENT_COEFFICIENT: f32 = 111.7;
/// Lower plants bend. chosen: by Eqs. 14–15 slender saplings would break in any gale, but only trees were measured.
pub const LEAST_HEIGHT_M: f32 = 5.0;
/// Share of its height at which a stem breaks, lowest and highest. chosen: mostly below the crown.
const BREAK_HEIGHT_FRACTION: [f32; 2] = [0.1, 0.5];
/// Share of the wind that is left in full shelter. chosen: as a few heights behind a dense shelter belt.
const SHELTERED_FRACTION: f32 = 0.4;
/// Tangent of the shelter's angle that is full shelter. chosen: the top of a shelter belt seen from five of its heights away.
const FULL_SHELTER_TAN: f32 = 0.2;
/// What shelters counts as further off by this much. chosen: a crown's width, as air flows round a single crown.
const FLOW_AROUND_M: f32 = 10.0;
/// How fast wind fades below the top of a canopy. chosen: forests have 2–3 (Cionco 1965, exponential profile).
const CANOPY_ATTENUATION: f32 = 2.5;

/// A storm, blowing towards the direction given.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct WindStorm {
    /// Speed towards the east.
    pub wind_east_m_s: f32,
    /// Speed towards the north.
    pub wind_north_m_s: f32,
}

impl WindStorm {
    /// Speed of the storm where nothing shelters, m/s.
    pub fn speed_m_s(&self) -> f32 {
        let (east, north) = (self.wind_east_m_s, self.wind_north_m_s);
        (east * east + north * north).sqrt()
    }

    /// Direction in which trees fall, downwind: radians clockwise from north, in 0..2π.
    pub fn fall_azimuth_rad(&self) -> f32 {
        let azimuth_rad = math::atan2(self.wind_east_m_s, self.wind_north_m_s);
        if azimuth_rad < 0.0 { azimuth_rad + TAU } else { azimuth_rad }
    }
}

/// Ground and canopy that a storm blows over, row-major, row 0 north.
#[derive(Clone, Copy, Debug)]
pub struct StormSurface<'a> {
    /// Rows of cells.
    pub rows: usize,
    /// Columns of cells.
    pub cols: usize,
    /// Side of a cell.
    pub cell_m: f32,
    /// Elevation of the ground.
    pub elevation_m: &'a [f32],
    /// Height of the tallest plant, 0 where there is none.
    pub canopy_height_m: &'a [f32],
}

/// Share of the storm's speed at the top of each cell's canopy, in 0.4..=1.
///
/// Shelter is the steepest line up to any top upwind, of ground or canopy. Each cell lies on one of many parallel lines along the
/// wind; each line is walked downwind with the convex hull of the tops behind, so the cost is that of the cells.
///
/// # Reference
/// Peytavie et al. 2024, section 5.3.2, "directional occlusion"; hull as in Timonen & Westerholm 2010.
/// # Departures
/// They name no formula: the share falls with smoothstep(tan / 0.2) from 1 to 0.4.
pub fn exposure_fraction(surface: &StormSurface, storm: &WindStorm) -> Vec<f32> {
    let (rows, cols) = (surface.rows, surface.cols);
    assert!(
        surface.elevation_m.len() == rows * cols && surface.canopy_height_m.len() == rows * cols,
        "a surface needs an elevation and a canopy height for each cell"
    );
    let mut exposure = vec![1.0; rows * cols];
    let (east, south) = (storm.wind_east_m_s, -storm.wind_north_m_s);
    if east == 0.0 && south == 0.0 {
        return exposure;
    }
    // steps go along the axis that the wind is closer to; a line's place on the other axis is rounded
    let along_cols = east.abs() >= south.abs();
    let (major, minor) = if along_cols { (east, south) } else { (south, east) };
    let (steps, width) = if along_cols { (cols, rows) } else { (rows, cols) };
    let slope = minor / major.abs();
    let step_m = surface.cell_m * (1.0 + slope * slope).sqrt();
    // grids are far smaller than 2²⁴ cells wide, so indices are exact in f32 and fit isize
    let offsets: Vec<isize> =
        (0..steps).map(|step| (slope * step as f32).round() as isize).collect();
    let last = offsets.last().copied().unwrap_or(0);
    let mut hull = Vec::new();
    for line in -last.max(0)..width as isize - last.min(0) {
        hull.clear();
        for (step, offset) in offsets.iter().enumerate() {
            let across = line + offset;
            if across < 0 || across >= width as isize {
                continue;
            }
            let along = if major > 0.0 { step } else { steps - 1 - step };
            let across = across as usize; // checked above
            let cell = if along_cols { across * cols + along } else { along * cols + across };
            let distance_m = step as f32 * step_m;
            let top_m = surface.elevation_m[cell] + surface.canopy_height_m[cell];
            let shelter_tan = steepest_tan(&hull, distance_m + FLOW_AROUND_M, top_m);
            exposure[cell] = exposure_at(shelter_tan);
            push_onto_hull(&mut hull, [distance_m, top_m]);
        }
    }
    exposure
}

/// Share of the speed at the top of the canopy that reaches a plant below it, in 0..=1.
///
/// # Reference
/// Cionco 1965, J. Appl. Meteorol. 4, 517: e^(−a (1 − z/h)).
pub fn below_canopy_fraction(height_m: f32, canopy_height_m: f32) -> f32 {
    if height_m >= canopy_height_m {
        return 1.0;
    }
    math::exp(-CANOPY_ATTENUATION * (1.0 - height_m / canopy_height_m))
}

/// What a stem withstands, by species.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StemWood {
    /// Turning moment per mass of stem that uproots it (C).
    pub pulling_coefficient_nm_kg: f32,
    /// Bending stress that breaks it (MOR).
    pub modulus_of_rupture_pa: f32,
    /// Density of air-dry wood (ρ).
    pub density_kg_m3: f32,
    /// Volume of the stem by that of a cylinder of dbh and height (f_V).
    pub form_factor: f32,
}

/// Wind at the top of a tree that brings it down; the lower of the two does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CriticalSpeeds {
    /// Uproots it (w_u).
    pub uproot_m_s: f32,
    /// Breaks its stem (w_s).
    pub snap_m_s: f32,
}

/// Wind speeds that uproot a tree and that break its stem, m/s; infinite for plants below 5 m.
///
/// `wet_factor` is the mass of the stem by that of its dry wood: 1.85 for a live tree, 1 for a snag.
///
/// # Reference
/// Peytavie et al. 2024, Eqs. 14–16, φ and h in metres. Dbh² · h cancels from w_u, so a species is uprooted at one speed whatever
/// its size; w_s goes with √(dbh / height).
/// # Departures
/// Plants below 5 m bend: by the equations a sapling of 3 m and 2 cm would break at 16 m/s.
pub fn critical_speeds(
    wood: &StemWood,
    dbh_m: f32,
    height_m: f32,
    wet_factor: f32,
) -> CriticalSpeeds {
    if height_m < LEAST_HEIGHT_M {
        return CriticalSpeeds { uproot_m_s: f32::INFINITY, snap_m_s: f32::INFINITY };
    }
    let turning_nm_s2_m2 = TURNING_MOMENT_COEFFICIENT * dbh_m * dbh_m * height_m;
    let volume_m3 = PI / 4.0 * dbh_m * dbh_m * height_m * wood.form_factor;
    let mass_kg = wood.density_kg_m3 * wet_factor * volume_m3;
    let uproot_nm = wood.pulling_coefficient_nm_kg * mass_kg;
    let snap_nm = wood.modulus_of_rupture_pa * dbh_m * dbh_m * dbh_m * PI / 32.0;
    CriticalSpeeds {
        uproot_m_s: (uproot_nm / turning_nm_s2_m2).sqrt(),
        snap_m_s: (snap_nm / turning_nm_s2_m2).sqrt(),
    }
}

/// What a storm does to a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StormDamage {
    /// Nothing.
    None,
    /// Breaks some of its primary branches.
    Branches {
        /// Share that breaks, above 0.
        fraction: f32,
    },
    /// Breaks its stem.
    Snapped {
        /// Share of its height that stays standing.
        height_fraction: f32,
    },
    /// Tears it out with its roots.
    Uprooted,
}

/// What wind does to a tree; of `draws`, uniform in 0..1, the first scatters branches, the second the height of the break.
///
/// # Reference
/// Peytavie et al. 2024, section 5.3.2.
/// # Departures
/// They draw for each branch. One draw scatters the share of branches evenly about its mean, as far as 0..=1 lets it.
pub fn damage(speeds: &CriticalSpeeds, wind_m_s: f32, draws: [f32; 4]) -> StormDamage {
    let [branch_draw, break_draw, ..] = draws;
    let fall_m_s = speeds.uproot_m_s.min(speeds.snap_m_s);
    if wind_m_s > fall_m_s {
        if speeds.uproot_m_s <= speeds.snap_m_s {
            return StormDamage::Uprooted;
        }
        let [lowest, highest] = BREAK_HEIGHT_FRACTION;
        return StormDamage::Snapped { height_fraction: math::lerp(lowest, highest, break_draw) };
    }
    if wind_m_s <= BRANCH_BREAKING_M_S {
        return StormDamage::None;
    }
    let mean = (wind_m_s - BRANCH_BREAKING_M_S) / (fall_m_s - BRANCH_BREAKING_M_S);
    let fraction = mean + (2.0 * branch_draw - 1.0) * mean.min(1.0 - mean);
    if fraction > 0.0 { StormDamage::Branches { fraction } } else { StormDamage::None }
}

/// Share of the wind behind shelter that rises by so much per distance.
fn exposure_at(shelter_tan: f32) -> f32 {
    math::lerp(1.0, SHELTERED_FRACTION, math::smoothstep(shelter_tan / FULL_SHELTER_TAN))
}

/// Tangent of the steepest line from a place up to a hull upwind of it; at least 0.
fn steepest_tan(hull: &[[f32; 2]], distance_m: f32, top_m: f32) -> f32 {
    let mut steepest = f32::NEG_INFINITY;
    // seen from outside, a convex hull rises and then falls
    for [corner_m, corner_top_m] in hull.iter().rev() {
        let tan = (corner_top_m - top_m) / (distance_m - corner_m);
        if tan < steepest {
            break;
        }
        steepest = tan;
    }
    steepest.max(0.0)
}

/// Adds the next top downwind to an upper convex hull of (distance, top).
fn push_onto_hull(hull: &mut Vec<[f32; 2]>, next: [f32; 2]) {
    while let [.., before, last] = hull.as_slice() {
        let over = (last[1] - before[1]) * (next[0] - before[0]);
        if over > (next[1] - before[1]) * (last[0] - before[0]) {
            break;
        }
        hull.pop();
    }
    hull.push(next);
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIR: StemWood = StemWood {
        pulling_coefficient_nm_kg: 145.0,
        modulus_of_rupture_pa: 42e6,
        density_kg_m3: 415.0,
        form_factor: 0.45,
    };
    const WINDS: [[f32; 2]; 6] =
        [[20.0, 0.0], [-20.0, 0.0], [0.0, 20.0], [0.0, -20.0], [15.0, 9.0], [-7.0, -18.0]];

    fn exposure(
        cols: usize,
        tops_m: &[f32],
        [wind_east_m_s, wind_north_m_s]: [f32; 2],
    ) -> Vec<f32> {
        let surface = StormSurface {
            rows: tops_m.len() / cols,
            cols,
            cell_m: 5.0,
            elevation_m: &vec![300.0; tops_m.len()],
            canopy_height_m: tops_m,
        };
        exposure_fraction(&surface, &WindStorm { wind_east_m_s, wind_north_m_s })
    }

    #[test]
    fn critical_speeds_have_their_closed_forms() {
        let speeds = critical_speeds(&FIR, 0.4, 25.0, 1.85);
        // w_u = √(C ρ f_w f_V π/4 / 111.7) = √352.4; w_s = √(MOR π φ / (32 · 111.7 h)) = √590.6
        assert!((speeds.uproot_m_s - 18.771).abs() < 1e-2, "{speeds:?}");
        assert!((speeds.snap_m_s - 24.302).abs() < 1e-2, "{speeds:?}");
        let snag = critical_speeds(&FIR, 0.4, 25.0, 1.0);
        assert!((snag.uproot_m_s - 18.771 / 1.85_f32.sqrt()).abs() < 1e-2);
    }

    #[test]
    fn slender_trees_snap_sooner_and_deep_roots_hold_longer() {
        let snap = |dbh_m, height_m| critical_speeds(&FIR, dbh_m, height_m, 1.85).snap_m_s;
        assert!(snap(0.3, 25.0) < snap(0.4, 25.0) && snap(0.3, 30.0) < snap(0.3, 25.0));
        let rooted = StemWood { pulling_coefficient_nm_kg: 162.0, ..FIR };
        let uproot = |wood| critical_speeds(wood, 0.4, 25.0, 1.85).uproot_m_s;
        assert!(uproot(&rooted) > uproot(&FIR));
    }

    #[test]
    fn saplings_bend() {
        let speeds = critical_speeds(&FIR, 0.02, 3.0, 1.85);
        assert_eq!(damage(&speeds, 40.0, [0.5; 4]), StormDamage::None);
        // just above the bound the printed equations hold
        assert!(critical_speeds(&FIR, 0.03, 5.0, 1.85).snap_m_s < 17.0);
    }

    #[test]
    fn damage_grows_with_the_wind() {
        let speeds = CriticalSpeeds { uproot_m_s: 30.0, snap_m_s: 40.0 };
        assert_eq!(damage(&speeds, 18.0, [0.5; 4]), StormDamage::None);
        let half_way_m_s = (30.0 + BRANCH_BREAKING_M_S) / 2.0;
        let StormDamage::Branches { fraction } = damage(&speeds, half_way_m_s, [0.5; 4]) else {
            panic!("branches break half way");
        };
        assert!((fraction - 0.5).abs() < 1e-6);
        assert_eq!(damage(&speeds, 30.1, [0.5; 4]), StormDamage::Uprooted);
        let snapping = CriticalSpeeds { uproot_m_s: 40.0, snap_m_s: 30.0 };
        let snapped = StormDamage::Snapped { height_fraction: 0.3 };
        assert_eq!(damage(&snapping, 45.0, [0.5; 4]), snapped);
    }

    #[test]
    fn trees_fall_downwind() {
        let azimuth_rad = |wind_east_m_s, wind_north_m_s| {
            WindStorm { wind_east_m_s, wind_north_m_s }.fall_azimuth_rad()
        };
        assert_eq!(azimuth_rad(0.0, 20.0), 0.0);
        assert!((azimuth_rad(20.0, 0.0) - PI / 2.0).abs() < 1e-6);
        assert!((azimuth_rad(0.0, -20.0) - PI).abs() < 1e-6);
        assert!((azimuth_rad(-20.0, 0.0) - 1.5 * PI).abs() < 1e-6);
    }

    #[test]
    fn level_ground_and_level_canopy_lie_open() {
        for wind in WINDS {
            assert!(exposure(31, &[0.0; 31 * 20], wind).iter().all(|&share| share == 1.0));
            assert!(exposure(31, &[25.0; 31 * 20], wind).iter().all(|&share| share == 1.0));
        }
    }

    #[test]
    fn a_tall_stand_shelters_what_lies_downwind() {
        // columns 20–29 carry 25 m, the others 5 m
        let tops_m: Vec<f32> = (0..20 * 60)
            .map(|cell| if (20..30).contains(&(cell % 60)) { 25.0 } else { 5.0 })
            .collect();
        for (sign, lee, windward) in [(1.0, 30, 19), (-1.0, 19, 30)] {
            let row = &exposure(60, &tops_m, [sign * 20.0, 0.0])[10 * 60..11 * 60];
            assert_eq!(row[windward], 1.0);
            assert!((20..30).all(|col| row[col] == 1.0));
            assert!((row[lee] - SHELTERED_FRACTION).abs() < 1e-6);
        }
        // 20 m over 110 m + 10 m, from the last tall column
        let row = &exposure(60, &tops_m, [20.0, 0.0])[..60];
        assert!((row[29 + 22] - exposure_at(20.0 / 120.0)).abs() < 1e-5);
        assert!((30..59).all(|col| row[col] <= row[col + 1]));
    }

    #[test]
    fn the_hull_finds_what_a_search_of_all_tops_finds() {
        let tops_m: Vec<f32> = (0..400_u32)
            .map(|cell| (cell.wrapping_mul(2_654_435_761) >> 20) as f32 / 100.0)
            .collect();
        let found = exposure(400, &tops_m, [9.0, 0.0]);
        for cell in 0..400 {
            let tan = |upwind: usize| {
                (tops_m[upwind] - tops_m[cell]) / ((cell - upwind) as f32 * 5.0 + FLOW_AROUND_M)
            };
            let steepest = (0..cell).map(tan).fold(0.0, f32::max);
            assert!((found[cell] - exposure_at(steepest)).abs() < 1e-4, "cell {cell}");
        }
    }

    #[test]
    fn shelter_is_found_in_every_wind() {
        // a wall of one cell all round a pit shelters the pit from every side
        let mut tops_m = vec![80.0; 15 * 15];
        for row in 1..14 {
            tops_m[row * 15 + 1..row * 15 + 14].fill(0.0);
        }
        for wind in WINDS {
            let found = exposure(15, &tops_m, wind);
            assert!((0..225).all(|cell| tops_m[cell] > 0.0 || found[cell] < 0.5), "{wind:?}");
        }
    }

    #[test]
    fn wind_fades_below_the_canopy() {
        assert_eq!(below_canopy_fraction(30.0, 25.0), 1.0);
        assert!((below_canopy_fraction(10.0, 20.0) - math::exp(-1.25)).abs() < 1e-6);
    }
}
