//! The terrain as triangles: patches of cells, coarser far off, and walls where it ends.

use super::camera::Camera;
use super::coverage::Window;
use super::ground::Ground;
use super::surface_buffer::{Corner, Ink, Surface, SurfaceBuffer};
use super::vector::{Vec3, vec3};

/// Cells a patch is wide. chosen: some hundred patches a km².
pub const PATCH_CELLS: usize = 32;
/// Pixels that a triangle's side is at least wide, where cells are finer. chosen: no facet shows.
const LEAST_SIDE_PX: f32 = 2.5;
/// How far walls reach below the lowest ground, in widths of the terrain. chosen: a slab, not a pillar.
const WALL_DEPTH: f32 = 0.022;

/// A square of terrain.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    /// Its first row of corners.
    pub row: usize,
    /// Its first column of corners.
    pub col: usize,
    /// Cells a side of its triangles.
    pub step: usize,
    /// The rectangle that it may touch.
    pub rect_px: [f32; 4],
    depth_m: f32,
}

/// The lower end of walls.
pub fn base_m(ground: &Ground) -> f32 {
    ground.range_m[0] - WALL_DEPTH * ground.width_m().max(ground.depth_m()) - 2.0
}

/// Patches within a camera's sight, the nearest first.
pub fn visible(ground: &Ground, camera: &Camera) -> Vec<Patch> {
    let mut patches = Vec::new();
    for row in (0..ground.rows - 1).step_by(PATCH_CELLS) {
        for col in (0..ground.cols - 1).step_by(PATCH_CELLS) {
            let (last_row, last_col) = (
                (row + PATCH_CELLS).min(ground.rows - 1),
                (col + PATCH_CELLS).min(ground.cols - 1),
            );
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for r in row..=last_row {
                for c in col..=last_col {
                    let z = ground.corner(r, c).z;
                    (low, high) = (low.min(z), high.max(z)); // NaN is passed over
                }
            }
            if low > high {
                continue;
            }
            let [a, b] = [ground.corner(row, col), ground.corner(last_row, last_col)];
            let middle = vec3(0.5 * (a.x + b.x), 0.5 * (a.y + b.y), 0.5 * (low + high));
            let half = vec3(0.5 * (b.x - a.x), 0.5 * (b.y - a.y), 0.5 * (high - low));
            let is_rim =
                row == 0 || col == 0 || last_row == ground.rows - 1 || last_col == ground.cols - 1;
            let reach_m = half.length() + if is_rim { low - base_m(ground) } else { 0.0 };
            let Some(rect_px) = camera.bounds(middle, reach_m) else { continue };
            let depth_m = camera.view(middle).z;
            let side_px = ground.cell_m * camera.px_per_m(depth_m - half.length());
            let mut step = 1;
            while step < 8 && side_px * (step as f32) < LEAST_SIDE_PX {
                step *= 2;
            }
            patches.push(Patch { row, col, step, rect_px, depth_m });
        }
    }
    patches.sort_by(|a, b| a.depth_m.total_cmp(&b.depth_m));
    patches
}

/// Draws the patches that touch a tile.
pub fn draw(
    buffer: &mut SurfaceBuffer,
    camera: &Camera,
    ground: &Ground,
    patches: &[Patch],
    has_walls: bool,
) {
    let window = buffer.window;
    for patch in patches.iter().filter(|patch| window.touches(patch.rect_px)) {
        draw_patch(buffer, camera, ground, patch, window, has_walls);
    }
}

/// Rows or columns of corners that a patch has, its last one included.
fn stops(first: usize, end: usize, step: usize) -> Vec<usize> {
    let last = (first + PATCH_CELLS).min(end);
    let mut stops: Vec<usize> = (first..last).step_by(step).collect();
    stops.push(last);
    stops
}

fn draw_patch(
    buffer: &mut SurfaceBuffer,
    camera: &Camera,
    ground: &Ground,
    patch: &Patch,
    window: Window,
    has_walls: bool,
) {
    let rows = stops(patch.row, ground.rows - 1, patch.step);
    let cols = stops(patch.col, ground.cols - 1, patch.step);
    let ink = Ink { item: 0, surface: Surface::Ground, variation: 128, openness: 255 };
    let corner = |place: Vec3| Corner { view: camera.view(place), normal: super::vector::UP };
    let mut triangle = |a: Vec3, b: Vec3, c: Vec3, ink: Ink| {
        if a.z.is_finite() && b.z.is_finite() && c.z.is_finite() {
            buffer.triangle(camera, [corner(a), corner(b), corner(c)], ink, |_, _, _| true);
        }
    };
    let mut north: Vec<Vec3> = cols.iter().map(|c| ground.corner(rows[0], *c)).collect();
    for row in &rows[1..] {
        let south: Vec<Vec3> = cols.iter().map(|c| ground.corner(*row, *c)).collect();
        for i in 1..cols.len() {
            let [a, b, c, d] = [north[i - 1], north[i], south[i], south[i - 1]];
            // most cells of a patch are in other tiles
            let is_seen = !camera.is_perspective()
                || [a, b, c, d].iter().all(|p| camera.project(*p).is_none())
                || touches(camera, window, [a, b, c, d]);
            if is_seen {
                triangle(a, d, c, ink);
                triangle(a, c, b, ink);
            }
        }
        north = south;
    }
    // what hides gaps between patches of different steps, or the terrain's end
    let base = base_m(ground);
    let ends = [
        (rows[0], true, patch.row == 0, vec3(0.0, 1.0, 0.0)),
        (rows[rows.len() - 1], true, rows[rows.len() - 1] == ground.rows - 1, vec3(0.0, -1.0, 0.0)),
        (cols[0], false, patch.col == 0, vec3(-1.0, 0.0, 0.0)),
        (cols[cols.len() - 1], false, cols[cols.len() - 1] == ground.cols - 1, vec3(1.0, 0.0, 0.0)),
    ];
    for (line, is_row, is_rim, outward) in ends {
        let stops = if is_row { &cols } else { &rows };
        let place = |stop: usize| {
            if is_row { ground.corner(line, stop) } else { ground.corner(stop, line) }
        };
        let is_wall = is_rim && has_walls;
        for pair in stops.windows(2) {
            let (a, b) = (place(pair[0]), place(pair[1]));
            let lower = |p: Vec3| {
                let drop_m = if is_wall { p.z - base } else { patch.step as f32 * ground.cell_m };
                vec3(p.x, p.y, p.z - drop_m)
            };
            let ink = if is_wall { Ink { surface: Surface::Wall, ..ink } } else { ink };
            let mut side = |a: Vec3, b: Vec3, c: Vec3| {
                if a.z.is_finite() && b.z.is_finite() && c.z.is_finite() {
                    let corner = |place: Vec3| Corner { view: camera.view(place), normal: outward };
                    let corners = [corner(a), corner(b), corner(c)];
                    buffer.triangle(camera, corners, ink, |_, _, _| true);
                }
            };
            side(a, b, lower(b));
            side(a, lower(b), lower(a));
        }
    }
}

/// Whether a square of ground may touch a tile; those across the near plane may.
fn touches(camera: &Camera, window: Window, corners: [Vec3; 4]) -> bool {
    let mut rect = [f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY];
    for place in corners {
        let Some(p) = camera.project(place) else { return true };
        rect = [rect[0].min(p.x), rect[1].min(p.y), rect[2].max(p.x), rect[3].max(p.y)];
    }
    window.touches(rect)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Grid;

    #[test]
    fn ground_fills_a_picture_from_above_without_a_hole() {
        let grid = Grid::from_fn(100, 100, 1.0, |c| (c.row as f32 * 0.3).rem_euclid(7.0));
        let ground = Ground::new(&grid, [0.0; 3]);
        let down = -std::f32::consts::FRAC_PI_2;
        for scale in [0.9, 0.3] {
            let size = [64.0, 64.0];
            let eye = vec3(50.0, 50.0, 90.0);
            let camera = Camera::orthographic(eye, 0.0, down, scale, size);
            let window = Window { left: 0, top: 0, right: 64, bottom: 64 };
            let mut buffer = SurfaceBuffer::new(window);
            draw(&mut buffer, &camera, &ground, &visible(&ground, &camera), false);
            let seen = buffer.samples.iter().filter(|s| s.surface == Surface::Ground).count();
            let expected = (100.0 * scale).min(64.0) * (100.0 * scale).min(64.0);
            assert!((seen as f32 - expected).abs() <= 64.0, "{seen} of {expected}");
        }
    }
}
