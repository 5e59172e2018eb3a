//! Ground points to a surface: Delaunay triangles, linear in each, sampled at cell centres.
//!
//! Triangles whose circumscribed circle is wider than the largest gap are left out. A circle of a
//! Delaunay triangle is empty of points, so what stays masked is just what an empty disk of that width
//! reaches. It also makes tiles exact: every triangle kept lies, with its circle, within one gap of any
//! cell it covers, so a tile triangulated with a margin of one gap has exactly the triangles of the whole.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;
use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};

use super::Error;
use super::ground::GroundPoint;
use crate::progress::Reporter;
use crate::raster::{Frame, Grid, Mask};

/// Cells across a tile. chosen: 9 to 16 tiles a km² at 1 m, half as large again with a margin of 40 m.
const TILE_CELLS: i64 = 400;
/// How far outside a triangle, as a share of its height, a centre still counts as on its edge.
const EDGE: f64 = 1e-9;

/// The surface through ground points (in row-major order of their cells).
pub(super) fn interpolate(
    points: &[GroundPoint],
    frame: &Arc<Frame>,
    max_gap_m: f64,
    reporter: &Reporter,
) -> Result<Grid<f32>, Error> {
    interpolate_tiled(points, frame, max_gap_m, TILE_CELLS, reporter)
}

fn interpolate_tiled(
    points: &[GroundPoint],
    frame: &Arc<Frame>,
    max_gap_m: f64,
    tile_cells: i64,
    reporter: &Reporter,
) -> Result<Grid<f32>, Error> {
    let tiles = tiles(frame, tile_cells);
    let stage = reporter.stage("ground surface", tiles.len() as u64);
    let row_starts = row_starts(points, frame);
    let filled: Vec<Result<Vec<Option<f32>>, Error>> = tiles
        .par_iter()
        .map(|tile| {
            reporter.check_cancelled()?;
            let margin = (max_gap_m / frame.transform.cell_m).ceil() as usize + 1;
            let near = within(points, &row_starts, frame, tile.widened(margin, frame));
            let heights = fill(near, tile, frame, max_gap_m);
            stage.advance(1);
            Ok(heights)
        })
        .collect();

    let mut values = vec![0.0; frame.len()];
    let mut valid = vec![false; frame.len()];
    for (tile, heights) in tiles.iter().zip(filled) {
        let heights = heights?;
        for (row, line) in tile.rows.clone().zip(heights.chunks_exact(tile.cols.len())) {
            for (col, height) in tile.cols.clone().zip(line) {
                if let Some(height) = height {
                    values[row * frame.cols + col] = *height;
                    valid[row * frame.cols + col] = true;
                }
            }
        }
    }
    Ok(Grid::new(Arc::clone(frame), Arc::new(Mask::new(valid)), values))
}

/// A rectangle of cells.
#[derive(Clone, Debug)]
struct Tile {
    rows: Range<usize>,
    cols: Range<usize>,
}

impl Tile {
    fn widened(&self, cells: usize, frame: &Frame) -> Self {
        Self {
            rows: self.rows.start.saturating_sub(cells)..(self.rows.end + cells).min(frame.rows),
            cols: self.cols.start.saturating_sub(cells)..(self.cols.end + cells).min(frame.cols),
        }
    }
}

/// Tiles that cover the frame, cut at multiples of the tile in map coordinates.
fn tiles(frame: &Frame, tile_cells: i64) -> Vec<Tile> {
    let t = &frame.transform;
    let cuts = |edge_m: f64, cells: usize| {
        let first = (edge_m / t.cell_m).round() as i64; // the edge, in whole cells from the map's origin
        let mut cuts = vec![0];
        let mut next = (tile_cells - first.rem_euclid(tile_cells)) as usize;
        while next < cells {
            cuts.push(next);
            next += tile_cells as usize;
        }
        cuts.push(cells);
        cuts
    };
    let rows = cuts(-t.north_m, frame.rows);
    let cols = cuts(t.west_m, frame.cols);
    rows.windows(2)
        .flat_map(|r| cols.windows(2).map(|c| Tile { rows: r[0]..r[1], cols: c[0]..c[1] }))
        .collect()
}

fn row_of(point: &GroundPoint, frame: &Frame) -> usize {
    ((point.south_m / frame.transform.cell_m) as usize).min(frame.rows - 1)
}

fn col_of(point: &GroundPoint, frame: &Frame) -> usize {
    ((point.east_m / frame.transform.cell_m) as usize).min(frame.cols - 1)
}

/// Where each row's points begin.
fn row_starts(points: &[GroundPoint], frame: &Frame) -> Vec<usize> {
    (0..=frame.rows).map(|row| points.partition_point(|p| row_of(p, frame) < row)).collect()
}

/// The points in a rectangle.
fn within(points: &[GroundPoint], row_starts: &[usize], frame: &Frame, tile: Tile) -> Vec<Vertex> {
    tile.rows
        .flat_map(|row| {
            let line = &points[row_starts[row]..row_starts[row + 1]];
            let first = line.partition_point(|p| col_of(p, frame) < tile.cols.start);
            let end = line.partition_point(|p| col_of(p, frame) < tile.cols.end);
            line[first..end].iter().map(|p| Vertex(*p))
        })
        .collect()
}

struct Vertex(GroundPoint);

impl HasPosition for Vertex {
    type Scalar = f64;
    fn position(&self) -> Point2<f64> {
        Point2::new(self.0.east_m, self.0.south_m)
    }
}

/// Heights at the centres of a tile's cells from the points in and around it.
fn fill(points: Vec<Vertex>, tile: &Tile, frame: &Frame, max_gap_m: f64) -> Vec<Option<f32>> {
    let mut heights = vec![None; tile.rows.len() * tile.cols.len()];
    // it refuses NaN and absurdly large or small coordinates: the frame has none
    let Ok(triangulation) = DelaunayTriangulation::<Vertex>::bulk_load(points) else {
        return heights;
    };
    for face in triangulation.inner_faces() {
        let corners = face.vertices().map(|v| v.data().0);
        sample(corners, tile, frame, max_gap_m, &mut heights);
    }
    heights
}

/// Sets the cells whose centres a triangle covers.
fn sample(
    [a, b, c]: [GroundPoint; 3],
    tile: &Tile,
    frame: &Frame,
    max_gap_m: f64,
    heights: &mut [Option<f32>],
) {
    let cell = frame.transform.cell_m;
    let (abe, abs) = (b.east_m - a.east_m, b.south_m - a.south_m);
    let (ace, acs) = (c.east_m - a.east_m, c.south_m - a.south_m);
    let double_area = abe * acs - abs * ace;

    // the circumscribed circle's diameter is the product of the sides over twice the area
    let (bce, bcs) = (c.east_m - b.east_m, c.south_m - b.south_m);
    let sides = (abe * abe + abs * abs) * (ace * ace + acs * acs) * (bce * bce + bcs * bcs);
    if sides > (max_gap_m * double_area) * (max_gap_m * double_area) || double_area == 0.0 {
        return;
    }

    // cells whose centres, at half cells, lie between the corners; `as` makes negative numbers 0
    let span = |low: f64, high: f64, cells: &Range<usize>| {
        let first = (low / cell - 0.5 - EDGE).ceil() as usize;
        let end = ((high / cell + 0.5 + EDGE).floor()) as usize;
        first.max(cells.start)..end.min(cells.end)
    };
    let extremes = |of: fn(&GroundPoint) -> f64| {
        let (p, q, r) = (of(&a), of(&b), of(&c));
        (p.min(q).min(r), p.max(q).max(r))
    };
    let (west, east) = extremes(|p| p.east_m);
    let (north, south) = extremes(|p| p.south_m);
    for row in span(north, south, &tile.rows) {
        let ps = (row as f64 + 0.5) * cell - a.south_m;
        for col in span(west, east, &tile.cols) {
            let pe = (col as f64 + 0.5) * cell - a.east_m;
            let to_b = (pe * acs - ps * ace) / double_area;
            let to_c = (ps * abe - pe * abs) / double_area;
            if to_b >= -EDGE && to_c >= -EDGE && to_b + to_c <= 1.0 + EDGE {
                let z = a.z_m + to_b * (b.z_m - a.z_m) + to_c * (c.z_m - a.z_m);
                let at = (row - tile.rows.start) * tile.cols.len() + (col - tile.cols.start);
                heights[at] = Some(z as f32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math;
    use crate::raster::Cell;
    use crate::rng::{self, Key, Process};

    /// Points strewn one a cell, in row-major order, where `there`.
    fn strewn(
        frame: &Frame,
        there: impl Fn(f64, f64) -> bool,
        height: impl Fn(f64, f64) -> f64,
    ) -> Vec<GroundPoint> {
        (0..frame.len())
            .filter_map(|index| {
                let (seed, process, entity) = (5, Process::StrewnPoints, index as u64);
                let draws = rng::uniforms(Key { seed, process, year: 0, month: 0, entity });
                let cell = frame.cell(index);
                let at = |cells: usize, share: f32| {
                    (cells as f64 + f64::from(share)) * frame.transform.cell_m
                };
                let (east_m, south_m) = (at(cell.col, draws[0]), at(cell.row, draws[1]));
                let z_m = height(east_m, south_m);
                there(east_m, south_m).then_some(GroundPoint { east_m, south_m, z_m })
            })
            .collect()
    }

    fn surface(points: &[GroundPoint], frame: Frame, max_gap_m: f64, tile_cells: i64) -> Grid<f32> {
        interpolate_tiled(points, &Arc::new(frame), max_gap_m, tile_cells, &Reporter::silent())
            .unwrap()
    }

    #[test]
    fn a_plane_is_met_exactly() {
        let plane = |e: f64, s: f64| 100.0 + 0.3 * e - 0.7 * s;
        let frame = Frame::local(40, 60, 0.5);
        let points = strewn(&frame, |_, _| true, plane);
        let grid = surface(&points, frame, 10.0, TILE_CELLS);
        assert!(grid.mask().valid_count() > 38 * 58, "{}", grid.mask().valid_count());
        for row in 0..40 {
            for col in 0..60 {
                let Some(z) = grid.get(Cell { row, col }) else { continue };
                let expected = plane(0.25 + 0.5 * col as f64, 0.25 + 0.5 * row as f64);
                assert!((f64::from(*z) - expected).abs() < 1e-4, "{row} {col}: {z}");
            }
        }
    }

    #[test]
    fn a_paraboloid_is_met_within_the_bound_of_linear_interpolation() {
        let bowl = |e: f64, s: f64| ((e - 30.0).powi(2) + (s - 30.0).powi(2)) / 200.0;
        let frame = Frame::local(60, 60, 1.0);
        let points = strewn(&frame, |_, _| true, bowl);
        let grid = surface(&points, frame, 6.0, TILE_CELLS);
        let mut worst = 0.0_f64;
        for index in (0..grid.frame().len()).filter(|i| grid.mask().is_valid(*i)) {
            let cell = grid.frame().cell(index);
            let expected = bowl(cell.col as f64 + 0.5, cell.row as f64 + 0.5);
            let above = f64::from(grid.values()[index]) - expected;
            assert!(above > -1e-5, "chords of a bowl lie above it");
            worst = worst.max(above);
        }
        // above the chord by at most radius² / 200, radius ≤ 3 m
        assert!(worst < 9.0 / 200.0 && worst > 1e-3, "{worst}");
    }

    #[test]
    fn tiles_have_the_triangles_of_the_whole() {
        let rough = |e: f64, s: f64| 3.0 * math::sin_f64(e) + 2.0 * math::cos_f64(1.3 * s);
        // a lake, a strip without points, thin stands: circles of all sizes
        let there = |e: f64, s: f64| {
            let lake = (e - 70.0).hypot(s - 60.0) < 17.0;
            let thin = e > 100.0 && (e * 7.3 + s * 3.1).rem_euclid(1.0) > 0.15;
            !(lake || thin || (100.0..107.0).contains(&s))
        };
        let mut frame = Frame::local(150, 170, 1.0);
        frame.transform.west_m = 400_013.0; // tiles do not begin where the frame does
        let points = strewn(&frame, there, rough);
        let whole = surface(&points, frame.clone(), 20.0, 100_000);
        assert!(whole.mask().valid_count() < frame.len() - 500, "the lake is masked");
        for tile_cells in [16, 33, 64] {
            let tiled = surface(&points, frame.clone(), 20.0, tile_cells);
            assert_eq!(tiled.mask(), whole.mask());
            assert_eq!(tiled.values(), whole.values(), "tiles of {tile_cells}");
        }
    }

    #[test]
    fn gaps_are_bridged_up_to_the_given_width() {
        let frame = Frame::local(60, 80, 1.0);
        let points = strewn(&frame, |e, _| !(35.0..45.0).contains(&e), |_, _| 5.0);
        let middle = Cell { row: 30, col: 40 };
        assert_eq!(surface(&points, frame.clone(), 9.0, TILE_CELLS).get(middle), None);
        assert_eq!(surface(&points, frame, 16.0, TILE_CELLS).get(middle), Some(&5.0));
    }

    #[test]
    fn outside_the_points_nothing_is_known() {
        let frame = Frame::local(30, 30, 1.0);
        let points = strewn(&frame, |e, s| e + s < 30.0, |_, _| 5.0);
        let grid = surface(&points, frame.clone(), 100.0, TILE_CELLS);
        assert_eq!(grid.get(Cell { row: 20, col: 20 }), None);
        assert_eq!(grid.get(Cell { row: 10, col: 10 }), Some(&5.0));
        assert_eq!(surface(&[], frame, 100.0, TILE_CELLS).mask().valid_count(), 0);
    }
}
