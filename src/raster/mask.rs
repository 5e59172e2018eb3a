//! Which cells of a grid hold a value.

/// Valid cells of a grid; nodata is a mask, never a value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    valid: Vec<bool>,
    valid_count: usize,
}

impl Mask {
    /// A mask from one flag a cell, row-major.
    pub fn new(valid: Vec<bool>) -> Self {
        let valid_count = valid.iter().filter(|v| **v).count();
        Self { valid, valid_count }
    }

    /// A mask of `len` cells, all valid.
    pub fn all_valid(len: usize) -> Self {
        Self { valid: vec![true; len], valid_count: len }
    }

    /// Whether the cell at `index` holds a value.
    #[inline]
    pub fn is_valid(&self, index: usize) -> bool {
        self.valid[index]
    }

    /// Whether every cell holds a value.
    pub fn is_all_valid(&self) -> bool {
        self.valid_count == self.valid.len()
    }

    /// Number of cells that hold a value.
    pub fn valid_count(&self) -> usize {
        self.valid_count
    }

    /// One flag a cell, row-major.
    pub fn as_slice(&self) -> &[bool] {
        &self.valid
    }
}
