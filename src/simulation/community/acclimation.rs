//! Acclimation: trees that stand in a canopy from the start live where they stand.
//!
//! A measured canopy, or shares of species that were asked for, may put a tree where its neighbours' crowns leave it less light or
//! water than its niche asks for. That it stands there says that it bears it: sun leaves where there is sun, roots where there is
//! water. So a tree is given as much as keeps it alive where it stands, and no more; its seedlings are not, and what gets worse
//! afterwards it suffers as others do.
//!
//! # Departures
//! Peytavie et al. 2024 begin with bare ground and need none of this. Without it two thirds of live oaks that stood among
//! firs died within five years.

use rayon::prelude::*;

use super::Community;
use crate::raster::MONTHS;
use crate::simulation::carbon_pool;
use crate::simulation::competition::{Competitor, Shares, Tile};
use crate::species::niche;

/// Halvings of what a tree may need. chosen: to within 10⁻⁴ of the best vigor.
const HALVINGS: usize = 11;

impl Community {
    /// Gives each plant that is `standing`, an entry a plant, what it needs to live on the light and water it has now.
    ///
    /// # Panics
    /// But in whole forests.
    pub fn acclimate(&mut self, standing: &[bool]) {
        assert_eq!(standing.len(), self.acclimation.len(), "plants that know no acclimation");
        let tiles = Tile::all(&self.plot);
        let by_tile = self.by_tile(tiles.len());
        let mut parts: Vec<(u32, Shares)> = tiles
            .par_iter()
            .zip(by_tile)
            .flat_map_iter(|(tile, mut plants)| {
                self.sort_by_height(&mut plants);
                let competitors: Vec<Competitor> =
                    plants.iter().map(|plant| self.competitor(*plant)).collect();
                let (shares, _) = tile.compete(&self.plot, &self.traits, &competitors);
                plants.into_iter().zip(shares).filter(|(plant, _)| standing[*plant as usize])
            })
            .collect();
        // crowns over several tiles: their shares are added up in the order of tiles
        parts.sort_by_key(|(plant, _)| *plant);
        let needs: Vec<(u32, f32)> = parts
            .par_chunk_by(|a, b| a.0 == b.0)
            .map(|parts| {
                let (plant, mut shares) = parts[0];
                parts[1..].iter().for_each(|(_, part)| shares.add(part));
                let index = plant as usize;
                (plant, need(&self.vigor_on(index, &shares), self.pool_capacity(index)))
            })
            .collect();
        for (plant, need) in needs {
            self.acclimation[plant as usize] = need;
        }
    }
}

/// The least that, added in each month, lets a pool of this capacity last through years of this vigor.
fn need(vigor: &[f32; MONTHS], capacity: f32) -> f32 {
    let lasts = |added: f32| {
        let mut pool = capacity;
        let mut at_new_year = pool;
        // years on end: what a year takes away, the next ones do too
        for _ in 0..2 {
            at_new_year = pool;
            for month in vigor {
                (pool, _) = carbon_pool::after_month(pool, month + added, capacity);
                if pool < 0.0 {
                    return false;
                }
            }
        }
        pool >= at_new_year
    };
    if lasts(0.0) {
        return 0.0;
    }
    // with the greatest stress made up for, no month takes anything
    let (mut too_little, mut enough) = (0.0, niche::MOST_STRESS);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (too_little + enough);
        if lasts(middle) { enough = middle } else { too_little = middle }
    }
    enough
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lowest_in_a_century(vigor: &[f32; MONTHS], added: f32, capacity: f32) -> f32 {
        let (mut pool, mut lowest) = (capacity, capacity);
        for month in vigor.iter().cycle().take(100 * MONTHS) {
            (pool, _) = carbon_pool::after_month(pool, month + added, capacity);
            lowest = lowest.min(pool);
        }
        lowest
    }

    #[test]
    fn the_need_is_the_least_that_keeps_a_pool_from_being_overdrawn() {
        let all_bad = [-0.2; MONTHS];
        let dry_summer: [f32; MONTHS] =
            std::array::from_fn(|m| if (4..10).contains(&m) { -0.2 } else { 0.1 });
        let fair: [f32; MONTHS] =
            std::array::from_fn(|m| if (5..8).contains(&m) { -0.2 } else { 0.4 });
        for (vigor, capacity) in [(all_bad, 2.5), (dry_summer, 2.5), (dry_summer, 0.7)] {
            let need = need(&vigor, capacity);
            assert!(need > 0.0 && need <= niche::MOST_STRESS, "{need}");
            assert!(lowest_in_a_century(&vigor, need, capacity) > -1e-4);
            assert!(lowest_in_a_century(&vigor, need - 0.005, capacity) < 0.0);
        }
        assert_eq!(need(&fair, 2.5), 0.0);
    }
}
