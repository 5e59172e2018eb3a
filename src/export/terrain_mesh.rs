//! The ground as triangles: a grid of vertices at cell centres, thinned until it is light enough, and up to the map's edges.

use rayon::prelude::*;

use crate::raster::{Cell, Grid, MapWindow};

/// Most triangles of a terrain. chosen: 354 × 354 quads, which a browser shows at full rate; a square kilometre in steps of 3 m.
pub const MOST_TRIANGLES: usize = 250_000;

/// The ground as triangles, in metres east, north and up from an origin. They wind counter-clockwise seen from above.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TerrainMesh {
    /// Places of vertices.
    pub position_m: Vec<[f32; 3]>,
    /// Unit normals of vertices.
    pub normal: Vec<[f32; 3]>,
    /// Indices of three vertices each.
    pub triangles: Vec<[u32; 3]>,
}

/// Where vertices stand along one side of the grid.
struct Line {
    /// Row or column that a vertex has its height from.
    cell: Vec<usize>,
    /// Its coordinate on the map.
    at_m: Vec<f64>,
}

impl TerrainMesh {
    /// The ground of a grid of elevations, or of the cells that touch `window`, in at most `most_triangles`.
    ///
    /// Vertices stand at centres of cells, where the ground is as high as the grid says. The outer half of the outermost
    /// cells is level, as it is to whoever asks for heights between centres. Around masked cells there is a hole.
    pub fn new(
        elevation_m: &Grid<f32>,
        origin: [f64; 3],
        window: Option<&MapWindow>,
        most_triangles: usize,
    ) -> Self {
        let frame = elevation_m.frame();
        let transform = &frame.transform;
        let cell_m = transform.cell_m;
        // as: cuts below 0, and the grid's size is the upper end
        let span = |low: f64, high: f64, len: usize| {
            let first = (low.floor().max(0.0) as usize).min(len);
            first..(high.ceil().max(0.0) as usize).clamp(first, len)
        };
        let (rows, cols) = match window {
            None => (0..frame.rows, 0..frame.cols),
            Some(window) => {
                let down = |north: f64| (transform.north_m - north) / cell_m;
                let along = |east: f64| (east - transform.west_m) / cell_m;
                (
                    span(down(window.north), down(window.south), frame.rows),
                    span(along(window.west), along(window.east), frame.cols),
                )
            }
        };
        if rows.is_empty() || cols.is_empty() {
            return Self::default();
        }
        let line = |cells: &std::ops::Range<usize>, step: usize, start_m: f64, way_m: f64| {
            let (first, last) = (cells.start, cells.end - 1);
            let mut cell: Vec<usize> = (first..last).step_by(step).chain([last]).collect();
            let mut at_m: Vec<f64> =
                cell.iter().map(|cell| start_m + (*cell as f64 + 0.5) * way_m).collect();
            cell.insert(0, first);
            cell.push(last);
            at_m.insert(0, start_m + first as f64 * way_m);
            at_m.push(start_m + cells.end as f64 * way_m);
            Line { cell, at_m }
        };
        let count = |step: usize| {
            let quads = |cells: usize| (cells - 1).div_ceil(step) + 2;
            2 * quads(rows.len()) * quads(cols.len())
        };
        let longest = rows.len().max(cols.len());
        let step = (1..longest).find(|step| count(*step) <= most_triangles).unwrap_or(longest);
        let down = line(&rows, step, transform.north_m, -cell_m);
        let along = line(&cols, step, transform.west_m, cell_m);
        Self::between(elevation_m, &down, &along, origin)
    }

    /// Triangles between lines of vertices.
    fn between(elevation_m: &Grid<f32>, down: &Line, along: &Line, origin: [f64; 3]) -> Self {
        let width = along.cell.len();
        let height_m = |row: usize, col: usize| {
            let cell = Cell { row: down.cell[row], col: along.cell[col] };
            elevation_m.get(cell).map(|height| f64::from(*height))
        };
        // a vertex is kept if it is valid; its number is how many are kept before it
        let is_kept: Vec<bool> = (0..down.cell.len() * width)
            .map(|at| height_m(at / width, at % width).is_some())
            .collect();
        let mut number = Vec::with_capacity(is_kept.len());
        let mut kept = 0_u32;
        for is_kept in &is_kept {
            number.push(kept);
            kept += u32::from(*is_kept);
        }
        let position_m: Vec<[f32; 3]> = (0..is_kept.len())
            .into_par_iter()
            .filter_map(|at| {
                let (row, col) = (at / width, at % width);
                let place = [along.at_m[col], down.at_m[row], height_m(row, col)?];
                // metres from an origin within the scene: f32 holds millimetres
                Some(std::array::from_fn(|axis| (place[axis] - origin[axis]) as f32))
            })
            .collect();
        let valid = |corners: [usize; 3]| {
            let is_whole = corners.iter().all(|corner| is_kept[*corner]);
            is_whole.then(|| corners.map(|corner| number[corner]))
        };
        let rise = |a: usize, b: usize| {
            let height = |at: usize| height_m(at / width, at % width);
            height(a).zip(height(b)).map_or(f64::MAX, |(a, b)| (a - b).abs())
        };
        let triangles: Vec<[u32; 3]> = (0..down.cell.len() - 1)
            .into_par_iter()
            .flat_map_iter(|row| {
                let of_row = (row * width..row * width + width - 1).flat_map(|at| {
                    let [nw, ne, sw, se] = [at, at + 1, at + width, at + width + 1];
                    // along the diagonal that is less steep: ridges and valleys keep their line
                    let halves = if rise(nw, se) <= rise(ne, sw) {
                        [[nw, sw, se], [nw, se, ne]]
                    } else {
                        [[nw, sw, ne], [ne, sw, se]]
                    };
                    halves.into_iter().filter_map(valid)
                });
                of_row.collect::<Vec<_>>()
            })
            .collect();
        let normal = normals(&position_m, &triangles);
        Self { position_m, normal, triangles }
    }

    /// Least and greatest corner of a box around it, `None` if it is empty.
    pub fn bounds(&self) -> Option<[[f32; 3]; 2]> {
        let first = self.position_m.first()?;
        Some(self.position_m.iter().fold([*first; 2], |[low, high], place| {
            let axes = [0, 1, 2];
            [axes.map(|a| low[a].min(place[a])), axes.map(|a| high[a].max(place[a]))]
        }))
    }
}

/// Unit normals of vertices: the mean of the triangles around them, by area. Up where there are none.
fn normals(position_m: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let mut sums = vec![[0.0_f32; 3]; position_m.len()];
    for corners in triangles {
        let [a, b, c] = corners.map(|corner| position_m[corner as usize]);
        let side = |to: [f32; 3]| [to[0] - a[0], to[1] - a[1], to[2] - a[2]];
        let (u, v) = (side(b), side(c));
        let twice_area =
            [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        for corner in corners {
            let sum = &mut sums[*corner as usize];
            (0..3).for_each(|axis| sum[axis] += twice_area[axis]);
        }
    }
    let unit = |sum: &[f32; 3]| {
        let length = sum.iter().map(|part| part * part).sum::<f32>().sqrt();
        if length > 0.0 { sum.map(|part| part / length) } else { [0.0, 0.0, 1.0] }
    };
    sums.iter().map(unit).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::raster::{Frame, Mask};

    fn plane(rows: usize, cols: usize) -> Grid<f32> {
        Grid::from_fn(rows, cols, 2.0, |cell| 100.0 + cell.col as f32 - 0.5 * cell.row as f32)
    }

    fn area_m2(mesh: &TerrainMesh) -> f32 {
        let signed = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|corner| mesh.position_m[corner as usize]);
            0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))
        };
        assert!(mesh.triangles.iter().all(|corners| signed(corners) > 0.0), "counter-clockwise");
        mesh.triangles.iter().map(signed).sum()
    }

    #[test]
    fn it_covers_the_map_and_is_as_high_as_the_grid() {
        let grid = plane(30, 40);
        let mesh = TerrainMesh::new(&grid, [0.0, 0.0, 90.0], None, usize::MAX);
        assert_eq!(mesh.position_m.len(), 32 * 42);
        assert!((area_m2(&mesh) - 80.0 * 60.0).abs() < 0.1);
        // the plane rises 0.5 to the east and 0.25 to the north
        let at = |x: f32, y: f32| mesh.position_m.iter().find(|p| p[0] == x && p[1] == y).unwrap();
        assert_eq!(at(1.0, 59.0)[2], 10.0);
        assert_eq!(at(21.0, 49.0)[2], 10.0 + 10.0 - 2.5);
        assert_eq!(at(0.0, 60.0)[2], 10.0, "level beyond the outermost centres");
        let middle = mesh.position_m.iter().position(|p| p[0] == 21.0 && p[1] == 49.0).unwrap();
        let length = (1.0 + 0.25_f32 + 0.0625).sqrt();
        let expected = [-0.5 / length, -0.25 / length, 1.0 / length];
        assert!(mesh.normal[middle].iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5));
    }

    #[test]
    fn it_is_thinned_to_what_is_allowed_and_still_covers_the_map() {
        let grid = plane(300, 217);
        for most in [50, 4_000, 60_000] {
            let mesh = TerrainMesh::new(&grid, [0.0; 3], None, most);
            assert!(mesh.triangles.len() <= most && mesh.triangles.len() > most / 4);
            assert!((area_m2(&mesh) / (600.0 * 434.0) - 1.0).abs() < 1e-4);
            assert_eq!(mesh.bounds().unwrap()[1][..2], [434.0, 600.0]);
        }
    }

    #[test]
    fn a_window_takes_the_cells_that_it_touches() {
        let window = MapWindow { west: 9.0, south: -50.0, east: 13.0, north: 7.0 };
        let mesh = TerrainMesh::new(&plane(30, 40), [0.0; 3], Some(&window), usize::MAX);
        let [low, high] = mesh.bounds().unwrap();
        assert_eq!((low[0], high[0], low[1], high[1]), (8.0, 14.0, 0.0, 8.0));
        let outside = MapWindow { west: 900.0, south: 0.0, east: 901.0, north: 7.0 };
        let none = TerrainMesh::new(&plane(30, 40), [0.0; 3], Some(&outside), usize::MAX);
        assert_eq!(none, TerrainMesh::default());
    }

    #[test]
    fn masked_cells_are_holes_and_one_cell_is_a_square() {
        let valid = (0..100).map(|i| i != 55).collect();
        let frame = Arc::new(Frame::local(10, 10, 1.0));
        let grid = Grid::new(frame, Arc::new(Mask::new(valid)), vec![3.0; 100]);
        let mesh = TerrainMesh::new(&grid, [0.0; 3], None, usize::MAX);
        // each of the four quads around the cell's centre keeps the half that does not touch it
        assert!((area_m2(&mesh) - 98.0).abs() < 1e-3, "{}", area_m2(&mesh));
        let one = TerrainMesh::new(&plane(1, 1), [0.0; 3], None, usize::MAX);
        assert!((area_m2(&one) - 4.0).abs() < 1e-6);
    }
}
