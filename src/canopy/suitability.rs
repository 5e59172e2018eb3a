//! How well each canopy species suits each cell, over what a tree's roots and crown reach.
//!
//! Vigor is the least of four adaptations that all fall the same way with the distance from the ideal in half widths.
//! So it is worked out from the greatest of the four distances alone, the species' **stress** at the cell.

use rayon::prelude::*;

use super::limits::{LIMITS, Limit, LimitCounts};
use super::mosaic::Mosaic;
use super::site::Site;
use crate::math;
use crate::progress::{Cancelled, Reporter};
use crate::raster::{Grid, Mask};
use crate::species::Species;
use crate::species::niche::{BELL_AT_HALF_WIDTH, BELL_EXPONENT, MOST_STRESS};

/// Rows that are worked on together. chosen: running sums start anew with each band, so that results do not depend on
/// threads; 128 rows make that start a tenth of the work at 1 m.
const BAND_ROWS: usize = 128;

/// Cells that no region's canopy counts.
pub(super) const NOT_CANOPY: u8 = u8::MAX;

/// Steps of a code in one e-fold of vigor.
pub(super) const CODES_PER_E_FOLD: f32 = 7900.0;
/// ln of the least vigor that codes tell apart. chosen: 0.0003, where nobody would plant the species.
const LEAST_LN_VIGOR: f32 = -8.0;
/// Room for the mosaic's deviations at both ends of the codes, e-folds.
const HEADROOM: f32 = 0.1;
/// Cells of the table of ln vigor over stress.
const TABLE_CELLS: usize = 1024;

/// A species that may stand in the canopy.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    /// Index in the biome.
    pub species: usize,
    /// Sun, moisture, temperature, slope, in the site's order.
    ideals: [f32; 4],
    /// 1 / half width.
    steepness: [f32; 4],
    /// Canopy above this is not its own.
    max_canopy_height_m: f32,
}

impl Candidate {
    pub(super) fn new(index: usize, species: &Species, height_margin: f32) -> Self {
        let niche = &species.niche;
        let tolerances = [niche.sun_h, niche.moisture_mm, niche.temperature_c, niche.slope_rad];
        Self {
            species: index,
            ideals: tolerances.map(|tolerance| tolerance.ideal),
            steepness: tolerances.map(|tolerance| 1.0 / tolerance.half_width),
            max_canopy_height_m: species.max_height_m * height_margin,
        }
    }

    /// Greatest distance from the ideals, in half widths.
    #[inline]
    fn stress(&self, offer: [f32; 4]) -> f32 {
        let [sun, moisture, temperature, slope] = self.distances(offer);
        larger(larger(sun, moisture), larger(temperature, slope))
    }

    /// Distances from the ideals, in half widths.
    #[inline]
    fn distances(&self, offer: [f32; 4]) -> [f32; 4] {
        std::array::from_fn(|i| (offer[i] - self.ideals[i]).abs() * self.steepness[i])
    }

    /// What keeps the species from such a place.
    fn limit(&self, offer: [f32; 4]) -> Limit {
        let stress = self.stress(offer);
        if stress <= MOST_STRESS_BORNE {
            return Limit::TooTall;
        }
        let distances = self.distances(offer);
        let worst = (0..4).find(|&i| distances[i] >= stress).unwrap_or(0);
        Limit::of_resource(worst, offer[worst] > self.ideals[worst])
    }
}

/// The larger of two numbers, neither of them NaN; compiles to one instruction.
#[inline]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The stress up to which vigor is positive: (ln 6 / ln 5)^(1/4.5) by Peytavie 2024, Eq. 4, less a hair, so that rounding
/// lets no species stand where it has none.
const MOST_STRESS_BORNE: f32 = 1.024_123;

/// How stress becomes a code: 0 where the species cannot stand, else the higher the better.
pub(super) enum Coding {
    /// Species are ranked by stress: vigor need not be known where all weights are equal.
    Rank,
    /// Codes are logarithms of vigor, [`CODES_PER_E_FOLD`] steps an e-fold, so that weights may be added.
    LnVigor(Vec<f32>),
}

impl Coding {
    /// The coding that weights can be added to.
    pub(super) fn ln_vigor() -> Self {
        let end = f64::from(MOST_STRESS_BORNE);
        let entry = |i: usize| {
            let stress = end * i as f64 / TABLE_CELLS as f64;
            let power = math::powf_f64(stress, f64::from(BELL_EXPONENT));
            let bell = math::exp_f64(math::ln_f64(f64::from(BELL_AT_HALF_WIDTH)) * power);
            let shift = f64::from(MOST_STRESS);
            let vigor = (1.0 + shift) * bell - shift;
            (math::ln_f64(vigor) as f32).max(LEAST_LN_VIGOR) // −12..=0
        };
        // one more, for stress that rounds up to the end
        Self::LnVigor((0..TABLE_CELLS + 2).map(|i| entry(i.min(TABLE_CELLS))).collect())
    }

    /// Codes of a row from stress, infinite where the species cannot stand.
    fn codes(&self, stress: &[f32], deviation: &[f32], codes: &mut [u16]) {
        let end = MOST_STRESS_BORNE;
        match self {
            Self::Rank => {
                let scale = f32::from(u16::MAX - 1) / end;
                for (code, &stress) in codes.iter_mut().zip(stress) {
                    // 0..65534 for what is suited, below 0 and cut to 0 for what is not
                    *code = ((end - stress) * scale + 1.0) as u16;
                }
            }
            Self::LnVigor(table) => {
                let scale = TABLE_CELLS as f32 / end;
                for ((code, &stress), deviation) in codes.iter_mut().zip(stress).zip(deviation) {
                    *code = if stress <= end {
                        let at = stress * scale;
                        let cell = at as usize; // 0..=TABLE_CELLS
                        let (low, high) = (table[cell], table[cell + 1]);
                        let ln_vigor = low + (high - low) * (at - cell as f32);
                        let e_folds = ln_vigor + deviation + (HEADROOM - LEAST_LN_VIGOR);
                        1 + (e_folds * CODES_PER_E_FOLD) as u16 // below 64,781
                    } else {
                        0
                    };
                }
            }
        }
    }
}

/// Codes of all candidates at all cells, and what the canopy's cells lack.
pub(super) struct Suitability {
    pub cols: usize,
    pub candidates: usize,
    /// Row after row; within a row, candidate after candidate.
    pub codes: Vec<u16>,
    /// The region whose canopy a cell belongs to, [`NOT_CANOPY`] where it is none.
    pub canopy_region: Vec<u8>,
    pub counts: LimitCounts,
}

impl Suitability {
    /// The code of a candidate at a cell; 0 where it cannot stand.
    #[inline]
    pub(super) fn code(&self, index: usize, candidate: usize) -> u16 {
        let (row, col) = (index / self.cols, index % self.cols);
        self.codes[(row * self.candidates + candidate) * self.cols + col]
    }
}

/// What suitability is worked out from.
pub(super) struct Ground<'a> {
    pub site: &'a Site,
    pub chm_m: &'a Grid<f32>,
    pub allowed: &'a Mask,
    /// Region number of each cell and how many regions there are; all 0 where `None`.
    pub regions: Option<&'a [u8]>,
    pub region_count: usize,
    /// Canopy begins here.
    pub canopy_min_height_m: f32,
    /// Half the side of the square that the site is averaged over and the canopy's height is taken from, cells.
    pub radius: usize,
    /// Whether to count, species by species, what keeps it from the canopy's cells.
    pub counts_limits: bool,
}

/// Codes of all candidates; rows are worked on in parallel, with equal results for any number of threads.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
pub(super) fn run(
    ground: &Ground<'_>,
    candidates: &[Candidate],
    coding: &Coding,
    mosaic: Option<&Mosaic>,
    reporter: &Reporter,
) -> Result<Suitability, Cancelled> {
    let frame = ground.chm_m.frame();
    let cols = frame.cols;
    let mut codes = vec![0_u16; frame.len() * candidates.len()];
    let mut canopy_region = vec![NOT_CANOPY; frame.len()];
    let band_cells = (BAND_ROWS * cols).max(1);
    let band_codes = (BAND_ROWS * cols * candidates.len()).max(1);
    let no_counts = || LimitCounts::new(ground.region_count, candidates.len());
    let counts = codes
        .par_chunks_mut(band_codes)
        .zip(canopy_region.par_chunks_mut(band_cells))
        .enumerate()
        .map(|(band, (codes, canopy_region))| {
            reporter.check_cancelled()?;
            let mut counts = no_counts();
            let out = BandOut { codes, canopy_region, counts: &mut counts };
            fill_band(ground, candidates, coding, mosaic, band * BAND_ROWS, out);
            Ok(counts)
        })
        .try_reduce(no_counts, |a, b| Ok(a.merged(&b)))?;
    Ok(Suitability { cols, candidates: candidates.len(), codes, canopy_region, counts })
}

struct BandOut<'a> {
    codes: &'a mut [u16],
    canopy_region: &'a mut [u8],
    counts: &'a mut LimitCounts,
}

fn fill_band(
    ground: &Ground<'_>,
    candidates: &[Candidate],
    coding: &Coding,
    mosaic: Option<&Mosaic>,
    first_row: usize,
    out: BandOut<'_>,
) {
    let frame = ground.chm_m.frame();
    let (cols, radius) = (frame.cols, ground.radius);
    let mut means = RowMeans::new(ground, first_row);
    let mut heights = RowMaxima::new(ground, first_row);
    let mut deviations = mosaic.map(|mosaic| mosaic.rows(cols));
    let mut deviation = vec![0.0_f32; cols];
    let mut stress = vec![0.0_f32; cols];
    let mut least_stress = vec![0.0_f32; cols];
    let valid = ground.site.sun_h.mask().as_slice();
    let rows = out.codes.chunks_mut((cols * candidates.len()).max(1));
    for (row, (codes, canopy_region)) in
        (first_row..).zip(rows.zip(out.canopy_region.chunks_mut(cols.max(1))))
    {
        means.advance(ground, row, radius);
        heights.advance(ground, row, radius);
        let cells = row * cols..(row + 1) * cols;
        let (allowed, valid) = (&ground.allowed.as_slice()[cells.clone()], &valid[cells.clone()]);
        for (height, (allowed, valid)) in heights.row.iter_mut().zip(allowed.iter().zip(valid)) {
            if !(*allowed && *valid) {
                *height = f32::INFINITY; // no species stands here
            }
        }

        // Which cells are canopy
        let chm = &ground.chm_m.values()[cells.clone()];
        let chm_valid = &ground.chm_m.mask().as_slice()[cells.clone()];
        for col in 0..cols {
            if chm_valid[col]
                && chm[col] >= ground.canopy_min_height_m
                && heights.row[col] < f32::INFINITY
            {
                canopy_region[col] = ground.regions.map_or(0, |r| r[cells.start + col]);
                out.counts.canopy[usize::from(canopy_region[col])] += 1;
            }
        }

        // How well each candidate is suited
        least_stress.fill(f32::INFINITY);
        for (at, candidate) in candidates.iter().enumerate() {
            let [sun, moisture, temperature, slope] = &means.means;
            for col in 0..cols {
                let offer = [sun[col], moisture[col], temperature[col], slope[col]];
                let is_too_tall = heights.row[col] > candidate.max_canopy_height_m;
                stress[col] = if is_too_tall { f32::INFINITY } else { candidate.stress(offer) };
            }
            for (least, stress) in least_stress.iter_mut().zip(&stress) {
                *least = if *stress < *least { *stress } else { *least };
            }
            if let Some(rows) = &mut deviations {
                rows.fill(row, candidate.species, &mut deviation);
            }
            coding.codes(&stress, &deviation, &mut codes[at * cols..(at + 1) * cols]);
            if ground.counts_limits {
                for col in (0..cols).filter(|&col| canopy_region[col] != NOT_CANOPY) {
                    let region = usize::from(canopy_region[col]);
                    if stress[col] <= MOST_STRESS_BORNE {
                        *out.counts.suited(region, at) += 1;
                    } else {
                        let limit = candidate.limit(means.offer(col));
                        *out.counts.limit(region, at, limit) += 1;
                    }
                }
            }
        }

        // What canopy lacks that no candidate can make up
        for col in 0..cols {
            if canopy_region[col] != NOT_CANOPY && least_stress[col] > MOST_STRESS_BORNE {
                let offer = means.offer(col);
                let nearest = candidates.iter().min_by(|a, b| {
                    let too_tall = |c: &Candidate| heights.row[col] > c.max_canopy_height_m;
                    let place = |c: &Candidate| (too_tall(c), c.stress(offer));
                    let ((tall_a, stress_a), (tall_b, stress_b)) = (place(a), place(b));
                    tall_a.cmp(&tall_b).then(stress_a.total_cmp(&stress_b))
                });
                if let Some(nearest) = nearest {
                    let region = usize::from(canopy_region[col]);
                    *out.counts.empty_for(region, nearest.limit(offer)) += 1;
                }
            }
        }
    }
}

/// Means of the four site maps over the square around each cell of a row, by running sums over the valid cells.
///
/// Sums of some hundred `f32` are exact in `f64` for all that sites hold, so nothing drifts along the way.
struct RowMeans {
    /// Sums down the columns of the rows within reach.
    columns: Vec<[f64; 4]>,
    column_counts: Vec<u32>,
    /// First row not yet summed.
    next_row: usize,
    first_row: usize,
    means: [Vec<f32>; 4],
}

impl RowMeans {
    fn new(ground: &Ground<'_>, first_row: usize) -> Self {
        let cols = ground.chm_m.frame().cols;
        Self {
            columns: vec![[0.0; 4]; cols],
            column_counts: vec![0; cols],
            next_row: first_row.saturating_sub(ground.radius),
            first_row,
            means: std::array::from_fn(|_| vec![0.0; cols]),
        }
    }

    fn offer(&self, col: usize) -> [f32; 4] {
        std::array::from_fn(|i| self.means[i][col])
    }

    /// Adds a row to the columns' sums, or takes it out again.
    fn add(&mut self, site: &Site, row: usize, adds: bool) {
        let cols = self.columns.len();
        let cells = row * cols..(row + 1) * cols;
        let maps = [&site.sun_h, &site.moisture_mm, &site.temperature_c, &site.slope_rad];
        let [sun, moisture, temperature, slope] = maps.map(|map| &map.values()[cells.clone()]);
        let valid = &site.sun_h.mask().as_slice()[cells.clone()];
        let (sign, count) = if adds { (1.0, 1) } else { (-1.0, 1_u32.wrapping_neg()) };
        for col in 0..cols {
            if valid[col] {
                let values = [sun[col], moisture[col], temperature[col], slope[col]];
                for (sum, value) in self.columns[col].iter_mut().zip(values) {
                    *sum += sign * f64::from(value);
                }
                self.column_counts[col] = self.column_counts[col].wrapping_add(count);
            }
        }
    }

    /// Moves on to `row`, which is the first one or follows the last.
    fn advance(&mut self, ground: &Ground<'_>, row: usize, radius: usize) {
        let frame = ground.chm_m.frame();
        while self.next_row < (row + radius + 1).min(frame.rows) {
            self.add(ground.site, self.next_row, true);
            self.next_row += 1;
        }
        if row > self.first_row && row > radius {
            self.add(ground.site, row - radius - 1, false);
        }
        let cols = frame.cols;
        let mut sums = [0.0_f64; 4];
        let mut count = 0_u32;
        for col in 0..radius.min(cols) {
            add_to(&mut sums, &self.columns[col], 1.0);
            count += self.column_counts[col];
        }
        let (mut last_count, mut share) = (0, 0.0);
        for col in 0..cols {
            if col + radius < cols {
                add_to(&mut sums, &self.columns[col + radius], 1.0);
                count += self.column_counts[col + radius];
            }
            if col > radius {
                add_to(&mut sums, &self.columns[col - radius - 1], -1.0);
                count -= self.column_counts[col - radius - 1];
            }
            if count != last_count {
                (last_count, share) = (count, 1.0 / f64::from(count.max(1)));
            }
            for (mean, sum) in self.means.iter_mut().zip(sums) {
                mean[col] = (sum * share) as f32; // a mean of f32 values
            }
        }
    }
}

#[inline]
fn add_to(sums: &mut [f64; 4], values: &[f64; 4], sign: f64) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += sign * value;
    }
}

/// The canopy's greatest height over the square around each cell of a row.
struct RowMaxima {
    /// Maxima along the rows within reach, by row number modulo the reach.
    along_rows: Vec<Vec<f32>>,
    next_row: usize,
    padded: Vec<f32>,
    spare: Vec<f32>,
    row: Vec<f32>,
}

impl RowMaxima {
    fn new(ground: &Ground<'_>, first_row: usize) -> Self {
        let cols = ground.chm_m.frame().cols;
        let width = 2 * ground.radius + 1;
        Self {
            along_rows: vec![vec![0.0; cols]; width],
            next_row: first_row.saturating_sub(ground.radius),
            padded: vec![0.0; cols + width - 1],
            spare: vec![0.0; cols + width - 1],
            row: vec![0.0; cols],
        }
    }

    /// Maxima of one row over the columns within reach, masked cells counting as bare ground.
    fn take_row(&mut self, chm_m: &Grid<f32>, row: usize, radius: usize) {
        let cols = self.row.len();
        let cells = row * cols..(row + 1) * cols;
        self.padded.fill(0.0);
        let valid = &chm_m.mask().as_slice()[cells.clone()];
        let middle = &mut self.padded[radius..radius + cols];
        for ((height, &value), &valid) in middle.iter_mut().zip(&chm_m.values()[cells]).zip(valid) {
            *height = if valid { value } else { 0.0 };
        }
        // maxima over 1, 2, 4 … cells; two of the last kind that overlap make up the width
        let width = 2 * radius + 1;
        let mut span = 1;
        let mut len = self.padded.len();
        while 2 * span <= width {
            len -= span;
            let (left, right) = (&self.padded[..len], &self.padded[span..span + len]);
            for ((to, &a), &b) in self.spare.iter_mut().zip(left).zip(right) {
                *to = larger(a, b);
            }
            std::mem::swap(&mut self.padded, &mut self.spare);
            span *= 2;
        }
        let kept = &mut self.along_rows[row % width];
        let right = &self.padded[width - span..];
        for ((to, &a), &b) in kept.iter_mut().zip(&self.padded).zip(right) {
            *to = larger(a, b);
        }
    }

    fn advance(&mut self, ground: &Ground<'_>, row: usize, radius: usize) {
        let rows = ground.chm_m.frame().rows;
        while self.next_row < (row + radius + 1).min(rows) {
            self.take_row(ground.chm_m, self.next_row, radius);
            self.next_row += 1;
        }
        let width = 2 * radius + 1;
        self.row.fill(0.0);
        for near in row.saturating_sub(radius)..(row + radius + 1).min(rows) {
            for (to, &value) in self.row.iter_mut().zip(&self.along_rows[near % width]) {
                *to = larger(*to, value);
            }
        }
    }
}

const _: () = assert!(LIMITS == 9, "four resources, two sides each, and height");

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::raster::Cell;
    use crate::species::Biome;

    #[test]
    fn codes_are_logarithms_of_vigor() {
        let biome = Biome::builtin("sonoma").unwrap();
        let coding = Coding::ln_vigor();
        let mut worst = 0.0_f32;
        for index in biome.canopy_species() {
            let candidate = Candidate::new(index, &biome.species[index], 1.15);
            let niche = &biome.species[index].niche;
            for step in 0..2000 {
                let at = step as f32 / 2000.0;
                let offer = [14.0 * at, 180.0 * at, 40.0 * at, 1.4 * at];
                for resource in 0..4 {
                    let mut here = candidate.ideals;
                    here[resource] = offer[resource];
                    let vigor = niche.vigor(here[0], here[1], here[2], here[3]);
                    let mut code = [0];
                    coding.codes(&[candidate.stress(here)], &[0.0], &mut code);
                    assert!(code[0] == 0 || vigor > 0.0, "{here:?}: code {}, {vigor}", code[0]);
                    let e_folds = f32::from(code[0]) / CODES_PER_E_FOLD;
                    let read = match code[0] {
                        0 => vigor.min(0.0),
                        _ => math::exp(e_folds + LEAST_LN_VIGOR - HEADROOM),
                    };
                    worst = worst.max((read - vigor).abs());
                }
            }
        }
        assert!(worst < 1e-3, "{worst}");
    }

    #[test]
    fn ranks_fall_with_stress_and_vanish_with_vigor() {
        let stress = [0.0, 0.2, 0.9, 1.0, 1.024, 1.0242, 2.0, f32::INFINITY];
        let mut codes = [9; 8];
        Coding::Rank.codes(&stress, &[], &mut codes);
        assert!(codes[..5].windows(2).all(|pair| pair[0] > pair[1]), "{codes:?}");
        assert!(codes[4] > 0 && codes[5..] == [0; 3], "{codes:?}");
    }

    #[test]
    fn means_and_maxima_are_those_of_the_square_around() {
        let field = |salt: usize| {
            let value = |cell: Cell| ((cell.row * 31 + cell.col * 17 + salt) % 23) as f32;
            Grid::from_fn(30, 21, 1.0, value)
        };
        let valid: Vec<bool> = (0..630).map(|i| i % 7 != 3).collect();
        let mask = Arc::new(Mask::new(valid));
        let masked =
            |grid: Grid<f32>| Grid::new(grid.frame().clone(), mask.clone(), grid.into_values());
        let site = Site {
            sun_h: masked(field(1)),
            moisture_mm: masked(field(2)),
            temperature_c: masked(field(3)),
            slope_rad: masked(field(4)),
        };
        let chm_m = masked(field(5));
        let allowed = Mask::all_valid(630);
        for radius in [0_usize, 1, 3, 40] {
            let ground = Ground {
                site: &site,
                chm_m: &chm_m,
                allowed: &allowed,
                regions: None,
                region_count: 1,
                canopy_min_height_m: 3.0,
                radius,
                counts_limits: false,
            };
            for first_row in [0_usize, 11] {
                let mut means = RowMeans::new(&ground, first_row);
                let mut maxima = RowMaxima::new(&ground, first_row);
                for row in first_row..30 {
                    means.advance(&ground, row, radius);
                    maxima.advance(&ground, row, radius);
                    for col in 0..21_usize {
                        let around = |grid: &Grid<f32>| -> Vec<f32> {
                            let rows = row.saturating_sub(radius)..row + radius + 1;
                            let cols = col.saturating_sub(radius)..col + radius + 1;
                            let cells =
                                rows.flat_map(|row| cols.clone().map(move |col| (row, col)));
                            cells
                                .filter_map(|(row, col)| grid.get(Cell { row, col }).copied())
                                .collect()
                        };
                        let moisture = around(&site.moisture_mm);
                        let mean = moisture.iter().sum::<f32>() / moisture.len().max(1) as f32;
                        assert!((means.means[1][col] - mean).abs() < 1e-4, "{row} {col}");
                        let height = around(&chm_m).into_iter().fold(0.0, f32::max);
                        assert_eq!(maxima.row[col], height, "{row} {col}");
                    }
                }
            }
        }
    }
}
