//! Values on a frame.

use std::ops::{Index, IndexMut};
use std::sync::Arc;

use rayon::prelude::*;

use super::{Cell, Frame, Mask};

/// Months of a year.
pub const MONTHS: usize = 12;

/// One value a cell, row-major from the north-west, with place and mask.
/// Values of masked cells are unspecified but finite; ask the mask before you use one.
#[derive(Clone, Debug)]
pub struct Grid<T> {
    frame: Arc<Frame>,
    mask: Arc<Mask>,
    values: Vec<T>,
}

impl<T> Grid<T> {
    /// A grid of given values.
    ///
    /// # Panics
    /// If frame, mask and values differ in length.
    pub fn new(frame: Arc<Frame>, mask: Arc<Mask>, values: Vec<T>) -> Self {
        assert_eq!(frame.len(), values.len(), "grid values do not fill the frame");
        assert_eq!(frame.len(), mask.as_slice().len(), "grid mask does not fill the frame");
        Self { frame, mask, values }
    }

    /// A grid on the same frame and mask with other values.
    pub fn with_values<U>(&self, values: Vec<U>) -> Grid<U> {
        Grid::new(Arc::clone(&self.frame), Arc::clone(&self.mask), values)
    }

    /// Size and place.
    pub fn frame(&self) -> &Arc<Frame> {
        &self.frame
    }

    /// Valid cells.
    pub fn mask(&self) -> &Arc<Mask> {
        &self.mask
    }

    /// All values, masked ones included.
    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// The values alone.
    pub fn into_values(self) -> Vec<T> {
        self.values
    }

    /// All values, to be changed in place.
    pub fn values_mut(&mut self) -> &mut [T] {
        &mut self.values
    }

    /// The values of one row.
    pub fn row(&self, row: usize) -> &[T] {
        &self.values[row * self.frame.cols..][..self.frame.cols]
    }

    /// The value at `cell`, `None` where masked or outside.
    pub fn get(&self, cell: Cell) -> Option<&T> {
        if cell.row >= self.frame.rows || cell.col >= self.frame.cols {
            return None;
        }
        let index = self.frame.index(cell);
        self.mask.is_valid(index).then(|| &self.values[index])
    }

    /// The values of valid cells.
    pub fn valid_values(&self) -> impl Iterator<Item = &T> {
        self.values.iter().zip(self.mask.as_slice()).filter(|(_, valid)| **valid).map(|(v, _)| v)
    }
}

impl Grid<f32> {
    /// A fully valid grid in local metres computed cell by cell; for tests and generated terrain.
    pub fn from_fn(rows: usize, cols: usize, cell_m: f64, f: impl FnMut(Cell) -> f32) -> Self {
        let frame = Frame::local(rows, cols, cell_m);
        let values = (0..frame.len()).map(|i| frame.cell(i)).map(f).collect();
        let mask = Mask::all_valid(frame.len());
        Self::new(Arc::new(frame), Arc::new(mask), values)
    }

    /// Smallest and largest valid value, `None` if all cells are masked.
    pub fn range(&self) -> Option<(f32, f32)> {
        self.valid_values().fold(None, |range, &v| match range {
            None => Some((v, v)),
            Some((lo, hi)) => Some((lo.min(v), hi.max(v))),
        })
    }
}

impl<T> Index<Cell> for Grid<T> {
    type Output = T;
    #[inline]
    fn index(&self, cell: Cell) -> &T {
        &self.values[self.frame.index(cell)]
    }
}

impl<T> IndexMut<Cell> for Grid<T> {
    #[inline]
    fn index_mut(&mut self, cell: Cell) -> &mut T {
        let index = self.frame.index(cell);
        &mut self.values[index]
    }
}

/// Twelve grids on one frame and mask, January first.
#[derive(Clone, Debug)]
pub struct MonthlyGrid {
    frame: Arc<Frame>,
    mask: Arc<Mask>,
    months: [Vec<f32>; MONTHS],
}

impl MonthlyGrid {
    /// # Panics
    /// If a month's values do not fill the frame.
    pub fn new(frame: Arc<Frame>, mask: Arc<Mask>, months: [Vec<f32>; MONTHS]) -> Self {
        for values in &months {
            assert_eq!(frame.len(), values.len(), "monthly values do not fill the frame");
        }
        Self { frame, mask, months }
    }

    /// Size and place.
    pub fn frame(&self) -> &Arc<Frame> {
        &self.frame
    }

    /// Valid cells.
    pub fn mask(&self) -> &Arc<Mask> {
        &self.mask
    }

    /// All values of a month; 0 is January.
    pub fn month(&self, month_index: usize) -> &[f32] {
        &self.months[month_index]
    }

    /// The months' values, January first, to be worked on in place.
    pub fn into_months(self) -> [Vec<f32>; MONTHS] {
        self.months
    }

    /// Mean over the year, cell by cell.
    pub fn yearly_mean(&self) -> Grid<f32> {
        let mean = |index: usize| {
            let sum: f64 = self.months.iter().map(|month| f64::from(month[index])).sum();
            (sum / MONTHS as f64) as f32 // a mean of f32 values
        };
        let values = (0..self.frame.len()).into_par_iter().map(mean).collect();
        Grid::new(Arc::clone(&self.frame), Arc::clone(&self.mask), values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masked_cells_give_nothing() {
        let frame = Arc::new(Frame::local(1, 2, 1.0));
        let grid = Grid::new(frame, Arc::new(Mask::new(vec![true, false])), vec![3.0, 9.0]);
        assert_eq!(grid.get(Cell { row: 0, col: 0 }), Some(&3.0));
        assert_eq!(grid.get(Cell { row: 0, col: 1 }), None);
        assert_eq!(grid.get(Cell { row: 1, col: 0 }), None);
        assert_eq!(grid.range(), Some((3.0, 3.0)));
    }

    #[test]
    fn yearly_mean_is_the_mean_of_the_months() {
        let frame = Arc::new(Frame::local(1, 1, 1.0));
        let months = std::array::from_fn(|m| vec![m as f32]);
        let monthly = MonthlyGrid::new(frame, Arc::new(Mask::all_valid(1)), months);
        assert!((monthly.yearly_mean().values()[0] - 5.5).abs() < 1e-6);
    }
}
