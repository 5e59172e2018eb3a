//! Rasters brought to a picture's size: averaged where cells are smaller than pixels, smoothly drawn out where larger.

use std::sync::Arc;

use rayon::prelude::*;

use crate::raster::{Frame, GeoTransform, Grid, MapWindow, Mask};

/// Pixels whose cells are masked by more than this share are void.
const LEAST_VALID_FRACTION: f32 = 0.5;

/// The cells one row or column of pixels draws on.
struct Taps {
    first: usize,
    weights: Vec<f32>,
    /// Whether the pixel's middle lies on the grid.
    is_inside: bool,
}

/// Where along one axis of a grid a picture's pixels lie, counted in cells from the grid's edge.
#[derive(Clone, Copy)]
struct Extent {
    from: f64,
    span: f64,
}

/// A raster in `rows` × `cols` pixels over the same ground.
/// Downwards a tent filter as wide as needed to see every cell; upwards a cubic B-spline, which shades without creases.
/// Masked cells do not count; a pixel is valid where half of what it sees is.
pub fn fit(grid: &Grid<f32>, rows: usize, cols: usize) -> Grid<f32> {
    let frame = grid.frame();
    let whole = |cells: usize| Extent { from: 0.0, span: cells as f64 };
    fit_extent(grid, [whole(frame.rows), whole(frame.cols)], rows, cols)
}

/// Like [`fit`], over a rectangle of the map, which may reach beyond the raster: pixels there are void.
pub fn fit_window(grid: &Grid<f32>, window: &MapWindow, rows: usize, cols: usize) -> Grid<f32> {
    let frame = grid.frame();
    let t = frame.transform;
    let down = Extent {
        from: (t.north_m - window.north) / t.cell_m,
        span: (window.north - window.south) / t.cell_m,
    };
    let across = Extent {
        from: (window.west - t.west_m) / t.cell_m,
        span: (window.east - window.west) / t.cell_m,
    };
    fit_extent(grid, [down, across], rows, cols)
}

fn fit_extent(grid: &Grid<f32>, extents: [Extent; 2], rows: usize, cols: usize) -> Grid<f32> {
    let frame = grid.frame();
    assert!(rows > 0 && cols > 0 && !frame.is_empty(), "nothing to draw or nowhere to draw it");
    let [down, across] = extents;
    let row_taps: Vec<Taps> = (0..rows).map(|r| taps(r, frame.rows, down, rows)).collect();
    let col_taps: Vec<Taps> = (0..cols).map(|c| taps(c, frame.cols, across, cols)).collect();
    let mask = grid.mask().as_slice();
    let all_valid = grid.mask().is_all_valid();
    // the columns of cells that any pixel sees
    let first_col = col_taps.iter().map(|t| t.first).min().unwrap_or(0);
    let end_col = col_taps.iter().map(|t| t.first + t.weights.len()).max().unwrap_or(0);
    let seen_cols = end_col - first_col;

    let mut values = vec![0.0_f32; rows * cols];
    let mut valid = vec![true; rows * cols];
    values.par_chunks_mut(cols).zip(valid.par_chunks_mut(cols)).zip(&row_taps).for_each_init(
        || (vec![0.0_f32; seen_cols], vec![0.0_f32; seen_cols]),
        |(sums, seen), ((values, valid), taps)| {
            sums.fill(0.0);
            seen.fill(if all_valid { 1.0 } else { 0.0 });
            for (row, weight) in (taps.first..).zip(&taps.weights) {
                let line = &grid.row(row)[first_col..end_col];
                if all_valid {
                    sums.iter_mut().zip(line).for_each(|(s, z)| *s += weight * z);
                } else {
                    let flags = &mask[row * frame.cols..][first_col..end_col];
                    for (((s, n), z), &is_valid) in
                        sums.iter_mut().zip(&mut *seen).zip(line).zip(flags)
                    {
                        if is_valid {
                            *s += weight * z;
                            *n += weight;
                        }
                    }
                }
            }
            let is_row_inside = taps.is_inside;
            for ((value, valid), taps) in values.iter_mut().zip(valid).zip(&col_taps) {
                let (mut sum, mut total) = (0.0, 0.0);
                for (col, weight) in (taps.first - first_col..).zip(&taps.weights) {
                    sum += weight * sums[col];
                    total += weight * seen[col];
                }
                *valid = total >= LEAST_VALID_FRACTION && is_row_inside && taps.is_inside;
                *value = if total > 1e-6 { sum / total } else { 0.0 };
            }
        },
    );
    let t = frame.transform;
    // pixels are square on sheets; where a strip is one pixel thick its shading does not show
    let transform = GeoTransform {
        west_m: t.west_m + across.from * t.cell_m,
        north_m: t.north_m - down.from * t.cell_m,
        cell_m: t.cell_m * across.span / cols as f64,
    };
    let fitted = Frame { rows, cols, transform, crs: frame.crs.clone() };
    Grid::new(Arc::new(fitted), Arc::new(Mask::new(valid)), values)
}

fn taps(pixel: usize, cells: usize, extent: Extent, pixels: usize) -> Taps {
    let ratio = extent.span / pixels as f64;
    // the pixel's centre, counted in cell centres
    let center = extent.from + (pixel as f64 + 0.5) * ratio - 0.5;
    let is_inside = (-0.5..=cells as f64 - 0.5).contains(&center);
    let radius = if ratio >= 1.0 { ratio } else { 2.0 };
    let last = cells as i64 - 1;
    let (from, to) = ((center - radius).ceil() as i64, (center + radius).floor() as i64);
    // cells beyond the edge need their mirrors inside
    let first = from.min(2 * last - to).clamp(0, last);
    let end = to.max(-from).clamp(0, last);
    let kernel = |d: f64| {
        if ratio >= 1.0 { (1.0 - d.abs() / ratio).max(0.0) } else { cubic_b_spline(d.abs()) }
    };
    // a sampled tent pulls to one side, by another amount in each pixel, and slopes would show a weave: balance it
    let moment = |power: i32| -> f64 {
        let offsets = (from..=to).map(|cell| cell as f64 - center);
        offsets.map(|d| kernel(d) * d.powi(power)).sum()
    };
    let lean = moment(1) / moment(2).max(1e-12);
    let mut weights = vec![0.0_f64; (end - first + 1) as usize]; // end ≥ first
    for cell in from..=to {
        let d = cell as f64 - center;
        let weight = kernel(d) * (1.0 - lean * d);
        // beyond the edge the slope goes on: as far above the edge's cell as its mirror lies below
        let edge = cell.clamp(0, last);
        let mirror = (2 * edge - cell).clamp(0, last);
        weights[(edge - first) as usize] += weight;
        if mirror != edge {
            weights[(edge - first) as usize] += weight;
            weights[(mirror - first) as usize] -= weight;
        }
    }
    let total: f64 = weights.iter().sum();
    let weights = weights.iter().map(|w| (w / total) as f32).collect();
    Taps { first: first as usize, weights, is_inside }
}

fn cubic_b_spline(d: f64) -> f64 {
    if d < 1.0 {
        2.0 / 3.0 - d * d + d * d * d / 2.0
    } else {
        let rest = (2.0 - d).max(0.0);
        rest * rest * rest / 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_stays_and_a_plane_keeps_its_tilt() {
        for (rows, cols) in [(7, 11), (40, 66), (300, 280)] {
            let level = fit(&Grid::from_fn(40, 66, 3.0, |_| 12.5), rows, cols);
            assert!(level.values().iter().all(|v| (v - 12.5).abs() < 1e-4));
        }
        let plane = Grid::from_fn(64, 64, 2.0, |c| 3.0 * c.col as f32);
        for size in [16, 56, 160] {
            let fitted = fit(&plane, size, size);
            let (a, b) = (fitted.values()[size / 4], fitted.values()[3 * size / 4]);
            // half the width: 32 cells of 3 m
            assert!((b - a - 96.0).abs() < 1e-2, "{size}: {a} {b}");
            let step = 192.0 / size as f32;
            let even = fitted.row(0).windows(2).all(|w| (w[1] - w[0] - step).abs() < 2e-3);
            assert!(even, "the tilt reaches the edges: {:?}", fitted.row(0));
            assert!((fitted.frame().transform.cell_m * size as f64 - 128.0).abs() < 1e-9);
        }
    }

    #[test]
    fn masked_cells_do_not_bleed() {
        let frame = Arc::new(Frame::local(20, 20, 1.0));
        let valid: Vec<bool> = (0..400).map(|i| i % 20 < 10).collect();
        let values = (0..400).map(|i| if i % 20 < 10 { 5.0 } else { 9999.0 }).collect();
        let grid = Grid::new(frame, Arc::new(Mask::new(valid)), values);
        for size in [8, 57] {
            let fitted = fit(&grid, size, size);
            assert!(fitted.valid_values().all(|v| (v - 5.0).abs() < 1e-4));
            let share = fitted.mask().valid_count() as f64 / (size * size) as f64;
            assert!((share - 0.5).abs() < 0.07, "{share}");
        }
    }
    #[test]
    fn a_window_shows_the_part_it_is_of_and_what_lies_beyond_is_void() {
        let plane = Grid::from_fn(50, 50, 2.0, |c| 10.0 * c.row as f32 + c.col as f32);
        let window = MapWindow { west: 20.0, south: 30.0, east: 40.0, north: 50.0 };
        let part = fit_window(&plane, &window, 100, 100);
        // a pixel of 0.2 m whose middle lies 20.1 m east and 50.1 m south of the corner
        let expected = 10.0 * (50.1 / 2.0 - 0.5) + 20.1 / 2.0 - 0.5;
        assert!((part.values()[0] - expected).abs() < 1e-3, "{} {expected}", part.values()[0]);
        assert!(part.mask().is_all_valid());
        let t = part.frame().transform;
        assert_eq!((t.west_m, t.north_m, t.cell_m), (20.0, 50.0, 0.2));
        let beyond = MapWindow { west: -10.0, south: 80.0, east: 10.0, north: 100.0 };
        let part = fit_window(&plane, &beyond, 40, 40);
        assert_eq!(part.mask().valid_count(), 800, "the western half is void");
        let far = MapWindow { west: 900.0, south: 80.0, east: 920.0, north: 100.0 };
        assert_eq!(fit_window(&plane, &far, 40, 40).mask().valid_count(), 0);
    }
}
