//! What every sheet has beside its maps: inks, letter styles, scale bar, north arrow, the look of missing ground.

use super::canvas::{Canvas, Rect};
use super::lettering::{Align, Lettering, Style};
use super::ramp::Rgb;
use super::scale;
use crate::raster::Crs;

/// The sheet itself.
pub const PAPER: Rgb = [250, 248, 243];
/// Text and lines that matter.
pub const INK: Rgb = [38, 40, 44];
/// Text and lines that explain.
pub const GREY_INK: Rgb = [104, 106, 108];
/// Lines around maps.
pub const FRAME_INK: Rgb = [120, 118, 112];
/// Ground that is not known, and the hatching over it.
pub const VOID: Rgb = [226, 228, 226];
/// See [`VOID`].
pub const VOID_HATCH: Rgb = [208, 211, 210];

/// What signs a sheet.
pub const NAME: &str = "wildwood";
/// A sheet's title.
pub const TITLE: Style = Style { size_px: 34.0, bold: true, color: INK };
/// The line below the title.
pub const SUBTITLE: Style = Style { size_px: 17.0, bold: false, color: GREY_INK };
/// What stands above a map or a legend.
pub const CAPTION: Style = Style { size_px: 17.0, bold: true, color: INK };
/// Units and remarks.
pub const UNIT: Style = Style { size_px: 14.0, bold: false, color: GREY_INK };
/// Names and numbers.
pub const LABEL: Style = Style { size_px: 14.0, bold: false, color: INK };

/// The longest scale bar.
const LONGEST_BAR_PX: f64 = 260.0;

/// A colour as a pixel holds it.
pub fn rounded(color: [f32; 3]) -> Rgb {
    color.map(|c| (c + 0.5) as u8) // `as` holds it within 0..=255
}

/// Colour of a pixel of ground that is not known.
pub fn void_color(x: usize, y: usize) -> Rgb {
    if (x + y).is_multiple_of(9) { VOID_HATCH } else { VOID }
}

/// How a sheet calls a coordinate reference system.
pub fn crs_name(crs: &Crs) -> String {
    match crs {
        Crs::Epsg(code) => format!("EPSG:{code}"),
        Crs::Local => "local metres".to_owned(),
        Crs::Proj(_) => "own projection".to_owned(),
    }
}

/// A bar of a round length with its upper left corner at `[x, y]`, labelled above.
pub fn scale_bar(canvas: &mut Canvas, lettering: &Lettering, [x, y]: [u32; 2], m_per_px: f64) {
    let length_m = scale::round_down(LONGEST_BAR_PX * m_per_px);
    let length_px = length_m / m_per_px;
    let bar = Rect { x, y, width: length_px.round() as u32, height: 8 };
    let quarter = (f64::from(bar.width) / 4.0).max(1.0);
    canvas.paint(bar, |px, _| {
        // four fields, dark and light in turn
        if ((f64::from(px) / quarter) as u32).is_multiple_of(2) { INK } else { PAPER }
    });
    canvas.frame(bar, INK);
    let (left, right, y) = (x as f32, bar.right() as f32, y as f32 - 10.0);
    lettering.draw(canvas, left, y, Align::Left, "0", LABEL);
    lettering.draw(canvas, right, y, Align::Center, &scale::length_label(length_m), LABEL);
}

/// An arrow to the north whose tip is `[x, y]`.
pub fn north_arrow(canvas: &mut Canvas, lettering: &Lettering, [x, y]: [u32; 2]) {
    let (x, y) = (x as f32, y as f32);
    let (tip, foot, notch) = ([x, y], y + 38.0, [x, y + 29.0]);
    canvas.polygon(&[tip, [x + 11.0, foot], notch], GREY_INK);
    canvas.polygon(&[tip, notch, [x - 11.0, foot]], INK);
    let style = Style { bold: true, ..LABEL };
    lettering.draw(canvas, x, y + 56.0, Align::Center, "N", style);
}
