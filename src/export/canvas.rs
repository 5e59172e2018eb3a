//! A sheet of pixels: fills, strokes and blending.

use image::{Rgb as Pixel, RgbImage};

use super::ramp::Rgb;
use super::strokes::{Ends, Stroke};

/// A picture under way.
pub struct Canvas {
    image: RgbImage,
}

/// A rectangle of whole pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    /// Left edge.
    pub x: u32,
    /// Upper edge.
    pub y: u32,
    /// Width.
    pub width: u32,
    /// Height.
    pub height: u32,
}

impl Rect {
    /// First column to the right.
    pub fn right(&self) -> u32 {
        self.x + self.width
    }

    /// First row below.
    pub fn bottom(&self) -> u32 {
        self.y + self.height
    }
}

/// Mixes two sRGB channels 0..=255 in light, not in code values: gamma 2, close to sRGB's and exact to compute.
pub fn mix_light(below: f32, above: f32, alpha: f32) -> f32 {
    (below * below + alpha * (above * above - below * below)).max(0.0).sqrt()
}

impl Canvas {
    /// A sheet of one colour.
    pub fn new(width: u32, height: u32, color: Rgb) -> Self {
        Self { image: RgbImage::from_pixel(width, height, Pixel(color)) }
    }

    /// A picture that is drawn on.
    pub fn from_image(image: RgbImage) -> Self {
        Self { image }
    }

    /// The picture so far.
    pub fn image(&self) -> &RgbImage {
        &self.image
    }

    /// The finished picture.
    pub fn into_image(self) -> RgbImage {
        self.image
    }

    /// Lays a colour over a pixel; outside nothing happens.
    pub fn blend(&mut self, x: i64, y: i64, color: Rgb, alpha: f32) {
        let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else { return };
        if let Some(pixel) = self.image.get_pixel_mut_checked(x, y) {
            for (below, above) in pixel.0.iter_mut().zip(color) {
                let mixed = mix_light(f32::from(*below), f32::from(above), alpha.clamp(0.0, 1.0));
                *below = (mixed + 0.5) as u8; // within 0..=255
            }
        }
    }

    /// Fills a rectangle with what `color` gives for each of its pixels, counted from its corner.
    pub fn paint(&mut self, rect: Rect, color: impl Fn(u32, u32) -> Rgb) {
        for y in 0..rect.height {
            for x in 0..rect.width {
                if let Some(pixel) = self.image.get_pixel_mut_checked(rect.x + x, rect.y + y) {
                    *pixel = Pixel(color(x, y));
                }
            }
        }
    }

    /// A line one pixel wide around a rectangle, outside it.
    pub fn frame(&mut self, rect: Rect, color: Rgb) {
        let (x0, y0) = (i64::from(rect.x) - 1, i64::from(rect.y) - 1);
        let (x1, y1) = (i64::from(rect.right()), i64::from(rect.bottom()));
        for x in x0..=x1 {
            self.blend(x, y0, color, 1.0);
            self.blend(x, y1, color, 1.0);
        }
        for y in y0 + 1..y1 {
            self.blend(x0, y, color, 1.0);
            self.blend(x1, y, color, 1.0);
        }
    }

    /// A line through points with round joints and ends, anti-aliased; where it meets itself it is no darker. One point
    /// is a dot. Widths below a pixel are drawn as a paler line of one.
    pub fn polyline(&mut self, points: &[[f32; 2]], width_px: f32, color: Rgb, alpha: f32) {
        let alpha = alpha * width_px.clamp(0.0, 1.0);
        let half_width = [0.5 * width_px.max(1.0); 2];
        let stroke =
            |from: [f32; 2], to: [f32; 2]| Stroke { from, to, half_width, ends: Ends::Round };
        let strokes: Vec<Stroke> = match points {
            [point] => vec![stroke(*point, *point)],
            _ => points.windows(2).map(|pair| stroke(pair[0], pair[1])).collect(),
        };
        let [wide, high] = [self.image.width(), self.image.height()].map(|n| n as usize);
        // `as` cuts negatives to 0
        let span = |low: f32, high: f32, end: usize| {
            (low.max(0.0) as usize).min(end)..((high + 1.0).max(0.0) as usize).min(end)
        };
        // coverage of all strokes together, over the box that holds them
        let boxes = || strokes.iter().map(Stroke::bounds);
        let bound = |corner: usize, axis: usize, pick: fn(f32, f32) -> f32, start: f32| {
            boxes().map(|b| b[corner][axis]).fold(start, pick)
        };
        let cols = span(bound(0, 0, f32::min, f32::MAX), bound(1, 0, f32::max, f32::MIN), wide);
        let rows = span(bound(0, 1, f32::min, f32::MAX), bound(1, 1, f32::max, f32::MIN), high);
        let mut coverage = vec![0.0_f32; rows.len() * cols.len()];
        for stroke in &strokes {
            let [[left, top], [right, bottom]] = stroke.bounds();
            for row in span(top, bottom, high) {
                for col in span(left, right, wide) {
                    let here = stroke.touch([col as f32 + 0.5, row as f32 + 0.5]).coverage;
                    let pixel = &mut coverage[(row - rows.start) * cols.len() + col - cols.start];
                    *pixel = pixel.max(here);
                }
            }
        }
        for (index, coverage) in coverage.into_iter().enumerate() {
            if coverage > 0.0 {
                let (row, col) = (rows.start + index / cols.len(), cols.start + index % cols.len());
                self.blend(col as i64, row as i64, color, alpha * coverage);
            }
        }
    }

    /// A filled convex polygon of corners in order, anti-aliased by sixteen samples a pixel.
    pub fn polygon(&mut self, corners: &[[f32; 2]], color: Rgb) {
        let bound = |axis: usize, pick: fn(f32, f32) -> f32, start: f32| {
            corners.iter().map(|c| c[axis]).fold(start, pick)
        };
        let (left, right) = (bound(0, f32::min, f32::MAX), bound(0, f32::max, f32::MIN));
        let (top, bottom) = (bound(1, f32::min, f32::MAX), bound(1, f32::max, f32::MIN));
        for y in top.floor() as i64..=bottom.ceil() as i64 {
            for x in left.floor() as i64..=right.ceil() as i64 {
                let inside = (0..16)
                    .filter(|s| {
                        let px = x as f32 + ((s % 4) as f32 + 0.5) / 4.0;
                        let py = y as f32 + ((s / 4) as f32 + 0.5) / 4.0;
                        contains(corners, px, py)
                    })
                    .count();
                if inside > 0 {
                    self.blend(x, y, color, inside as f32 / 16.0);
                }
            }
        }
    }
}

/// Whether a convex polygon holds a point: all edges see it on one side.
fn contains(corners: &[[f32; 2]], x: f32, y: f32) -> bool {
    let sides = corners
        .iter()
        .zip(corners.iter().cycle().skip(1))
        .map(|([ax, ay], [bx, by])| (bx - ax) * (y - ay) - (by - ay) * (x - ax));
    let (mut left, mut right) = (true, true);
    for side in sides {
        left &= side >= 0.0;
        right &= side <= 0.0;
    }
    left || right
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blending_ends_at_the_colours_and_mixes_light_between() {
        assert_eq!(mix_light(40.0, 200.0, 0.0), 40.0);
        assert_eq!(mix_light(40.0, 200.0, 1.0), 200.0);
        // half the light of white is brighter than half its code value
        assert!((mix_light(0.0, 255.0, 0.5) - 180.3).abs() < 0.1);
    }

    #[test]
    fn a_square_polygon_covers_its_area() {
        let mut canvas = Canvas::new(10, 10, [255; 3]);
        canvas.polygon(&[[2.0, 2.0], [6.5, 2.0], [6.5, 5.0], [2.0, 5.0]], [0; 3]);
        let full = canvas.image().pixels().filter(|p| p.0 == [0; 3]).count();
        let part = canvas.image().pixels().filter(|p| p.0 != [0; 3] && p.0 != [255; 3]).count();
        assert_eq!((full, part), (12, 3));
    }

    #[test]
    fn lines_have_their_width_and_are_no_darker_where_they_meet() {
        let mut canvas = Canvas::new(40, 40, [255; 3]);
        // there and back again
        canvas.polyline(&[[5.0, 20.0], [35.0, 20.0], [5.0, 20.0]], 2.0, [0; 3], 0.5);
        let column = |x: u32| (0..40).map(move |y| [x, y]);
        let inked: Vec<u8> = column(20)
            .map(|[x, y]| canvas.image().get_pixel(x, y).0[0])
            .filter(|v| *v < 255)
            .collect();
        assert_eq!(inked, [180, 180], "half the light of white");
        canvas.polyline(&[], 2.0, [0; 3], 1.0);
        canvas.polyline(&[[-50.0, -9.0], [90.0, 400.0]], 3.0, [0; 3], 1.0);
        canvas.polyline(&[[30.0, 5.0]], 4.0, [9; 3], 1.0);
        assert_eq!(canvas.image().get_pixel(30, 5).0, [9; 3]);
    }

    #[test]
    fn drawing_outside_is_harmless() {
        let mut canvas = Canvas::new(4, 4, [9; 3]);
        canvas.blend(-1, 2, [0; 3], 1.0);
        canvas.frame(Rect { x: 0, y: 0, width: 4, height: 4 }, [0; 3]);
        canvas.paint(Rect { x: 3, y: 3, width: 5, height: 5 }, |_, _| [1; 3]);
        assert_eq!(canvas.image().get_pixel(0, 0).0, [9; 3]);
        assert_eq!(canvas.image().get_pixel(3, 3).0, [1; 3]);
    }
}
