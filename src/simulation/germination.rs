//! Germination: once a year a seed may sprout in each cell; which species it is follows from what all plants leave there.
//!
//! # Reference
//! Kapp et al. 2020, section 6.1, Eq. 4, doi:10.1145/3414685.3417848.

use super::competition::CellStates;
use super::plot::Plot;
use super::traits::{AdaptationTable, Traits};
use crate::raster::MONTHS;
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

/// The seedlings of a tile's cells in a year.
pub fn sprout(
    cells: &CellStates,
    plot: &Plot,
    traits: &[Traits],
    table: &AdaptationTable,
    seed: u64,
    year: u16,
) -> Vec<Seedling> {
    let tile = cells.tile();
    let mut seedlings = Vec::new();
    let mut weights = vec![0.0; traits.len()];
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
        let of_sub_biomes = |traits: &Traits| traits.sub_biomes & seeds.sub_biomes != 0;
        let weigh = |traits: &Traits| {
            if of_sub_biomes(traits) { weight(cells, cell, plot, traits, table) } else { 0.0 }
        };
        weights.iter_mut().zip(traits).for_each(|(weight, traits)| *weight = weigh(traits));
        let Some(species) = roulette(&weights, choice) else { continue };
        seedlings.push(Seedling {
            id: u64::from(year) << 32 | (row * plot.cols + col) as u64,
            species: species as u16, // biomes have some dozens
            east_m: (col as f32 + across) * plot.cell_m,
            south_m: (row as f32 + down) * plot.cell_m,
        });
    }
    seedlings
}

/// How likely a species is among those that sprout: its mean vigor over the growing season on what plants leave to seeds,
/// and the more the sooner it bears seeds.
///
/// # Reference
/// Kapp et al. 2020, Eq. 4: w = max(0, v̄ / m^β).
fn weight(
    cells: &CellStates,
    cell: usize,
    plot: &Plot,
    traits: &Traits,
    table: &AdaptationTable,
) -> f32 {
    let ground = &plot.ground[cells.ground_at(cell)];
    let slope = table.adaptation(ground.slope_rad, traits.slope_rad);
    if slope <= 0.0 {
        return 0.0;
    }
    let (light, water_mm) = (cells.light_at(cell), cells.seed_water_mm(cell, plot));
    let (mut sum, mut months) = (0.0, 0.0);
    for month in (0..MONTHS).filter(|month| traits.years_a_month[*month] > 0.0) {
        sum += table
            .adaptation(ground.sun_h[month] * light, traits.sun_h)
            .min(table.adaptation(water_mm[month], traits.moisture_mm))
            .min(table.adaptation(ground.temperature_c[month], traits.temperature_c))
            .min(slope);
        months += 1.0;
    }
    (sum / months * traits.seed_weight).max(0.0)
}

/// An index, each as likely as its weight; none if all are 0.
fn roulette(weights: &[f32], choice: f32) -> Option<usize> {
    let total: f32 = weights.iter().sum();
    let mut left = choice * total;
    let mut last = None;
    for (index, weight) in weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0) {
        last = Some(index);
        left -= weight;
        if left < 0.0 {
            break;
        }
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roulette_gives_each_its_share_and_nothing_of_nothing() {
        let weights = [0.0, 1.0, 0.0, 3.0, 0.0];
        let mut counts = [0; 5];
        for draw in 0..1000 {
            counts[roulette(&weights, draw as f32 / 1000.0).unwrap()] += 1;
        }
        assert_eq!(counts, [0, 250, 0, 750, 0]);
        assert_eq!(roulette(&[0.0; 3], 0.5), None);
        assert_eq!(roulette(&[0.2, 0.0], 0.999_999_94), Some(0));
    }
}
