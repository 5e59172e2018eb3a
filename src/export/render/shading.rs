//! Shading: light that a pixel of the picture sends to the eye.

use super::camera::Camera;
use super::draw_list::Item;
use super::ground_color;
use super::ground_mesh;
use super::noise;
use super::shadow::Shadows;
use super::sky::Sky;
use super::sky_light::SkyLight;
use super::surface_buffer::{Sample, Surface};
use super::vector::{UP, Vec3, vec3};
use super::world::World;
use crate::math::smoothstep;
use crate::tree::mesh::Material;

/// How far the sun reaches around the edge of soft things, as a share of its cosine. chosen: leaves face all ways.
const LEAF_WRAP: f32 = 0.25;
/// Light that goes through a leaf, by red, green and blue, over what it reflects. Leaves pass about as much as they
/// reflect, and more of the yellow.
const LEAF_PASSES: Vec3 = vec3(0.95, 0.90, 0.35);
/// Least share of the sky that is left anywhere. chosen: light that bounces among crowns, which the lattice leaves out.
const LEAST_SKY: f32 = 0.16;

/// What lights a picture.
pub struct Lights<'a> {
    /// The sky.
    pub sky: &'a Sky,
    /// Shadows of the sun; sections have none.
    pub shadows: &'a Shadows,
    /// Light among crowns.
    pub sky_light: &'a SkyLight,
    /// Whether air and sky are drawn; maps and sections lie on white paper.
    pub has_air: bool,
    /// So far from the eye haze begins: what lies between a bird and a tile is no part of the picture, m.
    pub clear_m: f32,
}

/// Light from a sample at column `x` and row `y`, linear.
pub fn shade(
    world: &World<'_>,
    lights: &Lights<'_>,
    camera: &Camera,
    items: &[Item],
    sample: &Sample,
    [x, y]: [i32; 2],
) -> Vec3 {
    let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
    let ray = camera.ray(px, py);
    if sample.surface == Surface::Sky {
        return if lights.has_air { lights.sky.radiance(ray) } else { Vec3::splat(PAPER) };
    }
    let place = camera.place(px, py, sample.nearness);
    let word = noise::hash2(x as u32, y as u32); // bits, not sizes
    let light = surface_light(world, lights, camera, items, sample, place, ray, word);
    if lights.has_air {
        lights.sky.hazed(light, ray, (place - camera.eye).length() - lights.clear_m)
    } else {
        light
    }
}

/// Light of white paper. chosen: comes out as 255 after exposure.
pub const PAPER: f32 = 40.0;

#[allow(clippy::too_many_arguments, reason = "each is one thing that light depends on")]
fn surface_light(
    world: &World<'_>,
    lights: &Lights<'_>,
    camera: &Camera,
    items: &[Item],
    sample: &Sample,
    place: Vec3,
    ray: Vec3,
    word: u32,
) -> Vec3 {
    let variation = f32::from(sample.variation) / 255.0;
    let openness = f32::from(sample.openness) / 255.0;
    let px_m = 1.0 / camera.px_per_m(camera.view(place).z);
    let mut normal = sample.normal.normalize_or(UP);
    let sky = lights.sky;
    match sample.surface {
        Surface::Sky => Vec3::default(),
        Surface::Wall => {
            let top_m = world.ground.height_m(place.x, place.y).unwrap_or(place.z);
            let albedo = ground_color::wall(place, top_m - place.z);
            let base_m = ground_mesh::base_m(&world.ground);
            let sun = sky.sun_light * normal.dot(sky.sun).max(0.0);
            // darker towards the foot, as if it stood on something
            let up = ((place.z - base_m) / (top_m - base_m).max(1.0)).clamp(0.0, 1.0);
            albedo * (sun + sky.ambient(normal, 0.75)) * (0.55 + 0.45 * up)
        }
        Surface::Ground => {
            normal = world.ground.normal(place.x, place.y);
            let [open_sky, _] = lights.sky_light.at(place + UP * 0.3);
            let albedo = ground_color::ground(world, place, normal, px_m, open_sky);
            if px_m < 0.4 {
                let bump = |d: f32, layer: i32| {
                    let at = |x: f32, y: f32| noise::smooth_level(x / d, y / d, layer);
                    let here = at(place.x, place.y);
                    let east = at(place.x + 0.2 * d, place.y) - here;
                    let north = at(place.x, place.y + 0.2 * d) - here;
                    vec3(-east, -north, 0.0)
                };
                normal = (normal + bump(0.35, 21) * 0.8 + bump(0.08, 22) * 0.9).normalize_or(UP);
            }
            matte(lights, albedo, place, normal, 1.0, 0.02, word)
        }
        Surface::Grass => {
            // what grows in the shade stays green
            let [open_sky, _] = lights.sky_light.at(place);
            let dryness =
                ground_color::dryness(world, place.x, place.y) * smoothstep(open_sky * 1.25);
            let albedo = ground_color::grass(dryness, variation, world.season);
            let up = (normal * 0.4 + UP).normalize_or(UP);
            leaf(lights, albedo, place, up, ray, openness, 0.05, word)
        }
        Surface::Litter => {
            let albedo = ground_color::litter(variation) * (0.7 + 0.6 * openness);
            matte(lights, albedo, place, normal, 1.0, 0.03, word)
        }
        Surface::Part(material) => {
            let item = &items[sample.item as usize];
            let albedo = world.color(item, material);
            let radius_m = 0.5 * (item.axes[0].length() + item.axes[1].length());
            match material {
                Material::Foliage => {
                    let [a, b, _, _] = noise::four(noise::hash2(u32::from(sample.variation), 77));
                    let fresh = vec3(1.10, 1.05, 0.84);
                    let hue = vec3(1.0, 1.0, 1.0).lerp(fresh, (a - 0.35).max(0.0));
                    let albedo = albedo * hue * (0.78 + 0.44 * b);
                    let reach_m = 0.10 * radius_m + 0.1;
                    leaf(lights, albedo, place, normal, ray, openness, reach_m, word)
                }
                Material::Bark | Material::Wood => {
                    let albedo = bark(albedo, place, item, material, px_m);
                    let mossy =
                        moss(albedo, place, normal, item, material, world.decay_class(item));
                    matte(lights, mossy, place, normal, 1.0, 0.06, word)
                }
                Material::Soil => {
                    let grain = noise::smooth(place / 0.12);
                    matte(lights, albedo * (0.6 + 0.8 * grain), place, normal, 1.0, 0.06, word)
                }
            }
        }
    }
}

/// Light from a rough surface.
fn matte(
    lights: &Lights<'_>,
    albedo: Vec3,
    place: Vec3,
    normal: Vec3,
    openness: f32,
    reach_m: f32,
    word: u32,
) -> Vec3 {
    let sky = lights.sky;
    let [open_sky, deep_sun] = lights.sky_light.at(place + normal * 0.3);
    let facing = normal.dot(sky.sun).max(0.0);
    let lit = if facing > 0.0 { lights.shadows.sunlit(place, normal, reach_m, word) } else { 0.0 };
    let sun = sky.sun_light * (facing * lit);
    let share = LEAST_SKY + (1.0 - LEAST_SKY) * open_sky;
    // light that sunny ground and leaves throw back
    let bounce = vec3(0.20, 0.22, 0.10) * (0.35 * deep_sun + 0.10 * open_sky);
    albedo * (sun + sky.ambient(normal, share * openness) + bounce)
}

/// Light from a leaf: soft around edges, brighter against the sun.
#[allow(clippy::too_many_arguments, reason = "each is one thing that light depends on")]
fn leaf(
    lights: &Lights<'_>,
    albedo: Vec3,
    place: Vec3,
    normal: Vec3,
    ray: Vec3,
    openness: f32,
    reach_m: f32,
    word: u32,
) -> Vec3 {
    let sky = lights.sky;
    let [open_sky, deep_sun] = lights.sky_light.at(place + normal * 0.2);
    let lit = lights.shadows.sunlit(place, normal, reach_m, word);
    // leaves in front of the one that a depth map holds let some sun through
    let reached = (0.86 * lit + 0.14 * deep_sun) * (0.35 + 0.65 * openness);
    let cosine = normal.dot(sky.sun);
    let front = ((cosine + LEAF_WRAP) / (1.0 + LEAF_WRAP)).max(0.0);
    let back = (0.35 - 0.65 * cosine).max(0.0);
    let toward = ray.dot(sky.sun).max(0.0);
    let glow = back * (0.22 + 1.1 * toward * toward * toward);
    let sun = sky.sun_light * reached;
    let share = (LEAST_SKY + (1.0 - LEAST_SKY) * open_sky) * (0.25 + 0.75 * openness * openness);
    let bounce = vec3(0.16, 0.22, 0.07) * ((0.4 * deep_sun + 0.12 * open_sky) * openness);
    let reflected = albedo * (sun * front + sky.ambient(normal, share) + bounce);
    let passed = albedo * LEAF_PASSES * sun * glow;
    // waxy leaves mirror a little of sun and sky
    let half = (sky.sun - ray).normalize_or(UP);
    let mirror = half.dot(normal).max(0.0);
    let mirror = mirror * mirror * mirror * mirror;
    let gloss = sun * (0.006 * mirror * mirror) + sky.sky_light * (0.004 * share);
    reflected + passed + gloss
}

/// Bark and wood with their furrows.
fn bark(albedo: Vec3, place: Vec3, item: &Item, material: Material, px_m: f32) -> Vec3 {
    if px_m > 0.06 {
        return albedo;
    }
    // furrows run along the stem: stretched noise in the model's frame
    let axis =
        if item.axes[0].length() > item.axes[2].length() { item.axes[0] } else { item.axes[2] };
    let axis = axis.normalize_or(UP);
    let local = place - item.position;
    let along = local.dot(axis);
    let across = local - axis * along;
    let stretch = if material == Material::Bark { 0.11 } else { 0.05 };
    let wander = noise::smooth(local / 0.22) * 0.075 + noise::smooth(local / 0.03) * 0.012;
    let across = across + axis.cross(vec3(0.3, 0.5, 0.8)) * wander;
    let furrow = noise::smooth(across / 0.042 + axis * (along * stretch / 0.042));
    // ridges between dark furrows
    let ridge = 1.0 - (2.0 * furrow - 1.0).abs();
    let plate = noise::smooth(across / 0.16 + axis * (along * 0.35 / 0.16));
    let grain = noise::smooth(local / 0.018);
    let dark = (1.0 - ridge * ridge * ridge * 0.80).max(0.0);
    albedo * (0.28 + 0.64 * dark + 0.36 * plate + 0.55 * (grain - 0.5))
}

/// Moss on wood that lies or stands damp, on what faces up.
fn moss(
    albedo: Vec3,
    place: Vec3,
    normal: Vec3,
    item: &Item,
    material: Material,
    decay_class: u8,
) -> Vec3 {
    let is_lying = item.axes[0].length() > 1.5 * item.axes[2].length();
    let reach = if is_lying {
        0.55
    } else {
        0.9 - 1.5 * (place.z - item.position.z) // the foot of a stem
    };
    let patch = noise::smooth(place / 0.3) + 0.4 * noise::smooth(place / 0.06) - 0.7;
    let up = if is_lying { normal.z } else { 0.4 };
    let soft = if material == Material::Wood { 0.9 } else { 1.0 };
    let age = 0.25 * (f32::from(decay_class) - 2.0).max(0.0);
    let share =
        smoothstep((reach * up + 0.7 * patch + if is_lying { age } else { 0.0 }) * 1.6) * soft;
    let damp = if is_lying { albedo * 0.62 } else { albedo };
    damp.lerp(vec3(0.046, 0.070, 0.014), share.clamp(0.0, 1.0) * 0.94)
}
