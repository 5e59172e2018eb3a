//! Assignment: each cell to the candidate whose weighted vigor is greatest, and how many cells each one has.

use rayon::prelude::*;

use super::brush::Blend;
use super::specks::NOBODY;
use super::suitability::{CODES_PER_E_FOLD, NOT_CANOPY, Suitability};

/// What a species is to a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// It has a share to reach.
    Targeted,
    /// It competes with weight 1.
    Free,
    /// It stands only where no targeted species can: those are to take everything.
    Reserve,
    /// It is not to stand here.
    Excluded,
}

/// Put on a reserve's score: more than weights and vigors together can make up.
const RESERVE_OFFSET: i32 = -(48.0 * CODES_PER_E_FOLD) as i32;
/// Score of a candidate that cannot stand at a cell.
const CANNOT: i32 = i32::MIN / 2;
/// Weight that reserves and excluded species have in the blend across a region's border. chosen: a fiftieth of the
/// vigor, so that they thin out towards the region and do not stand along its border.
const SOFT_WEIGHT: i32 = -(4.0 * CODES_PER_E_FOLD) as i32;
/// Columns worked on together, so that scores stay in the fastest memory.
const BLOCK: usize = 256;

/// Roles and weights of the candidates in each region.
pub(super) struct Weights<'a> {
    /// By region, then candidate.
    pub roles: &'a [Vec<Role>],
    /// By region, then candidate, in steps of codes; 0 for all but targeted ones.
    pub weights: Vec<Vec<i32>>,
    /// The regions' borders, where there is more than one.
    pub blend: Option<&'a Blend>,
    /// Region number of each cell; all 0 where `None`.
    pub regions: Option<&'a [u8]>,
}

impl Weights<'_> {
    /// Whether a patch of `from` may be given to `to` at a cell of a region.
    pub(super) fn may_replace(&self, cell: usize, from: u8, to: u8) -> bool {
        let region = self.regions.map_or(0, |regions| usize::from(regions[cell]));
        let role = |candidate: u8| self.roles[region][usize::from(candidate)];
        match role(to) {
            Role::Excluded => false,
            Role::Reserve => from == NOBODY || role(from) == Role::Reserve,
            Role::Targeted | Role::Free => true,
        }
    }
}

fn offset(role: Role) -> i32 {
    match role {
        Role::Targeted | Role::Free => 0,
        Role::Reserve => RESERVE_OFFSET,
        Role::Excluded => CANNOT,
    }
}

/// Fills `map` with the candidate at each cell, [`NOBODY`] where none can stand.
pub(super) fn assign(suitability: &Suitability, weights: &Weights<'_>, map: &mut [u8]) {
    let (cols, candidates) = (suitability.cols, suitability.candidates);
    if cols == 0 || candidates == 0 {
        map.fill(NOBODY);
        return;
    }
    let soft: Vec<Vec<i32>> = weights
        .weights
        .iter()
        .zip(weights.roles)
        .map(|(weights, roles)| {
            let soft = |(&weight, &role): (&i32, &Role)| match role {
                Role::Targeted | Role::Free => weight,
                Role::Reserve | Role::Excluded => SOFT_WEIGHT,
            };
            weights.iter().zip(roles).map(soft).collect()
        })
        .collect();
    let nodes = weights.blend.map(|blend| (blend, blend.node_weights(&soft, candidates)));
    let rows = map.par_chunks_mut(cols).zip(suitability.codes.par_chunks(cols * candidates));
    rows.enumerate().for_each_init(
        || vec![0_i32; cols],
        |row_weights, (row, (map, codes))| {
            let mut scores = RowScores::new(map);
            for candidate in 0..candidates {
                let codes = &codes[candidate * cols..(candidate + 1) * cols];
                match (&nodes, weights.regions) {
                    (Some((blend, nodes)), Some(regions)) => {
                        let per_candidate = nodes.len() / candidates;
                        let nodes = &nodes[candidate * per_candidate..][..per_candidate];
                        blend.fill_row(nodes, row, row_weights);
                        let regions = &regions[row * cols..(row + 1) * cols];
                        for (weight, &region) in row_weights.iter_mut().zip(regions) {
                            *weight += offset(weights.roles[usize::from(region)][candidate]);
                        }
                        scores.offer_weighted(candidate as u8, codes, row_weights);
                    }
                    _ => {
                        let weight = weights.weights[0][candidate];
                        let offset = offset(weights.roles[0][candidate]);
                        scores.offer(candidate as u8, codes, weight + offset);
                    }
                }
            }
        },
    );
}

/// The best score so far at each cell of a row, and whose it is.
struct RowScores<'a> {
    winner: &'a mut [u8],
    best: Vec<i32>,
}

impl<'a> RowScores<'a> {
    fn new(winner: &'a mut [u8]) -> Self {
        winner.fill(NOBODY);
        Self { best: vec![CANNOT / 2; winner.len()], winner }
    }

    fn offer(&mut self, candidate: u8, codes: &[u16], weight: i32) {
        if weight <= CANNOT / 2 {
            return;
        }
        let blocks = self.winner.chunks_mut(BLOCK).zip(self.best.chunks_mut(BLOCK));
        for ((winner, best), codes) in blocks.zip(codes.chunks(BLOCK)) {
            for ((winner, best), &code) in winner.iter_mut().zip(best).zip(codes) {
                let score = if code > 0 { i32::from(code) + weight } else { CANNOT };
                let wins = score > *best;
                *best = if wins { score } else { *best };
                *winner = if wins { candidate } else { *winner };
            }
        }
    }

    fn offer_weighted(&mut self, candidate: u8, codes: &[u16], weights: &[i32]) {
        let cells = self.winner.iter_mut().zip(&mut self.best).zip(codes).zip(weights);
        for (((winner, best), &code), &weight) in cells {
            let score = if code > 0 { i32::from(code) + weight } else { CANNOT };
            let wins = score > *best;
            *best = if wins { score } else { *best };
            *winner = if wins { candidate } else { *winner };
        }
    }
}

/// Canopy cells of each region and candidate; the last column counts those without any.
pub(super) fn canopy_cells(map: &[u8], suitability: &Suitability, regions: usize) -> Vec<Vec<u64>> {
    let width = suitability.candidates + 1;
    let chunk = (suitability.cols * 64).max(1);
    let zero = || vec![0_u64; regions * width];
    let counted = map
        .par_chunks(chunk)
        .zip(suitability.canopy_region.par_chunks(chunk))
        .map(|(map, canopy_region)| {
            let mut counts = zero();
            for (&candidate, &region) in map.iter().zip(canopy_region) {
                if region != NOT_CANOPY {
                    let column = usize::from(candidate).min(width - 1);
                    counts[usize::from(region) * width + column] += 1;
                }
            }
            counts
        })
        .reduce(zero, |mut a, b| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            a
        });
    counted.chunks(width).map(<[u64]>::to_vec).collect()
}
