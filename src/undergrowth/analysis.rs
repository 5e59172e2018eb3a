//! Analysis: from simulated plots to statistics.
//!
//! # Reference
//! Kapp et al. 2020, section 6.2, Analysis, doi:10.1145/3414685.3417848.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::clustering::{self, Scale};
use super::conditions::Factors;
use super::disk_distance::BINS;
use super::disks::Disks;
use super::measures::Measures;
use super::statistics::{
    self, Cluster, Density, FORMAT, Pair, QUANTILES, Source, SpeciesShare, Statistics,
};
use crate::math;
use crate::species::Biome;

/// Lower plants are seedlings that nobody would count; m. chosen: what a forester's regeneration survey begins with.
pub const LEAST_HEIGHT_M: f32 = 0.1;

/// Most clusters of one combination of sub-biomes. chosen: light in fours, moisture in sixes.
const MOST_CLUSTERS: usize = 28;
/// Least ground of a cluster, m². chosen: some hundreds of plants at usual densities.
const CLUSTER_M2: f64 = 1200.0;
/// Upper ends of classes of the chance of seeds, the last open. chosen: a lone tree, a few, a wood, a dense wood.
const CHANCE_ENDS: [f32; 5] = [0.01, 0.04, 0.1, 0.16, 0.22];
/// Pairs below which a kind of neighbour is left out: chance alone.
const LEAST_PAIRS: f64 = 20.0;
/// Plants below which a cluster borrows its species from the nearest one.
const LEAST_PLANTS: u32 = 40;
/// Plants of a species below which heights are those of all clusters.
const LEAST_HEIGHTS: usize = 25;
/// Plants below which a cluster borrows its neighbours from the nearest one.
const LEAST_NEIGHBOURS: u32 = 150;

/// A plot after its simulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Rows of ground cells.
    pub rows: usize,
    /// Columns of ground cells.
    pub cols: usize,
    /// Their width.
    pub cell_m: f32,
    /// Width of the rim whose plants are seen as neighbours only.
    pub rim_m: f32,
    /// What undergrowth of each cell depends on.
    pub factors: Vec<Factors>,
    /// Sub-biomes that shed seeds on each cell.
    pub sub_biomes: Vec<u32>,
    /// Canopy trees over the plot and near it.
    pub trees: Disks,
    /// Undergrowth in the years that are counted.
    pub years: Vec<(u16, Disks)>,
    /// Live plants at the end of each year.
    pub plants_by_year: Vec<u32>,
}

impl Sample {
    /// Chance a year that a seed sprouts in a simulation cell of a cell.
    fn seed_chance(&self, cell: usize) -> f32 {
        let [.., chance] = self.factors[cell];
        chance
    }

    /// Whether a cell lies inside the rim.
    pub fn is_inside(&self, cell: usize) -> bool {
        let rim = (self.rim_m / self.cell_m).ceil() as usize;
        let inside = |at: usize, count: usize| at >= rim && at + rim < count;
        inside(cell / self.cols, self.rows) && inside(cell % self.cols, self.cols)
    }

    /// The cell that a place lies in.
    pub fn cell_at(&self, east_m: f32, south_m: f32) -> usize {
        // `as` cuts negatives to 0
        let line = |at_m: f32, count: usize| ((at_m / self.cell_m) as usize).min(count - 1);
        line(south_m, self.rows) * self.cols + line(east_m, self.cols)
    }
}

/// What was counted in a cluster.
#[derive(Clone, Default)]
struct Counted {
    area_m2: f64,
    classes: [Class; CHANCE_ENDS.len() + 1],
    heights_m: BTreeMap<u16, Vec<f32>>,
}

/// What was counted on ground of a class of the chance of seeds.
#[derive(Clone, Copy, Default)]
struct Class {
    area_m2: f64,
    /// The chance, summed over the ground.
    chance_m2: f64,
    plants: u64,
}

/// Statistics of simulated plots.
///
/// # Panics
/// If there is no ground with seeds in any of them.
pub fn analyse(samples: &[Sample], biome: &Biome, seed: u64) -> Statistics {
    // clusters of each combination of sub-biomes
    let mut grounds: BTreeMap<u32, Vec<Factors>> = BTreeMap::new();
    for sample in samples {
        for cell in (0..sample.factors.len()).filter(|cell| sample.is_inside(*cell)) {
            let sub_biomes = sample.sub_biomes[cell];
            if sub_biomes != 0 {
                grounds.entry(sub_biomes).or_default().push(sample.factors[cell]);
            }
        }
    }
    let scale = Scale { unit: Scale::of(biome).unit.map(rounded) };
    let cell_m2 = samples.first().map_or(1.0, |sample| f64::from(sample.cell_m).powi(2));
    let mut clusters: Vec<(u32, Factors)> = Vec::new();
    for (sub_biomes, ground) in &grounds {
        let area_m2 = ground.len() as f64 * cell_m2;
        let count = ((area_m2 / CLUSTER_M2) as usize).clamp(1, MOST_CLUSTERS);
        let centres = clustering::centres(ground, &scale, count, seed ^ u64::from(*sub_biomes));
        clusters.extend(centres.into_iter().map(|centre| (*sub_biomes, centre)));
    }
    assert!(!clusters.is_empty(), "no ground with seeds");

    // counts
    let places: Vec<Factors> = clusters.iter().map(|(_, c)| scale.coordinates(c)).collect();
    let species = biome.species.len();
    let mut pairs = PairSums::new(clusters.len(), species);
    let mut counted = vec![Counted::default(); clusters.len()];
    for sample in samples {
        let cluster_of: Vec<Option<u16>> = (0..sample.factors.len())
            .map(|cell| {
                let bits = sample.sub_biomes[cell];
                let of_bits = clusters.iter().enumerate().filter(|(_, (of, _))| *of == bits);
                let centres = of_bits.map(|(index, _)| (index, &places[index]));
                let is_counted = bits != 0 && sample.is_inside(cell);
                let at = || scale.coordinates(&sample.factors[cell]);
                is_counted.then(|| clustering::nearest(&at(), centres) as u16)
            })
            .collect();
        for (_, plants) in &sample.years {
            for (cell, cluster) in cluster_of.iter().enumerate() {
                let Some(cluster) = cluster else { continue };
                let chance = sample.seed_chance(cell);
                let counted = &mut counted[usize::from(*cluster)];
                counted.area_m2 += cell_m2;
                let class = &mut counted.classes[class_of(chance)];
                class.area_m2 += cell_m2;
                class.chance_m2 += f64::from(chance) * cell_m2;
            }
            let of_plants: Vec<Option<u16>> = (plants.east_m.iter().zip(&plants.south_m))
                .map(|(east_m, south_m)| cluster_of[sample.cell_at(*east_m, *south_m)])
                .collect();
            for (plant, cluster) in of_plants.iter().enumerate() {
                let Some(cluster) = cluster else { continue };
                let cell = sample.cell_at(plants.east_m[plant], plants.south_m[plant]);
                let counted = &mut counted[usize::from(*cluster)];
                counted.classes[class_of(sample.seed_chance(cell))].plants += 1;
                let heights_m = counted.heights_m.entry(plants.species[plant]).or_default();
                heights_m.push(plants.height_m[plant]);
            }
            let mut area_m2 = vec![0.0; clusters.len()];
            cluster_of.iter().flatten().for_each(|c| area_m2[usize::from(*c)] += cell_m2);
            let trees = &sample.trees;
            pairs.add(&Measures::of(clusters.len(), species, plants, &of_plants, trees), &area_m2);
        }
    }
    assemble(samples, biome, seed, scale, &clusters, &pairs, counted)
}

fn class_of(chance: f32) -> usize {
    CHANCE_ENDS.iter().filter(|end| chance >= **end).count()
}

fn assemble(
    samples: &[Sample],
    biome: &Biome,
    seed: u64,
    scale: Scale,
    clusters: &[(u32, Factors)],
    pairs: &PairSums,
    counted: Vec<Counted>,
) -> Statistics {
    let mut all_heights_m: BTreeMap<u16, Vec<f32>> = BTreeMap::new();
    for counted in &counted {
        for (species, heights_m) in &counted.heights_m {
            all_heights_m.entry(*species).or_default().extend(heights_m);
        }
    }
    all_heights_m.values_mut().for_each(|heights_m| heights_m.sort_by(f32::total_cmp));
    let plants_of = |counted: &Counted| counted.heights_m.values().map(Vec::len).sum::<usize>();
    // far fewer than 2³²
    let plants: Vec<u32> = counted.iter().map(|counted| plants_of(counted) as u32).collect();
    // the nearest cluster with enough plants, of the same sub-biomes if there is one
    let nearest = |cluster: usize, least: u32| {
        let (bits, at) = &clusters[cluster];
        let rank = |other: &usize| {
            let (other_bits, other_at) = &clusters[*other];
            (
                (bits ^ other_bits).count_ones(),
                clustering::square_distance(&scale.coordinates(at), &scale.coordinates(other_at)),
            )
        };
        let enough = (0..clusters.len()).filter(|other| plants[*other] >= least);
        let best = enough.min_by(|a, b| {
            let (a, b) = (rank(a), rank(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        best.filter(|best| *best != cluster).map(|best| best as u16)
    };
    let of_clusters: Vec<Cluster> = (counted.into_iter().enumerate())
        .map(|(index, counted)| {
            let total = f64::from(plants[index]).max(1.0);
            let species = counted.heights_m.into_iter().map(|(species, mut heights_m)| {
                let share = heights_m.len() as f64 / total;
                let height_of_all = heights_m.len() < LEAST_HEIGHTS;
                heights_m.sort_by(f32::total_cmp);
                let sorted = if height_of_all { &all_heights_m[&species] } else { &heights_m };
                let at = |i: usize| {
                    let share = i as f32 / (QUANTILES - 1) as f32;
                    rounded(statistics::quantile(sorted, share))
                };
                SpeciesShare {
                    species,
                    share: rounded(share as f32),
                    height_m: (0..QUANTILES).map(at).collect(),
                    height_of_all,
                }
            });
            let (sub_biomes, centre) = clusters[index];
            Cluster {
                sub_biomes,
                centre: centre.map(rounded),
                area_m2: rounded(counted.area_m2 as f32),
                plants: plants[index],
                density: density(&counted.classes),
                species: species.collect(),
                species_from: nearest(index, LEAST_PLANTS),
                pairs: pairs.of(index),
                pairs_from: nearest(index, LEAST_NEIGHBOURS),
            }
        })
        .collect();
    let source = Source {
        wildwood_version: env!("CARGO_PKG_VERSION").to_owned(),
        seed,
        plots: samples.len(),
        years: samples.first().map_or_else(Vec::new, |s| s.years.iter().map(|(y, _)| *y).collect()),
        area_m2: of_clusters.iter().map(|cluster| f64::from(cluster.area_m2)).sum(),
        plants: plants.iter().map(|plants| u64::from(*plants)).sum(),
    };
    Statistics {
        format: FORMAT,
        biome: biome.key.clone(),
        species: biome.species.iter().map(|species| species.key.clone()).collect(),
        sub_biomes: biome.sub_biomes.iter().map(|sub_biome| sub_biome.key.clone()).collect(),
        least_height_m: LEAST_HEIGHT_M,
        source,
        scale,
        clusters: of_clusters,
    }
}

/// The density that lies nearest to those of classes, by least squares weighed by ground.
fn density(classes: &[Class]) -> Density {
    let points: Vec<[f64; 3]> = (classes.iter().filter(|class| class.area_m2 > 0.0))
        .map(|Class { area_m2, chance_m2, plants }| {
            [*area_m2, chance_m2 / area_m2, *plants as f64 / area_m2]
        })
        .collect();
    // the slope for a half chance, and what is missed then
    let fit = |half_chance: f64| {
        let shape = |chance: f64| chance / (1.0 + chance / half_chance);
        let (mut up, mut down) = (0.0, 0.0);
        for [area_m2, chance, plants] in &points {
            up += area_m2 * shape(*chance) * plants;
            down += area_m2 * shape(*chance).powi(2);
        }
        let slope = if down > 0.0 { up / down } else { 0.0 };
        let missed = |[area_m2, chance, plants]: &[f64; 3]| {
            area_m2 * (slope * shape(*chance) - plants).powi(2)
        };
        (points.iter().map(missed).sum::<f64>(), slope, half_chance)
    };
    // from a few trees' chance to more than any wood's: steps by the root of two
    let halves = (0..20).map(|step| 0.03 * math::powf_f64(2.0, 0.5 * f64::from(step)));
    let best = halves.map(fit).min_by(|a, b| a.0.total_cmp(&b.0));
    let (_, slope, half_chance) = best.unwrap_or((0.0, 0.0, 1.0));
    Density {
        plants_per_m2_and_chance: rounded(slope as f32),
        half_chance: rounded(half_chance as f32),
    }
}

/// Pairs of plots, and how many of them chance would have: plants times density of the neighbours.
struct PairSums {
    layout: Measures,
    counts: Vec<f64>,
    by_chance: Vec<f64>,
}

impl PairSums {
    fn new(clusters: usize, species: usize) -> Self {
        let layout = Measures::new(clusters, species);
        let counts = vec![0.0; layout.pairs.len()];
        Self { by_chance: vec![0.0; counts.len() / BINS], counts, layout }
    }

    /// Adds a plot of which so much ground is of each cluster.
    fn add(&mut self, plot: &Measures, area_m2: &[f64]) {
        let sums = self.counts.iter_mut().zip(&plot.pairs);
        sums.for_each(|(sum, count)| *sum += f64::from(*count));
        let species = plot.kinds() - 1;
        for (cluster, area_m2) in area_m2.iter().enumerate() {
            let plants = |of: usize| f64::from(plot.plants[cluster * species + of]);
            for of in 0..species {
                for near in 0..=species {
                    let density =
                        if near == species { 1.0 } else { plants(near) / area_m2.max(1.0) };
                    self.by_chance[plot.pair(cluster, of, near) / BINS] += plants(of) * density;
                }
            }
        }
    }

    /// Neighbours of the plants of a cluster.
    fn of(&self, cluster: usize) -> Vec<Pair> {
        let species = self.layout.kinds() - 1;
        let mut pairs = Vec::new();
        for of in 0..species {
            for near in 0..=species {
                let first = self.layout.pair(cluster, of, near);
                let (counts, by_chance) =
                    (&self.counts[first..first + BINS], self.by_chance[first / BINS]);
                if by_chance > 0.0 && counts.iter().sum::<f64>() >= LEAST_PAIRS {
                    let near_a_plant = |bin: usize| rounded((counts[bin] / by_chance) as f32);
                    pairs.push(Pair {
                        of: of as u16, // biomes have some dozens
                        near: near as u16,
                        near_a_plant: std::array::from_fn(near_a_plant),
                    });
                }
            }
        }
        pairs
    }
}

/// Four significant digits: what the samples carry, and what a file should.
fn rounded(value: f32) -> f32 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{self, Key, Process};

    /// 60 × 60 m, shady in the west, light in the east, one plant a m² there and two here.
    fn sample(biome: &Biome) -> Sample {
        let fern = biome.species_index("western-swordfern").unwrap() as u16;
        let toyon = biome.species_index("toyon").unwrap() as u16;
        let mut plants = Disks::default();
        for entity in 0..6000 {
            let key = Key { seed: 2, process: Process::StrewnPoints, year: 0, month: 0, entity };
            let [across, down, size, which] = rng::uniforms(key);
            let place = [across * 60.0, down * 60.0];
            let height_m = 0.1 + size;
            if place[0] < 30.0 && which < 0.5 {
                plants.push(fern, place, 0.3, height_m);
            } else if place[0] >= 30.0 {
                plants.push(toyon, place, 0.2, 2.0 * height_m);
            }
        }
        Sample {
            rows: 60,
            cols: 60,
            cell_m: 1.0,
            rim_m: 4.0,
            factors: (0..3600)
                .map(|cell| [if cell % 60 < 30 { 2.0 } else { 8.0 }, 80.0, 12.0, 0.1, 0.08])
                .collect(),
            sub_biomes: vec![1; 3600],
            trees: Disks::default(),
            years: vec![(200, plants)],
            plants_by_year: vec![4500],
        }
    }

    #[test]
    fn shade_and_light_are_clusters_with_their_own_plants() {
        let biome = Biome::builtin("sonoma").unwrap();
        let statistics = analyse(&[sample(&biome)], &biome, 1);
        assert_eq!(statistics.clusters.len(), 2);
        for cluster in &statistics.clusters {
            let is_light = cluster.centre[0] > 5.0;
            let expected = if is_light { 6000.0 / 3600.0 } else { 3000.0 / 3600.0 };
            let density = cluster.plants_per_m2(0.08);
            assert!((density / expected - 1.0).abs() < 0.1, "{density}");
            let [species] = cluster.species.as_slice() else { panic!("{:?}", cluster.species) };
            assert_eq!(biome.species[usize::from(species.species)].key == "toyon", is_light);
            let median = species.height_at_m(0.5);
            assert!((median - if is_light { 1.2 } else { 0.6 }).abs() < 0.1, "{median}");
            // strewn at random
            let own = cluster.pairs.iter().find(|pair| pair.of == pair.near).unwrap();
            let touch = if is_light { 0.4_f32 } else { 0.6 };
            let (inner, outer) = (touch + 1.0, touch + 2.0);
            let ring_m2 = std::f32::consts::PI * (outer * outer - inner * inner);
            // what chance has lies in a ring of its area
            let found = own.near_a_plant[6] / ring_m2;
            assert!((found - 1.0).abs() < 0.12, "{found}");
            assert_eq!((cluster.species_from, cluster.pairs_from), (None, None));
        }
        let text = statistics.to_json();
        assert_eq!(Statistics::parse(&text, &biome).unwrap(), statistics);
    }

    #[test]
    fn density_is_proportional_where_seeds_are_few_and_less_where_they_are_many() {
        let at = |chance: f64, plants_per_m2: f64| {
            let plants = (400.0 * plants_per_m2).round() as u64;
            Class { area_m2: 400.0, chance_m2: 400.0 * chance, plants }
        };
        let wanted = |chance: f64| 20.0 * chance / (1.0 + chance / 0.12);
        let chances = [0.005, 0.03, 0.09, 0.2];
        let found = density(&chances.map(|chance| at(chance, wanted(chance))));
        assert!((found.plants_per_m2_and_chance - 20.0).abs() < 1.0, "{found:?}");
        assert!((found.half_chance - 0.12).abs() < 0.01, "{found:?}");
        let none =
            density(&[Class { area_m2: 100.0, chance_m2: 3.0, plants: 0 }, Class::default()]);
        assert_eq!(none.plants_per_m2_and_chance, 0.0);
    }

    #[test]
    fn values_keep_four_digits() {
        assert_eq!([rounded(0.123_456), rounded(98_765.4), rounded(0.0)], [0.1235, 98_770.0, 0.0]);
    }
}
