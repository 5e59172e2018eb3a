//! Lettering in DejaVu Sans, anti-aliased.
//!
//! The fonts come with the `dejavu` crate: © Bitstream (Bitstream Vera licence), Arev glyphs © Tavmjong Bah,
//! DejaVu's changes in the public domain. The licence allows embedding and redistribution with software.

use ab_glyph::{Font, FontRef, PxScale, ScaleFont, point};

use super::canvas::Canvas;
use super::ramp::Rgb;

/// Where a text stands against its anchor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// The anchor is the text's left end.
    Left,
    /// The anchor is the text's middle.
    Center,
    /// The anchor is the text's right end.
    Right,
}

/// Size, weight and colour of a text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    /// Height of an em.
    pub size_px: f32,
    /// Whether bold.
    pub bold: bool,
    /// Colour.
    pub color: Rgb,
}

/// The two fonts of a sheet.
pub struct Lettering {
    regular: FontRef<'static>,
    bold: FontRef<'static>,
}

impl Default for Lettering {
    fn default() -> Self {
        Self { regular: embedded(dejavu::sans::regular()), bold: embedded(dejavu::sans::bold()) }
    }
}

fn embedded(bytes: &'static [u8]) -> FontRef<'static> {
    match FontRef::try_from_slice(bytes) {
        Ok(font) => font,
        Err(_) => panic!("the embedded font cannot be read"),
    }
}

impl Lettering {
    fn font(&self, style: Style) -> &FontRef<'static> {
        if style.bold { &self.bold } else { &self.regular }
    }

    fn scale(&self, style: Style) -> PxScale {
        // ab_glyph counts from ascender to descender, typographers count the em
        let font = self.font(style);
        let em = font.units_per_em().unwrap_or(1.0);
        PxScale::from(style.size_px * font.height_unscaled() / em)
    }

    /// Width of a text in pixels.
    pub fn width_px(&self, text: &str, style: Style) -> f32 {
        let font = self.font(style).as_scaled(self.scale(style));
        let mut previous = None;
        text.chars().fold(0.0, |width, letter| {
            let glyph = font.glyph_id(letter);
            let kern = previous.replace(glyph).map_or(0.0, |before| font.kern(before, glyph));
            width + kern + font.h_advance(glyph)
        })
    }

    /// The text, cut with an ellipsis to fit into `width_px`.
    pub fn shortened(&self, text: &str, style: Style, width_px: f32) -> String {
        if self.width_px(text, style) <= width_px {
            return text.to_owned();
        }
        let mut letters: Vec<char> = text.chars().collect();
        while letters.pop().is_some() {
            let shorter: String = letters.iter().chain(std::iter::once(&'…')).collect();
            if self.width_px(&shorter, style) <= width_px {
                return shorter;
            }
        }
        String::new()
    }

    /// Draws a text with its baseline at `y_px`.
    pub fn draw(
        &self,
        canvas: &mut Canvas,
        x_px: f32,
        y_px: f32,
        align: Align,
        text: &str,
        style: Style,
    ) {
        let width = self.width_px(text, style);
        let mut pen = match align {
            Align::Left => x_px,
            Align::Center => x_px - width / 2.0,
            Align::Right => x_px - width,
        };
        let scale = self.scale(style);
        let font = self.font(style).as_scaled(scale);
        let mut previous = None;
        for letter in text.chars() {
            let id = font.glyph_id(letter);
            pen += previous.replace(id).map_or(0.0, |before| font.kern(before, id));
            let glyph = id.with_scale_and_position(scale, point(pen, y_px));
            pen += font.h_advance(id);
            if let Some(outline) = font.font().outline_glyph(glyph) {
                let corner = outline.px_bounds().min;
                outline.draw(|dx, dy, coverage| {
                    // glyph boxes are a few pixels across
                    let (x, y) = (corner.x as i64 + i64::from(dx), corner.y as i64 + i64::from(dy));
                    // dark strokes blended in linear light look thin: thicken half-covered pixels a little
                    let lean = 1.0 - coverage.clamp(0.0, 1.0);
                    canvas.blend(x, y, style.color, 1.0 - lean * lean.sqrt());
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STYLE: Style = Style { size_px: 20.0, bold: false, color: [0, 0, 0] };

    fn inked(canvas: &Canvas) -> Vec<(u32, u32)> {
        let image = canvas.image();
        image.enumerate_pixels().filter(|(_, _, p)| p.0[0] < 128).map(|(x, y, _)| (x, y)).collect()
    }

    #[test]
    fn text_draws_inside_its_box() {
        let lettering = Lettering::default();
        for (align, left) in [(Align::Left, 60.0), (Align::Center, 100.0), (Align::Right, 140.0)] {
            let mut canvas = Canvas::new(260, 60, [255; 3]);
            let width = lettering.width_px("Höhe 8", STYLE);
            assert!((50.0..100.0).contains(&width), "{width}");
            lettering.draw(&mut canvas, left, 40.0, align, "Höhe 8", STYLE);
            let start = match align {
                Align::Left => left,
                Align::Center => left - width / 2.0,
                Align::Right => left - width,
            };
            let pixels = inked(&canvas);
            assert!(pixels.len() > 100, "{} pixels", pixels.len());
            for (x, y) in pixels {
                assert!((x as f32) > start - 2.0 && (x as f32) < start + width + 2.0, "x {x}");
                assert!((18..=42).contains(&y), "y {y}");
            }
        }
    }

    #[test]
    fn long_titles_are_cut_to_fit() {
        let lettering = Lettering::default();
        let long = "A very long name of a very small forest";
        let short = lettering.shortened(long, STYLE, 120.0);
        assert!(short.ends_with('…') && lettering.width_px(&short, STYLE) <= 120.0);
        assert_eq!(lettering.shortened("Wood", STYLE, 120.0), "Wood");
    }

    #[test]
    fn every_sign_of_a_sheet_has_a_glyph() {
        let lettering = Lettering::default();
        for font in [&lettering.regular, &lettering.bold] {
            assert!("°·×–−…²₃äßčéŁ".chars().all(|c| font.glyph_id(c).0 != 0));
        }
    }
}
