//! Lighting: the depth maps and the lattice of light that a view needs.

use super::camera::Camera;
use super::painter::Painter;
use super::shadow::Shadows;
use super::sky::Sky;
use super::sky_light::SkyLight;
use super::vector::{Vec3, vec3};
use super::world::World;
use crate::gpu::GpuError;

/// Balls of the finest shadows around what is near the eye: how far ahead their middles are, their radii in m, and texels a side. chosen:
/// leaves cast shadows underfoot, branches to the middle distance.
const NEAR_BALLS: [(f32, f32, u32); 2] = [(13.0, 17.0, 2048), (62.0, 78.0, 2560)];
/// Texels a side over all of a scene.
const WHOLE_TEXELS: u32 = 4096;
/// From how far off, in radii of the scene, a view needs no finer shadows.
const FAR_RADII: f32 = 0.9;
/// How far the lattice reaches around a view in the forest, m.
const LATTICE_REACH_M: f32 = 150.0;

/// The light of a view.
pub struct Lighting {
    /// The sky.
    pub sky: Sky,
    /// Shadows.
    pub shadows: Shadows,
    /// Light among crowns.
    pub sky_light: SkyLight,
}

/// Middle and radius of all that can cast a shadow.
pub fn whole(world: &World<'_>) -> (Vec3, f32) {
    let ground = &world.ground;
    let [low, high] = ground.range_m;
    let top = high + world.tallest_m;
    let middle = ground.middle();
    let half = vec3(0.5 * ground.width_m(), 0.5 * ground.depth_m(), 0.5 * (top - low));
    (vec3(middle.x, middle.y, 0.5 * (low + top)), half.length() + 2.0)
}

/// Whether a view is so far off that all of the scene looks alike to it.
pub fn is_far(world: &World<'_>, camera: &Camera) -> bool {
    let (middle, radius_m) = whole(world);
    !camera.is_perspective() || (camera.eye - middle).length() > FAR_RADII * radius_m
}

/// From which distance on a view shows haze: that of the nearest part of a scene seen from afar.
pub fn clear_m(world: &World<'_>, camera: &Camera) -> f32 {
    let (middle, radius_m) = whole(world);
    if is_far(world, camera) { ((camera.eye - middle).length() - radius_m).max(0.0) } else { 0.0 }
}

impl Lighting {
    /// The light of a sky on a world, as a view needs it; far views of one world share theirs.
    ///
    /// # Errors
    /// If a graphics card is the painter and fails.
    pub fn new(
        world: &World<'_>,
        sky: Sky,
        camera: &Camera,
        painter: &mut Painter,
    ) -> Result<Self, GpuError> {
        let (middle, radius_m) = whole(world);
        let mut balls = Vec::new();
        let is_far = is_far(world, camera);
        if !is_far {
            let near = NEAR_BALLS.iter().filter(|(_, ball_m, _)| *ball_m < radius_m);
            balls.extend(near.map(|&(ahead_m, ball_m, side)| {
                (camera.eye + camera.forward * ahead_m, ball_m, side)
            }));
        }
        balls.push((middle, radius_m * 1.05, WHOLE_TEXELS));
        let shadows = Shadows::new(world, sky.sun, &balls, painter)?;
        let sky_light = if is_far {
            SkyLight::new(world, sky.sun, middle, f32::INFINITY)
        } else {
            let ahead = camera.eye + camera.forward * (0.4 * LATTICE_REACH_M);
            SkyLight::new(world, sky.sun, ahead, LATTICE_REACH_M)
        };
        Ok(Self { sky, shadows, sky_light })
    }
}
