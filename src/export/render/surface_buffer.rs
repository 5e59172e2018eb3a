//! What each pixel of a tile shows: how near it is, which way it faces, and whose surface it is.

use super::camera::{Camera, NEAR_M, Projected};
use super::coverage::{Window, cover};
use super::vector::Vec3;
use crate::tree::mesh::Material;

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Surface {
    /// Nothing but sky.
    Sky,
    /// The terrain.
    Ground,
    /// Where the terrain ends: the side of the block it is cut from.
    Wall,
    /// A blade of grass.
    Grass,
    /// A fallen leaf or twig.
    Litter,
    /// A part of an instance.
    Part(Material),
}

/// A pixel of a tile.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Larger is nearer, see [`Projected`]; −∞ where there is only sky.
    pub nearness: f32,
    /// Which way the surface faces.
    pub normal: Vec3,
    /// The item it belongs to, if it is a part of one; else a word of noise.
    pub item: u32,
    /// Whose surface it is.
    pub surface: Surface,
    /// Brightness and hue deviate by this from part to part, 0–255.
    pub variation: u8,
    /// Share of the light that comes as deep as this into a crown or tuft, 0–255.
    pub openness: u8,
}

impl Sample {
    /// Nothing.
    pub const EMPTY: Self = Self {
        nearness: f32::NEG_INFINITY,
        normal: Vec3 { x: 0.0, y: 0.0, z: 1.0 },
        item: 0,
        surface: Surface::Sky,
        variation: 128,
        openness: 255,
    };
}

/// What is drawn: all of a triangle's pixels alike but for place and normal.
#[derive(Clone, Copy, Debug)]
pub struct Ink {
    /// See [`Sample::item`].
    pub item: u32,
    /// See [`Sample::surface`].
    pub surface: Surface,
    /// See [`Sample::variation`].
    pub variation: u8,
    /// See [`Sample::openness`].
    pub openness: u8,
}

/// Side of the blocks that are known to be hidden or not, in pixels.
const BLOCK_PX: usize = 8;

/// The pixels of a tile.
pub struct SurfaceBuffer {
    /// Where they lie.
    pub window: Window,
    /// Row by row.
    pub samples: Vec<Sample>,
    /// Nearness of the farthest pixel of each block, as of the last survey.
    farthest: Vec<f32>,
}

/// A corner in view metres, with its normal.
#[derive(Clone, Copy, Debug)]
pub struct Corner {
    /// See [`Camera::view`].
    pub view: Vec3,
    /// In the world.
    pub normal: Vec3,
}

impl SurfaceBuffer {
    /// An empty tile.
    pub fn new(window: Window) -> Self {
        let blocks = window.width().div_ceil(BLOCK_PX) * window.height().div_ceil(BLOCK_PX);
        Self {
            window,
            samples: vec![Sample::EMPTY; window.len()],
            farthest: vec![f32::NEG_INFINITY; blocks],
        }
    }

    /// Finds out how far one sees in each block.
    pub fn survey(&mut self) {
        let across = self.window.width().div_ceil(BLOCK_PX);
        self.farthest.fill(f32::INFINITY);
        for (y, row) in self.samples.chunks_exact(self.window.width()).enumerate() {
            let blocks = &mut self.farthest[y / BLOCK_PX * across..][..across];
            for (block, samples) in blocks.iter_mut().zip(row.chunks(BLOCK_PX)) {
                *block = samples.iter().fold(*block, |far, sample| far.min(sample.nearness));
            }
        }
    }

    /// Whether all of a rectangle (left, top, right, bottom) lies outside the tile, or showed what is nearer than `nearness` at the last survey.
    #[inline]
    pub fn hides(&self, [left, top, right, bottom]: [f32; 4], nearness: f32) -> bool {
        let window = self.window;
        if !window.touches([left, top, right, bottom]) {
            return true;
        }
        let across = window.width().div_ceil(BLOCK_PX);
        let block = |edge_px: f32, first: i32, pixels: usize| {
            let within = (edge_px - first as f32).clamp(0.0, (pixels - 1) as f32);
            within as usize / BLOCK_PX // within the tile
        };
        let (x0, x1) =
            (block(left, window.left, window.width()), block(right, window.left, window.width()));
        let (y0, y1) =
            (block(top, window.top, window.height()), block(bottom, window.top, window.height()));
        (y0..=y1).all(|y| {
            self.farthest[y * across + x0..=y * across + x1].iter().all(|far| *far > nearness)
        })
    }

    /// Draws a triangle where it is nearest and `keeps` (given nearness, column and row) agrees.
    #[inline(always)]
    pub fn triangle(
        &mut self,
        camera: &Camera,
        corners: [Corner; 3],
        ink: Ink,
        keeps: impl Fn(i32, i32, f32) -> bool,
    ) {
        if camera.is_perspective() && corners.iter().any(|c| c.view.z < NEAR_M) {
            if corners.iter().any(|c| c.view.z >= NEAR_M) {
                self.clipped(camera, corners, ink);
            }
            return;
        }
        let [a, b, c] = corners;
        let projected = [a, b, c].map(|corner| camera.project_view(corner.view));
        self.flat(projected, [a.normal, b.normal, c.normal], ink, keeps);
    }

    /// Draws a triangle of the picture, see [`SurfaceBuffer::triangle`].
    #[inline(always)]
    pub fn flat(
        &mut self,
        projected: [Projected; 3],
        [a, b, c]: [Vec3; 3],
        ink: Ink,
        keeps: impl Fn(i32, i32, f32) -> bool,
    ) {
        let window = self.window;
        let samples = &mut self.samples;
        cover(window, projected, |x, y, nearness, [weight_b, weight_c]| {
            let sample = &mut samples[window.index(x, y)];
            if nearness > sample.nearness && keeps(x, y, nearness) {
                *sample = Sample {
                    nearness,
                    normal: a + (b - a) * weight_b + (c - a) * weight_c,
                    item: ink.item,
                    surface: ink.surface,
                    variation: ink.variation,
                    openness: ink.openness,
                };
            }
        });
    }

    /// Draws what of a triangle lies behind the near plane.
    #[cold]
    fn clipped(&mut self, camera: &Camera, corners: [Corner; 3], ink: Ink) {
        let mut kept: Vec<Corner> = Vec::with_capacity(4);
        for (i, from) in corners.iter().enumerate() {
            let to = &corners[(i + 1) % 3];
            if from.view.z >= NEAR_M {
                kept.push(*from);
            }
            if (from.view.z >= NEAR_M) != (to.view.z >= NEAR_M) {
                let t = (NEAR_M - from.view.z) / (to.view.z - from.view.z);
                let mut view = from.view.lerp(to.view, t);
                view.z = NEAR_M;
                kept.push(Corner { view, normal: from.normal.lerp(to.normal, t) });
            }
        }
        for i in 2..kept.len() {
            let fan = [kept[0], kept[i - 1], kept[i]];
            let projected = fan.map(|corner| camera.project_view(corner.view));
            self.flat(projected, fan.map(|corner| corner.normal), ink, |_, _, _| true);
        }
    }

    /// Draws one pixel where it is nearest.
    #[inline]
    pub fn dot(&mut self, x: i32, y: i32, nearness: f32, normal: Vec3, ink: Ink) {
        let w = self.window;
        if x < w.left || x >= w.right || y < w.top || y >= w.bottom {
            return;
        }
        let sample = &mut self.samples[w.index(x, y)];
        if nearness > sample.nearness {
            let Ink { item, surface, variation, openness } = ink;
            *sample = Sample { nearness, normal, item, surface, variation, openness };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::vector::{UP, vec3};
    use super::*;

    const INK: Ink = Ink { item: 1, surface: Surface::Ground, variation: 0, openness: 255 };
    const WINDOW: Window = Window { left: 0, top: 0, right: 32, bottom: 32 };

    fn square(camera: &Camera, depth_m: f32, half_m: f32) -> [[Corner; 3]; 2] {
        let at = |x: f32, y: f32| {
            let place = camera.eye
                + camera.forward * depth_m
                + camera.right * (x * half_m)
                + camera.up * (y * half_m);
            Corner { view: camera.view(place), normal: UP }
        };
        let [a, b, c, d] = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
        [[a, b, c], [a, c, d]]
    }

    #[test]
    fn the_nearer_wins_in_any_order() {
        let camera = Camera::perspective(Vec3::default(), 0.3, 0.1, 1.0, [32.0, 32.0]);
        let near = (square(&camera, 5.0, 1.0), Ink { item: 7, ..INK });
        let far = (square(&camera, 9.0, 9.0), Ink { item: 8, ..INK });
        for order in [[near, far], [far, near]] {
            let mut buffer = SurfaceBuffer::new(WINDOW);
            for (triangles, ink) in order {
                for triangle in triangles {
                    buffer.triangle(&camera, triangle, ink, |_, _, _| true);
                }
            }
            let middle = buffer.samples[WINDOW.index(16, 16)];
            let corner = buffer.samples[WINDOW.index(1, 1)];
            assert_eq!((middle.item, corner.item), (7, 8));
            assert!((middle.nearness - 0.2).abs() < 1e-5);
        }
    }

    #[test]
    fn ground_underfoot_is_cut_at_the_near_plane() {
        let eye = vec3(0.0, 0.0, 1.7);
        let camera = Camera::perspective(eye, 0.0, -0.3, 1.2, [32.0, 32.0]);
        let corner = |x: f32, y: f32| Corner { view: camera.view(vec3(x, y, 0.0)), normal: UP };
        let mut buffer = SurfaceBuffer::new(WINDOW);
        let ground = [corner(-900.0, -300.0), corner(900.0, -300.0), corner(0.0, 900.0)];
        buffer.triangle(&camera, ground, INK, |_, _, _| true);
        let sample = buffer.samples[WINDOW.index(16, 30)];
        let place = camera.place(16.5, 30.5, sample.nearness);
        assert!(sample.surface == Surface::Ground && place.z.abs() < 1e-3, "{place:?}");
    }
}
