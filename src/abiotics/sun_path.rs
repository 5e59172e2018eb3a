//! The sun's path over a month's representative day, cut where it passes from one azimuth sector to the next.
//!
//! Sector `i` lies between the grid azimuths i and i + 1 of `azimuth_count` equal steps from the grid's north.
//! Within a sector the path is a chain of nodes at most one time step apart; between nodes both the sun's
//! tangent and its place in the sector are taken as straight in time.

use std::f64::consts::{PI, TAU};

use super::solar::{REPRESENTATIVE_DAY, SunPosition, declination_rad, sun_position};
use crate::math::{acos_f64, atan2_f64, cos_f64, sin_f64, tan_f64};

/// Hours of a day per radian of hour angle.
const HOURS_PER_RAD: f64 = 12.0 / PI;
/// Pieces of path shorter than this are dropped: rounding noise where two cuts fall together, 0.4 ms a day.
const SHORTEST_RAD: f64 = 1e-9 * 24.0;
/// Highest tangent of the sun's elevation kept, so that a zenith sun stays finite. chosen: 0.2 arc seconds off zenith.
const TAN_ZENITH: f64 = 1e6;

/// A stretch of a month's sun path within one azimuth sector.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SunArc {
    /// 0 is January.
    pub(crate) month_index: usize,
    /// The path; at least two nodes.
    pub(crate) nodes: Vec<SunNode>,
}

/// A moment of the sun's path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SunNode {
    /// Tangent of the sun's elevation, at least 0.
    pub(crate) tan_elevation: f32,
    /// Place in the sector, 0 at its first azimuth, 1 at its second.
    pub(crate) sector_fraction: f32,
    /// Half the time since the node before; 0 at the first.
    pub(crate) half_step_h: f32,
}

/// The sun paths of all months, by azimuth sector of the grid.
pub(crate) fn sun_arcs_by_sector(
    latitude_rad: f64,
    grid_convergence_rad: f64,
    azimuth_count: usize,
    longest_step_h: f64,
) -> Vec<Vec<SunArc>> {
    assert!(longest_step_h > 0.0, "steps along the sun's path take no time");
    let mut sectors = vec![Vec::new(); azimuth_count];
    let width_rad = TAU / azimuth_count as f64;
    for (month_index, day) in REPRESENTATIVE_DAY.iter().enumerate() {
        let declination_rad = declination_rad(*day);
        let at = |hour_angle: f64| {
            let time_h = 12.0 + hour_angle * HOURS_PER_RAD;
            sun_position(latitude_rad, declination_rad, time_h)
        };
        let grid_azimuth_rad = |sun: SunPosition| sun.azimuth_rad - grid_convergence_rad;
        for (from, to) in pieces(latitude_rad, declination_rad, grid_convergence_rad, azimuth_count)
        {
            let middle_rad = grid_azimuth_rad(at((from + to) / 2.0)).rem_euclid(TAU);
            let sector = ((middle_rad / width_rad) as usize).min(azimuth_count - 1);
            let sector_middle_rad = (sector as f64 + 0.5) * width_rad;
            let steps = ((to - from) * HOURS_PER_RAD / longest_step_h).ceil().max(1.0);
            let step = (to - from) / steps;
            let node = |index: usize| {
                let sun = at(from + step * index as f64);
                let off_middle_rad =
                    (grid_azimuth_rad(sun) - sector_middle_rad + PI).rem_euclid(TAU) - PI;
                let half_step_h = if index == 0 { 0.0 } else { step * HOURS_PER_RAD / 2.0 };
                SunNode {
                    tan_elevation: tan_f64(sun.elevation_rad).clamp(0.0, TAN_ZENITH) as f32,
                    sector_fraction: (off_middle_rad / width_rad + 0.5).clamp(0.0, 1.0) as f32,
                    half_step_h: half_step_h as f32,
                }
            };
            let nodes = (0..=steps as usize).map(node).collect(); // a day has a few hundred steps
            sectors[sector].push(SunArc { month_index, nodes });
        }
    }
    sectors
}

/// Hour angles between which the sun is up and within one sector.
fn pieces(
    latitude_rad: f64,
    declination_rad: f64,
    grid_convergence_rad: f64,
    azimuth_count: usize,
) -> Vec<(f64, f64)> {
    let (sin_lat, cos_lat) = (sin_f64(latitude_rad), cos_f64(latitude_rad));
    let (sin_dec, cos_dec) = (sin_f64(declination_rad), cos_f64(declination_rad));
    let cos_sunset = -tan_f64(latitude_rad) * tan_f64(declination_rad);
    let sunset = acos_f64(cos_sunset.clamp(-1.0, 1.0));
    let mut cuts = vec![-sunset, sunset];
    for index in 0..azimuth_count {
        let azimuth_rad = TAU * index as f64 / azimuth_count as f64 + grid_convergence_rad;
        let (sin_az, cos_az) = (sin_f64(azimuth_rad), cos_f64(azimuth_rad));
        // the sun is in the vertical plane of the azimuth where a·cos H + b·sin H = c
        let (a, b, c) = (sin_az * sin_lat * cos_dec, -cos_az * cos_dec, sin_az * cos_lat * sin_dec);
        let amplitude = (a * a + b * b).sqrt();
        if c.abs() >= amplitude {
            continue; // never, or only touched
        }
        let (middle, half) = (atan2_f64(b, a), acos_f64(c / amplitude));
        let crossings = [middle - half, middle + half].map(|h| (h + PI).rem_euclid(TAU) - PI);
        cuts.extend(crossings.into_iter().filter(|h| h.abs() < sunset));
    }
    cuts.sort_by(f64::total_cmp);
    cuts.windows(2).map(|w| (w[0], w[1])).filter(|(from, to)| to - from > SHORTEST_RAD).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::abiotics::solar::day_length_h;

    #[test]
    fn the_path_takes_the_whole_day_in_short_steps() {
        for latitude_deg in [-90.0, -66.6, -35.0, -10.0, 0.0, 21.3, 42.5, 66.6, 89.0] {
            for convergence_rad in [0.0, 0.05, -2.0] {
                let latitude_rad = f64::to_radians(latitude_deg);
                let sectors = sun_arcs_by_sector(latitude_rad, convergence_rad, 64, 0.25);
                let mut hours = [0.0; 12];
                for arc in sectors.iter().flatten() {
                    let steps = arc.nodes.iter().map(|node| 2.0 * f64::from(node.half_step_h));
                    hours[arc.month_index] += steps.clone().sum::<f64>();
                    assert!(steps.clone().all(|step_h| step_h < 0.25 + 1e-6));
                    assert!(arc.nodes.len() >= 2);
                }
                for (month_index, day) in REPRESENTATIVE_DAY.iter().enumerate() {
                    let expected_h = day_length_h(latitude_rad, declination_rad(*day));
                    let off_s = (hours[month_index] - expected_h).abs() * 3600.0;
                    assert!(off_s < 0.1, "{latitude_deg}°, month {month_index}: {off_s} s");
                }
            }
        }
    }

    #[test]
    fn nodes_lie_where_the_sun_stands() {
        // the noon sun of December at 42.5° N: due south, 24.4° high
        let sectors = sun_arcs_by_sector(42.5_f64.to_radians(), 0.0, 64, 0.25);
        let arc = sectors[32].iter().find(|arc| arc.month_index == 11);
        let noon = arc.map(|arc| arc.nodes[0]).expect("the sun passes south");
        let declination_rad = declination_rad(REPRESENTATIVE_DAY[11]);
        let expected = tan_f64(PI / 2.0 - 42.5_f64.to_radians() + declination_rad);
        assert!((f64::from(noon.tan_elevation) - expected).abs() < 1e-6);
        assert!(noon.sector_fraction < 1e-6);
        // within a sector the sun goes from one side to the other
        let arc = sectors[40].iter().find(|arc| arc.month_index == 5);
        let nodes = &arc.expect("the afternoon sun of June passes").nodes;
        assert!(nodes[0].sector_fraction < 1e-5);
        assert!(nodes[nodes.len() - 1].sector_fraction > 1.0 - 1e-5);
    }

    #[test]
    fn no_sun_from_the_north_in_winter() {
        let sectors = sun_arcs_by_sector(42.5_f64.to_radians(), 0.0, 64, 0.25);
        let north = sectors[0..16].iter().chain(&sectors[48..64]).flatten();
        assert!(north.clone().all(|arc| (3..9).contains(&arc.month_index)));
        assert!(north.count() > 0);
    }
}
