//! Variety: what makes two plants of a species look unlike, and leaves and litter look strewn.
//!
//! Keyed by the plant's id or the pixel alone: a plant looks the same in every picture of it.

/// A number with its bits mixed, so that neighbours have nothing in common.
///
/// # Reference
/// The finalizer of MurmurHash3 (Appleby 2011), which is one to one.
pub fn mixed(number: u32) -> u32 {
    let mut bits = number;
    bits = (bits ^ (bits >> 16)).wrapping_mul(0x85eb_ca6b);
    bits = (bits ^ (bits >> 13)).wrapping_mul(0xc2b2_ae35);
    bits ^ (bits >> 16)
}

/// What sets a plant apart, by its id.
pub fn of_plant(id: u64) -> u32 {
    mixed(id as u32 ^ mixed((id >> 32) as u32 ^ 0x9e37_79b9)) // both halves
}

/// A number in 0..1 for each aspect of a thing.
pub fn unit(seed: u32, aspect: u32) -> f32 {
    (mixed(seed ^ aspect.wrapping_add(1).wrapping_mul(0x9e37_79b9)) >> 8) as f32 / 16_777_216.0 // 24 bits are exact
}

/// A number in 0..1 for each cell of a lattice.
pub fn speck(seed: u32, col: i32, row: i32) -> f32 {
    let (col, row) = (col.cast_unsigned(), row.cast_unsigned());
    unit(seed ^ mixed(col.wrapping_mul(0x85eb_ca6b).wrapping_add(row)), row)
}

/// Smooth noise in −1..=1, whose clumps are one unit wide.
pub fn clumps(seed: u32, x: f32, y: f32) -> f32 {
    let (left, above) = (x.floor(), y.floor());
    let ease = |t: f32| t * t * (3.0 - 2.0 * t);
    let (u, v) = (ease(x - left), ease(y - above));
    let at = |dx: i32, dy: i32| speck(seed, left as i32 + dx, above as i32 + dy);
    let upper = at(0, 0) + u * (at(1, 0) - at(0, 0));
    let lower = at(0, 1) + u * (at(1, 1) - at(0, 1));
    2.0 * (upper + v * (lower - upper)) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_fill_the_unit_interval_evenly() {
        let mean = |f: &dyn Fn(u32) -> f32| (0..10_000).map(|i| f64::from(f(i))).sum::<f64>() / 1e4;
        // standard error of the mean of 10,000 uniforms is 0.0029
        assert!((mean(&|i| unit(of_plant(u64::from(i)), 3)) - 0.5).abs() < 0.012);
        assert!((mean(&|i| unit(7, i)) - 0.5).abs() < 0.012);
        assert!((mean(&|i| speck(1, (i % 100) as i32 - 50, (i / 100) as i32)) - 0.5).abs() < 0.012);
    }

    #[test]
    fn clumps_are_smooth_and_bounded() {
        let mut last = clumps(5, -3.0, 0.4);
        for step in 1..600 {
            let here = clumps(5, -3.0 + step as f32 * 0.01, 0.4);
            assert!((-1.0..=1.0).contains(&here) && (here - last).abs() < 0.04);
            last = here;
        }
    }
}
