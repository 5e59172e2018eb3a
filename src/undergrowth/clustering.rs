//! Clustering: pieces of ground that are alike in their abiotic conditions.
//!
//! # Reference
//! Kapp et al. 2020, section 6.2: k-means for each combination of sub-biomes; Arthur and Vassilvitskii 2007, "k-means++".

use rayon::prelude::*;

use super::conditions::{DIMENSIONS, Factors};
use crate::math;
use crate::rng::{self, Key, Process};
use crate::species::{Biome, Niche};

/// Rounds of Lloyd's algorithm at most. chosen: centres move by less than a thousandth of the range after twenty.
const ROUNDS: usize = 40;

/// Soil water that plants of dry ground live on, mm: below it differences count as they are, above it as shares.
const DRY_MM: f32 = 20.0;
/// Difference of moisture that counts as one, as a logarithm. chosen: half as much again, or a third less; densities double over it.
const MOISTURE_UNIT: f32 = 0.5;
/// Chance a year that a seed sprouts in a cell, below which differences count as they are.
const FEW_SEEDS: f32 = 1e-3;
/// Difference of that chance that counts as one, as a logarithm. chosen: seven times as many; density follows seeds by a law of
/// its own, only the mixture of species is told apart by it.
const SEEDS_UNIT: f32 = 2.0;

/// Units of distance between conditions.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Scale {
    /// How much of each factor counts as one; of moisture, of ln(1 + mm / 20), of seeds, of ln(chance + 0.001).
    pub unit: Factors,
}

impl Scale {
    /// The mean half width of what a biome's species bear, but of moisture, which parts dry ground more finely than wet.
    ///
    /// # Departures
    /// The authors' program scales each condition by its range over the map, so that three degrees of a small hill part
    /// clusters as much as shade from sun. Here what matters to plants counts.
    pub fn of(biome: &Biome) -> Self {
        let mean = |of: &dyn Fn(&Niche) -> f32| {
            let sum: f32 = biome.species.iter().map(|species| of(&species.niche)).sum();
            sum / biome.species.len().max(1) as f32 // some dozens
        };
        let unit = [
            mean(&|niche| niche.sun_h.half_width),
            MOISTURE_UNIT,
            mean(&|niche| niche.temperature_c.half_width),
            mean(&|niche| niche.slope_rad.half_width),
            SEEDS_UNIT,
        ];
        Self { unit }
    }

    /// Conditions as coordinates of a space whose distances count.
    #[inline]
    pub fn coordinates(&self, at: &Factors) -> Factors {
        let [sun_h, moisture_mm, temperature_c, slope_rad, seed_chance] = *at;
        let moisture = math::ln(1.0 + moisture_mm / DRY_MM);
        let seeds = math::ln(seed_chance + FEW_SEEDS);
        let values = [sun_h, moisture, temperature_c, slope_rad, seeds];
        std::array::from_fn(|axis| values[axis] / self.unit[axis])
    }
}

/// Square of the distance between two places, by their coordinates.
#[inline]
pub fn square_distance(a: &Factors, b: &Factors) -> f32 {
    let mut sum = 0.0;
    for axis in 0..DIMENSIONS {
        let apart = a[axis] - b[axis];
        sum += apart * apart;
    }
    sum
}

/// Index of the nearest of some places, by their coordinates; the first of several as near.
///
/// # Panics
/// If there is none.
#[inline]
pub fn nearest<'a>(at: &Factors, places: impl Iterator<Item = (usize, &'a Factors)>) -> usize {
    let mut best = (f32::INFINITY, None);
    for (index, place) in places {
        let away = square_distance(at, place);
        if best.1.is_none() || away < best.0 {
            best = (away, Some(index));
        }
    }
    best.1.expect("there is a place to be near to")
}

/// `count` centres of samples, or fewer where there are fewer different samples.
pub fn centres(samples: &[Factors], scale: &Scale, count: usize, seed: u64) -> Vec<Factors> {
    let at: Vec<Factors> = samples.par_iter().map(|sample| scale.coordinates(sample)).collect();
    let first = first_centres(&at, count, seed);
    let mut centres: Vec<Factors> = first.into_iter().map(|sample| samples[sample]).collect();
    for _ in 0..ROUNDS {
        let places: Vec<Factors> = centres.iter().map(|c| scale.coordinates(c)).collect();
        let nearest: Vec<usize> =
            at.par_iter().map(|at| nearest(at, places.iter().enumerate())).collect();
        let mut sums = vec![([0.0_f64; DIMENSIONS], 0_usize); centres.len()];
        for (sample, centre) in samples.iter().zip(&nearest) {
            let (sum, count) = &mut sums[*centre];
            sum.iter_mut().zip(sample).for_each(|(sum, value)| *sum += f64::from(*value));
            *count += 1;
        }
        let moved: Vec<Factors> =
            (sums.iter().zip(&centres))
                .map(|((sum, count), centre)| {
                    if *count == 0 { *centre } else { sum.map(|sum| (sum / *count as f64) as f32) }
                })
                .collect();
        let most = (moved.iter().zip(&centres))
            .map(|(a, b)| square_distance(&scale.coordinates(a), &scale.coordinates(b)))
            .fold(0.0, f32::max);
        centres = moved;
        if most < 1e-6 {
            break;
        }
    }
    centres
}

/// Samples far from each other, by their coordinates: each next one is drawn by the square of its distance to those before.
fn first_centres(at: &[Factors], count: usize, seed: u64) -> Vec<usize> {
    let draw = |entity: u64| {
        let key = Key { seed, process: Process::Clustering, year: 0, month: 0, entity };
        f64::from(rng::uniforms(key)[0])
    };
    let Some(last) = at.len().checked_sub(1) else { return Vec::new() };
    let mut centres = vec![((draw(0) * at.len() as f64) as usize).min(last)];
    let mut away: Vec<f32> = vec![f32::INFINITY; at.len()];
    while centres.len() < count {
        let newest = at[centres[centres.len() - 1]];
        away.par_iter_mut().zip(at).for_each(|(away, at)| {
            *away = away.min(square_distance(at, &newest));
        });
        let total: f64 = away.iter().map(|away| f64::from(*away)).sum();
        if total <= 0.0 {
            break;
        }
        let mut left = draw(centres.len() as u64) * total;
        let chosen = away.iter().position(|away| {
            left -= f64::from(*away);
            left < 0.0
        });
        centres.push(chosen.unwrap_or(last));
    }
    centres
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples around three places.
    fn three_places() -> Vec<Factors> {
        let places = [
            [2.0, 20.0, 10.0, 0.0, 0.1],
            [8.0, 20.0, 10.0, 0.3, 0.1],
            [8.0, 150.0, 14.0, 0.1, 0.1],
        ];
        (0..900)
            .map(|index| {
                let key = Key {
                    seed: 3,
                    process: Process::StrewnPoints,
                    year: 0,
                    month: 0,
                    entity: index,
                };
                let apart = rng::uniforms(key);
                let place: Factors = places[index as usize % 3];
                std::array::from_fn(|axis| place[axis] * (0.95 + 0.1 * apart[axis % 4]))
            })
            .collect()
    }

    #[test]
    fn centres_are_the_means_of_what_is_alike() {
        let samples = three_places();
        let scale = Scale { unit: [4.0, 0.5, 15.0, 1.0, 2.0] };
        let mut found = centres(&samples, &scale, 3, 1);
        found.sort_by(|a, b| (a[0] + a[1]).total_cmp(&(b[0] + b[1])));
        for (centre, first) in found.iter().zip(0..3) {
            let of: Vec<_> = samples.iter().skip(first).step_by(3).collect();
            for axis in 0..DIMENSIONS {
                let mean = of.iter().map(|sample| sample[axis]).sum::<f32>() / 300.0;
                assert!((centre[axis] - mean).abs() < 1e-2 * (1.0 + mean), "{found:?}");
            }
        }
    }

    #[test]
    fn equal_samples_are_one_cluster() {
        let samples = vec![[1.0, 2.0, 3.0, 0.0, 0.1]; 50];
        let scale = Scale { unit: [4.0, 0.5, 15.0, 1.0, 2.0] };
        assert_eq!(centres(&samples, &scale, 4, 1), [samples[0]]);
        assert_eq!(centres(&[], &scale, 4, 1), [[0.0; DIMENSIONS]; 0]);
    }
}
