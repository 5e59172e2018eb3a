//! Measures: how many plants of which species stand in each cluster, and how they lie to each other.

use rayon::prelude::*;

use super::disk_distance::{self, BINS, REACH_M};
use super::disks::Disks;
use crate::plants::buckets::Buckets;

/// Width of the buckets that undergrowth is sought in, m. chosen: half of what a small plant asks for.
pub(super) const BUCKET_M: f32 = 2.0;
/// The same of canopy trees. chosen: a crown.
pub(super) const TREE_BUCKET_M: f32 = 6.0;
/// Undergrowth with a wider crown is sought apart from the rest, m: else all would be sought as far as the widest reach.
pub(super) const WIDE_M: f32 = 0.6;
/// Plants that are measured together. chosen: enough to be worth a thread.
const CHUNK: usize = 4096;

/// Counts by cluster and species, and of pairs by their category.
#[derive(Clone, Debug, PartialEq)]
pub struct Measures {
    species: usize,
    /// Plants by cluster and species.
    pub plants: Vec<u32>,
    /// Pairs by cluster and species of the first plant, by kind of the second ([`Measures::kinds`]), by category.
    pub pairs: Vec<u32>,
}

impl Measures {
    /// Nothing counted.
    pub fn new(clusters: usize, species: usize) -> Self {
        Self {
            species,
            plants: vec![0; clusters * species],
            pairs: vec![0; clusters * species * (species + 1) * BINS],
        }
    }

    /// Kinds of plants that a plant may be near to: each species in the undergrowth, then the canopy.
    pub fn kinds(&self) -> usize {
        self.species + 1
    }

    /// Index of the first category of a pair.
    #[inline]
    pub fn pair(&self, cluster: usize, species: usize, kind: usize) -> usize {
        ((cluster * self.species + species) * self.kinds() + kind) * BINS
    }

    /// Adds what another counted.
    pub fn add(&mut self, other: &Self) {
        let sum = |a: &mut Vec<u32>, b: &Vec<u32>| a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        sum(&mut self.plants, &other.plants);
        sum(&mut self.pairs, &other.pairs);
    }

    /// Counts undergrowth and its neighbours. `cluster_of` gives each plant's cluster; plants without one are seen by others
    /// but not counted.
    pub fn of(
        clusters: usize,
        species: usize,
        undergrowth: &Disks,
        cluster_of: &[Option<u16>],
        trees: &Disks,
    ) -> Self {
        let finder = Finder::new(undergrowth, trees);
        let chunks: Vec<Self> = (0..undergrowth.len().div_ceil(CHUNK))
            .into_par_iter()
            .fold(
                || Self::new(clusters, species),
                |mut counted, chunk| {
                    let plants = cluster_of.iter().enumerate().skip(chunk * CHUNK).take(CHUNK);
                    for (plant, cluster) in plants {
                        let Some(cluster) = *cluster else { continue };
                        counted.count(usize::from(cluster), plant, undergrowth, trees, &finder);
                    }
                    counted
                },
            )
            .collect();
        // whole numbers: the order does not matter
        let mut all = Self::new(clusters, species);
        chunks.iter().for_each(|counted| all.add(counted));
        all
    }

    fn count(
        &mut self,
        cluster: usize,
        plant: usize,
        undergrowth: &Disks,
        trees: &Disks,
        finder: &Finder,
    ) {
        let own = usize::from(undergrowth.species[plant]);
        self.plants[cluster * self.species + own] += 1;
        let at = [undergrowth.east_m[plant], undergrowth.south_m[plant]];
        let radius_m = undergrowth.radius_m[plant];
        let first = self.pair(cluster, own, 0);
        let species = self.species;
        finder.near(at, radius_m, |other, is_tree| {
            let disks = if is_tree { trees } else { undergrowth };
            if !is_tree && other == plant {
                return;
            }
            let (east_m, south_m) = (disks.east_m[other] - at[0], disks.south_m[other] - at[1]);
            let away_m = (east_m * east_m + south_m * south_m).sqrt();
            if let Some(bin) = disk_distance::bin(away_m, radius_m, disks.radius_m[other]) {
                let kind = if is_tree { species } else { usize::from(disks.species[other]) };
                self.pairs[first + kind * BINS + bin] += 1;
            }
        });
    }
}

/// Finds all plants that may be within reach of one.
pub struct Finder {
    narrow: Buckets,
    narrow_indices: Vec<u32>,
    narrow_m: f32,
    wide: Buckets,
    wide_indices: Vec<u32>,
    wide_m: f32,
    trees: Buckets,
    trees_m: f32,
}

impl Finder {
    /// A finder in undergrowth and trees.
    pub fn new(undergrowth: &Disks, trees: &Disks) -> Self {
        let (wide_indices, narrow_indices): (Vec<u32>, Vec<u32>) = (0..undergrowth.len() as u32)
            .partition(|plant| undergrowth.radius_m[*plant as usize] > WIDE_M);
        let buckets = |plants: &[u32]| {
            let of = |measure: &[f32]| -> Vec<f32> {
                plants.iter().map(|plant| measure[*plant as usize]).collect()
            };
            Buckets::new(&of(&undergrowth.east_m), &of(&undergrowth.south_m), BUCKET_M)
        };
        let widest = |plants: &[u32]| {
            plants.iter().map(|plant| undergrowth.radius_m[*plant as usize]).fold(0.0, f32::max)
        };
        Self {
            narrow: buckets(&narrow_indices),
            narrow_m: widest(&narrow_indices),
            wide: buckets(&wide_indices),
            wide_m: widest(&wide_indices),
            narrow_indices,
            wide_indices,
            trees: Buckets::new(&trees.east_m, &trees.south_m, TREE_BUCKET_M),
            trees_m: trees.widest_m(),
        }
    }

    /// Visits whatever may be within reach of a plant at a place: its index, and whether it is a tree.
    #[inline]
    pub fn near(&self, at: [f32; 2], radius_m: f32, mut visit: impl FnMut(usize, bool)) {
        let reach_m = radius_m + REACH_M;
        self.narrow
            .near(at, reach_m + self.narrow_m, |i| visit(self.narrow_indices[i] as usize, false));
        self.wide.near(at, reach_m + self.wide_m, |i| visit(self.wide_indices[i] as usize, false));
        self.trees.near(at, reach_m + self.trees_m, |i| visit(i, true));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{self, Key, Process};

    /// Plants strewn over a square.
    fn strewn(count: u64, side_m: f32, first: u64, widest_m: f32) -> Disks {
        let mut disks = Disks::default();
        for entity in first..first + count {
            let key = Key { seed: 1, process: Process::StrewnPoints, year: 0, month: 0, entity };
            let [a, b, c, d] = rng::uniforms(key);
            disks.push((3.0 * d) as u16, [a * side_m, b * side_m], c * c * widest_m, 1.0);
        }
        disks
    }

    #[test]
    fn every_pair_within_reach_is_counted_in_its_category() {
        let (plants, trees) = (strewn(700, 30.0, 0, 2.0), strewn(20, 30.0, 9000, 5.0));
        let cluster_of: Vec<Option<u16>> =
            (0..700).map(|plant| (plant % 5 > 0).then_some(plant % 2)).collect();
        let counted = Measures::of(2, 3, &plants, &cluster_of, &trees);
        let mut expected = Measures::new(2, 3);
        for (a, cluster) in cluster_of.iter().enumerate() {
            let Some(cluster) = cluster.map(usize::from) else { continue };
            let own = usize::from(plants.species[a]);
            expected.plants[cluster * 3 + own] += 1;
            for (disks, is_tree) in [(&plants, false), (&trees, true)] {
                for b in (0..disks.len()).filter(|b| is_tree || *b != a) {
                    let away_m = ((plants.east_m[a] - disks.east_m[b]).powi(2)
                        + (plants.south_m[a] - disks.south_m[b]).powi(2))
                    .sqrt();
                    let kind = if is_tree { 3 } else { usize::from(disks.species[b]) };
                    let bin = disk_distance::bin(away_m, plants.radius_m[a], disks.radius_m[b]);
                    if let Some(bin) = bin {
                        let pair = expected.pair(cluster, own, kind);
                        expected.pairs[pair + bin] += 1;
                    }
                }
            }
        }
        assert_eq!(counted, expected);
        assert!(expected.pairs.iter().filter(|count| **count > 0).count() > 100);
    }
}
