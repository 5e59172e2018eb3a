//! Numbers that the two papers choose differently over one set of processes.

use crate::species::Biome;

/// How height follows from idealized age.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GrowthCurve {
    /// Smoothstep to the greatest height at the greatest age (Kapp 2020, Eq. 3, which prints −2x³ + 3x³ for 3x² − 2x³);
    /// herbs saturate.
    ///
    /// # Departures
    /// By Eq. 3 a fern that may live for five years has a tenth of its height in its first year, in which six of ten die
    /// (survivors 0.01): the median fern of a redwood stand had no height, and all ferns together covered 3 % of the
    /// ground. Herbs spread from rhizomes and have their height in the second year, so theirs is the curve of their
    /// species (Peytavie 2024, Eq. 2).
    Smoothstep,
    /// Saturating (Peytavie 2024, Eq. 2), as the species file has it.
    Saturating,
    /// Saturating, and between the laws of plants grown alone and among others, as crowded as a plant is
    /// (Peytavie 2024, Eqs. 1–2): height, crown radius and stem diameter.
    Envelope,
}

/// Where seeds come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Seeding {
    /// From the trees of a fixed canopy, each of its sub-biome (Kapp 2020).
    CanopyTrees,
    /// From a bank of seeds that lies everywhere (Peytavie 2024): a cell without a trunk has
    /// [`Parameters::seed_chance_per_year`], and where a decaying downed log lies this chance a year. Of a biome with several
    /// sub-biomes they are those of the trees that stand nearest.
    Everywhere {
        /// γ of cells with decaying downed logs.
        chance_on_downed_logs_per_year: f32,
        /// γ that each tree within reach gives beside, up to [`Parameters::most_seed_chance_per_year`].
        chance_by_tree_per_year: f32,
        /// γ of ground that no tree's seeds reach, once trees stand somewhere.
        chance_from_afar_per_year: f32,
    },
}

/// How plants compete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Competition {
    /// For the light and the water of the cells under their crowns (Kapp 2020).
    Resources,
    /// By circles that may not meet: where two crowns touch, the lower plant dies; light and water are the canopy's alone.
    /// For comparison (Deussen et al. 1998, doi:10.1145/280814.280898; Kapp 2020, Fig. 20).
    Intersection,
}

/// Parameters of a simulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Width of the cells that plants compete in, m.
    pub cell_m: f32,
    /// Vigor that the carbon pool holds, in months of the best vigor.
    pub pool_capacity: f32,
    /// What a tree of [`Self::full_pool_height_m`] and more holds besides, and lower plants the less.
    pub tree_pool_capacity: f32,
    /// Height from which pools are as large as they get, m.
    pub full_pool_height_m: f32,
    /// Share of a species that reaches its greatest age.
    pub survivors_fraction: f32,
    /// Height by age.
    pub growth: GrowthCurve,
    /// Height at which a plant under the open sky would be canopy, m; the canopy is fixed, so it dies.
    pub open_limit_m: f32,
    /// Chance that a seed sprouts in a cell in a year, for each canopy tree near.
    pub seed_chance_per_year: f32,
    /// Most that the chances of all trees near add up to.
    pub most_seed_chance_per_year: f32,
    /// Where seeds come from.
    pub seeding: Seeding,
    /// How plants compete.
    pub competition: Competition,
    /// Distance up to which that chance holds, in crown radii of the tree.
    pub seed_flat_radii: f32,
    /// Distance at which it has fallen to 0, in crown radii.
    pub seed_reach_radii: f32,
    /// Exponent of the greatest age by which short-lived species sprout more often.
    pub lifespan_exponent: f32,
}

/// Seedlings that sprout in whole forests on bare ground. chosen: twelve times the Pyrenees' rate, so that pioneers of Sonoma,
/// which live for a few years, find each other.
const SEEDLINGS_PER_M2_YEAR: f32 = 0.25;
/// Seedlings on ground that no tree's seeds reach, once trees stand. chosen: the Pyrenees' rate; with that of bare ground the open
/// parts of a savanna fill with shrubs at once.
const FAR_SEEDLINGS_PER_M2_YEAR: f32 = 0.02;
/// Most that sprout among trees. chosen: the undergrowth of a grown scene stays as dense as it was, within 30 %; with 1, herbs
/// halve, with 0.25 they fall to a fifth.
const MOST_SEEDLINGS_PER_M2_YEAR: f32 = 3.0;

impl Parameters {
    /// Undergrowth under a fixed canopy.
    ///
    /// # Reference
    /// Kapp et al. 2020, section 6.1: cells of 20 cm, three months of the greatest stress (0.2) in the pool, survivors
    /// 0.01, seeding 0.003 flat to 4 r and falling to 0 at 12 r, exponent 1.2. Where no crown stands above, undergrowth ends
    /// at the least height of canopy, 3 m: taller plants there would have been seen from above.
    pub fn kapp2020() -> Self {
        Self {
            cell_m: 0.2,
            pool_capacity: 0.6,
            tree_pool_capacity: 0.0,
            full_pool_height_m: 10.0,
            survivors_fraction: 0.01,
            growth: GrowthCurve::Smoothstep,
            open_limit_m: 3.0,
            seed_chance_per_year: 0.003,
            most_seed_chance_per_year: 1.0,
            seeding: Seeding::CanopyTrees,
            competition: Competition::Resources,
            seed_flat_radii: 4.0,
            seed_reach_radii: 12.0,
            lifespan_exponent: 1.2,
        }
    }

    /// Vigor that the pool of a plant of this height holds, in months of the best vigor.
    #[inline]
    pub fn pool_capacity_of(&self, height_m: f32) -> f32 {
        self.pool_capacity + self.tree_pool_capacity * (height_m / self.full_pool_height_m).min(1.0)
    }

    /// Undergrowth of a biome: [`Self::kapp2020`], with no more seedlings than sprout there.
    pub fn undergrowth(biome: &Biome) -> Self {
        let parameters = Self::kapp2020();
        let cell_m2 = parameters.cell_m * parameters.cell_m;
        let most_seed_chance_per_year = (biome.most_seedlings_per_m2_year * cell_m2).min(1.0);
        Self { most_seed_chance_per_year, ..parameters }
    }

    /// Whole forests of a biome: [`Self::peytavie2024`], with as many seedlings as sprout there.
    ///
    /// # Departures
    /// Their rate, 0.02 seedlings on a m² in a year, is the Pyrenees', which [`Biome::most_seedlings_per_m2_year`] has. Where herbs
    /// take most of the places, as in Sonoma, it keeps neither ferns nor trees. There each tree within reach adds its seeds, as
    /// for undergrowth ([`Self::kapp2020`]), and bare ground has more than the Pyrenees'.
    pub fn forest(biome: &Biome) -> Self {
        let parameters = Self::peytavie2024();
        let cell_m2 = parameters.cell_m * parameters.cell_m;
        let at_most =
            |per_m2_year: f32| biome.most_seedlings_per_m2_year.min(per_m2_year) * cell_m2;
        let chance = at_most(SEEDLINGS_PER_M2_YEAR);
        let Seeding::Everywhere { chance_on_downed_logs_per_year: nursed, .. } = parameters.seeding
        else {
            return parameters;
        };
        let undergrowth = Self::kapp2020();
        let by_tree =
            undergrowth.seed_chance_per_year / (undergrowth.cell_m * undergrowth.cell_m) * cell_m2;
        let seeding = Seeding::Everywhere {
            chance_on_downed_logs_per_year: (chance * nursed / parameters.seed_chance_per_year)
                .min(1.0),
            chance_by_tree_per_year: by_tree,
            chance_from_afar_per_year: at_most(FAR_SEEDLINGS_PER_M2_YEAR),
        };
        Self {
            seed_chance_per_year: chance,
            most_seed_chance_per_year: at_most(MOST_SEEDLINGS_PER_M2_YEAR),
            seeding,
            ..parameters
        }
    }

    /// Whole forests of the Pyrenees.
    ///
    /// # Reference
    /// Peytavie et al. 2024, section 5, and what their program ran (PAPER_NOTES §7, §10): cells of 50 cm, a pool of 1,
    /// germination of 0.005 per cell and year, 0.0279 on downed logs.
    /// # Departures
    /// Their pool is 1 for seedling and tree alike: five bad months empty it, and the dry season of a Mediterranean summer, which
    /// has six, killed half of any grown forest within five years. Trees store carbon to leaf out several times over: theirs
    /// is 2.5. chosen: a year of the greatest stress.
    pub fn peytavie2024() -> Self {
        Self {
            cell_m: 0.5,
            pool_capacity: 1.0,
            tree_pool_capacity: 1.5,
            growth: GrowthCurve::Envelope,
            open_limit_m: f32::INFINITY,
            seed_chance_per_year: 0.005,
            seeding: Seeding::Everywhere {
                chance_on_downed_logs_per_year: 0.0279,
                chance_by_tree_per_year: 0.0,
                chance_from_afar_per_year: 0.005,
            },
            ..Self::kapp2020()
        }
    }
}
