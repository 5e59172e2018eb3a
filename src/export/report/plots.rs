//! Plots of a report, as SVG that lies in the page.

use std::fmt::Write;

use crate::export::scale;

const WIDTH: f64 = 520.0;
const HEIGHT: f64 = 220.0;
/// Room for the scales: left, right, top, bottom.
const MARGIN: [f64; 4] = [58.0, 10.0, 10.0, 38.0];
/// Ticks that a scale has at most.
const TICKS: usize = 6;

/// Bars stacked by kind, side by side.
pub struct Bars<'a> {
    /// What the bars count, with its unit.
    pub y_label: &'a str,
    /// What they are counted by, with its unit.
    pub x_label: &'a str,
    /// A label a bar; empty ones are left out.
    pub labels: Vec<String>,
    /// Kinds with their colour and a value a bar.
    pub kinds: Vec<(&'a str, [u8; 3], Vec<f64>)>,
}

impl Bars<'_> {
    /// The plot.
    pub fn svg(&self) -> String {
        let sums: Vec<f64> = (0..self.labels.len())
            .map(|bar| self.kinds.iter().map(|(_, _, values)| values[bar]).sum())
            .collect();
        let most = sums.iter().copied().fold(0.0, f64::max);
        let mut svg = String::new();
        let [left, right, top, bottom] = MARGIN;
        let (wide, high) = (WIDTH - left - right, HEIGHT - top - bottom);
        begin(&mut svg, self.y_label, self.x_label, most);
        let each = wide / self.labels.len().max(1) as f64;
        for (bar, label) in self.labels.iter().enumerate() {
            let x = left + each * bar as f64;
            let mut below = 0.0;
            for (name, color, values) in &self.kinds {
                let part = values[bar] / most.max(1e-9) * high;
                if part > 0.0 {
                    let y = HEIGHT - bottom - below - part;
                    let _ = write!(
                        svg,
                        "<rect x='{:.1}' y='{y:.1}' width='{:.1}' height='{part:.1}' fill='{}'><title>{}: {}</title></rect>",
                        x + 0.08 * each,
                        0.84 * each,
                        css(*color),
                        escaped(name),
                        short(values[bar])
                    );
                    below += part;
                }
            }
            if !label.is_empty() {
                let _ = write!(
                    svg,
                    "<text x='{:.1}' y='{:.1}' text-anchor='middle'>{}</text>",
                    x + 0.5 * each,
                    HEIGHT - bottom + 14.0,
                    escaped(label)
                );
            }
        }
        svg.push_str("</svg>");
        svg
    }
}

/// Points of two measures.
pub struct Scatter<'a> {
    /// What y is, with its unit.
    pub y_label: &'a str,
    /// What x is, with its unit.
    pub x_label: &'a str,
    /// Places and colours.
    pub points: Vec<([f64; 2], [u8; 3])>,
}

impl Scatter<'_> {
    /// The plot.
    pub fn svg(&self) -> String {
        let most =
            |axis: usize| self.points.iter().map(|(at, _)| at[axis]).fold(1e-9, f64::max) * 1.03;
        let (most_x, most_y) = (most(0), most(1));
        let mut svg = String::new();
        let [left, right, top, bottom] = MARGIN;
        let (wide, high) = (WIDTH - left - right, HEIGHT - top - bottom);
        begin(&mut svg, self.y_label, self.x_label, most_y);
        for tick in scale::ticks(0.0, most_x, TICKS) {
            let x = left + tick / most_x * wide;
            let y = HEIGHT - bottom + 14.0;
            let _ = write!(
                svg,
                "<text x='{x:.1}' y='{y:.1}' text-anchor='middle'>{}</text>",
                short(tick)
            );
        }
        for ([x, y], color) in &self.points {
            let _ = write!(
                svg,
                "<circle cx='{:.1}' cy='{:.1}' r='1.8' fill='{}' fill-opacity='0.6'/>",
                left + x / most_x * wide,
                HEIGHT - bottom - y / most_y * high,
                css(*color)
            );
        }
        svg.push_str("</svg>");
        svg
    }
}

/// The frame, its labels and the scale of y.
fn begin(svg: &mut String, y_label: &str, x_label: &str, most_y: f64) {
    let [left, right, top, bottom] = MARGIN;
    let high = HEIGHT - top - bottom;
    let _ = write!(svg, "<svg viewBox='0 0 {WIDTH} {HEIGHT}' role='img'>");
    for tick in scale::ticks(0.0, most_y, TICKS) {
        let y = HEIGHT - bottom - tick / most_y.max(1e-9) * high;
        let _ = write!(
            svg,
            "<line x1='{left}' x2='{}' y1='{y:.1}' y2='{y:.1}' class='grid'/><text x='{}' y='{:.1}' text-anchor='end'>{}</text>",
            WIDTH - right,
            left - 5.0,
            y + 4.0,
            short(tick)
        );
    }
    let _ = write!(
        svg,
        "<text x='{:.1}' y='{:.1}' text-anchor='middle'>{}</text><text transform='translate(12 {:.1}) rotate(-90)' text-anchor='middle'>{}</text>",
        0.5 * (left + WIDTH - right),
        HEIGHT - 6.0,
        escaped(x_label),
        0.5 * (top + HEIGHT - bottom),
        escaped(y_label)
    );
}

/// A number in three digits or so.
pub fn short(value: f64) -> String {
    let size = value.abs();
    let decimals = match size {
        _ if value == value.round() && size < 1e6 => 0,
        100.0.. => 0,
        10.0.. => 1,
        1.0.. => 2,
        _ => 3,
    };
    let digits = format!("{size:.decimals$}");
    let (whole, rest) = digits.split_once('.').map_or((&digits[..], ""), |(a, b)| (a, b));
    let mut grouped = String::new();
    for (place, digit) in whole.chars().enumerate() {
        if place > 0 && (whole.len() - place).is_multiple_of(3) {
            grouped.push('\u{202f}'); // narrow, does not break
        }
        grouped.push(digit);
    }
    let sign = if value < 0.0 { "−" } else { "" };
    if rest.is_empty() { format!("{sign}{grouped}") } else { format!("{sign}{grouped}.{rest}") }
}

/// Text as it may stand in a page.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('\'', "&#39;")
}

/// A colour of a style.
pub fn css([red, green, blue]: [u8; 3]) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_grouped() {
        let texts = [0.0, 0.0123, 1.234, 45.67, 1234.5, 2_345_678.9, -12.0].map(short);
        assert_eq!(
            texts,
            ["0", "0.012", "1.23", "45.7", "1\u{202f}234", "2\u{202f}345\u{202f}679", "−12"]
        );
    }

    #[test]
    fn a_bar_is_as_high_as_its_value() {
        let bars = Bars {
            y_label: "trees",
            x_label: "m",
            labels: vec!["a".into(), "b".into()],
            kinds: vec![("x & y", [1, 2, 3], vec![5.0, 10.0])],
        };
        let svg = bars.svg();
        assert!(svg.contains("height='172.0' fill='#010203'><title>x &amp; y: 10<"), "{svg}");
        assert!(svg.contains("height='86.0' fill='#010203'"), "{svg}");
    }
}
