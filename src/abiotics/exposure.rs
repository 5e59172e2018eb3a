//! Hours of direct sun and the view of the sky, past the terrain's own horizon, no clouds considered.
//!
//! The circle of azimuths is worked in batches of sectors, so that only a few horizons lie in memory. Each batch
//! adds, cell by cell, the hours the sun spends above the horizon while it crosses the batch's sectors.
//!
//! # Departures
//! Kapp 2020 counts 15-minute steps in light or shade; here the moment at which the sun crosses the horizon is found
//! within the step, both taken as straight, so that the map shows no steps.

use std::f64::consts::TAU;

use rayon::prelude::*;

use super::horizon::{Heights, Horizon};
use super::sky_view::{sky_towards, sky_view_fraction};
use super::slope::{Gradient, gradient_row};
use super::sun_path::{SunArc, SunNode, sun_arcs_by_sector};
use crate::math::{cos_f64, sin_f64};
use crate::progress::{Cancelled, Reporter};
use crate::raster::{Grid, MONTHS, MonthlyGrid};
use crate::terrain::Terrain;

/// Azimuth sectors worked at once. chosen: nine horizons of 4096² cells are 0.6 GB, and each pass over the
/// twelve monthly bands does the work of eight sectors.
const SECTORS_PER_BATCH: usize = 8;
/// Rows of the tiles in which horizons are turned into hours.
/// chosen: nine horizons of a tile are 36 KiB, and a tile's row is four cache lines.
const TILE_ROWS: usize = 16;
/// Columns of those tiles.
const TILE_COLS: usize = 64;
const TILE_CELLS: usize = TILE_ROWS * TILE_COLS;
/// Cells worked at once in the inner loop. chosen: two vectors of the four lanes that every x86-64 has.
const LANES: usize = 8;

/// Sun and sky past the terrain's horizon.
#[derive(Clone, Debug)]
pub struct Exposure {
    /// Hours a day with the sun above the terrain's horizon, whatever angle it strikes the ground at; 0 where masked.
    pub direct_sun_h: MonthlyGrid,
    /// Share of the sky's light that reaches the tilted cell, in 0..=1; 0 where masked.
    pub sky_view: Grid<f32>,
}

/// Direct sun and sky view over a terrain, with the horizon looked up in `azimuth_count` directions (at least 8)
/// and the sun's path in steps of at most `path_step_h`.
///
/// Between directions the horizon is taken as straight. Azimuths count from true north, rows from the grid's: the
/// terrain's convergence turns the sun's path into the grid. The whole terrain has the latitude of its middle.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
pub fn exposure(
    terrain: &Terrain,
    azimuth_count: usize,
    path_step_h: f64,
    reporter: &Reporter,
) -> Result<Exposure, Cancelled> {
    let elevation_m = &terrain.elevation_m;
    let azimuth_count = azimuth_count.max(8);
    let stage = reporter.stage("sunlight", azimuth_count as u64);
    let cells = elevation_m.frame().len();
    let mut months_h: [Vec<f32>; MONTHS] = std::array::from_fn(|_| vec![0.0; cells]);
    let mut sky_view = vec![0.0; cells];
    let sectors = sectors(terrain, azimuth_count, path_step_h);
    let heights = Heights::new(elevation_m);
    let mut window = HorizonWindow { horizons: Vec::new(), spare: Vec::new() };
    for batch in sectors.chunks(SECTORS_PER_BATCH) {
        window.advance(batch, azimuth_count, &heights, reporter)?;
        bands_by_block(elevation_m, &mut months_h, &mut sky_view).into_par_iter().for_each_init(
            || Scratch::new(elevation_m.frame().cols),
            |scratch, mut block| block.add(elevation_m, batch, &window.horizons, scratch),
        );
        stage.advance(batch.len() as u64);
    }
    drop((window, heights));
    bands_by_block(elevation_m, &mut months_h, &mut sky_view).into_par_iter().for_each_init(
        || Scratch::new(elevation_m.frame().cols),
        |scratch, mut block| block.finish(elevation_m, azimuth_count, scratch),
    );
    let (frame, mask) = (elevation_m.frame().clone(), elevation_m.mask().clone());
    Ok(Exposure {
        direct_sun_h: MonthlyGrid::new(frame, mask, months_h),
        sky_view: elevation_m.with_values(sky_view),
    })
}

/// An azimuth sector and the sun's ways through it.
struct Sector {
    /// Number of the sector's first azimuth.
    first: usize,
    /// Unit vector of the first azimuth.
    to_east: f32,
    to_north: f32,
    crossings: Vec<Crossing>,
}

/// The sun's way through a sector in a month, with what it gives to cells all in light or all in shade.
struct Crossing {
    arc: SunArc,
    lowest_tan: f32,
    highest_tan: f32,
    all_light_h: f32,
    all_shade_h: f32,
}

fn sectors(terrain: &Terrain, azimuth_count: usize, path_step_h: f64) -> Vec<Sector> {
    let (latitude_rad, convergence_rad) = (terrain.latitude_rad, terrain.grid_convergence_rad);
    let arcs = sun_arcs_by_sector(latitude_rad, convergence_rad, azimuth_count, path_step_h);
    let sector = |(first, arcs): (usize, Vec<SunArc>)| {
        let azimuth_rad = azimuth_rad(first, azimuth_count);
        Sector {
            first,
            to_east: sin_f64(azimuth_rad) as f32, // kernels are f32
            to_north: cos_f64(azimuth_rad) as f32,
            crossings: arcs.into_iter().map(Crossing::new).collect(),
        }
    };
    arcs.into_iter().enumerate().map(sector).collect()
}

impl Crossing {
    fn new(arc: SunArc) -> Self {
        let tans = arc.nodes.iter().map(|node| node.tan_elevation);
        // heights far below and far above any sun
        let [all_light_h] = lit_h(&arc.nodes, &[-1e9], &[-1e9]);
        let [all_shade_h] = lit_h(&arc.nodes, &[1e9], &[1e9]);
        Self {
            lowest_tan: tans.clone().fold(f32::INFINITY, f32::min),
            highest_tan: tans.fold(0.0, f32::max),
            all_light_h,
            all_shade_h,
            arc,
        }
    }
}

fn azimuth_rad(azimuth: usize, azimuth_count: usize) -> f64 {
    TAU * (azimuth % azimuth_count) as f64 / azimuth_count as f64
}

/// Hours along a path with the sun above the horizon, `N` cells at once.
///
/// `first` and `second` are the horizon's tangents at the sector's sides. Between two nodes the sun's height over
/// the horizon runs straight from d₀ to d₁, so it is positive for the share ½ + ½·(d₀ + d₁)/(|d₀| + |d₁|).
#[inline]
fn lit_h<const N: usize>(nodes: &[SunNode], first: &[f32; N], second: &[f32; N]) -> [f32; N] {
    let over = |node: &SunNode| -> [f32; N] {
        std::array::from_fn(|i| {
            (node.tan_elevation - first[i]) - node.sector_fraction * (second[i] - first[i])
        })
    };
    let mut hours = [0.0; N];
    let mut before = over(&nodes[0]);
    for node in &nodes[1..] {
        let now = over(node);
        for i in 0..N {
            let reach = (before[i].abs() + now[i].abs()).max(f32::MIN_POSITIVE);
            hours[i] += node.half_step_h + node.half_step_h * ((before[i] + now[i]) / reach);
        }
        before = now;
    }
    hours
}

/// The horizons at the sides of a batch's sectors.
struct HorizonWindow {
    horizons: Vec<Horizon>,
    spare: Vec<Vec<f32>>,
}

impl HorizonWindow {
    /// Sweeps the horizons of the next batch; its first is the last of the batch before.
    fn advance(
        &mut self,
        batch: &[Sector],
        azimuth_count: usize,
        heights: &Heights,
        reporter: &Reporter,
    ) -> Result<(), Cancelled> {
        let shared = self.horizons.pop();
        self.spare.extend(self.horizons.drain(..).map(Horizon::into_storage));
        self.horizons.extend(shared);
        for azimuth in batch[0].first + self.horizons.len()..=batch[0].first + batch.len() {
            reporter.check_cancelled()?;
            let storage = self.spare.pop().unwrap_or_default();
            let azimuth_rad = azimuth_rad(azimuth, azimuth_count);
            self.horizons.push(Horizon::sweep(heights, azimuth_rad, storage));
        }
        Ok(())
    }
}

/// The bands of a few rows of cells.
struct Block<'a> {
    first_row: usize,
    months_h: [&'a mut [f32]; MONTHS],
    /// Sky view; until [`Block::finish`] the sum of [`sky_towards`].
    sky: &'a mut [f32],
}

/// Cuts the bands into blocks of rows.
fn bands_by_block<'a>(
    elevation_m: &Grid<f32>,
    months_h: &'a mut [Vec<f32>; MONTHS],
    sky_view: &'a mut [f32],
) -> Vec<Block<'a>> {
    let block_cells = TILE_ROWS * elevation_m.frame().cols.max(1);
    let mut months = months_h.each_mut().map(|hours| hours.chunks_mut(block_cells));
    let blocks = sky_view.chunks_mut(block_cells).enumerate().map(|(block, sky)| Block {
        first_row: block * TILE_ROWS,
        months_h: months.each_mut().map(|chunks| chunks.next().unwrap_or_default()),
        sky,
    });
    blocks.collect()
}

/// Working memory of one task.
struct Scratch {
    gradients: Vec<Gradient>,
    /// The tile's horizon towards each of the batch's azimuths.
    horizons: Vec<[f32; TILE_CELLS]>,
    /// Lowest and highest of each.
    ranges: Vec<(f32, f32)>,
}

impl Scratch {
    fn new(cols: usize) -> Self {
        Self {
            gradients: vec![Gradient::default(); TILE_ROWS * cols],
            horizons: vec![[0.0; TILE_CELLS]; SECTORS_PER_BATCH + 1],
            ranges: Vec::with_capacity(SECTORS_PER_BATCH + 1),
        }
    }
}

impl Block<'_> {
    /// Adds what a batch of sectors gives.
    fn add(
        &mut self,
        elevation_m: &Grid<f32>,
        batch: &[Sector],
        horizons: &[Horizon],
        scratch: &mut Scratch,
    ) {
        let cols = elevation_m.frame().cols;
        let rows = self.sky.len() / cols;
        for (row, gradients) in scratch.gradients.chunks_exact_mut(cols).take(rows).enumerate() {
            gradient_row(elevation_m, self.first_row + row, gradients);
        }
        for first_col in (0..cols).step_by(TILE_COLS) {
            let tile = Tile { rows, first_col, width: TILE_COLS.min(cols - first_col), cols };
            scratch.ranges.clear();
            for (horizon, out) in horizons.iter().zip(&mut scratch.horizons) {
                let rows = self.first_row..self.first_row + rows;
                let cols = first_col..first_col + tile.width;
                scratch.ranges.push(horizon.copy_block(rows, cols, TILE_COLS, out));
            }
            for (index, sector) in batch.iter().enumerate() {
                let sides = [&scratch.horizons[index], &scratch.horizons[index + 1]];
                let ranges = [scratch.ranges[index], scratch.ranges[index + 1]];
                tile.add_sky(sector, sides[0], &scratch.gradients, self.sky);
                for crossing in &sector.crossings {
                    let hours = &mut *self.months_h[crossing.arc.month_index];
                    tile.add_sun(crossing, sides, ranges, hours);
                }
            }
        }
    }

    /// Turns sums into their final values.
    fn finish(&mut self, elevation_m: &Grid<f32>, azimuth_count: usize, scratch: &mut Scratch) {
        let cols = elevation_m.frame().cols;
        let gradients = &mut scratch.gradients[..cols];
        for (row, sky) in self.sky.chunks_exact_mut(cols).enumerate() {
            gradient_row(elevation_m, self.first_row + row, gradients);
            for (sky, gradient) in sky.iter_mut().zip(&*gradients) {
                *sky = sky_view_fraction(*sky, *gradient, azimuth_count);
            }
        }
        let mask = elevation_m.mask();
        if !mask.is_all_valid() {
            let valid = &mask.as_slice()[self.first_row * cols..][..self.sky.len()];
            let bands = self.months_h.iter_mut().map(|hours| &mut **hours);
            for band in bands.chain([&mut *self.sky]) {
                for (value, valid) in band.iter_mut().zip(valid) {
                    *value = if *valid { *value } else { 0.0 };
                }
            }
        }
    }
}

/// A tile of a block: where its cells lie in the block's bands.
struct Tile {
    rows: usize,
    first_col: usize,
    width: usize,
    cols: usize,
}

impl Tile {
    /// Where a row of the tile lies in the block's bands.
    fn row(&self, row: usize) -> std::ops::Range<usize> {
        let start = row * self.cols + self.first_col;
        start..start + self.width
    }

    /// Adds the sky above the horizon towards a sector's first azimuth.
    fn add_sky(
        &self,
        sector: &Sector,
        horizon: &[f32; TILE_CELLS],
        gradients: &[Gradient],
        sky: &mut [f32],
    ) {
        for (row, horizon) in horizon.chunks_exact(TILE_COLS).enumerate().take(self.rows) {
            let cells = sky[self.row(row)].iter_mut().zip(&gradients[self.row(row)]).zip(horizon);
            for ((sky, gradient), tan) in cells {
                let rise = gradient.to_east * sector.to_east + gradient.to_north * sector.to_north;
                *sky += sky_towards(*tan, rise);
            }
        }
    }

    /// Adds the hours of a crossing.
    fn add_sun(
        &self,
        crossing: &Crossing,
        sides: [&[f32; TILE_CELLS]; 2],
        ranges: [(f32, f32); 2],
        hours: &mut [f32],
    ) {
        let lowest = ranges[0].0.min(ranges[1].0);
        let highest = ranges[0].1.max(ranges[1].1);
        let alike_h = if highest <= crossing.lowest_tan {
            Some(crossing.all_light_h)
        } else if lowest >= crossing.highest_tan {
            Some(crossing.all_shade_h)
        } else {
            None
        };
        for row in 0..self.rows {
            let hours = &mut hours[self.row(row)];
            if let Some(alike_h) = alike_h {
                hours.iter_mut().for_each(|h| *h += alike_h);
                continue;
            }
            let [first, second] = sides.map(|side| &side[row * TILE_COLS..][..TILE_COLS]);
            let lanes = first.as_chunks::<LANES>().0.iter().zip(second.as_chunks::<LANES>().0);
            for (hours, (first, second)) in hours.chunks_mut(LANES).zip(lanes) {
                let lit_h = lit_h(&crossing.arc.nodes, first, second);
                hours.iter_mut().zip(lit_h).for_each(|(hours, lit_h)| *hours += lit_h);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;
    use std::sync::Arc;

    use super::*;
    use crate::abiotics::solar::{REPRESENTATIVE_DAY, day_length_h, declination_rad, sun_position};
    use crate::math::{atan2_f64, tan_f64};
    use crate::raster::{Cell, Frame, Mask};

    fn terrain(elevation_m: Grid<f32>, latitude_deg: f64) -> Terrain {
        let latitude_rad = latitude_deg.to_radians();
        Terrain { elevation_m, latitude_rad, grid_convergence_rad: 0.0 }
    }

    fn exposed(terrain: &Terrain) -> Exposure {
        exposure(terrain, 64, 0.25, &Reporter::silent()).expect("nobody cancels")
    }

    /// Hours of a month's day for which `sees` the direction (east, north, up) of a risen sun, second by second.
    fn hours_seen(
        latitude_rad: f64,
        month_index: usize,
        sees: impl Fn(f64, f64, f64) -> bool,
    ) -> f64 {
        let declination_rad = declination_rad(REPRESENTATIVE_DAY[month_index]);
        let seconds = (0..86_400).filter(|second| {
            let time_h = (f64::from(*second) + 0.5) / 3600.0;
            let sun = sun_position(latitude_rad, declination_rad, time_h);
            let (up, level) = (sin_f64(sun.elevation_rad), cos_f64(sun.elevation_rad));
            let east = level * sin_f64(sun.azimuth_rad);
            let north = level * cos_f64(sun.azimuth_rad);
            up > 0.0 && sees(east, north, up)
        });
        seconds.count() as f64 / 3600.0
    }

    #[test]
    fn open_level_ground_has_the_whole_day_and_the_whole_sky() {
        for latitude_deg in [0.0, 10.0, 42.5, 66.6, 80.0, -35.0] {
            let terrain = terrain(Grid::from_fn(5, 21, 1.0, |_| 812.3), latitude_deg);
            let exposure = exposed(&terrain);
            for (month_index, day) in REPRESENTATIVE_DAY.iter().enumerate() {
                let expected_h = day_length_h(terrain.latitude_rad, declination_rad(*day));
                for hours in exposure.direct_sun_h.month(month_index) {
                    let off_s = (f64::from(*hours) - expected_h).abs() * 3600.0;
                    assert!(off_s < 0.1, "{latitude_deg}°, month {month_index}: {off_s} s");
                }
            }
            for sky_view in exposure.sky_view.values() {
                assert!((sky_view - 1.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn a_slope_sees_the_sun_in_front_of_it_and_its_share_of_sky() {
        let middle = Cell { row: 20, col: 20 };
        for (slope_deg, facing_deg, latitude_deg, convergence_deg) in [
            (30.0, 0.0, 42.5, 0.0),
            (30.0, 180.0, 42.5, 0.0),
            (20.0, 90.0, 10.0, 0.0),
            (35.0, 225.0, -35.0, 0.0),
            (45.0, 290.0, 66.6, 0.0),
            (30.0, 60.0, 42.5, 25.0),
        ] {
            let (slope, facing) = (f64::to_radians(slope_deg), f64::to_radians(facing_deg));
            let fall_east = (tan_f64(slope) * sin_f64(facing)) as f32;
            let fall_north = (tan_f64(slope) * cos_f64(facing)) as f32;
            let plane = Grid::from_fn(41, 41, 1.0, |c| {
                fall_north * c.row as f32 - fall_east * c.col as f32
            });
            let mut terrain = terrain(plane, latitude_deg);
            terrain.grid_convergence_rad = f64::to_radians(convergence_deg);
            let exposure = exposed(&terrain);
            let true_facing = facing + terrain.grid_convergence_rad;
            let normal = [
                sin_f64(slope) * sin_f64(true_facing),
                sin_f64(slope) * cos_f64(true_facing),
                cos_f64(slope),
            ];
            let index = terrain.elevation_m.frame().index(middle);
            for month_index in 0..MONTHS {
                let expected_h =
                    hours_seen(terrain.latitude_rad, month_index, |east, north, up| {
                        normal[0] * east + normal[1] * north + normal[2] * up > 0.0
                    });
                let hours = f64::from(exposure.direct_sun_h.month(month_index)[index]);
                let off_min = (hours - expected_h).abs() * 60.0;
                assert!(
                    off_min < 2.0,
                    "{slope_deg}° facing {facing_deg}°, month {month_index}: {hours} h, not {expected_h} h"
                );
            }
            let sky_view = f64::from(exposure.sky_view[middle]);
            assert!(
                (sky_view - (1.0 + cos_f64(slope)) / 2.0).abs() < 1e-3,
                "{slope_deg}°: {sky_view}"
            );
        }
    }

    #[test]
    fn a_long_wall_hides_the_low_sun_and_part_of_the_sky() {
        // a cliff of 20 m, 40 m south of the northernmost row, 1000 m to either side;
        // half a cell of them moves a crossing by up to 2.5 minutes
        let cliff = Grid::from_fn(44, 2001, 1.0, |c| if c.row >= 40 { 20.0 } else { 0.0 });
        let terrain = terrain(cliff, 42.5);
        let exposure = exposed(&terrain);
        let cell = Cell { row: 0, col: 1000 };
        let index = terrain.elevation_m.frame().index(cell);
        for month_index in 0..MONTHS {
            let expected_h = hours_seen(terrain.latitude_rad, month_index, |_, north, up| {
                up / (-north).max(1e-9) > 20.0 / 40.0
            });
            let hours = f64::from(exposure.direct_sun_h.month(month_index)[index]);
            assert!(
                (hours - expected_h).abs() < 5.0 / 60.0,
                "month {month_index}: {hours}, {expected_h}"
            );
        }
        // December's noon sun stands 24° high, the cliff 26.6°
        assert!(exposure.direct_sun_h.month(11)[index] < 0.1);
        let wall_rad = atan2_f64(20.0, 40.0);
        let sky_view = f64::from(exposure.sky_view[cell]);
        assert!((sky_view - (1.0 + cos_f64(wall_rad)) / 2.0).abs() < 2e-3, "{sky_view}");
    }

    /// Hills of several sizes, about 100 m high.
    fn hills(cell: Cell) -> f32 {
        let (x, y) = (cell.col as f64, cell.row as f64);
        let wave = |a: f64, b: f64, phase: f64| sin_f64((a * x + b * y) * PI / 180.0 + phase);
        (60.0 * wave(2.1, 1.3, 0.2) + 25.0 * wave(-5.0, 6.1, 1.0) + 6.0 * wave(21.0, 17.0, 2.0))
            as f32
    }

    #[test]
    fn hours_lie_within_the_day() {
        let terrain = terrain(Grid::from_fn(90, 131, 2.0, hills), 47.0);
        let exposure = exposed(&terrain);
        for (month_index, day) in REPRESENTATIVE_DAY.iter().enumerate() {
            let day_h = day_length_h(terrain.latitude_rad, declination_rad(*day)) as f32;
            let hours = exposure.direct_sun_h.month(month_index);
            assert!(hours.iter().all(|h| (-1e-4..=day_h + 1e-4).contains(h)));
            assert!(hours.iter().any(|h| *h < 0.9 * day_h));
        }
        assert!(exposure.sky_view.values().iter().all(|v| (0.1..=1.0).contains(v)));
    }

    #[test]
    fn one_thread_and_many_give_the_same_bits() {
        let terrain = terrain(Grid::from_fn(77, 150, 2.0, hills), 47.0);
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.expect("threads start").install(|| exposed(&terrain))
        };
        let (one, many) = (on(1), on(4));
        for month_index in 0..MONTHS {
            assert_eq!(one.direct_sun_h.month(month_index), many.direct_sun_h.month(month_index));
        }
        assert_eq!(one.sky_view.values(), many.sky_view.values());
    }

    #[test]
    fn masked_cells_are_zero_and_cast_no_shade() {
        let frame = Arc::new(Frame::local(20, 30, 1.0));
        let in_void = |index: usize| (10..14).contains(&(index % 30));
        let valid = (0..frame.len()).map(|i| !in_void(i)).collect();
        let values = (0..frame.len()).map(|i| if in_void(i) { 500.0 } else { 3.0 }).collect();
        let grid = Grid::new(frame, Arc::new(Mask::new(valid)), values);
        let exposure = exposed(&terrain(grid, 42.5));
        let day_h = day_length_h(42.5_f64.to_radians(), declination_rad(REPRESENTATIVE_DAY[0]));
        for (index, hours) in exposure.direct_sun_h.month(0).iter().enumerate() {
            let expected_h = if in_void(index) { 0.0 } else { day_h as f32 };
            assert!((hours - expected_h).abs() < 1e-4);
            let expected = if in_void(index) { 0.0 } else { 1.0 };
            assert!((exposure.sky_view.values()[index] - expected).abs() < 1e-5);
        }
    }

    #[test]
    fn a_cancelled_run_stops() {
        let silence = Reporter::new(Box::new(Quiet), Arc::new(true.into()));
        let terrain = terrain(Grid::from_fn(4, 4, 1.0, |_| 0.0), 42.5);
        assert!(exposure(&terrain, 64, 0.25, &silence).is_err());
    }

    struct Quiet;
    impl crate::progress::Sink for Quiet {
        fn event(&self, _: &crate::progress::Event<'_>) {}
    }

    #[test]
    fn no_terrain_is_no_trouble() {
        for (rows, cols) in [(0, 0), (0, 5), (5, 0)] {
            let frame = Arc::new(Frame::local(rows, cols, 1.0));
            let grid = Grid::new(frame, Arc::new(Mask::all_valid(0)), Vec::new());
            assert!(exposed(&terrain(grid, 42.5)).sky_view.values().is_empty());
        }
    }
}
