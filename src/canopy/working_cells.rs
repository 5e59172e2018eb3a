//! Working cells: the grid that trees are placed on, as fine as crowns need it.

use std::borrow::Cow;

use rayon::prelude::*;

use super::crowns::{GridSize, UNITS_PER_CELL};
use super::species_map::{NO_SPECIES, SpeciesMap};
use super::visibility::CanopyCells;
use crate::raster::{Grid, Mask};

/// Wider scene cells are cut into working cells no wider than this. chosen: the crowns of trees of 8 m are about 4 m wide;
/// on cells a quarter as wide they are still round.
const MAX_WORKING_CELL_M: f64 = 1.0;
/// The same where most of the canopy is lower than [`LOW_CANOPY_M`]. chosen: the crowns of 3 m trees, the lowest that count
/// as canopy, are about 2 m wide.
const MAX_WORKING_CELL_LOW_M: f64 = 0.5;
/// Canopy lower than this is low. chosen: its crowns are narrower than 4 m.
const LOW_CANOPY_M: f32 = 8.0;
/// What widths of cells are rounded by in files. chosen: a thousandth of a millimetre.
const CELL_NOISE_M: f64 = 1e-6;

/// Scene cells that trees can be placed on, metres. Narrower ones leave no room for crowns in units, see
/// [`super::crowns`]; wider ones show no crowns at all. chosen: twice beyond the 0.5–5 m that placement is meant for.
pub const CELLS_M: std::ops::RangeInclusive<f64> = 0.25..=10.0;
/// Working cells at most. chosen: half of what the `u32` of a top counts, and more than memories hold.
const MOST_CELLS: f64 = 2_147_483_648.0;

/// The canopy on working cells: each scene cell cut into `per_cell` × `per_cell`.
#[derive(Clone, Debug)]
pub struct WorkingCells<'a> {
    /// Working cells along a scene cell's side.
    pub per_cell: usize,
    /// Size of the working grid.
    pub size: GridSize,
    /// Width of a working cell.
    pub cell_m: f32,
    /// Canopy's surface above ground, metres, where trees are seeded by its shape.
    pub surface_m: Cow<'a, [f32]>,
    /// Whether the scene's cell is canopy.
    pub is_canopy: Vec<bool>,
    /// Columns of the scene.
    scene_cols: usize,
}

impl<'a> WorkingCells<'a> {
    /// Working cells of a canopy height model; `allowed` cells of at least `min_height_m` are canopy.
    pub fn new(chm_m: &'a Grid<f32>, allowed: &Mask, min_height_m: f32) -> Self {
        let frame = chm_m.frame();
        let scene_cell_m = frame.transform.cell_m;
        let is_land: Vec<bool> = chm_m
            .mask()
            .as_slice()
            .par_iter()
            .zip(allowed.as_slice())
            .map(|(&valid, &allowed)| valid && allowed)
            .collect();
        let is_scene_canopy: Vec<bool> = chm_m
            .values()
            .par_iter()
            .zip(&is_land)
            .map(|(&h, &land)| land && h >= min_height_m)
            .collect();
        let per_cell = if scene_cell_m <= MAX_WORKING_CELL_M + CELL_NOISE_M {
            1
        } else {
            let heights = chm_m.values().par_iter().zip(&is_scene_canopy);
            let (all, low) = heights
                .filter(|(_, is_canopy)| **is_canopy)
                .map(|(&h, _)| (1_usize, usize::from(h < LOW_CANOPY_M)))
                .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
            let is_low = 2 * low > all;
            let widest_m = if is_low { MAX_WORKING_CELL_LOW_M } else { MAX_WORKING_CELL_M };
            ((scene_cell_m - CELL_NOISE_M) / widest_m).ceil() as usize // at most 20, see CELLS_M
        };
        let size = GridSize { rows: frame.rows * per_cell, cols: frame.cols * per_cell };
        let (surface_m, is_canopy) = if per_cell == 1 {
            (Cow::Borrowed(chm_m.values()), is_scene_canopy)
        } else {
            let surface = refined(chm_m, &is_land, per_cell, size);
            let spread = (0..size.rows * size.cols)
                .into_par_iter()
                .map(|i| {
                    is_scene_canopy
                        [i / size.cols / per_cell * frame.cols + i % size.cols / per_cell]
                })
                .collect();
            (Cow::Owned(surface), spread)
        };
        let cell_m = (scene_cell_m / per_cell as f64) as f32; // 0.25–1 m
        let scene_cols = frame.cols;
        Self { per_cell, size, cell_m, surface_m, is_canopy, scene_cols }
    }

    /// Whether trees can be placed on cells of `cell_m`, `rows` by `cols` of them.
    ///
    /// # Errors
    /// What is wrong, and what to do.
    pub fn check(rows: usize, cols: usize, cell_m: f64) -> Result<(), String> {
        if !CELLS_M.contains(&cell_m) {
            let (least, most) = (CELLS_M.start(), CELLS_M.end());
            return Err(format!(
                "cells of {cell_m} m: trees are placed on cells of {least} to {most} m; import with --cell"
            ));
        }
        let per_cell = (cell_m / MAX_WORKING_CELL_LOW_M).max(1.0);
        if rows as f64 * cols as f64 * per_cell * per_cell > MOST_CELLS {
            return Err(format!(
                "{rows} × {cols} cells of {cell_m} m are too many to place trees on at once; import a part with --bbox"
            ));
        }
        Ok(())
    }

    /// The cells as the renderers of visibility take them.
    pub fn canopy(&self) -> CanopyCells<'_> {
        CanopyCells { rows: self.size.rows, cols: self.size.cols, is_canopy: &self.is_canopy }
    }

    /// Index of the scene cell that a working cell is part of.
    #[inline]
    pub fn scene_index(&self, index: usize) -> usize {
        if self.per_cell == 1 {
            return index;
        }
        let (row, col) = (index / self.size.cols, index % self.size.cols);
        row / self.per_cell * self.scene_cols + col / self.per_cell
    }

    /// Index of the working cell that a position in units lies in.
    #[inline]
    pub fn index_at(&self, x: i32, y: i32) -> usize {
        let cell = |units: i32, cells: usize| super::crowns::cell_of_units(units).min(cells - 1);
        cell(y, self.size.rows) * self.size.cols + cell(x, self.size.cols)
    }

    /// The same; `None` outside the grid.
    #[inline]
    pub fn index_within(&self, x: i32, y: i32) -> Option<usize> {
        let is_within = |at: i32, cells: usize| at >= 0 && super::crowns::cell_of_units(at) < cells;
        let is_inside = is_within(x, self.size.cols) && is_within(y, self.size.rows);
        is_inside.then(|| self.index_at(x, y))
    }

    /// Units in a metre.
    #[inline]
    pub fn units_per_m(&self) -> f32 {
        UNITS_PER_CELL as f32 / self.cell_m
    }

    /// Working cells whose trees are known: canopy on which some species can stand.
    #[inline]
    pub fn is_plantable(&self, index: usize, species: &SpeciesMap) -> bool {
        self.is_canopy[index] && species.values()[self.scene_index(index)] != NO_SPECIES
    }
}

/// The surface between cell centres by Catmull–Rom splines, so that tops lie between cells where their neighbours say so;
/// never below ground. What is no land counts as ground.
fn refined(chm_m: &Grid<f32>, is_land: &[bool], per_cell: usize, size: GridSize) -> Vec<f32> {
    let frame = chm_m.frame();
    let weights: Vec<[f32; 4]> = (0..per_cell)
        .map(|sub| {
            let offset = (sub as f32 + 0.5) / per_cell as f32 - 0.5;
            catmull_rom(if offset < 0.0 { offset + 1.0 } else { offset })
        })
        .collect();
    // the first of four neighbours along an axis, for a working cell
    let first = |cell: usize| {
        let sub = cell % per_cell;
        let before = usize::from(2 * sub + 1 < per_cell); // left of the centre
        (cell / per_cell) as isize - 1 - before as isize
    };
    let clamped = |at: isize, len: usize| at.clamp(0, len as isize - 1) as usize;
    let mut surface = vec![0.0; size.rows * size.cols];
    surface.par_chunks_mut(size.cols).enumerate().for_each(|(row, line)| {
        let row_weights = weights[row % per_cell];
        let rows: [usize; 4] =
            std::array::from_fn(|i| clamped(first(row) + i as isize, frame.rows));
        let mixed: Vec<f32> = (0..frame.cols)
            .map(|col| {
                let at = |i: usize| {
                    let index = rows[i] * frame.cols + col;
                    if is_land[index] { chm_m.values()[index].max(0.0) } else { 0.0 }
                };
                (0..4).map(|i| row_weights[i] * at(i)).sum()
            })
            .collect();
        for (col, value) in line.iter_mut().enumerate() {
            let col_weights = weights[col % per_cell];
            let at = |i: usize| mixed[clamped(first(col) + i as isize, frame.cols)];
            *value = (0..4).map(|i| col_weights[i] * at(i)).sum::<f32>().max(0.0);
        }
    });
    surface
}

/// Weights of four values one apart, for a place `t` past the second, 0 ≤ t < 1.
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        0.5 * (-t3 + 2.0 * t2 - t),
        0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
        0.5 * (-3.0 * t3 + 4.0 * t2 + t),
        0.5 * (t3 - t2),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Cell;

    fn ramp(cell_m: f64) -> Grid<f32> {
        Grid::from_fn(8, 10, cell_m, |Cell { row, col }| 2.0 + row as f32 + 2.0 * col as f32)
    }

    #[test]
    fn cells_too_narrow_too_wide_or_too_many_are_refused() {
        assert!(WorkingCells::check(1000, 1000, 1.0).is_ok());
        assert!(WorkingCells::check(1000, 1000, 0.1).unwrap_err().contains("0.25 to 10 m"));
        assert!(WorkingCells::check(1000, 1000, 30.0).unwrap_err().contains("--cell"));
        assert!(WorkingCells::check(20_000, 20_000, 5.0).unwrap_err().contains("--bbox"));
    }

    #[test]
    fn cells_up_to_a_metre_stay_as_they_are() {
        for cell_m in [0.5, 1.0, 1.000_000_000_1] {
            let chm = ramp(cell_m);
            let cells = WorkingCells::new(&chm, chm.mask(), 3.0);
            assert_eq!((cells.per_cell, cells.size.rows), (1, 8));
            assert_eq!(cells.surface_m, chm.values());
            assert!(!cells.is_canopy[0] && cells.is_canopy[1]);
        }
    }

    #[test]
    fn wide_cells_are_cut_and_planes_stay_planes() {
        for (cell_m, per_cell, factor) in
            [(4.0, 4, 1.0), (5.0, 5, 1.0), (2.0, 2, 1.0), (1.5, 2, 1.0), (4.0, 8, 0.25)]
        {
            // the last is lower than 8 m
            let chm = ramp(cell_m);
            let chm = chm.with_values(chm.values().iter().map(|h| h * factor).collect());
            let cells = WorkingCells::new(&chm, chm.mask(), 3.0);
            assert_eq!(cells.per_cell, per_cell);
            assert!(cells.cell_m <= 1.0);
            for row in 2 * per_cell..6 * per_cell {
                for col in 2 * per_cell..8 * per_cell {
                    let at = |cell: usize| (cell as f32 + 0.5) / per_cell as f32 - 0.5;
                    let expected = factor * (2.0 + at(row) + 2.0 * at(col));
                    let index = row * cells.size.cols + col;
                    assert!((cells.surface_m[index] - expected).abs() < 1e-3, "{row} {col}");
                    let scene = row / per_cell * 10 + col / per_cell;
                    assert_eq!(cells.scene_index(index), scene);
                }
            }
        }
    }
}
