//! A chart: quantities over the years as lines or stacked bars, with round ticks, and marks beside each other.

use super::canvas::{Canvas, Rect};
use super::furniture::{CAPTION, GREY_INK, INK, LABEL, UNIT};
use super::lettering::{Align, Lettering};
use super::ramp::Rgb;
use super::scale;
use super::species_legend::thousands;

/// Lines of the grid.
const GRID: Rgb = [226, 224, 218];
/// Behind the grid.
const GROUND: Rgb = [255, 255, 253];
/// Room over the highest value.
const HEADROOM: f64 = 1.06;
/// Least room for a tick of the upright axis.
const TICK_PX: u32 = 32;
/// Width of a line, and of the dot that a single value is.
const LINE_PX: f32 = 2.2;
const DOT_PX: f32 = 7.0;
/// Bars narrower than this have no gap between them.
const GAPLESS_PX: f32 = 5.0;

/// Where values lie on a sheet.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    rect: Rect,
    /// First and last year.
    years: [f64; 2],
    /// Value of the upper edge; the lower one is 0.
    top: f64,
}

impl Chart {
    /// A chart of values from 0 up to `most`; nothing but zeros is spread up to 1.
    pub fn new(rect: Rect, years: [f64; 2], most: f64) -> Self {
        let top = if most > 0.0 && most.is_finite() { most * HEADROOM } else { 1.0 };
        Self { rect, years, top }
    }

    /// Column of a year.
    pub fn x(&self, year: f64) -> f32 {
        let [first, last] = self.years;
        let along = (year - first) / (last - first).max(f64::MIN_POSITIVE);
        self.rect.x as f32 + (along * f64::from(self.rect.width)) as f32 // pixels of a sheet
    }

    fn y(&self, value: f64) -> f32 {
        self.rect.bottom() as f32 - (value / self.top * f64::from(self.rect.height)) as f32
    }

    /// Years of the level axis that are labelled.
    fn year_ticks(&self) -> Vec<f64> {
        let ticks = scale::ticks(self.years[0], self.years[1], 12);
        ticks.into_iter().filter(|year| year.fract() == 0.0).collect()
    }

    /// Ground, grid, and the labels of the upright axis; title and unit stand above. Gives the column where they end.
    pub fn axes(&self, canvas: &mut Canvas, lettering: &Lettering, title: &str, unit: &str) -> f32 {
        let Rect { x, y, height, .. } = self.rect;
        canvas.paint(self.rect, |_, _| GROUND);
        let (left, right) = (x as f32, self.rect.right() as f32);
        for year in self.year_ticks() {
            let at = self.x(year).round() + 0.5;
            canvas.polyline(&[[at, y as f32], [at, self.rect.bottom() as f32]], 1.0, GRID, 1.0);
        }
        let at_most = (height / TICK_PX).clamp(2, 8) as usize;
        let ticks = scale::ticks(0.0, self.top, at_most);
        let decimals = decimals_of(&ticks);
        for tick in ticks {
            let at = self.y(tick).round() + 0.5;
            canvas.polyline(&[[left, at], [right, at]], 1.0, GRID, 1.0);
            canvas.polyline(&[[left - 6.0, at], [left, at]], 1.0, GREY_INK, 1.0);
            let label = match decimals {
                0 => thousands(tick as usize), // not negative
                _ => scale::fixed(tick, decimals),
            };
            lettering.draw(canvas, left - 11.0, at + 5.0, Align::Right, &label, LABEL);
        }
        lettering.draw(canvas, left, y as f32 - 12.0, Align::Left, title, CAPTION);
        let after = left + lettering.width_px(title, CAPTION) + 10.0;
        lettering.draw(canvas, after, y as f32 - 12.0, Align::Left, unit, UNIT);
        after + lettering.width_px(unit, UNIT) + 4.0
    }

    /// The two axes' lines, over what is drawn between them.
    pub fn close(&self, canvas: &mut Canvas) {
        let (left, bottom) = (self.rect.x as f32 - 0.5, self.rect.bottom() as f32 + 0.5);
        let right = self.rect.right() as f32;
        let corner = [left, bottom];
        canvas.polyline(&[[left, self.rect.y as f32], corner, [right, bottom]], 1.0, GREY_INK, 1.0);
        for year in self.year_ticks() {
            let at = self.x(year).round() + 0.5;
            canvas.polyline(&[[at, bottom], [at, bottom + 5.0]], 1.0, GREY_INK, 1.0);
        }
    }

    /// Labels of the years below.
    pub fn year_labels(&self, canvas: &mut Canvas, lettering: &Lettering, title: &str) {
        let y = self.rect.bottom() as f32 + 22.0;
        for year in self.year_ticks() {
            let label = scale::fixed(year, 0);
            lettering.draw(canvas, self.x(year), y, Align::Center, &label, LABEL);
        }
        let middle = self.rect.x as f32 + self.rect.width as f32 / 2.0;
        lettering.draw(canvas, middle, y + 22.0, Align::Center, title, UNIT);
    }

    /// A line through values; a single one is a dot.
    pub fn line(&self, canvas: &mut Canvas, values: &[(f64, f64)], color: Rgb) {
        let points: Vec<_> = values.iter().map(|&(year, v)| [self.x(year), self.y(v)]).collect();
        let width = if points.len() == 1 { DOT_PX } else { LINE_PX };
        canvas.polyline(&points, width, color, 1.0);
    }

    /// A bar for the year that ends at `year`, of parts from the bottom up.
    pub fn bar(&self, canvas: &mut Canvas, year: f64, parts: &[(f64, Rgb)]) {
        let (left, right) = (self.x(year - 1.0).round(), self.x(year).round());
        let gap = if right - left >= GAPLESS_PX { 1.0 } else { 0.0 };
        let right = (right - gap).max(left + 1.0);
        let mut sum = 0.0;
        for &(value, color) in parts {
            let below = self.y(sum).round();
            sum += value;
            let above = self.y(sum).round();
            let [x, y] = [left, above].map(|n| n.max(0.0) as u32); // on the sheet
            let [width, height] = [right - left, below - above].map(|n| n.max(0.0) as u32);
            canvas.paint(Rect { x, y, width, height }, |_, _| color);
        }
    }

    /// An upright line through the chart.
    pub fn mark(&self, canvas: &mut Canvas, year: f64) {
        mark_line(canvas, self.x(year), [self.rect.y, self.rect.bottom()].map(|y| y as f32));
    }
}

/// A mark's line at a column between two rows.
pub fn mark_line(canvas: &mut Canvas, x: f32, [top, bottom]: [f32; 2]) {
    canvas.polyline(&[[x, top], [x, bottom]], 1.0, INK, 0.45);
}

/// Decimals that tell ticks apart.
fn decimals_of(ticks: &[f64]) -> usize {
    let step = ticks.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::MAX, f64::min);
    match step {
        s if s >= 0.99 => 0,
        s if s >= 0.099 => 1,
        s if s >= 0.0099 => 2,
        _ => 3,
    }
}

/// A label beside or over a mark, and how it is placed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tag {
    /// Column of its mark.
    pub x: f32,
    /// Column where it would like to begin.
    pub left: f32,
    /// Its width.
    pub width: f32,
}

/// Rows for tags, 0 the uppermost, so that no tag lies over another or under another's line, which comes up to its tag
/// from below; with the column that each begins at, none beyond `right`. `None` for a tag without room.
pub fn place(tags: &[Tag], rows: usize, right: f32) -> Vec<Option<(usize, f32)>> {
    const APART_PX: f32 = 6.0;
    let mut placed: Vec<(Tag, usize)> = Vec::new();
    let mut place_one = |tag: &Tag| {
        let left = tag.left.min(right - tag.width);
        let (from, to) = (left - APART_PX, left + tag.width + APART_PX);
        let row = (0..rows).find(|&row| {
            placed.iter().all(|(other, other_row)| {
                let is_over = other.left < to && from < other.left + other.width;
                let other_line_crosses = *other_row < row && (from..to).contains(&other.x);
                let line_crosses = *other_row > row
                    && (other.left - APART_PX..other.left + other.width).contains(&tag.x);
                !(other_line_crosses || line_crosses || *other_row == row && is_over)
            })
        })?;
        placed.push((Tag { left, ..*tag }, row));
        Some((row, left))
    };
    tags.iter().map(&mut place_one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_do_not_overlap_and_lines_do_not_cross_them() {
        let tags: Vec<Tag> = [10.0, 40.0, 60.0, 300.0, 310.0, 380.0]
            .map(|x| Tag { x, left: x + 4.0, width: 50.0 })
            .to_vec();
        let places = place(&tags, 3, 400.0);
        let [first, .., last] = [places[0], places[1], places[5]].map(Option::unwrap);
        assert_eq!(first, (0, 14.0));
        assert!(last.1 + 50.0 <= 400.0);
        let placed: Vec<_> = tags
            .iter()
            .zip(&places)
            .filter_map(|(t, p)| p.map(|(row, left)| (t, row, left)))
            .collect();
        assert!(placed.len() >= 5, "{places:?}");
        for (i, (tag, row, left)) in placed.iter().enumerate() {
            for (j, (_, other_row, other_left)) in
                placed.iter().enumerate().filter(|(j, _)| *j != i)
            {
                let is_over = left < &(other_left + 50.0) && other_left < &(left + 50.0);
                assert!(row != other_row || !is_over, "{i} and {j}");
                let crosses = row < other_row && (*other_left..other_left + 50.0).contains(&tag.x);
                assert!(!crosses, "line of {i} through {j}");
            }
        }
        assert_eq!(place(&tags[..1].repeat(4), 3, 400.0).iter().flatten().count(), 1);
    }

    #[test]
    fn values_stand_in_proportion_and_zeros_on_the_axis() {
        let rect = Rect { x: 100, y: 50, width: 200, height: 106 };
        let chart = Chart::new(rect, [0.0, 50.0], 10.0);
        assert!((chart.y(0.0) - 156.0).abs() < 1e-3 && (chart.y(10.0) - 56.0).abs() < 1e-3);
        assert_eq!([chart.x(0.0), chart.x(25.0)], [100.0, 200.0]);
        assert_eq!(Chart::new(rect, [0.0, 1.0], 0.0).y(0.0), 156.0);
        assert_eq!(decimals_of(&[0.0, 0.2]), 1);
    }
}
