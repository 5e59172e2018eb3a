//! Ground points to a surface: Delaunay triangles, linear in each, sampled at cell centres.
//!
//! Triangles whose circumscribed circle is wider than the largest gap are left out. A circle of a
//! Delaunay triangle is empty of points, so what stays masked is just what an empty disk of that width
//! reaches. It also makes tiles exact: every triangle kept lies, with its circle, within one gap of any
//! cell it covers, so a tile triangulated with a margin of one gap has exactly the triangles of the whole.

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
    frame: &std::sync::Arc<Frame>,
    max_gap_m: f64,
    reporter: &Reporter,
) -> Result<Grid<f32>, Error> {
    let tiles = tiles(frame);
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
    Ok(Grid::new(std::sync::Arc::clone(frame), std::sync::Arc::new(Mask::new(valid)), values))
}

/// A rectangle of cells.
#[derive(Clone, Debug)]
struct Tile {
    rows: std::ops::Range<usize>,
    cols: std::ops::Range<usize>,
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
fn tiles(frame: &Frame) -> Vec<Tile> {
    let t = &frame.transform;
    let cuts = |edge_m: f64, cells: usize| {
        let first = (edge_m / t.cell_m).round() as i64; // the edge, in whole cells from the map's origin
        let mut cuts = vec![0];
        let mut next = (TILE_CELLS - first.rem_euclid(TILE_CELLS)) as usize;
        while next < cells {
            cuts.push(next);
            next += TILE_CELLS as usize;
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
fn within(
    points: &[GroundPoint],
    row_starts: &[usize],
    frame: &Frame,
    tile: Tile,
) -> Vec<Vertex> {
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

    // cells whose centres, at half cells, lie between the corners
    let span = |low: f64, high: f64, cells: &std::ops::Range<usize>| {
        let first = (low / cell - 0.5 - EDGE).ceil().max(cells.start as f64) as usize;
        let last = (high / cell - 0.5 + EDGE).floor().min(cells.end as f64 - 1.0);
        if last < 0.0 { 1..=0 } else { first..=last as usize }
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
