//! From light to a picture: exposure, a film's curve, and pixels out of finer ones.

use rayon::prelude::*;

use super::noise;
use super::vector::{LUMINANCE, Vec3};
use crate::math;

/// Powers of light below and above grey before the curve. chosen: leaves of a forest are much alike; a little more contrast tells them apart.
const SHADE_CONTRAST: f32 = 1.22;
const SUN_CONTRAST: f32 = 1.06;
/// Power of the brightness of what is brighter than grey in the forest. chosen: sun flecks are twenty times as bright as the shade
/// around them, and eyes see the colours of both.
pub const FLECK_POWER: f32 = 0.45;
/// A grey card's light, which contrast leaves as it is.
const GREY: f32 = 0.18;
/// Steps of the curve's table. chosen: finer than 8 bits anywhere.
const STEPS: usize = 4096;
/// Light at which the table ends, above white.
const TABLE_END: f32 = 16.0;

/// The exposure that brings linear light of those samples that are not sky to `mean_light`, on a logarithmic mean.
pub fn exposure(light: &[Vec3], mean_light: f32, is_sky: impl Fn(usize) -> bool + Sync) -> f32 {
    let (mut sum, mut count) = (0.0_f64, 0.0_f64);
    // one in some is enough for a mean, and always the same ones
    for i in (0..light.len()).step_by(7) {
        if !is_sky(i) {
            sum += f64::from(math::ln(light[i].dot(LUMINANCE).max(1e-4)));
            count += 1.0;
        }
    }
    if count == 0.0 {
        return 1.0;
    }
    let mean = math::exp((sum / count) as f32); // a mean of f32 values
    (mean_light / mean).clamp(0.5, 8.0)
}

/// A film's curve: shadows lifted off black, lights rolled off into white.
///
/// # Reference
/// Narkowicz 2015, "ACES filmic tone mapping curve", fitted to the ACES reference transform.
pub fn film(light: f32) -> f32 {
    let x = light.max(0.0);
    ((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)).clamp(0.0, 1.0)
}

/// Light with more contrast in the shade, and a little more in the sun, where leaves would be bleached.
fn contrasted(light: f32) -> f32 {
    let power = if light < GREY { SHADE_CONTRAST } else { SUN_CONTRAST };
    GREY * math::powf(light / GREY, power)
}

/// Film and sRGB coding by light, looked up.
pub struct Curve {
    table: Vec<f32>,
}

impl Default for Curve {
    fn default() -> Self {
        let table = (0..=STEPS).map(|i| {
            // squares: most steps where it is dark
            let share = i as f32 / STEPS as f32;
            let light = share * share * TABLE_END;
            let v = film(contrasted(light));
            if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * math::powf(v, 1.0 / 2.4) - 0.055 }
        });
        Self { table: table.collect() }
    }
}

impl Curve {
    /// The code 0..=1 of linear light.
    #[inline]
    pub fn code(&self, light: f32) -> f32 {
        let place = (light.clamp(0.0, TABLE_END) / TABLE_END).sqrt() * STEPS as f32;
        let below = (place as usize).min(STEPS - 1); // within the table
        let t = place - below as f32;
        self.table[below] + (self.table[below + 1] - self.table[below]) * t
    }
}

/// Share of a bright colour that stays as it is when it is held back. chosen: with all of it meadows in the sun glow like lamps, with none
/// they are bleached.
const KEPT_HUE: f32 = 0.55;

/// Light whose brightness over grey is raised to a power.
fn held_back(light: Vec3, power: f32) -> Vec3 {
    let brightness = light.dot(LUMINANCE);
    if power == 1.0 || brightness <= GREY {
        return light;
    }
    let target = GREY * math::powf(brightness / GREY, power);
    let kept = light * (target / brightness);
    // each channel by itself, as films do: bright colours pale
    let pale = light.map(|v| GREY * math::powf((v / GREY).max(0.0), power));
    pale.lerp(kept, KEPT_HUE)
}

/// A picture of `width` × `height` from light `finer` times finer each way; brightness over grey is raised to `power`.
pub fn develop(
    light: &[Vec3],
    [width, height]: [usize; 2],
    finer: usize,
    exposure: f32,
    power: f32,
) -> Vec<u8> {
    let curve = Curve::default();
    let mut bytes = vec![0; width * height * 3];
    let across = width * finer;
    // a tent over the neighbours' nearest samples too: edges without steps
    let reach = if finer > 1 { finer / 2 } else { 0 };
    bytes.par_chunks_exact_mut(width * 3).enumerate().for_each(|(row, line)| {
        let rows = span(row, finer, reach, height * finer);
        for (col, pixel) in line.chunks_exact_mut(3).enumerate() {
            let cols = span(col, finer, reach, across);
            let (mut sum, mut weights) = (Vec3::default(), 0.0);
            for y in rows.clone() {
                for x in cols.clone() {
                    let weight = tent(y, row, finer) * tent(x, col, finer);
                    // coded before averaging: a bright sample must not outshine its neighbours
                    let exposed = held_back(light[y * across + x] * exposure, power);
                    sum += exposed.map(|v| curve.code(v)) * weight;
                    weights += weight;
                }
            }
            let mean = sum / weights;
            // half a step of noise, or an even sky would show the steps of 8 bits
            let noise = noise::unit(noise::hash2(row as u32, col as u32)); // below 2³²
            for (byte, value) in pixel.iter_mut().zip([mean.x, mean.y, mean.z]) {
                *byte = (value * 255.0 + noise).clamp(0.0, 255.0) as u8; // clamped
            }
        }
    });
    bytes
}

fn span(pixel: usize, finer: usize, reach: usize, end: usize) -> std::ops::Range<usize> {
    (pixel * finer).saturating_sub(reach)..((pixel + 1) * finer + reach).min(end)
}

fn tent(sample: usize, pixel: usize, finer: usize) -> f32 {
    let middle = (pixel as f32 + 0.5) * finer as f32;
    let distance = (sample as f32 + 0.5 - middle).abs() / finer as f32;
    (1.0 - distance).max(0.05)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_rises_from_black_to_white() {
        let curve = Curve::default();
        let codes: Vec<f32> = (0..160).map(|i| curve.code(i as f32 * 0.1)).collect();
        assert!(codes.windows(2).all(|pair| pair[1] >= pair[0]));
        assert!(codes[0] == 0.0 && codes[159] > 0.995, "{codes:?}");
        for light in [0.003_f32, 0.05, 0.4, 2.5] {
            let v = film(contrasted(light));
            let exact =
                if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * math::powf(v, 1.0 / 2.4) - 0.055 };
            assert!((curve.code(light) - exact).abs() < 1e-3);
        }
    }

    #[test]
    fn even_light_stays_even_and_exposure_finds_the_mean() {
        let light = vec![Vec3::splat(0.3); 16 * 8];
        let bytes = develop(&light, [8, 4], 2, 1.0, FLECK_POWER);
        assert!(bytes.iter().all(|byte| byte.abs_diff(bytes[0]) <= 1));
        let [below, above] = [0.1, 0.72].map(|v| held_back(Vec3::new(v, v, v), 0.5));
        assert!(below.x == 0.1 && (above.x - 0.36).abs() < 1e-4, "{below} {above}");
        let dark = vec![Vec3::splat(0.1); 70];
        assert!((exposure(&dark, 0.15, |_| false) - 1.5).abs() < 1e-3);
        assert_eq!(exposure(&dark, 0.15, |_| true), 1.0);
    }
}
