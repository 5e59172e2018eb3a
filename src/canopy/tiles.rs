//! Tiles: neighbouring trees changed one after the other, far ones at once.
//!
//! The grid is cut into square tiles at least as wide as two crowns reach, coloured in fours like
//! a b a b
//! c d c d
//! so that the crowns of one tile never touch what the crowns of another tile of its colour touch. One colour after the
//! other, its tiles are worked in parallel: the result depends on neither threads nor their order.

use rayon::prelude::*;

use super::crowns::{GridSize, UNITS_PER_CELL, cell_of_units};

/// Least width of a tile in cells. chosen: wide enough to be worth a task, narrow enough for many.
const LEAST_TILE_CELLS: usize = 64;

/// How a grid is cut.
#[derive(Clone, Copy, Debug)]
pub struct Tiling {
    tile_cells: usize,
    rows: usize,
    cols: usize,
}

impl Tiling {
    /// Tiles for crowns of up to `widest` units.
    pub fn new(size: GridSize, widest: i32) -> Self {
        // two radii, and a cell at either end
        let reach = 2 * (widest / UNITS_PER_CELL + 2) as usize; // not negative
        let tile_cells = reach.max(LEAST_TILE_CELLS);
        let tiles = |cells: usize| cells.div_ceil(tile_cells).max(1);
        Self { tile_cells, rows: tiles(size.rows), cols: tiles(size.cols) }
    }

    /// The tile that a position in units lies in.
    #[inline]
    pub fn tile_at(&self, x: i32, y: i32) -> usize {
        let along = |at: i32, tiles: usize| (cell_of_units(at) / self.tile_cells).min(tiles - 1);
        along(y, self.rows) * self.cols + along(x, self.cols)
    }

    /// Indices of `positions` by tile, in their order.
    pub fn sorted(&self, positions: impl Iterator<Item = (i32, i32)>) -> Vec<Vec<u32>> {
        let mut tiles = vec![Vec::new(); self.rows * self.cols];
        for (index, (x, y)) in (0_u32..).zip(positions) {
            tiles[self.tile_at(x, y)].push(index);
        }
        tiles
    }

    /// Works on every tile, colour after colour; gives what each tile's work gave, in the order of tiles.
    pub fn run<T: Send>(&self, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
        let mut done: Vec<(usize, T)> = Vec::with_capacity(self.rows * self.cols);
        for color in 0..4 {
            let of_color = (0..self.rows * self.cols).filter(|tile| {
                let (row, col) = (tile / self.cols, tile % self.cols);
                row % 2 * 2 + col % 2 == color
            });
            let tiles: Vec<usize> = of_color.collect();
            done.par_extend(tiles.into_par_iter().map(|tile| (tile, work(tile))));
        }
        done.sort_unstable_by_key(|(tile, _)| *tile);
        done.into_iter().map(|(_, result)| result).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    #[test]
    fn tiles_of_one_color_are_two_crowns_apart() {
        let widest = 40 * UNITS_PER_CELL;
        let tiling = Tiling::new(GridSize { rows: 500, cols: 700 }, widest);
        assert!(tiling.tile_cells as i32 * UNITS_PER_CELL >= 2 * widest + 2 * UNITS_PER_CELL);
        assert_eq!(Tiling::new(GridSize { rows: 10, cols: 1 }, 100).run(|tile| tile), [0]);
    }

    #[test]
    fn neighbours_never_run_in_one_color_and_results_are_in_order() {
        let tiling = Tiling::new(GridSize { rows: 64 * 5, cols: 64 * 3 }, 32);
        let ran = Mutex::new(Vec::new());
        let results = tiling.run(|tile| {
            ran.lock().unwrap().push(tile);
            tile
        });
        assert_eq!(results, (0..15).collect::<Vec<_>>());
        // the four colours of 5 × 3 tiles, one after the other, each in any order
        let ran = ran.into_inner().unwrap();
        let mut rest = &ran[..];
        for (color, tiles) in [6, 3, 4, 2].into_iter().enumerate() {
            let (of_color, others) = rest.split_at(tiles);
            let is_of_color = |tile: &usize| tile / 3 % 2 * 2 + tile % 3 % 2 == color;
            assert!(of_color.iter().all(is_of_color), "{of_color:?}");
            rest = others;
        }
        assert!(rest.is_empty());
    }
}
