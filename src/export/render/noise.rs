//! Noise that breaks surfaces up: whole numbers hashed to numbers without pattern, and smooth noise between them.
//!
//! Textures, not draws: they depend on place alone, so that a picture's leaves stay where they are from view to view.

use super::coverage::floor;
use super::vector::{UP, Vec3, vec3};

/// A number without pattern for each whole number.
///
/// # Reference
/// Jarzynski & Olano 2020, "Hash functions for GPU rendering", JCGT 9(3): PCG.
#[inline]
pub fn hash(word: u32) -> u32 {
    let state = word.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let mixed = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (mixed >> 22) ^ mixed
}

/// Two words hashed to one.
#[inline]
pub fn hash2(a: u32, b: u32) -> u32 {
    hash(a ^ hash(b))
}

/// A number in 0..1 from the word's upper bits.
#[inline]
pub fn unit(word: u32) -> f32 {
    (word >> 8) as f32 * (1.0 / 16_777_216.0) // 24 bits are exact in f32
}

/// Four numbers in 0..1 from one word.
#[inline]
pub fn four(word: u32) -> [f32; 4] {
    let second = hash(word);
    [word & 0xffff, word >> 16, second & 0xffff, second >> 16].map(|w| w as f32 * (1.0 / 65536.0)) // 16 bits are exact
}

/// A direction, evenly over the ball's surface but for a slight pull to its corners: good enough for leaves.
#[inline]
pub fn direction(word: u32) -> Vec3 {
    let [x, y, z, _] = four(word);
    vec3(x + x - 1.0, y + y - 1.0, z + z - 1.0).normalize_or(UP)
}

#[inline]
fn lattice(x: i32, y: i32, z: i32) -> f32 {
    // bits, not sizes
    unit(hash(
        (x as u32).wrapping_mul(0x8da6_b343)
            ^ (y as u32).wrapping_mul(0xd816_3841)
            ^ (z as u32).wrapping_mul(0xcb1a_b31f),
    ))
}

/// Smooth noise in 0..1 with features one unit large.
#[inline]
pub fn smooth(p: Vec3) -> f32 {
    let (x, y, z) = (floor(p.x), floor(p.y), floor(p.z));
    let (fx, fy, fz) = (x as f32, y as f32, z as f32);
    let ease = |t: f32| t * t * (3.0 - 2.0 * t);
    let (tx, ty, tz) = (ease(p.x - fx), ease(p.y - fy), ease(p.z - fz));
    let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let edge = |dy: i32, dz: i32| {
        let (y, z) = (y.wrapping_add(dy), z.wrapping_add(dz));
        lerp(lattice(x, y, z), lattice(x.wrapping_add(1), y, z), tx)
    };
    lerp(lerp(edge(0, 0), edge(1, 0), ty), lerp(edge(0, 1), edge(1, 1), ty), tz)
}

/// Smooth noise as of [`smooth`], and how it rises along each axis.
#[inline]
pub fn smooth_with_slope(p: Vec3) -> (f32, Vec3) {
    let (x, y, z) = (floor(p.x), floor(p.y), floor(p.z));
    let (tx, ty, tz) = (p.x - x as f32, p.y - y as f32, p.z - z as f32);
    let ease = |t: f32| t * t * (3.0 - 2.0 * t);
    let rate = |t: f32| 6.0 * t * (1.0 - t);
    let (ex, ey, ez) = (ease(tx), ease(ty), ease(tz));
    let (x1, y1, z1) = (x.wrapping_add(1), y.wrapping_add(1), z.wrapping_add(1));
    let [a, b] = [lattice(x, y, z), lattice(x1, y, z)];
    let [c, d] = [lattice(x, y1, z), lattice(x1, y1, z)];
    let [e, f] = [lattice(x, y, z1), lattice(x1, y, z1)];
    let [g, h] = [lattice(x, y1, z1), lattice(x1, y1, z1)];
    let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let [ab, cd, ef, gh] = [lerp(a, b, ex), lerp(c, d, ex), lerp(e, f, ex), lerp(g, h, ex)];
    let [low, high] = [lerp(ab, cd, ey), lerp(ef, gh, ey)];
    let slope = vec3(
        lerp(lerp(b - a, d - c, ey), lerp(f - e, h - g, ey), ez) * rate(tx),
        lerp(cd - ab, gh - ef, ez) * rate(ty),
        (high - low) * rate(tz),
    );
    (lerp(low, high, ez), slope)
}

/// Smooth noise over the plane in 0..1 with features one unit large.
#[inline]
pub fn smooth_level(x: f32, y: f32, layer: i32) -> f32 {
    let (cx, cy) = (floor(x), floor(y));
    let (fx, fy) = (cx as f32, cy as f32);
    let ease = |t: f32| t * t * (3.0 - 2.0 * t);
    let (tx, ty) = (ease(x - fx), ease(y - fy));
    let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let (ex, ey) = (cx.wrapping_add(1), cy.wrapping_add(1));
    let south = lerp(lattice(cx, cy, layer), lattice(ex, cy, layer), tx);
    let north = lerp(lattice(cx, ey, layer), lattice(ex, ey, layer), tx);
    lerp(south, north, ty)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_even_and_continuous() {
        let n = 20_000;
        let mean = (0..n).map(|i| unit(hash(i))).sum::<f32>() / n as f32;
        assert!((mean - 0.5).abs() < 0.01, "{mean}");
        let mut before = smooth(vec3(-3.0, 0.3, 0.7));
        for i in 1..3000 {
            let now = smooth(vec3(-3.0 + i as f32 * 0.002, 0.3, 0.7));
            assert!((now - before).abs() < 0.01 && (0.0..=1.0).contains(&now));
            before = now;
        }
        let at = vec3(3.3, -1.7, 12.6);
        let (value, slope) = smooth_with_slope(at);
        assert!((value - smooth(at)).abs() < 1e-6);
        for (axis, rise) in [(vec3(1e-2, 0.0, 0.0), slope.x), (vec3(0.0, 0.0, 1e-2), slope.z)] {
            let found = (smooth(at + axis) - smooth(at - axis)) / 2e-2;
            assert!((found - rise).abs() < 1e-2, "{found} {rise}");
        }
        assert!((direction(77).length() - 1.0).abs() < 1e-5);
    }
}
