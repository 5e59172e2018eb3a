//! Shaded relief: how bright ground looks under a low lamp in the north-west.
//!
//! # Reference
//! Horn 1981, "Hill shading and the reflectance map", doi:10.1109/PROC.1981.11918 (Lambert's cosine law);
//! lamps from several sides: Mark 1992, "Multidirectional, oblique-weighted, shaded-relief image", USGS OFR 92-422.
//! # Departures
//! Three lamps with fixed weights instead of four weighted by aspect: ridges along the main light keep their form
//! and there is one shadow side, which the eye needs to tell hill from hollow.

use std::f32::consts::FRAC_PI_4;

use rayon::prelude::*;

use super::canvas::mix_light;
use crate::math::{cos, sin, tan};
use crate::raster::Grid;

/// Where light comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Angle from grid north, clockwise.
    pub azimuth_rad: f32,
    /// Angle above the horizontal plane.
    pub altitude_rad: f32,
}

impl Light {
    /// The cartographers' lamp: 315°, 45° high.
    pub const NORTH_WEST: Self = Self { azimuth_rad: 7.0 * FRAC_PI_4, altitude_rad: FRAC_PI_4 };

    /// Unit vector towards the light: east, north, up.
    fn direction(&self) -> [f32; 3] {
        let (sin_az, cos_az) = (sin(self.azimuth_rad), cos(self.azimuth_rad));
        let (sin_alt, cos_alt) = (sin(self.altitude_rad), cos(self.altitude_rad));
        [cos_alt * sin_az, cos_alt * cos_az, sin_alt]
    }
}

/// Colour of light on full lit slopes and in full shade, against flat ground's 1; warm light, cool shade.
const LIT: [f32; 3] = [1.0, 0.985, 0.93];
const SHADE: [f32; 3] = [0.27, 0.29, 0.38];

/// A surface colour under light of −1 (full shade) over 0 (flat ground) to 1 (full light), 0..=255 a channel.
pub fn lit(color: [f32; 3], light: f32, strength: f32) -> [f32; 3] {
    std::array::from_fn(|channel| {
        if light < 0.0 {
            // shade deepens slowly at first: most slopes keep their colour
            let depth = -light * strength;
            color[channel] * (1.0 + depth * (SHADE[channel] - 1.0))
        } else {
            mix_light(color[channel], 255.0 * LIT[channel], 0.38 * light * strength)
        }
    })
}

/// A hillshade of 0..=1 against flat ground's: −1 full shade, 0 flat, 1 full light.
pub fn against_flat(shade: f32) -> f32 {
    let flat = std::f32::consts::FRAC_1_SQRT_2;
    if shade < flat { shade / flat - 1.0 } else { (shade - flat) / (1.0 - flat) }
}

/// Cosine of the angle between ground and light, 0..=1: 0 where ground turns away, sin(altitude) on the flat.
/// Heights count `exaggeration` times. 0 where masked.
pub fn hillshade(elevation_m: &Grid<f32>, light: Light, exaggeration: f32) -> Grid<f32> {
    shade(elevation_m, &[(1.0, light)], exaggeration)
}

/// Like [`hillshade`] with lamps in the north-west (strong), west and north (weak): softer, nothing quite black.
pub fn soft_hillshade(elevation_m: &Grid<f32>, exaggeration: f32) -> Grid<f32> {
    let lamp = |eighths: f32| Light { azimuth_rad: eighths * FRAC_PI_4, ..Light::NORTH_WEST };
    // chosen: at 0.6 and twice 0.2 south-east slopes keep detail and still read as shade
    shade(elevation_m, &[(0.6, lamp(7.0)), (0.2, lamp(6.0)), (0.2, lamp(8.0))], exaggeration)
}

fn shade(elevation_m: &Grid<f32>, lamps: &[(f32, Light)], exaggeration: f32) -> Grid<f32> {
    let cols = elevation_m.frame().cols;
    let lamps: Vec<(f32, [f32; 3])> = lamps.iter().map(|(w, l)| (*w, l.direction())).collect();
    let mut shade = vec![0.0_f32; elevation_m.frame().len()];
    shade.par_chunks_mut(cols.max(1)).enumerate().for_each(|(row, out)| {
        for (col, out) in out.iter_mut().enumerate() {
            if !elevation_m.mask().is_valid(row * cols + col) {
                continue;
            }
            let [east, north] = gradient(elevation_m, row, col).map(|g| g * exaggeration);
            let length = (east * east + north * north + 1.0).sqrt();
            *out = lamps
                .iter()
                .map(|(weight, [le, ln, lu])| {
                    weight * ((lu - east * le - north * ln) / length).max(0.0)
                })
                .sum();
        }
    });
    elevation_m.with_values(shade)
}

/// Rise towards east and north, metres a metre; one-sided beside edges and voids, so that planes come out exact.
fn gradient(elevation_m: &Grid<f32>, row: usize, col: usize) -> [f32; 2] {
    let (frame, mask, z) = (elevation_m.frame(), elevation_m.mask(), elevation_m.values());
    let here = row * frame.cols + col;
    let rise = |ahead: Option<usize>, behind: Option<usize>| {
        let valid = |cell: Option<usize>| cell.filter(|&c| mask.is_valid(c));
        let (ahead, behind) = (valid(ahead), valid(behind));
        let steps = usize::from(ahead.is_some()) + usize::from(behind.is_some());
        let difference = z[ahead.unwrap_or(here)] - z[behind.unwrap_or(here)];
        difference / (steps.max(1) as f32 * frame.cell_m())
    };
    let east = rise((col + 1 < frame.cols).then_some(here + 1), (col > 0).then(|| here - 1));
    let north = rise(
        (row > 0).then(|| here - frame.cols),
        (row + 1 < frame.rows).then_some(here + frame.cols),
    );
    [east, north]
}

/// How much heights are to be exaggerated for shading, so that steep ground of any landscape shows its form:
/// the 90th percentile of slopes is brought to about 40°.
pub fn fitting_exaggeration(elevation_m: &Grid<f32>) -> f32 {
    let frame = elevation_m.frame();
    // every n-th cell will do: some 20,000 slopes
    let stride = (frame.len() / 20_000).max(1) | 1; // odd: does not run along columns
    let mut rises: Vec<f32> = (0..frame.len())
        .step_by(stride)
        .filter(|&cell| elevation_m.mask().is_valid(cell))
        .map(|cell| {
            let [east, north] = gradient(elevation_m, cell / frame.cols, cell % frame.cols);
            (east * east + north * north).sqrt()
        })
        .collect();
    if rises.is_empty() {
        return 1.0;
    }
    let at = rises.len() * 9 / 10;
    let steep = *rises.select_nth_unstable_by(at, f32::total_cmp).1;
    // chosen: beyond 8 noise of flat ground would look like hills
    (tan(40_f32.to_radians()) / steep.max(1e-6)).clamp(0.7, 8.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::{Cell, Mask};
    use std::sync::Arc;

    /// A plane rising `east` and `north` metres a metre.
    fn plane(east: f32, north: f32) -> Grid<f32> {
        Grid::from_fn(5, 6, 2.0, |c| 2.0 * (c.col as f32 * east - c.row as f32 * north))
    }

    #[test]
    fn planes_match_the_closed_form_to_their_edges() {
        let (p, q) = (0.3_f32, -0.7_f32);
        let l = Light::NORTH_WEST;
        let (e, n, u) = (
            cos(l.altitude_rad) * sin(l.azimuth_rad),
            cos(l.altitude_rad) * cos(l.azimuth_rad),
            sin(l.altitude_rad),
        );
        let expected = (u - p * e - q * n) / (1.0 + p * p + q * q).sqrt();
        let shade = hillshade(&plane(p, q), l, 1.0);
        assert!(shade.values().iter().all(|s| (s - expected).abs() < 1e-5), "{shade:?} {expected}");
    }

    #[test]
    fn flat_ground_shows_the_sine_of_the_lights_altitude() {
        for altitude_rad in [0.2, FRAC_PI_4, 1.3] {
            let light = Light { altitude_rad, ..Light::NORTH_WEST };
            let shade = hillshade(&plane(0.0, 0.0), light, 3.0);
            assert!(shade.values().iter().all(|s| (s - sin(altitude_rad)).abs() < 1e-6));
        }
    }

    #[test]
    fn slopes_facing_north_west_are_bright_and_those_facing_away_dark() {
        // rising to the south-east = facing north-west
        for shade in [
            hillshade(&plane(0.6, -0.6), Light::NORTH_WEST, 1.0),
            soft_hillshade(&plane(0.6, -0.6), 1.0),
        ] {
            assert!(shade.values()[0] > 0.85);
        }
        assert!(hillshade(&plane(-0.6, 0.6), Light::NORTH_WEST, 1.0).values()[0] < 0.2);
        assert_eq!(hillshade(&plane(-2.0, 2.0), Light::NORTH_WEST, 1.0).values()[0], 0.0);
    }

    #[test]
    fn voids_do_not_shade_their_shores() {
        let grid = plane(0.3, 0.2);
        let valid: Vec<bool> = (0..30).map(|i| i != 14).collect();
        let mut values = grid.values().to_vec();
        values[14] = -500.0;
        let holed = Grid::new(Arc::clone(grid.frame()), Arc::new(Mask::new(valid)), values);
        let whole = hillshade(&grid, Light::NORTH_WEST, 1.0);
        let shade = hillshade(&holed, Light::NORTH_WEST, 1.0);
        let beside = Cell { row: 2, col: 3 };
        assert!((whole[beside] - shade[beside]).abs() < 1e-5);
        assert_eq!(shade[Cell { row: 2, col: 2 }], 0.0);
    }

    #[test]
    fn gentle_land_is_exaggerated_and_steep_land_is_not() {
        assert!(
            (fitting_exaggeration(&plane(0.2, 0.0)) - tan(40_f32.to_radians()) / 0.2).abs() < 0.01
        );
        assert_eq!(fitting_exaggeration(&plane(9.0, 0.0)), 0.7);
        assert_eq!(fitting_exaggeration(&plane(0.0, 0.0)), 8.0);
    }
}
