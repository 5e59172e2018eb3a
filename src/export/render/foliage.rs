//! Foliage: leaves and sprays strewn over the surfaces that models have for crowns, as many as the picture can show.
//!
//! Models end at clumps and tiers. Drawn as they are they look cast from plastic; here each of their triangles bears leaves, as large
//! as leaves are or as the picture's pixels ask for, over a darker inside.

use super::camera::Camera;
use super::draw_list::Item;
use super::noise;
use super::surface_buffer::{Corner, Ink, Surface, SurfaceBuffer};
use super::vector::{UP, Vec3, vec3};
use crate::species::{Form, Leaf, Species};
use crate::tree::mesh::{Material, MeshPart};

/// Least length of a leaf in pixels. chosen: smaller ones cost time and flicker.
const LEAST_LEAF_PX: f32 = 2.6;
/// How often leaves cover the surface they are strewn over. chosen: the inside shows through here and there.
const COVER: f32 = 1.5;
/// Most leaves a triangle bears. chosen: far more than any needs; bounds the work on degenerate models.
pub const MOST_LEAVES: f32 = 6000.0;
/// Width of boughs in crown radii.
const LUMP: f32 = 0.34;
/// How much the slope of boughs tilts leaves. chosen: boughs look round.
pub const LUMP_TILT: f32 = 2.1;
/// Light that comes through to the inside of a clump, 0–255. chosen: dark, not black.
const INSIDE_OPENNESS: f32 = 110.0;

/// From this length on leaves have a rounded outline instead of a kite's.
const ROUND_LEAF_PX: f32 = 9.0;
/// A leaf's outline along its axis and across, from its stalk: halves of its length and width.
const OUTLINE: [[f32; 2]; 6] =
    [[-1.0, 0.0], [-0.35, 1.0], [0.35, 0.72], [1.0, 0.0], [0.35, -0.72], [-0.35, -1.0]];
/// From this crown radius on leaves stand alone: seen so near, a closed inside looks cut from paper.
const OPEN_CROWN_PX: f32 = 110.0;
/// How often leaves then cover the surface they are strewn about.
const OPEN_COVER: f32 = 2.3;

/// How leaves of a species look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeafLook {
    /// Length of a leaf, or of the spray that a twig's needles form, m.
    pub length_m: f32,
    /// Its width over its length.
    pub width: f32,
    /// How far leaves stand off the surface, in crown radii.
    pub fringe: f32,
    /// How far they hang, 0 not at all.
    pub droop: f32,
    /// How far boughs stand out of the crown's outline, in crown radii.
    pub lumpiness: f32,
    /// Whether these are twigs without leaves, which one sees through.
    pub is_bare: bool,
}

impl LeafLook {
    /// Twigs of a broadleaf in winter. chosen: as wide as a tenth of their length with their buds and side twigs, so that from the air a
    /// bare wood is a brown haze.
    pub const TWIGS: Self = Self {
        length_m: 0.45,
        width: 0.07,
        fringe: 0.05,
        droop: 0.0,
        lumpiness: 0.3,
        is_bare: true,
    };

    /// How leaves of a species look. chosen: sizes of leaves with their twigs, as one tells them apart from some metres off.
    pub fn of(species: &Species) -> Self {
        match (species.leaf, species.form) {
            (Leaf::Needle, Form::Tree) => Self {
                length_m: 0.17,
                width: 0.26,
                fringe: 0.045,
                droop: 0.35,
                lumpiness: 0.20,
                is_bare: false,
            },
            (Leaf::Needle, _) => Self {
                length_m: 0.07,
                width: 0.3,
                fringe: 0.06,
                droop: 0.1,
                lumpiness: 0.2,
                is_bare: false,
            },
            (Leaf::Frond, _) => Self {
                length_m: 0.09,
                width: 0.3,
                fringe: 0.03,
                droop: 0.2,
                lumpiness: 0.0,
                is_bare: false,
            },
            (Leaf::Broad, Form::Herb) => Self {
                length_m: 0.04,
                width: 0.7,
                fringe: 0.08,
                droop: 0.0,
                lumpiness: 0.1,
                is_bare: false,
            },
            (Leaf::Broad, Form::Tree) => Self {
                length_m: 0.11,
                width: 0.62,
                fringe: 0.05,
                droop: 0.1,
                lumpiness: 0.50,
                is_bare: false,
            },
            (Leaf::Broad, _) => Self {
                length_m: 0.075,
                width: 0.6,
                fringe: 0.07,
                droop: 0.1,
                lumpiness: 0.34,
                is_bare: false,
            },
        }
    }
}

/// Ground area that stands for one leaf when they are counted, m². chosen: narrow leaves as if they were a third as wide as long, or
/// crowns of needles would take thousands.
pub fn leaf_area_m2(leaf_m: f32, width: f32) -> f32 {
    0.5 * leaf_m * leaf_m * width.max(0.34)
}

/// How one crown is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crown {
    /// Length of its leaves, as large as the picture's pixels ask for, m.
    pub leaf_m: f32,
    /// Ground area that stands for one leaf when they are counted, m².
    pub leaf_area_m2: f32,
    /// Whether it is large enough to bear leaves.
    pub is_leafy: bool,
    /// Whether leaves stand alone, without an inside.
    pub is_open: bool,
    /// Whether leaves have a rounded outline.
    pub is_round: bool,
    /// How far leaves stand off its surface, m.
    pub fringe_m: f32,
    /// Width of boughs, m.
    pub lump_m: f32,
    /// How far boughs reach out, m.
    pub lump_reach_m: f32,
    /// How far its inside lies within its surface, m.
    pub inset_m: f32,
    /// How often leaves cover its surface.
    pub cover: f32,
}

impl Crown {
    /// How a crown is drawn as far off as it is.
    pub fn of(camera: &Camera, item: &Item, look: &LeafLook) -> Self {
        let size = |axis: Vec3| axis.length();
        let crown_radius_m = 0.5 * (size(item.axes[0]) + size(item.axes[1]));
        let height_m = size(item.axes[2]);
        let px_per_m = camera.px_per_m(item.depth_m.max(0.3));
        // small plants have small leaves
        let natural_m = look.length_m.min(0.16 * crown_radius_m.min(height_m) + 0.01);
        let least_m = LEAST_LEAF_PX / px_per_m;
        // steps of a quarter keep leaves in place while a camera moves a little
        let mut leaf_m = natural_m;
        while leaf_m < least_m {
            leaf_m *= 1.25;
        }
        let is_leafy = leaf_m < 0.55 * crown_radius_m;
        let fringe_m = if is_leafy { look.fringe * crown_radius_m + 0.4 * leaf_m } else { 0.0 };
        let lump_reach_m = look.lumpiness * crown_radius_m;
        let is_open =
            look.is_bare || is_leafy && crown_radius_m.min(height_m) * px_per_m > OPEN_CROWN_PX;
        Self {
            leaf_m,
            leaf_area_m2: leaf_area_m2(leaf_m, look.width),
            is_leafy,
            is_open,
            is_round: leaf_m * px_per_m >= ROUND_LEAF_PX,
            fringe_m,
            lump_m: (LUMP * crown_radius_m).max(2.5 * leaf_m),
            lump_reach_m,
            inset_m: if is_leafy { 0.6 * fringe_m + 0.45 * lump_reach_m } else { 0.0 },
            cover: if is_open { OPEN_COVER } else { COVER },
        }
    }
}

/// Draws a crown's surface.
pub fn draw(
    buffer: &mut SurfaceBuffer,
    camera: &Camera,
    item: &Item,
    item_place: u32,
    part: &MeshPart,
    look: &LeafLook,
    corners: &mut Vec<Corner>,
) {
    let crown = Crown::of(camera, item, look);
    let Crown { leaf_m, fringe_m, lump_m, lump_reach_m, inset_m, cover, .. } = crown;
    let Crown { is_leafy, is_open, is_round, .. } = crown;
    let seed = noise::hash2(item.group, item.index);
    let lump_offset = vec3(f32::from(seed as u8), f32::from((seed >> 8) as u8), 0.0); // low bytes
    corners.clear();
    corners.extend(part.positions.iter().zip(&part.normals).map(|(position, normal)| {
        let normal = item.normal(*normal);
        let place = item.place(*position) - normal * inset_m;
        Corner { view: camera.view(place), normal }
    }));
    let window = buffer.window;
    let is_near = camera.is_perspective();
    for (number, triangle) in part.triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|i| corners[i as usize]);
        let word = noise::hash2(seed, number as u32); // models have some thousand triangles
        let depth_m = a.view.z.min(b.view.z).min(c.view.z);
        if is_near && depth_m < 0.25 {
            continue; // leaves that touch the lens hide the forest
        }
        let projected = [a, b, c].map(|corner| camera.project_view(corner.view));
        let slack_px = 1.0 + (2.0 * (fringe_m + leaf_m) + lump_reach_m) * camera.px_per_m(depth_m);
        let low = |f: fn(f32, f32) -> f32, v: [f32; 3]| f(f(v[0], v[1]), v[2]);
        let xs = projected.map(|p| p.x);
        let ys = projected.map(|p| p.y);
        let rect = [
            low(f32::min, xs) - slack_px,
            low(f32::min, ys) - slack_px,
            low(f32::max, xs) + slack_px,
            low(f32::max, ys) + slack_px,
        ];
        let nearest = if is_near {
            1.0 / (depth_m - fringe_m - leaf_m - lump_reach_m).max(0.2)
        } else {
            fringe_m + leaf_m + lump_reach_m - depth_m
        };
        if buffer.hides(rect, nearest) {
            continue;
        }
        // the inside
        let openness = if is_leafy { INSIDE_OPENNESS } else { 255.0 } as u8; // whole numbers
        let surface = Surface::Part(Material::Foliage);
        let ink = Ink { item: item_place, surface, variation: (word >> 24) as u8, openness };
        if !is_open {
            buffer.flat(projected, [a.normal, b.normal, c.normal], ink, |_, _, _| true);
        }
        if !is_leafy {
            continue;
        }
        let across = (b.view - a.view).cross(c.view - a.view);
        let area_m2 = 0.5 * across.length();
        let expected = cover * area_m2 / crown.leaf_area_m2;
        let count = (expected.min(MOST_LEAVES) + noise::unit(word)) as u32; // small, and not negative
        for k in 0..count {
            let [r, s, t, u] = noise::four(noise::hash2(word, k));
            let (wb, wc) = if r + s > 1.0 { (1.0 - r, 1.0 - s) } else { (r, s) };
            let base = a.view + (b.view - a.view) * wb + (c.view - a.view) * wc;
            // most leaves of a large triangle are in other tiles
            let at = camera.project_view(base);
            let reach_px = [at.x - slack_px, at.y - slack_px, at.x + slack_px, at.y + slack_px];
            if !window.touches(reach_px) {
                continue;
            }
            let normal = (a.normal + (b.normal - a.normal) * wb + (c.normal - a.normal) * wc)
                .normalize_or(UP);
            let noise_word = noise::hash2(word ^ 0x5bd1, k);
            let random = noise::direction(noise_word);
            let outward =
                vec3(normal.dot(camera.right), normal.dot(camera.up), normal.dot(camera.forward));
            let gravity = vec3(0.0, -camera.up.z, -camera.forward.z);
            // crowns are lumpy: boughs reach out, and dark is between them
            let world_base =
                camera.eye + camera.right * base.x + camera.up * base.y + camera.forward * base.z;
            let lump_at = (world_base - item.position) / lump_m + lump_offset;
            let (lump, slope) = noise::smooth_with_slope(lump_at);
            let tilted = (normal - slope * (look.lumpiness * LUMP_TILT)).normalize_or(UP);
            let lift_m = fringe_m * (0.6 + 1.6 * t - 0.6 * (1.0 - u) * t)
                + lump_reach_m * (1.4 * lump - 0.35).max(0.0); // no leaf lies behind the inside
            let middle = base + outward * lift_m;
            if is_near && middle.z < 0.3 {
                continue;
            }
            let axis =
                (outward * 0.7 + random + gravity * look.droop).normalize_or(UP) * (0.5 * leaf_m);
            let side =
                axis.cross(outward * 0.4 + noise::direction(noise_word ^ 0x9e37)).normalize_or(UP)
                    * (0.5 * leaf_m * look.width);
            let leaf_normal = side.cross(axis).normalize_or(UP);
            let leaf_world = camera.right * leaf_normal.x
                + camera.up * leaf_normal.y
                + camera.forward * leaf_normal.z;
            let facing = if leaf_world.dot(normal) < 0.0 { -leaf_world } else { leaf_world };
            let shading = (tilted * 0.66 + facing * 0.34).normalize_or(UP);
            let depth_share = (0.30 * t + 1.7 * (lump - 0.22)).clamp(0.0, 1.0);
            let ink = Ink {
                variation: (noise_word >> 16) as u8,
                openness: (70.0 + 185.0 * depth_share) as u8, // within 70..=255
                ..ink
            };
            let normals = [shading; 3];
            let points = OUTLINE
                .map(|[along, across]| camera.project_view(middle + axis * along + side * across));
            if !is_round {
                for [p, q, r] in [[0, 1, 3], [0, 3, 5]] {
                    buffer.flat([points[p], points[q], points[r]], normals, ink, |_, _, _| true);
                }
            } else {
                for [p, q, r] in [[0, 1, 5], [1, 2, 5], [2, 4, 5], [2, 3, 4]] {
                    buffer.flat([points[p], points[q], points[r]], normals, ink, |_, _, _| true);
                }
            }
        }
    }
}
