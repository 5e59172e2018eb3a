//! What bare ground looks like: soil, litter, grass, stones, by the maps of the forest floor and by slope.

use super::noise::smooth_level;
use super::vector::{Vec3, vec3};
use super::world::{Season, World};
use crate::math::smoothstep;

// chosen, all: linear light of dry surfaces, after photographs
const SOIL: Vec3 = vec3(0.072, 0.049, 0.031);
const LITTER_BROWN: Vec3 = vec3(0.092, 0.050, 0.024);
const LITTER_PALE: Vec3 = vec3(0.165, 0.105, 0.056);
const GRASS_GREEN: Vec3 = vec3(0.060, 0.098, 0.022);
const GRASS_STRAW: Vec3 = vec3(0.270, 0.205, 0.092);
const ROCK: Vec3 = vec3(0.250, 0.240, 0.220);
const MOSS: Vec3 = vec3(0.058, 0.085, 0.020);
/// Ground where colours stand for figures.
const NEUTRAL: Vec3 = vec3(0.105, 0.108, 0.112);

/// A fallen leaf's colour by a share 0..=1.
pub fn litter(share: f32) -> Vec3 {
    if share < 0.7 {
        LITTER_BROWN.lerp(LITTER_PALE, share / 0.7)
    } else {
        LITTER_PALE.lerp(vec3(0.21, 0.095, 0.028), (share - 0.7) / 0.3)
    }
}

/// A blade's colour where grass is `dryness` dry, 0 green to 1 straw.
pub fn grass(dryness: f32, variation: f32, season: Season) -> Vec3 {
    let dry = match season {
        Season::Summer => dryness,
        Season::Autumn => (dryness + 0.35).min(1.0),
        Season::Winter => 0.35 + 0.4 * dryness,
        Season::Spring => 0.15 * dryness,
    };
    let share = (dry + 0.5 * (variation - 0.5)).clamp(0.0, 1.0);
    GRASS_GREEN.lerp(GRASS_STRAW, share) * (0.75 + 0.5 * variation)
}

/// How dry grass is at a place, 0..=1.
pub fn dryness(world: &World<'_>, x: f32, y: f32) -> f32 {
    world.ground.dryness.as_ref().map_or(0.2, |field| field.at(x, y))
}

/// The ground's colour at a place with a normal that sees `open_sky` of the sky, in pixels of `px_m`.
pub fn ground(world: &World<'_>, place: Vec3, normal: Vec3, px_m: f32, open_sky: f32) -> Vec3 {
    let (x, y) = (place.x, place.y);
    if world.painted.is_some() {
        return NEUTRAL * (0.85 + 0.3 * smooth_level(x / 23.0, y / 23.0, 1));
    }
    let field = &world.ground;
    // grain that is finer than a pixel would only glitter
    let grain = |scale_m: f32, layer: i32| {
        if px_m > scale_m { 0.5 } else { smooth_level(x / scale_m, y / scale_m, layer) }
    };
    let broad = smooth_level(x / 23.0, y / 23.0, 1);
    let middle = grain(2.7, 2);
    let small = grain(0.45, 3);
    let fine = grain(0.09, 4);
    let grass_m = field.grass_m.as_ref().map_or(0.1, |grass| grass.at(x, y));
    let litterfall = field.litterfall.as_ref().map_or(0.2, |litter| litter.at(x, y));

    let mottle = 0.72 + 0.26 * broad + 0.2 * middle + 0.22 * small + 0.2 * fine;
    let mut color = SOIL;
    let leaf_share =
        smoothstep((litterfall * 1.5 + 0.5 * (small - 0.5) + 0.3 * (fine - 0.5)) / 0.9);
    color = color.lerp(litter(0.15 + 0.75 * (0.5 * fine + 0.5 * small)), leaf_share);
    let cover = smoothstep((grass_m / 0.16 + 0.9 * (middle - 0.5) + 0.5 * (small - 0.5)).max(0.0));
    let dry = dryness(world, x, y) * smoothstep(open_sky * 1.25);
    let blades = grass(dry, 0.6 * small + 0.4 * fine, world.season);
    color = color.lerp(blades, cover * (1.0 - 0.35 * leaf_share));
    let damp = smoothstep((broad - 0.62) * 4.0) * (1.0 - cover) * 0.45;
    color = color.lerp(MOSS, damp * middle);
    // steeper than some 40° soil does not hold
    let steep = smoothstep((0.80 - normal.z + 0.10 * (middle - 0.5)) / 0.14);
    color = color.lerp(ROCK * (0.7 + 0.6 * small), steep);
    color * mottle
}

/// The colour of the terrain's cut side, `depth_m` below its surface.
pub fn wall(place: Vec3, depth_m: f32) -> Vec3 {
    let wave = smooth_level((place.x + place.y) / 31.0, place.z / 7.0, 9);
    let layer = smooth_level(0.3 * wave, place.z / 2.2, 10);
    let soil = vec3(0.050, 0.034, 0.022);
    let stone = vec3(0.088, 0.078, 0.066);
    let share = smoothstep((depth_m - 0.8) / 3.0);
    soil.lerp(stone, share) * (0.72 + 0.35 * layer + 0.2 * wave)
}
