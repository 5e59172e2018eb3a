//! Herbs: rosettes of fern fronds, and mats of leaves.

use std::f32::consts::TAU;

use super::mesh::{Material, Mesh};
use super::sculptor::{Clump, Dice, Lathe, Sculptor, level};
use crate::math;
use crate::species::Species;

const GOLDEN_RAD: f32 = 2.399_963;
/// Fronds of a rosette and pieces of a frond, by level of detail.
const FRONDS: [(usize, usize); 3] = [(13, 5), (7, 2), (3, 1)];
/// Leaves of a mat, by level of detail.
const LEAVES: [usize; 2] = [38, 11];

/// Height and radius in metres of the herb that a species' model is made for.
fn typical_m(species: &Species) -> (f32, f32) {
    let height_m = 0.6 * species.max_height_m;
    (height_m, species.crown_radius_m(height_m))
}

/// A model of a fern at a level of detail.
pub fn fern(species: &Species, dice: &mut Dice, detail: usize) -> Mesh {
    let (height_m, radius_m) = typical_m(species);
    let mut sculptor = Sculptor::default();
    let (fronds, pieces) = FRONDS[detail];
    let turn = dice.between(0.0, TAU);
    for i in 0..fronds {
        let angle = turn + TAU * (i as f32 + dice.between(-0.25, 0.25)) / fronds as f32;
        // every other frond is an inner one: steeper and shorter
        let is_inner = i % 2 == 1 && detail == 0;
        let reach =
            radius_m * if is_inner { dice.between(0.5, 0.7) } else { dice.between(0.9, 1.0) };
        let rise =
            height_m * if is_inner { dice.between(0.9, 1.0) } else { dice.between(0.6, 0.8) };
        frond(&mut sculptor, angle, reach, rise, 0.17 * radius_m, pieces);
    }
    sculptor.fit_foliage(radius_m, height_m);
    sculptor.into_mesh([radius_m, radius_m, height_m])
}

/// A frond: rises, arches and hangs; folded along its middle, flat below.
fn frond(
    sculptor: &mut Sculptor,
    angle: f32,
    reach_m: f32,
    rise_m: f32,
    half_width_m: f32,
    pieces: usize,
) {
    let out = level(angle);
    let aside = [-out[1], out[0], 0.0];
    let material = Material::Foliage;
    let mut before: Option<[[u32; 3]; 2]> = None;
    for knot in 0..=pieces {
        let s = 0.04 + 0.96 * knot as f32 / pieces as f32;
        // y = 2.43 s − 1.48 s² is highest, about 1, at 0.82
        let height = rise_m * (2.43 - 1.48 * s) * s;
        let slope = rise_m * (2.43 - 2.96 * s) / reach_m;
        let up = [-slope * out[0], -slope * out[1], 1.0];
        let length = (1.0 + slope * slope).sqrt();
        let wide = half_width_m * math::powf((1.0 - s).max(0.0), 0.55) * (s / 0.2).min(1.0);
        let wide = wide.max(0.06 * half_width_m);
        let place = |side: f32, lift: f32| {
            let lift = lift * half_width_m;
            std::array::from_fn(|k| {
                s * reach_m * out[k]
                    + side * wide * aside[k]
                    + if k == 2 { height } else { 0.0 }
                    + lift * up[k] / length
            })
        };
        let tilt = |side: f32, sign: f32| std::array::from_fn(|k| sign * up[k] + side * aside[k]);
        let top = [
            sculptor.vertex(material, place(-1.0, 0.0), tilt(-0.5, 1.0)),
            sculptor.vertex(material, place(0.0, 0.3), tilt(0.0, 1.0)),
            sculptor.vertex(material, place(1.0, 0.0), tilt(0.5, 1.0)),
        ];
        let under = [
            sculptor.vertex(material, place(-1.0, 0.0), tilt(0.0, -1.0)),
            0,
            sculptor.vertex(material, place(1.0, 0.0), tilt(0.0, -1.0)),
        ];
        if let Some([last_top, last_under]) = before {
            // seen from above with the tip ahead, side −1 is on the right
            for side in 0..2 {
                let [a, b] = [last_top[side], last_top[side + 1]];
                let [c, d] = [top[side + 1], top[side]];
                sculptor.triangle(material, [a, d, c]);
                sculptor.triangle(material, [a, c, b]);
            }
            let [a, b] = [last_under[0], last_under[2]];
            let [c, d] = [under[2], under[0]];
            sculptor.triangle(material, [a, c, d]);
            sculptor.triangle(material, [a, b, c]);
        }
        before = Some([top, under]);
    }
}

/// A model of a mat of leaves at a level of detail.
pub fn mat(species: &Species, dice: &mut Dice, detail: usize) -> Mesh {
    let (height_m, radius_m) = typical_m(species);
    let mut sculptor = Sculptor::default();
    if detail == 2 {
        let rings = [(0.35 * height_m, radius_m), (0.8 * height_m, 0.7 * radius_m)];
        let lathe = Lathe {
            axis: [0.0; 2],
            low_m: 0.0,
            high_m: height_m,
            rings: &rings,
            sides: 5,
            unevenness: 0.0,
        };
        sculptor.lathe(&lathe, dice);
    } else {
        let count = LEAVES[detail];
        let leaf_m = radius_m * [0.17, 0.3][detail];
        for i in 0..count {
            let away = ((i as f32 + 0.5) / count as f32).sqrt();
            let out = level(GOLDEN_RAD * i as f32 + dice.between(-0.3, 0.3));
            let reach = (radius_m - leaf_m) * away;
            let high = height_m * (0.9 - 0.45 * away * away) * dice.between(0.75, 1.0);
            let clump = Clump {
                middle: [reach * out[0], reach * out[1], high],
                radii: [leaf_m, leaf_m, 0.14 * height_m],
                frequency: 1,
                unevenness: 0.15,
                heart: [0.0, 0.0, -radius_m],
            };
            sculptor.clump(&clump, dice);
        }
    }
    sculptor.fit_foliage(radius_m, height_m);
    sculptor.into_mesh([radius_m, radius_m, height_m])
}
