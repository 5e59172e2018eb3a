//! Crowns as spheres on a grid of working cells, in whole numbers, so that every machine sees the same crown.
//!
//! # Reference
//! Kapp et al. 2020, section 5.2: a crown is a sphere over the trunk whose apex is the tree's top.

/// Units in the width of a working cell. Distances that roots are taken of stay below 2048 units: their squares are then
/// below 2²², where a square root in `f32` rounds down to the exact whole root.
pub const UNITS_PER_CELL: i32 = 32;

/// Greatest radius in units: a cell less than the greatest distance, for the look around a crown that may move.
pub const MAX_RADIUS_UNITS: i32 = 2047 - UNITS_PER_CELL;

/// Cells of a disk: a row, and its columns from the first up to, but not counting, the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Row from the north.
    pub row: usize,
    /// First column.
    pub first_col: usize,
    /// One past the last column.
    pub end_col: usize,
}

/// Rows and columns of a grid of working cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GridSize {
    /// Rows from north to south.
    pub rows: usize,
    /// Columns from west to east.
    pub cols: usize,
}

/// The middle of a cell along either axis, in units from the grid's edge.
#[inline]
pub fn middle_units(cell: usize) -> i32 {
    cell as i32 * UNITS_PER_CELL + UNITS_PER_CELL / 2 // grids have at most 2²⁶ units a side
}

/// The cell along either axis that a position within the grid lies in.
#[inline]
pub fn cell_of_units(position: i32) -> usize {
    (position.max(0) / UNITS_PER_CELL) as usize // not negative
}

/// Whole part of the square root of `n`, for 0 ≤ n < 2²².
#[inline]
pub fn whole_root(n: i32) -> i32 {
    debug_assert!((0..1 << 22).contains(&n), "{n} is outside the roots' range");
    // both conversions are exact below 2²⁴, and so is the root's whole part, see `UNITS_PER_CELL`
    (n as f32).sqrt() as i32
}

/// Rows of a grid of `rows` that a disk reaches.
#[inline]
pub fn disk_rows(y: i32, radius: i32, rows: usize) -> std::ops::Range<usize> {
    let half = UNITS_PER_CELL / 2;
    let first = (y - radius - half + UNITS_PER_CELL - 1).div_euclid(UNITS_PER_CELL).max(0);
    let end = (y + radius - half).div_euclid(UNITS_PER_CELL) + 1;
    let end = (end.max(0) as usize).min(rows); // not negative
    (first as usize).min(end)..end
}

/// Cells of one row whose centres are at most `radius` from (`x`, `y`); the row is one of [`disk_rows`].
#[inline]
pub fn disk_span(x: i32, y: i32, radius: i32, row: usize, cols: usize) -> Span {
    let dy = middle_units(row) - y;
    let half_width = whole_root(radius * radius - dy * dy);
    let half = UNITS_PER_CELL / 2;
    let first = (x - half_width - half + UNITS_PER_CELL - 1).div_euclid(UNITS_PER_CELL).max(0);
    let end = (x + half_width - half).div_euclid(UNITS_PER_CELL) + 1;
    let end_col = (end.max(0) as usize).min(cols); // not negative
    Span { row, first_col: (first as usize).min(end_col), end_col }
}

/// Cells of a grid whose centres are at most `radius` from (`x`, `y`), row by row.
#[inline]
pub fn disk_spans(x: i32, y: i32, radius: i32, size: GridSize) -> impl Iterator<Item = Span> {
    disk_rows(y, radius, size.rows).map(move |row| disk_span(x, y, radius, row, size.cols))
}

/// Disks around the middles of cells, by radius: looked up where many are asked for.
#[derive(Clone, Debug)]
pub struct CenteredDisks {
    /// Radius after radius, row after row from the middle one outwards: cells to either side of the middle one.
    half_widths: Vec<u8>,
    /// Where each radius begins; one more at the end.
    starts: Vec<u32>,
}

impl CenteredDisks {
    /// Disks of up to `widest` units.
    pub fn new(widest: i32) -> Self {
        let (mut half_widths, mut starts) = (Vec::new(), vec![0]);
        for radius in 0..=widest {
            for row in 0..=radius / UNITS_PER_CELL {
                let dy = row * UNITS_PER_CELL;
                let cells = whole_root(radius * radius - dy * dy) / UNITS_PER_CELL;
                half_widths.push(cells as u8); // at most MAX_RADIUS_UNITS / UNITS_PER_CELL = 62
            }
            starts.push(half_widths.len() as u32); // less than 2¹⁸
        }
        Self { half_widths, starts }
    }

    /// Cells to either side of the middle one, for the middle row and each one outwards.
    #[inline]
    pub fn half_widths(&self, radius: i32) -> &[u8] {
        let radius = radius as usize; // not negative
        &self.half_widths[self.starts[radius] as usize..self.starts[radius + 1] as usize]
    }
}

/// Crowns, struct of arrays; all lengths in units of 1/[`UNITS_PER_CELL`] of a working cell.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Crowns {
    /// From the grid's west edge eastward to the trunk.
    pub x: Vec<i32>,
    /// From the grid's north edge southward to the trunk.
    pub y: Vec<i32>,
    /// Radius of the sphere, 1..=[`MAX_RADIUS_UNITS`].
    pub radius: Vec<i32>,
    /// Elevation of the sphere's centre above a datum, within ±2²⁴: below 0 where a crown on the lowest ground is wider
    /// than high.
    pub center_z: Vec<i32>,
}

impl Crowns {
    /// Number of crowns.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Cells of a grid that a crown lies over, row by row.
    pub fn spans(&self, crown: usize, size: GridSize) -> impl Iterator<Item = Span> {
        disk_spans(self.x[crown], self.y[crown], self.radius[crown], size)
    }

    /// How many they are.
    pub fn cell_count(&self, crown: usize, size: GridSize) -> usize {
        self.spans(crown, size).map(|span| span.end_col - span.first_col).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_roots_are_exact() {
        for root in 0..2048_i32 {
            assert_eq!(whole_root(root * root), root);
            assert_eq!(whole_root((root + 1) * (root + 1) - 1), root);
        }
    }

    #[test]
    fn spans_hold_just_the_centres_within_the_radius() {
        let size = GridSize { rows: 9, cols: 11 };
        for (x, y, radius) in
            [(100, 100, 70), (0, 0, 90), (340, 200, 33), (-60, 140, 64), (16, 16, 1), (17, 17, 1)]
        {
            let mut inside = vec![false; size.rows * size.cols];
            for span in disk_spans(x, y, radius, size) {
                for col in span.first_col..span.end_col {
                    inside[span.row * size.cols + col] = true;
                }
            }
            for (index, found) in inside.into_iter().enumerate() {
                let dx = middle_units(index % size.cols) - x;
                let dy = middle_units(index / size.cols) - y;
                let expected = dx * dx + dy * dy <= radius * radius;
                assert_eq!(found, expected, "cell {index} of ({x}, {y}, {radius})");
            }
        }
    }

    #[test]
    fn centered_disks_are_the_disks_around_middles() {
        let size = GridSize { rows: 140, cols: 140 };
        let disks = CenteredDisks::new(MAX_RADIUS_UNITS);
        for radius in [0, 1, 31, 32, 33, 46, 100, 640, 1999, MAX_RADIUS_UNITS] {
            let at = middle_units(70);
            let half_widths = disks.half_widths(radius);
            for span in disk_spans(at, at, radius, size) {
                let half_width = usize::from(half_widths[span.row.abs_diff(70)]);
                assert_eq!((span.first_col, span.end_col), (70 - half_width, 71 + half_width));
            }
            assert_eq!(disk_rows(at, radius, size.rows).len(), 2 * half_widths.len() - 1);
        }
    }

    #[test]
    fn a_position_lies_in_the_cell_whose_middle_is_nearest() {
        for cell in [0, 1, 700] {
            assert_eq!(cell_of_units(middle_units(cell)), cell);
        }
        assert_eq!((cell_of_units(31), cell_of_units(32)), (0, 1));
    }
}
