//! Where a grid's cells lie on the map.

use super::Crs;

/// A cell's place in a grid; row 0 is the northernmost, column 0 the westernmost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Cell {
    /// Rows from the north.
    pub row: usize,
    /// Columns from the west.
    pub col: usize,
}

/// A place in map coordinates of the grid's CRS.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapPoint {
    /// Easting in metres.
    pub east_m: f64,
    /// Northing in metres.
    pub north_m: f64,
}

/// The map position of a north-up grid of square cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeoTransform {
    /// Easting of the grid's west edge.
    pub west_m: f64,
    /// Northing of the grid's north edge.
    pub north_m: f64,
    /// Cell width and height.
    pub cell_m: f64,
}

impl GeoTransform {
    /// The map position of a cell's centre.
    pub fn center(&self, cell: Cell) -> MapPoint {
        MapPoint {
            east_m: self.west_m + (cell.col as f64 + 0.5) * self.cell_m,
            north_m: self.north_m - (cell.row as f64 + 0.5) * self.cell_m,
        }
    }
}

/// Size and place of a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
    /// Map position.
    pub transform: GeoTransform,
    /// The metric coordinate reference system of the map coordinates.
    pub crs: Crs,
}

impl Frame {
    /// A frame in local metres whose south-west corner is the origin; for tests and generated terrain.
    pub fn local(rows: usize, cols: usize, cell_m: f64) -> Self {
        let north_m = rows as f64 * cell_m;
        Self {
            rows,
            cols,
            transform: GeoTransform { west_m: 0.0, north_m, cell_m },
            crs: Crs::Local,
        }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.rows * self.cols
    }

    /// Whether the frame has no cells.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A cell's index in row-major storage.
    #[inline]
    pub fn index(&self, cell: Cell) -> usize {
        debug_assert!(cell.row < self.rows && cell.col < self.cols, "{cell:?} outside the grid");
        cell.row * self.cols + cell.col
    }

    /// The cell stored at `index`.
    #[inline]
    pub fn cell(&self, index: usize) -> Cell {
        Cell { row: index / self.cols, col: index % self.cols }
    }

    /// Cell width in metres, as rasters and kernels use it.
    #[inline]
    pub fn cell_m(&self) -> f32 {
        self.transform.cell_m as f32 // cells are 0.1–100 m: no digits that matter are lost
    }

    /// The map position of the grid's south-west corner, which positions in the scene are counted from.
    pub fn south_west(&self) -> MapPoint {
        let GeoTransform { west_m, north_m, cell_m } = self.transform;
        MapPoint { east_m: west_m, north_m: north_m - self.rows as f64 * cell_m }
    }

    /// The map position of the grid's middle.
    pub fn middle(&self) -> MapPoint {
        let t = &self.transform;
        MapPoint {
            east_m: t.west_m + self.cols as f64 * t.cell_m / 2.0,
            north_m: t.north_m - self.rows as f64 * t.cell_m / 2.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centers_lie_half_a_cell_inside() {
        let frame = Frame::local(3, 4, 2.0);
        let p = frame.transform.center(Cell { row: 2, col: 0 });
        assert_eq!((p.east_m, p.north_m), (1.0, 1.0));
    }

    #[test]
    fn index_and_cell_are_inverse() {
        let frame = Frame::local(3, 4, 1.0);
        for index in 0..frame.len() {
            assert_eq!(frame.index(frame.cell(index)), index);
        }
    }
}
