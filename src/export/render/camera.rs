//! Cameras: from places in metres to places on the picture, and back.

use super::vector::{UP, Vec3, vec3};
use crate::math;

/// Nothing nearer than this is drawn, m. chosen: less than a hand's breadth, and far from where 1/z loses digits.
pub const NEAR_M: f32 = 0.08;

/// How rays run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Through the eye; pixels a unit of tangent.
    Perspective {
        /// Focal length in pixels.
        focal_px: f32,
    },
    /// All alike, as on maps and sections.
    Orthographic {
        /// Scale in pixels a metre.
        px_per_m: f32,
    },
}

/// Where one looks from, where to, and how large the picture is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The eye; with parallel rays the middle of the plane that depth counts from.
    pub eye: Vec3,
    /// Towards the picture's right side.
    pub right: Vec3,
    /// Towards its upper side.
    pub up: Vec3,
    /// Into it.
    pub forward: Vec3,
    /// How rays run.
    pub projection: Projection,
    /// Width and height in pixels.
    pub size_px: [f32; 2],
}

/// A place on the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Projected {
    /// Pixels from the left edge.
    pub x: f32,
    /// Pixels from the upper edge.
    pub y: f32,
    /// Larger is nearer, and straight over the picture along any plane: 1/depth, or −depth with parallel rays.
    pub nearness: f32,
}

impl Camera {
    /// A camera at `eye` that looks along azimuth (clockwise from north) and pitch (up positive), with a field of view
    /// `fov_rad` across the picture's width.
    pub fn perspective(
        eye: Vec3,
        azimuth_rad: f32,
        pitch_rad: f32,
        fov_rad: f32,
        size_px: [f32; 2],
    ) -> Self {
        let focal_px = 0.5 * size_px[0] / math::tan(0.5 * fov_rad);
        let [right, up, forward] = axes(azimuth_rad, pitch_rad);
        Self { eye, right, up, forward, projection: Projection::Perspective { focal_px }, size_px }
    }

    /// A camera with parallel rays; `eye` is in the middle of the picture.
    pub fn orthographic(
        eye: Vec3,
        azimuth_rad: f32,
        pitch_rad: f32,
        px_per_m: f32,
        size_px: [f32; 2],
    ) -> Self {
        let [right, up, forward] = axes(azimuth_rad, pitch_rad);
        let projection = Projection::Orthographic { px_per_m };
        Self { eye, right, up, forward, projection, size_px }
    }

    /// The same view in pixels `factor` times finer.
    pub fn finer(&self, factor: f32) -> Self {
        let projection = match self.projection {
            Projection::Perspective { focal_px } => {
                Projection::Perspective { focal_px: focal_px * factor }
            }
            Projection::Orthographic { px_per_m } => {
                Projection::Orthographic { px_per_m: px_per_m * factor }
            }
        };
        Self { projection, size_px: self.size_px.map(|s| s * factor), ..*self }
    }

    /// Metres to the right, up and into the picture.
    #[inline]
    pub fn view(&self, place: Vec3) -> Vec3 {
        let d = place - self.eye;
        vec3(d.dot(self.right), d.dot(self.up), d.dot(self.forward))
    }

    /// Where a place in view metres lies on the picture; with perspective its depth must not be 0.
    #[inline]
    pub fn project_view(&self, v: Vec3) -> Projected {
        let [width, height] = self.size_px;
        match self.projection {
            Projection::Perspective { focal_px } => {
                let nearness = 1.0 / v.z;
                let scale = focal_px * nearness;
                Projected { x: 0.5 * width + scale * v.x, y: 0.5 * height - scale * v.y, nearness }
            }
            Projection::Orthographic { px_per_m } => Projected {
                x: 0.5 * width + px_per_m * v.x,
                y: 0.5 * height - px_per_m * v.y,
                nearness: -v.z,
            },
        }
    }

    /// Where a place lies on the picture, `None` before the near plane.
    pub fn project(&self, place: Vec3) -> Option<Projected> {
        let v = self.view(place);
        let is_behind = self.is_perspective() && v.z < NEAR_M;
        (!is_behind).then(|| self.project_view(v))
    }

    /// Whether rays run through the eye.
    #[inline]
    pub fn is_perspective(&self) -> bool {
        matches!(self.projection, Projection::Perspective { .. })
    }

    /// The place that is drawn at a place of the picture.
    #[inline]
    pub fn place(&self, x: f32, y: f32, nearness: f32) -> Vec3 {
        let (dx, dy) = (x - 0.5 * self.size_px[0], 0.5 * self.size_px[1] - y);
        match self.projection {
            Projection::Perspective { focal_px } => {
                let depth_m = 1.0 / nearness;
                let s = depth_m / focal_px;
                self.eye + self.right * (dx * s) + self.up * (dy * s) + self.forward * depth_m
            }
            Projection::Orthographic { px_per_m } => {
                let s = 1.0 / px_per_m;
                self.eye + self.right * (dx * s) + self.up * (dy * s) - self.forward * nearness
            }
        }
    }

    /// Direction of the ray through a place of the picture, at length 1.
    #[inline]
    pub fn ray(&self, x: f32, y: f32) -> Vec3 {
        match self.projection {
            Projection::Perspective { focal_px } => {
                let (dx, dy) = (x - 0.5 * self.size_px[0], 0.5 * self.size_px[1] - y);
                (self.forward * focal_px + self.right * dx + self.up * dy).normalize_or(UP)
            }
            Projection::Orthographic { .. } => self.forward,
        }
    }

    /// Pixels a metre has at a depth.
    #[inline]
    pub fn px_per_m(&self, depth_m: f32) -> f32 {
        match self.projection {
            Projection::Perspective { focal_px } => focal_px / depth_m.max(NEAR_M),
            Projection::Orthographic { px_per_m } => px_per_m,
        }
    }

    /// The rectangle of the picture that a ball may touch: left, top, right, bottom in pixels; `None` if it is out of sight.
    pub fn bounds(&self, middle: Vec3, radius_m: f32) -> Option<[f32; 4]> {
        let v = self.view(middle);
        let [width, height] = self.size_px;
        let full = [0.0, 0.0, width, height];
        let rect = match self.projection {
            Projection::Perspective { focal_px } => {
                if v.z + radius_m < NEAR_M {
                    return None;
                }
                // beside the planes through the eye and the picture's edges
                let is_beside = |off_m: f32, half_px: f32| {
                    let slant = (focal_px * focal_px + half_px * half_px).sqrt();
                    off_m.abs() * focal_px - v.z * half_px > radius_m * slant
                };
                if is_beside(v.x, 0.5 * width) || is_beside(v.y, 0.5 * height) {
                    return None;
                }
                if v.z - radius_m < NEAR_M {
                    full
                } else {
                    let (near, far) = (focal_px / (v.z - radius_m), focal_px / (v.z + radius_m));
                    let low = |edge: f32| edge * if edge < 0.0 { near } else { far };
                    let high = |edge: f32| edge * if edge > 0.0 { near } else { far };
                    [
                        0.5 * width + low(v.x - radius_m),
                        0.5 * height - high(v.y + radius_m),
                        0.5 * width + high(v.x + radius_m),
                        0.5 * height - low(v.y - radius_m),
                    ]
                }
            }
            Projection::Orthographic { px_per_m } => [
                0.5 * width + px_per_m * (v.x - radius_m),
                0.5 * height - px_per_m * (v.y + radius_m),
                0.5 * width + px_per_m * (v.x + radius_m),
                0.5 * height - px_per_m * (v.y - radius_m),
            ],
        };
        let is_seen = rect[2] >= 0.0 && rect[0] < width && rect[3] >= 0.0 && rect[1] < height;
        is_seen.then_some(rect)
    }
}

/// Right, up and forward of a view along azimuth and pitch.
fn axes(azimuth_rad: f32, pitch_rad: f32) -> [Vec3; 3] {
    let (sin_a, cos_a) = (math::sin(azimuth_rad), math::cos(azimuth_rad));
    let (sin_p, cos_p) = (math::sin(pitch_rad), math::cos(pitch_rad));
    let forward = vec3(sin_a * cos_p, cos_a * cos_p, sin_p);
    let right = vec3(cos_a, -sin_a, 0.0);
    [right, right.cross(forward), forward]
}

/// Azimuth and pitch of the direction from one place to another; north and level where they are one.
pub fn direction_angles(from: Vec3, to: Vec3) -> [f32; 2] {
    let d = to - from;
    let level_m = d.dot(vec3(d.x, d.y, 0.0)).max(0.0).sqrt();
    if level_m == 0.0 && d.z == 0.0 {
        return [0.0, 0.0];
    }
    [math::atan2(d.x, d.y), math::atan2(d.dot(UP), level_m)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_point_comes_to_its_pixel() {
        // looking north from 10 m up; half the width of 200 px is tan 45° = 1
        let eye = vec3(5.0, 0.0, 10.0);
        let fov = std::f32::consts::FRAC_PI_2;
        let camera = Camera::perspective(eye, 0.0, 0.0, fov, [200.0, 100.0]);
        let p = camera.project(vec3(15.0, 40.0, 12.0)).unwrap();
        assert!((p.x - 125.0).abs() < 1e-3 && (p.y - 45.0).abs() < 1e-3, "{p:?}");
        assert!((p.nearness - 1.0 / 40.0).abs() < 1e-7);
        let back = camera.place(p.x, p.y, p.nearness);
        assert!((back - vec3(15.0, 40.0, 12.0)).length() < 1e-3, "{back:?}");
        assert_eq!(camera.project(vec3(5.0, -1.0, 10.0)), None);
        assert!((camera.ray(p.x, p.y) - vec3(10.0, 40.0, 2.0).normalize_or(UP)).length() < 1e-5);
    }

    #[test]
    fn parallel_rays_keep_sizes() {
        let down = -std::f32::consts::FRAC_PI_2;
        let camera = Camera::orthographic(vec3(50.0, 50.0, 100.0), 0.0, down, 4.0, [400.0, 400.0]);
        let p = camera.project(vec3(60.0, 75.0, 30.0)).unwrap();
        assert!((p.x - 240.0).abs() < 1e-3 && (p.y - 100.0).abs() < 1e-3, "{p:?}");
        assert!((p.nearness + 70.0).abs() < 1e-3);
    }

    #[test]
    fn balls_are_within_their_bounds() {
        let camera = Camera::perspective(Vec3::default(), 0.4, -0.2, 1.0, [640.0, 480.0]);
        let middle = camera.forward * 20.0 + camera.right * 3.0;
        let [left, top, right, bottom] = camera.bounds(middle, 2.0).unwrap();
        for d in [camera.right, camera.up, camera.forward, -camera.right, -camera.up] {
            let p = camera.project(middle + d * 2.0).unwrap();
            assert!(p.x >= left && p.x <= right && p.y >= top && p.y <= bottom);
        }
        assert_eq!(camera.bounds(camera.forward * -10.0, 2.0), None);
        assert_eq!(camera.bounds(camera.right * 100.0 + camera.forward, 2.0), None);
    }

    #[test]
    fn angles_lead_from_one_place_to_another() {
        let [azimuth, pitch] = direction_angles(Vec3::default(), vec3(3.0, 3.0, -3.0));
        let camera = Camera::perspective(Vec3::default(), azimuth, pitch, 1.0, [64.0, 64.0]);
        assert!((camera.forward - vec3(1.0, 1.0, -1.0).normalize_or(UP)).length() < 1e-6);
    }
}
