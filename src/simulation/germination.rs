//! Germination: once a year a seed may sprout in each cell; which species it is follows from what all plants leave there.
//!
//! # Reference
//! Kapp et al. 2020, section 6.1, Eq. 4, doi:10.1145/3414685.3417848.

use super::competition::CellStates;
use super::parameters::{Parameters, Seeding};
use super::plot::Plot;
use super::traits::Traits;
use super::vigor::{Limits, Offer};
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

/// Where and when seeds sprout.
#[derive(Clone, Copy)]
pub struct Sowing<'a> {
    pub plot: &'a Plot,
    pub traits: &'a [Traits],
    pub parameters: &'a Parameters,
    /// Whether a decaying downed log lies on each cell of the plot; empty where there is none.
    pub downed_logs: &'a [bool],
    pub seed: u64,
    pub year: u16,
    /// Added to the ids of seedlings.
    pub first_id: u64,
}

/// The seedlings of a tile's cells in a year.
///
/// # Reference
/// Peytavie et al. 2024, section 5.1, where seeds lie everywhere: a cell with a trunk has none; a seed that is drawn
/// sprouts with the best vigor of all species; α counts where a decaying downed log lies.
pub fn sprout(cells: &CellStates, trunks: &[bool], sowing: &Sowing) -> Vec<Seedling> {
    let Sowing { plot, traits, parameters, seed, year, .. } = *sowing;
    let tile = cells.tile();
    let mut candidates = Candidates::of(traits);
    let mut draws = Vec::with_capacity(tile.cols);
    let mut seedlings = Vec::new();
    for row in tile.row..tile.row + tile.rows {
        // a row's draws together: one by one they would wait for each other
        draws.clear();
        draws.extend((tile.col..tile.col + tile.cols).map(|col| {
            // plots have fewer than 2³² cells
            let entity =
                rng::entity_of_cell(plot.first_east + col as i64, -(plot.first_south + row as i64));
            rng::uniforms(Key { seed, process: Process::Germination, year, month: 0, entity })
        }));
        for (col, [chance, choice, across, down]) in (tile.col..).zip(draws.iter().copied()) {
            let cell = (row - tile.row) * tile.cols + col - tile.col;
            let seeds = plot.seeds[cells.ground_at(cell)];
            let mut nursed = false;
            let chance_per_year = match parameters.seeding {
                Seeding::CanopyTrees => seeds.chance_per_year,
                Seeding::Everywhere { .. } if trunks[cell] => 0.0,
                Seeding::Everywhere { chance_on_downed_logs_per_year, .. } => {
                    nursed = sowing.downed_logs.get(row * plot.cols + col) == Some(&true);
                    let chance = if nursed {
                        chance_on_downed_logs_per_year
                    } else {
                        parameters.seed_chance_per_year
                    };
                    // among many trees it would pass 1 on downed logs, and vigor would decide nothing
                    (seeds.chance_per_year * chance).min(1.0)
                }
            };
            if chance >= chance_per_year {
                continue;
            }
            let ground = &plot.ground[cells.ground_at(cell)];
            let offer = Offer::new(ground, cells.light_at(cell), cells.seed_water_mm(cell, plot));
            candidates.find(&offer, seeds.sub_biomes);
            let species = match parameters.seeding {
                Seeding::CanopyTrees => candidates.choose(&offer, traits, choice),
                // of those that are below it, the draw is uniform up to the chance
                Seeding::Everywhere { .. } => {
                    let acceptance = chance / chance_per_year;
                    candidates.choose_where_it_thrives(&offer, traits, nursed, acceptance, choice)
                }
            };
            let Some(species) = species else { continue };
            seedlings.push(Seedling {
                id: sowing.first_id + (u64::from(year) << 32 | (row * plot.cols + col) as u64),
                species,
                east_m: (col as f32 + across) * plot.cell_m,
                south_m: (row as f32 + down) * plot.cell_m,
            });
        }
    }
    seedlings
}

/// Species that a seed may be, those that sprout the most first: a choice is likely to need the first few only.
struct Candidates {
    all: Vec<Candidate>,
    /// Places in `all` of those that a cell may suit.
    found: Vec<u16>,
    /// Most that these, from each one on, may weigh together; one longer.
    weight_at_most: Vec<f32>,
    /// Room for their weights.
    sums: Vec<f32>,
}

struct Candidate {
    species: u16,
    sub_biomes: u32,
    seed_weight: f32,
    limits: Limits,
}

impl Candidates {
    fn of(traits: &[Traits]) -> Self {
        let candidate = |(index, traits): (usize, &Traits)| Candidate {
            species: index as u16, // biomes have some dozens
            sub_biomes: traits.sub_biomes,
            seed_weight: traits.seed_weight,
            limits: Limits::of(traits),
        };
        let mut all: Vec<Candidate> = traits.iter().enumerate().map(candidate).collect();
        all.sort_by(|a, b| b.seed_weight.total_cmp(&a.seed_weight));
        let (found, weight_at_most) = (vec![0; all.len()], vec![0.0; all.len() + 1]);
        Self { all, found, weight_at_most, sums: Vec::new() }
    }

    /// Finds the species of these sub-biomes that a place may suit.
    fn find(&mut self, offer: &Offer, sub_biomes: u32) {
        let year = offer.year();
        self.found.resize(self.all.len(), 0);
        let mut count = 0;
        for (place, candidate) in self.all.iter().enumerate() {
            // no branch: which ones it is differs from cell to cell
            self.found[count] = place as u16;
            let suited = candidate.sub_biomes & sub_biomes != 0;
            count += usize::from(suited & candidate.limits.may_suit(&year));
        }
        self.found.truncate(count);
        self.weight_at_most.resize(count + 1, 0.0);
        self.weight_at_most[count] = 0.0;
        let mut most = 0.0;
        for (place, found) in self.found.iter().enumerate().rev() {
            most += self.all[usize::from(*found)].seed_weight;
            self.weight_at_most[place] = most;
        }
    }

    /// One of those found, each as likely as its weight.
    fn choose(&mut self, offer: &Offer, traits: &[Traits], choice: f32) -> Option<u16> {
        let species = |place: usize| self.all[usize::from(self.found[place])].species;
        let weigh = |place: usize| weight(offer, &traits[usize::from(species(place))]);
        roulette(&self.weight_at_most, choice, &mut self.sums, weigh).map(species)
    }

    /// One of those found, each as likely as its weight, if `acceptance` is below the best vigor of all.
    ///
    /// # Reference
    /// Peytavie et al. 2024, section 5.1, Germination, and Eq. 5: w = max(α v̄ / ℓ^β, 0).
    /// # Departures
    /// α is a preference for decaying wood: off it, it is 1.
    fn choose_where_it_thrives(
        &mut self,
        offer: &Offer,
        traits: &[Traits],
        nursed: bool,
        acceptance: f32,
        choice: f32,
    ) -> Option<u16> {
        self.sums.clear();
        let (mut total, mut best) = (0.0, 0.0_f32);
        for place in &self.found {
            let traits = &traits[usize::from(self.all[usize::from(*place)].species)];
            let vigor = season_vigor(offer, traits);
            best = best.max(vigor);
            let alpha = if nursed { traits.downed_log_seeding_multiplier } else { 1.0 };
            total += (alpha * vigor * traits.seed_weight).max(0.0);
            self.sums.push(total);
        }
        if acceptance >= best {
            return None;
        }
        let chosen = self.sums.partition_point(|sum| *sum <= choice * total);
        self.found.get(chosen).map(|place| self.all[usize::from(*place)].species)
    }
}

/// How likely a species is among those that sprout: its mean vigor over the growing season on what plants leave to seeds,
/// and the more the sooner it bears seeds; at most its `seed_weight`.
///
/// # Reference
/// Kapp et al. 2020, Eq. 4: w = max(0, v̄ / m^β).
#[inline]
fn weight(offer: &Offer, traits: &Traits) -> f32 {
    (season_vigor(offer, traits) * traits.seed_weight).max(0.0)
}

/// Mean vigor over the growing season.
#[inline]
fn season_vigor(offer: &Offer, traits: &Traits) -> f32 {
    let by_month = offer.vigor(traits);
    // years a month are equal within the season, 0 outside, and 1 together
    let in_season = |month: usize| by_month[month] * traits.years_a_month[month];
    let quarters: [f32; 4] =
        std::array::from_fn(|month| in_season(month) + in_season(month + 4) + in_season(month + 8));
    (quarters[0] + quarters[1]) + (quarters[2] + quarters[3])
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
    let (mut total, mut chosen) = (0.0, 0);
    for (index, most_left) in weight_at_most.iter().skip(1).enumerate() {
        total += weigh(index);
        sums.push(total);
        // the point lies at most there, and at least here: what comes moves it on
        let [here, there] = [choice * total, choice * (total + most_left)];
        while chosen < sums.len() && sums[chosen] <= here {
            chosen += 1;
        }
        if chosen < sums.len() && sums[chosen] > there {
            return Some(chosen);
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
        let weights = [1.0, 0.5, 0.1, 0.1];
        assert_eq!(chosen(&weights, 1.0, 0.2), (Some(0), 1));
        assert_eq!(chosen(&weights, 1.0, 0.3), (Some(0), 3));
        assert_eq!(chosen(&weights, 1.0, 0.7), (Some(1), 4));
        assert_eq!(chosen(&weights, 1.0, 0.99), (Some(3), 4));
    }
}
