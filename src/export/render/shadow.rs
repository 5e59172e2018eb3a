//! Shadows: how far the sun's light reaches, as depth maps seen from the sun; fine near the eye, coarse far off.

use rayon::prelude::*;

use super::camera::{Camera, Projected, direction_angles};
use super::coverage::{Window, cover};
use super::draw_list::{self, Detail, DetailSizes, Item};
use super::ground::Ground;
use super::noise;
use super::painter::Painter;
use super::vector::{Vec3, vec3};
use super::world::World;
use crate::gpu::GpuError;
use crate::tree::mesh::Material;

/// Pixels a side of a tile of a depth map. chosen: fits a core's cache.
const TILE_PX: u32 = 256;
/// Sizes in texels from which on finer models are drawn. chosen: far models cast nearly the same shadow; what is smaller than two texels casts
/// as a splat.
pub const DETAIL: DetailSizes = DetailSizes { least_px: [600.0, 90.0, 3.0] };
/// Gaps in foliage are as large as this, m, or two texels. chosen: holes between sprays.
const GAP_M: f32 = 0.3;
/// Below this smooth noise leaves a gap: over a third of the surface. chosen: light meets two or more surfaces of a crown, so that
/// a seventh or less reaches the ground in flecks, as under real stands.
pub const GAP_THRESHOLD: f32 = 0.43;

/// Size of gaps in foliage where texels are so large.
pub fn gap_m(texel_m: f32) -> f32 {
    GAP_M.max(2.0 * texel_m)
}

/// A depth map.
pub struct DepthMap {
    camera: Camera,
    side_px: u32,
    nearness: Vec<f32>,
    /// Middle and radius of the ball within which it is used.
    middle: Vec3,
    radius_m: f32,
    texel_m: f32,
}

/// Depth maps, the finest first.
pub struct Shadows {
    maps: Vec<DepthMap>,
    sun: Vec3,
}

impl Shadows {
    /// Depth maps around balls (middle, radius, texels a side), the finest first; `sun` is the direction to it.
    ///
    /// # Errors
    /// If a graphics card is the painter and fails.
    pub fn new(
        world: &World<'_>,
        sun: Vec3,
        balls: &[(Vec3, f32, u32)],
        painter: &mut Painter,
    ) -> Result<Self, GpuError> {
        let maps = balls.iter().map(|ball| depth_map(world, sun, *ball, painter));
        Ok(Self { maps: maps.collect::<Result<_, _>>()?, sun })
    }

    /// Share of the sun that reaches a place, 0..=1; `reach_m` is how far off its surface the question is asked.
    #[inline]
    pub fn sunlit(&self, place: Vec3, normal: Vec3, reach_m: f32, word: u32) -> f32 {
        let Some(map) =
            self.maps.iter().find(|map| (place - map.middle).length() < map.radius_m * 0.96)
        else {
            return 1.0;
        };
        let bias_m = 0.8 * map.texel_m + reach_m;
        let asked = place + normal * (0.9 * map.texel_m) + self.sun * bias_m;
        let v = map.camera.view(asked);
        let p = map.camera.project_view(v);
        map.light(p, word)
    }
}

impl DepthMap {
    /// Share of texels around a place that lie behind it, at four places of a turned cross.
    #[inline]
    fn light(&self, p: Projected, word: u32) -> f32 {
        let [a, b, _, _] = noise::four(word);
        let (dx, dy) = (a - 0.5, b - 0.5);
        let mut lit = 0.0;
        for (ox, oy) in [(-0.75, -0.35), (0.35, -0.75), (0.75, 0.35), (-0.35, 0.75)] {
            lit += self.smooth(p.x + ox + dx, p.y + oy + dy, p.nearness);
        }
        0.25 * lit
    }

    /// Light between four texels.
    #[inline]
    fn smooth(&self, x: f32, y: f32, nearness: f32) -> f32 {
        let most = self.side_px as f32 - 1.001;
        let (x, y) = ((x - 0.5).clamp(0.0, most), (y - 0.5).clamp(0.0, most));
        // clamped to the map
        let (col, row) = (x as usize, y as usize);
        let (tx, ty) = (x - col as f32, y - row as f32);
        let side = self.side_px as usize;
        let at = |r: usize, c: usize| f32::from(u8::from(self.nearness[r * side + c] <= nearness));
        let (c1, r1) = ((col + 1).min(side - 1), (row + 1).min(side - 1));
        let north = at(row, col) + (at(row, c1) - at(row, col)) * tx;
        let south = at(r1, col) + (at(r1, c1) - at(r1, col)) * tx;
        north + (south - north) * ty
    }
}

fn depth_map(
    world: &World<'_>,
    sun: Vec3,
    (middle, radius_m, side_px): (Vec3, f32, u32),
    painter: &mut Painter,
) -> Result<DepthMap, GpuError> {
    let [azimuth_rad, pitch_rad] = direction_angles(sun, Vec3::default());
    let side = side_px as f32;
    let px_per_m = side / (2.0 * radius_m);
    let camera = Camera::orthographic(middle, azimuth_rad, pitch_rad, px_per_m, [side, side]);
    let items = draw_list::visible(world.instances, &world.bounds, &camera, &DETAIL);
    let texel_m = 1.0 / px_per_m;
    let nearness = match painter {
        Painter::Cpu => nearness(world, &camera, &items, side_px, texel_m),
        #[cfg(feature = "gpu")]
        Painter::Gpu(gpu) => gpu.depth_map(world, &camera, &items, side_px, texel_m)?,
    };
    Ok(DepthMap { camera, side_px, nearness, middle, radius_m, texel_m })
}

/// Nearness of what the sun sees in each pixel of a depth map, −∞ where there is nothing; by the CPU.
pub fn nearness(
    world: &World<'_>,
    camera: &Camera,
    items: &[Item],
    side_px: u32,
    texel_m: f32,
) -> Vec<f32> {
    let tiling = draw_list::tile(items, side_px, side_px, TILE_PX);
    let tiles: Vec<Vec<f32>> = tiling
        .windows
        .par_iter()
        .zip(&tiling.items)
        .map(|(window, list)| {
            let mut depths = vec![f32::NEG_INFINITY; window.len()];
            draw_ground(&mut depths, *window, camera, &world.ground, texel_m);
            for place in list {
                draw_item(&mut depths, *window, camera, world, &items[*place as usize], texel_m);
            }
            depths
        })
        .collect();
    let mut nearness = vec![f32::NEG_INFINITY; (side_px * side_px) as usize];
    for (window, tile) in tiling.windows.iter().zip(tiles) {
        for (row, values) in tile.chunks_exact(window.width()).enumerate() {
            let first = (window.top as usize + row) * side_px as usize + window.left as usize;
            nearness[first..first + values.len()].copy_from_slice(values);
        }
    }
    nearness
}

/// Cells a side of the terrain's triangles where texels are so large.
pub fn ground_step(ground: &Ground, texel_m: f32) -> usize {
    let mut step = 1;
    while step < 16 && (step as f32) * ground.cell_m < 3.0 * texel_m {
        step *= 2;
    }
    step
}

/// The texel that a splat darkens, `None` if it is left out by chance.
pub fn splat_texel(item: &Item) -> Option<[i32; 2]> {
    let [left, top, right, bottom] = item.rect_px;
    // a ball's rectangle is three times as large as most plants
    let area_px = (right - left) * (bottom - top) * 0.3;
    let word = noise::hash2(item.group, item.index);
    // saturating; what is beside the map is passed over
    let texel = [(0.5 * (left + right)) as i32, (0.5 * (top + bottom)) as i32];
    (area_px >= noise::unit(word)).then_some(texel)
}

/// The terrain itself, from cells no finer than texels.
fn draw_ground(depths: &mut [f32], window: Window, camera: &Camera, ground: &Ground, texel_m: f32) {
    let step = ground_step(ground, texel_m);
    // the tile's footprint on the terrain, generously: rays from its corners at the lowest and highest ground
    let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for x in [window.left, window.right] {
        for y in [window.top, window.bottom] {
            for z in ground.range_m {
                let from = camera.place(x as f32, y as f32, 0.0);
                let along = (z - from.z) / camera.forward.z.min(-0.02);
                let hit = from + camera.forward * along;
                low = [low[0].min(hit.x), low[1].min(hit.y)];
                high = [high[0].max(hit.x), high[1].max(hit.y)];
            }
        }
    }
    let index = |d: f32, last: usize| (d / ground.cell_m).clamp(0.0, last as f32) as usize; // clamped
    let (last_row, last_col) = (ground.rows - 1, ground.cols - 1);
    let col0 = index(low[0] - ground.west_m, last_col) / step * step;
    let row0 = index(ground.north_m - high[1], last_row) / step * step;
    let col1 = (index(high[0] - ground.west_m, last_col) + step).min(last_col);
    let row1 = (index(ground.north_m - low[1], last_row) + step).min(last_row);
    let project = |row: usize, col: usize| {
        let place = ground.corner(row.min(last_row), col.min(last_col));
        place.z.is_finite().then(|| camera.project_view(camera.view(place)))
    };
    for row in (row0..row1).step_by(step) {
        for col in (col0..col1).step_by(step) {
            let corners = [
                project(row, col),
                project(row, col + step),
                project(row + step, col + step),
                project(row + step, col),
            ];
            let [Some(a), Some(b), Some(c), Some(d)] = corners else { continue };
            for triangle in [[a, b, c], [a, c, d]] {
                cover(window, triangle, |x, y, nearness, _| {
                    let depth = &mut depths[window.index(x, y)];
                    *depth = depth.max(nearness);
                });
            }
        }
    }
}

fn draw_item(
    depths: &mut [f32],
    window: Window,
    camera: &Camera,
    world: &World<'_>,
    item: &Item,
    texel_m: f32,
) {
    let group = &world.instances.groups[item.group as usize];
    let word = noise::hash2(item.group, item.index);
    let level = match item.detail {
        Detail::Level(level) => level,
        Detail::Splat => {
            let Some([col, row]) = splat_texel(item) else { return };
            let inside = col >= window.left
                && col < window.right
                && row >= window.top
                && row < window.bottom;
            if inside {
                let depth = &mut depths[window.index(col, row)];
                *depth = depth.max(-item.depth_m);
            }
            return;
        }
    };
    let mesh = &world.instances.archetypes[group.archetype].levels[usize::from(level)];
    let gap_m = gap_m(texel_m);
    let has_leaves = world.has_leaves(item);
    for part in &mesh.parts {
        let is_foliage = part.material == Material::Foliage;
        if is_foliage && !has_leaves {
            continue;
        }
        let corners: Vec<Projected> = part
            .positions
            .iter()
            .map(|position| camera.project_view(camera.view(item.place(*position))))
            .collect();
        for triangle in &part.triangles {
            let [a, b, c] = triangle.map(|i| corners[i as usize]);
            cover(window, [a, b, c], |x, y, nearness, _| {
                let depth = &mut depths[window.index(x, y)];
                if nearness <= *depth {
                    return;
                }
                if is_foliage {
                    let place = camera.place(x as f32 + 0.5, y as f32 + 0.5, nearness);
                    let offset = vec3((word & 0xff) as f32, ((word >> 8) & 0xff) as f32, 0.0);
                    if noise::smooth(place / gap_m + offset) < GAP_THRESHOLD {
                        return;
                    }
                }
                *depth = nearness;
            });
        }
    }
}
