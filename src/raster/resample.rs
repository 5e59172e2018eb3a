//! Values between and across cells: nearest, bilinear, bicubic, area average; all know of missing cells.

/// Values with their valid flags, row-major: what the kernels read.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a> {
    rows: usize,
    cols: usize,
    values: &'a [f32],
    valid: &'a [bool],
}

/// A place between cells, counted in cells from the grid's first corner; centres lie at + 0.5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellPosition {
    /// Rows from the first row's outer edge.
    pub row: f64,
    /// Columns from the first column's outer edge.
    pub col: f64,
}

/// How values are drawn from a grid for a cell of another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// The value of the cell that holds the target cell's centre: for numbers that name things.
    Nearest,
    /// Weights of the 2 × 2 nearest cells.
    Bilinear,
    /// Weights of the 4 × 4 nearest cells; bilinear where one of them is missing.
    Bicubic,
    /// Mean over the target cell's area.
    Average,
}

/// Keys's parameter: −1/2 makes the cubic exact for parabolas and is what GDAL's `cubic` uses.
///
/// # Reference
/// Keys 1981, Cubic convolution interpolation for digital image processing, Eq. 4,
/// doi:10.1109/TASSP.1981.1163711.
const KEYS_A: f64 = -0.5;

/// An average needs at least this share of its area covered by valid cells; chosen: the half that
/// the centre's cell stands for in the other kernels.
const AVERAGE_LEAST_COVER_FRACTION: f64 = 0.5;

impl<'a> Samples<'a> {
    /// The middle, in cells from the first corner.
    pub fn middle(&self) -> CellPosition {
        CellPosition { row: self.rows as f64 / 2.0, col: self.cols as f64 / 2.0 }
    }

    /// Samples of `rows` × `cols` cells.
    ///
    /// # Panics
    /// If values or flags do not fill the grid.
    pub fn new(rows: usize, cols: usize, values: &'a [f32], valid: &'a [bool]) -> Self {
        assert_eq!(rows * cols, values.len(), "values do not fill the grid");
        assert_eq!(rows * cols, valid.len(), "valid flags do not fill the grid");
        Self { rows, cols, values, valid }
    }

    /// The value at a cell, `None` where missing or outside.
    fn get(&self, row: isize, col: isize) -> Option<f64> {
        let (row, col) = (usize::try_from(row).ok()?, usize::try_from(col).ok()?);
        if row >= self.rows || col >= self.cols {
            return None;
        }
        let index = row * self.cols + col;
        self.valid[index].then(|| f64::from(self.values[index]))
    }

    /// The value of the cell that holds `at`.
    fn nearest(&self, at: CellPosition) -> Option<f64> {
        let inside =
            (0.0..self.rows as f64).contains(&at.row) && (0.0..self.cols as f64).contains(&at.col);
        // inside, so truncation is floor and the index fits
        if inside { self.get(at.row as isize, at.col as isize) } else { None }
    }

    /// The value at `at` between the four nearest centres.
    ///
    /// Missing neighbours are left out and the other weights raised in proportion, as in GDAL; a
    /// place **in** a missing cell, or outside the grid, has no value.
    pub fn bilinear(&self, at: CellPosition) -> Option<f32> {
        let middle = self.nearest(at)?;
        let (row, row_fraction) = split(at.row);
        let (col, col_fraction) = split(at.col);
        let (mut sum, mut weight_sum) = (0.0, 0.0);
        for (row_step, row_weight) in [1.0 - row_fraction, row_fraction].into_iter().enumerate() {
            for (col_step, col_weight) in [1.0 - col_fraction, col_fraction].into_iter().enumerate()
            {
                // steps are 0 or 1
                let value = self.get(row + row_step as isize, col + col_step as isize);
                if let Some(value) = value {
                    let weight = row_weight * col_weight;
                    sum += weight * (value - middle);
                    weight_sum += weight;
                }
            }
        }
        // the cell that holds `at` is valid and weighs at least a quarter; heights fit f32
        Some((middle + sum / weight_sum) as f32)
    }

    /// The value at `at` by cubic convolution over the 4 × 4 nearest centres.
    ///
    /// Where one of them is missing, [bilinear](Self::bilinear): negative weights must not be raised.
    pub fn bicubic(&self, at: CellPosition) -> Option<f32> {
        self.nearest(at)?;
        let (row, row_fraction) = split(at.row);
        let (col, col_fraction) = split(at.col);
        let inside = |first: isize, count: usize| {
            usize::try_from(first - 1).ok().filter(|first| first + 4 <= count)
        };
        let (Some(first_row), Some(first_col)) = (inside(row, self.rows), inside(col, self.cols))
        else {
            return self.bilinear(at);
        };
        let row_weights = keys_weights(row_fraction);
        let col_weights = keys_weights(col_fraction);
        let reference = f64::from(self.values[(first_row + 1) * self.cols + first_col + 1]);
        let mut sum = 0.0;
        for (step, row_weight) in row_weights.into_iter().enumerate() {
            let start = (first_row + step) * self.cols + first_col;
            let (values, valid) = (&self.values[start..][..4], &self.valid[start..][..4]);
            if !(valid[0] && valid[1] && valid[2] && valid[3]) {
                return self.bilinear(at);
            }
            let mut row_sum = 0.0;
            for (value, weight) in values.iter().zip(col_weights) {
                row_sum += weight * (f64::from(*value) - reference);
            }
            sum += row_weight * row_sum;
        }
        Some((reference + sum) as f32) // heights fit f32
    }

    /// The mean over a quadrilateral (corners in order, convex), each cell weighted by its shared area.
    ///
    /// `None` where less than half the quadrilateral is covered by valid cells.
    pub fn average(&self, corners: &[CellPosition; 4]) -> Option<f32> {
        let target = Polygon::quadrilateral(corners);
        let target_area = target.area();
        let rows = covered(corners.map(|c| c.row), self.rows);
        let cols = covered(corners.map(|c| c.col), self.cols);
        let (mut sum, mut area_sum, mut reference) = (0.0, 0.0, None);
        for row in rows {
            let band = target.clipped(ROW, row as f64, 1.0).clipped(ROW, row as f64 + 1.0, -1.0);
            for col in cols.clone() {
                let index = row * self.cols + col;
                if !self.valid[index] {
                    continue;
                }
                let shared =
                    band.clipped(COL, col as f64, 1.0).clipped(COL, col as f64 + 1.0, -1.0);
                let area = shared.area();
                let value = f64::from(self.values[index]);
                sum += area * (value - *reference.get_or_insert(value));
                area_sum += area;
            }
        }
        let covered_enough =
            area_sum > 0.0 && area_sum >= AVERAGE_LEAST_COVER_FRACTION * target_area;
        reference.filter(|_| covered_enough).map(|r| (r + sum / area_sum) as f32) // heights fit f32
    }

    /// The value of a target cell with these corners and this middle.
    #[inline]
    pub fn draw(
        &self,
        kernel: Kernel,
        middle: CellPosition,
        corners: impl FnOnce() -> Option<[CellPosition; 4]>,
    ) -> Option<f32> {
        match kernel {
            Kernel::Nearest => self.nearest(middle).map(|value| value as f32), // was one
            Kernel::Bilinear => self.bilinear(middle),
            Kernel::Bicubic => self.bicubic(middle),
            Kernel::Average => self.average(&corners()?),
        }
    }
}

/// The last centre at or before a position, and how far on towards the next.
fn split(position: f64) -> (isize, f64) {
    let before = (position - 0.5).floor();
    (before as isize, position - 0.5 - before) // positions inside a grid fit
}

/// Indices of the cells that a span of corners touches.
fn covered(corners: [f64; 4], count: usize) -> std::ops::Range<usize> {
    let first = corners.into_iter().fold(f64::INFINITY, f64::min).floor().max(0.0);
    let end = corners.into_iter().fold(f64::NEG_INFINITY, f64::max).ceil().min(count as f64);
    // both lie in 0..=count here, or the range is empty
    first as usize..end.max(0.0) as usize
}

/// Weights of the four centres around a place `t` of the way from the second to the third.
fn keys_weights(t: f64) -> [f64; 4] {
    let near = |d: f64| ((KEYS_A + 2.0) * d - (KEYS_A + 3.0)) * d * d + 1.0;
    let far = |d: f64| ((KEYS_A * d - 5.0 * KEYS_A) * d + 8.0 * KEYS_A) * d - 4.0 * KEYS_A;
    [far(1.0 + t), near(t), near(1.0 - t), far(2.0 - t)]
}

const ROW: usize = 0;
const COL: usize = 1;

/// Corners a quadrilateral has at most after four cuts, each adding one.
const POLYGON_CORNERS: usize = 8;

/// A convex polygon in (row, column).
#[derive(Clone, Copy)]
struct Polygon {
    corners: [[f64; 2]; POLYGON_CORNERS],
    count: usize,
}

impl Polygon {
    fn quadrilateral(corners: &[CellPosition; 4]) -> Self {
        let mut polygon = Self { corners: [[0.0; 2]; POLYGON_CORNERS], count: 4 };
        for (to, from) in polygon.corners.iter_mut().zip(corners) {
            *to = [from.row, from.col];
        }
        polygon
    }

    fn push(&mut self, corner: [f64; 2]) {
        // rounding can split a touching corner in two; the area lost with a ninth is nil
        if self.count < POLYGON_CORNERS {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    /// What lies on the upper (`side` 1) or lower (`side` −1) side of `bound` along an axis.
    ///
    /// # Reference
    /// Sutherland and Hodgman 1974, Reentrant polygon clipping, doi:10.1145/360767.360802.
    fn clipped(&self, axis: usize, bound: f64, side: f64) -> Self {
        let corners = &self.corners[..self.count];
        let depth = |corner: &[f64; 2]| (corner[axis] - bound) * side;
        if corners.iter().all(|c| depth(c) >= 0.0) {
            return *self;
        }
        let mut kept = Self { corners: [[0.0; 2]; POLYGON_CORNERS], count: 0 };
        for (i, here) in corners.iter().enumerate() {
            let next = &corners[(i + 1) % corners.len()];
            let (depth_here, depth_next) = (depth(here), depth(next));
            if depth_here >= 0.0 {
                kept.push(*here);
            }
            if (depth_here >= 0.0) != (depth_next >= 0.0) {
                let t = depth_here / (depth_here - depth_next);
                let mut cut =
                    [here[0] + t * (next[0] - here[0]), here[1] + t * (next[1] - here[1])];
                cut[axis] = bound;
                kept.push(cut);
            }
        }
        kept
    }

    fn area(&self) -> f64 {
        let corners = &self.corners[..self.count];
        let Some(&origin) = corners.first() else { return 0.0 };
        // fan of triangles from the first corner: exact for cells far from the grid's corner
        let doubled: f64 = corners
            .windows(2)
            .map(|pair| {
                let [a, b] =
                    [pair[0], pair[1]].map(|c| [c[ROW] - origin[ROW], c[COL] - origin[COL]]);
                a[ROW] * b[COL] - a[COL] * b[ROW]
            })
            .sum();
        doubled.abs() / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 9;
    const COLS: usize = 11;

    fn at(row: f64, col: f64) -> CellPosition {
        CellPosition { row, col }
    }

    fn square(row: f64, col: f64, size: f64) -> [CellPosition; 4] {
        [at(row, col), at(row, col + size), at(row + size, col + size), at(row + size, col)]
    }

    fn filled(f: impl Fn(f64, f64) -> f64) -> Vec<f32> {
        let cell = |i: usize| f((i / COLS) as f64 + 0.5, (i % COLS) as f64 + 0.5) as f32;
        (0..ROWS * COLS).map(cell).collect()
    }

    #[test]
    fn a_ramp_survives_both_kernels_and_the_average() {
        let ramp = |row: f64, col: f64| 100.0 + 3.0 * col - 2.0 * row;
        let (values, valid) = (filled(ramp), [true; ROWS * COLS]);
        let samples = Samples::new(ROWS, COLS, &values, &valid);
        for (row, col) in [(2.0, 2.0), (4.5, 5.5), (3.21, 7.89), (6.999, 4.001)] {
            let expected = ramp(row, col) as f32;
            for found in [samples.bilinear(at(row, col)), samples.bicubic(at(row, col))] {
                assert!((found.unwrap() - expected).abs() < 1e-5, "{found:?} for {expected}");
            }
        }
        // a mean of whole cells lies at their middle
        let found = samples.average(&square(3.0, 2.0, 3.0)).unwrap();
        assert!((found - ramp(4.5, 3.5) as f32).abs() < 1e-5, "{found}");
    }

    #[test]
    fn the_cubic_is_exact_for_parabolas_and_bilinear_is_not() {
        let bowl = |row: f64, col: f64| 0.25 * (row - 4.0) * (row - 4.0) + 0.5 * col * row;
        let (values, valid) = (filled(bowl), [true; ROWS * COLS]);
        let samples = Samples::new(ROWS, COLS, &values, &valid);
        let expected = bowl(4.1, 5.3) as f32;
        assert!((samples.bicubic(at(4.1, 5.3)).unwrap() - expected).abs() < 1e-5);
        assert!((samples.bilinear(at(4.1, 5.3)).unwrap() - expected).abs() > 1e-2);
    }

    #[test]
    fn at_a_centre_the_cell_keeps_its_bits() {
        let values = filled(|row, col| (row * 12.9898 + col * 78.233).fract() * 0.3 + 4321.0);
        let valid = [true; ROWS * COLS];
        let samples = Samples::new(ROWS, COLS, &values, &valid);
        for row in 0..ROWS {
            for col in 0..COLS {
                let middle = at(row as f64 + 0.5, col as f64 + 0.5);
                let value = Some(values[row * COLS + col]);
                assert_eq!(samples.bilinear(middle), value);
                assert_eq!(samples.bicubic(middle), value);
                assert_eq!(samples.average(&square(row as f64, col as f64, 1.0)), value);
            }
        }
    }

    #[test]
    fn missing_cells_are_left_out() {
        let mut values = filled(|_, _| 7.0);
        let mut valid = [true; ROWS * COLS];
        let hole = 4 * COLS + 5;
        (values[hole], valid[hole]) = (-9999.0, false);
        let samples = Samples::new(ROWS, COLS, &values, &valid);
        for (row, col) in [(3.9, 5.5), (4.5, 4.9), (5.2, 6.2), (2.6, 5.5)] {
            assert_eq!(samples.bilinear(at(row, col)), Some(7.0));
            assert_eq!(samples.bicubic(at(row, col)), Some(7.0));
        }
        // a centre in the hole has no value, nor has one outside
        assert_eq!(samples.bilinear(at(4.1, 5.9)), None);
        assert_eq!(samples.bicubic(at(4.1, 5.9)), None);
        assert_eq!(samples.bicubic(at(-0.1, 5.9)), None);
        assert_eq!(samples.bilinear(at(f64::NAN, 5.9)), None);
        // an average stands while half of its area does
        assert_eq!(samples.average(&square(4.0, 5.0, 1.0)), None);
        assert_eq!(samples.average(&square(4.0, 5.0, 2.0)), Some(7.0));
        assert_eq!(samples.average(&square(-1.0, 0.0, 1.5)), None);
        assert_eq!(samples.average(&square(-0.7, 0.0, 1.5)), Some(7.0));
    }

    #[test]
    fn a_turned_average_weighs_cells_by_shared_area() {
        // a diamond around a corner of four cells: its four quarters are equal
        let values = filled(|row, col| if row < 4.0 && col < 4.0 { 8.0 } else { 0.0 });
        let valid = [true; ROWS * COLS];
        let samples = Samples::new(ROWS, COLS, &values, &valid);
        let diamond = [at(3.0, 4.0), at(4.0, 5.0), at(5.0, 4.0), at(4.0, 3.0)];
        assert_eq!(samples.average(&diamond), Some(2.0));
        // across cell borders the shared areas fill the polygon
        let tilted = [at(1.3, 2.1), at(1.9, 6.6), at(6.4, 6.0), at(5.8, 1.5)];
        let even = filled(|_, _| 3.0);
        assert_eq!(Samples::new(ROWS, COLS, &even, &valid).average(&tilted), Some(3.0));
        let polygon = Polygon::quadrilateral(&tilted);
        let mut shared = 0.0;
        for row in 0..ROWS {
            for col in 0..COLS {
                let band =
                    polygon.clipped(ROW, row as f64, 1.0).clipped(ROW, row as f64 + 1.0, -1.0);
                shared +=
                    band.clipped(COL, col as f64, 1.0).clipped(COL, col as f64 + 1.0, -1.0).area();
            }
        }
        assert!((shared - polygon.area()).abs() < 1e-12, "{shared} of {}", polygon.area());
    }
}
