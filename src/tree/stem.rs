//! Stems: how they taper, and the classes of thickness that models are made in.
//!
//! An instance stretches a model sideways by its crown's radius, and so its stem. Models are therefore made for classes of the
//! ratio of stem to crown, in steps of 1.3: the stem drawn at breast height is at most 14 % thicker or 12 % thinner than the true one.

use super::mesh::Material;
use super::sculptor::{Knot, Sculptor};
use crate::math;

/// Height at which stems are measured, m.
pub const BREAST_HEIGHT_M: f32 = 1.3;
/// Step of the classes. chosen: √1.3 = 1.14, within 15 % with few models.
pub const CLASS_STEP: f32 = 1.3;
/// Number of classes. chosen: from stems of 0.6 % of the crown's radius to 90 %, beyond the greatest redwoods and old snags.
pub const CLASSES: usize = 20;
/// Dbh over crown radius in the middle of the first class.
const FIRST_RATIO: f32 = 0.006;

/// Heights at which a model's stem has rings, as shares of the plant's.
const RINGS: [f32; 7] = [-0.02, 0.0, 0.02, 0.06, 0.3, 0.65, 0.9];
/// Which of them each level of detail has.
const RINGS_OF_LEVEL: [&[usize]; 3] = [&[0, 1, 2, 3, 4, 5, 6], &[0, 3, 5], &[0]];
/// Sides of a stem in each level of detail.
pub const STEM_SIDES: [usize; 3] = [7, 4, 3];
/// How stems taper: diameter falls with this power of the distance from the top. chosen: gives the form factor 0.45, as in `simulation::deadwood`.
const TAPER_EXPONENT: f32 = 0.61;
/// How much thicker stems are at the ground than their taper tells. chosen: the butts of grown trees.
const FLARE: f32 = 0.28;
/// Height to which the flare reaches, as a share of the plant's.
const FLARE_FRACTION: f32 = 0.06;

/// Dbh over crown radius in the middle of a class.
pub fn class_ratio(class: usize) -> f32 {
    FIRST_RATIO * math::powf(CLASS_STEP, class as f32)
}

/// The class of a ratio of stem to crown; the first or last where it lies beyond.
pub fn class_of(ratio: f32) -> usize {
    let steps = math::ln(ratio.max(1e-6) / FIRST_RATIO) / math::ln(CLASS_STEP);
    steps.round().clamp(0.0, (CLASSES - 1) as f32) as usize // within the classes
}

/// Thickness of a stem at one of its rings, as a share of that where classes are measured.
fn smooth_taper(fraction: f32) -> f32 {
    let below_top = (1.0 - fraction.max(0.0)).max(0.0);
    let flare = (1.0 - fraction.max(0.0) / FLARE_FRACTION).clamp(0.0, 1.0);
    math::powf(below_top, TAPER_EXPONENT) * (1.0 + FLARE * flare * flare)
}

/// Thickness of the finest model's stem at a height, as a share of that which its class tells; straight between rings.
///
/// Heights are shares of the plant's, 0..=1.
pub fn taper(fraction: f32) -> f32 {
    let f = fraction.clamp(0.0, 1.0);
    let above = RINGS.iter().position(|ring| *ring > f);
    let (low, high) = match above {
        Some(i) => (RINGS[i.max(1) - 1], RINGS[i]),
        None => (RINGS[RINGS.len() - 1], 1.0),
    };
    let t = (f - low) / (high - low);
    math::lerp(smooth_taper(low), smooth_taper(high), t)
}

/// Share of its height at which a plant's stem is measured: breast height, or the middle of those lower than twice that.
pub fn breast_fraction(height_m: f32) -> f32 {
    (BREAST_HEIGHT_M / height_m.max(0.01)).min(0.5)
}

/// A stem in metres: how it stands and how far up it goes.
#[derive(Clone, Copy, Debug)]
pub struct Stem {
    /// Height of the tree that it tapers towards.
    pub height_m: f32,
    /// Diameter that its taper is a share of.
    pub diameter_m: f32,
    /// Share of the height at which it ends.
    pub end_fraction: f32,
    /// Whether it ends as thick as its taper tells, and not in a point.
    pub is_broken: bool,
    /// Where its foot is, east and north, m.
    pub foot_m: [f32; 2],
    /// How far its axis strays from upright half-way up, east and north, m.
    pub bend_m: [f32; 2],
    /// How far it leans from its foot to its end, east and north, m.
    pub lean_m: [f32; 2],
}

impl Stem {
    /// Where its axis is at a share of the height.
    pub fn axis(&self, fraction: f32) -> [f32; 3] {
        let t = fraction.clamp(0.0, 1.0);
        let bow = 4.0 * t * (1.0 - t);
        let at = |k: usize| self.foot_m[k] + bow * self.bend_m[k] + t * self.lean_m[k];
        [at(0), at(1), fraction * self.height_m]
    }

    /// Its radius at a share of the height, m.
    pub fn radius_m(&self, fraction: f32) -> f32 {
        0.5 * self.diameter_m * taper(fraction)
    }

    /// The knots of a level of detail, up to where it ends.
    pub fn knots(&self, level: usize) -> Vec<Knot> {
        let rings = RINGS_OF_LEVEL[level].iter().map(|&ring| RINGS[ring]);
        let mut knots: Vec<Knot> = rings
            .filter(|fraction| *fraction < self.end_fraction - 0.02)
            .map(|fraction| Knot { at: self.axis(fraction), radius: self.radius_m(fraction) })
            .collect();
        let end = self.end_fraction;
        let radius = if self.is_broken { self.radius_m(end) } else { 0.0 };
        knots.push(Knot { at: self.axis(end), radius });
        if level == 2
            && let Some(foot) = knots.first_mut()
        {
            // a pyramid as thick as the stem a tenth of the way up
            foot.radius = self.radius_m(0.1) * 1.1;
        }
        knots
    }

    /// Adds the stem; a broken end stays open.
    pub fn build(&self, sculptor: &mut Sculptor, material: Material, level: usize) {
        sculptor.tube(material, &self.knots(level), STEM_SIDES[level], true);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_are_within_fifteen_percent() {
        for i in 0..1000 {
            let ratio = 0.0055 * math::powf(170.0, i as f32 / 1000.0);
            let drawn = class_ratio(class_of(ratio));
            assert!((drawn / ratio - 1.0).abs() < 0.15, "{ratio}: {drawn}");
        }
        assert_eq!((class_of(0.0), class_of(9.0)), (0, CLASSES - 1));
    }

    #[test]
    fn stems_narrow_upwards() {
        let thickness: Vec<f32> = (0..=100).map(|i| taper(i as f32 / 100.0)).collect();
        assert!(thickness.windows(2).all(|pair| pair[1] <= pair[0]), "{thickness:?}");
        assert!((taper(0.06) - 0.963).abs() < 1e-3 && taper(1.0) == 0.0);
    }
}
