//! Grass: how tall grasses and herbs stand that are too small and too many to be single plants.

use std::collections::VecDeque;

use rayon::prelude::*;

use crate::abiotics::AbioticMaps;
use crate::raster::{Grid, MONTHS};
use crate::species::biome::ForestFloor;

/// How grass is worked out.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct GrassParams {
    /// Months in a row that a sward takes to reach its height, 1–12 (others are taken as the nearest).
    pub season_months: usize,
}

impl Default for GrassParams {
    fn default() -> Self {
        // chosen: both the spring flush of annual grassland (UC ANR 8018) and the first growth of meadows last about
        // three months
        Self { season_months: 3 }
    }
}

/// Suitability of a site's cells for grass through their best season, worked out from the months one after the other: the
/// greatest mean over so many months in a row, the year closed to a ring.
///
/// # Reference
/// Kapp et al. 2020, section 6.3: density and with it height rest on abiotic conditions.
/// # Departures
/// The paper does not say of which months; its program takes yearly means. Grass grows in its season and stands on, so the
/// best season counts: yearly means of 23 °C and dry summers hide the wet spring that grassland lives on, and those of
/// mountains hide the summer beneath the winter's frost.
pub struct SeasonSuitability {
    season_months: usize,
    /// Months that a season over the new year ends with.
    first: Vec<Vec<f32>>,
    /// The newest months, fewer than a season.
    last: VecDeque<Vec<f32>>,
    best: Vec<f32>,
}

impl SeasonSuitability {
    /// Before January of so many cells.
    pub fn new(cells: usize, params: &GrassParams) -> Self {
        Self {
            season_months: params.season_months.clamp(1, MONTHS),
            first: Vec::new(),
            last: VecDeque::new(),
            best: vec![0.0; cells],
        }
    }

    /// Takes the next month's suitability.
    pub fn add_month(&mut self, suitability: Vec<f32>) {
        assert_eq!(suitability.len(), self.best.len(), "a month of other cells");
        if self.first.len() + 1 < self.season_months {
            self.first.push(suitability.clone());
        }
        self.end_season_with(suitability);
    }

    fn end_season_with(&mut self, month: Vec<f32>) {
        self.last.push_back(month);
        if self.last.len() == self.season_months {
            let last = &self.last;
            self.best.par_iter_mut().enumerate().with_min_len(1 << 12).for_each(|(cell, best)| {
                let sum: f32 = last.iter().map(|month| month[cell]).sum();
                *best = best.max(sum / last.len() as f32); // at most 12
            });
            self.last.pop_front();
        }
    }

    /// Suitability in 0..=1 once all twelve months were taken.
    pub fn finish(mut self) -> Vec<f32> {
        for month in std::mem::take(&mut self.first) {
            self.end_season_with(month);
        }
        self.best
    }
}

/// Suitability of a site for grass, each cell's best season.
pub fn suitability(maps: &AbioticMaps, floor: &ForestFloor, params: &GrassParams) -> Vec<f32> {
    let cells = maps.slope_rad.frame().len();
    let mut season = SeasonSuitability::new(cells, params);
    for month in 0..MONTHS {
        let (moisture_mm, sun_h) = (maps.moisture_mm.month(month), maps.sunlight_h.month(month));
        let of_cell = |cell: usize| {
            floor.suitability(moisture_mm[cell], maps.temperature_c.at(month, cell), sun_h[cell])
        };
        season.add_month((0..cells).into_par_iter().with_min_len(1 << 12).map(of_cell).collect());
    }
    season.finish()
}

/// Height of grass in m: the biome's greatest, by how well the site suits and how much light reaches the ground.
///
/// # Reference
/// Kapp et al. 2020, section 6.3: density, which translates directly to height, is reduced by the alpha of incident crowns.
#[inline]
pub fn height_m(max_grass_height_m: f32, suitability: f32, light_fraction: f32) -> f32 {
    max_grass_height_m * suitability * light_fraction
}

/// Height of grass on every cell in m, in the place of the share of light that reaches its ground. 0 where masked.
///
/// Steep rock needs no rule of its own: from the slope on that no rain infiltrates, its soil is too dry for grass.
/// # Departures
/// The authors' program shades grass by canopy trees only; here all plants do.
pub fn heights_m(
    suitability: &Grid<f32>,
    mut light_fraction: Vec<f32>,
    floor: &ForestFloor,
) -> Vec<f32> {
    let mask = suitability.mask();
    let cell = |(index, height): (usize, &mut f32)| {
        if !mask.is_valid(index) {
            *height = 0.0;
            return;
        }
        *height = height_m(floor.max_grass_height_m, suitability.values()[index], *height);
        assert!(height.is_finite(), "grass of cell {index} has no height");
    };
    light_fraction.par_iter_mut().enumerate().with_min_len(1 << 12).for_each(cell);
    light_fraction
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::species::Biome;

    fn season_suitability(by_month: &[f32; MONTHS], season_months: usize) -> f32 {
        let mut season = SeasonSuitability::new(1, &GrassParams { season_months });
        by_month.iter().for_each(|month| season.add_month(vec![*month]));
        season.finish()[0]
    }

    #[test]
    fn the_best_months_in_a_row_count_also_over_the_new_year() {
        let mut by_month = [0.0; MONTHS];
        assert_eq!(season_suitability(&by_month, 3), 0.0);
        for month in [11, 0, 1] {
            by_month[month] = 0.9;
        }
        by_month[6] = 1.0; // one good month makes no sward
        assert!((season_suitability(&by_month, 3) - 0.9).abs() < 1e-6);
        assert_eq!(season_suitability(&by_month, 1), 1.0);
        assert!((season_suitability(&by_month, 12) - 3.7 / 12.0).abs() < 1e-6);
        assert_eq!(season_suitability(&[1.0; MONTHS], 3), 1.0);
    }

    #[test]
    fn the_season_differs_from_yearly_means_where_summers_are_dry() {
        let floor = Biome::builtin("sonoma").unwrap().forest_floor;
        let moisture_mm = [90., 80., 70., 40., 15., 4., 0., 0., 0., 5., 40., 80.];
        let temperature_c =
            [13.5, 16.4, 18.6, 20.9, 24.4, 28.4, 32.1, 30.4, 29.3, 25.2, 18.2, 13.4];
        let by_month =
            std::array::from_fn(|m| floor.suitability(moisture_mm[m], temperature_c[m], 7.0));
        assert_eq!(season_suitability(&by_month, 3), 1.0);
        // half the water still makes a full spring, of which the yearly mean of 17.7 mm knows nothing
        let half: [f32; MONTHS] =
            std::array::from_fn(|m| floor.suitability(moisture_mm[m] * 0.5, temperature_c[m], 7.0));
        let mean_mm = moisture_mm.iter().sum::<f32>() / 24.0;
        let yearly = floor.suitability(mean_mm, 22.6, 7.0);
        assert!(season_suitability(&half, 3) > 0.99 && yearly < 0.6, "{yearly}");
    }

    #[test]
    fn height_falls_in_proportion_to_the_light_that_is_left() {
        assert_eq!(height_m(0.6, 1.0, 1.0), 0.6);
        assert!((height_m(0.6, 1.0, 0.25) - 0.15).abs() < 1e-7);
        assert_eq!(height_m(0.6, 0.0, 1.0), 0.0);
    }
}
