//! Outlines of crowns: how wide each shape is at each height.

use crate::species::CrownShape;

/// Half the width of a crown in radii, at a height of 0 (its base) to 1 (its top).
pub fn half_width(shape: CrownShape, along: f32) -> f32 {
    let t = along.clamp(0.0, 1.0);
    match shape {
        CrownShape::Cone => (1.0 - t) * (0.7 + 0.3 * (t / 0.06).min(1.0)),
        CrownShape::Ellipsoid => (1.0 - (2.0 * t - 1.0).powi(2)).sqrt(),
        CrownShape::Hemisphere => (1.0 - t * t).sqrt(),
        CrownShape::Cylinder => (1.0 - (2.0 * t - 1.0).powi(8)).sqrt(),
        CrownShape::InvertedCone => {
            const SHOULDER: f32 = 0.78;
            if t <= SHOULDER {
                0.12 + 0.88 * t / SHOULDER
            } else {
                (1.0 - ((t - SHOULDER) / (1.0 - SHOULDER)).powi(2)).sqrt()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crowns_have_the_widths_of_their_shapes() {
        use CrownShape::{Cone, Cylinder, Ellipsoid, Hemisphere, InvertedCone};
        let at = |shape, along| half_width(shape, along);
        assert_eq!((at(Cone, 0.5), at(Cone, 1.0)), (0.5, 0.0));
        assert_eq!((at(Ellipsoid, 0.5), at(Ellipsoid, 0.0), at(Ellipsoid, 1.0)), (1.0, 0.0, 0.0));
        assert_eq!((at(Hemisphere, 0.0), at(Hemisphere, 1.0)), (1.0, 0.0));
        assert!(at(Cylinder, 0.2) > 0.98 && at(Cylinder, 0.8) > 0.98);
        assert!(at(InvertedCone, 0.1) < 0.3 && at(InvertedCone, 0.7) > 0.85);
    }
}
