//! Which pixels a triangle covers, and how near it is in each.

use super::camera::Projected;

/// Pixels of a tile: first column and row, and those behind the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub left: i32,
    /// First row.
    pub top: i32,
    /// Column behind the last.
    pub right: i32,
    /// Row behind the last.
    pub bottom: i32,
}

impl Window {
    /// Number of columns.
    #[inline]
    pub fn width(&self) -> usize {
        (self.right - self.left) as usize // windows are some hundred pixels wide
    }

    /// Number of rows.
    #[inline]
    pub fn height(&self) -> usize {
        (self.bottom - self.top) as usize // windows are some hundred pixels high
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.width() * self.height()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A pixel's place in row-major order.
    #[inline]
    pub fn index(&self, x: i32, y: i32) -> usize {
        (y - self.top) as usize * self.width() + (x - self.left) as usize // x and y lie within
    }

    /// Whether a rectangle (left, top, right, bottom) touches it.
    #[inline]
    pub fn touches(&self, [left, top, right, bottom]: [f32; 4]) -> bool {
        right >= self.left as f32
            && left <= self.right as f32
            && bottom >= self.top as f32
            && top <= self.bottom as f32
    }

    /// How many pixels of a rectangle (left, top, right, bottom) lie within.
    #[inline]
    pub fn shared_px(&self, [left, top, right, bottom]: [f32; 4]) -> f32 {
        let width_px = right.min(self.right as f32) - left.max(self.left as f32);
        let height_px = bottom.min(self.bottom as f32) - top.max(self.top as f32);
        width_px.max(0.0) * height_px.max(0.0)
    }
}

/// Slack of edges, in shares of a triangle. chosen: a few roundings, so that neighbours leave no gap.
const EDGE_SLACK: f32 = 1e-5;

/// The next whole number below; saturating. Faster than the library's where processors lack an instruction for it.
#[inline]
pub fn floor(v: f32) -> i32 {
    let whole = v as i32; // saturating, towards 0
    whole.saturating_sub(i32::from(whole as f32 > v))
}

#[inline]
fn ceiling(v: f32) -> i32 {
    let whole = v as i32; // saturating, towards 0
    whole.saturating_add(i32::from((whole as f32) < v))
}

/// Calls `pixel` with column, row, nearness and the weights of the second and third corner for each pixel whose middle a
/// triangle covers.
#[inline(always)]
pub fn cover(
    window: Window,
    [a, b, c]: [Projected; 3],
    mut pixel: impl FnMut(i32, i32, f32, [f32; 2]),
) {
    let low_x = a.x.min(b.x).min(c.x);
    let high_x = a.x.max(b.x).max(c.x);
    let low_y = a.y.min(b.y).min(c.y);
    let high_y = a.y.max(b.y).max(c.y);
    // saturating: corners may lie far off
    let first_x = (ceiling(low_x - 0.5)).max(window.left);
    let last_x = (floor(high_x - 0.5)).min(window.right - 1);
    let first_y = (ceiling(low_y - 0.5)).max(window.top);
    let last_y = (floor(high_y - 0.5)).min(window.bottom - 1);
    if first_x > last_x || first_y > last_y {
        return;
    }
    let (abx, aby, acx, acy) = (b.x - a.x, b.y - a.y, c.x - a.x, c.y - a.y);
    let area = abx * acy - aby * acx;
    if area.abs() < 1e-12 {
        return;
    }
    let inverse = 1.0 / area;
    let (step_b, step_c) = (acy * inverse, -aby * inverse);
    let (rise_b, rise_c) = (b.nearness - a.nearness, c.nearness - a.nearness);
    for y in first_y..=last_y {
        let dy = y as f32 + 0.5 - a.y;
        for x in first_x..=last_x {
            let dx = x as f32 + 0.5 - a.x;
            let weight_b = dx * step_b - dy * acx * inverse;
            let weight_c = dx * step_c + dy * abx * inverse;
            if weight_b >= -EDGE_SLACK
                && weight_c >= -EDGE_SLACK
                && weight_b + weight_c <= 1.0 + EDGE_SLACK
            {
                let nearness = a.nearness + weight_b * rise_b + weight_c * rise_c;
                pixel(x, y, nearness, [weight_b, weight_c]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(x: f32, y: f32, nearness: f32) -> Projected {
        Projected { x, y, nearness }
    }

    const WINDOW: Window = Window { left: 0, top: 0, right: 16, bottom: 16 };

    #[test]
    fn two_halves_of_a_square_cover_each_of_its_pixels() {
        let [p, q] = [corner(2.3, 1.7, 1.0), corner(13.1, 1.7, 1.0)];
        let [r, s] = [corner(13.1, 14.2, 2.0), corner(2.3, 14.2, 2.0)];
        let mut hits = vec![0; WINDOW.len()];
        for triangle in [[p, q, r], [p, s, r]] {
            cover(WINDOW, triangle, |x, y, nearness, _| {
                hits[WINDOW.index(x, y)] += 1;
                let expected = 1.0 + (y as f32 + 0.5 - 1.7) / 12.5;
                assert!((nearness - expected).abs() < 1e-4);
            });
        }
        let covered = hits.iter().filter(|n| **n > 0).count();
        assert_eq!(covered, 11 * 12, "columns 2–12, rows 2–13");
    }

    #[test]
    fn slivers_and_far_corners_do_no_harm() {
        cover(WINDOW, [corner(1.0, 1.0, 1.0); 3], |_, _, _, _| panic!("no area"));
        let mut count = 0;
        let huge = [corner(-1e9, -1e9, 1.0), corner(1e9, -1e9, 1.0), corner(0.0, 1e9, 1.0)];
        cover(WINDOW, huge, |_, _, _, _| count += 1);
        assert_eq!(count, WINDOW.len());
    }
}
