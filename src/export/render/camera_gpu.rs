//! Cameras on the graphics card: the uniform that all of a picture's pipelines read; twin of [`super::camera`].

use bytemuck::{Pod, Zeroable};

use super::camera::{Camera, NEAR_M, Projection};
use super::coverage::Window;
use super::ground::Ground;
use super::ground_mesh;
use super::vector::vec3;

/// A camera, the band of the picture that is drawn, and the ground under both, as the WGSL text has them.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[allow(missing_docs, reason = "the text tells what the fields are")]
pub struct View {
    pub eye: [f32; 3],
    pub px_per_m: f32,
    pub right: [f32; 3],
    pub depth_base: f32,
    pub up: [f32; 3],
    pub depth_scale: f32,
    pub forward: [f32; 3],
    pub is_perspective: u32,
    pub size_px: [f32; 2],
    pub window_px: [f32; 2],
    pub window_size_px: [f32; 2],
    pub gap_m: f32,
    pub gap_threshold: f32,
    pub edges_m: [f32; 4],
    pub ground_cols: u32,
    pub ground_rows: u32,
    pub ground_cell_m: f32,
    pub base_m: f32,
    pub has_walls: u32,
    pub needs_all_corners: u32,
    pub pad_a: u32,
    pub pad_b: u32,
}

impl View {
    /// A camera over a ground; `nearness` are the farthest and the nearest that anything is where rays are parallel.
    pub fn of(camera: &Camera, ground: &Ground, nearness: [f32; 2]) -> Self {
        let (px_per_m, depth_base, depth_scale) = match camera.projection {
            // 1/depth from 0 to the near plane's
            Projection::Perspective { focal_px } => (focal_px, 0.0, NEAR_M),
            Projection::Orthographic { px_per_m } => {
                let [far, near] = nearness;
                // a little within 0..1, of which 0 is the sky
                let scale = 0.98 / (near - far).max(1.0);
                (px_per_m, 0.01 - far * scale, scale)
            }
        };
        let [east_m, south_m] = ground.far_edges_m();
        Self {
            eye: camera.eye.to_array(),
            px_per_m,
            right: camera.right.to_array(),
            depth_base,
            up: camera.up.to_array(),
            depth_scale,
            forward: camera.forward.to_array(),
            is_perspective: u32::from(camera.is_perspective()),
            size_px: camera.size_px,
            window_size_px: camera.size_px,
            edges_m: [ground.west_m, ground.north_m, south_m, east_m],
            // grids have fewer than 2³² rows
            ground_cols: ground.cols as u32,
            ground_rows: ground.rows as u32,
            ground_cell_m: ground.cell_m,
            base_m: ground_mesh::base_m(ground),
            ..Self::default()
        }
    }

    /// The same where only a band of the picture is drawn.
    pub fn within(self, window: Window) -> Self {
        Self {
            // pictures are far smaller than 2²⁴ pixels wide
            window_px: [window.left as f32, window.top as f32],
            window_size_px: [window.width() as f32, window.height() as f32],
            ..self
        }
    }

    /// Nearness of what depth buffers hold; −∞ where nothing was drawn.
    #[inline]
    pub fn nearness(&self, depth: f32) -> f32 {
        if depth > 0.0 { (depth - self.depth_base) / self.depth_scale } else { f32::NEG_INFINITY }
    }
}

/// The farthest and the nearest that the ground with its walls can be from a camera with parallel rays.
pub fn ground_range(camera: &Camera, ground: &Ground) -> [f32; 2] {
    let [east_m, south_m] = ground.far_edges_m();
    let mut range = [f32::INFINITY, f32::NEG_INFINITY];
    for x in [ground.west_m, east_m] {
        for y in [south_m, ground.north_m] {
            for z in [ground_mesh::base_m(ground), ground.range_m[1]] {
                let nearness = -camera.view(vec3(x, y, z)).z;
                range = [range[0].min(nearness), range[1].max(nearness)];
            }
        }
    }
    range
}
