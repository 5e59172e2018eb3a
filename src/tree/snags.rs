//! Snags: stems with twigs, with branches, bare, broken; and stumps.
//!
//! # Reference
//! Decay classes after Peytavie et al. 2024, Table 2, doi:10.1145/3641816: class 1 has twigs and bark, 2 and 3 lose branches and
//! bark, 4 is a broken bare stem, 5 a stump.

use std::f32::consts::TAU;

use super::crowns::Build;
use super::habit::{CrownStyle, Habit};
use super::mesh::{Material, Mesh};
use super::outline::half_width;
use super::sculptor::{Dice, GOLDEN_RAD, Knot, Sculptor, along, level, unit};
use super::stem::{STEM_SIDES, Stem};
use crate::math;
use crate::species::Species;

/// Primary branches of a whole snag of decay class 1–3, by level of detail.
const BRANCHES: [[usize; 3]; 3] = [[22, 15, 7], [9, 7, 4], [3, 2, 1]];
/// Twigs of a branch of class 1.
const TWIGS: usize = 3;
/// Reach of the longest branch that is left, in crown radii, by decay class.
pub const REACH: [f32; 3] = [1.0, 0.8, 0.5];
/// Share of the stem from the ground that still has bark, by decay class.
const BARK_FRACTION: [f32; 5] = [1.0, 0.8, 0.35, 0.0, 0.0];

/// What a snag's model shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SnagShape {
    /// Decay class, 1–5.
    pub decay_class: u8,
    /// Share of its height at death that stands; 1 if it is whole.
    pub standing_fraction: f32,
}

impl SnagShape {
    fn class(&self) -> usize {
        usize::from(self.decay_class.clamp(1, 5)) - 1
    }

    fn is_broken(&self) -> bool {
        self.standing_fraction < 0.98
    }
}

/// A model of a snag that has branches (class 1–3) at a level of detail. `build` tells its sizes when it was whole.
pub fn branched(
    species: &Species,
    build: &Build,
    shape: SnagShape,
    dice: &mut Dice,
    detail: usize,
) -> Mesh {
    let mut sculptor = Sculptor::default();
    let stem = stand(&mut sculptor, build, shape, dice, detail);
    let class = shape.class();
    let count = BRANCHES[detail][class];
    let style = Habit::of(species).crown;
    let material = if class < 2 { Material::Bark } else { Material::Wood };
    let turn = dice.between(0.0, TAU);
    let top_m = shape.standing_fraction * build.height_m;
    // where branches leave the stem, as shares of the height at death, and how far each reaches
    let base = if shape.is_broken() {
        build.base_fraction.min(0.6 * shape.standing_fraction)
    } else {
        build.base_fraction
    };
    let mut branches: Vec<(f32, f32)> = (0..count)
        .map(|i| {
            let t = (i as f32 + dice.between(0.2, 0.8)) / count as f32;
            let fraction = math::lerp(base, 0.92 * shape.standing_fraction, t);
            let t_crown = (fraction - build.base_fraction) / (1.0 - build.base_fraction);
            let wide = half_width(species.crown.shape, 0.05 + 0.9 * t_crown).max(0.15);
            (fraction, wide * dice.between(0.5, 1.0))
        })
        .collect();
    let longest = branches.iter().map(|branch| branch.1).fold(1e-3, f32::max);
    for (_, reach) in &mut branches {
        *reach *= build.radius_m / longest;
    }
    for (i, (fraction, reach)) in branches.into_iter().enumerate() {
        let rise = match style {
            CrownStyle::Tiers { droop, .. } => reach * (0.05 - 0.8 * droop),
            CrownStyle::Clumps { .. } => reach * dice.between(0.35, 0.85),
        };
        let room = 0.97 * top_m - fraction * build.height_m;
        let from = stem.axis(fraction);
        let mut to = along(from, reach, level(turn + GOLDEN_RAD * i as f32));
        to[2] += rise.min(room);
        let radius = (0.3 * stem.radius_m(fraction)).max(0.012 * reach).min(0.04 * top_m);
        branch(&mut sculptor, material, [from, to], radius, detail);
        if class == 0 && detail == 0 {
            for twig in 0..TWIGS {
                twig_on(&mut sculptor, [from, to], (twig as f32 + 1.5) / 4.5, radius, top_m, dice);
            }
        }
    }
    sculptor.into_mesh([build.radius_m, build.radius_m, top_m])
}

/// A model of a snag without branches, or of a stump, at a level of detail: its stem has radius 1 at its foot.
pub fn bare(build: &Build, shape: SnagShape, dice: &mut Dice, detail: usize) -> Mesh {
    let mut sculptor = Sculptor::default();
    let stem = stand(&mut sculptor, build, shape, dice, detail);
    let foot_m = stem.radius_m(0.0);
    sculptor.into_mesh([foot_m, foot_m, shape.standing_fraction * build.height_m])
}

/// Adds the stem with its break.
fn stand(
    sculptor: &mut Sculptor,
    build: &Build,
    shape: SnagShape,
    dice: &mut Dice,
    detail: usize,
) -> Stem {
    let class = shape.class();
    let top_m = shape.standing_fraction * build.height_m;
    let crook = build.height_m * dice.between(0.0, 0.003);
    let mut stem = Stem {
        height_m: build.height_m,
        diameter_m: build.dbh_m,
        end_fraction: shape.standing_fraction,
        is_broken: shape.is_broken(),
        foot_m: [0.0; 2],
        bend_m: [crook, 0.5 * crook],
        lean_m: [0.0; 2],
    };
    let sides = STEM_SIDES[detail];
    // the highest tooth of the break is the top
    let teeth: Vec<f32> = (0..sides).map(|_| dice.roll()).collect();
    let highest = teeth.iter().copied().fold(0.0, f32::max);
    if stem.is_broken {
        let end_radius_m = stem.radius_m(shape.standing_fraction);
        let tooth_m = (2.2 * end_radius_m).min(0.35 * top_m);
        stem.end_fraction = shape.standing_fraction - tooth_m * highest / build.height_m;
        let knots = stem.knots(detail);
        let Some(end) = knots.last().copied() else { return stem };
        bark_and_wood(sculptor, &knots, class, shape.standing_fraction * build.height_m, sides);
        let tooth = |side: usize| tooth_m * teeth[side % sides];
        splinters(sculptor, end, sides, &tooth, 0.4 * tooth_m);
    } else {
        stem.end_fraction = 1.0;
        let knots = stem.knots(detail);
        bark_and_wood(sculptor, &knots, class, build.height_m, sides);
    }
    stem
}

/// Adds a stem whose lower part has bark and whose upper part is bare.
fn bark_and_wood(sculptor: &mut Sculptor, knots: &[Knot], class: usize, top_m: f32, sides: usize) {
    let bark_m = BARK_FRACTION[class] * top_m;
    let has_bark = |knot: &&Knot| bark_m > 0.0 && knot.at[2] <= bark_m;
    let split = knots.iter().filter(has_bark).count();
    if split >= 2 {
        sculptor.tube(Material::Bark, &knots[..split], sides, true);
    }
    let rest = &knots[if split >= 2 { split - 1 } else { 0 }..];
    if rest.len() >= 2 {
        sculptor.tube(Material::Wood, rest, sides, true);
    }
}

/// Closes a broken stem with a ring of teeth.
fn splinters(
    sculptor: &mut Sculptor,
    end: Knot,
    sides: usize,
    tooth: &dyn Fn(usize) -> f32,
    dent: f32,
) {
    let corner = end.radius * super::sculptor::corner_radius(sides);
    let out = |side: usize| level(TAU * side as f32 / sides as f32);
    let up = |place: [f32; 3], lift: f32| along(place, lift, [0.0, 0.0, 1.0]);
    let material = Material::Wood;
    let mut ring = |lifted: bool, inward: bool| -> Vec<u32> {
        (0..sides)
            .map(|side| {
                let place = along(end.at, corner, out(side));
                let place = if lifted { up(place, tooth(side)) } else { place };
                let normal =
                    if inward { along([0.0, 0.0, 0.8], -0.6, out(side)) } else { out(side) };
                sculptor.vertex(material, place, normal)
            })
            .collect()
    };
    let (low, high, inner) = (ring(false, false), ring(true, false), ring(true, true));
    let middle = sculptor.vertex(material, up(end.at, -dent), [0.0, 0.0, 1.0]);
    for side in 0..sides {
        let next = (side + 1) % sides;
        // where a tooth has no height there is no side to see
        if tooth(next) > 1e-4 {
            sculptor.triangle(material, [low[side], low[next], high[next]]);
        }
        if tooth(side) > 1e-4 {
            sculptor.triangle(material, [low[side], high[next], high[side]]);
        }
    }
    sculptor.band(material, &inner, &[middle]);
}

fn branch(
    sculptor: &mut Sculptor,
    material: Material,
    [from, to]: [[f32; 3]; 2],
    radius: f32,
    detail: usize,
) {
    let mut knots = vec![Knot { at: from, radius }];
    if detail == 0 {
        let mut middle = along(from.map(|v| 0.5 * v), 0.5, to);
        middle[2] += 0.06 * (to[2] - from[2]).abs();
        knots.push(Knot { at: middle, radius: 0.55 * radius });
    }
    knots.push(Knot { at: to, radius: 0.0 });
    sculptor.tube(material, &knots, 3, false);
}

fn twig_on(
    sculptor: &mut Sculptor,
    [from, to]: [[f32; 3]; 2],
    at: f32,
    radius: f32,
    top_m: f32,
    dice: &mut Dice,
) {
    let ahead = std::array::from_fn(|k| to[k] - from[k]);
    let start = along(from, at, ahead);
    let length = (ahead[0] * ahead[0] + ahead[1] * ahead[1]).sqrt();
    let side = if dice.roll() < 0.5 { 1.0 } else { -1.0 };
    let direction = unit([
        0.6 * ahead[0] - side * ahead[1],
        0.6 * ahead[1] + side * ahead[0],
        length * dice.between(-0.1, 0.6),
    ]);
    let reach = length * dice.between(0.2, 0.35) * (1.2 - at);
    let mut end = along(start, reach, direction);
    end[2] = end[2].min(0.99 * top_m);
    let knots = [Knot { at: start, radius: 0.4 * radius }, Knot { at: end, radius: 0.0 }];
    sculptor.tube(Material::Bark, &knots, 3, false);
}
