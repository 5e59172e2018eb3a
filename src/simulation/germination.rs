//! Germination: once a year a seed may sprout in each cell; which species it is follows from what all plants leave there.
//!
//! # Reference
//! Kapp et al. 2020, section 6.1, Eq. 4, doi:10.1145/3414685.3417848.

use super::competition::CellStates;
use super::plot::Plot;
use super::traits::Traits;
use super::vigor;
use crate::rng::{self, Key, Process};

/// A plant that has just sprouted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seedling {
    /// Unique in a simulation: the year, then the cell.
    pub id: u64,
    /// Index of its species.
    pub species: u16,
    /// Metres east of the plot's corner.
    pub east_m: f32,
    /// Metres south of it.
    pub south_m: f32,
}

/// Species that may sprout somewhere, those that sprout the most first: what a choice among them is likely to need.
#[derive(Default)]
struct Candidates {
    sub_biomes: u32,
    species: Vec<u16>,
    /// Most that the species from each one on may weigh together; one longer.
    weight_at_most: Vec<f32>,
}

impl Candidates {
    fn of(sub_biomes: u32, traits: &[Traits]) -> Self {
        let in_them = |index: &usize| traits[*index].sub_biomes & sub_biomes != 0;
        let mut species: Vec<usize> = (0..traits.len()).filter(in_them).collect();
        let most = |index: usize| traits[index].seed_weight;
        species.sort_by(|a, b| most(*b).total_cmp(&most(*a)));
        let mut weight_at_most = vec![0.0; species.len() + 1];
        for (place, index) in species.iter().enumerate().rev() {
            weight_at_most[place] = weight_at_most[place + 1] + most(*index);
        }
        let species = species.into_iter().map(|index| index as u16).collect(); // biomes have some dozens
        Self { sub_biomes, species, weight_at_most }
    }
}

/// The seedlings of a tile's cells in a year.
pub fn sprout(
    cells: &CellStates,
    plot: &Plot,
    traits: &[Traits],
    seed: u64,
    year: u16,
) -> Vec<Seedling> {
    let tile = cells.tile();
    let mut seedlings = Vec::new();
    let mut candidates = Candidates::default();
    let mut sums = Vec::new();
    for cell in 0..tile.rows * tile.cols {
        let seeds = plot.seeds[cells.ground_at(cell)];
        if seeds.chance_per_year <= 0.0 {
            continue;
        }
        let (row, col) = (tile.row + cell / tile.cols, tile.col + cell % tile.cols);
        // plots have fewer than 2³² cells
        let entity =
            rng::entity_of_cell(plot.first_east + col as i64, -(plot.first_south + row as i64));
        let key = Key { seed, process: Process::Germination, year, month: 0, entity };
        let [chance, choice, across, down] = rng::uniforms(key);
        if chance >= seeds.chance_per_year {
            continue;
        }
        if candidates.sub_biomes != seeds.sub_biomes {
            candidates = Candidates::of(seeds.sub_biomes, traits);
        }
        let weigh = |place: usize| {
            let traits = &traits[usize::from(candidates.species[place])];
            weight(cells, cell, plot, traits)
        };
        let Some(place) = roulette(&candidates.weight_at_most, choice, &mut sums, weigh) else {
            continue;
        };
        seedlings.push(Seedling {
            id: u64::from(year) << 32 | (row * plot.cols + col) as u64,
            species: candidates.species[place],
            east_m: (col as f32 + across) * plot.cell_m,
            south_m: (row as f32 + down) * plot.cell_m,
        });
    }
    seedlings
}

/// How likely a species is among those that sprout: its mean vigor over the growing season on what plants leave to seeds,
/// and the more the sooner it bears seeds; at most its `seed_weight`.
///
/// # Reference
/// Kapp et al. 2020, Eq. 4: w = max(0, v̄ / m^β).
fn weight(cells: &CellStates, cell: usize, plot: &Plot, traits: &Traits) -> f32 {
    let ground = &plot.ground[cells.ground_at(cell)];
    if vigor::is_too_steep(traits, ground.slope_rad) {
        return 0.0;
    }
    let (light, water_mm) = (cells.light_at(cell), cells.seed_water_mm(cell, plot));
    let by_month = vigor::by_month(traits, ground, light, &water_mm);
    // years a month are equal within the season, 0 outside, and 1 together
    let in_season = |month: usize| by_month[month] * traits.years_a_month[month];
    let quarters: [f32; 4] =
        std::array::from_fn(|month| in_season(month) + in_season(month + 4) + in_season(month + 8));
    let mean = (quarters[0] + quarters[1]) + (quarters[2] + quarters[3]);
    (mean * traits.seed_weight).max(0.0)
}

/// An index, each as likely as its weight; none if all are 0.
///
/// Weights are asked for one after the other, only until those that are left cannot change the choice:
/// `weight_at_most` has the most that they may be together, from each index on. `sums` is room to work in.
fn roulette(
    weight_at_most: &[f32],
    choice: f32,
    sums: &mut Vec<f32>,
    mut weigh: impl FnMut(usize) -> f32,
) -> Option<usize> {
    sums.clear();
    let mut total = 0.0;
    for (index, most_left) in weight_at_most.iter().skip(1).enumerate() {
        total += weigh(index);
        sums.push(total);
        let chosen = |point: f32| sums.iter().position(|sum| *sum > point);
        let sure = chosen(choice * (total + most_left)).filter(|_| total > 0.0);
        if sure.is_some() && sure == chosen(choice * total) {
            return sure;
        }
    }
    // rounding may put the point on the total: the last that weighs anything
    sums.iter().position(|sum| *sum == total).filter(|_| total > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(weights: &[f32], at_most: f32, choice: f32) -> (Option<usize>, usize) {
        let count = weights.len();
        let left: Vec<f32> = (0..=count).map(|index| at_most * (count - index) as f32).collect();
        let mut asked = 0;
        let index = roulette(&left, choice, &mut Vec::new(), |index| {
            asked += 1;
            weights[index]
        });
        (index, asked)
    }

    #[test]
    fn roulette_gives_each_its_share_and_nothing_of_nothing() {
        let weights = [0.0, 1.0, 0.0, 3.0, 0.0];
        for at_most in [3.0, 100.0] {
            let mut counts = [0; 5];
            for draw in 0..1000 {
                counts[chosen(&weights, at_most, draw as f32 / 1000.0).0.unwrap()] += 1;
            }
            assert_eq!(counts, [0, 250, 0, 750, 0]);
        }
        assert_eq!(chosen(&[0.0; 3], 1.0, 0.5).0, None);
        assert_eq!(chosen(&[0.2, 0.0], 0.2, 0.999_999_94).0, Some(0));
    }

    #[test]
    fn roulette_asks_for_no_more_weights_than_the_choice_needs() {
        assert_eq!(chosen(&[1.0, 0.5, 0.1, 0.1], 0.1, 0.3), (Some(0), 1));
        assert_eq!(chosen(&[1.0, 0.5, 0.1, 0.1], 0.1, 0.7), (Some(1), 2));
        assert_eq!(chosen(&[1.0, 0.5, 0.1, 0.1], 0.1, 0.99), (Some(3), 4));
    }
}
