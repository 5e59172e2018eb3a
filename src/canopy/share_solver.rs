//! Weights that give each species its share of a region's canopy, worked out on a sample of its cells.
//!
//! # Reference
//! Kapp et al. 2020, section 5.1: weights alpha_s that minimise Σ (t_s − A_s(alpha))².
//! # Departures
//! They solve one species at a time by bisection. Here all are solved together: the cell goes to the greatest of
//! ln alpha_s + ln v_s, a problem concave in the ln alpha_s, climbed one coordinate at a time. The best value of one
//! coordinate is a quantile over the cells, so no search is needed.

use std::collections::BTreeMap;

use super::suitability::CODES_PER_E_FOLD;

/// Greatest weight, in steps of codes. chosen: e^16, beyond which one species has every cell it can stand in, for
/// codes span e^8.
const MOST_WEIGHT: i32 = (16.0 * CODES_PER_E_FOLD) as i32;
/// Stands in for the weight of a species that can have a cell unopposed.
const NOBODY: i32 = i32::MIN / 2;
/// Most rounds over all species. chosen: five species on real terrain take about ten.
const MOST_SWEEPS: usize = 60;
/// Part of the sample's cells by which shares may miss on the sample.
const TOLERANCE_FRACTION: f64 = 0.000_5;
/// Every so many-th cell of the sample serves to find the weights roughly.
const ROUGH_STRIDE: usize = 8;
/// Fewest cells that weights are found roughly on first.
const LEAST_ROUGH_CELLS: usize = 4096;
/// Rounds of [`reachable`]; each costs microseconds.
const REACH_ROUNDS: usize = 500;

/// Sampled canopy cells of one region: what each cell is worth to each of the species that have targets.
#[derive(Clone, Debug, Default)]
pub(super) struct Sample {
    /// Species with targets.
    pub targeted: usize,
    /// Codes, cell after cell; 0 where a species cannot stand. Behind the targeted ones stands the best code of all
    /// species that compete with weight 1.
    pub codes: Vec<u16>,
    /// Sampled cells, those included where none of these species can stand but another can.
    pub cells: usize,
}

impl Sample {
    fn stride(&self) -> usize {
        self.targeted + 1
    }

    fn rows(&self) -> std::slice::ChunksExact<'_, u16> {
        self.codes.chunks_exact(self.stride())
    }

    fn thinned(&self) -> Self {
        let codes: Vec<u16> = self.rows().step_by(ROUGH_STRIDE).flatten().copied().collect();
        Self { targeted: self.targeted, codes, cells: self.cells.div_ceil(ROUGH_STRIDE) }
    }

    /// Share of the sampled cells that each targeted species takes.
    fn shares(&self, weights: &[i32]) -> Vec<f64> {
        let mut counts = vec![0_u32; self.targeted];
        for row in self.rows() {
            let mut best =
                if row[self.targeted] > 0 { i32::from(row[self.targeted]) } else { NOBODY };
            let mut winner = None;
            for (species, (&code, &weight)) in row.iter().zip(weights).enumerate() {
                let score = i32::from(code) + weight;
                if code > 0 && score > best {
                    (best, winner) = (score, Some(species));
                }
            }
            if let Some(winner) = winner {
                counts[winner] += 1;
            }
        }
        counts.iter().map(|&count| f64::from(count) / self.cells.max(1) as f64).collect()
    }
}

/// Shares nearest to the targets, in the least-squares sense, that some assignment of the sampled cells has.
///
/// Cells are told apart only by who can stand there. Each kind of cell in turn is shared out as well as can be while
/// the others stay as they are, until nothing changes; the problem is convex, so that is the best there is.
pub(super) fn reachable(sample: &Sample, targets: &[f64]) -> Vec<f64> {
    let total = sample.cells.max(1) as f64;
    let mut cells_by_kind: BTreeMap<Vec<bool>, u64> = BTreeMap::new();
    let mut kind = vec![false; sample.stride()];
    for row in sample.rows() {
        kind.iter_mut().zip(row).for_each(|(can, &code)| *can = code > 0);
        match cells_by_kind.get_mut(&kind) {
            Some(cells) => *cells += 1,
            None => {
                cells_by_kind.insert(kind.clone(), 1);
            }
        }
    }
    let kinds: Vec<(Vec<usize>, bool, f64)> = cells_by_kind
        .into_iter()
        .map(|(kind, cells)| {
            let species = (0..sample.targeted).filter(|&s| kind[s]).collect();
            (species, kind[sample.targeted], cells as f64 / total)
        })
        .collect();
    let mut shares = vec![0.0; sample.targeted];
    let mut given: Vec<Vec<f64>> = kinds.iter().map(|(s, ..)| vec![0.0; s.len()]).collect();
    for _ in 0..REACH_ROUNDS {
        let mut change = 0.0_f64;
        for ((species, others_can, amount), given) in kinds.iter().zip(&mut given) {
            let wanted: Vec<f64> = species
                .iter()
                .zip(&*given)
                .map(|(&s, given)| targets[s] - shares[s] + given)
                .collect();
            let shared = shared_out(&wanted, *amount, *others_can);
            for ((&s, given), new) in species.iter().zip(given).zip(shared) {
                shares[s] += new - *given;
                change = change.max((new - *given).abs());
                *given = new;
            }
        }
        if change < 1e-7 {
            break;
        }
    }
    shares
}

/// `amount` shared out so that the squared distances from what is wanted are least; all of it, unless others can take
/// the rest.
fn shared_out(wanted: &[f64], amount: f64, others_can: bool) -> Vec<f64> {
    let sum: f64 = wanted.iter().map(|w| w.max(0.0)).sum();
    if others_can && sum <= amount {
        return wanted.iter().map(|w| w.max(0.0)).collect();
    }
    // the level below which nobody gets anything
    let mut sorted = wanted.to_vec();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let (mut sum, mut level) = (0.0, 0.0);
    for (i, wanted) in sorted.iter().enumerate() {
        sum += wanted;
        let here = (sum - amount) / (i + 1) as f64;
        if *wanted <= here {
            break;
        }
        level = here;
    }
    wanted.iter().map(|w| (w - level).max(0.0)).collect()
}

/// Weights, in steps of codes, that give each targeted species its share of the sample; `weights` holds where to begin.
///
/// `shares` must be [`reachable`], or nearly. Where no other species competes, weights are known but for a constant;
/// their mean is then 0.
pub(super) fn solve(sample: &Sample, shares: &[f64], weights: &mut [i32]) {
    if sample.cells >= LEAST_ROUGH_CELLS {
        climb(&sample.thinned(), shares, weights);
    }
    climb(sample, shares, weights);
}

fn climb(sample: &Sample, shares: &[f64], weights: &mut [i32]) {
    let others_compete = sample.rows().any(|row| row[sample.targeted] > 0);
    let tolerance = TOLERANCE_FRACTION.max(1.0 / sample.cells.max(1) as f64);
    let mut bids = Vec::with_capacity(sample.cells);
    for _ in 0..MOST_SWEEPS {
        for species in 0..sample.targeted {
            bids_against(sample, weights, species, &mut bids);
            let wanted = (shares[species] * sample.cells as f64).round().max(0.0) as usize;
            weights[species] = bid_that_takes(&mut bids, wanted, weights[species]);
        }
        if !others_compete {
            let mean = weights.iter().sum::<i32>() / sample.targeted.max(1) as i32;
            weights.iter_mut().for_each(|weight| *weight -= mean);
        }
        let reached = sample.shares(weights);
        let miss = reached.iter().zip(shares).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if miss <= tolerance {
            break;
        }
    }
}

/// For each cell where a species can stand, the weight above which it has the cell, the others' weights given.
fn bids_against(sample: &Sample, weights: &[i32], species: usize, bids: &mut Vec<i32>) {
    bids.clear();
    for row in sample.rows().filter(|row| row[species] > 0) {
        let mut best =
            if row[sample.targeted] > 0 { i32::from(row[sample.targeted]) } else { NOBODY };
        for (other, (&code, &weight)) in row.iter().zip(weights).enumerate() {
            let score = i32::from(code) + weight;
            if other != species && code > 0 && score > best {
                best = score;
            }
        }
        bids.push(if best == NOBODY { -MOST_WEIGHT } else { best - i32::from(row[species]) });
    }
}

/// The weight that exceeds `wanted` of the bids, midway to the next one; `now` where no weight matters.
fn bid_that_takes(bids: &mut [i32], wanted: usize, now: i32) -> i32 {
    let most = |bid: i32| bid.clamp(-MOST_WEIGHT, MOST_WEIGHT);
    if bids.is_empty() {
        return now;
    }
    if wanted >= bids.len() {
        return most(bids.iter().copied().max().unwrap_or(now).saturating_add(1));
    }
    let (below, next, _) = bids.select_nth_unstable(wanted);
    let next = *next;
    match below.iter().copied().max() {
        // ties fall to species of lower index, so at least one step above
        Some(last) => most(last + ((next - last) / 2).max(1)),
        None => most(next - 1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Key, Process, words};

    /// Cells whose codes vary independently, `None` where a species cannot stand.
    fn sample(cells: usize, targeted: usize, can: impl Fn(usize, usize) -> bool) -> Sample {
        let code = |cell: usize, species: usize| {
            let entity = (cell * 64 + species) as u64;
            let key = Key { seed: 3, process: Process::StrewnPoints, year: 0, month: 0, entity };
            if can(cell, species) { 30_000 + (words(key)[0] % 30_000) as u16 } else { 0 }
        };
        let codes = (0..cells).flat_map(|cell| (0..=targeted).map(move |s| (cell, s)));
        Sample { targeted, codes: codes.map(|(cell, s)| code(cell, s)).collect(), cells }
    }

    #[test]
    fn sharing_out_is_fair() {
        assert_eq!(shared_out(&[3.0, 1.0], 10.0, true), [3.0, 1.0]);
        assert_eq!(shared_out(&[3.0, 1.0], 10.0, false), [6.0, 4.0]);
        assert_eq!(shared_out(&[3.0, 1.0], 3.0, true), [2.5, 0.5]);
        assert_eq!(shared_out(&[3.0, -1.0], 2.0, true), [2.0, 0.0]);
        assert!(shared_out(&[], 2.0, false).is_empty());
    }

    #[test]
    fn only_what_can_be_reached_is_asked() {
        // species 0 stands on a fifth of the cells, species 1 on all of them, others nowhere
        let fifth = sample(1000, 2, |cell, species| match species {
            0 => cell % 5 == 0,
            1 => true,
            _ => false,
        });
        let near = |found: Vec<f64>, expected: [f64; 2]| {
            found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5)
        };
        assert!(near(reachable(&fifth, &[0.1, 0.9]), [0.1, 0.9]));
        assert!(near(reachable(&fifth, &[0.6, 0.4]), [0.2, 0.8]));
        // two species that need the same third: what is missing is shared
        let third = sample(900, 2, |cell, species| species == 2 || cell % 3 == 0);
        assert!(near(reachable(&third, &[0.2, 0.1]), [0.2, 0.1]));
        assert!(near(reachable(&third, &[0.3, 0.2]), [0.3 - 1.0 / 12.0, 0.2 - 1.0 / 12.0]));
    }

    #[test]
    fn weights_give_the_shares() {
        let all = sample(8000, 4, |_, _| true);
        let partial = sample(8000, 4, |cell, species| (cell >> species) % 2 == 0 || cell % 7 == 0);
        let alone = sample(8000, 4, |cell, species| species < 4 && (cell + species) % 3 > 0);
        for (sample, targets) in [
            (&all, [0.1, 0.2, 0.3, 0.2]),
            (&all, [0.01, 0.9, 0.01, 0.05]),
            (&partial, [0.3, 0.1, 0.3, 0.05]),
            (&alone, [0.25, 0.4, 0.3, 0.05]),
        ] {
            let shares = reachable(sample, &targets);
            let mut weights = [0; 4];
            solve(sample, &shares, &mut weights);
            let reached = sample.shares(&weights);
            for ((reached, share), target) in reached.iter().zip(&shares).zip(targets) {
                assert!((share - target).abs() < 1e-4, "{shares:?} for {targets:?}");
                assert!(
                    (reached - share).abs() < 2e-3,
                    "{reached} for {share}, weights {weights:?}"
                );
            }
        }
    }

    #[test]
    fn nothing_to_solve_is_no_trouble() {
        let empty = Sample { targeted: 2, ..Sample::default() };
        assert_eq!(reachable(&empty, &[0.5, 0.5]), [0.0, 0.0]);
        let mut weights = [0; 2];
        solve(&empty, &[0.5, 0.5], &mut weights);
        assert_eq!(weights, [0, 0]);
    }
}
