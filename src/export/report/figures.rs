//! Figures of a report: each beside the range that is expected of it, and where that comes from.

use super::{ReportInput, Stand};
use crate::canopy::species_map::SpeciesParams;
use crate::export::selection::SceneContent;
use crate::plants::Layer;
use crate::plants::deadwood::Deadwood;
use crate::raster::Cell;
use crate::species::{Biome, Species};

/// Years after which deadwood is held to a range. chosen: Peytavie et al. 2024, section 7.2, measure from year 500 on; runs of three
/// centuries are to be held too.
const DEADWOOD_YEARS: u32 = 300;
/// How far plants may stand off the elevations of the cells around them, m. chosen: what rounding and interpolation leave.
const GROUND_ERROR_M: f32 = 0.5;

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

/// Figures of one section, in the order in which they are told.
struct Section {
    name: &'static str,
    figures: Vec<Figure>,
}

impl Section {
    fn new(name: &'static str) -> Self {
        Self { name, figures: Vec::new() }
    }

    /// Adds a figure of which anything may be expected.
    fn tell(&mut self, name: &'static str, unit: &'static str, value: f64, says: &'static str) {
        let section = self.name;
        self.figures.push(Figure { section, name, unit, value, expected: None, source: says });
    }

    /// Adds a figure and the range that is expected of it.
    fn hold(
        &mut self,
        name: &'static str,
        unit: &'static str,
        value: f64,
        expected: [f64; 2],
        source: &'static str,
    ) {
        self.tell(name, unit, value, source);
        self.figures.last_mut().into_iter().for_each(|figure| figure.expected = Some(expected));
    }
}

/// Figures of a scene and its stand, section by section.
pub fn figures(input: &ReportInput, stand: &Stand) -> Vec<Figure> {
    let scene = input.scene;
    let is_pyrenees = scene.biome.key == "pyrenees";
    let mut sections = vec![structure(stand, &scene.biome, is_pyrenees)];
    sections.extend(input.fit.as_ref().map(fit));
    if scene.plants.layer.contains(&Layer::Undergrowth) {
        sections.push(undergrowth(stand, is_pyrenees));
    }
    sections.extend(scene.deadwood.as_ref().map(|dead| deadwood(stand, dead, scene.years)));
    sections.push(wholeness(scene));
    sections.into_iter().flat_map(|section| section.figures).collect()
}

fn structure(stand: &Stand, biome: &Biome, is_pyrenees: bool) -> Section {
    let mut section = Section::new("Structure");
    let source = "chosen: from open savanna to pole stands";
    section.hold("canopy trees", "a hectare", stand.canopy_per_ha, [0.0, 6000.0], source);
    let source = "chosen: pole stands have some thousands; stems of 7.5 cm and more, as Peytavie 2024, 7.2, counts";
    section.hold("stems", "a hectare", stand.stems_per_ha, [0.0, 6000.0], source);
    let (expected, source) = if is_pyrenees {
        ([0.0, 60.0], "Peytavie 2024, 7.2: 36 simulated, 42 in the inventory of the Pyrenees")
    } else {
        let source =
            "chosen: oak woodland has 5–25, closed mixed conifer 40–80; redwoods alone exceed it";
        ([0.0, 100.0], source)
    };
    section.hold("basal area", "m²/ha", stand.basal_area_m2_ha, expected, source);
    let most = |of: fn(&Species) -> f32| {
        let canopy = biome.canopy_species().map(|index| &biome.species[index]);
        f64::from(canopy.map(of).fold(0.0, f32::max))
    };
    let thickest_m = most(|species| species.stem.max_trunk_diameter_m);
    let source = "of those stems; no more than the biome's thickest trunk";
    let value = stand.quadratic_mean_dbh_m;
    section.hold("quadratic mean diameter", "m", value, [0.0, thickest_m], source);
    let margin = f64::from(SpeciesParams::default().height_margin);
    let tallest_m = most(|species| species.max_height_m) * margin;
    let source =
        "mean of the hundred thickest stems a hectare; no more than the biome's tallest tree";
    section.hold("dominant height", "m", stand.dominant_height_m, [0.0, tallest_m], source);
    let source = "mean weighed by basal area; no more than the biome's tallest tree";
    section.hold("Lorey's height", "m", stand.lorey_height_m, [0.0, tallest_m], source);
    let source = "Reineke 1933 for the index; chosen: near the most of pure Douglas-fir, redwood may exceed it";
    let value = stand.stand_density_index;
    section.hold("stand density index", "", value, [0.0, 1500.0], source);
    if let Some(value) = stand.slenderness {
        let source = "chosen: conifers of closed stands 60–100, open-grown trees down to 25";
        section.hold("height over dbh, median", "", value, [20.0, 110.0], source);
    }
    if let Some(value) = stand.crown_to_height {
        let source =
            "chosen: 0.2 in dense conifers to 1.2 in open oaks (crown laws of the species files)";
        section.hold("crown width over height, median", "", value, [0.15, 1.2], source);
    }
    if let Some(value) = stand.clark_evans {
        let source = "Clark & Evans 1954: 1 by chance, more where crowns keep apart, less in groups; chosen range";
        section.hold("evenness of canopy trees", "", value, [0.6, 1.6], source);
    }
    section
}

fn fit(fit: &CanopyFit) -> Section {
    let mut section = Section::new("Fit to the canopy");
    let source = "goal of placement; its last 2 % are seams between crowns";
    section.hold("canopy under crowns", "", fit.coverage_fraction, [0.98, 1.0], source);
    let source = "found on five measured canopies: 0.001–0.13";
    section.hold("crowns off the canopy", "", fit.overhang_fraction, [0.0, 0.13], source);
    let source = "found on five measured canopies: 0–0.8 m";
    section.hold("height against the canopy, RMSE", "m", fit.height_rmse_m, [0.0, 1.0], source);
    section
}

fn undergrowth(stand: &Stand, is_pyrenees: bool) -> Section {
    let mut section = Section::new("Undergrowth");
    let most = if is_pyrenees { 8000.0 } else { 25_000.0 };
    let source = "equilibrium of simulated plots of the biome, plants of 10 cm and more";
    section.hold("plants", "a hectare", stand.undergrowth_per_ha, [0.0, most], source);
    section
}

fn deadwood(stand: &Stand, deadwood: &Deadwood, years: u32) -> Section {
    let mut section = Section::new("Deadwood");
    let is_balanced = years >= DEADWOOD_YEARS;
    let hold = |section: &mut Section, name, unit, value, expected, source| {
        if is_balanced {
            section.hold(name, unit, value, expected, source);
        } else {
            section.tell(name, unit, value, source);
        }
    };
    let says = "stems of 7.5 cm and more, over 2 m high";
    section.tell("snags", "a hectare", stand.snags_per_ha, says);
    section.tell("basal area of snags", "m²/ha", stand.snag_basal_area_m2_ha, "of those");
    let source = "Peytavie 2024, 7.2: 0.112 in the inventory; expected from year 300 on, without recent events";
    let value = stand.snags_of_standing_fraction;
    hold(&mut section, "snags of standing basal area", "", value, [0.04, 0.2], source);
    let source = "Christensen et al. 2005: all deadwood of 86 beech reserves is 130 m³/ha on average, from nearly none to 550; here when it came down";
    let value = stand.downed_log_m3_ha;
    hold(&mut section, "volume of downed logs", "m³/ha", value, [10.0, 600.0], source);
    let rotten = deadwood.downed_logs.decay_class.iter().filter(|class| **class >= 3).count();
    let value = rotten as f64 / deadwood.downed_logs.len().max(1) as f64;
    let source = "chosen: old forests hold all classes (of Peytavie 2024, Table 2)";
    hold(&mut section, "downed logs of class 3–5", "of all", value, [0.2, 0.95], source);
    section
}

fn wholeness(scene: &SceneContent) -> Section {
    let mut section = Section::new("Wholeness");
    let [off, tall, afloat] = faults(scene).map(|count| count as f64);
    let none = [0.0, 0.0];
    section.hold("plants outside the terrain", "", off, none, "a plant has ground");
    let source = "the species' greatest height and what placement allows beyond, 15 %";
    section.hold("plants too tall for their species", "", tall, none, source);
    let source = "elevations of the cells around them, within 0.5 m";
    section.hold("plants off the ground", "", afloat, none, source);
    section
}

/// Plants outside the terrain, too tall for their species, off the ground.
fn faults(scene: &SceneContent) -> [usize; 3] {
    let (plants, elevation) = (&scene.plants, &scene.elevation_m);
    let frame = elevation.frame();
    let height_margin = SpeciesParams::default().height_margin;
    let mut counts = [0; 3];
    for i in 0..plants.len() {
        let species = &scene.biome.species[usize::from(plants.species[i])];
        counts[1] += usize::from(plants.height_m[i] > species.max_height_m * height_margin);
        // `as` cuts what lies west or north to cells that do not hold it
        let (east, south) = (
            plants.east_m[i] / frame.cell_m(),
            frame.rows as f32 - plants.north_m[i] / frame.cell_m(),
        );
        let is_inside =
            (0.0..=frame.cols as f32).contains(&east) && (0.0..=frame.rows as f32).contains(&south);
        let cell = Cell {
            row: (south as usize).min(frame.rows - 1),
            col: (east as usize).min(frame.cols - 1),
        };
        if elevation.get(cell).is_none() || !is_inside {
            counts[0] += 1;
            continue;
        }
        let around = (cell.row.saturating_sub(1)..(cell.row + 2).min(frame.rows)).flat_map(|row| {
            let cols = cell.col.saturating_sub(1)..(cell.col + 2).min(frame.cols);
            cols.map(move |col| Cell { row, col })
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

#[cfg(test)]
mod tests {
    use super::super::stand::tests::lattice;
    use super::*;

    fn found(scene: &SceneContent, name: &str) -> Figure {
        let input = ReportInput { scene, fit: None, facts: Vec::new(), pictures: Vec::new() };
        let all = figures(&input, &Stand::of(scene));
        all.into_iter().find(|figure| figure.name == name).unwrap()
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
}
