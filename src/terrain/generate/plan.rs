//! The large forms of a landscape: the main valley, its mouth, and where rock is lifted.

use rayon::prelude::*;

use super::GenerateParams;
use super::extent::Extent;
use super::noise::{Field, Noise, by_rows};
use crate::math::{exp, sin, smoothstep};

/// Wavelength of the largest ridges as a share of the longer side.
const RIDGE_WAVELENGTH_FRACTION: f64 = 0.8;

/// The large forms: where the main valley runs and where rock is lifted fastest.
pub struct Plan {
    seed: u64,
    /// Quarter turns from a river that leaves in the south.
    turns: usize,
    width_m: f64,
    height_m: f64,
    /// Bends of the main valley: amplitude as a share of the half width, phase, waves along it.
    bends: [[f32; 3]; 2],
    /// Where the valley's axis lies across the map on average, −1..1.
    offset: f32,
}

impl Plan {
    /// The plan of a landscape.
    pub fn new(params: &GenerateParams) -> Self {
        let noise = Noise { seed: params.seed, field: Field::Plan };
        let (width_m, height_m) =
            (params.cols as f64 * params.cell_m, params.rows as f64 * params.cell_m);
        let draw = |n| noise.uniform(n);
        // a long map has its valley along it
        let turns = match (width_m / height_m, draw(0)) {
            (ratio, d) if ratio > 1.5 => {
                if d < 0.5 {
                    1
                } else {
                    3
                }
            }
            (ratio, d) if ratio < 0.67 => {
                if d < 0.5 {
                    0
                } else {
                    2
                }
            }
            (_, d) => (d * 4.0) as usize, // 0..=3
        };
        let tau = std::f32::consts::TAU;
        Self {
            seed: params.seed,
            turns,
            width_m,
            height_m,
            bends: [
                [0.14 + 0.16 * draw(1), tau * draw(2), 0.55 + 0.4 * draw(3)],
                [0.05 + 0.06 * draw(4), tau * draw(5), 1.4 + 0.8 * draw(6)],
            ],
            offset: 0.7 * (draw(7) - 0.5),
        }
    }

    /// Place in the valley's own coordinates: across −1..1, and along from 0 at the head to 1 at the mouth (on the map).
    fn across_and_along(&self, extent: &Extent, row: usize, col: usize) -> (f32, f32) {
        let x = (extent.center_east_m(col) / self.width_m) as f32;
        let y = (extent.center_north_m(row) / self.height_m) as f32;
        match self.turns {
            0 => (2.0 * x - 1.0, 1.0 - y),
            1 => (2.0 * y - 1.0, 1.0 - x),
            2 => (1.0 - 2.0 * x, y),
            _ => (1.0 - 2.0 * y, x),
        }
    }

    /// Where the main valley lies across the map.
    fn axis(&self, along: f32) -> f32 {
        let bend = |[amplitude, phase, waves]: [f32; 3]| {
            amplitude * sin(phase + waves * std::f32::consts::TAU * along)
        };
        self.offset + self.bends.into_iter().map(bend).sum::<f32>()
    }

    /// Cells of the working edge where the river leaves, kept at their height.
    pub fn outlets(&self, extent: &Extent) -> Vec<u32> {
        let edge: Vec<usize> = match self.turns {
            0 => (0..extent.cols).map(|col| (extent.rows - 1) * extent.cols + col).collect(),
            1 => (0..extent.rows).map(|row| row * extent.cols).collect(),
            2 => (0..extent.cols).collect(),
            _ => (0..extent.rows).map(|row| (row + 1) * extent.cols - 1).collect(),
        };
        let distance = |cell: usize| {
            let (across, along) =
                self.across_and_along(extent, cell / extent.cols, cell % extent.cols);
            (across - self.axis(along)).abs()
        };
        let nearest = edge.into_iter().min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
        nearest.into_iter().map(|cell| cell as u32).collect() // cells number less than 2³²
    }

    /// A first surface: a trough that falls to the mouth between rising flanks, and noise.
    pub fn first_sketch_m(&self, extent: &Extent, relief_m: f32) -> Vec<f32> {
        let longer_m = self.width_m.max(self.height_m);
        let hills = Noise { seed: self.seed, field: Field::Hills };
        let rough = hills.fractal(0.4 * longer_m, 8, 0.6, extent);
        by_rows(extent, |row, out| {
            for (col, z) in out.iter_mut().enumerate() {
                let (across, along) = self.across_and_along(extent, row, col);
                let flank = (across - self.axis(along)).abs().min(1.0);
                let upstream = (1.0 - along).max(-0.3);
                *z = relief_m
                    * (0.45 * upstream + 0.5 * flank + 0.18 * rough[row * extent.cols + col]);
            }
        })
    }

    /// Slope at which ground slides: some rock stands steeper than other.
    pub fn critical_slope(&self, extent: &Extent, steepest: f32) -> Vec<f32> {
        let longer_m = self.width_m.max(self.height_m);
        let rock = Noise { seed: self.seed, field: Field::Rock };
        let mut slope = rock.fractal(0.25 * longer_m, 4, 0.6, extent);
        slope.par_iter_mut().for_each(|s| *s = steepest * (1.0 + 0.3 * *s).max(0.5));
        slope
    }

    /// How fast rock rises against the landscape's mean, about 0.2..2: slow along the main valley and at its mouth.
    pub fn uplift(&self, extent: &Extent) -> Vec<f32> {
        let longer_m = self.width_m.max(self.height_m);
        let ridges = Noise { seed: self.seed, field: Field::Ridges }.ridged(
            RIDGE_WAVELENGTH_FRACTION * longer_m,
            6,
            extent,
        );
        let texture = Noise { seed: self.seed, field: Field::Texture }.fractal(
            0.12 * longer_m,
            4,
            0.6,
            extent,
        );
        by_rows(extent, |row, out| {
            for (col, rate) in out.iter_mut().enumerate() {
                let cell = row * extent.cols + col;
                let (across, along) = self.across_and_along(extent, row, col);
                let off = across - self.axis(along);
                let trough = exp(-(off * off) / 0.2);
                let headwaters = smoothstep(1.0 - along);
                let rise = 0.6 + 0.35 * ridges[cell] + 0.2 * texture[cell];
                *rate = (rise * (1.0 - 0.5 * trough) * (0.7 + 0.5 * headwaters)).max(0.1);
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_maps_have_their_valley_along_them() {
        for (rows, cols) in [(40, 400), (400, 40)] {
            for seed in 0..6 {
                let params = GenerateParams { rows, cols, seed, ..GenerateParams::default() };
                let plan = Plan::new(&params);
                assert_eq!(plan.turns % 2 == 1, cols > rows, "seed {seed}");
            }
        }
    }

    #[test]
    fn the_outlet_lies_on_the_edge_where_the_valley_ends() {
        for seed in 0..8 {
            let params = GenerateParams { rows: 30, cols: 40, seed, ..GenerateParams::default() };
            let plan = Plan::new(&params);
            let extent = Extent { rows: 30, cols: 40, cell_m: 2.0, west_m: 0.0, north_m: 60.0 };
            let outlet = plan.outlets(&extent)[0] as usize;
            let (across, along) = plan.across_and_along(&extent, outlet / 40, outlet % 40);
            assert!(along > 0.95, "along {along}");
            assert!((across - plan.axis(along)).abs() < 0.1);
        }
    }
}
