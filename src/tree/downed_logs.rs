//! Downed logs: tapered stems with bark and stubs, rotten ones sunk flat, and the root plates of uprooted trees.
//!
//! # Reference
//! Decay classes after Peytavie et al. 2024, Table 2, doi:10.1145/3641816: classes 1–3 are round, with bark and stubs that go one after
//! the other; 4 and 5 are flat ovals that sink into the ground.

use std::f32::consts::TAU;

use super::mesh::{Material, Mesh};
use super::sculptor::{Dice, Knot, Sculptor, along};
use crate::math;
use crate::plants::deadwood::DownedLogKind;

/// Length over diameter that models are made for: details along the stem are stretched by what differs. chosen: stems of grown trees.
const SLENDERNESS: f32 = 30.0;
/// Rings and sides of a stem by level of detail.
const RINGS: [usize; 3] = [7, 3, 2];
const SIDES: [usize; 3] = [8, 6, 4];
/// Height over width of the cross section by decay class. chosen: round until the wood gives way.
pub const FLATNESS: [f32; 5] = [1.0, 1.0, 0.95, 0.8, 0.55];
/// Height of a log's axis above the ground, in diameters, by decay class. chosen: fresh ones just touch the ground, class 3 lies in the
/// litter, class 5 shows its upper half as a low ridge.
pub const AXIS_ABOVE_GROUND: [f32; 5] = [0.48, 0.46, 0.38, 0.2, 0.04];
/// Stubs of branches by decay class.
const STUBS: [usize; 5] = [14, 9, 4, 0, 0];
/// Share of the length that bark covers by decay class.
const BARK_FRACTION: [f32; 5] = [1.0, 0.8, 0.4, 0.0, 0.0];
/// Reach of a root plate in diameters of the stem: to the sides and up, and down into the ground. chosen: as in close-ups.
const PLATE: [f32; 2] = [1.7, 0.8];

/// What a downed log's model shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DownedLogShape {
    /// What part of the tree it is.
    pub kind: DownedLogKind,
    /// Decay class, 1–5.
    pub decay_class: u8,
    /// Diameter of its thin end over that of the thick one.
    pub tip_fraction: f32,
}

/// A model of a downed log at a level of detail.
pub fn downed_log(shape: DownedLogShape, dice: &mut Dice, detail: usize) -> Mesh {
    let class = usize::from(shape.decay_class.clamp(1, 5)) - 1;
    let mut sculptor = Sculptor::default();
    let (rings, sides) = (RINGS[detail], SIDES[detail]);
    let bend = if detail == 0 { dice.between(-0.3, 0.3) } else { 0.0 };
    let is_rotten = class >= 3;
    let knots: Vec<Knot> = (0..rings)
        .map(|ring| {
            let t = ring as f32 / (rings - 1) as f32;
            let is_end = ring == 0 || ring + 1 == rings;
            let radius = 0.5 * math::lerp(1.0, shape.tip_fraction, t);
            let rot = if is_rotten && !is_end { dice.between(0.82, 1.04) } else { 1.0 };
            let aside = 4.0 * t * (1.0 - t) * bend;
            Knot { at: [t * SLENDERNESS, aside, 0.0], radius: radius * rot }
        })
        .collect();
    let barked = BARK_FRACTION[class] * SLENDERNESS;
    let split = knots.iter().filter(|knot| knot.at[0] <= barked + 1e-3).count();
    let [bark, bare] =
        if split >= 2 { [&knots[..split], &knots[split - 1..]] } else { [&[][..], &knots[..]] };
    sculptor.tube(Material::Bark, bark, sides, false);
    if bare.len() >= 2 {
        sculptor.tube(Material::Wood, bare, sides, false);
    }
    ends(&mut sculptor, &knots, sides, class, shape.kind == DownedLogKind::Uprooted);
    for stub in 0..[STUBS[class], STUBS[class] / 3, 0][detail] {
        let t = (stub as f32 + dice.roll()) / STUBS[class] as f32;
        // stems branch towards their thin end
        let t = if shape.kind == DownedLogKind::Branch { 0.1 + 0.85 * t } else { 0.35 + 0.62 * t };
        let radius = 0.5 * math::lerp(1.0, shape.tip_fraction, t);
        let angle = dice.between(0.0, TAU);
        let length = [2.6, 1.5, 0.6][class.min(2)] * radius * dice.between(0.6, 1.4);
        let out = [0.45, math::cos(angle), math::sin(angle)];
        let from = [t * SLENDERNESS, 4.0 * t * (1.0 - t) * bend, 0.0];
        let knots = [
            Knot { at: from, radius: 0.22 * radius },
            Knot { at: along(from, radius + length, out), radius: 0.0 },
        ];
        let material = if class == 0 { Material::Bark } else { Material::Wood };
        sculptor.tube(material, &knots, 3, false);
    }
    sculptor.flatten(FLATNESS[class]);
    if shape.kind == DownedLogKind::Uprooted {
        root_plate(&mut sculptor, class, dice, detail);
    }
    sculptor.into_mesh([SLENDERNESS, 1.0, 1.0])
}

/// Closes both ends: broken wood.
fn ends(sculptor: &mut Sculptor, knots: &[Knot], sides: usize, class: usize, thin_alone: bool) {
    let [Some(first), Some(last)] = [knots.first(), knots.last()] else { return };
    let dent = if class >= 3 { 0.8 } else { 0.05 };
    let back = [-1.0, 0.0, 0.0];
    if !thin_alone {
        sculptor.cap(Material::Wood, *first, back, sides, dent);
    }
    sculptor.cap(Material::Wood, *last, [1.0, 0.0, 0.0], sides, dent * last.radius);
}

/// A disc of soil that stands upright behind the thick end, with roots around its rim.
fn root_plate(sculptor: &mut Sculptor, class: usize, dice: &mut Dice, detail: usize) {
    let corners = [11, 7, 5][detail];
    // soil is washed off over the years
    let worn = [1.0, 0.95, 0.85, 0.7, 0.55][class];
    let thick = 0.5 * worn;
    let reach = |angle: f32, dice: &mut Dice| {
        let is_up = math::sin(angle) > 0.0;
        let up = if is_up { PLATE[0] } else { PLATE[1] };
        let (c, s) = (math::cos(angle), math::sin(angle));
        let far = 1.0 / ((c / PLATE[0]).powi(2) + (s / up).powi(2)).sqrt();
        worn * far * dice.between(0.82, 1.0)
    };
    let rim: Vec<[f32; 3]> = (0..corners)
        .map(|i| {
            let angle = TAU * i as f32 / corners as f32;
            let far = reach(angle, dice);
            [-0.4 * thick, far * math::cos(angle), far * math::sin(angle)]
        })
        .collect();
    let soil = Material::Soil;
    let mut disc = |x: f32, ahead: f32| {
        let ring: Vec<u32> = rim
            .iter()
            .map(|p| sculptor.vertex(soil, *p, [ahead, 0.6 * p[1], 0.6 * p[2]]))
            .collect();
        let middle = sculptor.vertex(soil, [x, 0.0, 0.0], [ahead, 0.0, 0.0]);
        // y to z turns around +x: counter-clockwise seen from the thin end
        if ahead > 0.0 {
            sculptor.band(soil, &ring, &[middle]);
        } else {
            sculptor.band(soil, &[middle], &ring);
        }
    };
    disc(thick, 1.0);
    disc(-thick, -1.0);
    if detail == 2 {
        return;
    }
    let roots = [12, 5][detail];
    for root in 0..roots {
        let angle = TAU * (root as f32 + dice.between(-0.3, 0.3)) / roots as f32;
        let far = reach(angle, dice);
        let end = far * dice.between(1.05, 1.3);
        let (c, s) = (math::cos(angle), math::sin(angle));
        let from = [0.0, 0.5 * far * c, 0.5 * far * s];
        let to = [-dice.between(0.1, 0.9) * thick, end * c, end * s];
        let knots = [Knot { at: from, radius: 0.13 }, Knot { at: to, radius: 0.0 }];
        sculptor.tube(Material::Bark, &knots, 3, false);
    }
}
