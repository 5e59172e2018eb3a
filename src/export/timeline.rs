//! A timeline: how basal area of species, snags and downed logs went over the years, and what plants died of.
//!
//! # Reference
//! Peytavie et al. 2024, Fig. 27, which has the first two charts.

use std::collections::BTreeMap;

use image::RgbImage;

use super::canvas::{Canvas, Rect};
use super::chart::{self, Chart, Tag};
use super::furniture::{CAPTION, INK, LABEL, NAME, PAPER, SUBTITLE, TITLE, UNIT};
use super::layout::MARGIN_PX;
use super::lettering::{Align, Lettering, Style};
use super::ramp::Rgb;
use super::scale;
use super::species_legend::thousands;
use crate::plants::deadwood::{Cause, TimelineRow};
use crate::species::Biome;

/// Size of the picture.
const SIZE_PX: [u32; 2] = [1600, 1200];
/// Room left of the charts for numbers, and right of them for legends.
const AXIS_PX: u32 = 62;
const LEGEND_PX: u32 = 316;
const LEGEND_GAP_PX: u32 = 28;
/// Where the labels of marks begin, the height of a row of them, and the most rows.
const TAGS_Y: u32 = 124;
const TAG_PX: u32 = 19;
const TAG_ROWS: usize = 3;
/// Room for a chart's title, and for the years below the last.
const TITLE_PX: u32 = 34;
const YEARS_PX: u32 = 54;
/// Space between charts.
const GAP_PX: u32 = 22;
/// How the charts share the height.
const SHARES: [f64; 3] = [0.46, 0.33, 0.21];
/// Height of a line of a legend, and of the key of marks.
const ROW_PX: u32 = 24;
const KEY_COLUMNS: u32 = 4;
const KEY_ROWS: u32 = 4;

/// Species whose basal area never reaches this share of the greatest sum of all are left out.
const LEAST_SHOWN_FRACTION: f64 = 0.005;
/// Most species with a line.
const MOST_SPECIES: usize = 14;

const LIVE: Rgb = [46, 122, 62];
const SNAGS: Rgb = [116, 118, 124];
const DOWNED_LOGS: Rgb = [152, 92, 42];

const TAG: Style = Style { size_px: 13.0, bold: false, color: INK };
const NUMBER: Style = Style { size_px: 13.0, bold: true, color: INK };
const SMALL: Style = Style { size_px: 12.0, ..UNIT };

/// Something to be marked on the timeline.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TimelineMark {
    /// Year of the simulation, from 1.
    pub year: u16,
    /// Month, 1–12.
    pub month: u8,
    /// What it was.
    pub label: String,
}

impl TimelineMark {
    /// Its place among the states at the ends of years: the first year lies between 0 and 1.
    fn years(&self) -> f64 {
        f64::from(self.year) - 1.0 + (f64::from(self.month) - 0.5) / 12.0
    }
}

/// Colour of a cause of death.
fn color_of(cause: Cause) -> Rgb {
    match cause {
        Cause::Age => [138, 128, 118],
        Cause::Competition => [122, 166, 96],
        Cause::Drought => [226, 182, 66],
        Cause::Disease => [146, 98, 168],
        Cause::Fire => [206, 80, 44],
        Cause::Storm => [70, 124, 178],
        Cause::Decay => [110, 78, 52],
        Cause::SelfPruning => [176, 196, 160],
    }
}

/// What one line of a chart shows.
#[derive(Clone, Debug, PartialEq)]
struct Series {
    name: String,
    color: Rgb,
    /// One a year, in the order of the years.
    values: Vec<f64>,
}

impl Series {
    fn most(&self) -> f64 {
        self.values.iter().copied().fold(0.0, f64::max)
    }

    fn last(&self) -> f64 {
        self.values.last().copied().unwrap_or(0.0)
    }
}

/// What the rows say, year by year.
#[derive(Clone, Debug, PartialEq)]
struct Years {
    years: Vec<u16>,
    /// The species that are shown, those with most basal area at the end first; and the number of others that had any.
    species: Vec<Series>,
    left_out: usize,
    /// Live, snags, downed logs.
    stages: [Series; 3],
    /// Deaths of each year, in the order of [`Cause::ALL`].
    deaths: Vec<[f64; 8]>,
}

impl Years {
    fn of(rows: &[TimelineRow], biome: &Biome) -> Self {
        let mut place: BTreeMap<u16, usize> = rows.iter().map(|row| (row.year, 0)).collect();
        for (index, at) in place.values_mut().enumerate() {
            *at = index;
        }
        let years: Vec<u16> = place.keys().copied().collect();
        let none = vec![0.0_f64; years.len()];
        let mut species = vec![none.clone(); biome.species.len()];
        let mut stages = [none.clone(), none.clone(), none];
        let mut deaths = vec![[0.0_f64; 8]; years.len()];
        for row in rows {
            let year = place[&row.year];
            let areas_m2_ha = [row.live_m2_ha, row.snag_m2_ha, row.downed_log_m2_ha].map(f64::from);
            species[usize::from(row.species)][year] += areas_m2_ha[0];
            for (stage, area_m2_ha) in stages.iter_mut().zip(areas_m2_ha) {
                stage[year] += area_m2_ha;
            }
            for (sum, count) in deaths[year].iter_mut().zip(row.tree_deaths) {
                *sum += f64::from(count);
            }
        }

        let greatest = stages[0].iter().copied().fold(0.0, f64::max);
        let mut lines: Vec<Series> = species
            .into_iter()
            .zip(&biome.species)
            .map(|(values, species)| Series {
                name: species.common_name.clone(),
                color: species.color_srgb,
                values,
            })
            .filter(|series| series.most() > 0.0)
            .collect();
        let present = lines.len();
        lines.retain(|series| series.most() >= LEAST_SHOWN_FRACTION * greatest);
        // stable: equals stay in the biome's order
        lines.sort_by(|a, b| b.most().total_cmp(&a.most()));
        lines.truncate(MOST_SPECIES);
        lines.sort_by(|a, b| b.last().total_cmp(&a.last()));
        let left_out = present - lines.len();
        let [live, snags, downed_logs] = stages;
        let stage = |name: &str, color, values| Series { name: name.to_owned(), color, values };
        let stages = [
            stage("Live", LIVE, live),
            stage("Snags", SNAGS, snags),
            stage("Downed logs", DOWNED_LOGS, downed_logs),
        ];
        Self { years, species: lines, left_out, stages, deaths }
    }

    /// First and last year of the axis.
    fn span(&self) -> [f64; 2] {
        let first = self.years.first().map_or(0.0, |year| f64::from(*year));
        let last = self.years.last().map_or(1.0, |year| f64::from(*year));
        match last {
            _ if last > first => [first, last],
            // a single year has its own twelve months, the state that a simulation began with those to come
            0.0 => [0.0, 1.0],
            _ => [last - 1.0, last],
        }
    }

    fn points(&self, series: &Series) -> Vec<(f64, f64)> {
        self.years.iter().map(|year| f64::from(*year)).zip(series.values.iter().copied()).collect()
    }

    /// Causes that anything died of, with the number of deaths.
    fn causes(&self) -> Vec<(usize, f64)> {
        let sum = |cause: usize| self.deaths.iter().map(|year| year[cause]).sum::<f64>();
        (0..8).map(|cause| (cause, sum(cause))).filter(|(_, deaths)| *deaths > 0.0).collect()
    }
}

/// Marks that lie within the years, in their order, and how they are told: by their own labels, or by numbers.
struct Marks<'a> {
    marks: Vec<&'a TimelineMark>,
    /// What stands at each, and in which row and column.
    tags: Vec<(String, Option<(usize, f32)>)>,
    /// What the numbers mean, and how often each happened; empty where labels stand at the marks.
    key: Vec<(&'a str, Vec<u16>)>,
}

impl<'a> Marks<'a> {
    fn of(events: &'a [TimelineMark], axis: &Chart, [first, last]: [f64; 2], pen: &Pen) -> Self {
        let mut marks: Vec<&TimelineMark> =
            events.iter().filter(|mark| (first..=last).contains(&mark.years())).collect();
        marks.sort_by_key(|mark| (mark.year, mark.month)); // stable
        let right = axis.x(last);
        let tagged = |labels: Vec<String>, style: Style, is_beside: bool| {
            let tags: Vec<Tag> = labels
                .iter()
                .zip(&marks)
                .map(|(label, mark)| {
                    let (x, width) = (axis.x(mark.years()), pen.lettering.width_px(label, style));
                    Tag { x, left: if is_beside { x + 4.0 } else { x - width / 2.0 }, width }
                })
                .collect();
            let places = chart::place(&tags, TAG_ROWS, right + if is_beside { 0.0 } else { 12.0 });
            labels.into_iter().zip(places).collect::<Vec<_>>()
        };
        let tags = tagged(marks.iter().map(|mark| mark.label.clone()).collect(), TAG, true);
        if tags.iter().all(|(_, place)| place.is_some()) {
            return Self { marks, tags, key: Vec::new() };
        }
        let mut key: Vec<(&str, Vec<u16>)> = Vec::new();
        let mut numbers = Vec::new();
        for mark in &marks {
            let at = key.iter().position(|(label, _)| *label == mark.label).unwrap_or(key.len());
            if at == key.len() {
                key.push((&mark.label, Vec::new()));
            }
            key[at].1.push(mark.year);
            numbers.push((at + 1).to_string());
        }
        let tags = tagged(numbers, NUMBER, false);
        Self { marks, tags, key }
    }

    fn key_rows(&self) -> u32 {
        (self.key.len() as u32).div_ceil(KEY_COLUMNS).min(KEY_ROWS) // a few rows
    }
}

/// One picture of 1600 × 1200 pixels: basal area of the species that matter, basal area of what lives, stands dead and
/// lies, deaths by cause; with `events` marked. The same picture for the same input on every machine.
///
/// # Panics
/// If a row's species is none of the biome's.
pub fn timeline(rows: &[TimelineRow], biome: &Biome, events: &[TimelineMark]) -> RgbImage {
    let years = Years::of(rows, biome);
    let [width, height] = SIZE_PX;
    let mut pen =
        Pen { canvas: Canvas::new(width, height, PAPER), lettering: Lettering::default() };
    let left = MARGIN_PX + AXIS_PX;
    let span = years.span();
    let wide = width - MARGIN_PX - LEGEND_PX - LEGEND_GAP_PX - left;
    let axis = Chart::new(Rect { x: left, y: 0, width: wide, height: 1 }, span, 1.0);
    let marks = Marks::of(events, &axis, span, &pen);

    // places
    let key_px = if marks.key.is_empty() { 0 } else { TITLE_PX + ROW_PX * marks.key_rows() };
    let tag_rows = if marks.marks.is_empty() { 0 } else { TAG_ROWS as u32 };
    let mut y = TAGS_Y + tag_rows * TAG_PX;
    let fixed = 3 * TITLE_PX + 2 * GAP_PX + YEARS_PX + key_px + MARGIN_PX;
    let room = f64::from(height - y - fixed);
    let rects = SHARES.map(|share| {
        let high = (share * room) as u32; // some hundred pixels
        let rect = Rect { x: left, y: y + TITLE_PX, width: wide, height: high };
        y = rect.bottom() + GAP_PX;
        rect
    });

    // charts
    pen.heading(&years, biome);
    let most = |some: &[Series]| some.iter().map(Series::most).fold(0.0, f64::max);
    let deaths = years.deaths.iter().map(|year| year.iter().sum::<f64>()).fold(0.0, f64::max);
    let charts = [most(&years.species), most(&years.stages), deaths];
    let charts: [Chart; 3] = std::array::from_fn(|i| Chart::new(rects[i], span, charts[i]));
    let titles = [
        ("Basal area by species", "m²/ha, live stems of 7.5 cm and more"),
        ("Basal area by life stage", "m²/ha"),
        ("Deaths", "trees of 7.5 cm and more a year, by cause"),
    ];
    let mut titled = [0.0; 3];
    for ((chart, (title, unit)), right) in charts.iter().zip(titles).zip(&mut titled) {
        *right = chart.axes(&mut pen.canvas, &pen.lettering, title, unit);
    }
    pen.marks(&charts, rects[0], titled[0], &marks);
    pen.lines(&charts[0], &years, &years.species);
    pen.lines(&charts[1], &years, &years.stages);
    for (year, deaths) in years.years.iter().zip(&years.deaths) {
        // the state that a simulation began with has no year before it
        if f64::from(*year) > span[0] {
            let parts: Vec<_> =
                deaths.iter().zip(Cause::ALL).map(|(n, cause)| (*n, color_of(cause))).collect();
            charts[2].bar(&mut pen.canvas, f64::from(*year), &parts);
        }
    }
    charts.iter().for_each(|chart| chart.close(&mut pen.canvas));
    charts[2].year_labels(&mut pen.canvas, &pen.lettering, "years of the simulation");

    // legends
    let x = rects[0].right() + LEGEND_GAP_PX;
    pen.species_legend(&years, [x, rects[0].y]);
    let last = years.years.last().map_or(0, |year| *year);
    let areas = |some: &[Series]| -> Vec<(String, Rgb, String)> {
        some.iter().map(|s| (s.name.clone(), s.color, area(s.last()))).collect()
    };
    if !years.years.is_empty() {
        let head = format!("m²/ha, year {last}");
        pen.legend(&areas(&years.stages), &head, [x, rects[1].y], false);
    }
    let causes: Vec<_> = years
        .causes()
        .into_iter()
        .map(|(cause, deaths)| {
            let cause = Cause::ALL[cause];
            (capital(cause.name()), color_of(cause), thousands(deaths as usize)) // a count
        })
        .collect();
    if !causes.is_empty() {
        pen.legend(&causes, "in all", [x, rects[2].y], true);
    }
    pen.key(&marks, [left, rects[2].bottom() + YEARS_PX + GAP_PX / 2]);
    pen.canvas.into_image()
}

/// A basal area in m²/ha in three digits or so.
fn area(m2_ha: f64) -> String {
    let decimals = if m2_ha >= 9.95 || m2_ha == 0.0 { 1 } else { 2 };
    scale::fixed(m2_ha, decimals)
}

/// A word with a capital at its head.
fn capital(word: &str) -> String {
    let mut letters = word.chars();
    letters.next().into_iter().flat_map(char::to_uppercase).chain(letters).collect()
}

/// Draws a timeline's parts.
struct Pen {
    canvas: Canvas,
    lettering: Lettering,
}

impl Pen {
    fn text(&mut self, x: u32, y: u32, align: Align, text: &str, style: Style) {
        self.lettering.draw(&mut self.canvas, x as f32, y as f32, align, text, style);
    }

    fn heading(&mut self, years: &Years, biome: &Biome) {
        let (x, right) = (MARGIN_PX, SIZE_PX[0] - MARGIN_PX);
        self.text(x, MARGIN_PX + 26, Align::Left, "Living and dead wood over the years", TITLE);
        let span = match years.years.as_slice() {
            [] => "no years".to_owned(),
            [only] => format!("year {only}"),
            [first, .., last] => format!("years {first}–{last}"),
        };
        let facts = format!("{}   ·   {span}", biome.name);
        self.text(x, MARGIN_PX + 57, Align::Left, &facts, SUBTITLE);
        let signature = Style { size_px: 13.0, ..UNIT };
        self.text(right, MARGIN_PX + 57, Align::Right, NAME, signature);
    }

    fn lines(&mut self, chart: &Chart, years: &Years, some: &[Series]) {
        // the greatest last, over the others
        let mut order: Vec<&Series> = some.iter().collect();
        order.sort_by(|a, b| a.most().total_cmp(&b.most()));
        for series in order {
            chart.line(&mut self.canvas, &years.points(series), series.color);
        }
    }

    /// Draws marks through all charts, and up to their tags past the first chart's title, which ends at `title_right`.
    fn marks(&mut self, charts: &[Chart; 3], first: Rect, title_right: f32, marks: &Marks<'_>) {
        let style = if marks.key.is_empty() { TAG } else { NUMBER };
        for (mark, (label, place)) in marks.marks.iter().zip(&marks.tags) {
            let years = mark.years();
            charts.iter().for_each(|chart| chart.mark(&mut self.canvas, years));
            let Some((row, left)) = *place else { continue };
            let tag_bottom = (TAGS_Y + TAG_PX * (row as u32 + 1)) as f32; // a few rows
            self.lettering.draw(
                &mut self.canvas,
                left,
                tag_bottom - 5.0,
                Align::Left,
                label,
                style,
            );
            // a line goes up beside its label, but ends below its number or a label that stands to the left
            let x = charts[0].x(years);
            let is_beside = marks.key.is_empty() && left > x;
            let top = if is_beside { tag_bottom - TAG_PX as f32 + 3.0 } else { tag_bottom };
            let past_title = if x < title_right { TITLE_PX as f32 - 4.0 } else { 0.0 };
            chart::mark_line(&mut self.canvas, x, [top, first.y as f32 - past_title]);
        }
    }

    /// Names with what is drawn in their colours, and a number each.
    fn legend(
        &mut self,
        entries: &[(String, Rgb, String)],
        head: &str,
        [x, y]: [u32; 2],
        is_filled: bool,
    ) {
        let right = x + LEGEND_PX;
        self.text(right, y + 2, Align::Right, head, SMALL);
        for (row, (name, color, number)) in (1_u32..).zip(entries) {
            let base = y + row * ROW_PX;
            let (left, middle) = (x as f32, base as f32 - 4.5);
            if is_filled {
                let swatch = Rect { x: x + 6, y: base - 12, width: 14, height: 14 };
                self.canvas.paint(swatch, |_, _| *color);
            } else {
                let line = [[left + 1.0, middle], [left + 25.0, middle]];
                self.canvas.polyline(&line, 3.0, *color, 1.0);
            }
            let room = LEGEND_PX as f32 - 44.0 - self.lettering.width_px(number, LABEL);
            let name = self.lettering.shortened(name, LABEL, room);
            self.text(x + 34, base, Align::Left, &name, LABEL);
            self.text(right, base, Align::Right, number, LABEL);
        }
    }

    fn species_legend(&mut self, years: &Years, [x, y]: [u32; 2]) {
        let last = years.years.last().map_or(0, |year| *year);
        let entries: Vec<_> =
            years.species.iter().map(|s| (s.name.clone(), s.color, area(s.last()))).collect();
        if entries.is_empty() {
            self.text(x, y + ROW_PX, Align::Left, "no species has basal area", UNIT);
            return;
        }
        self.legend(&entries, &format!("m²/ha, year {last}"), [x, y], false);
        if years.left_out > 0 {
            let y = y + ROW_PX * (entries.len() as u32 + 1); // a few rows
            let note = format!("{} other species: below 0.5 %", years.left_out);
            self.text(x + 34, y, Align::Left, &note, UNIT);
        }
    }

    /// What the numbers of marks mean.
    fn key(&mut self, marks: &Marks<'_>, [x, y]: [u32; 2]) {
        if marks.key.is_empty() {
            return;
        }
        self.text(x, y + 12, Align::Left, "Events", CAPTION);
        let rows = marks.key_rows();
        let (most, wide) = (rows * KEY_COLUMNS, (SIZE_PX[0] - MARGIN_PX - x) / KEY_COLUMNS);
        let shown = if marks.key.len() as u32 > most { most - 1 } else { most };
        let mut lines: Vec<(String, String)> = (1..)
            .zip(&marks.key)
            .take(shown as usize)
            .map(|(number, (label, years)): (u32, _)| {
                let when = match years.as_slice() {
                    [year] => format!("year {year}"),
                    [first, second] => format!("years {first}, {second}"),
                    _ => format!("{} times", years.len()),
                };
                (number.to_string(), format!("{label}, {when}"))
            })
            .collect();
        if lines.len() < marks.key.len() {
            lines.push(("…".to_owned(), format!("and {} more", marks.key.len() - lines.len())));
        }
        for (index, (number, text)) in (0_u32..).zip(lines) {
            let left = x + index / rows * wide;
            let base = y + 12 + ROW_PX * (index % rows + 1);
            self.text(left + 18, base, Align::Right, &number, NUMBER);
            let text = self.lettering.shortened(&text, LABEL, wide as f32 - 40.0);
            self.text(left + 26, base, Align::Left, &text, LABEL);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sonoma() -> Biome {
        Biome::builtin("sonoma").unwrap()
    }

    fn row(
        year: u16,
        species: u16,
        [live_m2_ha, snag_m2_ha, downed_log_m2_ha]: [f32; 3],
    ) -> TimelineRow {
        TimelineRow {
            year,
            species,
            live_m2_ha,
            snag_m2_ha,
            downed_log_m2_ha,
            ..TimelineRow::default()
        }
    }

    fn mark(year: u16, month: u8, label: &str) -> TimelineMark {
        TimelineMark { year, month, label: label.to_owned() }
    }

    fn count(picture: &RgbImage, color: Rgb) -> usize {
        picture.pixels().filter(|p| p.0 == color).count()
    }

    #[test]
    fn rows_of_a_year_add_up_and_small_species_are_left_out() {
        let mut rows = vec![
            row(0, 14, [20.0, 0.0, 0.0]),
            row(0, 8, [10.0, 1.0, 0.5]),
            row(0, 9, [0.1, 0.0, 0.0]),
            row(5, 14, [22.0, 2.0, 1.0]),
        ];
        rows[3].tree_deaths = [1, 2, 0, 0, 0, 4, 0, 0];
        let years = Years::of(&rows, &sonoma());
        assert_eq!(years.years, [0, 5]);
        assert_eq!(years.species.len(), 2, "0.1 of 30.1 is below 0.5 %");
        assert_eq!(years.left_out, 1);
        assert_eq!(years.species[0].values, [20.0, 22.0]);
        assert_eq!(years.species[1].values, [10.0, 0.0], "a species without a row has died out");
        let [live, snags, downed_logs] = &years.stages;
        assert!((live.values[0] - 30.1).abs() < 1e-6 && snags.values == [1.0, 2.0]);
        assert_eq!(downed_logs.values, [0.5, 1.0]);
        assert_eq!(years.causes(), [(0, 1.0), (1, 2.0), (5, 4.0)]);
    }

    #[test]
    fn lines_are_drawn_in_the_colours_of_their_species() {
        let biome = sonoma();
        let rows: Vec<_> = (0..=50).map(|y| row(y, 14, [f32::from(y), 2.0, 0.0])).collect();
        let picture = timeline(&rows, &biome, &[]);
        assert_eq!((picture.width(), picture.height()), (1600, 1200));
        assert!(count(&picture, biome.species[14].color_srgb) > 1_000);
        assert!(count(&picture, biome.species[8].color_srgb) == 0);
        assert!(count(&picture, SNAGS) > 1_000);
    }

    #[test]
    fn deaths_stand_in_proportion() {
        let mut rows: Vec<_> = (0..=20).map(|y| row(y, 14, [1.0; 3])).collect();
        rows[10].tree_deaths = [0, 0, 0, 0, 300, 100, 0, 0];
        let picture = timeline(&rows, &sonoma(), &[]);
        // the swatches of the legend alike
        let swatch = 14 * 14;
        let [fire, storm] =
            [Cause::Fire, Cause::Storm].map(|c| count(&picture, color_of(c)) - swatch);
        assert!((fire as f64 / storm as f64 - 3.0).abs() < 0.1, "{fire} {storm}");
    }

    #[test]
    fn one_row_no_rows_zeros_and_the_last_year_are_no_trouble() {
        let biome = sonoma();
        let zeros: Vec<_> = (0..9).map(|y| row(y, 3, [0.0; 3])).collect();
        let last = [row(65_534, 2, [1.0; 3]), row(65_535, 2, [0.001; 3])];
        for rows in
            [&[][..], &[row(0, 14, [30.0, 1.0, 0.0])], &[row(7, 0, [0.0; 3])], &zeros, &last]
        {
            let picture = timeline(rows, &biome, &[mark(7, 2, "Fire"), mark(400, 1, "Storm")]);
            assert_eq!((picture.width(), picture.height()), (1600, 1200));
        }
        // a single year is a dot
        let one = timeline(&[row(0, 14, [30.0, 1.0, 0.0])], &biome, &[]);
        assert!(count(&one, biome.species[14].color_srgb) > 60);
    }

    #[test]
    fn crowded_marks_get_numbers_and_a_key_with_one_line_for_each_label() {
        let rows: Vec<_> = (0..=100).map(|y| row(y, 14, [f32::from(y), 2.0, 0.0])).collect();
        let pen = Pen { canvas: Canvas::new(9, 9, PAPER), lettering: Lettering::default() };
        let axis = Chart::new(Rect { x: 110, y: 0, width: 1098, height: 1 }, [0.0, 100.0], 1.0);
        let few = [mark(40, 8, "Storm"), mark(10, 7, "Drought"), mark(200, 1, "Fire")];
        let few = Marks::of(&few, &axis, [0.0, 100.0], &pen);
        assert!(few.key.is_empty());
        assert_eq!(few.tags.iter().map(|t| t.0.as_str()).collect::<Vec<_>>(), ["Drought", "Storm"]);
        let many: Vec<_> = (1..=100)
            .map(|y| {
                mark(y, 7, ["A long and dry summer", "Bark beetles", "Fire"][usize::from(y) % 3])
            })
            .collect();
        let crowded = Marks::of(&many, &axis, [0.0, 100.0], &pen);
        assert_eq!(crowded.key.iter().map(|k| k.1.len()).collect::<Vec<_>>(), [34, 33, 33]);
        assert!(timeline(&rows, &sonoma(), &many) != timeline(&rows, &sonoma(), &[]));
    }

    #[test]
    fn a_mark_lies_within_its_year() {
        assert!((mark(1, 1, "").years() - 0.0417).abs() < 1e-3);
        assert!((mark(12, 12, "").years() - 11.958).abs() < 1e-3);
    }
}
