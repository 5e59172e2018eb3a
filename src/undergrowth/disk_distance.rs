//! Disk distance: how two plants lie to each other, by the overlap of their crowns or by the gap between them.
//!
//! # Reference
//! Gain et al. 2017, "EcoBrush", doi:10.1111/cgf.13106, and Ecormier-Nocca et al. 2019, "Accurate synthesis of multi-class
//! disk distributions", Computer Graphics Forum 38(2), as Kapp et al. 2020, section 6.2, use them.
//! # Departures
//! The authors' bins of overlap are in metres; here they are relative to the lesser crown, as the method has them
//! (PAPER_NOTES §8). Gaps are told apart the finer the nearer, up to 3 m instead of 5 m: beyond that plants hardly know of
//! each other, and each comparison costs as many neighbours as its area has.

/// Number of categories.
pub const BINS: usize = 8;
/// Categories of overlap: contained, more than half, less than half.
pub const OVERLAP_BINS: usize = 3;
/// Where bins of gaps end, m.
pub const GAP_ENDS_M: [f32; BINS - OVERLAP_BINS] = [0.25, 0.5, 1.0, 2.0, 3.0];
/// Gaps at least so wide are none.
pub const REACH_M: f32 = 3.0;

/// Category of two crowns whose middles are so far apart; none beyond reach.
#[inline]
pub fn bin(distance_m: f32, radius_m: f32, other_radius_m: f32) -> Option<usize> {
    // the sum first: the same to the bit whichever of the two is asked
    let gap_m = distance_m - (radius_m + other_radius_m);
    if gap_m >= 0.0 {
        // bins of doubling width: fewer steps than a search
        return (gap_m < REACH_M).then(|| {
            OVERLAP_BINS
                + usize::from(gap_m >= GAP_ENDS_M[0])
                + usize::from(gap_m >= GAP_ENDS_M[1])
                + usize::from(gap_m >= GAP_ENDS_M[2])
                + usize::from(gap_m >= GAP_ENDS_M[3])
        });
    }
    // share of the lesser crown's width that lies under the other
    let overlap = -gap_m / (2.0 * radius_m.min(other_radius_m));
    Some(if overlap >= 1.0 {
        0
    } else if overlap >= 0.5 {
        1
    } else {
        2
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crowns_contained_halved_touching_and_apart() {
        let of = |distance_m| bin(distance_m, 1.0, 0.5);
        assert_eq!(of(0.0), Some(0));
        assert_eq!(of(0.49), Some(0));
        assert_eq!(of(0.51), Some(1));
        assert_eq!(of(0.99), Some(1));
        assert_eq!(of(1.01), Some(2));
        assert_eq!(of(1.49), Some(2));
        assert_eq!(of(1.51), Some(3));
        for (bin, end_m) in GAP_ENDS_M.iter().enumerate() {
            assert_eq!(of(1.5 + end_m - 0.01), Some(OVERLAP_BINS + bin));
        }
        assert_eq!(of(1.5 + REACH_M), None);
        assert_eq!(bin(0.7, 1.0, 0.5), bin(0.7, 0.5, 1.0));
    }
}
