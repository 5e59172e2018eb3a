//! Uplift against rivers and creep: what carves valleys and rounds ridges.
//!
//! Time is counted so that the rivers' erodibility is 1: dz/dt = U − A^½ S + ∇·(D ∇z), with U in metres and D in m²
//! per unit of time.
//!
//! # Reference
//! Rivers: Braun & Willett 2013, "A very efficient O(n), implicit and parallel method to solve the stream power
//! equation", doi:10.1016/j.geomorph.2012.10.008, Eqs. 15–23 with n = 1, m = ½. Creep: Roering et al. 1999,
//! "Evidence for nonlinear, diffusive sediment transport on hillslopes", doi:10.1029/1998WR900090, Eq. 8.

use rayon::prelude::*;

use super::drainage::Drainage;
use super::extent::Extent;

/// Largest share of the height difference to a neighbour that one explicit pass of creep may move;
/// four neighbours make the scheme stable up to ¼.
const STABLE_SHARE: f32 = 0.2;

/// Fewest explicit passes of a step: slopes near the critical one need them to shed what uplift brings.
const MIN_PASSES: usize = 2;

/// Raises `height_m` by uplift and lets rivers cut it, one implicit step of any length; outlets stay.
/// What would stand steeper than `critical_slope` (rise over run, one a cell) above its receiver slides off.
pub fn uplift_and_incise(
    height_m: &mut [f32],
    uplift_m: &[f32],
    critical_slope: &[f32],
    drainage: &Drainage,
    extent: &Extent,
    duration: f32,
) {
    let cell_m = extent.cell_m as f32;
    for &cell in &drainage.order {
        let cell = cell as usize;
        let receiver = drainage.receiver[cell] as usize;
        if receiver == cell {
            continue;
        }
        let run_m = drainage.step_cells[cell] * cell_m;
        let pull = drainage.area_m2[cell].sqrt() / run_m * duration;
        let raised = height_m[cell] + uplift_m[cell] * duration;
        let incised = (raised + pull * height_m[receiver]) / (1.0 + pull);
        height_m[cell] = incised.min(height_m[receiver] + critical_slope[cell] * run_m);
    }
}

/// Lets soil creep downhill for `duration`; faster the closer slopes come to `critical_slope` (rise over run).
/// `fixed` cells stay. At most `max_passes` explicit passes are spent, the last of them cut short if that is too few.
pub fn creep(
    height_m: &mut Vec<f32>,
    fixed: &[u32],
    extent: &Extent,
    diffusivity_m2: f32,
    critical_slope: f32,
    duration: f32,
    max_passes: usize,
) {
    let cell_m = extent.cell_m as f32;
    let total_share = diffusivity_m2 * duration / (cell_m * cell_m);
    // chosen: passes of half the stable share leave room for steep slopes to creep twice as fast
    let passes =
        ((total_share / (0.5 * STABLE_SHARE)).ceil() as usize).clamp(MIN_PASSES, max_passes);
    let share = total_share / passes as f32;
    let per_critical = 1.0 / (critical_slope * cell_m);
    let mut next = vec![0.0_f32; height_m.len()];
    for _ in 0..passes {
        next.par_chunks_mut(extent.cols).enumerate().for_each(|(row, out)| {
            let line = |r: usize| &height_m[r * extent.cols..][..extent.cols];
            let here = line(row);
            let (north, south) =
                (line(row.saturating_sub(1)), line((row + 1).min(extent.rows - 1)));
            let moved = |z: f32, north: f32, south: f32, west: f32, east: f32| {
                let flow = |other: f32| {
                    let difference = other - z;
                    let steepness = difference * per_critical;
                    // q = D S / (1 − (S/S_c)²), bounded by what an explicit pass can bear
                    let widened = share / (1.0 - steepness * steepness).max(0.05);
                    difference * widened.min(STABLE_SHARE)
                };
                z + flow(north) + flow(south) + flow(west) + flow(east)
            };
            let last = extent.cols - 1;
            let edges = |col: usize| {
                let (west, east) = (here[col.saturating_sub(1)], here[(col + 1).min(last)]);
                moved(here[col], north[col], south[col], west, east)
            };
            (out[0], out[last]) = (edges(0), edges(last));
            // slices of one length: the compiler drops bounds checks and works on several cells at once
            let lines = here.windows(3).zip(north[1..].iter().zip(&south[1..]));
            for (out, (three, (n, s))) in out[1..].iter_mut().zip(lines) {
                *out = moved(three[1], *n, *s, three[0], three[2]);
            }
        });
        for &cell in fixed {
            next[cell as usize] = height_m[cell as usize];
        }
        std::mem::swap(height_m, &mut next);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{cos, exp};

    fn strip(cols: usize) -> Extent {
        Extent { rows: 1, cols, cell_m: 10.0, west_m: 0.0, north_m: 10.0 }
    }

    #[test]
    fn a_river_settles_into_the_closed_form_profile() {
        // one row of cells draining west: at rest A^½ S = U, so z_i = Σ U dx / √A_k
        let extent = strip(12);
        let mut height: Vec<f32> = (0..12).map(|i| i as f32).collect();
        let uplift = vec![0.7_f32; 12];
        for _ in 0..60 {
            let drainage = Drainage::of(&height, &[0; 12], &[0], &extent);
            uplift_and_incise(&mut height, &uplift, &[9.0; 12], &drainage, &extent, 5.0);
        }
        let mut expected = 0.0;
        for (cell, z) in height.iter().enumerate() {
            if cell > 0 {
                expected += 0.7 * 10.0 / (100.0 * (12 - cell) as f32).sqrt();
            }
            assert!((z - expected).abs() < 1e-3, "cell {cell}: {z} {expected}");
        }
    }

    #[test]
    fn steep_ground_slides_to_the_critical_slope() {
        let extent = strip(5);
        let mut height = vec![0.0, 2.0, 80.0, 81.0, 200.0];
        let drainage = Drainage::of(&height, &[0; 12], &[0], &extent);
        uplift_and_incise(&mut height, &[0.0; 5], &[0.5; 5], &drainage, &extent, 1e-6);
        for (z, expected) in height.iter().zip([0.0, 2.0, 7.0, 12.0, 17.0]) {
            assert!((z - expected).abs() < 1e-3, "{height:?}");
        }
    }

    #[test]
    fn creep_keeps_the_mass_and_lowers_the_peak() {
        let extent = Extent { rows: 9, cols: 9, cell_m: 2.0, west_m: 0.0, north_m: 18.0 };
        let mut height = vec![0.0_f32; 81];
        height[40] = 3.0;
        creep(&mut height, &[], &extent, 4.0, 1.0, 1.0, 50);
        let mass: f32 = height.iter().sum();
        assert!((mass - 3.0).abs() < 1e-4, "mass {mass}");
        assert!(height[40] < 1.5 && height.iter().all(|z| *z >= 0.0));
    }

    #[test]
    fn gentle_creep_is_plain_diffusion() {
        // a cosine of wavelength L decays as exp(−D (2π/L)² t)
        let extent = strip(40);
        let wave = |i: usize| cos(std::f32::consts::TAU * (i as f32 + 0.5) / 40.0);
        let mut height: Vec<f32> = (0..40).map(|i| 0.1 * wave(i)).collect();
        creep(&mut height, &[], &extent, 50.0, 100.0, 20.0, 10_000);
        let k = std::f32::consts::TAU / 400.0;
        let decay = exp(-50.0 * k * k * 20.0);
        for (i, z) in height.iter().enumerate() {
            assert!((z - 0.1 * wave(i) * decay).abs() < 1e-3, "{i}: {z}");
        }
    }
}
