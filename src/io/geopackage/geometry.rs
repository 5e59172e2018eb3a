//! Geometries of a GeoPackage: a header with bounds, then ISO well-known binary, little-endian.
//!
//! # Reference
//! OGC 12-128r18, 2.1.3 (GeoPackageBinary); ISO 19125 for types above 1000, which have a z.

use std::f64::consts::TAU;

use super::{Bounds, Shape};
use crate::io::table::{Column, Values};
use crate::math;

/// Corners of a disk's polygon. chosen: a circle to the eye at a crown's size.
pub const DISK_CORNERS: usize = 16;

/// Flags of a header: little-endian, no bounds. Points need none.
const PLAIN: u8 = 0b0000_0001;

/// Flags of a header: little-endian, bounds of x and y.
const BOUNDED: u8 = 0b0000_0011;

const POINT_Z: u32 = 1001;
const LINE_Z: u32 = 1002;
const POLYGON: u32 = 3;

/// Geometries of a run of rows, all of one length.
pub struct Encoded {
    bytes: Vec<u8>,
    stride: usize,
    /// Bounds of each.
    pub boxes: Vec<Bounds>,
}

impl Encoded {
    /// The geometry of a row.
    pub fn bytes(&self, row: usize) -> &[u8] {
        &self.bytes[row * self.stride..][..self.stride]
    }
}

/// The geometries of a run of rows.
///
/// # Panics
/// If the columns lack the geometry, or the one that the shape names.
pub fn encode(
    columns: &[Column],
    values: &[Values<'_>],
    shape: &Shape<'_>,
    srs_id: i32,
) -> Encoded {
    let reals = |name: &str| {
        let column = columns.iter().position(|column| column.name == name);
        match column.map(|column| &values[column]) {
            Some(Values::Reals(numbers)) => numbers,
            _ => panic!("column `{name}` holds no reals, of which a geometry is made"),
        }
    };
    let place = columns.iter().position(|column| column.kind.is_geometry());
    let mut out = Writer { bytes: Vec::new(), boxes: Vec::new(), srs_id };
    match (shape, place.map(|place| &values[place])) {
        (Shape::Point { z }, Some(Values::Points(points))) => {
            points.iter().zip(reals(z).iter()).for_each(|(point, z)| out.point(*point, *z));
        }
        (Shape::Line { z, elevation_m }, Some(Values::Lines(lines))) => {
            for (ends, z) in lines.iter().zip(reals(z).iter()) {
                out.line(*ends, ends.map(|end| elevation_m(end, *z)));
            }
        }
        (Shape::Disk { radius }, Some(Values::Points(points))) => {
            let corners = disk_corners();
            points
                .iter()
                .zip(reals(radius).iter())
                .for_each(|(point, radius)| out.disk(*point, f64::from(*radius), &corners));
        }
        _ => panic!("the table has no geometry of the kind that its layer's shape asks for"),
    }
    let stride = out.bytes.len().checked_div(out.boxes.len()).unwrap_or(0);
    Encoded { bytes: out.bytes, stride, boxes: out.boxes }
}

/// Corners about the origin, counter-clockwise from the east, of a regular polygon with the area of the unit disk.
fn disk_corners() -> [[f64; 2]; DISK_CORNERS] {
    let step_rad = TAU / DISK_CORNERS as f64;
    let radius = (step_rad / math::sin_f64(step_rad)).sqrt();
    std::array::from_fn(|corner| {
        let angle_rad = step_rad * corner as f64;
        [radius * math::cos_f64(angle_rad), radius * math::sin_f64(angle_rad)]
    })
}

struct Writer {
    bytes: Vec<u8>,
    boxes: Vec<Bounds>,
    srs_id: i32,
}

impl Writer {
    fn header(&mut self, flags: u8, bounds: Bounds) {
        self.bytes.extend_from_slice(&[b'G', b'P', 0, flags]);
        self.bytes.extend_from_slice(&self.srs_id.to_le_bytes());
        if flags == BOUNDED {
            let [west, south, east, north] = bounds;
            self.numbers(&[west, east, south, north]);
        }
        self.boxes.push(bounds);
    }

    fn kind(&mut self, kind: u32) {
        self.bytes.push(1); // little-endian
        self.bytes.extend_from_slice(&kind.to_le_bytes());
    }

    fn count(&mut self, count: u32) {
        self.bytes.extend_from_slice(&count.to_le_bytes());
    }

    fn numbers(&mut self, numbers: &[f64]) {
        numbers.iter().for_each(|number| self.bytes.extend_from_slice(&number.to_le_bytes()));
    }

    fn point(&mut self, [x, y]: [f64; 2], z: f32) {
        self.header(PLAIN, [x, y, x, y]);
        self.kind(POINT_Z);
        self.numbers(&[x, y, f64::from(z)]);
    }

    fn line(&mut self, [[x, y], [x2, y2]]: [[f64; 2]; 2], [z, z2]: [f32; 2]) {
        self.header(BOUNDED, [x.min(x2), y.min(y2), x.max(x2), y.max(y2)]);
        self.kind(LINE_Z);
        self.count(2);
        self.numbers(&[x, y, f64::from(z), x2, y2, f64::from(z2)]);
    }

    fn disk(&mut self, [x, y]: [f64; 2], radius: f64, corners: &[[f64; 2]; DISK_CORNERS]) {
        let ring = corners.map(|[dx, dy]| [x + radius * dx, y + radius * dy]);
        let bounds = ring.iter().fold([x, y, x, y], |[west, south, east, north], [x, y]| {
            [west.min(*x), south.min(*y), east.max(*x), north.max(*y)]
        });
        self.header(BOUNDED, bounds);
        self.kind(POLYGON);
        self.count(1);
        self.count(DISK_CORNERS as u32 + 1); // closed
        ring.iter().chain(&ring[..1]).for_each(|corner| self.numbers(corner));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn writer() -> Writer {
        Writer { bytes: Vec::new(), boxes: Vec::new(), srs_id: 3794 }
    }

    #[test]
    fn a_point_is_37_bytes() {
        let mut out = writer();
        out.point([1.0, 2.0], 3.0);
        let expected = [
            &b"GP\0\x01"[..],
            &3794_i32.to_le_bytes(),
            &[1, 0xE9, 3, 0, 0],
            &1_f64.to_le_bytes(),
            &2_f64.to_le_bytes(),
            &3_f64.to_le_bytes(),
        ]
        .concat();
        assert_eq!((out.bytes.len(), out.bytes), (37, expected));
    }

    #[test]
    fn a_line_has_bounds_before_it() {
        let mut out = writer();
        out.line([[5.0, 1.0], [2.0, 4.0]], [7.0, 8.0]);
        let bounds: Vec<f64> =
            out.bytes[8..40].chunks(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect();
        assert_eq!(bounds, [2.0, 5.0, 1.0, 4.0]);
        assert_eq!(out.boxes, [[2.0, 1.0, 5.0, 4.0]]);
        assert_eq!(out.bytes.len(), 40 + 5 + 4 + 48);
    }

    #[test]
    fn a_disk_has_its_area() {
        let corners = disk_corners();
        let next = corners.iter().cycle().skip(1);
        let twice: f64 = corners.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum();
        assert!((twice / 2.0 - std::f64::consts::PI).abs() < 1e-12, "{twice}");
        assert!(twice > 0.0, "counter-clockwise");
    }
}
