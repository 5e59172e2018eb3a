//! Height of the terrain's horizon, for every cell, one azimuth at a time.
//!
//! Parallel lines sweep the grid against the azimuth. Each keeps the upper convex hull of the ground it
//! has passed; the tangent from the next point to that hull is the point's horizon. A point enters the hull
//! once and leaves it at most once, so a cell costs the same on any grid size and at any horizon distance.
//!
//! A line follows its azimuth exactly: it advances one column at a time (one row for azimuths nearer to
//! north and south, which run on a transposed copy) and reads heights interpolated between the two
//! cells it passes. It *owns* the nearer of the two and stores its result for it. Lines that leave the grid
//! come back in on the other side as new lines, so (line, column) and cells correspond one to one. A cell's
//! horizon is interpolated at its centre between the line that owns it and the one beyond the centre: taken from the
//! owner alone, it would show where lines change rows.
//!
//! # Reference
//! Timonen & Westerholm 2010, "Scalable height field self-shadowing", Computer Graphics Forum 29(2),
//! doi:10.1111/j.1467-8659.2009.01642.x.
//! # Departures
//! The earth is flat here and light straight: over the few kilometres of a tile both bend a horizon by less than
//! 0.0005 rad. Ground outside the grid is unknown and hides nothing.

use std::f64::consts::TAU;
use std::ops::Range;

use rayon::prelude::*;

use crate::math::{cos_f64, sin_f64};
use crate::raster::Grid;

/// Lines that one task sweeps. chosen: some 10⁵ cells at 4096 columns, far above the cost of handing out a task.
const LINES_PER_TASK: usize = 16;
/// Side of the blocks in which rasters are transposed. chosen: two blocks of 32² f32 fit the smallest L1 cache.
const TRANSPOSE_BLOCK: usize = 32;

/// Elevations as the sweeps read them: relative to the lowest cell (for f32's sake), NaN where masked, rimmed by
/// a NaN row on either side; once row by row, once column by column.
pub(crate) struct Heights {
    by_row: Raster,
    by_col: Raster,
    cell_m: f64,
}

/// Lines of heights with one NaN line before the first and one after the last.
struct Raster {
    lines: usize,
    length: usize,
    stride: usize,
    height_m: Vec<f32>,
}

/// Values from the start of a line to the start of the next. Never a power of two: cells above each other would
/// share one set of the cache and drive each other out.
fn line_stride(length: usize) -> usize {
    const CACHE_LINE: usize = 16; // f32 in 64 bytes
    length.next_multiple_of(CACHE_LINE) + CACHE_LINE
}

impl Heights {
    /// Heights of a terrain.
    pub(crate) fn new(elevation_m: &Grid<f32>) -> Self {
        let frame = elevation_m.frame();
        let (rows, cols) = (frame.rows, frame.cols);
        let base_m = elevation_m.range().map_or(0.0, |(lowest_m, _)| lowest_m);
        let mut by_row = Raster::unknown(rows, cols);
        let valid = elevation_m.mask().as_slice();
        let stride = by_row.stride;
        let inner = by_row.height_m[stride..].par_chunks_mut(stride).take(rows).enumerate();
        inner.for_each(|(row, heights_m)| {
            let source = elevation_m.row(row).iter().zip(&valid[row * cols..]);
            for (height_m, (z, valid)) in heights_m.iter_mut().zip(source) {
                *height_m = if *valid { z - base_m } else { f32::NAN };
            }
        });
        let by_col = by_row.transposed();
        Self { by_row, by_col, cell_m: frame.transform.cell_m }
    }
}

impl Raster {
    fn unknown(lines: usize, length: usize) -> Self {
        let stride = line_stride(length);
        Self { lines, length, stride, height_m: vec![f32::NAN; (lines + 2) * stride] }
    }

    fn transposed(&self) -> Self {
        let mut out = Self::unknown(self.length, self.lines);
        let stride = out.stride;
        let inner = &mut out.height_m[stride..][..self.length * stride];
        inner.par_chunks_mut(TRANSPOSE_BLOCK * stride).enumerate().for_each(|(block, out)| {
            let (first, width) = (block * TRANSPOSE_BLOCK, out.len() / stride);
            for line in 0..self.lines {
                let source = &self.height_m[(line + 1) * self.stride + first..][..width];
                for (offset, height_m) in source.iter().enumerate() {
                    out[offset * stride + line] = *height_m;
                }
            }
        });
        out
    }
}

/// How the lines of one azimuth run over a raster: line `k` passes, at step `i` along the raster's lines,
/// nearest to the cell in raster line `k + own_shift[i]`, and owns it.
struct Shear {
    /// Whether the lines run along columns of the grid rather than rows.
    by_col: bool,
    /// Whether one looks towards higher step numbers.
    forward: bool,
    /// From a step to the next, in metres.
    step_m: f64,
    /// Raster lines from `k` to the owned cell.
    own_shift: Vec<i32>,
    /// Place between the two cells passed, 0 at the first, 1 at the second.
    fraction: Vec<f32>,
}

impl Shear {
    fn new(heights: &Heights, grid_azimuth_rad: f64) -> Self {
        let (to_east, to_south) = (sin_f64(grid_azimuth_rad), -cos_f64(grid_azimuth_rad));
        let by_col = to_south.abs() > to_east.abs();
        let (raster, along, across) = if by_col {
            (&heights.by_col, to_south, to_east)
        } else {
            (&heights.by_row, to_east, to_south)
        };
        let gradient = across / along;
        // a line that meets cell centres but for the last digits of sin and cos meets them exactly
        let exact = |steps: usize| (steps as f64 * gradient * 1e9).round() / 1e9;
        let passed = |step: usize| {
            let (first, fraction) =
                (exact(step).floor(), (exact(step) - exact(step).floor()) as f32);
            // offsets are smaller than the grid's side
            (first as i32 + i32::from(Self::owns_second(fraction)), fraction)
        };
        let (own_shift, fraction) = (0..raster.length).map(passed).unzip();
        let step_m = heights.cell_m * (1.0 + gradient * gradient).sqrt();
        Self { by_col, forward: along > 0.0, step_m, own_shift, fraction }
    }

    /// Whether the owned cell is the second of the two passed at a step.
    #[inline]
    fn owns_second(fraction: f32) -> bool {
        fraction >= 0.5
    }
}

/// A point of a line's hull.
#[derive(Clone, Copy, Default)]
struct HullPoint {
    /// Step number; exact in f32 up to 16 million.
    step: f32,
    height_m: f32,
    /// Rise per step from here to the hull's next point outward.
    rise_m: f32,
}

/// The horizon towards one azimuth, stored by line.
pub(crate) struct Horizon {
    by_col: bool,
    lines: usize,
    stride: usize,
    /// By step of the lines, where to look the cells' centres up.
    lookups: Vec<Lookup>,
    /// Tangent of the horizon's elevation along the lines; NaN where the owned cell is masked.
    tan_elevation: Vec<f32>,
}

/// Where the centres of the cells at one step of the lines lie: between the line that owns the cell and another.
#[derive(Clone, Copy)]
struct Lookup {
    /// The line that owns the cell in the raster's first line.
    first_owner: usize,
    /// Share of the other line, in 0..=1/2.
    other_fraction: f32,
    /// Whether the other is the line before rather than after.
    other_is_before: bool,
}

impl Horizon {
    /// The horizon towards a grid azimuth (clockwise from the grid's north), written into `storage`.
    pub(crate) fn sweep(heights: &Heights, grid_azimuth_rad: f64, storage: Vec<f32>) -> Self {
        let shear = Shear::new(heights, grid_azimuth_rad);
        let raster = if shear.by_col { &heights.by_col } else { &heights.by_row };
        let mut tan_elevation = storage;
        tan_elevation.resize(raster.lines * raster.stride, 0.0);
        tan_elevation.par_chunks_mut(raster.stride * LINES_PER_TASK).enumerate().for_each_init(
            || vec![HullPoint::default(); raster.length],
            |hull, (task, lines)| {
                for (offset, line) in lines.chunks_exact_mut(raster.stride).enumerate() {
                    sweep_line(raster, &shear, task * LINES_PER_TASK + offset, line, hull);
                }
            },
        );
        let lookup = |(own_shift, fraction): (&i32, &f32)| Lookup {
            // in 0..lines; a grid without cells looks nothing up
            first_owner: i64::from(-own_shift).rem_euclid(raster.lines.max(1) as i64) as usize,
            other_fraction: fraction.min(1.0 - fraction),
            other_is_before: !Shear::owns_second(*fraction),
        };
        let lookups = shear.own_shift.iter().zip(&shear.fraction).map(lookup).collect();
        let (by_col, lines, stride) = (shear.by_col, raster.lines, raster.stride);
        Self { by_col, lines, stride, lookups, tan_elevation }
    }

    /// The storage, for the next sweep.
    pub(crate) fn into_storage(self) -> Vec<f32> {
        self.tan_elevation
    }

    /// Copies the horizon of a block of cells, row by row with `stride` values a row; gives the lowest and highest.
    pub(crate) fn copy_block(
        &self,
        rows: Range<usize>,
        cols: Range<usize>,
        stride: usize,
        out: &mut [f32],
    ) -> (f32, f32) {
        for (out, row) in out.chunks_mut(stride).zip(rows.clone()) {
            if self.by_col {
                for (value, col) in out.iter_mut().zip(cols.clone()) {
                    *value = self.at(col, row);
                }
            } else {
                for (value, col) in out.iter_mut().zip(cols.clone()) {
                    *value = self.at(row, col);
                }
            }
        }
        let copied = out.chunks(stride).take(rows.len()).flat_map(|row| &row[..cols.len()]);
        copied.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), tan| {
            (low.min(*tan), high.max(*tan))
        })
    }

    /// The horizon at a cell's centre, 0 where masked: its line passes up to half a cell beside it,
    /// so the nearest line on the other side has a say too.
    #[inline]
    fn at(&self, raster_line: usize, step: usize) -> f32 {
        let lookup = self.lookups[step];
        let own = self.on_line_of(raster_line, step, lookup.first_owner);
        let other_line = if lookup.other_is_before {
            raster_line.saturating_sub(1)
        } else {
            (raster_line + 1).min(self.lines - 1)
        };
        let other = self.on_line_of(other_line, step, lookup.first_owner);
        let tan = own + lookup.other_fraction * (other - own);
        // beside the unknown there is no other line
        if !tan.is_nan() {
            tan
        } else if !own.is_nan() {
            own
        } else {
            0.0
        }
    }

    /// The horizon along the line that owns a cell.
    #[inline]
    fn on_line_of(&self, raster_line: usize, step: usize, first_owner: usize) -> f32 {
        let line = raster_line + first_owner;
        let line = if line < self.lines { line } else { line - self.lines };
        self.tan_elevation[line * self.stride + step]
    }
}

/// Horizon along line `k`.
fn sweep_line(raster: &Raster, shear: &Shear, k: usize, out: &mut [f32], hull: &mut [HullPoint]) {
    let lines = raster.lines as i64;
    let mut start = 0;
    // each piece of the line between two wraps around the grid is a line of its own
    while start < raster.length {
        let wraps = (k as i64 + i64::from(shear.own_shift[start])).div_euclid(lines);
        let same = |shift: &i32| (k as i64 + i64::from(*shift)).div_euclid(lines) == wraps;
        let end = start + shear.own_shift[start..].partition_point(same);
        let first_line = k as i64 - wraps * lines;
        // heights first, in a loop that the hull's unforeseeable branches do not hold up
        for (height_m, step) in out[start..end].iter_mut().zip(start..) {
            *height_m = raster.profile_m(shear, first_line, step);
        }
        if shear.forward {
            sweep_piece((start..end).rev(), shear.step_m, out, hull);
        } else {
            sweep_piece(start..end, shear.step_m, out, hull);
        }
        start = end;
    }
}

/// Turns the heights of a piece of line into its horizon, steps given from the far end on; NaN stays NaN.
#[inline]
fn sweep_piece(
    steps: impl Iterator<Item = usize>,
    step_m: f64,
    line: &mut [f32],
    hull: &mut [HullPoint],
) {
    let steps_per_m = (1.0 / step_m) as f32; // cells are 0.1–100 m
    let mut hull_len = 0;
    for step in steps {
        let height_m = line[step];
        if height_m.is_nan() {
            continue;
        }
        let place = step as f32;
        let mut rise_m = f32::NEG_INFINITY;
        while hull_len > 0 {
            let nearest = hull[hull_len - 1];
            rise_m = (nearest.height_m - height_m) / (nearest.step - place).abs();
            if rise_m > nearest.rise_m {
                break;
            }
            hull_len -= 1;
        }
        line[step] = if rise_m.is_finite() { rise_m * steps_per_m } else { 0.0 };
        hull[hull_len] = HullPoint { step: place, height_m, rise_m };
        hull_len += 1;
    }
}

impl Raster {
    /// Height where a line passes at a step; NaN if the cell it owns there is unknown.
    #[inline]
    fn profile_m(&self, shear: &Shear, first_line: i64, step: usize) -> f32 {
        let fraction = shear.fraction[step];
        let own_line = (first_line + i64::from(shear.own_shift[step])) as usize; // within the grid
        let first = (own_line + 1 - usize::from(Shear::owns_second(fraction))) * self.stride + step;
        let (a, b) = (self.height_m[first], self.height_m[first + self.stride]);
        let height_m = a + fraction * (b - a);
        if height_m.is_nan() { self.rim_profile_m(first, fraction) } else { height_m }
    }

    /// The same beside the unknown: the owned cell's height, continued at the gradient from the cell behind it;
    /// `first` is the first of the two cells passed.
    #[cold]
    fn rim_profile_m(&self, first: usize, fraction: f32) -> f32 {
        let (own, behind, away) = if Shear::owns_second(fraction) {
            (first + self.stride, first + 2 * self.stride, 1.0 - fraction)
        } else {
            (first, first.wrapping_sub(self.stride), fraction)
        };
        let own_m = self.height_m[own];
        if own_m.is_nan() {
            return f32::NAN;
        }
        let behind_m = self.height_m[behind];
        if behind_m.is_nan() { own_m } else { own_m + away * (own_m - behind_m) }
    }
}

/// Tangent of the horizon's elevation towards a grid azimuth (clockwise from the grid's north); negative where all
/// ground ahead lies below the cell, 0 where there is none.
pub fn horizon_tan(elevation_m: &Grid<f32>, grid_azimuth_rad: f64) -> Grid<f32> {
    let frame = elevation_m.frame();
    let horizon =
        Horizon::sweep(&Heights::new(elevation_m), grid_azimuth_rad.rem_euclid(TAU), Vec::new());
    let mut values = vec![0.0; frame.len()];
    if !values.is_empty() {
        horizon.copy_block(0..frame.rows, 0..frame.cols, frame.cols, &mut values);
    }
    elevation_m.with_values(values)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::raster::{Cell, Frame, Mask};

    /// Rough ground without pattern, 0–20 m.
    fn rough(cell: Cell) -> f32 {
        let hash = (cell.row * 7919 + cell.col * 104_729) as u32;
        let hash = (hash ^ (hash >> 7)).wrapping_mul(0x9E37_79B9) >> 20;
        hash as f32 / 4096.0 * 20.0
    }

    /// The horizon by looking at every step of the lines on either side of a cell's centre.
    fn marched_tan(elevation_m: &Grid<f32>, azimuth_rad: f64, cell: Cell) -> f64 {
        let frame = elevation_m.frame();
        let (east, south) = (sin_f64(azimuth_rad), -cos_f64(azimuth_rad));
        let by_col = south.abs() > east.abs();
        let (along, gradient) = if by_col { (south, east / south) } else { (east, south / east) };
        let (step, line, steps, lines) = if by_col {
            (cell.row, cell.col, frame.rows, frame.cols)
        } else {
            (cell.col, cell.row, frame.cols, frame.rows)
        };
        let z = |step: usize, at: f64| -> f64 {
            let height = |line: usize| {
                let (row, col) = if by_col { (step, line) } else { (line, step) };
                f64::from(elevation_m[Cell { row, col }])
            };
            // up to half a cell outside, the two cells at the rim continue
            let first = (at.floor().max(0.0) as usize).min(lines - 2);
            height(first) + (at - first as f64) * (height(first + 1) - height(first))
        };
        let shift = |step: usize| (step as f64 * gradient * 1e9).round() / 1e9;
        let ahead = if along > 0.0 { step + 1..steps } else { 0..step };
        let step_m = f64::from(frame.cell_m()) * (1.0 + gradient * gradient).sqrt();
        let on_line = |offset: f64| {
            let at = |other: usize| offset + shift(other) - shift(step);
            let inside = |other: &usize| (-0.5..lines as f64 - 0.5).contains(&at(*other));
            // beyond its first step outside, a line is another line
            let steps = ahead.clone();
            let reached: Vec<usize> = if along > 0.0 {
                steps.take_while(inside).collect()
            } else {
                steps.rev().take_while(inside).collect()
            };
            let rise = |other: usize| {
                let distance_m = other.abs_diff(step) as f64 * step_m;
                (z(other, at(other)) - z(step, offset)) / distance_m
            };
            reached.into_iter().map(rise).reduce(f64::max).unwrap_or(0.0)
        };
        let beside = shift(step) - (shift(step) + 0.5).floor();
        let own = on_line(line as f64 + beside);
        let other = line as f64 + beside - if beside < 0.0 { -1.0 } else { 1.0 };
        if (-0.5..lines as f64 - 0.5).contains(&other) {
            own + beside.abs() * (on_line(other) - own)
        } else {
            own
        }
    }

    #[test]
    fn sweep_agrees_with_marching_along_every_line() {
        for (rows, cols) in [(37, 53), (61, 24), (16, 16)] {
            let elevation_m = Grid::from_fn(rows, cols, 2.0, rough);
            for degrees in (0..360).step_by(15).chain([7, 44, 46, 133, 200, 317]) {
                let azimuth_rad = f64::from(degrees).to_radians();
                let swept = horizon_tan(&elevation_m, azimuth_rad);
                for index in 0..rows * cols {
                    let cell = elevation_m.frame().cell(index);
                    let marched = marched_tan(&elevation_m, azimuth_rad, cell);
                    let off = (f64::from(swept[cell]) - marched).abs();
                    assert!(off < 1e-4 * (1.0 + marched.abs()), "{degrees}° at {cell:?}: {off}");
                }
            }
        }
    }

    #[test]
    fn a_plane_rises_by_its_own_slope() {
        let plane = Grid::from_fn(31, 31, 1.0, |c| 0.4 * c.col as f32 - 0.7 * c.row as f32);
        for degrees in (0..360).step_by(5) {
            let azimuth_rad = f64::from(degrees).to_radians();
            let rise = 0.4 * sin_f64(azimuth_rad) + 0.7 * cos_f64(azimuth_rad);
            let tan = horizon_tan(&plane, azimuth_rad)[Cell { row: 15, col: 15 }];
            assert!((f64::from(tan) - rise).abs() < 1e-4, "{degrees}°: {tan}, {rise}");
        }
    }

    #[test]
    fn a_wall_is_seen_from_every_distance() {
        let wall = Grid::from_fn(8, 200, 2.0, |c| if c.col >= 150 { 30.0 } else { 0.0 });
        let tan = horizon_tan(&wall, 90_f64.to_radians());
        for col in 0..150 {
            let expected = 30.0 / (2.0 * (150 - col) as f32);
            assert!((tan[Cell { row: 4, col }] / expected - 1.0).abs() < 1e-6);
        }
        assert_eq!(tan[Cell { row: 4, col: 160 }], 0.0);
        let back = horizon_tan(&wall, 270_f64.to_radians());
        assert_eq!(back[Cell { row: 4, col: 199 }], 0.0);
        assert!((back[Cell { row: 4, col: 150 }] + 30.0 / 300.0).abs() < 1e-6);
    }

    #[test]
    fn unknown_ground_hides_nothing_and_breaks_no_line() {
        let frame = Arc::new(Frame::local(9, 40, 1.0));
        let height = |index: usize| match index % 40 {
            10 => 1000.0, // masked: whatever stands there is not ground
            30 => 20.0,
            _ => 0.0,
        };
        let valid = (0..frame.len()).map(|i| i % 40 != 10).collect();
        let values = (0..frame.len()).map(height).collect();
        let grid = Grid::new(frame, Arc::new(Mask::new(valid)), values);
        let tan = horizon_tan(&grid, 90_f64.to_radians());
        assert!((tan[Cell { row: 4, col: 0 }] - 20.0 / 30.0).abs() < 1e-6);
        assert_eq!(tan[Cell { row: 4, col: 10 }], 0.0);
        // lines at a slant pass between the unknown and its neighbours
        for degrees in (0..360).step_by(7) {
            let tan = horizon_tan(&grid, f64::from(degrees).to_radians());
            assert!(tan.values().iter().all(|tan| (-20.0..=20.0).contains(tan)), "{degrees}°");
        }
    }

    #[test]
    fn thin_grids_are_fine() {
        for (rows, cols) in [(1, 1), (1, 9), (9, 1), (2, 50)] {
            let grid = Grid::from_fn(rows, cols, 1.0, rough);
            for degrees in (0..360).step_by(11) {
                let tan = horizon_tan(&grid, f64::from(degrees).to_radians());
                assert!(tan.values().iter().all(|tan| tan.is_finite()));
            }
        }
    }
}
