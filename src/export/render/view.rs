//! Views: where one looks from so that a whole tile, a spot in the forest, a section or a map fills the picture.

use super::camera::{Camera, NEAR_M, Projection, direction_angles};
use super::ground::Ground;
use super::ground_mesh;
use super::vector::{UP, Vec3, vec3};
use crate::export::instances::{FeatureTable, Instances};
use crate::math;

/// Field of view of aerial pictures. chosen: a short telephoto lens, which keeps far trees large.
const AERIAL_FOV_RAD: f32 = 0.56;
/// Field of view in the forest. chosen: a wide-angle lens of 26 mm, as one stands between trunks.
const FOREST_FOV_RAD: f32 = 1.15;
/// Height of the eye.
pub const EYE_HEIGHT_M: f32 = 1.7;
/// How far aerial pictures look down. chosen: crowns are seen from above and from the side.
const AERIAL_PITCH_RAD: f32 = -0.47;
/// Where aerial pictures look to. chosen: a little east of north, so that the morning's sun comes from the right.
pub const AERIAL_AZIMUTH_RAD: f32 = 0.34;
/// Share of the picture that the tile spans. chosen: a narrow margin.
const FILL: f32 = 0.955;
/// Height of the tile's middle in the picture, from its top. chosen: a little more air above than below.
const MIDDLE: f32 = 0.515;
/// Steps of centring. chosen: perspective makes each err a little, and all together by less than a pixel.
const CENTRINGS: usize = 4;
/// Places tried for the view in the forest, each way.
const SPOTS: usize = 28;
/// Directions tried at each.
const HEADINGS: usize = 12;
/// What a view loses that is hidden from edge to edge. chosen: more than tall trees and deadwood can win.
const HIDING: f32 = 14.0;

/// An aerial view of all that stands on the terrain, from an azimuth (of the direction one looks along).
pub fn overview(ground: &Ground, tallest_m: f32, azimuth_rad: f32, size_px: [f32; 2]) -> Camera {
    let [east, south] = ground.far_edges_m();
    let base_m = ground_mesh::base_m(ground);
    let mut corners = Vec::new();
    // the rim by its own heights: a box would leave room for peaks that are not there
    for k in 0..=8 {
        let t = k as f32 / 8.0;
        let x = ground.west_m + (east - ground.west_m) * t;
        let y = south + (ground.north_m - south) * t;
        for (x, y) in [(x, south), (x, ground.north_m), (ground.west_m, y), (east, y)] {
            let z = ground.height_m(x, y).unwrap_or(ground.range_m[0]);
            corners.push(vec3(x, y, z));
            corners.push(vec3(x, y, z + 0.8 * tallest_m));
            corners.push(vec3(x, y, base_m));
        }
    }
    let extent_m = ground.width_m().max(ground.depth_m());
    let target = ground.middle();
    let camera_at = |distance_m: f32, lift: f32| {
        let axis =
            Camera::perspective(target, azimuth_rad, AERIAL_PITCH_RAD, AERIAL_FOV_RAD, size_px);
        let eye = target - axis.forward * distance_m + axis.up * (lift * distance_m);
        Camera { eye, ..axis }
    };
    // first as near as the width allows, then centred on what is seen
    let reach = |camera: &Camera| {
        let mut bounds = [f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY];
        for corner in &corners {
            let p = camera.project(*corner)?;
            bounds =
                [bounds[0].min(p.x), bounds[1].min(p.y), bounds[2].max(p.x), bounds[3].max(p.y)];
        }
        Some(bounds)
    };
    let (mut near, mut far) = (0.3 * extent_m, 12.0 * extent_m);
    let mut best = camera_at(far, 0.0);
    for _ in 0..24 {
        let distance_m = 0.5 * (near + far);
        let mut camera = camera_at(distance_m, 0.0);
        let mut seen = reach(&camera);
        for _ in 0..CENTRINGS {
            let (Some([left, top, right, bottom]), Projection::Perspective { focal_px }) =
                (seen, camera.projection)
            else {
                break;
            };
            // move what is seen to the middle, by the angle that it is off
            let off_x = 0.5 * (left + right - size_px[0]);
            let off_y = 0.5 * (top + bottom) - MIDDLE * size_px[1];
            let scale = distance_m / focal_px;
            camera.eye += camera.right * (off_x * scale) - camera.up * (off_y * scale);
            seen = reach(&camera);
        }
        let fits = seen.is_some_and(|[left, top, right, bottom]| {
            let margin = 0.5 * (1.0 - FILL);
            left >= margin * size_px[0]
                && right <= (1.0 - margin) * size_px[0]
                && top >= margin * size_px[1]
                && bottom <= (1.0 - margin) * size_px[1]
        });
        if fits {
            best = camera;
            far = distance_m;
        } else {
            near = distance_m;
        }
    }
    best
}

/// A view from above, north up.
pub fn map(ground: &Ground, tallest_m: f32, size_px: [f32; 2]) -> Camera {
    let scale = (size_px[0] / ground.width_m()).min(size_px[1] / ground.depth_m());
    let middle = ground.middle();
    let eye = vec3(middle.x, middle.y, ground.range_m[1] + tallest_m + 10.0);
    Camera::orthographic(eye, 0.0, -std::f32::consts::FRAC_PI_2, scale, size_px)
}

/// A section seen from the south, with `below_m` and `above_m` of room under and over it.
pub fn profile(ground: &Ground, tallest_m: f32, size_px: [f32; 2]) -> Camera {
    let [low, high] = ground.range_m;
    let across_m = ground.width_m() * 1.02;
    let tall_m = (high - low) + tallest_m * 1.04 + 6.0;
    let scale = (size_px[0] / across_m).min(size_px[1] * 0.94 / tall_m);
    let middle = ground.middle();
    // the ground at the picture's foot
    let z = low - 5.0 + 0.5 * size_px[1] / scale;
    let [_, south] = ground.far_edges_m();
    Camera::orthographic(vec3(middle.x, south - 50.0, z), 0.0, 0.0, scale, size_px)
}

/// A camera that `eye` lifts to at least half a metre over the ground; whether it did.
pub fn over_ground(camera: Camera, ground: &Ground) -> (Camera, bool) {
    let floor_m =
        ground.height_m(camera.eye.x, camera.eye.y).map_or(f32::NEG_INFINITY, |z| z + 0.5);
    let [east, south] = ground.far_edges_m();
    let is_over = camera.eye.x >= ground.west_m
        && camera.eye.x <= east
        && camera.eye.y <= ground.north_m
        && camera.eye.y >= south;
    if is_over && camera.eye.z < floor_m {
        return (Camera { eye: vec3(camera.eye.x, camera.eye.y, floor_m), ..camera }, true);
    }
    (camera, false)
}

/// What stands or lies near a spot.
struct Neighbour {
    place: Vec3,
    radius_m: f32,
    height_m: f32,
    table: FeatureTable,
    azimuth_rad: f32,
}

/// A view in the forest from eye height: an open spot with tall trees and deadwood near, the best of many tried.
/// The sun, in the direction `sun`, stands to the side rather than behind.
pub fn forest_floor(
    ground: &Ground,
    instances: &Instances,
    sun: Vec3,
    size_px: [f32; 2],
) -> Camera {
    const CELL_M: f32 = 8.0;
    let [east, south] = ground.far_edges_m();
    let (width_m, depth_m) = (ground.width_m(), ground.depth_m());
    // some hundreds each way
    let cols = ((width_m / CELL_M).ceil() as usize).max(1);
    let rows = ((depth_m / CELL_M).ceil() as usize).max(1);
    let mut cells: Vec<Vec<Neighbour>> = Vec::new();
    cells.resize_with(rows * cols, Vec::new);
    let cell_of = |x: f32, y: f32| {
        let col = ((x - ground.west_m) / CELL_M).clamp(0.0, (cols - 1) as f32) as usize; // clamped
        let row = ((ground.north_m - y) / CELL_M).clamp(0.0, (rows - 1) as f32) as usize;
        row * cols + col
    };
    for group in &instances.groups {
        for i in 0..group.position_m.len() {
            let place = Vec3::from(group.position_m[i]);
            let [sx, _, sz] = group.scale[i];
            let axis = super::vector::turned(group.rotation[i], vec3(sx, 0.0, 0.0));
            let (radius_m, height_m) = match group.table {
                FeatureTable::DownedLogs => (0.5 * sx, sz),
                _ => (sx, sz),
            };
            if height_m < 0.15 {
                continue;
            }
            cells[cell_of(place.x, place.y)].push(Neighbour {
                place,
                radius_m,
                height_m,
                table: group.table,
                azimuth_rad: math::atan2(axis.x, axis.y),
            });
        }
    }
    let mut best = (f32::NEG_INFINITY, ground.middle(), 0.0_f32);
    for spot in 0..SPOTS * SPOTS {
        let u = 0.12 + 0.76 * ((spot % SPOTS) as f32 + 0.5) / SPOTS as f32;
        let v = 0.12 + 0.76 * ((spot / SPOTS) as f32 + 0.5) / SPOTS as f32;
        let x = ground.west_m + u * (east - ground.west_m);
        let y = south + v * (ground.north_m - south);
        let Some(z) = ground.height_m(x, y) else { continue };
        let here = vec3(x, y, z);
        let near: Vec<&Neighbour> = (-4..=4_i32)
            .flat_map(|dr| (-4..=4_i32).map(move |dc| (dr, dc)))
            .filter_map(|(dr, dc)| {
                let (px, py) = (x + dc as f32 * CELL_M, y + dr as f32 * CELL_M);
                let inside =
                    px >= ground.west_m && px <= east && py >= south && py <= ground.north_m;
                inside.then(|| cell_of(px, py))
            })
            .flat_map(|cell| &cells[cell])
            .collect();
        for heading in 0..HEADINGS {
            let azimuth = heading as f32 * std::f32::consts::TAU / HEADINGS as f32;
            let along = math::sin(azimuth) * sun.x + math::cos(azimuth) * sun.y;
            // light from the side, or a little against it
            let light = 1.2 - (along - 0.25).abs();
            let hidden = hidden_share(here, azimuth, &near);
            let score = spot_score(here, azimuth, &near, ground) + light - HIDING * hidden;
            if score > best.0 {
                best = (score, here, azimuth);
            }
        }
    }
    let (_, here, azimuth) = best;
    let eye = here + UP * EYE_HEIGHT_M;
    // along the ground some way off, a little up to the trunks
    let reach_m = 18.0;
    let ahead =
        vec3(here.x + reach_m * math::sin(azimuth), here.y + reach_m * math::cos(azimuth), 0.0);
    let z = ground.height_m(ahead.x, ahead.y).unwrap_or(here.z);
    let target = vec3(ahead.x, ahead.y, z + 2.4);
    let [azimuth_rad, pitch_rad] = direction_angles(eye, target);
    Camera::perspective(eye, azimuth_rad, pitch_rad.clamp(-0.25, 0.25), FOREST_FOV_RAD, size_px)
}

/// Fields across the view that are told apart when asked how far one sees.
const SIGHT_FIELDS: usize = 24;
/// From this distance on a shrub hides little, m.
const SIGHT_M: f32 = 14.0;

/// Share of a view that low plants before it hide, 0..=1: tall ones close by the most, those at [`SIGHT_M`] nothing.
fn hidden_share(here: Vec3, azimuth_rad: f32, near: &[&Neighbour]) -> f32 {
    let mut hidden = [0.0_f32; SIGHT_FIELDS];
    let field = FOREST_FOV_RAD / SIGHT_FIELDS as f32;
    for neighbour in near {
        let d = neighbour.place - here;
        let distance_m = (d.x * d.x + d.y * d.y).sqrt().max(NEAR_M);
        // taller trees have their crowns above one's head
        let is_low = neighbour.table == FeatureTable::Plants && neighbour.height_m < 12.0;
        if !is_low || distance_m > SIGHT_M {
            continue;
        }
        // what ends below the horizon hides the ground only
        let top = (d.z + neighbour.height_m - EYE_HEIGHT_M) / distance_m;
        let weight = (0.5 + 2.0 * top).clamp(0.0, 1.0) * (1.0 - distance_m / SIGHT_M);
        let turn = math::atan2(d.x, d.y) - azimuth_rad;
        let off = turn - std::f32::consts::TAU * (turn / std::f32::consts::TAU).round();
        let half = math::atan2(neighbour.radius_m, distance_m);
        let place = |angle: f32| (angle + 0.5 * FOREST_FOV_RAD) / field;
        // fields within the view, those that are covered in part too
        let (first, last) = (place(off - half).max(0.0) as usize, place(off + half).max(0.0));
        for share in hidden.iter_mut().take(last.ceil() as usize).skip(first) {
            *share = share.max(weight);
        }
    }
    hidden.iter().sum::<f32>() / SIGHT_FIELDS as f32
}

/// How good a spot is to look from along an azimuth.
fn spot_score(here: Vec3, azimuth_rad: f32, near: &[&Neighbour], ground: &Ground) -> f32 {
    let forward = vec3(math::sin(azimuth_rad), math::cos(azimuth_rad), 0.0);
    let mut score = 0.0;
    let (mut trees, mut dead) = (0.0_f32, 0.0_f32);
    for neighbour in near {
        let d = neighbour.place - here;
        let level = vec3(d.x, d.y, 0.0);
        let distance_m = level.length().max(NEAR_M);
        let ahead = level.dot(forward) / distance_m;
        let height_m = neighbour.height_m;
        match neighbour.table {
            FeatureTable::Plants => {
                // nothing in one's face
                let gap_m = distance_m - neighbour.radius_m;
                if height_m > 0.5 && height_m < 9.0 && gap_m < 1.2 {
                    score -= 6.0;
                }
                if height_m > 9.0 && distance_m < 2.5 {
                    score -= 8.0;
                }
                if height_m > 3.0 && distance_m < 6.0 && ahead > 0.6 {
                    score -= 0.8 * (6.0 - distance_m);
                }
                if ahead > 0.80 {
                    if height_m > 1.2 && height_m < 8.0 && distance_m < 16.0 {
                        score -= 1.4 * neighbour.radius_m.min(2.0) * (1.0 - distance_m / 16.0);
                    }
                    if height_m > 14.0 && distance_m > 4.0 && distance_m < 30.0 {
                        trees += (height_m / 25.0) * (1.0 - distance_m / 38.0);
                    }
                }
            }
            FeatureTable::Snags => {
                if height_m > 0.5 && distance_m - neighbour.radius_m < 1.2 {
                    score -= 6.0;
                }
                if ahead > 0.85 && distance_m > 4.0 && distance_m < 25.0 && height_m > 2.0 {
                    dead += 0.7;
                }
            }
            FeatureTable::DownedLogs => {
                // nor a trunk that one stands on, or that hides the rest
                let along =
                    vec3(math::sin(neighbour.azimuth_rad), math::cos(neighbour.azimuth_rad), 0.0);
                let nearest =
                    level + along * (-level.dot(along)).clamp(0.0, 2.0 * neighbour.radius_m);
                if nearest.length() < 1.5 + 4.0 * height_m {
                    score -= 5.0;
                }
                let is_long = neighbour.radius_m > 1.5 && height_m > 0.18;
                if ahead > 0.85 && distance_m > 3.5 && distance_m < 15.0 && is_long {
                    // one across the view is seen best
                    let across = math::sin(neighbour.azimuth_rad - azimuth_rad).abs();
                    dead += (0.4 + height_m.min(0.8)) * (0.4 + 0.6 * across);
                }
            }
        }
    }
    score += 3.0 * (1.0 - math::exp(-0.45 * trees)) + 6.5 * (1.0 - math::exp(-0.5 * dead));
    let normal = ground.normal(here.x, here.y);
    // level ground, and none that rises before one's nose
    score - 4.0 * (1.0 - normal.z) * 4.0 + 1.5 * forward.dot(normal).min(0.3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Grid;

    #[test]
    fn presets_are_finite_and_hold_the_tile() {
        for (rows, cols) in [(50, 50), (20, 90), (2, 3)] {
            let grid = Grid::from_fn(rows, cols, 2.0, |c| (c.row as f32 * 0.7).rem_euclid(11.0));
            let ground = Ground::new(&grid, [0.0; 3]);
            let size = [640.0, 360.0];
            let forest = Instances::default();
            let cameras = [
                overview(&ground, 30.0, AERIAL_AZIMUTH_RAD, size),
                map(&ground, 30.0, size),
                profile(&ground, 30.0, size),
                forest_floor(&ground, &forest, vec3(0.6, 0.0, 0.8), size),
            ];
            for camera in cameras {
                assert!(
                    [camera.eye, camera.right, camera.up, camera.forward]
                        .iter()
                        .all(|v| v.is_finite())
                );
                assert!((camera.forward.length() - 1.0).abs() < 1e-4);
            }
            let [east, south] = ground.far_edges_m();
            for camera in &cameras[..3] {
                for (x, y) in
                    [(0.0, south), (0.0, ground.north_m), (east, south), (east, ground.north_m)]
                {
                    let p = camera.project(vec3(x, y, ground.height_m(x, y).unwrap())).unwrap();
                    assert!(p.x >= -0.5 && p.x <= 640.5 && p.y >= -0.5 && p.y <= 360.5, "{p:?}");
                }
            }
        }
    }

    #[test]
    fn shrubs_before_the_eye_hide_a_view() {
        let shrub = |north_m: f32, height_m: f32| Neighbour {
            place: vec3(0.0, north_m, 0.0),
            radius_m: 2.0,
            height_m,
            table: FeatureTable::Plants,
            azimuth_rad: 0.0,
        };
        let share = |neighbour: &Neighbour, azimuth_rad: f32| {
            hidden_share(Vec3::default(), azimuth_rad, &[neighbour])
        };
        let near = share(&shrub(2.5, 3.0), 0.0);
        assert!(near > 0.6 && near <= 1.0, "{near}");
        assert!(share(&shrub(10.0, 3.0), 0.0) < 0.3 * near);
        assert_eq!(share(&shrub(2.5, 0.3), 0.0), 0.0, "herbs hide the ground only");
        assert_eq!(share(&shrub(2.5, 3.0), std::f32::consts::PI), 0.0, "behind one's back");
        assert!(
            (share(&shrub(-2.5, 3.0), std::f32::consts::PI) - near).abs() < 0.06,
            "across ±180°"
        );
    }

    #[test]
    fn eyes_under_the_ground_are_lifted() {
        let grid = Grid::from_fn(10, 10, 1.0, |_| 7.0);
        let ground = Ground::new(&grid, [0.0; 3]);
        let below = Camera::perspective(vec3(5.0, 5.0, 3.0), 0.0, 0.0, 1.0, [64.0, 64.0]);
        let (lifted, was_below) = over_ground(below, &ground);
        assert!(was_below && (lifted.eye.z - 7.5).abs() < 1e-5);
        assert!(!over_ground(lifted, &ground).1);
    }
}
