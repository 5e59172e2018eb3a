//! Where things stand on a sheet: one large map, up to four small ones, heading and legend.

use super::canvas::Rect;
use super::species_legend;

/// Empty paper around everything.
pub const MARGIN_PX: u32 = 48;
/// Room for title and subtitle.
pub const HEADER_PX: u32 = 82;
/// Room for scale bar and legend.
pub const FOOTER_PX: u32 = 92;
/// Room for a small map's title above it.
pub const CAPTION_PX: u32 = 30;
/// Room for a small map's colour ramp below it.
pub const RAMP_PX: u32 = 46;
/// Space between maps.
const GAP_PX: f64 = 28.0;
/// Space between the large map and the small ones.
const GUTTER_PX: f64 = 44.0;
/// Width that heading and maps fill where the map's shape allows it: 1600 with margins.
const CONTENT_PX: f64 = 1504.0;
/// Least width, for the legend's sake.
const LEAST_CONTENT_PX: u32 = 860;
/// Tallest large map.
const TALLEST_PX: f64 = 900.0;
/// Width a small map's title needs.
pub const LEAST_SLOT_PX: f64 = 150.0;

/// Places of a sheet's parts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sheet {
    /// Width of the sheet.
    pub width: u32,
    /// Height of the sheet.
    pub height: u32,
    /// The large map.
    pub map: Rect,
    /// The small maps.
    pub panels: Vec<Rect>,
    /// Scale bar, north arrow and legend.
    pub footer: Rect,
    /// The legend of species, where there is one.
    pub species: Option<Rect>,
}

/// Room for a line on deadwood below the legend of species.
pub const DEADWOOD_PX: u32 = 26;
/// Room in the footer for scale bar, north arrow and elevation.
const FOOTER_ITEMS_PX: u32 = 820;

impl Sheet {
    /// The sheet with room for a legend of so many species: right of the elevations where it fits, else below.
    pub fn with_species(self, entries: usize) -> Self {
        let footer = self.footer;
        let beside_x = self
            .panels
            .first()
            .map_or(0, |p| p.x)
            .clamp(footer.x + FOOTER_ITEMS_PX, footer.right().max(footer.x + FOOTER_ITEMS_PX));
        let room = footer.right() - beside_x.min(footer.right());
        let rect = |x: u32, y: u32, width: u32| {
            let height = species_legend::height_px(entries, width);
            Rect { x, y, width, height }
        };
        let legend = if room >= 2 * species_legend::COLUMN_PX + species_legend::COLUMN_GAP_PX {
            rect(beside_x, footer.y, room)
        } else {
            rect(footer.x, footer.bottom() + 6, footer.width)
        };
        let height = footer.height.max(legend.bottom() - footer.y);
        let footer = Rect { height, ..footer };
        let height = footer.bottom() + MARGIN_PX / 2;
        Self { height, footer, species: Some(legend), ..self }
    }

    /// The sheet with room for a line on deadwood below its legend of species.
    pub fn with_deadwood(self) -> Self {
        let Some(legend) = self.species else { return self };
        let legend = Rect { height: legend.height + DEADWOOD_PX, ..legend };
        let height = self.footer.height.max(legend.bottom() - self.footer.y);
        let footer = Rect { height, ..self.footer };
        let height = footer.bottom() + MARGIN_PX / 2;
        Self { height, footer, species: Some(legend), ..self }
    }
}

/// The sheet of a map `aspect` times as wide as high with `panels` small maps.
///
/// Maps of common shapes have the small ones beside them in two columns, wide ones below in a row or as strips,
/// tall ones beside in one row.
pub fn arrange(aspect: f64, panels: usize) -> Sheet {
    let (x0, y0) = (f64::from(MARGIN_PX), f64::from(MARGIN_PX + HEADER_PX));
    let (caption, furniture) = (f64::from(CAPTION_PX), f64::from(CAPTION_PX + RAMP_PX));
    // left, top, width of each small map; and the large map's width
    let mut small: Vec<(f64, f64, f64)> = Vec::new();
    let map_width;
    if panels == 0 {
        map_width = CONTENT_PX.min(TALLEST_PX * aspect);
    } else if aspect >= 4.0 {
        map_width = CONTENT_PX;
        let step = CONTENT_PX / aspect + furniture + GAP_PX / 2.0;
        for i in 0..panels {
            let top = y0 + CONTENT_PX / aspect + GAP_PX + i as f64 * step + caption;
            small.push((x0, top, CONTENT_PX));
        }
    } else if aspect >= 1.55 {
        map_width = CONTENT_PX.min(720.0 * aspect);
        let width = (map_width - 3.0 * GAP_PX) / 4.0;
        for i in 0..panels {
            let left = x0 + i as f64 * (width + GAP_PX);
            small.push((left, y0 + map_width / aspect + GAP_PX + caption, width));
        }
    } else if aspect >= 0.6 {
        // two rows with their captions as high as the large map: 2 (w/a + furniture) + gap = W/a
        let lost = (2.0 * furniture + GAP_PX) * aspect;
        map_width = ((CONTENT_PX - GUTTER_PX - GAP_PX + lost) / 2.0).min(TALLEST_PX * aspect);
        let width = (map_width - lost) / 2.0;
        for i in 0..panels {
            let left = x0 + map_width + GUTTER_PX + (i % 2) as f64 * (width + GAP_PX);
            let step = width / aspect + furniture + GAP_PX;
            small.push((left, y0 + caption + (i / 2) as f64 * step, width));
        }
    } else {
        map_width = TALLEST_PX * aspect;
        let room = (CONTENT_PX - map_width - GUTTER_PX - 3.0 * GAP_PX) / 4.0;
        let width = room.min((TALLEST_PX - furniture) * aspect);
        for i in 0..panels {
            let step = width.max(LEAST_SLOT_PX) + GAP_PX;
            let left = x0 + map_width.max(LEAST_SLOT_PX) + GUTTER_PX + i as f64 * step;
            small.push((left, y0 + caption, width));
        }
    }

    let rect = |x: f64, y: f64, width: f64| Rect {
        // pixels of a sheet: small positive numbers
        x: x.round() as u32,
        y: y.round() as u32,
        width: (width.round() as u32).max(1),
        height: ((width / aspect).round() as u32).max(1),
    };
    let map = rect(x0, y0, map_width);
    let panels: Vec<Rect> = small.into_iter().map(|(x, y, width)| rect(x, y, width)).collect();
    let right = panels.iter().map(Rect::right).fold(map.right(), u32::max);
    let content = (right - MARGIN_PX).max(LEAST_CONTENT_PX);
    let bottom = panels.iter().map(|p| p.bottom() + RAMP_PX).fold(map.bottom(), u32::max);
    // beside a map of common shape the small maps' ramps end where the map ends; the footer stands below both
    let footer = Rect { x: MARGIN_PX, y: bottom + 18, width: content, height: FOOTER_PX };
    Sheet {
        width: content + 2 * MARGIN_PX,
        height: footer.bottom() + MARGIN_PX / 2,
        map,
        panels,
        footer,
        species: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn overlap(a: Rect, b: Rect) -> bool {
        a.x < b.right() && b.x < a.right() && a.y < b.bottom() && b.y < a.bottom()
    }

    #[test]
    fn nothing_overlaps_and_all_lies_on_the_sheet() {
        for aspect in [0.05, 0.3, 0.59, 0.6, 0.8, 1.0, 1.5, 1.6, 2.5, 3.9, 4.0, 20.0] {
            for count in 0..=4 {
                let sheet = arrange(aspect, count);
                let mut slots = vec![sheet.map, sheet.footer];
                slots.extend(sheet.panels.iter().map(|p| Rect {
                    y: p.y - CAPTION_PX,
                    height: p.height + CAPTION_PX + RAMP_PX,
                    ..*p
                }));
                for (i, a) in slots.iter().enumerate() {
                    assert!(a.right() + MARGIN_PX <= sheet.width && a.bottom() <= sheet.height);
                    for b in &slots[i + 1..] {
                        assert!(!overlap(*a, *b), "aspect {aspect}, {count} panels: {a:?} {b:?}");
                    }
                }
                assert_eq!(sheet.panels.len(), count);
            }
        }
    }

    #[test]
    fn a_species_legend_has_room_of_its_own() {
        for aspect in [0.05, 0.3, 0.6, 1.0, 1.5, 2.5, 20.0] {
            for entries in [0, 1, 7, 16] {
                let sheet = arrange(aspect, 4).with_species(entries);
                let legend = sheet.species.unwrap();
                assert!(legend.right() + MARGIN_PX <= sheet.width, "{aspect}: {legend:?}");
                assert!(legend.bottom() < sheet.height && legend.y >= sheet.footer.y);
                let items = Rect { width: FOOTER_ITEMS_PX, height: FOOTER_PX, ..sheet.footer };
                assert!(!overlap(legend, items), "aspect {aspect}: {legend:?}");
                assert!(sheet.panels.iter().all(|p| !overlap(legend, *p)));
            }
        }
    }

    #[test]
    fn a_square_tile_fills_a_sheet_of_about_1600_by_1100() {
        let sheet = arrange(1.0, 4);
        assert!(sheet.width.abs_diff(1600) < 40, "{sheet:?}");
        assert!(sheet.height.abs_diff(1100) < 60, "{sheet:?}");
    }

    #[test]
    fn maps_keep_their_shape() {
        for aspect in [0.4, 1.0, 1.3, 2.0, 6.0] {
            let sheet = arrange(aspect, 4);
            for r in std::iter::once(&sheet.map).chain(&sheet.panels) {
                let got = f64::from(r.width) / f64::from(r.height);
                assert!((got / aspect - 1.0).abs() < 0.02, "{aspect}: {r:?}");
            }
        }
    }
}
