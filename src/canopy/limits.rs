//! What keeps a species from a place, and how many of the canopy's cells it keeps it from.

/// Kinds of [`Limit`].
pub const LIMITS: usize = 9;

/// What keeps a species from a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[allow(missing_docs, reason = "the names tell")]
pub enum Limit {
    TooDark,
    TooSunny,
    TooDry,
    TooWet,
    TooCold,
    TooWarm,
    TooLevel,
    TooSteep,
    /// The canopy is taller than the species grows.
    TooTall,
}

impl Limit {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; LIMITS] = [
        Self::TooDark,
        Self::TooSunny,
        Self::TooDry,
        Self::TooWet,
        Self::TooCold,
        Self::TooWarm,
        Self::TooLevel,
        Self::TooSteep,
        Self::TooTall,
    ];

    /// Too little or too much of a resource: 0 sun, 1 moisture, 2 temperature, 3 slope.
    pub(super) fn of_resource(resource: usize, is_too_much: bool) -> Self {
        Self::ALL[2 * resource + usize::from(is_too_much)]
    }

    /// The limit in words, to stand before "on 12 %".
    pub fn text(self) -> &'static str {
        match self {
            Self::TooDark => "too dark",
            Self::TooSunny => "too sunny",
            Self::TooDry => "too dry",
            Self::TooWet => "too wet",
            Self::TooCold => "too cold",
            Self::TooWarm => "too warm",
            Self::TooLevel => "too level",
            Self::TooSteep => "too steep",
            Self::TooTall => "the canopy is too tall for it",
        }
    }
}

/// Cells that a limit rules out, by [`Limit::ALL`].
pub type CellsByLimit = [u64; LIMITS];

/// Counts of canopy cells by region: what they are, and what rules species out there.
#[derive(Clone, Debug, Default)]
pub(super) struct LimitCounts {
    candidates: usize,
    /// Canopy cells of each region.
    pub canopy: Vec<u64>,
    suited: Vec<u64>,
    limits: Vec<CellsByLimit>,
    empty: Vec<CellsByLimit>,
}

impl LimitCounts {
    pub(super) fn new(regions: usize, candidates: usize) -> Self {
        Self {
            candidates,
            canopy: vec![0; regions],
            suited: vec![0; regions * candidates],
            limits: vec![[0; LIMITS]; regions * candidates],
            empty: vec![[0; LIMITS]; regions],
        }
    }

    /// Canopy cells of a region where a candidate can stand.
    pub(super) fn suited(&mut self, region: usize, candidate: usize) -> &mut u64 {
        &mut self.suited[region * self.candidates + candidate]
    }

    /// Canopy cells of a region that a limit keeps from a candidate.
    pub(super) fn limit(&mut self, region: usize, candidate: usize, limit: Limit) -> &mut u64 {
        &mut self.limits[region * self.candidates + candidate][limit as usize]
    }

    /// Canopy cells of a region where no candidate can stand, by what the one least out of place lacks.
    pub(super) fn empty_for(&mut self, region: usize, limit: Limit) -> &mut u64 {
        &mut self.empty[region][limit as usize]
    }

    /// As [`Self::suited`], to read.
    pub(super) fn suited_cells(&self, region: usize, candidate: usize) -> u64 {
        self.suited[region * self.candidates + candidate]
    }

    /// All limits of a candidate in a region.
    pub(super) fn limits_of(&self, region: usize, candidate: usize) -> CellsByLimit {
        self.limits[region * self.candidates + candidate]
    }

    /// Why cells of a region's canopy stay empty.
    pub(super) fn empty_of(&self, region: usize) -> CellsByLimit {
        self.empty[region]
    }

    /// Both counts together.
    pub(super) fn merged(mut self, other: &Self) -> Self {
        let add = |to: &mut [u64], from: &[u64]| {
            to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
        };
        add(&mut self.canopy, &other.canopy);
        add(&mut self.suited, &other.suited);
        add(self.limits.as_flattened_mut(), other.limits.as_flattened());
        add(self.empty.as_flattened_mut(), other.empty.as_flattened());
        self
    }
}

/// Shares of cells in words, largest first, none below half a percent: "too dry on 70 %, too steep on 3 %".
pub fn in_words(cells: &CellsByLimit, of_cells: u64) -> String {
    let mut shares: Vec<(u64, Limit)> = cells.iter().copied().zip(Limit::ALL).collect();
    shares.sort_by_key(|(cells, limit)| (std::cmp::Reverse(*cells), *limit));
    let percent = |cells: u64| 100.0 * cells as f64 / of_cells.max(1) as f64;
    let shown = shares.into_iter().filter(|(cells, _)| percent(*cells) >= 0.5);
    let words: Vec<String> = shown
        .map(|(cells, limit)| format!("{} on {:.0} %", limit.text(), percent(cells)))
        .collect();
    words.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_stand_in_the_order_of_their_numbers() {
        assert!(Limit::ALL.into_iter().enumerate().all(|(i, limit)| limit as usize == i));
        assert_eq!(Limit::of_resource(1, false), Limit::TooDry);
        assert_eq!(Limit::of_resource(3, true), Limit::TooSteep);
    }

    #[test]
    fn words_run_from_the_largest_share() {
        let mut cells = [0; LIMITS];
        cells[Limit::TooTall as usize] = 18;
        cells[Limit::TooDry as usize] = 70;
        assert_eq!(in_words(&cells, 100), "too dry on 70 %, the canopy is too tall for it on 18 %");
        assert_eq!(in_words(&cells, 100_000), "");
    }

    #[test]
    fn counts_of_bands_add_up() {
        let mut counts = LimitCounts::new(2, 3);
        *counts.limit(1, 2, Limit::TooWet) += 4;
        *counts.suited(1, 0) += 2;
        *counts.empty_for(0, Limit::TooDry) += 1;
        let both = counts.clone().merged(&counts);
        assert_eq!(both.limits_of(1, 2)[Limit::TooWet as usize], 8);
        assert_eq!((both.suited_cells(1, 0), both.empty_of(0)[2]), (4, 2));
    }
}
