//! The ground a landscape is worked on: wider than the map, in cells of some level of detail.

/// Size and place of a working grid; row 0 lies north.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
    /// Cell width.
    pub cell_m: f64,
    /// Easting of the west edge.
    pub west_m: f64,
    /// Northing of the north edge.
    pub north_m: f64,
}

impl Extent {
    /// Number of cells.
    pub fn len(&self) -> usize {
        self.rows * self.cols
    }

    /// Northing of the south edge.
    pub fn south_m(&self) -> f64 {
        self.north_m - self.rows as f64 * self.cell_m
    }

    /// Easting of the east edge.
    pub fn east_m(&self) -> f64 {
        self.west_m + self.cols as f64 * self.cell_m
    }

    /// Easting of a column's centres.
    pub fn center_east_m(&self, col: usize) -> f64 {
        self.west_m + (col as f64 + 0.5) * self.cell_m
    }

    /// Northing of a row's centres.
    pub fn center_north_m(&self, row: usize) -> f64 {
        self.north_m - (row as f64 + 0.5) * self.cell_m
    }

    /// The cell's absolute map position: cells east and north of the origin.
    pub fn absolute_cell(&self, row: usize, col: usize) -> (i64, i64) {
        // the map lies far within ±2⁵³ cells of the origin
        let east = (self.center_east_m(col) / self.cell_m).floor() as i64;
        let north = (self.center_north_m(row) / self.cell_m).floor() as i64;
        (east, north)
    }

    /// The same ground in cells of half the width.
    pub fn halved(&self) -> Self {
        Self { rows: self.rows * 2, cols: self.cols * 2, cell_m: self.cell_m / 2.0, ..*self }
    }
}

/// Values of an extent, interpolated bilinearly onto its [`Extent::halved`], each fine cell's drawn from a place
/// shifted by so many coarse cells east and north.
pub fn upsample_bent(
    values: &[f32],
    extent: &Extent,
    shift_east_cells: &[f32],
    shift_north_cells: &[f32],
) -> Vec<f32> {
    let fine = extent.halved();
    super::noise::by_rows(&fine, |row, out| {
        for (col, value) in out.iter_mut().enumerate() {
            let cell = row * fine.cols + col;
            let x = (col as f32 - 0.5) / 2.0 + shift_east_cells[cell];
            let y = (row as f32 - 0.5) / 2.0 - shift_north_cells[cell];
            let (left, right, u) = between(x, extent.cols);
            let (upper, lower, v) = between(y, extent.rows);
            let across = |row: usize| {
                let line = &values[row * extent.cols..][..extent.cols];
                line[left] + u * (line[right] - line[left])
            };
            let (above, below) = (across(upper), across(lower));
            *value = above + v * (below - above);
        }
    })
}

/// The lines on both sides of a place counted in line centres, and how far it lies from the first to the second.
fn between(place: f32, count: usize) -> (usize, usize, f32) {
    let place = place.clamp(0.0, (count - 1) as f32);
    let first = place as usize;
    (first, (first + 1).min(count - 1), place - first as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn upsampling_keeps_a_plane_inside_and_the_place_of_cells() {
        let coarse = Extent { rows: 5, cols: 6, cell_m: 4.0, west_m: 8.0, north_m: 20.0 };
        let plane = |e: &Extent, row, col| {
            (2.0 * e.center_east_m(col) - 3.0 * e.center_north_m(row)) as f32
        };
        let values: Vec<f32> = (0..30).map(|i| plane(&coarse, i / 6, i % 6)).collect();
        let (fine, result) =
            (coarse.halved(), upsample_bent(&values, &coarse, &[0.0; 120], &[0.0; 120]));
        for row in 1..9 {
            for col in 1..11 {
                let (a, b) = (result[row * 12 + col], plane(&fine, row, col));
                assert!((a - b).abs() < 1e-4, "({row}, {col}): {a} {b}");
            }
        }
    }

    #[test]
    fn shifts_draw_from_the_east_and_the_north() {
        let coarse = Extent { rows: 6, cols: 6, cell_m: 2.0, west_m: 0.0, north_m: 12.0 };
        let values: Vec<f32> = (0..36).map(|i| (i % 6) as f32 + 10.0 * (i / 6) as f32).collect();
        let at = |east: f32, north: f32| {
            upsample_bent(&values, &coarse, &[east; 144], &[north; 144])[5 * 12 + 5]
        };
        assert!((at(1.0, 0.0) - at(0.0, 0.0) - 1.0).abs() < 1e-4);
        assert!((at(0.0, 1.0) - at(0.0, 0.0) + 10.0).abs() < 1e-4);
    }

    #[test]
    fn absolute_cells_count_from_the_origin() {
        let extent = Extent { rows: 4, cols: 4, cell_m: 2.0, west_m: -4.0, north_m: 8.0 };
        assert_eq!(extent.absolute_cell(0, 0), (-2, 3));
        assert_eq!(extent.absolute_cell(3, 3), (1, 0));
    }
}
