//! Shapes burnt onto a grid: which cells have their centre in a polygon, or near a line or a point.

use rayon::prelude::*;

use super::Frame;

/// A shape in map coordinates, `[east, north]`.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A place.
    Point([f64; 2]),
    /// A line through its vertices.
    Line(Vec<[f64; 2]>),
    /// Rings, closed or not. Inside is what an odd number of rings surround, so holes are rings like any other.
    Polygon(Vec<Vec<[f64; 2]>>),
}

/// Rows that are worked on together.
const BAND_ROWS: usize = 64;

/// Whether each cell of `frame` is covered by a shape, row-major.
///
/// A cell is covered if its centre lies inside a polygon, or within half of `width_m` of a line or a point. Of two
/// polygons that share an edge, each centre on it belongs to one. Coordinates must be finite.
pub fn covered(shapes: &[Shape], width_m: f64, frame: &Frame) -> Vec<bool> {
    let mut covered = vec![false; frame.len()];
    if frame.is_empty() {
        return covered;
    }
    let reach = width_m.max(0.0) / 2.0;
    let spans: Vec<(f64, f64)> = shapes.iter().map(|shape| shape.north_span(reach)).collect();
    let bands = covered.par_chunks_mut(BAND_ROWS * frame.cols).enumerate();
    bands.for_each(|(band, covered)| {
        let mut band = Band {
            frame,
            first_row: band * BAND_ROWS,
            rows: covered.len() / frame.cols,
            covered,
            crossings: vec![Vec::new(); BAND_ROWS],
        };
        let (south, north) = (band.north_of(band.rows), band.north_of(0));
        for (shape, span) in shapes.iter().zip(&spans) {
            if span.0 <= north && span.1 >= south {
                band.burn(shape, reach);
            }
        }
    });
    covered
}

impl Shape {
    /// Its vertices, part after part.
    pub fn parts(&self) -> impl Iterator<Item = &[[f64; 2]]> {
        let parts: Vec<&[[f64; 2]]> = match self {
            Self::Point(point) => vec![std::slice::from_ref(point)],
            Self::Line(line) => vec![line],
            Self::Polygon(rings) => rings.iter().map(Vec::as_slice).collect(),
        };
        parts.into_iter()
    }

    /// The shape with every vertex moved; `None` if one has no place there.
    pub fn moved(&self, mut to: impl FnMut([f64; 2]) -> Option<[f64; 2]>) -> Option<Self> {
        let mut part = |part: &[[f64; 2]]| part.iter().map(|&p| to(p)).collect::<Option<Vec<_>>>();
        Some(match self {
            Self::Point(point) => Self::Point(*part(std::slice::from_ref(point))?.first()?),
            Self::Line(line) => Self::Line(part(line)?),
            Self::Polygon(rings) => {
                Self::Polygon(rings.iter().map(|ring| part(ring)).collect::<Option<_>>()?)
            }
        })
    }

    /// Southernmost and northernmost reach.
    fn north_span(&self, reach: f64) -> (f64, f64) {
        let norths = self.parts().flatten().map(|point| point[1]);
        let (south, north) = norths
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(s, n), north| (s.min(north), n.max(north)));
        (south - reach, north + reach)
    }
}

/// Some rows of the grid.
struct Band<'a> {
    frame: &'a Frame,
    first_row: usize,
    rows: usize,
    covered: &'a mut [bool],
    /// Eastings where a polygon's edges cross each row's centres.
    crossings: Vec<Vec<f64>>,
}

impl Band<'_> {
    /// Northing of a row's northern edge, counted within the band.
    fn north_of(&self, row: usize) -> f64 {
        let t = &self.frame.transform;
        t.north_m - (self.first_row + row) as f64 * t.cell_m
    }

    /// Northing of a row's centres.
    fn center_north(&self, row: usize) -> f64 {
        let t = &self.frame.transform;
        t.north_m - ((self.first_row + row) as f64 + 0.5) * t.cell_m
    }

    /// Rows of the band that may have centres between two northings; a row more at either end.
    fn rows_between(&self, south: f64, north: f64) -> std::ops::Range<usize> {
        let row = |northing: f64| (self.north_of(0) - northing) / self.frame.transform.cell_m;
        // `as` cuts to 0 what lies north of the band
        let first = (row(north) - 1.5).max(0.0) as usize;
        let end = ((row(south) + 1.5).max(0.0) as usize).min(self.rows);
        first.min(end)..end
    }

    /// Covers the cells of a row whose centres lie in `west..=east`, or `west..east`.
    fn cover(&mut self, row: usize, west: f64, east: f64, takes_last: bool) {
        let t = &self.frame.transform;
        let cols = self.frame.cols;
        let center = |col: usize| t.west_m + (col as f64 + 0.5) * t.cell_m;
        let near = |easting: f64| ((easting - t.west_m) / t.cell_m - 0.5).clamp(-1.0, cols as f64);
        // rounding may put a bound one cell off: the centres themselves decide
        let mut first = (near(west).floor() - 1.0).max(0.0) as usize;
        while first < cols && center(first) < west {
            first += 1;
        }
        let inside = |col: usize| center(col) < east || (takes_last && center(col) == east);
        let mut end = ((near(east).floor() + 3.0).max(0.0) as usize).min(cols);
        while end > first && !inside(end - 1) {
            end -= 1;
        }
        if first < end {
            self.covered[row * cols + first..row * cols + end].fill(true);
        }
    }

    fn burn(&mut self, shape: &Shape, reach: f64) {
        match shape {
            Shape::Point(point) => self.burn_segment(*point, *point, reach),
            Shape::Line(line) => {
                if let [point] = line[..] {
                    self.burn_segment(point, point, reach);
                }
                line.windows(2).for_each(|ends| self.burn_segment(ends[0], ends[1], reach));
            }
            Shape::Polygon(rings) => self.burn_polygon(rings),
        }
    }

    /// Even-odd filling: on each row, the cells between the first and second crossing, the third and fourth …
    fn burn_polygon(&mut self, rings: &[Vec<[f64; 2]>]) {
        for ring in rings {
            let Some(&last) = ring.last() else { continue };
            let mut from = last;
            for &to in ring {
                let (south, north) = (from[1].min(to[1]), from[1].max(to[1]));
                for row in self.rows_between(south, north) {
                    let northing = self.center_north(row);
                    // half open, so that a vertex on a row's centres counts once
                    if (from[1] <= northing) != (to[1] <= northing) {
                        let along = (northing - from[1]) / (to[1] - from[1]);
                        self.crossings[row].push(from[0] + along * (to[0] - from[0]));
                    }
                }
                from = to;
            }
        }
        for row in 0..self.rows {
            let mut crossings = std::mem::take(&mut self.crossings[row]);
            crossings.sort_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                self.cover(row, pair[0], pair[1], false);
            }
            crossings.clear();
            self.crossings[row] = crossings;
        }
    }

    /// All centres within `reach` of a segment: on each row one interval, for the area is convex.
    fn burn_segment(&mut self, a: [f64; 2], b: [f64; 2], reach: f64) {
        let (south, north) = (a[1].min(b[1]) - reach, a[1].max(b[1]) + reach);
        for row in self.rows_between(south, north) {
            if let Some((west, east)) = interval_near_segment(a, b, reach, self.center_north(row)) {
                self.cover(row, west, east, true);
            }
        }
    }
}

/// Eastings at a northing that lie within `reach` of a segment.
fn interval_near_segment(
    a: [f64; 2],
    b: [f64; 2],
    reach: f64,
    northing: f64,
) -> Option<(f64, f64)> {
    let disc = |center: [f64; 2]| {
        let off = northing - center[1];
        let half = (reach * reach - off * off).max(0.0).sqrt();
        (off.abs() <= reach).then_some((center[0] - half, center[0] + half))
    };
    let join = |one: Option<(f64, f64)>, other: Option<(f64, f64)>| match (one, other) {
        (Some(one), Some(other)) => Some((one.0.min(other.0), one.1.max(other.1))),
        (one, other) => one.or(other),
    };
    join(join(disc(a), disc(b)), interval_beside_segment(a, b, reach, northing))
}

/// Eastings at a northing in the rectangle that reaches as far to both sides of a segment.
fn interval_beside_segment(
    a: [f64; 2],
    b: [f64; 2],
    reach: f64,
    northing: f64,
) -> Option<(f64, f64)> {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let length = (dx * dx + dy * dy).sqrt();
    if length == 0.0 {
        return None;
    }
    let off = northing - a[1];
    // eastings x, from a, where low <= slope·x + rest <= high
    let between = |slope: f64, rest: f64, low: f64, high: f64| {
        if slope == 0.0 {
            let holds = (low..=high).contains(&rest);
            return holds.then_some((f64::NEG_INFINITY, f64::INFINITY));
        }
        let (first, second) = ((low - rest) / slope, (high - rest) / slope);
        Some((first.min(second), first.max(second)))
    };
    let along = between(dx, off * dy, 0.0, length * length)?;
    let across = between(dy, -off * dx, -reach * length, reach * length)?;
    let (west, east) = (along.0.max(across.0), along.1.min(across.1));
    (west <= east).then_some((a[0] + west, a[0] + east))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use proptest::prelude::*;

    use super::*;
    use crate::math::{cos_f64, sin_f64};
    use crate::raster::Cell;

    fn area_m2(shapes: &[Shape], width_m: f64, frame: &Frame) -> f64 {
        let cells = covered(shapes, width_m, frame).iter().filter(|c| **c).count();
        cells as f64 * frame.transform.cell_m * frame.transform.cell_m
    }

    fn circle(center: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
        let at = |i: u32| f64::from(i) / 720.0 * TAU;
        let point = |i| [center[0] + radius * cos_f64(at(i)), center[1] + radius * sin_f64(at(i))];
        (0..720).map(point).collect()
    }

    #[test]
    fn a_circle_has_its_area_with_and_without_a_hole() {
        let frame = Frame::local(400, 400, 0.5);
        let outer = circle([100.3, 99.8], 80.0);
        let area = area_m2(&[Shape::Polygon(vec![outer.clone()])], 6.0, &frame);
        assert!((area / (PI * 6400.0) - 1.0).abs() < 2e-3, "{area}");
        let ring = Shape::Polygon(vec![outer, circle([110.0, 100.0], 30.0)]);
        let area = area_m2(&[ring], 6.0, &frame);
        assert!((area / (PI * 5500.0) - 1.0).abs() < 2e-3, "{area}");
    }

    #[test]
    fn a_road_has_its_width_in_any_direction() {
        let frame = Frame::local(300, 300, 1.0);
        for degrees in [0.0_f64, 17.0, 40.0, 90.0, 131.0] {
            let (east, north) = (cos_f64(degrees.to_radians()), sin_f64(degrees.to_radians()));
            let end = |along: f64| [150.2 + along * east, 149.7 + along * north];
            let road = Shape::Line(vec![end(-100.0), end(-20.0), end(100.0)]);
            let expected = 200.0 * 6.0 + PI * 9.0;
            let area = area_m2(&[road], 6.0, &frame);
            assert!((area / expected - 1.0).abs() < 0.03, "{degrees}°: {area} for {expected}");
        }
        let tree = area_m2(&[Shape::Point([20.0, 20.0])], 20.0, &frame);
        assert!((tree / (PI * 100.0) - 1.0).abs() < 0.03, "{tree}");
    }

    #[test]
    fn polygons_that_touch_share_no_cell_and_leave_none() {
        let frame = Frame::local(20, 20, 1.0);
        let square = |west: f64, east: f64| {
            Shape::Polygon(vec![vec![[west, 2.5], [east, 2.5], [east, 18.5], [west, 18.5]]])
        };
        let (left, right) = (square(1.0, 9.5), square(9.5, 17.5));
        let count = |shapes: &[Shape]| covered(shapes, 0.0, &frame).iter().filter(|c| **c).count();
        assert_eq!(
            count(std::slice::from_ref(&left)) + count(std::slice::from_ref(&right)),
            count(&[left, right])
        );
        assert_eq!(count(&[square(1.0, 17.5)]), 16 * 16);
    }

    #[test]
    fn shapes_beyond_the_grid_and_empty_ones_do_nothing() {
        let frame = Frame::local(10, 10, 1.0);
        let far = |x: f64| Shape::Polygon(vec![vec![[x, x], [x + 9.0, x], [x, x + 9.0]]]);
        let nothing = [far(1e300), far(-1e9), Shape::Line(vec![]), Shape::Polygon(vec![vec![]])];
        assert!(covered(&nothing, 6.0, &frame).iter().all(|c| !c));
        let all =
            Shape::Polygon(vec![vec![[-1e12, -1e12], [1e12, -1e12], [1e12, 1e12], [-1e12, 1e12]]]);
        assert!(covered(&[all], 6.0, &frame).iter().all(|c| *c));
        assert!(covered(&[], 6.0, &Frame::local(0, 0, 1.0)).is_empty());
    }

    proptest! {
        #[test]
        fn centres_decide(
            corners in prop::collection::vec((-10.0..110.0_f64, -10.0..110.0_f64), 3..8),
            width_m in 0.5..30.0_f64,
        ) {
            let frame = Frame::local(100, 100, 1.0);
            let corners: Vec<[f64; 2]> = corners.into_iter().map(|(x, y)| [x, y]).collect();
            let line = covered(&[Shape::Line(corners.clone())], width_m, &frame);
            let polygon = covered(&[Shape::Polygon(vec![corners.clone()])], width_m, &frame);
            for index in (0..frame.len()).step_by(13) {
                let Cell { row, col } = frame.cell(index);
                let at = [col as f64 + 0.5, 99.5 - row as f64];
                // distance to the line
                let distance = corners.windows(2).map(|ends| {
                    let (a, b) = (ends[0], ends[1]);
                    let d = [b[0] - a[0], b[1] - a[1]];
                    let along = ((at[0] - a[0]) * d[0] + (at[1] - a[1]) * d[1])
                        / (d[0] * d[0] + d[1] * d[1]).max(1e-300);
                    let along = along.clamp(0.0, 1.0);
                    let off = [at[0] - a[0] - along * d[0], at[1] - a[1] - along * d[1]];
                    (off[0] * off[0] + off[1] * off[1]).sqrt()
                });
                let distance = distance.fold(f64::MAX, f64::min);
                if (distance - width_m / 2.0).abs() > 1e-9 {
                    prop_assert_eq!(line[index], distance < width_m / 2.0);
                }
                // winding by crossings of a ray to the north
                let mut inside = false;
                let closed = corners.iter().zip(corners.iter().cycle().skip(1));
                for (a, b) in closed.take(corners.len()) {
                    if (a[0] <= at[0]) != (b[0] <= at[0]) {
                        let north = a[1] + (at[0] - a[0]) / (b[0] - a[0]) * (b[1] - a[1]);
                        inside ^= north > at[1];
                    }
                }
                prop_assert_eq!(polygon[index], inside);
            }
        }
    }
}
