//! Density of contagious plants around a place.
//!
//! # Reference
//! Peytavie et al. 2024, section 5.3.3, doi:10.1145/3641816.

/// Crowns are summed in whole units of 1/1024 m², so that their order does not matter. chosen: 10 cm² is no crown.
const UNITS_PER_M2: f32 = 1024.0;
/// Most buckets along a side of the plot. chosen: a table of them still fits a core's cache.
const MOST_BUCKETS: f32 = 512.0;

/// A contagious plant.
#[derive(Clone, Copy, Debug, Default)]
pub struct Carrier {
    /// Distance from the plot's west side.
    pub east_m: f32,
    /// Distance from the plot's north side.
    pub south_m: f32,
    /// Radius of the crown.
    pub crown_radius_m: f32,
}

/// The contagious plants, bucket by bucket in rows of square buckets.
pub struct Contagion {
    radius_m: f32,
    /// Squared crown radii that make a density of 1.
    full_units: u64,
    bucket_m: f32,
    /// North-west corner of the first bucket: east, south.
    corner_m: [f32; 2],
    rows: usize,
    cols: usize,
    /// Where each bucket's plants begin; one more at the end.
    starts: Vec<usize>,
    east_m: Vec<f32>,
    south_m: Vec<f32>,
    /// Square of each plant's crown radius.
    crown_units: Vec<u32>,
}

impl Contagion {
    /// Buckets of the carriers, for questions about the plants within a radius.
    pub fn new(radius_m: f32, carriers: &[Carrier]) -> Self {
        let (mut low_m, mut high_m) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for carrier in carriers {
            for (axis, at_m) in [carrier.east_m, carrier.south_m].into_iter().enumerate() {
                low_m[axis] = low_m[axis].min(at_m);
                high_m[axis] = high_m[axis].max(at_m);
            }
        }
        let extent_m = [0, 1].map(|axis| (high_m[axis] - low_m[axis]).max(0.0));
        // a third of the radius: few plants out of reach are looked at
        let bucket_m = (radius_m / 3.0).max(extent_m[0].max(extent_m[1]) / MOST_BUCKETS).max(1e-3);
        // not negative and at most 512: truncation is floor
        let [cols, rows] = extent_m.map(|extent_m| (extent_m / bucket_m) as usize + 1);
        let bucket = |carrier: &Carrier| {
            let col = ((carrier.east_m - low_m[0]) / bucket_m) as usize;
            let row = ((carrier.south_m - low_m[1]) / bucket_m) as usize;
            row.min(rows - 1) * cols + col.min(cols - 1)
        };
        let mut starts = vec![0; rows * cols + 1];
        for carrier in carriers {
            starts[bucket(carrier) + 1] += 1;
        }
        for index in 1..starts.len() {
            starts[index] += starts[index - 1];
        }
        let mut next = starts.clone();
        let (mut east_m, mut south_m) = (vec![0.0; carriers.len()], vec![0.0; carriers.len()]);
        let mut crown_units = vec![0; carriers.len()];
        for carrier in carriers {
            let slot = &mut next[bucket(carrier)];
            let crown2_m2 = carrier.crown_radius_m * carrier.crown_radius_m;
            (east_m[*slot], south_m[*slot]) = (carrier.east_m, carrier.south_m);
            crown_units[*slot] = (crown2_m2 * UNITS_PER_M2).round() as u32; // crowns are below 2 km
            *slot += 1;
        }
        let full_units = ((radius_m * radius_m * UNITS_PER_M2) as u64).max(1); // to less than a unit
        Self {
            radius_m,
            full_units,
            bucket_m,
            corner_m: low_m,
            rows,
            cols,
            starts,
            east_m,
            south_m,
            crown_units,
        }
    }

    /// Share of the surroundings that crowns of contagious plants cover, overlaps counted twice, at most 1 (d_i).
    ///
    /// # Reference
    /// Peytavie et al. 2024, section 5.3.3: d_i = Σ r_j² / r_spread².
    /// # Departures
    /// Clamped to 1 (PAPER_NOTES §10), since crowns overlap.
    pub fn density_fraction(&self, east_m: f32, south_m: f32) -> f32 {
        let Some((west, east)) = self.reach(east_m - self.corner_m[0], self.cols) else {
            return 0.0;
        };
        let Some((north, south)) = self.reach(south_m - self.corner_m[1], self.rows) else {
            return 0.0;
        };
        let reach2_m2 = self.radius_m * self.radius_m;
        let mut units = 0;
        for row in north..=south {
            let range =
                self.starts[row * self.cols + west]..self.starts[row * self.cols + east + 1];
            let places = self.east_m[range.clone()].iter().zip(&self.south_m[range.clone()]);
            for ((plant_east_m, plant_south_m), crown_units) in places.zip(&self.crown_units[range])
            {
                let (right_m, down_m) = (plant_east_m - east_m, plant_south_m - south_m);
                let is_near = right_m * right_m + down_m * down_m <= reach2_m2;
                units += if is_near { u64::from(*crown_units) } else { 0 };
            }
            if units >= self.full_units {
                return 1.0; // the rest cannot add to it
            }
        }
        units as f32 / self.full_units as f32 // rounded to 24 bits
    }

    /// First and last bucket along an axis that are within the radius; none if all lie beyond it.
    fn reach(&self, from_corner_m: f32, count: usize) -> Option<(usize, usize)> {
        let first = ((from_corner_m - self.radius_m) / self.bucket_m).floor();
        let last = ((from_corner_m + self.radius_m) / self.bucket_m).floor();
        let is_within = !self.east_m.is_empty() && last >= 0.0 && first < count as f32;
        // a cast takes what is negative to 0
        is_within.then(|| (first as usize, (last as usize).min(count - 1)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{self, Key, Process};

    fn carriers(count: u64, side_m: f32, crown_radius_m: f32) -> Vec<Carrier> {
        let carrier = |entity| {
            let key = Key { seed: 8, process: Process::StrewnPoints, year: 0, month: 0, entity };
            let [east, south, size, _] = rng::uniforms(key);
            Carrier {
                east_m: east * side_m,
                south_m: south * side_m,
                crown_radius_m: crown_radius_m * (0.5 + size),
            }
        };
        (0..count).map(carrier).collect()
    }

    #[test]
    fn buckets_find_what_a_search_of_all_plants_finds() {
        let carriers = carriers(600, 300.0, 3.0);
        let places = [[150.0, 150.0], [2.0, 299.0], [-20.0, 100.0], [340.0, 340.0], [900.0, 9.0]];
        for radius_m in [50.0, 7.0, 0.1] {
            let contagion = Contagion::new(radius_m, &carriers);
            for [east_m, south_m] in places {
                let is_near = |carrier: &&Carrier| {
                    let (right_m, down_m) = (carrier.east_m - east_m, carrier.south_m - south_m);
                    right_m * right_m + down_m * down_m <= radius_m * radius_m
                };
                let crown2_m2 = |carrier: &Carrier| carrier.crown_radius_m.powi(2);
                let sum_m2: f32 = carriers.iter().filter(is_near).map(crown2_m2).sum();
                let expected = (sum_m2 / (radius_m * radius_m)).min(1.0);
                assert!((contagion.density_fraction(east_m, south_m) - expected).abs() < 1e-4);
            }
        }
        assert_eq!(Contagion::new(50.0, &[]).density_fraction(1.0, 1.0), 0.0);
    }

    #[test]
    fn overlapping_crowns_count_as_one_at_most() {
        // the printed density is above 6
        let contagion = Contagion::new(50.0, &carriers(600, 60.0, 6.0));
        assert_eq!(contagion.density_fraction(30.0, 30.0), 1.0);
    }
}
