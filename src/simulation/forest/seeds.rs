//! Seeds of a forest: of which sub-biomes, and how many, by the trees that stand near.
//!
//! A bank of seeds of all species lies on bare ground (Peytavie et al. 2024). Once trees stand, ground within reach of them has
//! seeds of their sub-biomes, and the more the more trees there are (Kapp et al. 2020); ground beyond has a few of the nearest's.
//! Without this, redwoods come up all over a savanna that is wet enough for them.
//!
//! # Departures
//! Peytavie et al. have the bank everywhere and always. Here one tree ends it for the whole scene, whose ground then has few seeds far
//! from any: what the terrain lacks comes back from its edges.
//!
//! # Reference
//! Kapp et al. 2020, section 6.1, Seeding, doi:10.1145/3414685.3417848; Peytavie et al. 2024, section 5.1, doi:10.1145/3641816.

use rayon::prelude::*;

use crate::simulation::parameters::Seeding;
use crate::simulation::seedbank::{self, Seeds};
use crate::simulation::{Community, Parameters, disk_span};
use crate::species::Biome;

/// Least height of trees that bear seeds, m. chosen: where canopy begins.
const LEAST_HEIGHT_M: f32 = 3.0;
/// Least width of the blocks that seeds are counted in, m. chosen: two radii of a small tree, whose seeds reach over six blocks.
const LEAST_BLOCK_M: f32 = 8.0;
/// Rows of blocks that are worked on together. chosen: enough strips for the cores of a desk.
const STRIP_ROWS: usize = 8;

/// A tree that bears seeds.
#[derive(Clone, Copy)]
struct SeedTree {
    east_m: f32,
    south_m: f32,
    crown_radius_m: f32,
    sub_biome: u32,
}

/// Seeds by block of ground cells.
pub(super) struct SeedMap {
    /// Ground cells on each side of a block.
    side: usize,
    rows: usize,
    cols: usize,
    block_m: f32,
    blocks: Vec<Seeds>,
}

impl SeedMap {
    /// Seeds of a community's trees; chances are counted in those of bare ground.
    pub fn of(community: &Community, biome: &Biome) -> Self {
        let ([ground_rows, ground_cols], ground_m) = community.plot().ground_size();
        let side = (LEAST_BLOCK_M / ground_m).ceil().max(1.0) as usize;
        let (rows, cols) = (ground_rows.div_ceil(side), ground_cols.div_ceil(side));
        let mut map = Self {
            side,
            rows,
            cols,
            block_m: ground_m * side as f32,
            blocks: vec![Seeds::default(); rows * cols],
        };
        map.sow(&bearing(community, biome), community.parameters());
        map.spread();
        map
    }

    /// Seeds of a ground cell.
    #[inline]
    pub fn at(&self, row: usize, col: usize) -> Seeds {
        self.blocks[row / self.side * self.cols + col / self.side]
    }

    fn sow(&mut self, bearing: &[SeedTree], parameters: &Parameters) {
        let Seeding::Everywhere { chance_by_tree_per_year, chance_from_afar_per_year, .. } =
            parameters.seeding
        else {
            return;
        };
        let share = |chance_per_year: f32| chance_per_year / parameters.seed_chance_per_year;
        let (by_tree, least) = (share(chance_by_tree_per_year), share(chance_from_afar_per_year));
        let most = share(parameters.most_seed_chance_per_year);
        let (rows, cols, block_m) = (self.rows, self.cols, self.block_m);
        let strips = self.blocks.par_chunks_mut(STRIP_ROWS * cols).enumerate();
        strips.for_each(|(strip, blocks)| {
            let (first, count) = (strip * STRIP_ROWS, blocks.len() / cols);
            for tree in bearing {
                // as far as the middle of its own block at least, so that the narrowest tree is told of
                let reach_m =
                    (parameters.seed_reach_radii * tree.crown_radius_m).max(0.75 * block_m);
                let reached = disk_span(tree.south_m, reach_m, rows, block_m);
                for row in reached.start.max(first)..reached.end.min(first + count) {
                    let south_m = (row as f32 + 0.5) * block_m - tree.south_m;
                    let half_m = (reach_m * reach_m - south_m * south_m).max(0.0).sqrt();
                    for col in disk_span(tree.east_m, half_m, cols, block_m) {
                        let east_m = (col as f32 + 0.5) * block_m - tree.east_m;
                        let away_m = (south_m * south_m + east_m * east_m).sqrt();
                        let block = &mut blocks[(row - first) * cols + col];
                        block.chance_per_year +=
                            by_tree * seedbank::share_at(away_m / tree.crown_radius_m, parameters);
                        block.sub_biomes |= 1 << tree.sub_biome;
                    }
                }
            }
            for block in blocks {
                block.chance_per_year = block.chance_per_year.max(least).min(most);
            }
        });
    }

    /// Gives blocks that no tree reaches the sub-biomes of the nearest that one does; all seeds if none does.
    fn spread(&mut self) {
        let (rows, cols) = (self.rows, self.cols);
        let mut front: Vec<usize> =
            (0..rows * cols).filter(|block| self.blocks[*block].sub_biomes != 0).collect();
        if front.is_empty() {
            self.blocks.fill(Seeds::EVERYWHERE);
            return;
        }
        // ring by ring; blocks that several reach at once take from all
        let mut is_done: Vec<bool> =
            self.blocks.iter().map(|seeds| seeds.sub_biomes != 0).collect();
        while !front.is_empty() {
            let mut next = Vec::new();
            for block in &front {
                let (row, col, from) = (block / cols, block % cols, self.blocks[*block].sub_biomes);
                for near_row in row.saturating_sub(1)..(row + 2).min(rows) {
                    for near_col in col.saturating_sub(1)..(col + 2).min(cols) {
                        let near = near_row * cols + near_col;
                        if !is_done[near] {
                            if self.blocks[near].sub_biomes == 0 {
                                next.push(near);
                            }
                            self.blocks[near].sub_biomes |= from;
                        }
                    }
                }
            }
            next.iter().for_each(|block| is_done[*block] = true);
            front = next;
        }
    }
}

/// Trees that bear seeds, in the order of the community.
fn bearing(community: &Community, biome: &Biome) -> Vec<SeedTree> {
    let is_tall = |plant: &usize| community.height_m[*plant] >= LEAST_HEIGHT_M;
    let tree = |plant: usize| {
        let species = &biome.species[usize::from(community.species[plant])];
        species.canopy_sub_biome.map(|sub_biome| SeedTree {
            east_m: community.east_m[plant],
            south_m: community.south_m[plant],
            crown_radius_m: community.crown_radius_m[plant],
            sub_biome: sub_biome as u32, // biomes have a handful
        })
    };
    (0..community.len()).filter(is_tall).filter_map(tree).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::MONTHS;
    use crate::simulation::Plot;
    use crate::simulation::plot::GroundCell;

    /// Seeds on 200 × 200 m with trees of these sub-biomes, 20 m high, at these places.
    fn seeds_among(trees: &[(usize, [f32; 2])]) -> (SeedMap, Parameters) {
        let biome = Biome::builtin("sonoma").unwrap();
        let parameters = Parameters::forest(&biome);
        let cell = GroundCell {
            sun_h: [8.0; MONTHS],
            moisture_mm: [60.0; MONTHS],
            temperature_c: [15.0; MONTHS],
            slope_rad: 0.0,
        };
        let plot = Plot::new([100, 100], 2.0, vec![cell; 10_000], &[], &biome, &parameters);
        let mut community = Community::new(plot, &biome, parameters, 1);
        for (index, (sub_biome, at)) in trees.iter().enumerate() {
            let species = biome.sub_biomes[*sub_biome].canopy[0] as u16;
            community.plant(index as u64, species, *at, 60.0);
            (community.height_m[index], community.crown_radius_m[index]) = (20.0, 2.0);
        }
        (SeedMap::of(&community, &biome), parameters)
    }

    #[test]
    fn bare_ground_has_all_seeds() {
        let (seeds, _) = seeds_among(&[]);
        assert!(seeds.blocks.iter().all(|block| *block == Seeds::EVERYWHERE));
    }

    #[test]
    fn ground_has_the_seeds_of_trees_within_reach_else_of_the_nearest() {
        let (seeds, _) = seeds_among(&[(0, [30.0, 100.0]), (2, [170.0, 100.0])]);
        let sub_biomes = |east_m: f32| seeds.at(50, (east_m / 2.0) as usize).sub_biomes;
        assert_eq!([sub_biomes(30.0), sub_biomes(2.0), sub_biomes(90.0)], [1; 3]);
        assert_eq!([sub_biomes(170.0), sub_biomes(198.0), sub_biomes(112.0)], [4; 3]);
        // two that overlap give both
        let (seeds, _) = seeds_among(&[(0, [90.0, 100.0]), (2, [110.0, 100.0])]);
        assert_eq!(seeds.at(50, 50).sub_biomes, 5);
    }

    #[test]
    fn the_narrowest_tree_seeds_its_own_block() {
        let biome = Biome::builtin("sonoma").unwrap();
        let (_, parameters) = seeds_among(&[]);
        let cell = GroundCell {
            sun_h: [8.0; MONTHS],
            moisture_mm: [60.0; MONTHS],
            temperature_c: [15.0; MONTHS],
            slope_rad: 0.0,
        };
        let plot = Plot::new([8, 8], 2.0, vec![cell; 64], &[], &biome, &parameters);
        let mut community = Community::new(plot, &biome, parameters, 1);
        community.plant(1, biome.sub_biomes[2].canopy[0] as u16, [0.1, 0.1], 60.0);
        (community.height_m[0], community.crown_radius_m[0]) = (4.0, 0.1);
        let seeds = SeedMap::of(&community, &biome);
        assert!(seeds.blocks.iter().all(|block| block.sub_biomes == 4), "{:?}", seeds.blocks);
    }

    #[test]
    fn trees_add_their_seeds_up_to_the_most() {
        let at = |count: usize| {
            let (seeds, parameters) = seeds_among(&vec![(0, [100.0, 100.0]); count]);
            let share = seeds.at(50, 50).chance_per_year;
            share * parameters.seed_chance_per_year / (parameters.cell_m * parameters.cell_m)
        };
        // seedlings on a m² in a year: a tree gives 0.075 (0.003 in 0.04 m²)
        for (trees, seedlings) in [(1, 0.075), (10, 0.75), (100, 3.0)] {
            assert!((at(trees) - seedlings).abs() < 1e-5, "{trees}: {}", at(trees));
        }
        // ground that none reaches has some, bare ground more
        let (seeds, _) = seeds_among(&[(0, [30.0, 100.0])]);
        assert!((seeds.at(50, 90).chance_per_year - 0.08).abs() < 1e-6);
    }
}
