//! Herbs: rosettes of fern fronds, and mats of leaves.

use std::f32::consts::TAU;

use super::mesh::{Material, Mesh};
use super::sculptor::{Clump, Dice, GOLDEN_RAD, Lathe, Sculptor, level};
use crate::math;
use crate::species::Species;

/// Fronds of a rosette and pairs of leaflets on a frond, by level of detail.
const FRONDS: [(usize, usize); 3] = [(14, 7), (8, 3), (6, 1)];
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
    let (fronds, pairs) = FRONDS[detail];
    let turn = dice.between(0.0, TAU);
    for i in 0..fronds {
        let angle = turn + TAU * (i as f32 + dice.between(-0.25, 0.25)) / fronds as f32;
        // every other frond is an inner one: steeper and shorter
        let is_inner = i % 2 == 1 && detail == 0;
        let (reaches, rises) =
            if is_inner { ([0.5, 0.7], [0.85, 1.0]) } else { ([0.9, 1.0], [0.45, 0.75]) };
        let reach = radius_m * dice.between(reaches[0], reaches[1]);
        let rise = height_m * dice.between(rises[0], rises[1]);
        frond(&mut sculptor, angle, reach, rise, [0.24, 0.3, 0.5][detail] * radius_m, pairs);
    }
    sculptor.fit_foliage(radius_m, height_m);
    sculptor.into_mesh([radius_m, radius_m, height_m])
}

/// A frond: rises, arches and hangs, with leaflets to both sides.
fn frond(
    sculptor: &mut Sculptor,
    angle: f32,
    reach_m: f32,
    rise_m: f32,
    half_width_m: f32,
    pairs: usize,
) {
    let out = level(angle);
    let aside = [-out[1], out[0], 0.0];
    let material = Material::Foliage;
    let at = |s: f32, side_m: f32| {
        // y = 2.43 s − 1.48 s² is highest, about 1, at 0.82
        let height = rise_m * (2.43 - 1.48 * s) * s - 0.35 * side_m.abs();
        std::array::from_fn(|k| {
            s * reach_m * out[k] + side_m * aside[k] + if k == 2 { height } else { 0.0 }
        })
    };
    for pair in 0..pairs {
        let place = |step: f32| 0.03 + 0.97 * (pair as f32 + step) / pairs as f32;
        let (from, to) = (place(0.0), place(1.0));
        let middle = 0.5 * (from + to);
        // leaflets are longest at a third, and short at the foot
        let long = half_width_m * math::powf(1.0 - 0.93 * middle, 0.7) * (middle / 0.18).min(1.0);
        let slope = rise_m * (2.43 - 2.96 * middle) / reach_m;
        for side in [-1.0, 1.0] {
            let tip = at(to.min(1.0), side * long);
            let up = [-slope * out[0], -slope * out[1], 1.0];
            let tilt = |sign: f32| std::array::from_fn(|k| sign * up[k] + 0.4 * side * aside[k]);
            let corners = if side > 0.0 {
                [at(from, 0.0), at(to, 0.0), tip]
            } else {
                [at(from, 0.0), tip, at(to, 0.0)]
            };
            let top = corners.map(|p| sculptor.vertex(material, p, tilt(1.0)));
            sculptor.triangle(material, top);
            let under = corners.map(|p| sculptor.vertex(material, p, tilt(-1.0)));
            sculptor.triangle(material, [under[0], under[2], under[1]]);
        }
    }
}

/// A model of a mat of leaves at a level of detail.
pub fn mat(species: &Species, dice: &mut Dice, detail: usize) -> Mesh {
    let (height_m, radius_m) = typical_m(species);
    let mut sculptor = Sculptor::default();
    if detail == 2 {
        let rings = [(0.25 * height_m, radius_m), (0.75 * height_m, 0.88 * radius_m)];
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
