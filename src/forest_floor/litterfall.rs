//! Litterfall: leaves, needles and twigs on the ground under crowns.

use rayon::prelude::*;

use crate::math;

/// How litterfall is worked out.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct LitterfallParams {
    /// Layers of leaves that lie beneath crowns of a cumulative alpha of one.
    pub layers_per_absorption: f32,
}

impl Default for LitterfallParams {
    fn default() -> Self {
        // chosen: beneath one crown of a tree (alpha 0.3–0.5) leaves cover 70–86 % of the ground, beneath two 91–98 %
        Self { layers_per_absorption: 4.0 }
    }
}

/// Share of the ground that litter covers, in 0..1, under crowns of a cumulative alpha A: 1 − e^(−kA).
///
/// # Reference
/// Kapp et al. 2020, section 6.3: litterfall density is directly proportional to cumulative alpha.
/// # Departures
/// The printed density has no bound. Here leaves fall in proportion to A, kA layers of them, each at a place of its own,
/// and what they leave bare is e^(−kA): proportional where litter is thin, and never more than all the ground.
#[inline]
pub fn density(cumulative_absorption: f32, params: &LitterfallParams) -> f32 {
    1.0 - math::exp(-params.layers_per_absorption * cumulative_absorption)
}

/// [`density`] of every cell, in the place of its cumulative alpha.
pub fn densities(mut cumulative_absorption: Vec<f32>, params: &LitterfallParams) -> Vec<f32> {
    cumulative_absorption.par_iter_mut().for_each(|value| *value = density(*value, params));
    cumulative_absorption
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn litter_rises_with_cumulative_alpha_to_all_the_ground() {
        let params = LitterfallParams::default();
        assert_eq!(density(0.0, &params), 0.0);
        let values: Vec<f32> = (0..100).map(|i| density(i as f32 * 0.05, &params)).collect();
        assert!(values.windows(2).all(|pair| pair[1] >= pair[0]));
        assert!(values[99] <= 1.0 && values[99] > 0.999);
        assert!((density(0.5, &params) - 0.8647).abs() < 1e-4);
    }

    #[test]
    fn thin_litter_is_proportional_and_thick_litter_less_than_printed() {
        let params = LitterfallParams::default();
        let ratio = density(0.002, &params) / density(0.001, &params);
        assert!((ratio - 2.0).abs() < 0.01, "{ratio}");
        // the printed proportion would lay 4 times the ground beneath two crowns of 0.5
        assert!(density(1.0, &params) < 1.0);
    }
}
