//! Tiles of an image that is written: where they lie, and their packed bytes.

use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::codec;
use super::write::NODATA;

/// Cells along a tile's edge, GDAL's own choice for this layout.
pub(super) const TILE_CELLS: usize = 512;

/// An image cut into tiles.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct TileGrid {
    pub(super) rows: usize,
    pub(super) cols: usize,
    pub(super) tile_rows: usize,
    pub(super) tile_cols: usize,
}

impl TileGrid {
    /// The grid of an image; one of at most [`TILE_CELLS`] either way is a single tile.
    pub(super) fn new(rows: usize, cols: usize) -> Self {
        // TIFF wants multiples of 16
        let tile_rows = rows.next_multiple_of(16).min(TILE_CELLS);
        let tile_cols = match cols.next_multiple_of(16).min(TILE_CELLS) {
            // validators take a tall image as wide as its tiles for strips
            TILE_CELLS if cols == TILE_CELLS && rows > TILE_CELLS => TILE_CELLS / 2,
            width if width == cols && rows > TILE_CELLS => width + 16,
            width => width,
        };
        Self { rows, cols, tile_rows, tile_cols }
    }

    /// Number of tiles of a band.
    pub(super) fn len(&self) -> usize {
        self.rows.div_ceil(self.tile_rows) * self.cols.div_ceil(self.tile_cols)
    }
}

/// How tiles are packed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Packing {
    pub(super) deflate_level: u32,
}

/// The packed bytes of a tile. `read` fills a row's values from (row, first column); `is_valid` tells by index.
pub(super) fn pack(
    grid: &TileGrid,
    tile: usize,
    packing: Packing,
    read: impl Fn(usize, usize, &mut [f32]),
    valid: &[bool],
) -> Vec<u8> {
    let across = grid.cols.div_ceil(grid.tile_cols);
    let (first_row, first_col) = (tile / across * grid.tile_rows, tile % across * grid.tile_cols);
    let rows = grid.tile_rows.min(grid.rows - first_row);
    let cols = grid.tile_cols.min(grid.cols - first_col);

    let mut row_values = vec![0.0; grid.tile_cols];
    let mut stored = vec![0; grid.tile_cols * 4];
    // terrain shrinks to about 60 %
    let packed = Vec::with_capacity(grid.tile_rows * grid.tile_cols * 3);
    let mut encoder = ZlibEncoder::new(packed, Compression::new(packing.deflate_level));
    let mut write = |stored: &[u8]| {
        encoder.write_all(stored).unwrap_or_else(|e| unreachable!("a vector takes all bytes: {e}"));
    };
    for row in first_row..first_row + rows {
        let values = &mut row_values[..cols];
        read(row, first_col, values);
        let start = row * grid.cols + first_col;
        for (index, (value, valid)) in values.iter_mut().zip(&valid[start..]).enumerate() {
            if *valid {
                assert!(value.is_finite(), "cell ({row}, {}) holds {value}", first_col + index);
            } else {
                *value = NODATA;
            }
        }
        // beyond the image: nobody reads it, and equal values pack best
        let last = row_values[cols - 1];
        row_values[cols..].fill(last);
        codec::apply_float_predictor(&row_values, &mut stored);
        write(&stored);
    }
    for _ in rows..grid.tile_rows {
        write(&stored);
    }
    encoder.finish().unwrap_or_else(|e| unreachable!("a vector takes all bytes: {e}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_multiples_of_sixteen() {
        let grid = TileGrid::new(7, 5);
        assert_eq!((grid.tile_rows, grid.tile_cols, grid.len()), (16, 16, 1));
        assert_eq!(TileGrid::new(1000, 513).len(), 4);
        // never as wide as a tall image
        assert_eq!(TileGrid::new(513, 512).tile_cols, 256);
        assert_eq!(TileGrid::new(750, 256).tile_cols, 272);
        assert_eq!(TileGrid::new(512, 512).tile_cols, 512);
    }
}
