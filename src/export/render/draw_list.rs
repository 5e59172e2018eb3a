//! What is drawn: instances within a camera's sight, each in the level of detail that its size asks for, sorted into tiles.

use rayon::prelude::*;

use super::camera::{Camera, NEAR_M};
use super::coverage::Window;
use super::vector::{UP, Vec3, turned, vec3};
use crate::export::instances::Instances;
use crate::tree::archetype::{Archetype, LEVELS};

/// How a model is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// As this level of its archetype.
    Level(u8),
    /// As a splat of a few pixels: smaller than any triangle is worth.
    Splat,
}

/// An instance within sight.
#[derive(Clone, Copy, Debug)]
pub struct Item {
    /// Its group.
    pub group: u32,
    /// Its place in the group.
    pub index: u32,
    /// How it is drawn.
    pub detail: Detail,
    /// Where its model's origin stands.
    pub position: Vec3,
    /// Where its model's axes point, as long as they are stretched.
    pub axes: [Vec3; 3],
    /// Depth of its middle, m.
    pub depth_m: f32,
    /// Radius of the ball around it, m.
    pub radius_m: f32,
    /// The rectangle that it may touch.
    pub rect_px: [f32; 4],
}

impl Item {
    /// A place of the model in the world.
    #[inline]
    pub fn place(&self, [x, y, z]: [f32; 3]) -> Vec3 {
        self.position + self.axes[0] * x + self.axes[1] * y + self.axes[2] * z
    }

    /// A normal of the model in the world.
    #[inline]
    pub fn normal(&self, [x, y, z]: [f32; 3]) -> Vec3 {
        // the inverse stretch: axes are square to each other
        let [i, j, k] = self.axes.map(|axis| axis / axis.dot(axis).max(1e-12));
        (i * x + j * y + k * z).normalize_or(UP)
    }
}

/// Middle and half sizes of the box around a model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ModelBounds {
    /// Middle of the box, in units of the model.
    pub middle: [f32; 3],
    /// Half its sizes.
    pub half: [f32; 3],
}

impl ModelBounds {
    /// The box around all levels of a model.
    pub fn of(archetype: &Archetype) -> Self {
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let parts = archetype.levels.iter().flat_map(|mesh| &mesh.parts);
        for position in parts.flat_map(|part| &part.positions) {
            for k in 0..3 {
                low[k] = low[k].min(position[k]);
                high[k] = high[k].max(position[k]);
            }
        }
        if low[0] > high[0] {
            return Self::default(); // a model without a vertex
        }
        Self {
            middle: std::array::from_fn(|k| 0.5 * (low[k] + high[k])),
            half: std::array::from_fn(|k| 0.5 * (high[k] - low[k])),
        }
    }
}

/// From which size on the screen on the finest, the middle and the far model are drawn, px of height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetailSizes {
    /// Least size of each level, the finest first; what is smaller than the last is a splat.
    pub least_px: [f32; LEVELS],
}

/// The instances that a camera may see, in the order of groups.
pub fn visible(
    instances: &Instances,
    bounds: &[ModelBounds],
    camera: &Camera,
    sizes: &DetailSizes,
) -> Vec<Item> {
    let mut items = Vec::new();
    for (group_index, group) in instances.groups.iter().enumerate() {
        let bounds = bounds[group.archetype];
        let [middle, half] = [bounds.middle, bounds.half];
        let part = (0..group.position_m.len()).into_par_iter().with_min_len(4096).filter_map(|i| {
            let [sx, sy, sz] = group.scale[i];
            let turn = group.rotation[i];
            let position = Vec3::from(group.position_m[i]);
            let local = vec3(middle[0] * sx, middle[1] * sy, middle[2] * sz);
            let center = position + turned(turn, local);
            let [hx, hy, hz] = [half[0] * sx, half[1] * sy, half[2] * sz];
            let radius_m = (hx * hx + hy * hy + hz * hz).sqrt();
            let rect_px = camera.bounds(center, radius_m)?;
            let depth_m = camera.view(center).z;
            let size_px = 2.0 * radius_m * camera.px_per_m((depth_m - radius_m).max(NEAR_M));
            let level = sizes.least_px.iter().position(|least| size_px >= *least);
            // at most LEVELS
            let detail = level.map_or(Detail::Splat, |level| Detail::Level(level as u8));
            Some(Item {
                group: group_index as u32, // groups are a few hundred
                index: i as u32,           // tables hold fewer than 2³² rows
                detail,
                position,
                axes: [
                    turned(turn, vec3(sx, 0.0, 0.0)),
                    turned(turn, vec3(0.0, sy, 0.0)),
                    turned(turn, vec3(0.0, 0.0, sz)),
                ],
                depth_m,
                radius_m,
                rect_px,
            })
        });
        items.par_extend(part);
    }
    items
}

/// A picture cut into square tiles, and what may touch each.
pub struct Tiling {
    /// The tiles, row by row.
    pub windows: Vec<Window>,
    /// For each tile the places of items in their list, the nearest first.
    pub items: Vec<Vec<u32>>,
}

/// Sorts items into tiles of a picture of `width` × `height` pixels.
pub fn tile(items: &[Item], width: u32, height: u32, tile_px: u32) -> Tiling {
    let (across, down) = (width.div_ceil(tile_px), height.div_ceil(tile_px));
    let mut windows = Vec::new();
    for row in 0..down {
        for col in 0..across {
            let [left, top] = [col * tile_px, row * tile_px];
            // pictures are far smaller than 2³¹ pixels wide
            windows.push(Window {
                left: left as i32,
                top: top as i32,
                right: width.min(left + tile_px) as i32,
                bottom: height.min(top + tile_px) as i32,
            });
        }
    }
    let mut lists = vec![Vec::new(); windows.len()];
    for (place, item) in items.iter().enumerate() {
        let at = |edge_px: f32, tiles: u32| {
            let edge = edge_px.max(0.0) as u32; // saturating
            (edge / tile_px).min(tiles - 1)
        };
        let [left, top, right, bottom] = item.rect_px;
        for row in at(top, down)..=at(bottom, down) {
            for col in at(left, across)..=at(right, across) {
                lists[(row * across + col) as usize].push(place as u32); // fewer than 2³² items
            }
        }
    }
    lists.par_iter_mut().for_each(|list| {
        // stable, so that equals keep the order of groups
        list.sort_by(|a, b| items[*a as usize].depth_m.total_cmp(&items[*b as usize].depth_m));
    });
    Tiling { windows, items: lists }
}

#[cfg(test)]
mod tests {
    use super::super::vector::UP;
    use super::*;

    #[test]
    fn normals_of_stretched_models_stay_square_to_their_surface() {
        let item = Item {
            group: 0,
            index: 0,
            detail: Detail::Level(0),
            position: Vec3::default(),
            axes: [vec3(3.0, 0.0, 0.0), vec3(0.0, 3.0, 0.0), UP],
            depth_m: 1.0,
            radius_m: 1.0,
            rect_px: [0.0; 4],
        };
        // the flank x + z = 1 of a cone
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let normal = item.normal([half, 0.0, half]);
        let flank = item.place([1.0, 0.0, 0.0]) - item.place([0.0, 0.0, 1.0]);
        assert!(normal.dot(flank).abs() < 1e-5, "{normal:?}");
    }
}
