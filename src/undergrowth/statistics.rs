//! Statistics: what the undergrowth of each cluster is like, as offline simulations left it, and the file they travel in.
//!
//! # Reference
//! Kapp et al. 2020, section 6.2, Analysis, doi:10.1145/3414685.3417848.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::clustering::{self, Scale};
use super::conditions::Factors;
use super::disk_distance::BINS;
use crate::species::Biome;

/// Version of the file's layout; others are refused.
pub const FORMAT: u32 = 1;
/// Values of a size distribution: every twentieth, ends included.
pub const QUANTILES: usize = 21;

/// Statistics of a biome's undergrowth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statistics {
    /// [`FORMAT`].
    pub format: u32,
    /// Key of the biome.
    pub biome: String,
    /// Keys of its species; clusters name them by their place here.
    pub species: Vec<String>,
    /// Keys of its sub-biomes, one bit each.
    pub sub_biomes: Vec<String>,
    /// Lower plants are not counted, and none are made.
    pub least_height_m: f32,
    /// Where they come from.
    pub source: Source,
    /// Unit of distances between conditions.
    pub scale: Scale,
    /// The clusters.
    pub clusters: Vec<Cluster>,
}

/// Where statistics come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// The wildwood that made them.
    pub wildwood_version: String,
    /// Seed of its plots.
    pub seed: u64,
    /// Number of plots.
    pub plots: usize,
    /// Years that plants were counted in.
    pub years: Vec<u16>,
    /// Ground that was counted, in all years together.
    pub area_m2: f64,
    /// Plants that were counted.
    pub plants: u64,
}

/// Undergrowth of ground that is alike.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cluster {
    /// One bit a sub-biome that sheds seeds here.
    pub sub_biomes: u32,
    /// Middle of its factors.
    pub centre: Factors,
    /// Ground that was counted.
    pub area_m2: f32,
    /// Plants that were counted.
    pub plants: u32,
    /// Plants by the chance of seeds.
    pub density: Density,
    /// Its species, in the order of their index.
    pub species: Vec<SpeciesShare>,
    /// The cluster that the species are taken from, if too few plants were counted here.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub species_from: Option<u16>,
    /// Neighbours, in the order of the plants' species and the neighbours' kinds.
    pub pairs: Vec<Pair>,
    /// The cluster that neighbours are taken from, if too few plants were counted here.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pairs_from: Option<u16>,
}

/// Density by the chance of seeds c: s c / (1 + c / h), proportional where seeds are few, and less than that where plants
/// leave seeds no room.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Density {
    /// Plants a m² over the chance a year that a seed sprouts in a simulation cell, where seeds are few: s.
    pub plants_per_m2_and_chance: f32,
    /// Chance at which there are half as many as in proportion: h.
    pub half_chance: f32,
}

/// A species in a cluster.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpeciesShare {
    /// Index of the species.
    pub species: u16,
    /// Its share of the plants.
    pub share: f32,
    /// Heights: every twentieth of the plants, the lowest and the highest included; m.
    pub height_m: Vec<f32>,
    /// Whether heights are those of all clusters, because too few plants were counted here.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub height_of_all: bool,
}

/// Neighbours of a species.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pair {
    /// Index of the plant's species.
    pub of: u16,
    /// Kind of the neighbour: its species, or the number of species for trees of the canopy.
    pub near: u16,
    /// Neighbours that a plant has in each category of disk distance; those of the undergrowth over their density, m²: so
    /// much ground would hold as many. Plots of one cluster differ in density, and neighbours with it.
    pub near_a_plant: [f32; BINS],
}

/// What is wrong with statistics.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum StatisticsError {
    #[error("statistics cannot be read: {problem}; make them anew with `wildwood statistics`")]
    Unreadable { problem: String },
    #[error(
        "statistics are of biome {found}, with other species or sub-biomes than {wanted} has now; make them anew with `wildwood statistics --biome`, which takes a name or a file"
    )]
    OtherBiome { found: String, wanted: String },
    #[error("no statistics are built in for biome `{name}`")]
    NoneBuiltIn { name: String },
}

const BUILT_IN: [(&str, &str); 2] = [
    ("sonoma", include_str!("../../statistics/sonoma.json")),
    ("pyrenees", include_str!("../../statistics/pyrenees.json")),
];

impl Statistics {
    /// Statistics that are part of the program.
    ///
    /// # Errors
    /// If there are none for the biome.
    pub fn builtin(biome: &Biome) -> Result<Self, StatisticsError> {
        Self::parse(Self::builtin_json(biome)?, biome)
    }

    /// Text of statistics that are part of the program.
    ///
    /// # Errors
    /// If there are none for the biome.
    pub fn builtin_json(biome: &Biome) -> Result<&'static str, StatisticsError> {
        let found = BUILT_IN.iter().find(|(name, _)| *name == biome.key);
        let none = || StatisticsError::NoneBuiltIn { name: biome.key.clone() };
        found.map(|(_, text)| *text).ok_or_else(none)
    }

    /// Statistics of a JSON text.
    ///
    /// # Errors
    /// If they are damaged, of another layout, or of another biome.
    pub fn parse(text: &str, biome: &Biome) -> Result<Self, StatisticsError> {
        let unreadable = |problem: String| StatisticsError::Unreadable { problem };
        let read: Self = serde_json::from_str(text).map_err(|e| unreadable(e.to_string()))?;
        if read.format != FORMAT {
            let found = read.format;
            return Err(unreadable(format!("layout {found} where this wildwood knows {FORMAT}")));
        }
        let is_of_biome = read.biome == biome.key
            && read.species.iter().eq(biome.species.iter().map(|species| &species.key))
            && read.sub_biomes.iter().eq(biome.sub_biomes.iter().map(|sub_biome| &sub_biome.key));
        if !is_of_biome {
            let wanted = biome.key.clone();
            return Err(StatisticsError::OtherBiome { found: read.biome, wanted });
        }
        read.check().map_err(|problem| unreadable(problem.to_owned()))?;
        Ok(read)
    }

    /// What a file must hold so that nothing made of it can fail.
    fn check(&self) -> Result<(), &'static str> {
        let is_amount = |value: f32| value.is_finite() && value >= 0.0;
        let is_cluster =
            |index: Option<u16>| index.is_none_or(|i| usize::from(i) < self.clusters.len());
        if self.clusters.is_empty() || self.clusters.len() > usize::from(u16::MAX) {
            return Err("no clusters, or too many");
        }
        if !self.scale.unit.iter().all(|unit| unit.is_finite() && *unit > 0.0) {
            return Err("a scale that is not above 0");
        }
        for cluster in &self.clusters {
            if !cluster.centre.iter().all(|value| value.is_finite()) {
                return Err("a cluster without a centre");
            }
            let Density { plants_per_m2_and_chance, half_chance } = cluster.density;
            if !(is_amount(plants_per_m2_and_chance) && is_amount(half_chance) && half_chance > 0.0)
            {
                return Err("a density that is none");
            }
            for share in &cluster.species {
                let is_known = usize::from(share.species) < self.species.len();
                let heights = &share.height_m;
                let is_sorted = heights.is_sorted() && heights.iter().all(|h| is_amount(*h));
                if !is_known || !is_amount(share.share) || heights.len() != QUANTILES || !is_sorted
                {
                    return Err("a species' share or heights that are none");
                }
            }
            for pair in &cluster.pairs {
                let is_known = usize::from(pair.of) < self.species.len()
                    && usize::from(pair.near) <= self.species.len();
                if !is_known || !pair.near_a_plant.iter().all(|count| is_amount(*count)) {
                    return Err("neighbours that are none");
                }
            }
            if !is_cluster(cluster.species_from) || !is_cluster(cluster.pairs_from) {
                return Err("a cluster that is not there");
            }
        }
        Ok(())
    }

    /// The file's text, a line for each cluster.
    pub fn to_json(&self) -> String {
        let written = "numbers, texts and lists are always JSON";
        let head = serde_json::to_string(&Self { clusters: Vec::new(), ..self.clone() });
        let head = head.expect(written);
        let head = head.trim_end_matches("[]}");
        let line = |cluster| serde_json::to_string(cluster).expect(written);
        let lines: Vec<String> = self.clusters.iter().map(line).collect();
        format!("{head}[\n{}\n]}}\n", lines.join(",\n"))
    }

    /// What a plant in a cluster has for neighbours; the cluster's own, or those it borrows.
    pub fn pairs(&self, cluster: usize) -> &[Pair] {
        let from = self.clusters[cluster].pairs_from.map_or(cluster, usize::from);
        &self.clusters[from].pairs
    }

    /// The species of a cluster; its own, or those it borrows.
    pub fn species(&self, cluster: usize) -> &[SpeciesShare] {
        let from = self.clusters[cluster].species_from.map_or(cluster, usize::from);
        &self.clusters[from].species
    }
}

/// Finds the cluster of a place.
pub struct ClusterFinder<'a> {
    statistics: &'a Statistics,
    /// Clusters of each combination of sub-biomes that was simulated.
    by_sub_biomes: BTreeMap<u32, Vec<usize>>,
    /// Coordinates of each cluster's centre.
    centres: Vec<Factors>,
}

impl<'a> ClusterFinder<'a> {
    /// A finder in statistics.
    pub fn new(statistics: &'a Statistics) -> Self {
        let mut by_sub_biomes: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (index, cluster) in statistics.clusters.iter().enumerate() {
            by_sub_biomes.entry(cluster.sub_biomes).or_default().push(index);
        }
        let centre = |cluster: &Cluster| statistics.scale.coordinates(&cluster.centre);
        let centres = statistics.clusters.iter().map(centre).collect();
        Self { statistics, by_sub_biomes, centres }
    }

    /// The clusters of a combination of sub-biomes; of the most alike one, if it was not simulated.
    pub fn clusters(&self, sub_biomes: u32) -> &[usize] {
        let most_alike = || {
            let apart = |bits: &u32| (bits ^ sub_biomes).count_ones();
            self.by_sub_biomes.iter().min_by_key(|(bits, _)| apart(bits)).map(|(_, c)| c)
        };
        self.by_sub_biomes.get(&sub_biomes).or_else(most_alike).map_or(&[], Vec::as_slice)
    }

    /// The nearest of some clusters.
    #[inline]
    pub fn nearest(&self, at: &Factors, clusters: &[usize]) -> usize {
        let centres = clusters.iter().map(|index| (*index, &self.centres[*index]));
        clustering::nearest(&self.statistics.scale.coordinates(at), centres)
    }
}

impl Cluster {
    /// Plants a m² where seeds sprout with such a chance a year.
    ///
    /// # Reference
    /// Kapp et al. 2020, section 6.2, Sampling: plants taper off with the seeding radii of the canopy.
    /// # Departures
    /// They thin by the chance itself. In dense woods many seedlings find no room, so density follows what was counted at such
    /// chances ([`Density`]).
    #[inline]
    pub fn plants_per_m2(&self, seed_chance: f32) -> f32 {
        let Density { plants_per_m2_and_chance, half_chance } = self.density;
        plants_per_m2_and_chance * seed_chance / (1.0 + seed_chance / half_chance)
    }
}

impl SpeciesShare {
    /// Height that this share of the species' plants does not reach, m.
    pub fn height_at_m(&self, share: f32) -> f32 {
        quantile(&self.height_m, share)
    }
}

impl SpeciesShare {
    /// Share of the species' plants that are lower than that.
    pub fn share_below(&self, limit_m: f32) -> f32 {
        let steps = (QUANTILES - 1) as f32;
        let higher = self.height_m.partition_point(|height_m| *height_m < limit_m);
        if higher == 0 || higher == QUANTILES {
            return higher as f32 / QUANTILES as f32;
        }
        let [low_m, high_m] = [self.height_m[higher - 1], self.height_m[higher]];
        ((higher - 1) as f32 + (limit_m - low_m) / (high_m - low_m)) / steps
    }
}

/// The value that a share of sorted values does not reach; between two, in proportion.
#[inline]
pub fn quantile(sorted: &[f32], share: f32) -> f32 {
    let at = share.clamp(0.0, 1.0) * (sorted.len() - 1) as f32;
    let low = (at as usize).min(sorted.len() - 1);
    let high = (low + 1).min(sorted.len() - 1);
    sorted[low] + (sorted[high] - sorted[low]) * (at - low as f32)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Two clusters of one sub-biome, in shade and in light, and one of two.
    pub fn example(biome: &Biome) -> Statistics {
        let species = |key: &str| biome.species_index(key).unwrap() as u16;
        let share = |key: &str, share: f32, most_m: f32| SpeciesShare {
            species: species(key),
            share,
            height_m: (0..QUANTILES).map(|i| 0.1 + (most_m - 0.1) * i as f32 / 20.0).collect(),
            height_of_all: false,
        };
        let pair = |of: &str, near: &str| Pair {
            of: species(of),
            near: species(near),
            near_a_plant: [0.1, 0.1, 0.2, 0.2, 0.2, 0.4, 1.0, 1.4],
        };
        let cluster = |sub_biomes: u32, sun_h: f32, shares: Vec<SpeciesShare>| Cluster {
            sub_biomes,
            centre: [sun_h, 80.0, 12.0, 0.1, 0.05],
            area_m2: 1000.0,
            plants: 900,
            density: Density { plants_per_m2_and_chance: 40.0, half_chance: 0.05 },
            species: shares,
            species_from: None,
            pairs: vec![pair("western-swordfern", "western-swordfern")],
            pairs_from: None,
        };
        let ferns = vec![share("redwood-sorrel", 0.3, 0.25), share("western-swordfern", 0.7, 1.1)];
        let shrubs = vec![share("toyon", 0.8, 3.0), share("tanoak", 0.2, 2.5)];
        Statistics {
            format: FORMAT,
            biome: biome.key.clone(),
            species: biome.species.iter().map(|species| species.key.clone()).collect(),
            sub_biomes: biome.sub_biomes.iter().map(|sub_biome| sub_biome.key.clone()).collect(),
            least_height_m: 0.1,
            source: Source {
                wildwood_version: "0".to_owned(),
                seed: 1,
                plots: 1,
                years: vec![200],
                area_m2: 3000.0,
                plants: 2700,
            },
            scale: Scale { unit: [4.0, 0.5, 15.0, 1.0, 2.0] },
            clusters: vec![
                cluster(1, 3.0, ferns),
                cluster(1, 8.0, shrubs.clone()),
                cluster(3, 6.0, shrubs),
            ],
        }
    }

    #[test]
    fn a_file_is_read_as_it_was_written_and_bad_ones_are_refused() {
        let biome = Biome::builtin("sonoma").unwrap();
        let statistics = example(&biome);
        let text = statistics.to_json();
        assert_eq!(Statistics::parse(&text, &biome).unwrap(), statistics);
        let pyrenees = Biome::builtin("pyrenees").unwrap();
        let message =
            |text: &str, biome: &Biome| Statistics::parse(text, biome).unwrap_err().to_string();
        assert!(message(&text, &pyrenees).contains("of biome sonoma"));
        assert!(message(&text[..200], &biome).contains("cannot be read"));
        let newer = text.replacen("\"format\":1", "\"format\":9", 1);
        assert!(message(&newer, &biome).contains("layout 9"));
        let negative = text.replacen("_and_chance\":40", "_and_chance\":-40", 1);
        assert!(message(&negative, &biome).contains("a density"));
    }

    #[test]
    fn shares_below_a_limit_are_those_whose_heights_lie_below_it() {
        let biome = Biome::builtin("sonoma").unwrap();
        let share = &example(&biome).clusters[1].species[0];
        assert_eq!([share.share_below(0.05), share.share_below(4.0)], [0.0, 1.0]);
        for limit_m in [0.2, 1.0, 2.9] {
            let below = share.share_below(limit_m);
            assert!((share.height_at_m(below) - limit_m).abs() < 1e-4, "{limit_m}");
        }
    }

    #[test]
    fn density_tapers_with_the_chance_of_seeds() {
        let biome = Biome::builtin("sonoma").unwrap();
        let cluster = &example(&biome).clusters[0];
        for (chance, expected) in [(0.0, 0.0), (0.001, 0.0392), (0.05, 1.0), (0.15, 1.5)] {
            assert!((cluster.plants_per_m2(chance) - expected).abs() < 1e-3, "{chance}");
        }
    }

    #[test]
    fn places_get_the_nearest_cluster_of_their_sub_biomes() {
        let biome = Biome::builtin("sonoma").unwrap();
        let statistics = example(&biome);
        let finder = ClusterFinder::new(&statistics);
        let of = |sun_h: f32, bits: u32| {
            finder.nearest(&[sun_h, 70.0, 11.0, 0.2, 0.05], finder.clusters(bits))
        };
        assert_eq!([of(2.0, 1), of(9.0, 1), of(2.0, 3)], [0, 1, 2]);
        // four and two were never simulated; three of two bits is the nearest that shares one with each
        assert_eq!(finder.clusters(7), [2]);
        assert_eq!(finder.clusters(2), [2]);
    }
}
