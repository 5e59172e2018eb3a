//! Carbon pool: what is left of good months carries a plant through bad ones, and what runs over becomes growth.
//!
//! # Reference
//! Kapp et al. 2020, section 6.1, doi:10.1145/3414685.3417848; Peytavie et al. 2024, section 5.

/// An overdrawn pool goes no lower: from there on death within the year is certain.
pub const LOWEST: f32 = -1.0;
/// Most that may run over in a month (PAPER_NOTES §7).
pub const MOST_OVERFLOW: f32 = 1.0;

/// The pool after a month of this vigor, and what ran over.
///
/// # Reference
/// Kapp et al. 2020, Algorithm 2: R_i += v; what lies above the capacity overflows.
#[inline]
pub fn after_month(pool: f32, vigor: f32, capacity: f32) -> (f32, f32) {
    let filled = pool + vigor;
    // not `min`, whose care for NaN is most of this chain of months
    let kept = if filled < capacity { filled } else { capacity };
    (kept.max(LOWEST), (filled - capacity).clamp(0.0, MOST_OVERFLOW))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_months_of_the_greatest_stress_empty_a_full_pool() {
        let mut pool = 0.6;
        for _ in 0..3 {
            (pool, _) = after_month(pool, -0.2, 0.6);
        }
        assert!(pool.abs() < 1e-6);
        (pool, _) = after_month(pool, -0.2, 0.6);
        assert!((pool + 0.2).abs() < 1e-6);
    }

    #[test]
    fn only_what_does_not_fit_runs_over() {
        assert_eq!(after_month(0.0, 0.5, 0.6), (0.5, 0.0));
        let (pool, over) = after_month(0.5, 0.5, 0.6);
        assert_eq!(pool, 0.6);
        assert!((over - 0.4).abs() < 1e-6);
        assert_eq!(after_month(-0.9, -0.2, 0.6).0, LOWEST);
    }
}
