//! Light: translucent layers over each other on a sheet, band by band of rows on all cores.
//!
//! Pixels hold light, the squares of code values, so that laying one colour over another is plain arithmetic and many
//! layers do not add up rounding errors.

use std::ops::Range;

use rayon::prelude::*;

use crate::export::canvas::{Canvas, Rect};
use crate::export::furniture::rounded;

/// Rows drawn by one worker at a time.
const BAND_ROWS: usize = 16;

/// Light of a pixel, a channel each.
type Light = [f32; 3];

/// A sheet under way.
pub struct LightSheet {
    pixels: Vec<Light>,
    rows: usize,
    cols: usize,
}

/// Some rows of a sheet, in the hands of one worker.
pub struct Band<'a> {
    pixels: &'a mut [Light],
    first_row: usize,
    cols: usize,
}

impl LightSheet {
    /// A sheet of `rows` × `cols` pixels in the colours that `color` gives for each, counted row by row.
    pub fn new(rows: usize, cols: usize, color: impl Fn(usize) -> [f32; 3] + Sync + Send) -> Self {
        let light = |pixel: usize| color(pixel).map(|c| c * c);
        Self { pixels: (0..rows * cols).into_par_iter().map(light).collect(), rows, cols }
    }

    /// Draws on all bands. What `draw` does must not depend on the band: it clips to it.
    pub fn draw(&mut self, draw: impl Fn(&mut Band<'_>) + Sync + Send) {
        let cols = self.cols;
        self.pixels.par_chunks_mut(BAND_ROWS * cols.max(1)).enumerate().for_each(
            |(band, pixels)| draw(&mut Band { pixels, first_row: band * BAND_ROWS, cols }),
        );
    }

    /// Puts the sheet onto a canvas with its upper left corner at `[x, y]`; gives the rectangle it fills.
    pub fn onto(&self, canvas: &mut Canvas, [x, y]: [u32; 2]) -> Rect {
        let (width, height) = (self.cols as u32, self.rows as u32); // sheets are some thousand pixels wide
        let rect = Rect { x, y, width, height };
        canvas.paint(rect, |x, y| {
            rounded(self.pixels[y as usize * self.cols + x as usize].map(|l| l.max(0.0).sqrt()))
        });
        rect
    }
}

impl Band<'_> {
    /// Rows and columns of this band that a box from `[left, top]` to `[right, bottom]` touches.
    pub fn touched(
        &self,
        [left, top]: [f32; 2],
        [right, bottom]: [f32; 2],
    ) -> (Range<usize>, Range<usize>) {
        // `as` cuts negatives to 0
        let rows = self.first_row..self.first_row + self.size()[0];
        let first = (top.max(0.0) as usize).max(rows.start);
        let end = ((bottom + 1.0).max(0.0) as usize).min(rows.end);
        let left = (left.max(0.0) as usize).min(self.cols);
        let right = ((right + 1.0).max(0.0) as usize).min(self.cols);
        (first..end.max(first), left..right.max(left))
    }

    /// The first row.
    pub fn first_row(&self) -> usize {
        self.first_row
    }

    /// Number of rows and columns.
    pub fn size(&self) -> [usize; 2] {
        [self.pixels.len() / self.cols, self.cols]
    }

    /// Lays a colour over a pixel of this band.
    pub fn lay(&mut self, row: usize, col: usize, color: [f32; 3], alpha: f32) {
        let pixel = &mut self.pixels[(row - self.first_row) * self.cols + col];
        for (below, above) in pixel.iter_mut().zip(color) {
            *below += alpha * (above * above - *below);
        }
    }

    /// Dims every pixel of this band towards cool shade by a share that `depth` gives by row and column.
    pub fn shade(&mut self, depth: impl Fn(usize, usize) -> f32) {
        for (index, pixel) in self.pixels.iter_mut().enumerate() {
            let depth = depth(self.first_row + index / self.cols, index % self.cols);
            for (light, cool) in pixel.iter_mut().zip(SHADE) {
                *light *= 1.0 - depth * (1.0 - cool);
            }
        }
    }
}

/// Light left in full shade, bluer than the light outside.
const SHADE: Light = [0.12, 0.15, 0.22];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_mix_light_and_stay_in_their_box() {
        let mut sheet = LightSheet::new(40, 30, |_| [100.0; 3]);
        sheet.draw(|band| {
            let (rows, cols) = band.touched([-3.0, 10.0], [4.5, 19.5]);
            for row in rows {
                for col in cols.clone() {
                    band.lay(row, col, [200.0; 3], 0.5);
                }
            }
        });
        let mut canvas = Canvas::new(30, 40, [0; 3]);
        sheet.onto(&mut canvas, [0, 0]);
        let drawn: Vec<_> =
            canvas.image().enumerate_pixels().filter(|(_, _, p)| p.0[0] != 100).collect();
        assert_eq!(drawn.len(), 5 * 10);
        // half the light of both: √((100² + 200²) / 2)
        assert!(drawn.iter().all(|(x, y, p)| *x < 5 && (10..20).contains(y) && p.0[0] == 158));
    }

    #[test]
    fn boxes_beyond_the_sheet_touch_nothing() {
        let mut sheet = LightSheet::new(5, 5, |_| [9.0; 3]);
        sheet.draw(|band| {
            for (from, to) in [([-9.0, -9.0], [-2.0, -2.0]), ([7.0, 1.0], [9.0, 2.0])] {
                let (rows, cols) = band.touched(from, to);
                assert!(rows.is_empty() || cols.is_empty());
            }
        });
    }
}
