//! Keyed random numbers: Philox4x32-10.
//!
//! A draw is a function of (seed, process, year, month, entity) alone, so results depend on neither
//! thread count, nor tile layout, nor order. Entities on the grid are keyed by their absolute map cell.
//!
//! # Reference
//! Salmon et al. 2011, "Parallel random numbers: as easy as 1, 2, 3", SC'11, doi:10.1145/2063384.2063405.

/// What a draw is for; each process has draws of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
#[non_exhaustive]
pub enum Process {
    /// Gradients of the demo terrain's noise.
    TerrainNoise = 1,
    /// Small deviations of vigor in the species map.
    SpeciesMosaic = 20,
    /// Pulses over a made-up forest.
    SyntheticPulse = 90,
    /// Trees of a made-up forest.
    SyntheticTree = 91,
    /// Where trees of a generated canopy may stand.
    CanopyLattice = 93,
    /// Size and form of a generated canopy's trees.
    CanopyTree = 94,
    /// Leaves and twigs of a generated canopy, cell by cell.
    CanopyRoughness = 95,
    /// Where trees of a learned canopy may stand, and their size and form.
    CanopyDetailLattice = 96,
    /// Leaves, twigs and undergrowth of a learned canopy, cell by cell.
    CanopyDetailRoughness = 97,
    /// What one footprint has that another of the same sketch has not.
    FootprintNoise = 98,
    /// What one canopy height has that another of the same footprint has not.
    HeightNoise = 99,
    /// How stand height deviates from place to place.
    StandHeight = 100,
    /// Whether a seed sprouts in a cell, which and where.
    Germination = 40,
    /// Whether a plant lives through a year.
    PlantDeath = 41,
    /// Which cells a fire spreads to.
    Wildfire = 42,
    /// What a storm does to a tree.
    StormDamage = 43,
    /// Who catches a disease.
    Disease = 44,
    /// Which years have events that recur.
    DisturbanceSchedule = 45,
    /// How a dead stem breaks and falls.
    SnagDecay = 46,
    /// Where a branch falls.
    FallingBranch = 47,
    /// How strong a tree's roots and wood are.
    StemStrength = 48,
    /// First centres of clusters.
    Clustering = 50,
    /// Number of undergrowth plants in a cell.
    UndergrowthCount = 51,
    /// Species, size and places to try of an undergrowth plant.
    UndergrowthPlant = 52,
    /// Changes that refinement tries.
    UndergrowthRefinement = 53,
    /// Made-up ground that statistics are simulated on.
    StatisticsPlot = 54,
    /// Points of Poisson-disk tiles.
    PoissonTile = 60,
    /// Colours of the corners between Poisson-disk tiles.
    PoissonCorner = 61,
    /// Shape of a plant's model.
    ModelShape = 70,
    /// Which of its species' models stands for a plant, how it is turned and tinted.
    ModelChoice = 71,
    /// Points that tests strew.
    StrewnPoints = 92,
}

/// The key of a draw. Equal keys give equal draws, on every machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key {
    /// The user's seed.
    pub seed: u64,
    /// What the draw is for.
    pub process: Process,
    /// Simulation year, 0 outside a simulation.
    pub year: u16,
    /// Month 1–12, 0 outside a month.
    pub month: u8,
    /// A plant's id, or a cell's absolute map position packed by [`entity_of_cell`].
    pub entity: u64,
}

/// Packs absolute map cell coordinates (cells east and north of the CRS origin) into an entity.
#[inline]
pub fn entity_of_cell(cell_east: i64, cell_north: i64) -> u64 {
    // two's complement: the low 32 bits tell cells apart within ±2³¹
    ((cell_east as u64) << 32) | (cell_north as u64 & 0xffff_ffff)
}

/// Four independent words, each uniform over all 32-bit values.
#[inline]
pub fn words(key: Key) -> [u32; 4] {
    let counter = [
        key.entity as u32, // low half
        (key.entity >> 32) as u32,
        u32::from(key.year) | u32::from(key.month) << 16,
        u32::from(key.process as u16),
    ];
    philox4x32_10(counter, [key.seed as u32, (key.seed >> 32) as u32])
}

/// Four independent numbers, each uniform in 0..1.
#[inline]
pub fn uniforms(key: Key) -> [f32; 4] {
    words(key).map(unit_interval)
}

/// A uniform number of mean 0 and deviation 1: between −√3 and √3.
pub fn centred_uniform(key: Key) -> f32 {
    const ROOT_OF_3: f32 = 1.732_050_8;
    (2.0 * uniforms(key)[0] - 1.0) * ROOT_OF_3
}

/// Maps a uniform word to 0..1; 24 bits, so that 1 is never reached.
#[inline]
pub fn unit_interval(word: u32) -> f32 {
    (word >> 8) as f32 * (1.0 / 16_777_216.0) // 24 bits are exact in f32
}

#[inline]
fn philox4x32_10(mut counter: [u32; 4], mut key: [u32; 2]) -> [u32; 4] {
    const MULTIPLIERS: [u64; 2] = [0xD251_1F53, 0xCD9E_8D57];
    const WEYL: [u32; 2] = [0x9E37_79B9, 0xBB67_AE85];
    for _ in 0..10 {
        let a = MULTIPLIERS[0] * u64::from(counter[0]);
        let b = MULTIPLIERS[1] * u64::from(counter[2]);
        counter = [
            (b >> 32) as u32 ^ counter[1] ^ key[0],
            b as u32,
            (a >> 32) as u32 ^ counter[3] ^ key[1],
            a as u32,
        ];
        key = [key[0].wrapping_add(WEYL[0]), key[1].wrapping_add(WEYL[1])];
    }
    counter
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn philox_matches_the_published_vectors() {
        // Random123 1.09, kat_vectors, "philox4x32 10"
        assert_eq!(
            philox4x32_10([0; 4], [0; 2]),
            [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]
        );
        assert_eq!(
            philox4x32_10([u32::MAX; 4], [u32::MAX; 2]),
            [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]
        );
        assert_eq!(
            philox4x32_10(
                [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344],
                [0xa409_3822, 0x299f_31d0]
            ),
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
        );
    }

    #[test]
    fn uniforms_fill_the_unit_interval_evenly() {
        let key =
            |entity| Key { seed: 7, process: Process::TerrainNoise, year: 0, month: 0, entity };
        let mean = (0..10_000).map(|e| f64::from(uniforms(key(e))[0])).sum::<f64>() / 10_000.0;
        // standard error of the mean of 10,000 uniforms is 0.0029
        assert!((mean - 0.5).abs() < 0.012, "mean {mean}");
        assert_eq!(unit_interval(0), 0.0);
        assert!(unit_interval(u32::MAX) < 1.0);
    }

    #[test]
    fn cells_west_and_south_of_the_origin_are_entities_of_their_own() {
        let all = [(1, 2), (2, 1), (-1, 2), (1, -2), (-1, -2)].map(|(e, n)| entity_of_cell(e, n));
        for (i, a) in all.iter().enumerate() {
            assert!(all.iter().skip(i + 1).all(|b| a != b));
        }
    }
}
