//! A downed log: where it lies, and how far it has rotted.

use super::decay;
use crate::math;
use crate::plants::deadwood::{Cause, DownedLogKind, frustum_m3};

/// Wood on the ground. Places are metres from the plot's north-west corner.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DownedLog {
    /// Unique among the downed logs of a simulation.
    pub id: u64,
    /// The id of the plant that it comes from.
    pub parent_id: u64,
    /// Index of its species.
    pub species: u16,
    /// What part of the tree it is.
    pub kind: DownedLogKind,
    /// Thick end, metres east.
    pub east_m: f32,
    /// Thick end, metres south.
    pub south_m: f32,
    /// Length on the map.
    pub length_m: f32,
    /// Diameter of the thick end.
    pub diameter_base_m: f32,
    /// Diameter of the thin end.
    pub diameter_tip_m: f32,
    /// Direction from the thick end to the thin one, clockwise from north.
    pub azimuth_rad: f32,
    /// Years of decay at the best rate that lie behind it, as a snag too.
    pub decayed_years: f32,
    /// Years of decay that it lasts.
    pub deathspan_years: f32,
    /// Year in which it came down.
    pub year: u16,
    /// What brought it down.
    pub cause: Cause,
}

/// Least diameter of the thick end. chosen: the bound between fine and coarse woody debris in forest inventories
/// (Woodall & Monleon 2008: 7.6 cm).
pub const LEAST_DIAMETER_M: f32 = 0.075;

impl DownedLog {
    /// Density of its wood over that at death.
    pub fn density_fraction(&self) -> f32 {
        decay::density_fraction(self.decayed_years / self.deathspan_years)
    }

    /// Decay class, 1–5.
    pub fn decay_class(&self) -> u8 {
        decay::class(self.density_fraction())
    }

    /// Whether it has rotted away.
    pub fn is_gone(&self) -> bool {
        self.decayed_years >= self.deathspan_years
    }

    /// Ages by years of decay.
    pub fn age(&mut self, years: f32) {
        self.decayed_years = (self.decayed_years + years).min(self.deathspan_years);
    }

    /// Volume when it came down, m³: that of a truncated cone.
    pub fn volume_m3(&self) -> f32 {
        // a tree's volume: far within f32
        frustum_m3(self.length_m, self.diameter_base_m, self.diameter_tip_m) as f32
    }

    /// Its middle, metres east and south.
    pub fn middle_m(&self) -> [f32; 2] {
        let (east, south) = (math::sin(self.azimuth_rad), -math::cos(self.azimuth_rad));
        let half_m = 0.5 * self.length_m;
        [self.east_m + half_m * east, self.south_m + half_m * south]
    }

    /// Visits the cells, `cell_m` wide, that it lies on, by row and column: those under points a third of a cell apart
    /// along it.
    pub fn cells(
        &self,
        [rows, cols]: [usize; 2],
        cell_m: f32,
        mut visit: impl FnMut(usize, usize),
    ) {
        let steps = (3.0 * self.length_m / cell_m).ceil().max(1.0);
        let (east, south) = (math::sin(self.azimuth_rad), -math::cos(self.azimuth_rad));
        for step in 0..=steps as usize {
            let along_m = self.length_m * step as f32 / steps;
            let (x, y) = (self.east_m + along_m * east, self.south_m + along_m * south);
            let (col, row) = ((x / cell_m).floor(), (y / cell_m).floor());
            if row >= 0.0 && col >= 0.0 && (row as usize) < rows && (col as usize) < cols {
                visit(row as usize, col as usize);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_lies_on_the_cells_along_it() {
        let downed_log = DownedLog {
            id: 0,
            parent_id: 1,
            species: 0,
            kind: DownedLogKind::Trunk,
            east_m: 1.25,
            south_m: 2.25,
            length_m: 2.0,
            diameter_base_m: 0.3,
            diameter_tip_m: 0.3,
            azimuth_rad: std::f32::consts::FRAC_PI_2,
            decayed_years: 0.0,
            deathspan_years: 30.0,
            year: 1,
            cause: Cause::Storm,
        };
        let mut cells = Vec::new();
        downed_log.cells([10, 6], 0.5, |row, col| cells.push((row, col)));
        cells.dedup();
        assert_eq!(cells, [(4, 2), (4, 3), (4, 4), (4, 5)]);
        assert!((downed_log.volume_m3() - 0.1414).abs() < 1e-3);
    }
}
