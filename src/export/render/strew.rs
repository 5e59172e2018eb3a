//! What is strewn on the ground near the eye: blades of grass and fallen leaves, by the maps of the forest floor.

use super::camera::{Camera, NEAR_M};
use super::coverage::Window;
use super::noise;
use super::surface_buffer::{Corner, Ink, Surface, SurfaceBuffer};
use super::vector::{UP, Vec3, vec3};
use super::world::World;
use crate::math;

/// Width of a square of ground that is strewn at once.
const SQUARE_M: f32 = 1.0;
/// How far from the eye blades and leaves are drawn; the ground's colour goes on from there.
const REACH_M: f32 = 45.0;
/// Blades on a square metre of closed sward. chosen: fewer and wider than real ones, with the same look.
const BLADES_PER_M2: f32 = 420.0;
/// Fallen leaves on a square metre all covered.
const LEAVES_PER_M2: f32 = 420.0;

/// A square of ground within sight.
#[derive(Clone, Copy, Debug)]
pub struct Tuft {
    /// Its column, east of 0 by so many metres.
    pub col: i32,
    /// Its row, north of 0 by so many metres.
    pub row: i32,
    /// Depth of its middle, m.
    pub depth_m: f32,
    rect_px: [f32; 4],
}

/// Squares within a camera's sight, the nearest first.
pub fn visible(world: &World<'_>, camera: &Camera) -> Vec<Tuft> {
    if !camera.is_perspective() {
        return Vec::new();
    }
    let ground = &world.ground;
    let [far_east, far_south] = ground.far_edges_m();
    let reach = (REACH_M / SQUARE_M) as i32; // some tens
    let (east, north) = ((camera.eye.x / SQUARE_M).floor(), (camera.eye.y / SQUARE_M).floor());
    let mut tufts = Vec::new();
    for row in -reach..=reach {
        for col in -reach..=reach {
            let (col, row) = (east as i32 + col, north as i32 + row); // some thousands
            let x = (col as f32 + 0.5) * SQUARE_M;
            let y = (row as f32 + 0.5) * SQUARE_M;
            if x < ground.west_m || x > far_east || y > ground.north_m || y < far_south {
                continue;
            }
            let Some(z) = ground.height_m(x, y) else { continue };
            let middle = vec3(x, y, z);
            if (middle - camera.eye).length() > REACH_M {
                continue;
            }
            let Some(rect_px) = camera.bounds(middle, SQUARE_M * 1.3) else { continue };
            tufts.push(Tuft { col, row, depth_m: camera.view(middle).z, rect_px });
        }
    }
    tufts.sort_by(|a, b| a.depth_m.total_cmp(&b.depth_m));
    tufts
}

/// Draws the squares that touch a tile.
pub fn draw(buffer: &mut SurfaceBuffer, world: &World<'_>, camera: &Camera, tufts: &[Tuft]) {
    let window = buffer.window;
    buffer.survey();
    for tuft in tufts.iter().filter(|tuft| window.touches(tuft.rect_px)) {
        if buffer.hides(tuft.rect_px, 1.0 / (tuft.depth_m - 2.0 * SQUARE_M).max(0.2)) {
            continue;
        }
        let word = noise::hash2(tuft.col as u32, tuft.row as u32); // bits, not sizes
        let px_per_m = px_per_m(camera, tuft);
        grass(buffer, world, camera, tuft, word, px_per_m);
        litter(buffer, world, camera, tuft, word ^ 0x1234_5678, px_per_m);
    }
}

/// Pixels a metre has on a square.
pub fn px_per_m(camera: &Camera, tuft: &Tuft) -> f32 {
    camera.px_per_m(tuft.depth_m.max(1.0))
}

/// Width of blades where a metre has so many pixels: far ones are fewer and wider.
fn blade_width_m(px_per_m: f32) -> f32 {
    (1.3 / px_per_m).max(0.0055)
}

/// Length of fallen leaves likewise.
fn litter_length_m(px_per_m: f32) -> f32 {
    (2.0 / px_per_m).max(0.055)
}

/// Most blades and most fallen leaves on a square where a metre has so many pixels.
pub fn counts(px_per_m: f32) -> [u32; 2] {
    let share = (0.0055 / blade_width_m(px_per_m)).min(1.0);
    let blades = BLADES_PER_M2 * SQUARE_M * SQUARE_M * share;
    let length_m = litter_length_m(px_per_m);
    let share = (0.055 / length_m) * (0.055 / length_m);
    // small leaves are in the ground's colour
    let leaves = if length_m > 0.2 { 0.0 } else { LEAVES_PER_M2 * SQUARE_M * SQUARE_M * share };
    [blades as u32, leaves as u32] // some hundreds
}

/// A place on a square.
fn place(world: &World<'_>, tuft: &Tuft, [u, v]: [f32; 2]) -> Option<Vec3> {
    let x = (tuft.col as f32 + u) * SQUARE_M;
    let y = (tuft.row as f32 + v) * SQUARE_M;
    world.ground.height_m(x, y).map(|z| vec3(x, y, z))
}

/// Whether what stands at a place and reaches as far as that is in another tile.
fn is_outside(camera: &Camera, window: Window, place: Vec3, reach_m: f32) -> bool {
    let v = camera.view(place);
    if v.z < 0.3 {
        return true;
    }
    let p = camera.project_view(v);
    let reach_px = reach_m * camera.px_per_m(v.z) * 1.2 + 2.0;
    !window.touches([p.x - reach_px, p.y - reach_px, p.x + reach_px, p.y + 0.5 * reach_px])
}

fn corner(camera: &Camera, place: Vec3, normal: Vec3) -> Corner {
    Corner { view: camera.view(place), normal }
}

fn grass(
    buffer: &mut SurfaceBuffer,
    world: &World<'_>,
    camera: &Camera,
    tuft: &Tuft,
    word: u32,
    px_per_m: f32,
) {
    let Some(field) = &world.ground.grass_m else { return };
    let window = buffer.window;
    let width_m = blade_width_m(px_per_m);
    let [count, _] = counts(px_per_m);
    for k in 0..count {
        let [u, v, s, t] = noise::four(noise::hash2(word, k));
        let Some(root) = place(world, tuft, [u, v]) else { continue };
        if is_outside(camera, window, root, 0.7) {
            continue;
        }
        let sward_m = field.at(root.x, root.y);
        // grass grows in tufts
        let clump = noise::smooth_level(root.x / 0.55, root.y / 0.55, 31);
        let chance = (sward_m / 0.14).min(1.0) * math::smoothstep((clump - 0.22) * 2.2);
        if s > chance {
            continue;
        }
        let height_m = (sward_m * (0.55 + 0.75 * t) * (0.6 + 0.8 * clump)).clamp(0.02, 0.7);
        if height_m * px_per_m < 1.5 {
            continue;
        }
        let angle = noise::unit(noise::hash2(word ^ 0x77, k)) * std::f32::consts::TAU;
        let lean = vec3(math::cos(angle), math::sin(angle), 0.0);
        let side = camera.right * (0.5 * width_m);
        let bend = 0.25 + 0.5 * (s / chance.max(1e-3));
        let middle = root + UP * (0.6 * height_m) + lean * (0.18 * bend * height_m);
        let tip = root + UP * (height_m * (1.0 - 0.25 * bend)) + lean * (0.62 * bend * height_m);
        let normal = (lean * -0.6 + UP).normalize_or(UP);
        let variation = (noise::unit(noise::hash2(word ^ 0x99, k)) * 255.0) as u8; // below 256
        let ink = Ink { item: 0, surface: Surface::Grass, variation, openness: 150 };
        let low = [root - side, root + side, middle + side * 0.8, middle - side * 0.8]
            .map(|p| corner(camera, p, normal));
        if low.iter().any(|c| c.view.z < NEAR_M * 3.0) {
            continue;
        }
        let tip = corner(camera, tip, normal);
        buffer.triangle(camera, [low[0], low[1], low[2]], ink, |_, _, _| true);
        buffer.triangle(camera, [low[0], low[2], low[3]], ink, |_, _, _| true);
        let ink = Ink { openness: 245, ..ink };
        buffer.triangle(camera, [low[3], low[2], tip], ink, |_, _, _| true);
    }
}

fn litter(
    buffer: &mut SurfaceBuffer,
    world: &World<'_>,
    camera: &Camera,
    tuft: &Tuft,
    word: u32,
    px_per_m: f32,
) {
    let Some(field) = &world.ground.litterfall else { return };
    let window = buffer.window;
    let length_m = litter_length_m(px_per_m);
    let [_, count] = counts(px_per_m);
    for k in 0..count {
        let [u, v, s, t] = noise::four(noise::hash2(word, k));
        let Some(middle) = place(world, tuft, [u, v]) else { continue };
        if is_outside(camera, window, middle, length_m) {
            continue;
        }
        if s > field.at(middle.x, middle.y) * 1.25 {
            continue;
        }
        let random = noise::direction(noise::hash2(word ^ 0x51, k));
        let normal = (random * 0.45 + UP).normalize_or(UP);
        let angle = t * std::f32::consts::TAU;
        let long = vec3(math::cos(angle), math::sin(angle), 0.0);
        let wide = normal.cross(long).normalize_or(UP);
        let long = wide.cross(normal) * (0.5 * length_m);
        let wide = wide * (0.26 * length_m);
        let middle = middle + UP * (0.012 + 0.02 * s);
        let word = noise::hash2(word ^ 0x99, k);
        let [a, b, _, _] = noise::four(word);
        // below 256
        let ink = Ink {
            item: 0,
            surface: Surface::Litter,
            variation: (a * 255.0) as u8,
            openness: (120.0 + 130.0 * b) as u8,
        };
        let points = [middle - long, middle + wide, middle + long, middle - wide]
            .map(|p| corner(camera, p, normal));
        if points.iter().any(|c| c.view.z < NEAR_M * 3.0) {
            continue;
        }
        buffer.triangle(camera, [points[0], points[1], points[2]], ink, |_, _, _| true);
        buffer.triangle(camera, [points[0], points[2], points[3]], ink, |_, _, _| true);
    }
}
