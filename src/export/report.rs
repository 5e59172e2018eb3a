//! A report on a scene: figures of its stand beside the range that is expected and where that comes from, with plots, as one
//! page of HTML that needs nothing beside it.

pub mod figures;
mod plots;
mod stand;

use std::collections::BTreeMap;
use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::selection::SceneContent;
use crate::plants::Layer;
use crate::simulation::forest::LEAST_DBH_M;
use figures::{CanopyFit, Figure};
pub use plots::short;
use plots::{Bars, Scatter, css, escaped};
pub use stand::Stand;

/// Classes of a histogram at most. chosen: trees of 400 m, stems of 10 m.
const MOST_CLASSES: usize = 200;
/// Points of a scatter plot at most. chosen: as many as are told apart.
const MOST_POINTS: usize = 1500;
/// What a report is of.
pub struct ReportInput<'a> {
    /// The scene.
    pub scene: &'a SceneContent,
    /// How well its trees fit their canopy, if that is on record.
    pub fit: Option<CanopyFit>,
    /// Facts for the head: name and text.
    pub facts: Vec<(String, String)>,
    /// Pictures: caption and PNG file.
    pub pictures: Vec<(String, Vec<u8>)>,
}

/// The page.
pub fn html(input: &ReportInput, stand: &Stand, figures: &[Figure]) -> String {
    let scene = input.scene;
    let mut page = String::new();
    let title = escaped(&scene.name);
    let _ = write!(
        page,
        "<!doctype html><html lang='en'><head><meta charset='utf-8'><meta name='viewport' content='width=device-width'>\
         <title>{title} – wildwood</title><style>{STYLE}</style></head><body><h1>{title}</h1>"
    );
    page.push_str("<dl>");
    for (name, text) in &input.facts {
        let _ = write!(page, "<dt>{}</dt><dd>{}</dd>", escaped(name), escaped(text));
    }
    page.push_str("</dl>");
    let off = figures.iter().filter(|figure| figure.is_expected() == Some(false)).count();
    let held = figures.iter().filter(|figure| figure.expected.is_some()).count();
    let _ = write!(
        page,
        "<p class='{}'>{} of {held} figures are within the range that is expected of them.</p>",
        if off == 0 { "ok" } else { "off" },
        held - off
    );
    write_table(&mut page, figures);
    write_species(&mut page, scene);
    write_plots(&mut page, scene, stand.hectares.max(1e-9));
    for (caption, png) in &input.pictures {
        let _ = write!(
            page,
            "<h2>{0}</h2><img alt='{0}' src='data:image/png;base64,{1}'>",
            escaped(caption),
            STANDARD.encode(png)
        );
    }
    let _ = writeln!(page, "<footer>wildwood {}</footer></body></html>", env!("CARGO_PKG_VERSION"));
    page
}

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;max-width:1120px;margin:2rem auto;padding:0 1rem;color:#22281f}\
h1{font-size:1.6rem;margin:0}h2{font-size:1.15rem;margin:2rem 0 .4rem}dl{display:grid;grid-template-columns:max-content 1fr;gap:.1rem 1rem}\
dt{color:#66705f}dd{margin:0}table{border-collapse:collapse;width:100%}th{text-align:left;color:#66705f;font-weight:500}\
td,th{padding:.22rem .6rem .22rem 0;border-bottom:1px solid #e4e8df;vertical-align:top}td.n,th.n{text-align:right;white-space:nowrap}\
td.s{color:#66705f}.ok{color:#2d6a2f}.off{color:#b03a1c;font-weight:600}.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(420px,1fr));gap:1rem}\
figure{margin:0}figcaption{color:#66705f}svg{width:100%;font-size:11px;fill:#444}.grid{stroke:#e4e8df}img{max-width:100%}\
.sw{display:inline-block;width:.8em;height:.8em;border-radius:2px;margin-right:.4em}footer{margin:2rem 0;color:#99a193}";

fn write_table(page: &mut String, figures: &[Figure]) {
    let mut section = "";
    for figure in figures {
        if figure.section != section {
            if !section.is_empty() {
                page.push_str("</table>");
            }
            section = figure.section;
            let _ = write!(
                page,
                "<h2>{section}</h2><table><tr><th style='width:22%'>figure<th class='n' style='width:7%'>found<th style='width:9%'>unit<th class='n' style='width:11%'>expected<th style='width:6%'><th>source, or what it says</tr>"
            );
        }
        let expected = figure.expected.map_or(String::new(), range_text);
        let (class, mark) = match figure.is_expected() {
            None => ("", ""),
            Some(true) => ("ok", "✓"),
            Some(false) => ("off", "outside"),
        };
        let _ = write!(
            page,
            "<tr><td>{}<td class='n'>{}<td>{}<td class='n'>{expected}<td class='{class}'>{mark}<td class='s'>{}</tr>",
            escaped(figure.name),
            short(figure.value),
            figure.unit,
            escaped(figure.source)
        );
    }
    if !section.is_empty() {
        page.push_str("</table>");
    }
}

/// A range in words.
pub fn range_text([low, high]: [f64; 2]) -> String {
    if low == high { short(low) } else { format!("{} – {}", short(low), short(high)) }
}

/// What each species has.
#[derive(Clone, Copy, Default)]
struct Share {
    canopy: usize,
    undergrowth: usize,
    crown_m2: f64,
    basal_m2: f64,
    tallest_m: f32,
}

fn shares(scene: &SceneContent) -> BTreeMap<u16, Share> {
    let plants = &scene.plants;
    let mut shares: BTreeMap<u16, Share> = BTreeMap::new();
    for i in 0..plants.len() {
        let share = shares.entry(plants.species[i]).or_default();
        let square = |m: f32| std::f64::consts::PI * f64::from(m) * f64::from(m);
        if plants.layer[i] == Layer::Canopy {
            share.canopy += 1;
            share.crown_m2 += square(plants.crown_radius_m[i]);
        } else {
            share.undergrowth += 1;
        }
        if plants.dbh_m[i] >= LEAST_DBH_M {
            share.basal_m2 += square(0.5 * plants.dbh_m[i]);
        }
        share.tallest_m = share.tallest_m.max(plants.height_m[i]);
    }
    shares
}

fn write_species(page: &mut String, scene: &SceneContent) {
    let shares = shares(scene);
    let total = |of: fn(&Share) -> f64| shares.values().map(of).sum::<f64>().max(1e-9);
    let (crowns, basal) = (total(|share| share.crown_m2), total(|share| share.basal_m2));
    let mut rows: Vec<(u16, Share)> = shares.into_iter().collect();
    rows.sort_by(|a, b| b.1.basal_m2.total_cmp(&a.1.basal_m2));
    page.push_str(
        "<h2>Species</h2><table><tr><th>species<th class='n'>canopy trees<th class='n'>of crown area<th class='n'>of basal area\
         <th class='n'>undergrowth<th class='n'>tallest, m</tr>",
    );
    for (species, share) in rows {
        let species = &scene.biome.species[usize::from(species)];
        let _ = write!(
            page,
            "<tr><td><span class='sw' style='background:{}'></span>{} <i>{}</i><td class='n'>{}<td class='n'>{:.1} %<td class='n'>{:.1} %<td class='n'>{}<td class='n'>{:.1}</tr>",
            css(species.color_srgb),
            escaped(&species.common_name),
            escaped(&species.scientific_name),
            short(share.canopy as f64),
            100.0 * share.crown_m2 / crowns,
            100.0 * share.basal_m2 / basal,
            short(share.undergrowth as f64),
            share.tallest_m
        );
    }
    page.push_str("</table>");
}

/// A species' name, colour and value in each class.
type Stacked<'a> = (&'a str, [u8; 3], Vec<f64>);

/// Bars of plants that count, by a measure in equal classes, stacked by species.
fn histogram<'a>(
    scene: &'a SceneContent,
    counts: impl Fn(usize) -> bool,
    measure: &[f32],
    class: f32,
    per: f64,
) -> (Vec<String>, Vec<Stacked<'a>>) {
    let plants = &scene.plants;
    let class_of = |i: usize| ((measure[i] / class) as usize).min(MOST_CLASSES - 1);
    let counted = || (0..plants.len()).filter(|i| counts(*i));
    let classes = counted().map(class_of).max().map_or(0, |last| last + 1);
    let mut of_species: BTreeMap<u16, Vec<f64>> = BTreeMap::new();
    for i in counted() {
        let values = of_species.entry(plants.species[i]).or_insert_with(|| vec![0.0; classes]);
        values[class_of(i)] += 1.0 / per;
    }
    let every = classes.div_ceil(10).max(1);
    let label = |at: usize| {
        if at.is_multiple_of(every) { short(f64::from(at as f32 * class)) } else { String::new() }
    };
    let kinds = of_species.into_iter().map(|(species, values)| {
        let species = &scene.biome.species[usize::from(species)];
        (species.common_name.as_str(), species.color_srgb, values)
    });
    ((0..classes).map(label).collect(), kinds.collect())
}

fn write_plots(page: &mut String, scene: &SceneContent, hectares: f64) {
    let plants = &scene.plants;
    let is_canopy = |i: usize| plants.layer[i] == Layer::Canopy;
    page.push_str("<h2>Structure in pictures</h2><div class='plots'>");
    let mut figure = |svg: String, caption: &str| {
        let _ = write!(page, "<figure>{svg}<figcaption>{}</figcaption></figure>", escaped(caption));
    };
    let (labels, kinds) = histogram(scene, is_canopy, &plants.height_m, 2.0, hectares);
    let bars =
        Bars { y_label: "trees a hectare", x_label: "height, m (classes of 2 m)", labels, kinds };
    figure(bars.svg(), "Heights of canopy trees, by species.");
    let is_stem = |i: usize| plants.dbh_m[i] >= LEAST_DBH_M;
    let dbh_cm: Vec<f32> = plants.dbh_m.iter().map(|m| 100.0 * m).collect();
    let (labels, kinds) = histogram(scene, is_stem, &dbh_cm, 5.0, hectares);
    let bars =
        Bars { y_label: "stems a hectare", x_label: "dbh, cm (classes of 5 cm)", labels, kinds };
    figure(
        bars.svg(),
        "Stem diameters. Uneven-aged forests fall off steadily, even-aged stands have a hump.",
    );
    let stems: Vec<usize> = (0..plants.len()).filter(|i| is_stem(*i)).collect();
    let step = stems.len().div_ceil(MOST_POINTS).max(1);
    let point = |i: &usize| {
        let color = scene.biome.species[usize::from(plants.species[*i])].color_srgb;
        ([f64::from(dbh_cm[*i]), f64::from(plants.height_m[*i])], color)
    };
    let points = stems.iter().step_by(step).map(point).collect();
    let scatter = Scatter { y_label: "height, m", x_label: "dbh, cm", points };
    figure(scatter.svg(), "Heights over stem diameters, a sample.");
    if let Some(dead) = &scene.deadwood {
        let count = |classes: &[u8]| {
            let mut counts = vec![0.0; 5];
            for class in classes {
                counts[usize::from(class.clamp(&1, &5) - 1)] += 1.0 / hectares;
            }
            counts
        };
        let bars = Bars {
            y_label: "pieces a hectare",
            x_label: "decay class (Peytavie 2024, Table 2)",
            labels: (1..=5).map(|class: u8| class.to_string()).collect(),
            kinds: vec![
                ("snags", [0x8a, 0x6d, 0x4b], count(&dead.snags.decay_class)),
                ("downed logs", [0xc9, 0xa2, 0x6b], count(&dead.downed_logs.decay_class)),
            ],
        };
        figure(bars.svg(), "Snags (dark) and downed logs (light) by decay class.");
    }
    page.push_str("</div>");
}

#[cfg(test)]
mod tests {
    use super::stand::tests::lattice;
    use super::*;

    fn input(scene: &SceneContent) -> ReportInput<'_> {
        ReportInput { scene, fit: None, facts: Vec::new(), pictures: Vec::new() }
    }

    #[test]
    fn a_page_needs_nothing_beside_it_and_says_what_is_off() {
        let mut scene = lattice(10, 25.0, 0.3);
        scene.name = "a <b> & c".to_owned();
        let png = vec![1, 2, 3];
        let input = ReportInput { pictures: vec![("Map".to_owned(), png)], ..input(&scene) };
        let stand = Stand::of(&scene);
        let mut figures = figures::figures(&input, &stand);
        let page = html(&input, &stand, &figures);
        assert!(
            page.contains("a &lt;b&gt; &amp; c") && page.contains("data:image/png;base64,AQID")
        );
        assert!(
            !page.contains("src='http") && !page.contains("<script") && !page.contains("<link")
        );
        assert!(page.contains("class='ok'") && page.matches("<svg").count() == 3);
        figures[1].value = 1e9;
        assert!(html(&input, &stand, &figures).contains("outside"));
    }
}
