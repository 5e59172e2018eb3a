//! A flat scene on the round Earth: where its metres lie on the WGS 84 ellipsoid.
//!
//! Elevations are taken as heights above the ellipsoid. The scene's root is a rigid frame at its origin: x along the map's east, so
//! that grid convergence is part of it, z up. Within it the map's metres are bent: by the map's scale, by the Earth's curvature
//! (0.8 m at 3 km) and by how much the vertical turns.
//!
//! # Reference
//! Geodetic to geocentric coordinates: IOGP 373-7-2 (2019), §4.1.1 (EPSG method 9602).

use glam::{DMat3, DMat4, DVec3, dvec3};

use crate::math;
use crate::raster::{Crs, CrsError, Projection};

/// WGS 84 semi-major axis, metres.
const EARTH_AXIS_M: f64 = 6_378_137.0;
/// WGS 84 first eccentricity, squared.
const EARTH_ECCENTRICITY_SQUARED: f64 = 0.006_694_379_990_141_316;
/// Side of the squares between which places are interpolated. chosen: the Earth bends by 0.4 mm within.
const STEP_M: f64 = 100.0;

/// Geocentric coordinates in metres of a point by longitude, latitude (degrees) and height above the ellipsoid.
pub fn geocentric_m(longitude_deg: f64, latitude_deg: f64, height_m: f64) -> DVec3 {
    let up = up(longitude_deg, latitude_deg);
    let normal_m = EARTH_AXIS_M / (1.0 - EARTH_ECCENTRICITY_SQUARED * up.z * up.z).sqrt();
    let polar = (1.0 - EARTH_ECCENTRICITY_SQUARED) * normal_m + height_m;
    dvec3(normal_m + height_m, normal_m + height_m, polar) * up
}

/// The direction up, off the ellipsoid.
fn up(longitude_deg: f64, latitude_deg: f64) -> DVec3 {
    let (longitude, latitude) = (longitude_deg.to_radians(), latitude_deg.to_radians());
    let level = math::cos_f64(latitude);
    dvec3(
        level * math::cos_f64(longitude),
        level * math::sin_f64(longitude),
        math::sin_f64(latitude),
    )
}

/// A place of the map in the root's frame.
#[derive(Clone, Copy)]
struct Node {
    /// Where it lies at the origin's elevation.
    at_m: DVec3,
    /// Its direction up.
    up: DVec3,
}

/// A scene's place on Earth.
pub struct Globe {
    origin_m: DVec3,
    axes: DMat3,
    /// South-west node, nodes a row, and all nodes from the south.
    corner_m: [f64; 2],
    cols: usize,
    nodes: Vec<Node>,
}

impl Globe {
    /// The place of a scene whose metres count from `origin` (map coordinates, elevation) and reach from `low` to `high`.
    ///
    /// # Errors
    /// [`CrsError`] for local metres and outside the system's domain.
    pub fn new(
        crs: &Crs,
        origin: [f64; 3],
        low: [f32; 2],
        high: [f32; 2],
    ) -> Result<Self, CrsError> {
        let projection = Projection::new(crs)?;
        let degrees = |x: f64, y: f64| projection.lon_lat_deg([origin[0] + x, origin[1] + y]);
        let place = |x: f64, y: f64| -> Result<(DVec3, DVec3), CrsError> {
            let [longitude, latitude] = degrees(x, y)?;
            Ok((geocentric_m(longitude, latitude, origin[2]), up(longitude, latitude)))
        };
        let (origin_m, z) = place(0.0, 0.0)?;
        let east = place(STEP_M, 0.0)?.0 - place(-STEP_M, 0.0)?.0;
        let x = east.reject_from_normalized(z).normalize();
        let axes = DMat3::from_cols(x, z.cross(x), z);
        let inward = axes.transpose();

        let corner_m = low.map(|at| f64::from(at) - STEP_M);
        // as: a scene has some hundred steps
        let count = |k: usize| ((f64::from(high[k]) - corner_m[k]) / STEP_M).ceil() as usize + 2;
        let (cols, rows) = (count(0), count(1));
        let mut nodes = Vec::with_capacity(rows * cols);
        for row in 0..rows {
            for col in 0..cols {
                let [x, y] = [corner_m[0] + col as f64 * STEP_M, corner_m[1] + row as f64 * STEP_M];
                let (at, up) = place(x, y)?;
                nodes.push(Node { at_m: inward * (at - origin_m), up: inward * up });
            }
        }
        Ok(Self { origin_m, axes, corner_m, cols, nodes })
    }

    /// The matrix from the root's frame to geocentric metres, by columns.
    pub fn root(&self) -> [f64; 16] {
        DMat4::from_mat3_translation(self.axes, self.origin_m).to_cols_array()
    }

    /// Where metres of the map lie in the root's frame, within 1 mm.
    pub fn place_m(&self, map_m: [f32; 3]) -> [f64; 3] {
        let along = |k: usize| (f64::from(map_m[k]) - self.corner_m[k]) / STEP_M;
        let (u, v) = (along(0), along(1));
        let rows = self.nodes.len() / self.cols;
        // `as` cuts below 0; what lies outside is extrapolated
        let (col, row) = ((u as usize).min(self.cols - 2), (v as usize).min(rows - 2));
        let (u, v) = (u - col as f64, v - row as f64);
        let at = row * self.cols + col;
        let corners = [at, at + 1, at + self.cols, at + self.cols + 1].map(|at| self.nodes[at]);
        let shares = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        let z = f64::from(map_m[2]);
        let parts =
            corners.iter().zip(shares).map(|(node, share)| (node.at_m + node.up * z) * share);
        parts.sum::<DVec3>().to_array()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn geocentric_coordinates_are_those_of_the_guidance_note() {
        // IOGP 373-7-2, §4.1.1: 53°48'33.820"N, 2°07'46.380"E, 73.0 m
        let latitude = 53.0 + 48.0 / 60.0 + 33.820 / 3600.0;
        let longitude = 2.0 + 7.0 / 60.0 + 46.380 / 3600.0;
        let found = geocentric_m(longitude, latitude, 73.0);
        for (found, expected) in
            found.to_array().into_iter().zip([3_771_793.968, 140_253.342, 5_124_304.349])
        {
            assert!((found - expected).abs() < 1e-3, "{found}");
        }
    }

    #[test]
    fn places_are_exact_to_a_millimetre_wherever_they_lie() {
        let crs = Crs::Epsg(32611);
        let origin = [256_000.0, 4_110_000.0, 350.0];
        let globe = Globe::new(&crs, origin, [-2_000.0; 2], [2_000.0; 2]).unwrap();
        let projection = Projection::new(&crs).unwrap();
        let root = globe.root();
        for map_m in [
            [0.0_f32; 3],
            [1_940.0, -1_833.0, 412.0],
            [-2_000.0, 2_000.0, -90.0],
            [33.0, 51.0, 8.0],
        ] {
            let local = globe.place_m(map_m);
            let [x, y, z] = map_m.map(f64::from);
            let [longitude, latitude] =
                projection.lon_lat_deg([origin[0] + x, origin[1] + y]).unwrap();
            let expected = geocentric_m(longitude, latitude, origin[2] + z);
            for k in 0..3 {
                let found: f64 =
                    root[12 + k] + (0..3).map(|axis| root[4 * axis + k] * local[axis]).sum::<f64>();
                assert!((found - expected[k]).abs() < 1e-3, "{map_m:?}: {found} {}", expected[k]);
            }
        }
    }

    #[test]
    fn the_root_is_a_rotation_and_x_runs_along_the_maps_east() {
        let globe =
            Globe::new(&Crs::Epsg(32633), [720_000.0, 5_100_000.0, 0.0], [0.0; 2], [1.0; 2])
                .unwrap();
        assert!((globe.axes.transpose() * globe.axes).abs_diff_eq(DMat3::IDENTITY, 1e-12));
        // map scale 1.0002 at 220 km from the central meridian; convergence is in the axes
        let [east, north, _] = globe.place_m([1_000.0, 0.0, 0.0]);
        assert!((east - 1_000.0).abs() < 0.5 && north.abs() < 0.05, "{east} {north}");
        assert!(Globe::new(&Crs::Local, [0.0; 3], [0.0; 2], [1.0; 2]).is_err());
    }
}
