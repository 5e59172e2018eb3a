//! Plot: the ground that plants compete on, and the canopy that stands over it and does not change.

use std::ops::Range;

use rayon::prelude::*;

use super::parameters::{Parameters, Seeding};
use super::seedbank::{self, Seeds};
use crate::abiotics::AbioticMaps;
use crate::plants::{Layer, Plants};
use crate::raster::{Frame, Grid, MONTHS, MonthlyGrid};
use crate::species::Biome;

/// What a terrain cell offers, month by month from January.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundCell {
    /// Light a day above all plants, hours.
    pub sun_h: [f32; MONTHS],
    /// Soil water, mm.
    pub moisture_mm: [f32; MONTHS],
    /// Temperature, °C.
    pub temperature_c: [f32; MONTHS],
    /// Slope, radians.
    pub slope_rad: f32,
}

/// A tree of the fixed canopy. Places are metres from the plot's north-west corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CanopyTree {
    /// Index into the biome's species.
    pub species: u16,
    /// Metres east of the corner.
    pub east_m: f32,
    /// Metres south of it.
    pub south_m: f32,
    /// Crown radius.
    pub crown_radius_m: f32,
    /// Height.
    pub height_m: f32,
    /// Height of the lowest live branches: undergrowth that reaches it dies.
    pub crown_base_m: f32,
}

/// What the canopy leaves to a simulation cell. Its water is not here: soil water, as the abiotic maps have it, is what
/// vegetation's transpiration has left already.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CanopyCell {
    /// Share of the light that it lets through.
    pub light_fraction: f32,
    /// Height of its underside, or of what would be canopy where there is none, m.
    pub base_m: f32,
}

const OPEN: CanopyCell = CanopyCell { light_fraction: 1.0, base_m: f32::INFINITY };

/// A rectangle of a scene's cells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellWindow {
    /// Rows, from the north.
    pub rows: Range<usize>,
    /// Columns, from the west.
    pub cols: Range<usize>,
}

impl CellWindow {
    /// All of a frame.
    pub fn all(frame: &Frame) -> Self {
        Self { rows: 0..frame.rows, cols: 0..frame.cols }
    }
}

/// Ground and canopy of a rectangle; rows count southwards.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Rows of simulation cells.
    pub rows: usize,
    /// Columns of simulation cells.
    pub cols: usize,
    /// Width of a simulation cell, m.
    pub cell_m: f32,
    /// Absolute number of the first column, counted in simulation cells east: draws are keyed by it.
    pub first_east: i64,
    /// Absolute number of the first row, counted in simulation cells south.
    pub first_south: i64,
    /// Ground by terrain cell, row-major.
    pub(super) ground: Vec<GroundCell>,
    /// Seeds by terrain cell.
    pub(super) seeds: Vec<Seeds>,
    /// Whether nothing sprouts on a terrain cell.
    is_barren: Vec<bool>,
    /// Canopy by simulation cell; empty where there is none.
    canopy: Vec<CanopyCell>,
    /// Row of the terrain cell that the middle of each simulation row lies in.
    pub(super) ground_row: Vec<usize>,
    /// The same of columns.
    pub(super) ground_col: Vec<usize>,
    ground_cols: usize,
    ground_cell_m: f32,
}

/// A frame's cells joined to ground cells.
struct Joined {
    /// Cells of the frame on each side of a ground cell.
    side: usize,
    rows: usize,
    cols: usize,
    cell_m: f32,
    frame_rows: usize,
    frame_cols: usize,
}

/// Least width of ground cells. Peytavie 2024, section 5.1: 1–3 m.
const LEAST_GROUND_CELL_M: f32 = 2.0;

impl Joined {
    fn of(frame: &Frame) -> Self {
        let cell_m = frame.cell_m();
        // 1.9 m cells are two metres wide enough
        let side = (LEAST_GROUND_CELL_M / cell_m - 0.1).ceil().max(1.0) as usize;
        Self {
            side,
            rows: frame.rows.div_ceil(side),
            cols: frame.cols.div_ceil(side),
            cell_m: cell_m * side as f32,
            frame_rows: frame.rows,
            frame_cols: frame.cols,
        }
    }

    /// Mean over the cells of a ground cell that have a value; 0 if none has.
    fn mean(&self, block: usize, value: impl Fn(usize) -> Option<f32>) -> f32 {
        let (row, col) = (block / self.cols * self.side, block % self.cols * self.side);
        let (mut sum, mut count) = (0.0, 0.0);
        for row in row..(row + self.side).min(self.frame_rows) {
            for col in col..(col + self.side).min(self.frame_cols) {
                if let Some(value) = value(row * self.frame_cols + col) {
                    sum += value;
                    count += 1.0;
                }
            }
        }
        if count > 0.0 { sum / count } else { 0.0 }
    }
}

impl Plot {
    /// The plot of a scene, or of a window of its cells: abiotic maps and canopy trees, those beyond the rim included as far
    /// as their crowns and seeds reach.
    ///
    /// # Panics
    /// If the window is not within the maps.
    pub fn of(
        maps: &AbioticMaps,
        canopy: &Plants,
        biome: &Biome,
        parameters: &Parameters,
        window: &CellWindow,
    ) -> Self {
        let frame = maps.slope_rad.frame();
        let ground_cell_m = frame.cell_m();
        let CellWindow { rows, cols } = window;
        assert!(rows.end <= frame.rows && cols.end <= frame.cols, "the window leaves the maps");
        let cell = |index: usize| {
            let index =
                (rows.start + index / cols.len()) * frame.cols + cols.start + index % cols.len();
            GroundCell {
                sun_h: std::array::from_fn(|month| maps.sunlight_h.month(month)[index]),
                moisture_mm: std::array::from_fn(|month| maps.moisture_mm.month(month)[index]),
                temperature_c: std::array::from_fn(|month| maps.temperature_c.at(month, index)),
                slope_rad: maps.slope_rad.values()[index],
            }
        };
        let ground = (0..rows.len() * cols.len()).into_par_iter().map(cell).collect();
        let (west_m, north_m) =
            (cols.start as f32 * ground_cell_m, (frame.rows - rows.start) as f32 * ground_cell_m);
        let tree = |index: usize| {
            let species = &biome.species[usize::from(canopy.species[index])];
            CanopyTree {
                species: canopy.species[index],
                east_m: canopy.east_m[index] - west_m,
                south_m: north_m - canopy.north_m[index],
                crown_radius_m: canopy.crown_radius_m[index],
                height_m: canopy.height_m[index],
                crown_base_m: species.crown_base_m(canopy.height_m[index], 1.0),
            }
        };
        let is_canopy = |index: &usize| canopy.layer[*index] == Layer::Canopy;
        let trees: Vec<CanopyTree> = (0..canopy.len()).filter(is_canopy).map(tree).collect();
        let mut plot =
            Self::new([rows.len(), cols.len()], ground_cell_m, ground, &trees, biome, parameters);
        // places are below 10⁹ cells
        let number = |m: f64| (m / f64::from(plot.cell_m)).round() as i64;
        let corner = frame.transform;
        plot.first_east = number(corner.west_m + f64::from(west_m));
        plot.first_south = number(-corner.north_m + rows.start as f64 * corner.cell_m);
        plot
    }

    /// A plot of `ground_rows` × `ground_cols` terrain cells, `ground_cell_m` wide, under a canopy.
    ///
    /// # Panics
    /// If the ground does not fill its cells, or a plot has more than 2³² simulation cells.
    pub fn new(
        [ground_rows, ground_cols]: [usize; 2],
        ground_cell_m: f32,
        ground: Vec<GroundCell>,
        canopy: &[CanopyTree],
        biome: &Biome,
        parameters: &Parameters,
    ) -> Self {
        assert_eq!(ground.len(), ground_rows * ground_cols, "ground does not fill its cells");
        let cell_m = parameters.cell_m;
        // whole simulation cells; a rim narrower than one is left out
        let cells = |ground_cells: usize| {
            ((ground_cells as f32 * ground_cell_m / cell_m) + 1e-3).floor().max(1.0) as usize
        };
        let (rows, cols) = (cells(ground_rows), cells(ground_cols));
        assert!(rows * cols < u32::MAX as usize, "too large a plot: cut it into smaller ones");
        let lines = |cells: usize, most: usize| {
            let line = |cell| ((cell as f32 + 0.5) * cell_m / ground_cell_m) as usize;
            (0..cells).map(|cell| line(cell).min(most - 1)).collect()
        };
        let seeds = match parameters.seeding {
            Seeding::Everywhere { .. } => vec![Seeds::EVERYWHERE; ground.len()],
            Seeding::CanopyTrees => {
                let mut seeds = vec![Seeds::default(); ground.len()];
                for tree in canopy {
                    let size = [ground_rows, ground_cols];
                    seedbank::sow(tree, biome, parameters, size, ground_cell_m, &mut seeds);
                }
                seeds
            }
        };
        let mut plot = Self {
            rows,
            cols,
            cell_m,
            first_east: 0,
            first_south: 0,
            is_barren: vec![false; ground.len()],
            ground,
            seeds,
            canopy: if canopy.is_empty() && parameters.open_limit_m == f32::INFINITY {
                Vec::new()
            } else {
                vec![OPEN; rows * cols]
            },
            ground_row: lines(rows, ground_rows),
            ground_col: lines(cols, ground_cols),
            ground_cols,
            ground_cell_m,
        };
        for tree in canopy {
            plot.shade(tree, biome);
        }
        let open = plot.canopy.iter_mut().filter(|cell| **cell == OPEN);
        open.for_each(|cell| cell.base_m = parameters.open_limit_m);
        plot
    }

    /// The plot of a whole scene without a canopy of its own, its ground cells two metres wide or more: finer ones are
    /// joined. Nothing sprouts where `is_barren` holds for half of a ground cell or where the maps hold nothing.
    ///
    /// # Reference
    /// Peytavie et al. 2024, section 5.1: abiotic factors on cells of 1–3 m.
    /// # Departures
    /// Light is the yearly mean in every month. Hours of the species tables are such means, by which species maps are made too;
    /// month by month, oaks that want 8 to 15 hours would die of any winter, and firs that bear 2 to 8 of any summer.
    ///
    /// # Panics
    /// If `is_barren` is not of the maps' size.
    pub fn open(
        maps: &AbioticMaps,
        is_barren: &[bool],
        biome: &Biome,
        parameters: &Parameters,
    ) -> Self {
        let joined = Joined::of(maps.slope_rad.frame());
        let is_valid = |index: usize| maps.slope_rad.mask().is_valid(index);
        let mean_sun_h = maps.sunlight_h.yearly_mean();
        let ground: Vec<GroundCell> = (0..joined.rows * joined.cols)
            .into_par_iter()
            .map(|block| GroundCell {
                sun_h: [joined
                    .mean(block, |index| is_valid(index).then(|| mean_sun_h.values()[index]));
                    MONTHS],
                moisture_mm: [0.0; MONTHS],
                temperature_c: std::array::from_fn(|month| {
                    joined.mean(block, |index| {
                        is_valid(index).then(|| maps.temperature_c.at(month, index))
                    })
                }),
                slope_rad: joined
                    .mean(block, |index| is_valid(index).then(|| maps.slope_rad.values()[index])),
            })
            .collect();
        let mut plot =
            Self::new([joined.rows, joined.cols], joined.cell_m, ground, &[], biome, parameters);
        // ground cells at the rim may reach beyond the scene, plants do not
        let frame = maps.slope_rad.frame();
        let inside = |cells: usize| (cells as f32 * frame.cell_m() / plot.cell_m + 1e-3) as usize;
        (plot.rows, plot.cols) =
            (plot.rows.min(inside(frame.rows)), plot.cols.min(inside(frame.cols)));
        plot.ground_row.truncate(plot.rows);
        plot.ground_col.truncate(plot.cols);
        plot.set_moisture(frame, &maps.moisture_mm);
        for block in 0..plot.seeds.len() {
            let barren = joined.mean(block, |index| {
                Some(f32::from(u8::from(is_barren[index] || !is_valid(index))))
            });
            if barren >= 0.5 {
                plot.is_barren[block] = true;
                plot.seeds[block] = Seeds::default();
            }
        }
        let corner = frame.transform;
        // places are below 10⁹ cells
        let number = |m: f64| (m / f64::from(plot.cell_m)).round() as i64;
        plot.first_east = number(corner.west_m);
        plot.first_south = number(-corner.north_m);
        plot
    }

    /// Puts other soil water on the ground of [`Self::open`], as monthly maps have it that lie on `frame`.
    pub fn set_moisture(&mut self, frame: &Frame, moisture_mm: &MonthlyGrid) {
        let joined = Joined::of(frame);
        assert_eq!(self.ground.len(), joined.rows * joined.cols, "another scene's moisture");
        let mask = moisture_mm.mask();
        self.ground.par_iter_mut().enumerate().for_each(|(block, ground)| {
            for (month, mm) in ground.moisture_mm.iter_mut().enumerate() {
                let values = moisture_mm.month(month);
                *mm = joined.mean(block, |index| mask.is_valid(index).then(|| values[index]));
            }
        });
    }

    /// Lays other seeds on ground that is not barren, by row and column of ground cells.
    pub(super) fn set_seeds(&mut self, seeds_at: impl Fn(usize, usize) -> Seeds + Sync) {
        let cols = self.ground_cols;
        let rows = self.seeds.par_chunks_mut(cols).zip(self.is_barren.par_chunks(cols));
        rows.enumerate().for_each(|(row, (seeds, is_barren))| {
            for (col, (seeds, is_barren)) in seeds.iter_mut().zip(is_barren).enumerate() {
                if !is_barren {
                    *seeds = seeds_at(row, col);
                }
            }
        });
    }

    /// Mean over each ground cell of [`Self::open`] of a map of the scene, 0 where it holds nothing.
    pub fn joined_mean(&self, map: &Grid<f32>) -> Vec<f32> {
        let joined = Joined::of(map.frame());
        let value = |index: usize| map.mask().is_valid(index).then(|| map.values()[index]);
        (0..joined.rows * joined.cols)
            .into_par_iter()
            .map(|block| joined.mean(block, value))
            .collect()
    }

    /// Rows, columns and width in m of ground cells.
    pub fn ground_size(&self) -> ([usize; 2], f32) {
        let cols = self.ground_cols;
        ([self.ground.len() / cols, cols], self.ground_cell_m)
    }

    /// Ground by ground cell, row-major.
    pub fn ground(&self) -> &[GroundCell] {
        &self.ground
    }

    /// The ground of a place.
    pub fn ground_at(&self, east_m: f32, south_m: f32) -> &GroundCell {
        let [row, col] = self.cell_at(east_m, south_m);
        &self.ground[self.ground_of(row, col)]
    }

    /// What the canopy leaves to a simulation cell.
    #[inline]
    pub(super) fn canopy_at(&self, cell: usize) -> CanopyCell {
        if self.canopy.is_empty() { OPEN } else { self.canopy[cell] }
    }

    /// Least height at which the canopy begins anywhere.
    pub(super) fn lowest_canopy_m(&self) -> f32 {
        self.canopy.iter().map(|cell| cell.base_m).fold(f32::INFINITY, f32::min)
    }

    fn shade(&mut self, tree: &CanopyTree, biome: &Biome) {
        let species = &biome.species[usize::from(tree.species)];
        let keep = 1.0 - species.absorbed_light_fraction;
        let crown =
            Disk { east_m: tree.east_m, south_m: tree.south_m, radius_m: tree.crown_radius_m };
        let beyond = |at_m: f32, cells: usize| {
            at_m < -tree.crown_radius_m || at_m > cells as f32 * self.cell_m + tree.crown_radius_m
        };
        if beyond(tree.east_m, self.cols) || beyond(tree.south_m, self.rows) {
            return;
        }
        for row in crown.rows(self.rows, self.cell_m) {
            for col in crown.cols(row, self.cols, self.cell_m) {
                let cell = &mut self.canopy[row * self.cols + col];
                cell.light_fraction *= keep;
                cell.base_m = cell.base_m.min(tree.crown_base_m);
            }
        }
    }

    /// Index of the terrain cell that a simulation cell lies in.
    #[inline]
    pub(super) fn ground_of(&self, row: usize, col: usize) -> usize {
        self.ground_row[row] * self.ground_cols + self.ground_col[col]
    }

    /// Row and column of the simulation cell that a place lies in.
    #[inline]
    pub(super) fn cell_at(&self, east_m: f32, south_m: f32) -> [usize; 2] {
        // `as` cuts negatives to 0
        let cell = |at_m: f32, cells: usize| ((at_m / self.cell_m) as usize).min(cells - 1);
        [cell(south_m, self.rows), cell(east_m, self.cols)]
    }

    /// Number of simulation cells.
    pub fn cells(&self) -> usize {
        self.rows * self.cols
    }

    /// Memory that it takes, ground and canopy together.
    pub fn bytes(&self) -> usize {
        let Self { ground, seeds, is_barren, canopy, ground_row, ground_col, .. } = self;
        size_of_val(&ground[..])
            + size_of_val(&seeds[..])
            + size_of_val(&is_barren[..])
            + size_of_val(&canopy[..])
            + size_of_val(&ground_row[..])
            + size_of_val(&ground_col[..])
    }

    /// Area in m².
    pub fn area_m2(&self) -> f32 {
        (self.rows * self.cols) as f32 * self.cell_m * self.cell_m
    }
}

/// A crown from above, in metres from the plot's north-west corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disk {
    pub east_m: f32,
    pub south_m: f32,
    pub radius_m: f32,
}

impl Disk {
    /// Whether it is too narrow to reach the middle of any cell but its own.
    #[inline]
    pub fn is_of_one_cell(&self, cell_m: f32) -> bool {
        self.radius_m < 0.499 * cell_m
    }

    /// Rows with cells of it: those whose middle it reaches, and that of its own middle.
    #[inline]
    pub fn rows(&self, rows: usize, cell_m: f32) -> Range<usize> {
        span(self.south_m, self.radius_m, rows, cell_m)
    }

    /// Columns of all rows together.
    #[inline]
    pub fn all_cols(&self, cols: usize, cell_m: f32) -> Range<usize> {
        span(self.east_m, self.radius_m, cols, cell_m)
    }

    /// Columns of a row whose middles it covers; in the row of its middle at least that.
    #[inline]
    pub fn cols(&self, row: usize, cols: usize, cell_m: f32) -> Range<usize> {
        let south_m = (row as f32 + 0.5) * cell_m - self.south_m;
        let half_m = (self.radius_m * self.radius_m - south_m * south_m).max(0.0).sqrt();
        let own_row = south_m.abs() <= 0.5 * cell_m;
        if half_m == 0.0 && !own_row {
            return 0..0;
        }
        if own_row {
            span(self.east_m, half_m, cols, cell_m)
        } else {
            disk_span(self.east_m, half_m, cols, cell_m)
        }
    }
}

/// Cells of a line, `cell_m` wide, whose middles lie within `half_m` of a place.
#[inline]
pub fn disk_span(at_m: f32, half_m: f32, cells: usize, cell_m: f32) -> Range<usize> {
    // `as` cuts negatives to 0
    let first = ((at_m - half_m) / cell_m + 0.5).max(0.0) as usize;
    let end = ((at_m + half_m) / cell_m + 0.5).max(0.0) as usize;
    first.min(cells)..end.min(cells).max(first.min(cells))
}

/// The same, and at least the cell of the place itself.
#[inline]
fn span(at_m: f32, half_m: f32, cells: usize, cell_m: f32) -> Range<usize> {
    let covered = disk_span(at_m, half_m, cells, cell_m);
    let own = ((at_m / cell_m).max(0.0) as usize).min(cells - 1);
    if covered.is_empty() { own..own + 1 } else { covered.start.min(own)..covered.end.max(own + 1) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(disk: Disk) -> Vec<(usize, usize)> {
        let of_row = |row| disk.cols(row, 30, 0.2).map(move |col| (row, col));
        disk.rows(30, 0.2).flat_map(of_row).collect()
    }

    #[test]
    fn a_disk_covers_the_cells_whose_middles_it_covers_and_its_own() {
        for (east_m, south_m, radius_m) in [
            (3.01, 2.97, 1.0),
            (0.05, 5.99, 0.7),
            (2.5, 2.5, 0.0),
            (1.07, 1.13, 0.04),
            (5.9, 0.3, 2.3),
        ] {
            let disk = Disk { east_m, south_m, radius_m };
            let own = ((south_m / 0.2) as usize, (east_m / 0.2) as usize);
            let covers = |row: usize, col: usize| {
                let (y, x) =
                    ((row as f32 + 0.5) * 0.2 - south_m, (col as f32 + 0.5) * 0.2 - east_m);
                x * x + y * y < radius_m * radius_m || (row, col) == own
            };
            let expected: Vec<_> =
                (0..900).map(|i| (i / 30, i % 30)).filter(|(r, c)| covers(*r, *c)).collect();
            assert_eq!(cells(disk), expected, "{disk:?}");
            assert!(!disk.is_of_one_cell(0.2) || expected == [own]);
        }
    }

    #[test]
    fn crowns_shade_and_drink_and_have_an_underside() {
        let biome = Biome::builtin("sonoma").unwrap();
        let species = biome.sub_biomes[0].canopy[0];
        let tree = |east_m: f32, crown_base_m: f32| CanopyTree {
            species: species as u16,
            east_m,
            south_m: 10.0,
            crown_radius_m: 4.0,
            height_m: 20.0,
            crown_base_m,
        };
        let cell = GroundCell {
            sun_h: [5.0; MONTHS],
            moisture_mm: [80.0; MONTHS],
            temperature_c: [12.0; MONTHS],
            slope_rad: 0.0,
        };
        let trees = [tree(8.0, 6.0), tree(12.0, 9.0)];
        let plot =
            Plot::new([20, 20], 1.0, vec![cell; 400], &trees, &biome, &Parameters::kapp2020());
        assert_eq!((plot.rows, plot.cols, plot.ground_of(52, 98)), (100, 100, 10 * 20 + 19));
        let at = |east_m: f32| {
            let [row, col] = plot.cell_at(east_m, 10.0);
            plot.canopy[row * 100 + col]
        };
        let keep = 1.0 - biome.species[species].absorbed_light_fraction;
        assert_eq!(at(5.0), CanopyCell { light_fraction: keep, base_m: 6.0 });
        assert_eq!(at(10.0), CanopyCell { light_fraction: keep * keep, base_m: 6.0 });
        assert_eq!(at(1.0), CanopyCell { base_m: 3.0, ..OPEN });
    }
}
