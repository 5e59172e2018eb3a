//! The ground of a forest: where it falls off to, and how well wood decays there.

use crate::math;
use crate::raster::MONTHS;
use crate::simulation::deadwood::DecayParameters;
use crate::simulation::deadwood::stock::Ground;
use crate::simulation::plot::GroundCell;
use crate::simulation::{Plot, disk_span};

/// Ground cells, row-major from the north-west corner.
#[derive(Clone, Debug)]
pub struct ForestGround {
    pub rows: usize,
    pub cols: usize,
    pub cell_m: f32,
    /// Elevation.
    pub elevation_m: Vec<f32>,
    slope_rad: Vec<f32>,
    downhill_rad: Vec<f32>,
    /// How well fungi thrive, 0..=1.
    viability: Vec<f32>,
    /// Soil water of each month in a year without drought, mm.
    usual_moisture_mm: Vec<[f32; MONTHS]>,
}

impl ForestGround {
    /// The ground of a plot whose ground cells have these elevations.
    ///
    /// # Panics
    /// If there are not as many elevations as ground cells.
    pub fn new(plot: &Plot, elevation_m: Vec<f32>, decay: &DecayParameters) -> Self {
        let ([rows, cols], cell_m) = plot.ground_size();
        assert_eq!(elevation_m.len(), rows * cols, "elevations are not on the plot's ground");
        let at = |row: usize, col: usize| elevation_m[row.min(rows - 1) * cols + col.min(cols - 1)];
        let downhill_rad = (0..rows * cols).map(|cell| {
            let (row, col) = (cell / cols, cell % cols);
            let east = at(row, col + 1) - at(row, col.saturating_sub(1));
            let north = at(row.saturating_sub(1), col) - at(row + 1, col);
            math::atan2(-east, -north)
        });
        Self {
            rows,
            cols,
            cell_m,
            downhill_rad: downhill_rad.collect(),
            slope_rad: plot.ground().iter().map(|ground| ground.slope_rad).collect(),
            usual_moisture_mm: plot.ground().iter().map(|ground| ground.moisture_mm).collect(),
            viability: plot.ground().iter().map(|ground| viability(ground, decay)).collect(),
            elevation_m,
        }
    }

    /// Memory that it takes.
    pub fn bytes(&self) -> usize {
        let measures = [&self.elevation_m, &self.slope_rad, &self.downhill_rad, &self.viability];
        measures.iter().map(|values| size_of_val(&values[..])).sum::<usize>()
            + size_of_val(&self.usual_moisture_mm[..])
    }

    /// Follows soil water that has changed.
    pub fn set_moisture(&mut self, plot: &Plot, decay: &DecayParameters) {
        let viabilities = plot.ground().iter().map(|ground| viability(ground, decay));
        self.viability.clear();
        self.viability.extend(viabilities);
    }

    /// Soil water of a month over what there is without drought.
    pub fn wetness_fraction(&self, plot: &Plot, cell: usize, month_index: usize) -> f32 {
        let usual_mm = self.usual_moisture_mm[cell][month_index];
        if usual_mm > 0.0 {
            (plot.ground()[cell].moisture_mm[month_index] / usual_mm).min(1.0)
        } else {
            1.0
        }
    }

    /// Visits the ground cells whose middles lie under a disk, and that of its own middle.
    pub fn under_disk(&self, at: [f32; 2], radius_m: f32, mut visit: impl FnMut(usize)) {
        let [east_m, south_m] = at;
        let own = self.cell_at(at);
        let mut is_own_visited = false;
        for row in disk_span(south_m, radius_m, self.rows, self.cell_m) {
            let away_m = (row as f32 + 0.5) * self.cell_m - south_m;
            let half_m = (radius_m * radius_m - away_m * away_m).max(0.0).sqrt();
            for col in disk_span(east_m, half_m, self.cols, self.cell_m) {
                let cell = row * self.cols + col;
                is_own_visited |= cell == own;
                visit(cell);
            }
        }
        if !is_own_visited {
            visit(own);
        }
    }

    /// Index of the ground cell of a place.
    #[inline]
    pub fn cell_at(&self, [east_m, south_m]: [f32; 2]) -> usize {
        // `as` cuts negatives to 0
        let line = |at_m: f32, cells: usize| ((at_m / self.cell_m) as usize).min(cells - 1);
        line(south_m, self.rows) * self.cols + line(east_m, self.cols)
    }
}

/// Yearly means decide (Peytavie et al. 2024, Eq. 10).
fn viability(ground: &GroundCell, decay: &DecayParameters) -> f32 {
    let mean = |months: &[f32; MONTHS]| months.iter().sum::<f32>() / MONTHS as f32;
    decay.viability(mean(&ground.temperature_c), mean(&ground.moisture_mm))
}

impl Ground for ForestGround {
    fn viability(&self, at: [f32; 2]) -> f32 {
        self.viability[self.cell_at(at)]
    }

    fn slope(&self, at: [f32; 2]) -> [f32; 2] {
        let cell = self.cell_at(at);
        [self.slope_rad[cell], self.downhill_rad[cell]]
    }
}
