//! A picture of a world through a camera: tiles are filled with surfaces, lit, and developed.

use image::RgbImage;
use rayon::prelude::*;

use super::camera::{Camera, NEAR_M};
use super::coverage::Window;
use super::draw_list::{self, Detail, DetailSizes, Item};
use super::foliage;
use super::ground_mesh::{self, Patch};
use super::noise;
use super::shading::{self, Lights};
use super::strew;
use super::surface_buffer::{Corner, Ink, Sample, Surface, SurfaceBuffer};
use super::tone;
use super::vector::{UP, Vec3};
use super::world::World;
use crate::tree::mesh::Material;

/// Samples a side of a tile. chosen: fits a core's cache.
const TILE_PX: u32 = 96;
/// Sizes in samples from which on finer models are drawn. chosen: near models where single branches show, far ones from a
/// shrub of some pixels on.
const DETAIL: DetailSizes = DetailSizes { least_px: [420.0, 42.0, 4.5] };

/// After so many items a tile finds out what is hidden by now. chosen: it costs less than one item.
const SURVEY_EVERY: usize = 4;

/// How a picture is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureOptions {
    /// Width and height in pixels.
    pub size_px: [u32; 2],
    /// Samples a pixel, each way.
    pub finer: u32,
    /// Whether the terrain's cut sides are drawn.
    pub has_walls: bool,
    /// Whether grass and litter are strewn on the ground near the eye.
    pub is_strewn: bool,
    /// A fixed exposure instead of one that is measured; white paper comes out white at any.
    pub exposure: Option<f32>,
}

/// Takes a picture; `camera` counts in its pixels.
pub fn take(
    world: &World<'_>,
    lights: &Lights<'_>,
    camera: &Camera,
    options: &PictureOptions,
) -> RgbImage {
    let [width, height] = options.size_px;
    let finer = options.finer.max(1);
    let camera = camera.finer(finer as f32);
    let (across, down) = (width * finer, height * finer);
    let items = draw_list::visible(world.instances, &world.bounds, &camera, &DETAIL);
    let tiling = draw_list::tile(&items, across, down, TILE_PX);
    let patches = ground_mesh::visible(&world.ground, &camera);
    let tufts = if options.is_strewn { strew::visible(world, &camera) } else { Vec::new() };

    let tiles: Vec<(Vec<Vec3>, Vec<bool>)> = tiling
        .windows
        .par_iter()
        .zip(&tiling.items)
        .map(|(window, list)| {
            let mut buffer = SurfaceBuffer::new(*window);
            draw_items(&mut buffer, world, &camera, &items, list);
            strew::draw(&mut buffer, world, &camera, &tufts);
            draw_ground(&mut buffer, world, &camera, &patches, options.has_walls);
            let (w, samples) = (buffer.window, &buffer.samples);
            let light = |i: usize, sample: &Sample| {
                // places within the tile
                let at = [w.left + (i % w.width()) as i32, w.top + (i / w.width()) as i32];
                shading::shade(world, lights, &camera, &items, sample, at)
            };
            let lit = samples.iter().enumerate().map(|(i, sample)| light(i, sample)).collect();
            let sky = samples.iter().map(|sample| sample.surface == Surface::Sky).collect();
            (lit, sky)
        })
        .collect();

    let mut light = vec![Vec3::default(); (across * down) as usize]; // below 2³²
    let mut is_sky = vec![false; light.len()];
    for (window, (lit, sky)) in tiling.windows.iter().zip(tiles) {
        let rows = lit.chunks_exact(window.width()).zip(sky.chunks_exact(window.width()));
        for (row, (lit, sky)) in rows.enumerate() {
            let first = first_of(*window, row, across);
            light[first..first + lit.len()].copy_from_slice(lit);
            is_sky[first..first + sky.len()].copy_from_slice(sky);
        }
    }
    let exposure = options.exposure.unwrap_or_else(|| tone::exposure(&light, |i| is_sky[i]));
    let size = [width as usize, height as usize]; // as large as the picture
    let bytes = tone::develop(&light, size[0], size[1], finer as usize, exposure);
    match RgbImage::from_raw(width, height, bytes) {
        Some(picture) => picture,
        None => panic!("a developed picture has three bytes a pixel"),
    }
}

/// Place of a tile's row in the whole picture.
fn first_of(window: Window, row: usize, across: u32) -> usize {
    // windows lie within the picture
    (window.top as usize + row) * across as usize + window.left as usize
}

fn draw_items(
    buffer: &mut SurfaceBuffer,
    world: &World<'_>,
    camera: &Camera,
    items: &[Item],
    list: &[u32],
) {
    let mut corners: Vec<Corner> = Vec::new();
    for (number, place) in list.iter().enumerate() {
        let item = &items[*place as usize];
        if number % SURVEY_EVERY == SURVEY_EVERY - 1 {
            buffer.survey();
        }
        if buffer.hides(item.rect_px, nearest(camera, item)) {
            continue;
        }
        let group = &world.instances.groups[item.group as usize];
        let has_leaves = world.has_leaves(item);
        let level = match item.detail {
            Detail::Splat => {
                if has_leaves {
                    splat(buffer, camera, item, *place);
                }
                continue;
            }
            Detail::Level(level) => level,
        };
        let mesh = &world.instances.archetypes[group.archetype].levels[usize::from(level)];
        for part in &mesh.parts {
            if part.material == Material::Foliage {
                if has_leaves {
                    let look = &world.leaves[world.species(group)];
                    foliage::draw(buffer, camera, item, *place, part, look, &mut corners);
                }
                continue;
            }
            corners.clear();
            corners.extend(part.positions.iter().zip(&part.normals).map(|(position, normal)| {
                Corner { view: camera.view(item.place(*position)), normal: item.normal(*normal) }
            }));
            let surface = Surface::Part(part.material);
            let ink = Ink { item: *place, surface, variation: 128, openness: 255 };
            for triangle in &part.triangles {
                let triangle = triangle.map(|i| corners[i as usize]);
                buffer.triangle(camera, triangle, ink, |_, _, _| true);
            }
        }
    }
}

/// The nearest that any part of an item can be.
fn nearest(camera: &Camera, item: &Item) -> f32 {
    let reach_m = item.radius_m * 1.2 + 0.5;
    if camera.is_perspective() {
        let depth_m = item.depth_m - reach_m;
        if depth_m > NEAR_M { 1.0 / depth_m } else { f32::INFINITY }
    } else {
        reach_m - item.depth_m
    }
}

/// Draws what is smaller than triangles are worth: as many pixels as it covers on average.
fn splat(buffer: &mut SurfaceBuffer, camera: &Camera, item: &Item, place: u32) {
    let word = noise::hash2(item.group ^ 0x7f4a, item.index);
    let scale = camera.px_per_m(item.depth_m);
    let wide_px = (item.axes[0].length() + item.axes[1].length()) * scale;
    let tall_px = (item.axes[2].length() * scale).max(wide_px * 0.5);
    // crowns fill some two thirds of their box
    let mut left_px = wide_px * tall_px * 0.66;
    let [x0, y0, x1, y1] = item.rect_px;
    let (mx, my) = (0.5 * (x0 + x1), 0.5 * (y0 + y1));
    let nearness =
        if camera.is_perspective() { 1.0 / item.depth_m.max(0.1) } else { -item.depth_m };
    let surface = Surface::Part(Material::Foliage);
    for k in 0..12_u32 {
        let [a, b, c, d] = noise::four(noise::hash2(word, k));
        if left_px < a {
            break;
        }
        left_px -= 1.0;
        let (x, y) = (mx + (b - 0.5) * wide_px, my + (c - 0.5) * tall_px);
        let normal = (noise::direction(noise::hash2(word, k ^ 0x33)) * 0.7 + UP).unit();
        let variation = (d * 255.0) as u8; // below 256
        let ink = Ink { item: place, surface, variation, openness: 215 };
        buffer.dot(x.floor() as i32, y.floor() as i32, nearness, normal, ink); // outside it is passed over
    }
}

fn draw_ground(
    buffer: &mut SurfaceBuffer,
    world: &World<'_>,
    camera: &Camera,
    patches: &[Patch],
    has_walls: bool,
) {
    ground_mesh::draw(buffer, camera, &world.ground, patches, has_walls);
}
