//! A picture of a world through a camera: tiles are filled with surfaces, lit, and developed.

use image::RgbImage;
use rayon::prelude::*;

use super::camera::{Camera, NEAR_M};
use super::coverage::Window;
use super::draw_list::{self, Detail, DetailSizes, Item};
use super::foliage;
use super::ground_mesh::{self, Patch};
use super::noise;
use super::painter::Painter;
use super::shading::{self, Lights};
use super::strew;
use super::surface_buffer::{Corner, Ink, Sample, Surface, SurfaceBuffer};
use super::tone;
use super::vector::{UP, Vec3};
use super::world::World;
use crate::export::instances::FeatureTable;
use crate::gpu::GpuError;
use crate::tree::mesh::Material;

/// Samples a side of a tile. chosen: fits a core's cache.
const TILE_PX: u32 = 96;
/// Sizes in samples from which on finer models are drawn. chosen: near models where single branches show, far ones from a
/// shrub of some pixels on.
pub const DETAIL: DetailSizes = DetailSizes { least_px: [420.0, 42.0, 4.5] };

/// A tile finds out what is hidden by now when what was drawn since could have covered this share of it. chosen: the fastest of
/// 1/8 to 4 on a square kilometre from the air.
const SURVEY_SHARE: f32 = 1.0;

/// Mean brightness, on a logarithmic scale, that pictures from afar and in the forest are exposed for. chosen: below a grey card's 0.18, as
/// crowns are dark; in the forest the eye gets used to the shade.
const AERIAL_LIGHT: f32 = 0.122;
const FOREST_LIGHT: f32 = 0.160;

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
    /// Whether the sky is a backdrop: as bright at any exposure.
    pub has_fixed_sky: bool,
    /// A fixed exposure instead of one that is measured; white paper comes out white at any.
    pub exposure: Option<f32>,
}

/// What a picture shows.
#[derive(Clone, Copy)]
pub struct Sight<'a> {
    /// What there is.
    pub world: &'a World<'a>,
    /// From where one looks; it counts in samples.
    pub camera: &'a Camera,
    /// What of the world is within sight.
    pub items: &'a [Item],
    /// How the picture is made.
    pub options: &'a PictureOptions,
}

/// Takes a picture; `camera` counts in its pixels.
///
/// # Errors
/// If a graphics card is the painter and fails.
pub fn take(
    world: &World<'_>,
    lights: &Lights<'_>,
    camera: &Camera,
    options: &PictureOptions,
    painter: &mut Painter,
) -> Result<RgbImage, GpuError> {
    let [width, height] = options.size_px;
    let finer = options.finer.max(1);
    let camera = camera.finer(finer as f32);
    let (across, down) = (width * finer, height * finer);
    let items = draw_list::visible(world.instances, &world.bounds, &camera, &DETAIL);
    let sight = Sight { world, camera: &camera, items: &items, options };
    let lit = |w: Window, samples: &[Sample]| -> (Vec<Vec3>, Vec<bool>) {
        let light = |i: usize, sample: &Sample| {
            // places within the tile
            let at = [w.left + (i % w.width()) as i32, w.top + (i / w.width()) as i32];
            shading::shade(world, lights, &camera, &items, sample, at)
        };
        let lit = samples.iter().enumerate().map(|(i, sample)| light(i, sample)).collect();
        let sky = samples.iter().map(|sample| sample.surface == Surface::Sky).collect();
        (lit, sky)
    };
    let tiles = match painter {
        Painter::Cpu => surfaces(&sight, lit),
        #[cfg(feature = "gpu")]
        Painter::Gpu(gpu) => gpu.surfaces(&sight, lit)?,
    };

    let mut light = vec![Vec3::default(); (across * down) as usize]; // below 2³²
    let mut is_sky = vec![false; light.len()];
    for (window, (lit, sky)) in tiles {
        let rows = lit.chunks_exact(window.width()).zip(sky.chunks_exact(window.width()));
        for (row, (lit, sky)) in rows.enumerate() {
            let first = first_of(window, row, across);
            light[first..first + lit.len()].copy_from_slice(lit);
            is_sky[first..first + sky.len()].copy_from_slice(sky);
        }
    }
    let mean_light = if options.has_fixed_sky { AERIAL_LIGHT } else { FOREST_LIGHT };
    let exposure =
        options.exposure.unwrap_or_else(|| tone::exposure(&light, mean_light, |i| is_sky[i]));
    // a backdrop is as bright whatever stands before it; a sky between crowns is held back, as eyes do
    let held_back = if options.has_fixed_sky { exposure } else { exposure.max(1.0).sqrt() };
    let sky = light.iter_mut().zip(&is_sky).filter(|(_, is_sky)| **is_sky);
    sky.for_each(|(light, _)| *light /= held_back);
    let size = [width as usize, height as usize]; // as large as the picture
    let power = if options.has_fixed_sky { 1.0 } else { tone::FLECK_POWER };
    let bytes = tone::develop(&light, size, finer as usize, exposure, power);
    match RgbImage::from_raw(width, height, bytes) {
        Some(picture) => Ok(picture),
        None => panic!("a developed picture has three bytes a pixel"),
    }
}

/// What `light` makes of the samples of each tile of a picture; by the CPU.
pub fn surfaces<R: Send>(
    sight: &Sight<'_>,
    light: impl Fn(Window, &[Sample]) -> R + Sync,
) -> Vec<(Window, R)> {
    let Sight { world, camera, items, options } = *sight;
    // as many samples as the camera has pixels
    let [across, down] = camera.size_px.map(|side| side as u32);
    let tiling = draw_list::tile(items, across, down, TILE_PX);
    let patches = ground_mesh::visible(&world.ground, camera);
    let tufts = if options.is_strewn { strew::visible(world, camera) } else { Vec::new() };
    let tiles = tiling.windows.par_iter().zip(&tiling.items);
    let lit = tiles.map(|(window, list)| {
        let mut buffer = SurfaceBuffer::new(*window);
        draw_items(&mut buffer, world, camera, items, list, options.has_walls);
        strew::draw(&mut buffer, world, camera, &tufts);
        draw_ground(&mut buffer, world, camera, &patches, options.has_walls);
        (*window, light(*window, &buffer.samples))
    });
    lit.collect()
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
    has_walls: bool,
) {
    let mut corners: Vec<Corner> = Vec::new();
    let enough_px = SURVEY_SHARE * buffer.window.len() as f32;
    let mut drawn_px = 0.0;
    for place in list {
        let item = &items[*place as usize];
        if drawn_px > enough_px {
            buffer.survey();
            drawn_px = 0.0;
        }
        if buffer.hides(item.rect_px, nearest(camera, item)) {
            continue;
        }
        drawn_px += buffer.window.shared_px(item.rect_px);
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
                if let Some(look) = world.foliage(group) {
                    foliage::draw(buffer, camera, item, *place, part, look, &mut corners);
                }
                continue;
            }
            corners.clear();
            corners.extend(part.positions.iter().zip(&part.normals).map(|(position, normal)| {
                Corner { view: camera.view(item.place(*position)), normal: item.normal(*normal) }
            }));
            // a block of terrain ends with clean sides
            let is_cut = has_walls && group.table == FeatureTable::DownedLogs;
            let surface = Surface::Part(part.material);
            let ink = Ink { item: *place, surface, variation: 128, openness: 255 };
            for triangle in &part.triangles {
                let triangle = triangle.map(|i| corners[i as usize]);
                if is_cut {
                    buffer.triangle(camera, triangle, ink, |x, y, nearness| {
                        let place = camera.place(x as f32 + 0.5, y as f32 + 0.5, nearness);
                        world.ground.covers(place)
                    });
                } else {
                    buffer.triangle(camera, triangle, ink, |_, _, _| true);
                }
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

/// Most dots of a splat.
pub const MOST_DOTS: u32 = 12;

/// What is smaller than triangles are worth: as many pixels as it covers on average.
#[derive(Clone, Copy, Debug)]
pub struct Splat {
    /// Its middle on the picture.
    pub middle_px: [f32; 2],
    /// Width and height.
    pub size_px: [f32; 2],
    /// How near it is.
    pub nearness: f32,
    /// Pixels it covers on average.
    pub area_px: f32,
    /// Where its noise begins.
    pub word: u32,
}

impl Splat {
    /// An item as a splat.
    pub fn of(camera: &Camera, item: &Item) -> Self {
        let scale = camera.px_per_m(item.depth_m);
        let wide_px = (item.axes[0].length() + item.axes[1].length()) * scale;
        let tall_px = (item.axes[2].length() * scale).max(wide_px * 0.5);
        let [x0, y0, x1, y1] = item.rect_px;
        Self {
            middle_px: [0.5 * (x0 + x1), 0.5 * (y0 + y1)],
            size_px: [wide_px, tall_px],
            nearness: if camera.is_perspective() {
                1.0 / item.depth_m.max(0.1)
            } else {
                -item.depth_m
            },
            // crowns fill some two thirds of their box
            area_px: wide_px * tall_px * 0.66,
            word: noise::hash2(item.group ^ 0x7f4a, item.index),
        }
    }
}

fn splat(buffer: &mut SurfaceBuffer, camera: &Camera, item: &Item, place: u32) {
    let Splat { middle_px: [mx, my], size_px: [wide_px, tall_px], nearness, area_px, word } =
        Splat::of(camera, item);
    let mut left_px = area_px;
    let surface = Surface::Part(Material::Foliage);
    for k in 0..MOST_DOTS {
        let [a, b, c, d] = noise::four(noise::hash2(word, k));
        if left_px < a {
            break;
        }
        left_px -= 1.0;
        let (x, y) = (mx + (b - 0.5) * wide_px, my + (c - 0.5) * tall_px);
        let normal = (noise::direction(noise::hash2(word, k ^ 0x33)) * 0.7 + UP).normalize_or(UP);
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

#[cfg(test)]
mod tests {
    use super::super::ground::Ground;
    use super::super::lighting::Lighting;
    use super::super::sky::Sky;
    use super::super::vector::vec3;
    use super::super::world::Season;
    use super::*;
    use crate::export::instances::{InstanceGroup, Instances};
    use crate::raster::Grid;
    use crate::species::Biome;
    use crate::tree::archetype::Archetype;
    use crate::tree::mesh::{Mesh, MeshPart};

    /// A box from 0 to 1 upwards, half a unit to each side.
    fn a_box(material: Material) -> Mesh {
        let (mut positions, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
                let first = positions.len() as u32;
                for [a, b] in [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5_f32]] {
                    let mut p = [0.0_f32; 3];
                    (p[axis], p[u], p[v]) = (0.5 * sign, a, b);
                    p[2] += 0.5;
                    positions.push(p);
                    let mut n = [0.0; 3];
                    n[axis] = sign;
                    normals.push(n);
                }
                triangles.push([first, first + 1, first + 2]);
                triangles.push([first, first + 2, first + 3]);
            }
        }
        Mesh { parts: vec![MeshPart { material, positions, normals, triangles }] }
    }

    fn boxes(material: Material, places: &[[f32; 3]], size_m: f32) -> Instances {
        let mesh = a_box(material);
        let levels = [mesh.clone(), mesh.clone(), mesh];
        let n = places.len();
        Instances {
            origin: [0.0; 3],
            archetypes: vec![Archetype {
                key: "box".to_owned(),
                species: 0,
                levels,
                colors_srgb: [[150; 3]; Material::ALL.len()],
            }],
            groups: vec![InstanceGroup {
                archetype: 0,
                table: FeatureTable::Plants,
                row: (0..n as u32).collect(),
                position_m: places.to_vec(),
                rotation: vec![[0.0, 0.0, 0.0, 1.0]; n],
                scale: vec![[size_m; 3]; n],
                tint_srgb: vec![[255; 3]; n],
            }],
        }
    }

    const OPTIONS: PictureOptions = PictureOptions {
        size_px: [96, 64],
        finer: 2,
        has_walls: true,
        is_strewn: false,
        has_fixed_sky: false,
        exposure: None,
    };

    fn picture(instances: &Instances, sun: Vec3, camera: &Camera) -> RgbImage {
        let biome = Biome::builtin("sonoma").unwrap();
        let ground = Ground::new(&Grid::from_fn(40, 40, 1.0, |_| 0.0), [0.0; 3]);
        let world = World::new(instances, ground, &biome, [&[], &[]], Season::Summer);
        let mut painter = Painter::Cpu;
        let light = Lighting::new(&world, Sky::new(sun, 1.0), camera, &mut painter).unwrap();
        let Lighting { sky, shadows, sky_light } = &light;
        let lights = Lights { sky, shadows, sky_light, has_air: true, clear_m: 0.0 };
        take(&world, &lights, camera, &OPTIONS, &mut painter).unwrap()
    }

    #[test]
    fn a_box_casts_its_shadow_away_from_the_sun() {
        let instances = boxes(Material::Wood, &[[20.0, 20.0, 0.0]], 4.0);
        let down = -std::f32::consts::FRAC_PI_2;
        let camera = Camera::orthographic(vec3(20.0, 20.0, 50.0), 0.0, down, 1.6, [96.0, 64.0]);
        // from the east, 45° high: the shadow is 4 m long, west of the box
        let image = picture(&instances, vec3(1.0, 0.0, 1.0).normalize_or(UP), &camera);
        let bright = |east_m: f32| {
            let x = (48.0 + 1.6 * (east_m - 20.0)) as u32;
            image.get_pixel(x, 32).0.iter().map(|c| u32::from(*c)).sum::<u32>()
        };
        let (shadow, sunny, beyond) = (bright(16.3), bright(23.7), bright(11.0));
        assert!(2 * shadow < sunny && 2 * shadow < beyond, "{shadow} {sunny} {beyond}");
    }

    #[test]
    fn pictures_are_the_same_for_any_number_of_threads() {
        let places: Vec<[f32; 3]> = (0..60)
            .map(|i| [3.0 + (i % 9) as f32 * 4.0, 3.0 + (i / 9) as f32 * 5.0, 0.0])
            .collect();
        let instances = boxes(Material::Foliage, &places, 2.5);
        let camera = Camera::perspective(vec3(20.0, -6.0, 7.0), 0.1, -0.3, 1.0, [96.0, 64.0]);
        let of_threads = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| picture(&instances, vec3(0.6, -0.3, 0.7).normalize_or(UP), &camera))
        };
        let one = of_threads(1);
        assert!(one == of_threads(2), "one thread and two differ");
        let colors: std::collections::BTreeSet<[u8; 3]> = one.pixels().map(|p| p.0).collect();
        assert!(colors.len() > 300, "{} colours: leaves, ground and sky", colors.len());
    }
}
