//! Grass: how tall grasses and herbs stand that are too small and too many to be single plants.

use rayon::prelude::*;

use crate::abiotics::AbioticMaps;
use crate::raster::MONTHS;
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

/// Suitability of a site for grass through its best season: the greatest mean over so many months in a row, the year closed
/// to a ring.
///
/// # Reference
/// Kapp et al. 2020, section 6.3: density and with it height rest on abiotic conditions.
/// # Departures
/// The paper does not say of which months; its program takes yearly means. Grass grows in its season and stands on, so the
/// best season counts: yearly means of 23 °C and dry summers hide the wet spring that grassland lives on, and those of
/// mountains hide the summer beneath the winter's frost.
#[inline]
pub fn season_suitability(by_month: &[f32; MONTHS], season_months: usize) -> f32 {
    let length = season_months.clamp(1, MONTHS);
    let two_years: [f32; 2 * MONTHS] = std::array::from_fn(|m| by_month[m % MONTHS]);
    let best =
        two_years.windows(length).map(|season| season.iter().sum::<f32>()).fold(0.0, f32::max);
    best / length as f32 // at most 12
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
    maps: &AbioticMaps,
    mut light_fraction: Vec<f32>,
    floor: &ForestFloor,
    params: &GrassParams,
) -> Vec<f32> {
    let mask = maps.slope_rad.mask();
    let moisture_mm: [&[f32]; MONTHS] = std::array::from_fn(|m| maps.moisture_mm.month(m));
    let sunlight_h: [&[f32]; MONTHS] = std::array::from_fn(|m| maps.sunlight_h.month(m));
    let cell = |(index, height): (usize, &mut f32)| {
        if !mask.is_valid(index) {
            *height = 0.0;
            return;
        }
        let by_month = std::array::from_fn(|m| {
            let temperature_c = maps.temperature_c.at(m, index);
            floor.suitability(moisture_mm[m][index], temperature_c, sunlight_h[m][index])
        });
        let suitability = season_suitability(&by_month, params.season_months);
        *height = height_m(floor.max_grass_height_m, suitability, *height);
        assert!(height.is_finite(), "grass of cell {index} has no height");
    };
    light_fraction.par_iter_mut().enumerate().with_min_len(1 << 12).for_each(cell);
    light_fraction
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::species::Biome;

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
