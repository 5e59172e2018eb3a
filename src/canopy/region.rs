//! Regions: what each asks of its canopy, how that is brought about round by round, and what came of it.

use std::borrow::Cow;

use super::assignment::Role;
use super::brush::Brush;
use super::limits::{self, CellsByLimit};
use super::share_solver::{self, Sample};
use super::shares::Shares;
use super::species_map::{MOST_MISS_FRACTION, RegionOutcome, SpeciesParams, SpeciesShare};
use super::suitability::{Candidate, NOT_CANOPY, Suitability};
use crate::species::Biome;

/// Solving goes on until all shares are this near. chosen: well within what counts as reached.
pub(super) const GOOD_MISS_FRACTION: f64 = 0.003;
/// Sampled cells of a region. chosen: shares on a sample spread over the region then err by about 0.3 %, which the
/// rounds on all cells take away.
const SAMPLE_CELLS: u64 = 8192;

/// A region as the solver sees it.
pub(super) struct Region<'a> {
    pub name: Option<&'a str>,
    pub shares: &'a Shares,
    pub roles: Vec<Role>,
    sample: Sample,
    /// Candidates with targets above 0, in the sample's order, and their targets that can be reached.
    targeted: Vec<usize>,
    reachable: Vec<f64>,
    /// Put on the reachable shares for the sample, so that all cells together reach them.
    corrections: Vec<f64>,
    sample_weights: Vec<i32>,
}

/// The landscape's region, then the brush's.
pub(super) fn regions<'a>(
    params: &'a SpeciesParams,
    brush: Option<&'a Brush>,
    candidates: &[Candidate],
) -> Vec<Region<'a>> {
    let painted = brush.map_or(&[][..], |brush| &brush.regions[..]);
    let painted = painted.iter().map(|region| (Some(region.name.as_str()), &region.shares));
    let all = std::iter::once((None, &params.shares)).chain(painted);
    all.map(|(name, shares)| {
        let role = |candidate: &Candidate| match shares.of(candidate.species) {
            Some(0.0) => Role::Excluded,
            Some(_) => Role::Targeted,
            None if shares.is_full() => Role::Reserve,
            None => Role::Free,
        };
        let roles: Vec<Role> = candidates.iter().map(role).collect();
        let targeted: Vec<usize> =
            (0..roles.len()).filter(|&c| roles[c] == Role::Targeted).collect();
        Region {
            name,
            shares,
            sample: Sample { targeted: targeted.len(), ..Sample::default() },
            reachable: targeted
                .iter()
                .map(|&c| shares.of(candidates[c].species).unwrap_or(0.0))
                .collect(),
            corrections: vec![0.0; targeted.len()],
            sample_weights: vec![0; targeted.len()],
            roles,
            targeted,
        }
    })
    .collect()
}

/// Fills the regions' samples: one canopy cell out of each run of equal length, at a place that varies.
pub(super) fn sample_canopy(suitability: &Suitability, regions: &mut [Region<'_>]) {
    if regions.iter().all(|region| region.targeted.is_empty()) {
        return;
    }
    let mut seen = vec![0_u64; regions.len()];
    for (cell, &region) in suitability.canopy_region.iter().enumerate() {
        if region == NOT_CANOPY {
            continue;
        }
        let at = usize::from(region);
        let stride = suitability.counts.canopy[at].div_ceil(SAMPLE_CELLS).max(1);
        let (run, place) = (seen[at] / stride, seen[at] % stride);
        seen[at] += 1;
        let chosen = (run.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32) % stride;
        let region = &mut regions[at];
        if place != chosen || region.targeted.is_empty() {
            continue;
        }
        let code = |candidate: usize| suitability.code(cell, candidate);
        let can_stand =
            |candidate: usize| region.roles[candidate] != Role::Excluded && code(candidate) > 0;
        if (0..region.roles.len()).any(can_stand) {
            let free = (0..region.roles.len()).filter(|&c| region.roles[c] == Role::Free);
            let best_free = free.map(code).max().unwrap_or(0);
            let codes = region.targeted.iter().map(|&c| code(c)).chain([best_free]);
            region.sample.codes.extend(codes);
            region.sample.cells += 1;
        }
    }
}

impl Region<'_> {
    /// Finds what can be reached, and weights that reach it on the sample.
    pub(super) fn begin(&mut self) {
        if self.targeted.is_empty() {
            return;
        }
        self.reachable = share_solver::reachable(&self.sample, &self.reachable);
        share_solver::solve(&self.sample, &self.reachable, &mut self.sample_weights);
    }

    /// Weight of every candidate, in steps of codes.
    pub(super) fn weights(&self, candidates: usize) -> Vec<i32> {
        let mut weights = vec![0; candidates];
        for (&candidate, &weight) in self.targeted.iter().zip(&self.sample_weights) {
            weights[candidate] = weight;
        }
        weights
    }

    /// Shares of the targeted species among cells that have a species.
    fn reached<'s>(&'s self, cells: &'s [u64]) -> impl Iterator<Item = f64> + 's {
        let stocked: u64 = cells.iter().take(self.roles.len()).sum();
        self.targeted.iter().map(move |&c| cells[c] as f64 / stocked.max(1) as f64)
    }

    /// How far the share that is farthest off is from what can be reached.
    pub(super) fn miss(&self, cells: &[u64]) -> f64 {
        if self.sample.cells == 0 {
            return 0.0;
        }
        let misses = self.reached(cells).zip(&self.reachable).map(|(a, b)| (a - b).abs());
        misses.fold(0.0, f64::max)
    }

    /// Solves anew with shares moved by what all cells together missed.
    pub(super) fn correct(&mut self, cells: &[u64]) {
        if self.miss(cells) <= GOOD_MISS_FRACTION {
            return;
        }
        let misses: Vec<f64> =
            self.reached(cells).zip(&self.reachable).map(|(a, b)| b - a).collect();
        for (correction, miss) in self.corrections.iter_mut().zip(misses) {
            *correction += miss;
        }
        let asked: Vec<f64> = self
            .reachable
            .iter()
            .zip(&self.corrections)
            .map(|(share, correction)| (share + correction).clamp(0.0, 1.0))
            .collect();
        share_solver::solve(&self.sample, &asked, &mut self.sample_weights);
    }

    pub(super) fn outcome(
        &self,
        at: usize,
        cells: &[u64],
        candidates: &[Candidate],
        suitability: &Suitability,
        biome: &Biome,
    ) -> RegionOutcome {
        let counts = &suitability.counts;
        let stocked: u64 = cells.iter().take(candidates.len()).sum();
        let species = candidates.iter().enumerate().map(|(candidate, of_biome)| {
            let target_fraction = self.shares.of(of_biome.species);
            let reached_fraction = cells[candidate] as f64 / stocked.max(1) as f64;
            let key = &biome.species[of_biome.species].key;
            let missed = target_fraction
                .filter(|target| (target - reached_fraction).abs() > MOST_MISS_FRACTION);
            let reason = missed.map(|target| {
                let suited = counts.suited_cells(at, candidate);
                let limits = counts.limits_of(at, candidate);
                let canopy_cells = counts.canopy[at];
                let found = Found { canopy_cells, stocked, suited, limits, reached_fraction };
                found.reason(key, target)
            });
            SpeciesShare {
                species: of_biome.species,
                cells: cells[candidate],
                reached_fraction,
                target_fraction,
                reason,
            }
        });
        RegionOutcome {
            name: self.name.map(str::to_owned),
            canopy_cells: counts.canopy[at],
            empty_cells: cells[candidates.len()],
            empty_by_limit: counts.empty_of(at),
            species: species.collect(),
        }
    }
}

/// What was found of a species whose share was missed.
struct Found {
    canopy_cells: u64,
    stocked: u64,
    suited: u64,
    limits: CellsByLimit,
    reached_fraction: f64,
}

impl Found {
    /// Why the share was missed, in words.
    fn reason(&self, key: &str, target: f64) -> String {
        if self.canopy_cells == 0 {
            return "there is no canopy".to_owned();
        }
        if self.stocked == 0 {
            return "no species can grow on any of the canopy cells".to_owned();
        }
        let percent = 100.0 * self.suited as f64 / self.canopy_cells as f64;
        let limits: Cow<'_, str> = match limits::in_words(&self.limits, self.canopy_cells) {
            words if words.is_empty() => "".into(),
            words => format!(": {words}").into(),
        };
        let grows = format!("{key} can grow on {percent:.0} % of the canopy cells{limits}");
        if self.reached_fraction > target {
            return format!(
                "{key} takes ground where none of the other species asked for can grow"
            );
        }
        if self.suited as f64 <= (target - MOST_MISS_FRACTION) * self.stocked as f64 {
            return grows;
        }
        format!("{grows}; other species need part of that ground to reach their own shares")
    }
}
