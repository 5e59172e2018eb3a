//! Visibility: which crown the sky sees at each working cell, and how much of each crown it sees.
//!
//! # Reference
//! Kapp et al. 2020, section 5.2: a top-down orthographic rendering of the crowns' spheres.

use super::crowns::Crowns;

/// Cells under no crown.
pub const NO_CROWN: u32 = u32::MAX;

/// What the sky sees. A cell belongs to the crown whose sphere is highest at the cell's centre; between equals, to the
/// crown with the lower index. A centre counts as under a crown if its distance from the trunk is at most the radius.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Visibility {
    /// The crown seen at each working cell, row-major from the north-west, [`NO_CROWN`] where none.
    pub owner: Vec<u32>,
    /// Cells seen of each crown.
    pub visible_cells: Vec<u32>,
    /// Cells seen of each crown that are canopy.
    pub canopy_cells: Vec<u32>,
    /// Sum over those canopy cells of columns east of the trunk's cell.
    pub sum_cols: Vec<i32>,
    /// Sum over those canopy cells of rows south of the trunk's cell.
    pub sum_rows: Vec<i32>,
}

/// The grid of working cells: its size, and which cells are canopy.
#[derive(Clone, Copy, Debug)]
pub struct CanopyCells<'a> {
    /// Rows of the grid.
    pub rows: usize,
    /// Columns of the grid.
    pub cols: usize,
    /// Whether a cell is canopy, row-major.
    pub is_canopy: &'a [bool],
}

/// Renders crowns; the twins on CPU and GPU give equal results, bit for bit, because all of it is whole numbers.
pub trait RenderVisibility: Sync {
    /// Fills `visibility` with what the sky sees of `crowns`.
    ///
    /// # Errors
    /// A text that says what failed, where the device can fail.
    fn render(
        &mut self,
        crowns: &Crowns,
        cells: CanopyCells<'_>,
        visibility: &mut Visibility,
    ) -> Result<(), String>;
}
