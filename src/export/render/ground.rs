//! Ground: the terrain as a surface in the picture's metres, and what grows and lies on it.

use super::vector::{UP, Vec3, vec3};
use crate::raster::{Cell, Grid};

/// A map over the picture's metres, straight between the middles of its cells.
#[derive(Clone, Debug)]
pub struct Field {
    rows: usize,
    cols: usize,
    cell_m: f32,
    west_m: f32,
    north_m: f32,
    values: Vec<f32>,
}

/// A map's cells as they lie in memory.
#[derive(Clone, Copy, Debug)]
pub struct FieldCells<'a> {
    /// Rows of cells, the first in the north.
    pub rows: usize,
    /// Cells a row.
    pub cols: usize,
    /// Width of a cell.
    pub cell_m: f32,
    /// Western edge.
    pub west_m: f32,
    /// Northern edge.
    pub north_m: f32,
    /// Row by row.
    pub values: &'a [f32],
}

impl Field {
    /// A map's values where places count from `origin` (map coordinates); `beyond` stands for what is masked.
    pub fn new(grid: &Grid<f32>, origin: [f64; 3], beyond: f32) -> Self {
        let frame = grid.frame();
        let valid = grid.mask().as_slice();
        let values = grid.values().iter().zip(valid);
        Self {
            rows: frame.rows,
            cols: frame.cols,
            cell_m: frame.cell_m(),
            // scenes are some km wide
            west_m: (frame.transform.west_m - origin[0]) as f32,
            north_m: (frame.transform.north_m - origin[1]) as f32,
            values: values.map(|(v, valid)| if *valid { *v } else { beyond }).collect(),
        }
    }

    /// Its cells.
    pub fn cells(&self) -> FieldCells<'_> {
        let Self { rows, cols, cell_m, west_m, north_m, ref values } = *self;
        FieldCells { rows, cols, cell_m, west_m, north_m, values }
    }

    /// The value at a place; beyond the rim that of the rim.
    #[inline]
    pub fn at(&self, x: f32, y: f32) -> f32 {
        let col = ((x - self.west_m) / self.cell_m - 0.5).clamp(0.0, (self.cols - 1) as f32);
        let row = ((self.north_m - y) / self.cell_m - 0.5).clamp(0.0, (self.rows - 1) as f32);
        // clamped to the map
        let (c0, r0) = (col as usize, row as usize);
        let (c1, r1) = ((c0 + 1).min(self.cols - 1), (r0 + 1).min(self.rows - 1));
        let (tc, tr) = (col - c0 as f32, row - r0 as f32);
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let north = lerp(self.values[r0 * self.cols + c0], self.values[r0 * self.cols + c1], tc);
        let south = lerp(self.values[r1 * self.cols + c0], self.values[r1 * self.cols + c1], tc);
        lerp(north, south, tr)
    }
}

/// The terrain by the corners of its cells, as it is drawn.
#[derive(Clone, Debug)]
pub struct Ground {
    /// Corners a row: one more than cells.
    pub cols: usize,
    /// Rows of corners, the first in the north.
    pub rows: usize,
    /// Distance of corners.
    pub cell_m: f32,
    /// The north-western corner.
    pub west_m: f32,
    /// The north-western corner.
    pub north_m: f32,
    /// Heights of corners; NaN where all cells around are masked.
    heights: Vec<f32>,
    /// Lowest and highest.
    pub range_m: [f32; 2],
    /// Height of grass and herbs, m.
    pub grass_m: Option<Field>,
    /// Share of the ground under leaves and twigs.
    pub litterfall: Option<Field>,
    /// How dry grass is, 0 green to 1 straw.
    pub dryness: Option<Field>,
}

impl Ground {
    /// The terrain where places count from `origin`; a scene without a valid cell lies level at 0.
    pub fn new(elevation_m: &Grid<f32>, origin: [f64; 3]) -> Self {
        let frame = elevation_m.frame();
        let (rows, cols) = (frame.rows + 1, frame.cols + 1);
        let mut heights = Vec::with_capacity(rows * cols);
        let mut range_m = [f32::INFINITY, f32::NEG_INFINITY];
        for row in 0..rows {
            for col in 0..cols {
                let (mut sum, mut count) = (0.0_f64, 0.0_f64);
                for (dr, dc) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    let (Some(r), Some(c)) = ((row + dr).checked_sub(1), (col + dc).checked_sub(1))
                    else {
                        continue;
                    };
                    if let Some(z) = elevation_m.get(Cell { row: r, col: c }) {
                        sum += f64::from(*z) - origin[2];
                        count += 1.0;
                    }
                }
                let z = (sum / count) as f32; // NaN where none is valid
                if z.is_finite() {
                    range_m = [range_m[0].min(z), range_m[1].max(z)];
                }
                heights.push(z);
            }
        }
        if range_m[0] > range_m[1] {
            range_m = [0.0, 0.0];
        }
        let transform = frame.transform;
        Self {
            cols,
            rows,
            cell_m: frame.cell_m(),
            // scenes are some km wide
            west_m: (transform.west_m - origin[0]) as f32,
            north_m: (transform.north_m - origin[1]) as f32,
            heights,
            range_m,
            grass_m: None,
            litterfall: None,
            dryness: None,
        }
    }

    /// Heights of corners, row by row; NaN where there is no ground.
    pub fn heights_m(&self) -> &[f32] {
        &self.heights
    }

    /// East and south edges.
    pub fn far_edges_m(&self) -> [f32; 2] {
        [self.west_m + self.width_m(), self.north_m - self.depth_m()]
    }

    /// Extent from west to east.
    pub fn width_m(&self) -> f32 {
        (self.cols - 1) as f32 * self.cell_m
    }

    /// Extent from north to south.
    pub fn depth_m(&self) -> f32 {
        (self.rows - 1) as f32 * self.cell_m
    }

    /// Whether a place lies over or under the terrain, not beside it.
    #[inline]
    pub fn covers(&self, place: Vec3) -> bool {
        let [east, south] = self.far_edges_m();
        place.x >= self.west_m && place.x <= east && place.y >= south && place.y <= self.north_m
    }

    /// The place of a corner; its height is NaN where there is no ground.
    #[inline]
    pub fn corner(&self, row: usize, col: usize) -> Vec3 {
        vec3(
            self.west_m + col as f32 * self.cell_m,
            self.north_m - row as f32 * self.cell_m,
            self.heights[row * self.cols + col],
        )
    }

    /// Height at a place, the rim's beyond it; `None` where there is no ground.
    #[inline]
    pub fn height_m(&self, x: f32, y: f32) -> Option<f32> {
        let [z, _, _] = self.surface(x, y);
        z.is_finite().then_some(z)
    }

    /// The unit normal at a place; up where there is no ground.
    #[inline]
    pub fn normal(&self, x: f32, y: f32) -> Vec3 {
        // over two cells, so that cells do not show as facets
        let reach = self.cell_m;
        let z = |dx: f32, dy: f32| self.surface(x + dx, y + dy)[0];
        let rise_east = (z(reach, 0.0) - z(-reach, 0.0)) / (2.0 * reach);
        let rise_north = (z(0.0, reach) - z(0.0, -reach)) / (2.0 * reach);
        let normal = vec3(-rise_east, -rise_north, 1.0).normalize_or(UP);
        if normal.is_finite() { normal } else { super::vector::UP }
    }

    #[inline]
    fn surface(&self, x: f32, y: f32) -> [f32; 3] {
        let col = ((x - self.west_m) / self.cell_m).clamp(0.0, (self.cols - 1) as f32);
        let row = ((self.north_m - y) / self.cell_m).clamp(0.0, (self.rows - 1) as f32);
        // clamped to the map
        let (c0, r0) = ((col as usize).min(self.cols - 2), (row as usize).min(self.rows - 2));
        let (tc, tr) = (col - c0 as f32, row - r0 as f32);
        let at = |r: usize, c: usize| self.heights[r * self.cols + c];
        let north = at(r0, c0) + (at(r0, c0 + 1) - at(r0, c0)) * tc;
        let south = at(r0 + 1, c0) + (at(r0 + 1, c0 + 1) - at(r0 + 1, c0)) * tc;
        [north + (south - north) * tr, tc, tr]
    }

    /// Middle of the terrain, at its mean height there.
    pub fn middle(&self) -> Vec3 {
        let x = self.west_m + 0.5 * self.width_m();
        let y = self.north_m - 0.5 * self.depth_m();
        let z = self.height_m(x, y).unwrap_or(0.5 * (self.range_m[0] + self.range_m[1]));
        vec3(x, y, z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_keeps_its_height_and_normal() {
        // rises east by a half
        let grid = Grid::from_fn(20, 30, 2.0, |cell| 100.0 + (cell.col as f32 + 0.5) * 1.0);
        let ground = Ground::new(&grid, [0.0, 0.0, 100.0]);
        let z = ground.height_m(31.0, 17.0).unwrap();
        assert!((z - 15.5).abs() < 1e-3, "{z}");
        let expected = vec3(-0.5, 0.0, 1.0).normalize_or(UP);
        assert!((ground.normal(30.0, 20.0) - expected).length() < 1e-3);
        assert_eq!(ground.far_edges_m(), [60.0, 0.0]);
        let field = Field::new(&grid, [0.0, 0.0, 0.0], 0.0);
        assert!((field.at(31.0, 17.0) - 115.5).abs() < 1e-3);
        assert!((field.at(-50.0, 17.0) - 100.5).abs() < 1e-3);
    }
}
