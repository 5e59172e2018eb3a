//! Legend of a close-up: the species of each layer with their symbols and numbers, and what a forester asks of a stand.

use super::deadwood::{DownedLogAbove, SeenDeadwood, SnagAbove};
use super::light::LightSheet;
use super::plan::{Seen, View};
use super::symbols::{CanopyTree, LowPlant, Symbol};
use crate::export::canvas::{Canvas, Rect};
use crate::export::furniture::{CAPTION, LABEL, PAPER, UNIT};
use crate::export::lettering::{Align, Lettering, Style};
use crate::export::scale;
use crate::export::species_legend::{percent, thousands};
use crate::plants::Plants;
use crate::plants::deadwood::Deadwood;
use crate::species::Biome;

/// Height of a species' line.
const ROW_PX: u32 = 27;
/// Room for a layer's title and the heads of its columns.
const HEAD_PX: u32 = 56;
/// Space below a layer.
const GAP_PX: u32 = 26;
/// Most species of a layer; those with fewest plants are summed up in the last line.
const MOST_ROWS: usize = 17;
/// Width of a symbol.
const SYMBOL_PX: u32 = 24;

/// A species of a layer.
#[derive(Clone, Debug, PartialEq)]
struct Row {
    /// Index of the species; none sums up several.
    species: Option<usize>,
    name: String,
    /// Number of plants that are rooted in the square.
    count: usize,
    /// Height of the tallest of them.
    tallest_m: f32,
}

/// One layer of the square.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerLegend {
    rows: Vec<Row>,
}

impl LayerLegend {
    /// The species of some plants that a view sees: the most numerous first. Plants rooted outside lend the square
    /// their crowns, so their species are listed, but they do not count.
    pub fn of(plants: &Plants, some: &[usize], biome: &Biome, view: &View) -> Self {
        let mut count = vec![None::<(usize, f32)>; biome.species.len()];
        for &i in some {
            let entry = count[usize::from(plants.species[i])].get_or_insert((0, 0.0));
            if view.contains(plants.east_m[i], plants.north_m[i], 0.0) {
                entry.0 += 1;
                entry.1 = entry.1.max(plants.height_m[i]);
            }
        }
        let row = |(species, entry): (usize, Option<(usize, f32)>)| {
            let (count, tallest_m) = entry?;
            let name = biome.species[species].common_name.clone();
            Some(Row { species: Some(species), name, count, tallest_m })
        };
        let mut rows: Vec<Row> = count.into_iter().enumerate().filter_map(row).collect();
        rows.sort_by_key(|row| std::cmp::Reverse(row.count)); // stable: equal counts in the biome's order
        if rows.len() > MOST_ROWS {
            let rest = rows.split_off(MOST_ROWS - 1);
            rows.push(Row {
                species: None,
                name: format!("{} other species", rest.len()),
                count: rest.iter().map(|r| r.count).sum(),
                tallest_m: rest.iter().map(|r| r.tallest_m).fold(0.0, f32::max),
            });
        }
        Self { rows }
    }

    /// Number of plants rooted in the square.
    pub fn count(&self) -> usize {
        self.rows.iter().map(|row| row.count).sum()
    }

    /// Height of the legend.
    pub fn height_px(&self) -> u32 {
        HEAD_PX + ROW_PX * self.rows.len() as u32 + GAP_PX // a few rows
    }

    /// Draws the layer's legend, with rings for `canopy`; gives the row below it.
    pub fn draw(
        &self,
        canvas: &mut Canvas,
        lettering: &Lettering,
        rect: Rect,
        title: &str,
        biome: &Biome,
        canopy: bool,
    ) -> u32 {
        let (left, right) = (rect.x as f32, rect.right() as f32);
        let head_y = rect.y as f32 + 16.0;
        lettering.draw(canvas, left, head_y, Align::Left, title, CAPTION);
        let after = left + lettering.width_px(title, CAPTION) + 9.0;
        if self.rows.is_empty() {
            lettering.draw(canvas, after, head_y, Align::Left, "none", UNIT);
            return rect.y + self.height_px();
        }
        let sum = thousands(self.count());
        lettering.draw(canvas, after, head_y, Align::Left, &sum, Style { bold: false, ..CAPTION });
        let grey = Style { size_px: 12.0, ..UNIT };
        let count_x = right - 78.0;
        let columns_y = head_y + 24.0;
        let counted = if canopy { "trees" } else { "plants" };
        lettering.draw(canvas, count_x, columns_y, Align::Right, counted, grey);
        lettering.draw(canvas, right, columns_y, Align::Right, "tallest, m", grey);
        for (index, row) in (0_u32..).zip(&self.rows) {
            let y = rect.y + HEAD_PX + index * ROW_PX;
            if let Some(species) = row.species {
                symbol(biome, species, canopy).onto(canvas, [rect.x, y - 4]);
            }
            let base = y as f32 + 13.0;
            let count = thousands(row.count);
            let room = count_x - left - 36.0 - lettering.width_px(&count, LABEL) - 10.0;
            let name = lettering.shortened(&row.name, LABEL, room);
            lettering.draw(canvas, left + 36.0, base, Align::Left, &name, LABEL);
            lettering.draw(canvas, count_x, base, Align::Right, &count, LABEL);
            let tallest = match row.count {
                0 => "\u{2013}".to_owned(),
                _ if row.tallest_m < 10.0 => scale::fixed(f64::from(row.tallest_m), 1),
                _ => scale::fixed(f64::from(row.tallest_m), 0),
            };
            lettering.draw(canvas, right, base, Align::Right, &tallest, LABEL);
        }
        rect.y + self.height_px()
    }
}

/// A species' symbol on paper.
fn symbol(biome: &Biome, species: usize, canopy: bool) -> LightSheet {
    let side = SYMBOL_PX as usize;
    let (middle, species) = (side as f32 / 2.0, &biome.species[species]);
    let color = species.color_srgb.map(f32::from);
    let mut sheet = LightSheet::new(side, side, |_| PAPER.map(f32::from));
    sheet.draw(|band| {
        if canopy {
            let absorbed_light_fraction = species.absorbed_light_fraction;
            let radius = middle - 1.0;
            let (x, y) = (middle, middle);
            let tree =
                CanopyTree { x, y, radius, stem_radius: 2.6, color, absorbed_light_fraction };
            tree.ring(band);
            tree.stem(band);
        } else {
            let plant = LowPlant {
                x: middle,
                y: middle,
                radius: middle - 1.5,
                height: 0.0,
                px_per_m: 26.0,
                color,
                seed: 3,
                symbol: Symbol::of(species),
            };
            plant.draw(band);
        }
    });
    sheet
}

/// Snags and downed logs of the square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeadwoodLegend {
    /// Number of snags, and the height of the tallest.
    snags: (usize, f32),
    /// Number of downed logs, and the length of the longest.
    downed_logs: (usize, f32),
}

impl DeadwoodLegend {
    /// Deadwood that belongs to a square.
    pub fn of(deadwood: &Deadwood, own: &SeenDeadwood) -> Self {
        let most = |some: &[usize], of: &[f32]| some.iter().map(|&i| of[i]).fold(0.0, f32::max);
        let Deadwood { snags, downed_logs } = deadwood;
        Self {
            snags: (own.snags.len(), most(&own.snags, &snags.height_m)),
            downed_logs: (own.downed_logs.len(), most(&own.downed_logs, &downed_logs.length_m)),
        }
    }

    /// Draws the legend; gives the row below it.
    pub fn draw(&self, canvas: &mut Canvas, lettering: &Lettering, rect: Rect) -> u32 {
        let (left, right) = (rect.x as f32, rect.right() as f32);
        let head_y = rect.y as f32 + 16.0;
        lettering.draw(canvas, left, head_y, Align::Left, "Deadwood", CAPTION);
        let grey = Style { size_px: 12.0, ..UNIT };
        let (count_x, columns_y) = (right - 78.0, head_y + 24.0);
        lettering.draw(canvas, count_x, columns_y, Align::Right, "number", grey);
        lettering.draw(canvas, right, columns_y, Align::Right, "longest, m", grey);
        let side = SYMBOL_PX as f32;
        let rows = [("Snags", self.snags), ("Downed logs", self.downed_logs)];
        for (index, (name, (count, longest_m))) in (0_u32..).zip(rows) {
            let y = rect.y + HEAD_PX + index * ROW_PX;
            let pixels = SYMBOL_PX as usize;
            let mut symbol = LightSheet::new(pixels, pixels, |_| PAPER.map(f32::from));
            symbol.draw(|band| match index {
                0 => SnagAbove::symbol(side).circle(band),
                _ => DownedLogAbove::symbol(side).draw(band),
            });
            symbol.onto(canvas, [rect.x, y - 4]);
            let base = y as f32 + 13.0;
            lettering.draw(canvas, left + 36.0, base, Align::Left, name, LABEL);
            lettering.draw(canvas, count_x, base, Align::Right, &thousands(count), LABEL);
            let longest = match count {
                0 => "\u{2013}".to_owned(),
                _ => scale::fixed(f64::from(longest_m), if longest_m < 10.0 { 1 } else { 0 }),
            };
            lettering.draw(canvas, right, base, Align::Right, &longest, LABEL);
        }
        rect.y + HEAD_PX + 2 * ROW_PX + GAP_PX
    }
}

/// What a forester asks of a stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Share of the ground under canopy crowns.
    pub canopy_cover_fraction: f64,
    /// Share of the ground under undergrowth.
    pub undergrowth_cover_fraction: f64,
    /// Canopy trees a hectare.
    pub trees_per_ha: f64,
    /// Sum of the canopy's stem sections at breast height, m² a hectare.
    pub basal_area_m2_ha: f64,
    /// Plants of the undergrowth a hectare.
    pub undergrowth_per_ha: f64,
    /// Volume of downed logs, m³ a hectare, where they are known.
    pub downed_m3_ha: Option<f64>,
}

impl Figures {
    /// Figures of the plants that a view sees over `land_m2` of known ground, with their covers.
    pub fn of(
        plants: &Plants,
        seen: &Seen,
        view: &View,
        land_m2: f64,
        [canopy_cover_fraction, undergrowth_cover_fraction]: [f64; 2],
    ) -> Self {
        let per_ha = 1e4 / land_m2.max(1.0);
        let is_rooted = |&&i: &&usize| view.contains(plants.east_m[i], plants.north_m[i], 0.0);
        let section_m2 = |&i: &usize| {
            let dbh_m = f64::from(plants.dbh_m[i]);
            std::f64::consts::FRAC_PI_4 * dbh_m * dbh_m
        };
        let rooted = |some: &[usize]| some.iter().filter(is_rooted).count() as f64;
        let sections_m2: f64 = seen.canopy.iter().filter(is_rooted).map(section_m2).sum();
        Self {
            canopy_cover_fraction,
            undergrowth_cover_fraction,
            trees_per_ha: rooted(&seen.canopy) * per_ha,
            basal_area_m2_ha: sections_m2 * per_ha,
            undergrowth_per_ha: rooted(&seen.undergrowth) * per_ha,
            downed_m3_ha: None,
        }
    }

    /// Draws the figures as a list.
    pub fn draw(&self, canvas: &mut Canvas, lettering: &Lettering, rect: Rect) {
        let (left, right) = (rect.x as f32, rect.right() as f32);
        let mut y = rect.y as f32 + 16.0;
        lettering.draw(canvas, left, y, Align::Left, "Stand", CAPTION);
        let whole = |n: f64| thousands(n.round().max(0.0) as usize); // plants a hectare
        let lines = [
            ("Canopy cover", percent(self.canopy_cover_fraction)),
            ("Undergrowth cover", percent(self.undergrowth_cover_fraction)),
            ("Canopy trees", format!("{} /ha", whole(self.trees_per_ha))),
            (
                "Basal area of the canopy",
                format!("{} m²/ha", scale::fixed(self.basal_area_m2_ha, 1)),
            ),
            ("Undergrowth", format!("{} /ha", whole(self.undergrowth_per_ha))),
        ];
        let downed = self
            .downed_m3_ha
            .map(|m3_ha| ("Volume of downed logs", format!("{} m³/ha", scale::fixed(m3_ha, 1))));
        for (name, value) in lines.into_iter().chain(downed) {
            y += ROW_PX as f32 - 2.0;
            lettering.draw(canvas, left, y, Align::Left, name, LABEL);
            lettering.draw(canvas, right, y, Align::Right, &value, LABEL);
        }
    }
}
