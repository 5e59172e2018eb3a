//! Crowns around a place: how many of a species' plants near are contagious.
//!
//! # Reference
//! Peytavie et al. 2024, section 5.3.3, doi:10.1145/3641816.

/// Crowns are summed in whole units of 1/1024 m², so that their order does not matter. chosen: 10 cm² is no crown.
const UNITS_PER_M2: f32 = 1024.0;
/// Cells of a radius. chosen: a place is off by a sixteenth of the radius at most.
const CELLS_OF_RADIUS: f32 = 8.0;
/// Most cells along a side of the plot.
const MOST_CELLS: f32 = 2048.0;

/// A plant as contagion sees it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Carrier {
    /// Distance from the plot's west side.
    pub east_m: f32,
    /// Distance from the plot's north side.
    pub south_m: f32,
    /// Radius of the crown.
    pub crown_radius_m: f32,
}

/// Squared crown radii of plants, summed over a disk around each cell of a grid.
pub struct CrownSums {
    cell_m: f32,
    rows: usize,
    cols: usize,
    /// Sum around each cell, row-major.
    sums: Vec<u64>,
}

impl CrownSums {
    /// Sums within a radius over a plot that reaches as far east and south as `reach_m`.
    pub fn new(radius_m: f32, reach_m: [f32; 2], plants: impl Iterator<Item = Carrier>) -> Self {
        let cell_m =
            (radius_m / CELLS_OF_RADIUS).max(reach_m[0].max(reach_m[1]) / MOST_CELLS).max(1e-3);
        // not negative and at most 2048: truncation is floor
        let [cols, rows] = reach_m.map(|reach_m| (reach_m / cell_m) as usize + 1);
        let mut crowns = vec![0_u64; rows * cols];
        for plant in plants {
            let col = ((plant.east_m / cell_m) as usize).min(cols - 1);
            let row = ((plant.south_m / cell_m) as usize).min(rows - 1);
            let crown_m2 = plant.crown_radius_m * plant.crown_radius_m;
            crowns[row * cols + col] += (crown_m2 * UNITS_PER_M2).round() as u64; // crowns are below 2 km
        }
        // rows summed up from the west: a run of cells is a difference
        let mut up_to = vec![0_u64; rows * (cols + 1)];
        for row in 0..rows {
            for col in 0..cols {
                up_to[row * (cols + 1) + col + 1] =
                    up_to[row * (cols + 1) + col] + crowns[row * cols + col];
            }
        }
        let radius_cells = radius_m / cell_m;
        let mut sums = vec![0; rows * cols];
        for row in 0..rows {
            let reach = radius_cells as usize; // a handful
            for near in row.saturating_sub(reach)..(row + reach + 1).min(rows) {
                let away = near.abs_diff(row) as f32;
                let half = (radius_cells * radius_cells - away * away).max(0.0).sqrt() as usize;
                for col in 0..cols {
                    let (first, end) = (col.saturating_sub(half), (col + half + 1).min(cols));
                    sums[row * cols + col] +=
                        up_to[near * (cols + 1) + end] - up_to[near * (cols + 1) + first];
                }
            }
        }
        Self { cell_m, rows, cols, sums }
    }

    /// Sum of squared crown radii around a place, m².
    pub fn around_m2(&self, east_m: f32, south_m: f32) -> f32 {
        let col = ((east_m / self.cell_m) as usize).min(self.cols - 1);
        let row = ((south_m / self.cell_m) as usize).min(self.rows - 1);
        self.sums[row * self.cols + col] as f32 / UNITS_PER_M2 // rounded to 24 bits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{self, Key, Process};

    fn strewn(count: u64, side_m: f32) -> Vec<Carrier> {
        let plant = |entity| {
            let key = Key { seed: 5, process: Process::StrewnPoints, year: 0, month: 0, entity };
            let [east, south, radius, _] = rng::uniforms(key);
            Carrier {
                east_m: east * side_m,
                south_m: south * side_m,
                crown_radius_m: 0.5 + 3.0 * radius,
            }
        };
        (0..count).map(plant).collect()
    }

    #[test]
    fn sums_are_near_those_of_every_plant_within_the_radius() {
        let (side_m, radius_m) = (300.0, 40.0);
        let plants = strewn(4000, side_m);
        let sums = CrownSums::new(radius_m, [side_m; 2], plants.iter().copied());
        for place in strewn(200, side_m) {
            let near = plants.iter().filter(|plant| {
                let (x, y) = (plant.east_m - place.east_m, plant.south_m - place.south_m);
                x * x + y * y <= radius_m * radius_m
            });
            let exact: f32 = near.map(|plant| plant.crown_radius_m * plant.crown_radius_m).sum();
            let found = sums.around_m2(place.east_m, place.south_m);
            assert!((found / exact - 1.0).abs() < 0.25, "{found} for {exact}");
        }
    }

    #[test]
    fn order_does_not_matter() {
        let plants = strewn(500, 100.0);
        let forth = CrownSums::new(20.0, [100.0; 2], plants.iter().copied());
        let back = CrownSums::new(20.0, [100.0; 2], plants.iter().rev().copied());
        assert_eq!(forth.sums, back.sums);
        assert_eq!(CrownSums::new(20.0, [0.0; 2], std::iter::empty()).around_m2(3.0, 4.0), 0.0);
    }
}
