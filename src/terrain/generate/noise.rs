//! Gradient noise whose draws are keyed by absolute lattice points, so a place keeps its noise in any window.
//!
//! # Reference
//! Perlin 2002, "Improving noise", doi:10.1145/566654.566636 (quintic fade);
//! Musgrave et al. 1989, "The synthesis and rendering of eroded fractal terrains", doi:10.1145/74334.74337.
//! # Departures
//! Gradients are unit vectors of a random angle instead of twelve fixed ones: no axis is favoured.

use std::f32::consts::TAU;

use rayon::prelude::*;

use super::extent::Extent;
use crate::math;
use crate::rng::{self, Key, Process};

/// Fields of noise, of landscapes and of made-up canopies; each has draws of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Field {
    /// Draws for the whole landscape: where the valley runs.
    Plan = 0,
    /// Where rock is lifted into ridges.
    Ridges = 1,
    /// The first surface.
    Hills = 2,
    /// Words for the drainage's wobble.
    Jitter = 3,
    /// Small unevenness of uplift.
    Texture = 4,
    /// Rises a river bends around.
    Bends = 5,
    /// How steep rock stands.
    Rock = 6,
    /// Shifts of ground to the east.
    BendEast = 7,
    /// Shifts of ground to the north.
    BendNorth = 8,
    /// Where woods stand and where land is open.
    Woodland = 9,
    /// How sharp a wood's edge is.
    Openness = 10,
    /// Gaps in the canopy.
    Gaps = 11,
    /// Meadows on level ground.
    Meadows = 12,
    /// Smooth change of stand height.
    StandHeight = 13,
    /// Stands of one age, with borders.
    StandAge = 14,
    /// Needles or broad leaves.
    StandKind = 15,
}

/// A family of noise octaves; each field has draws of its own.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    /// The landscape's seed.
    pub seed: u64,
    /// Tells fields of one landscape apart.
    pub field: Field,
}

impl Noise {
    fn key(&self, octave: u16, entity: u64) -> Key {
        Key {
            seed: self.seed,
            process: Process::TerrainNoise,
            year: octave,
            month: self.field as u8,
            entity,
        }
    }

    /// A uniform draw in 0..1 that belongs to the whole landscape.
    pub fn uniform(&self, octave: u16) -> f32 {
        rng::uniforms(self.key(octave, 0))[0]
    }

    /// One random word a cell.
    pub fn words(&self, octave: u16, extent: &Extent) -> Vec<u32> {
        let mut words = vec![0_u32; extent.len()];
        words.par_chunks_mut(extent.cols).enumerate().for_each(|(row, words)| {
            for (col, word) in words.iter_mut().enumerate() {
                let (east, north) = extent.absolute_cell(row, col);
                *word = rng::words(self.key(octave, rng::entity_of_cell(east, north)))[0];
            }
        });
        words
    }

    /// One octave of gradient noise at cell centres, within −1..=1 and 0 on lattice points.
    pub fn gradient(&self, octave: u16, wavelength_m: f64, extent: &Extent) -> Vec<f32> {
        let lattice = |m: f64| (m / wavelength_m).floor() as i64; // extents are far below 2⁵³ lattice steps
        let (first_east, first_north) = (lattice(extent.west_m), lattice(extent.south_m()));
        let lattice_cols = (lattice(extent.east_m()) - first_east + 2) as usize; // positive
        let lattice_rows = (lattice(extent.north_m) - first_north + 2) as usize;
        let gradients: Vec<[f32; 2]> = (0..lattice_rows * lattice_cols)
            .into_par_iter()
            .map(|i| {
                let east = first_east + (i % lattice_cols) as i64;
                let north = first_north + (i / lattice_cols) as i64;
                let draw = rng::uniforms(self.key(octave, rng::entity_of_cell(east, north)))[0];
                [math::cos(TAU * draw), math::sin(TAU * draw)]
            })
            .collect();

        by_rows(extent, |row, values| {
            let y = extent.center_north_m(row) / wavelength_m - first_north as f64;
            let (j, v) = (y.floor(), y.fract() as f32);
            let rows = &gradients[j as usize * lattice_cols..];
            for (col, value) in values.iter_mut().enumerate() {
                let x = extent.center_east_m(col) / wavelength_m - first_east as f64;
                let (i, u) = (x.floor() as usize, x.fract() as f32);
                let slope = |corner: usize, du: f32, dv: f32| {
                    let [gu, gv] = rows[corner];
                    gu * du + gv * dv
                };
                let (fade_u, fade_v) = (fade(u), fade(v));
                let south = mix(slope(i, u, v), slope(i + 1, u - 1.0, v), fade_u);
                let above = i + lattice_cols;
                let north =
                    mix(slope(above, u, v - 1.0), slope(above + 1, u - 1.0, v - 1.0), fade_u);
                // the largest value of unit-gradient noise in the plane is 1/√2
                *value = std::f32::consts::SQRT_2 * mix(south, north, fade_v);
            }
        })
    }

    /// Octaves of halving wavelength and amplitude `gain`, down to two cells; first octave within −1..=1.
    pub fn fractal(&self, wavelength_m: f64, octaves: u16, gain: f32, extent: &Extent) -> Vec<f32> {
        let mut sum = vec![0.0_f32; extent.len()];
        let (mut wavelength, mut amplitude) = (wavelength_m, 1.0);
        for octave in 0..octaves {
            if wavelength < 2.0 * extent.cell_m {
                break;
            }
            let values = self.gradient(octave, wavelength, extent);
            sum.par_iter_mut().zip(&values).for_each(|(s, v)| *s += amplitude * v);
            wavelength /= 2.0;
            amplitude *= gain;
        }
        sum
    }

    /// Ridged multifractal, about 0..2: sharp crests where an octave crosses 0, and detail only on crests.
    pub fn ridged(&self, wavelength_m: f64, octaves: u16, extent: &Extent) -> Vec<f32> {
        // chosen: Musgrave's usual gain; crests carry detail, hollows stay smooth
        const CREST_GAIN: f32 = 2.0;
        let mut sum = vec![0.0_f32; extent.len()];
        let mut weight = vec![1.0_f32; extent.len()];
        let (mut wavelength, mut amplitude) = (wavelength_m, 1.0);
        for octave in 0..octaves {
            if wavelength < 2.0 * extent.cell_m {
                break;
            }
            let values = self.gradient(octave, wavelength, extent);
            sum.par_iter_mut().zip(&mut weight).zip(&values).for_each(|((s, w), v)| {
                let crest = 1.0 - v.abs().min(1.0);
                let signal = crest * crest * *w;
                *s += amplitude * signal;
                *w = (signal * CREST_GAIN).clamp(0.0, 1.0);
            });
            wavelength /= 2.0;
            amplitude *= 0.5;
        }
        sum
    }
}

/// One value a cell, filled row by row in parallel.
pub fn by_rows(extent: &Extent, fill: impl Fn(usize, &mut [f32]) + Sync) -> Vec<f32> {
    let mut values = vec![0.0_f32; extent.len()];
    values.par_chunks_mut(extent.cols).enumerate().for_each(|(row, values)| fill(row, values));
    values
}

fn fade(t: f32) -> f32 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

#[cfg(test)]
mod tests {
    use super::*;

    fn extent(rows: usize, cols: usize, cell_m: f64) -> Extent {
        Extent { rows, cols, cell_m, west_m: -40.0, north_m: 30.0 }
    }

    #[test]
    fn noise_is_zero_on_lattice_points_and_stays_within_one() {
        let noise = Noise { seed: 3, field: Field::Plan };
        // centres at −40 + 5 + 10 i and 30 − 5 − 10 j: multiples of 5
        let on_lattice = noise.gradient(0, 5.0, &extent(6, 9, 10.0));
        assert!(on_lattice.iter().all(|v| v.abs() < 1e-5), "{on_lattice:?}");
        let between = noise.gradient(0, 7.3, &extent(60, 90, 1.0));
        assert!(between.iter().all(|v| v.abs() <= 1.0));
        assert!(between.iter().any(|v| v.abs() > 0.4));
    }

    #[test]
    fn a_place_keeps_its_noise_in_another_window() {
        let noise = Noise { seed: 3, field: Field::Ridges };
        let wide = extent(20, 30, 1.0);
        let narrow = Extent { rows: 10, cols: 12, west_m: -35.0, north_m: 27.0, ..wide };
        let (whole, part) = (noise.gradient(2, 6.5, &wide), noise.gradient(2, 6.5, &narrow));
        let (whole_words, part_words) = (noise.words(2, &wide), noise.words(2, &narrow));
        for row in 0..10 {
            for col in 0..12 {
                let (outer, inner) = ((row + 3) * 30 + col + 5, row * 12 + col);
                let (a, b) = (whole[outer], part[inner]);
                assert!((a - b).abs() < 1e-5, "({row}, {col}): {a} {b}");
                assert_eq!(whole_words[outer], part_words[inner]);
            }
        }
    }

    #[test]
    fn fields_and_seeds_differ() {
        let e = extent(8, 8, 1.0);
        let base = Noise { seed: 3, field: Field::Plan }.gradient(0, 3.1, &e);
        assert_ne!(base, Noise { seed: 4, field: Field::Plan }.gradient(0, 3.1, &e));
        assert_ne!(base, Noise { seed: 3, field: Field::Ridges }.gradient(0, 3.1, &e));
    }
}
