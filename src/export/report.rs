//! A report on a scene: figures of its stand beside the range that is expected and where that comes from, with plots, as one
//! page of HTML that needs nothing beside it.

mod plots;
mod stand;

use std::collections::BTreeMap;
use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::selection::SceneContent;
use crate::plants::Layer;
pub use plots::short;
use plots::{Bars, Scatter, css, escaped};
pub use stand::{LEAST_DBH_M, Stand};

/// Years after which deadwood is in balance. Peytavie et al. 2024, section 7.2: from year 500 on; snags are sooner.
const DEADWOOD_YEARS: u32 = 300;
/// Classes of a histogram at most. chosen: trees of 400 m, stems of 10 m.
const MOST_CLASSES: usize = 200;
/// Points of a scatter plot at most. chosen: as many as are told apart.
const MOST_POINTS: usize = 1500;
/// How far trees may stand above the tallest of their species, as a share. chosen: what placement allows canopy.
const HEIGHT_MARGIN: f32 = 1.15;
/// How far plants may stand off the elevations of the cells around them, m. chosen: what rounding and interpolation leave.
const GROUND_ERROR_M: f32 = 0.5;

const SLENDERNESS: &str = "height over dbh, median";
const CROWN_TO_HEIGHT: &str = "crown width over height, median";
const EVENNESS: &str = "evenness of canopy trees";

/// A figure beside what is expected of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// What it is about.
    pub section: &'static str,
    /// What it is.
    pub name: &'static str,
    /// Its unit; empty for shares and numbers.
    pub unit: &'static str,
    /// Its value.
    pub value: f64,
    /// Least and most that are expected; `None` where anything may be.
    pub expected: Option<[f64; 2]>,
    /// Where the range comes from, or what the figure says.
    pub source: &'static str,
}

impl Figure {
    /// Whether it is as expected; `None` where nothing is.
    pub fn is_expected(&self) -> Option<bool> {
        self.expected.map(|[low, high]| (low..=high).contains(&self.value))
    }
}

/// How well canopy trees fit the canopy that they were fitted to; shares of cells and m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CanopyFit {
    /// Share of the canopy under crowns.
    pub coverage_fraction: f64,
    /// Share of crowns off the canopy.
    pub overhang_fraction: f64,
    /// Error of tree heights against the canopy.
    pub height_rmse_m: f64,
}

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

/// Figures of a scene, section by section.
pub fn figures(input: &ReportInput) -> Vec<Figure> {
    let stand = Stand::of(input.scene);
    let mut figures = Vec::new();
    let mut add = |section, name, unit, value, expected, source| {
        figures.push(Figure { section, name, unit, value, expected, source });
    };
    let is_pyrenees = input.scene.biome.key == "pyrenees";

    const STRUCTURE: &str = "Structure";
    add(
        STRUCTURE,
        "canopy trees",
        "a hectare",
        stand.canopy_per_ha,
        None,
        "from open savanna to pole stands",
    );
    let stems = "stems of 7.5 cm and more, as Peytavie 2024, 7.2, counts";
    add(STRUCTURE, "stems", "a hectare", stand.stems_per_ha, Some([0.0, 6000.0]), stems);
    let (basal, source) = if is_pyrenees {
        ([0.0, 60.0], "Peytavie 2024, 7.2: 36 simulated, 42 in the inventory of the Pyrenees")
    } else {
        (
            [0.0, 100.0],
            "chosen: oak woodland has 5–25, closed mixed conifer 40–80; redwoods alone exceed it",
        )
    };
    add(STRUCTURE, "basal area", "m²/ha", stand.basal_area_m2_ha, Some(basal), source);
    add(
        STRUCTURE,
        "quadratic mean diameter",
        "m",
        stand.quadratic_mean_dbh_m,
        None,
        "of those stems",
    );
    let source = "mean of the hundred thickest stems a hectare";
    add(STRUCTURE, "dominant height", "m", stand.dominant_height_m, None, source);
    add(STRUCTURE, "Lorey's height", "m", stand.lorey_height_m, None, "mean weighed by basal area");
    let source =
        "Reineke 1933; the most of Douglas-fir is near 1,470 (Long 1985), of redwood 2,500";
    add(
        STRUCTURE,
        "stand density index",
        "",
        stand.stand_density_index,
        Some([0.0, 1500.0]),
        source,
    );
    let source = "chosen: conifers of closed stands 60–100, open-grown trees down to 25";
    add(STRUCTURE, SLENDERNESS, "", stand.slenderness, Some([20.0, 110.0]), source);
    let source =
        "chosen: 0.2 in dense conifers to 1.2 in open oaks (crown laws of the species files)";
    add(STRUCTURE, CROWN_TO_HEIGHT, "", stand.crown_to_height, Some([0.15, 1.2]), source);
    let source =
        "Clark & Evans 1954: 1 by chance, 1.2–1.5 where crowns keep apart, below 1 in groups";
    add(STRUCTURE, EVENNESS, "", stand.clark_evans, Some([0.6, 1.6]), source);

    if let Some(fit) = &input.fit {
        const FIT: &str = "Fit to the canopy";
        let source = "goal of placement; its last 2 % are seams between crowns";
        add(FIT, "canopy under crowns", "", fit.coverage_fraction, Some([0.98, 1.0]), source);
        let source = "found on five measured canopies: 0.001–0.13";
        add(FIT, "crowns off the canopy", "", fit.overhang_fraction, Some([0.0, 0.13]), source);
        let source = "found on five measured canopies: 0–0.8 m";
        add(
            FIT,
            "height against the canopy, RMSE",
            "m",
            fit.height_rmse_m,
            Some([0.0, 1.0]),
            source,
        );
    }

    if input.scene.plants.layer.contains(&Layer::Undergrowth) {
        let most = if is_pyrenees { 8000.0 } else { 25_000.0 };
        let source = "equilibrium of simulated plots of the biome";
        let value = stand.undergrowth_per_ha;
        add(
            "Undergrowth",
            "plants of 10 cm and more",
            "a hectare",
            value,
            Some([0.0, most]),
            source,
        );
    }

    if let Some(deadwood) = &input.scene.deadwood {
        const DEAD: &str = "Deadwood";
        let is_balanced = input.scene.years >= DEADWOOD_YEARS;
        let range = |range: [f64; 2]| is_balanced.then_some(range);
        add(
            DEAD,
            "snags",
            "a hectare",
            stand.snags_per_ha,
            None,
            "stems of 7.5 cm and more, over 2 m high",
        );
        add(DEAD, "basal area of snags", "m²/ha", stand.snag_m2_ha, None, "of those");
        let share = stand.snags_of_standing_fraction;
        let source = "Peytavie 2024, 7.2: 0.112 in the inventory; expected from year 300 on, without recent events";
        add(DEAD, "snags of standing basal area", "", share, range([0.04, 0.2]), source);
        let source = "Christensen et al. 2005: beech reserves of Europe have 130 m³/ha on average, up to 550 after storms; when they came down";
        add(
            DEAD,
            "volume of downed logs",
            "m³/ha",
            stand.downed_log_m3_ha,
            range([10.0, 600.0]),
            source,
        );
        let rotten = deadwood.downed_logs.decay_class.iter().filter(|class| **class >= 3).count();
        let share = rotten as f64 / deadwood.downed_logs.len().max(1) as f64;
        let source = "Peytavie 2024, Table 2; old forests hold all classes";
        add(DEAD, "downed logs of class 3–5", "of all", share, range([0.2, 0.95]), source);
    }

    // figures of canopy trees say nothing where there are none
    if stand.canopy_per_ha == 0.0 {
        let of_canopy = [SLENDERNESS, CROWN_TO_HEIGHT, EVENNESS];
        figures.retain(|figure| !of_canopy.contains(&figure.name));
    }
    let mut add = |section, name, unit, value, expected, source| {
        figures.push(Figure { section, name, unit, value, expected, source });
    };
    const WHOLE: &str = "Wholeness";
    let [off, tall, afloat] = faults(input.scene).map(|count| count as f64);
    let none = Some([0.0, 0.0]);
    add(WHOLE, "plants outside the terrain", "", off, none, "a plant has ground");
    add(
        WHOLE,
        "plants too tall for their species",
        "",
        tall,
        none,
        "the species' greatest height and 15 %",
    );
    add(
        WHOLE,
        "plants off the ground",
        "",
        afloat,
        none,
        "elevations of the cells around them, within 0.5 m",
    );
    figures
}

/// Plants outside the terrain, too tall for their species, off the ground.
fn faults(scene: &SceneContent) -> [usize; 3] {
    let (plants, elevation) = (&scene.plants, &scene.elevation_m);
    let frame = elevation.frame();
    let mut counts = [0; 3];
    for i in 0..plants.len() {
        let species = &scene.biome.species[usize::from(plants.species[i])];
        counts[1] += usize::from(plants.height_m[i] > species.max_height_m * HEIGHT_MARGIN);
        // `as` cuts what lies west or north to cells that do not hold it
        let (east, south) = (
            plants.east_m[i] / frame.cell_m(),
            frame.rows as f32 - plants.north_m[i] / frame.cell_m(),
        );
        let is_inside =
            (0.0..=frame.cols as f32).contains(&east) && (0.0..=frame.rows as f32).contains(&south);
        let cell = crate::raster::Cell {
            row: (south as usize).min(frame.rows - 1),
            col: (east as usize).min(frame.cols - 1),
        };
        if elevation.get(cell).is_none() || !is_inside {
            counts[0] += 1;
            continue;
        }
        let around = (cell.row.saturating_sub(1)..(cell.row + 2).min(frame.rows)).flat_map(|row| {
            let cols = cell.col.saturating_sub(1)..(cell.col + 2).min(frame.cols);
            cols.map(move |col| crate::raster::Cell { row, col })
        });
        let (low_m, high_m) = around
            .filter_map(|cell| elevation.get(cell).copied())
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), m| (low.min(m), high.max(m)));
        let is_on_ground =
            (low_m - GROUND_ERROR_M..=high_m + GROUND_ERROR_M).contains(&plants.z_m[i]);
        counts[2] += usize::from(!is_on_ground);
    }
    counts
}

/// The page.
pub fn html(input: &ReportInput, figures: &[Figure]) -> String {
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
    write_plots(&mut page, scene);
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

fn write_plots(page: &mut String, scene: &SceneContent) {
    let plants = &scene.plants;
    let hectares = Stand::of(scene).hectares.max(1e-9);
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

    fn found(scene: &SceneContent, name: &str) -> Figure {
        figures(&input(scene)).into_iter().find(|figure| figure.name == name).unwrap()
    }

    #[test]
    fn faults_are_counted() {
        let mut scene = lattice(10, 25.0, 0.3);
        let names = [
            "plants outside the terrain",
            "plants too tall for their species",
            "plants off the ground",
        ];
        for name in names {
            assert_eq!(found(&scene, name).is_expected(), Some(true), "{name}");
        }
        scene.plants.east_m[0] = -1.0;
        scene.plants.height_m[1] = 200.0;
        scene.plants.z_m[2] = 60.0;
        for name in names {
            assert_eq!(found(&scene, name).value, 1.0, "{name}");
            assert_eq!(found(&scene, name).is_expected(), Some(false), "{name}");
        }
    }

    #[test]
    fn a_page_needs_nothing_beside_it_and_says_what_is_off() {
        let mut scene = lattice(10, 25.0, 0.3);
        scene.name = "a <b> & c".to_owned();
        let png = vec![1, 2, 3];
        let input = ReportInput { pictures: vec![("Map".to_owned(), png)], ..input(&scene) };
        let mut figures = figures(&input);
        let page = html(&input, &figures);
        assert!(
            page.contains("a &lt;b&gt; &amp; c") && page.contains("data:image/png;base64,AQID")
        );
        assert!(
            !page.contains("src='http") && !page.contains("<script") && !page.contains("<link")
        );
        assert!(page.contains("class='ok'") && page.matches("<svg").count() == 3);
        figures[1].value = 1e9;
        assert!(html(&input, &figures).contains("outside"));
    }
}
