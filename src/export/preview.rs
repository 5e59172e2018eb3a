//! A scene's map sheet: shaded relief, the crowns of its canopy, and small maps of what the site offers.

use std::io::Cursor;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ImageError, RgbImage};
use rayon::prelude::*;

use super::canvas::{Canvas, Rect, mix_light};
use super::crown_layer::CrownLayer;
use super::deadwood_layer::{self, DeadwoodLayer};
use super::furniture::{
    self, CAPTION, FRAME_INK, INK, LABEL, NAME, PAPER, SUBTITLE, TITLE, UNIT, rounded, void_color,
};
use super::layout::{self, Sheet};
use super::lettering::{Align, Lettering, Style};
use super::ramp::{Ramp, Rgb, Spread};
use super::relief::{self, lit};
use super::species_legend::{self, Entry};
use super::{fit::fit, rivers, scale, species_panel};
use crate::canopy::species_map::SpeciesMap;
use crate::plants::Plants;
use crate::plants::deadwood::Deadwood;
use crate::raster::{Crs, Frame, Grid};
use crate::species::Biome;
use crate::terrain::Terrain;

const WATER: Rgb = [52, 108, 158];
/// Ground under and between crowns is drawn paler, towards this, so that crowns stand out; and by how much.
const PALE: [f32; 3] = [232.0, 226.0, 212.0];
const PALE_FRACTION: f32 = 0.5;
/// How much of the relief's light crowns take, and how dark their shadows are on the ground.
const RELIEF_ON_CROWNS: f32 = 0.32;
const CROWN_SHADOW: f32 = 0.55;

/// What the small maps show; what is missing is left out.
#[derive(Clone, Debug, Default)]
pub struct PreviewMaps<'a> {
    /// Sunlight in hours a day, mean of the year.
    pub sunlight_h: Option<Grid<f32>>,
    /// Soil moisture in mm, mean of the year.
    pub moisture_mm: Option<Grid<f32>>,
    /// Temperature in °C, mean of the year.
    pub temperature_c: Option<Grid<f32>>,
    /// Slope in radians.
    pub slope_rad: Option<Grid<f32>>,
    /// Discharge in m³/s, mean of the year; drawn as rivers on the large map.
    pub discharge_m3_s: Option<Grid<f32>>,
    /// Cells that are river; without it the largest discharges are drawn.
    pub river: Option<&'a [bool]>,
    /// Canopy trees; with them the sheet is a forest map.
    pub canopy: Option<CanopyLayer<'a>>,
}

/// The canopy that a forest map shows.
#[derive(Clone, Copy, Debug)]
pub struct CanopyLayer<'a> {
    /// Plants; those of the canopy are drawn.
    pub plants: &'a Plants,
    /// What the plants' species are.
    pub biome: &'a Biome,
    /// Canopy height.
    pub chm_m: &'a Grid<f32>,
    /// Which species stands where.
    pub species: &'a SpeciesMap,
    /// Snags and downed logs, where the forest has a history.
    pub deadwood: Option<&'a Deadwood>,
}

/// What a sheet says beside its maps.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PreviewOptions {
    /// The scene's name, the sheet's title.
    pub title: String,
    /// Where the climate of the maps comes from.
    pub climate: Option<String>,
}

impl Default for PreviewOptions {
    fn default() -> Self {
        Self { title: "Terrain".to_owned(), climate: None }
    }
}

/// One composed picture, 1600 × 1100 pixels for a square tile, other shapes for others; with canopy trees a forest map.
/// The same picture for the same input on every machine.
///
/// # Panics
/// If the terrain or a map has no cells.
pub fn preview(terrain: &Terrain, maps: &PreviewMaps<'_>, options: &PreviewOptions) -> RgbImage {
    let elevation = &terrain.elevation_m;
    let frame = elevation.frame();
    let panels = panels(maps);
    let mut sheet = layout::arrange(frame.cols as f64 / frame.rows as f64, panels.len());
    let species = maps.canopy.map(|c| species_legend::entries(c.plants, c.biome));
    if let Some(species) = &species {
        sheet = sheet.with_species(species.len());
    }
    let deadwood = maps.canopy.and_then(|c| c.deadwood);
    if deadwood.is_some() {
        sheet = sheet.with_deadwood();
    }
    let mut pen = Pen {
        canvas: Canvas::new(sheet.width, sheet.height, PAPER),
        lettering: Lettering::default(),
    };

    pen.heading(&sheet, frame, options);
    let elevation_range = pen.large_map(sheet.map, elevation, maps);
    pen.footer(&sheet, frame, elevation_range);
    if let (Some(rect), Some(species)) = (sheet.species, &species) {
        let room = if deadwood.is_some() { layout::DEADWOOD_PX } else { 0 };
        let trees = Rect { height: rect.height - room, ..rect };
        pen.species_legend(trees, species, land_ha(elevation));
        if let Some(deadwood) = deadwood {
            pen.deadwood_legend([rect.x, rect.bottom() - 6], deadwood, land_ha(elevation));
        }
    }
    if let Some(first) = sheet.panels.first() {
        let ground = Ground::of(elevation, *first);
        for (rect, panel) in sheet.panels.iter().zip(&panels) {
            pen.small_map(*rect, panel, &ground);
        }
    }
    pen.canvas.into_image()
}

/// A picture as PNG.
///
/// # Errors
/// Where the encoder fails, which it does only for lack of memory.
pub fn encode_png(picture: &RgbImage) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(
        Cursor::new(&mut bytes),
        CompressionType::Fast,
        FilterType::Adaptive,
    );
    picture.write_with_encoder(encoder)?;
    Ok(bytes)
}

/// Hectares of land a map shows.
fn land_ha(elevation_m: &Grid<f32>) -> f64 {
    let cell_m = elevation_m.frame().transform.cell_m;
    elevation_m.mask().valid_count() as f64 * cell_m * cell_m / 1e4
}

/// A small map.
struct Panel<'a> {
    title: &'static str,
    unit: &'static str,
    shows: Shows<'a>,
}

enum Shows<'a> {
    /// A measure by a colour ramp, times a factor from the grid's unit to the unit shown.
    Measure(&'a Grid<f32>, Ramp, f32),
    /// Species in their colours.
    Species(&'a SpeciesMap, &'a Biome),
}

/// Most small maps on a sheet.
const MOST_PANELS: usize = 4;

fn panels<'a>(maps: &'a PreviewMaps<'_>) -> Vec<Panel<'a>> {
    let degrees = 1_f32.to_degrees();
    let all = [
        (&maps.sunlight_h, "Sunlight", "h/day, yearly mean", Ramp::SUNLIGHT, 1.0),
        (&maps.moisture_mm, "Soil moisture", "mm, yearly mean", Ramp::MOISTURE, 1.0),
        (&maps.temperature_c, "Temperature", "°C, yearly mean", Ramp::TEMPERATURE, 1.0),
        (&maps.slope_rad, "Slope", "degrees", Ramp::SLOPE, degrees),
    ];
    let panel = |(grid, title, unit, ramp, to_shown): (&'a Option<Grid<f32>>, _, _, _, _)| {
        grid.as_ref().map(|grid| Panel { title, unit, shows: Shows::Measure(grid, ramp, to_shown) })
    };
    let site = all.into_iter().filter_map(panel);
    let Some(canopy) = &maps.canopy else { return site.collect() };
    let height = Shows::Measure(canopy.chm_m, Ramp::CANOPY_HEIGHT, 1.0);
    let species = Shows::Species(canopy.species, canopy.biome);
    let forest = [
        Panel { title: "Canopy height", unit: "m", shows: height },
        Panel { title: "Species", unit: "most suitable", shows: species },
    ];
    forest.into_iter().chain(site).take(MOST_PANELS).collect()
}

/// Terrain at a map's pixels, and its light.
pub(super) struct Ground {
    /// Elevation.
    pub elevation_m: Grid<f32>,
    /// Light against flat ground's: −1 full shade, 0 flat, 1 full light.
    pub light: Vec<f32>,
}

impl Ground {
    /// Terrain fitted to a map's pixels.
    pub fn of(elevation_m: &Grid<f32>, rect: Rect) -> Self {
        let (rows, cols) = (rect.height as usize, rect.width as usize);
        let fitted = fit(elevation_m, rows, cols);
        let exaggeration = relief::fitting_exaggeration(&fitted);
        let shade = relief::soft_hillshade(&fitted, exaggeration);

        // hollows a little darker, heights a little lighter, as under an open sky
        let broad_cells = (rows.min(cols) / 14).max(1);
        let broad =
            fit(&fit(&fitted, rows.div_ceil(broad_cells), cols.div_ceil(broad_cells)), rows, cols);
        let rise: Vec<f32> =
            fitted.values().iter().zip(broad.values()).map(|(z, mean)| z - mean).collect();
        let valid = fitted.mask().as_slice();
        let squares: f64 =
            rise.iter().zip(valid).filter(|(_, v)| **v).map(|(r, _)| f64::from(r * r)).sum();
        let spread = (squares / fitted.mask().valid_count().max(1) as f64).sqrt() as f32;
        let per_rise = 0.5 / spread.max(1e-6);
        let light = shade
            .values()
            .par_iter()
            .zip(&rise)
            .map(|(&s, r)| {
                (relief::against_flat(s) + 0.16 * (r * per_rise).clamp(-1.0, 1.0)).clamp(-1.0, 1.0)
            })
            .collect();
        Self { elevation_m: fitted, light }
    }
}

/// Colour of flat ground at a place along the range of elevations; paler on a forest map.
fn ground_tint(along: f32, forest: bool) -> [f32; 3] {
    let tint = Ramp::ELEVATION.color(along);
    let paler = if forest { PALE_FRACTION } else { 0.0 };
    std::array::from_fn(|c| tint[c] + paler * (PALE[c] - tint[c]))
}

/// Draws a sheet's parts.
struct Pen {
    canvas: Canvas,
    lettering: Lettering,
}

impl Pen {
    fn text(&mut self, x: u32, y: u32, align: Align, text: &str, style: Style) {
        self.lettering.draw(&mut self.canvas, x as f32, y as f32, align, text, style);
    }

    fn heading(&mut self, sheet: &Sheet, frame: &Frame, options: &PreviewOptions) {
        let room = (sheet.width - 2 * layout::MARGIN_PX) as f32;
        let title = self.lettering.shortened(&options.title, TITLE, room);
        let mut facts = facts(frame);
        if let Some(climate) = &options.climate {
            facts.push_str(&format!("   ·   climate: {climate}"));
        }
        let room = if sheet.species.is_some() { room - 90.0 } else { room }; // the name stands right
        let facts = self.lettering.shortened(&facts, SUBTITLE, room);
        let (x, y) = (layout::MARGIN_PX, layout::MARGIN_PX);
        self.text(x, y + 26, Align::Left, &title, TITLE);
        self.text(x, y + 57, Align::Left, &facts, SUBTITLE);
    }

    /// Draws the large map; gives the range of elevations it shows.
    fn large_map(
        &mut self,
        rect: Rect,
        elevation_m: &Grid<f32>,
        maps: &PreviewMaps<'_>,
    ) -> Option<Spread> {
        let (rows, cols) = (rect.height as usize, rect.width as usize);
        let ground = Ground::of(elevation_m, rect);
        let range = ground.elevation_m.range().map(|(low, high)| Spread { low, high });
        let river = maps
            .discharge_m3_s
            .as_ref()
            .map(|discharge| rivers::coverage(discharge, maps.river, rows, cols));
        let crowns = maps
            .canopy
            .map(|c| CrownLayer::draw(c.plants, c.biome, elevation_m.frame(), rows, cols));
        let dead = maps.canopy.zip(crowns.as_ref()).and_then(|(canopy, crowns)| {
            let size = [rows, cols];
            let deadwood = canopy.deadwood?;
            Some(DeadwoodLayer::draw(deadwood, elevation_m.frame(), &crowns.cover, size))
        });
        let place = |z: f32| range.map_or(0.5, |r| r.place(z));
        let color = |pixel: usize| {
            if !ground.elevation_m.mask().is_valid(pixel) {
                return void_color(pixel % cols, pixel / cols);
            }
            let along = place(ground.elevation_m.values()[pixel]);
            let tint = ground_tint(along, crowns.is_some());
            let land = lit(tint, ground.light[pixel], 1.0);
            let water = river.as_ref().map_or(0.0, |r| r[pixel]);
            let land = std::array::from_fn(|c| mix_light(land[c], f32::from(WATER[c]), water));
            let Some(crowns) = &crowns else { return rounded(land) };
            let land = lit(land, -crowns.shadow[pixel], CROWN_SHADOW);
            let crown = lit(crowns.color[pixel], ground.light[pixel], RELIEF_ON_CROWNS);
            let cover = crowns.cover[pixel];
            let living = std::array::from_fn(|c| mix_light(land[c], crown[c], cover));
            rounded(dead.as_ref().map_or(living, |dead| dead.over(pixel, living)))
        };
        self.pixels(rect, color);
        range
    }

    fn small_map(&mut self, rect: Rect, panel: &Panel<'_>, ground: &Ground) {
        self.caption(rect, panel);
        match panel.shows {
            Shows::Measure(grid, ramp, to_shown) => {
                self.measure(rect, grid, ramp, to_shown, ground);
            }
            Shows::Species(species, biome) => {
                let (rows, cols) = (rect.height as usize, rect.width as usize);
                let colors = species_panel::colors(species, biome, rows, cols);
                let color = |pixel: usize| match colors[pixel] {
                    Some(color) => rounded(lit(color, ground.light[pixel], 0.5)),
                    None => void_color(pixel % cols, pixel / cols),
                };
                self.pixels(rect, color);
                let note = "colours as in the legend";
                self.text(rect.x, rect.bottom() + 20, Align::Left, note, UNIT);
            }
        }
    }

    /// Paints a map pixel by pixel.
    fn pixels(&mut self, rect: Rect, color: impl Fn(usize) -> Rgb + Sync + Send) {
        let (rows, cols) = (rect.height as usize, rect.width as usize);
        let pixels: Vec<Rgb> = (0..rows * cols).into_par_iter().map(color).collect();
        self.canvas.paint(rect, |x, y| pixels[y as usize * cols + x as usize]);
        self.canvas.frame(rect, FRAME_INK);
    }

    fn measure(
        &mut self,
        rect: Rect,
        grid: &Grid<f32>,
        ramp: Ramp,
        to_shown: f32,
        ground: &Ground,
    ) {
        let (rows, cols) = (rect.height as usize, rect.width as usize);
        let mut shown = fit(grid, rows, cols);
        shown.values_mut().iter_mut().for_each(|v| *v *= to_shown);
        let spread = Spread::robust(shown.valid_values().copied());
        self.pixels(rect, |pixel| match spread {
            Some(spread) if shown.mask().is_valid(pixel) => {
                let tint = ramp.color(spread.place(shown.values()[pixel]));
                rounded(lit(tint, ground.light[pixel], 0.5))
            }
            _ => void_color(pixel % cols, pixel / cols),
        });
        let Some(spread) = spread else { return };
        let bar =
            Rect { x: rect.x, y: rect.bottom() + 9, width: rect.width.clamp(120, 420), height: 10 };
        self.ramp(bar, |along| ramp.color(along));
        let decimals = decimals_for(spread);
        let low = scale::fixed(f64::from(spread.low), decimals);
        let high = scale::fixed(f64::from(spread.high), decimals);
        self.text(bar.x, bar.bottom() + 18, Align::Left, &low, LABEL);
        self.text(bar.right(), bar.bottom() + 18, Align::Right, &high, LABEL);
    }

    /// Title, number of trees, and the species.
    fn species_legend(&mut self, rect: Rect, species: &[Entry], land_ha: f64) {
        let trees: usize = species.iter().map(|e| e.trees).sum();
        let y = rect.y + species_legend::TITLE_PX - 10;
        self.text(rect.x, y, Align::Left, "Canopy trees", CAPTION);
        if trees == 0 {
            let after = rect.x + self.lettering.width_px("Canopy trees", CAPTION) as u32 + 9;
            self.text(after, y, Align::Left, "none", UNIT);
            return;
        }
        let styles = [LABEL, Style { size_px: 12.0, ..UNIT }];
        species_legend::draw(&mut self.canvas, &self.lettering, rect, species, styles);
        let count = species_legend::thousands(trees);
        let per_ha = trees as f64 / land_ha.max(f64::MIN_POSITIVE);
        let decimals = if per_ha < 10.0 { 1 } else { 0 };
        let sum = format!("{count} trees, {} a hectare", scale::trimmed(per_ha, decimals));
        self.text(rect.x, rect.bottom() - 6, Align::Left, &sum, UNIT);
    }

    /// Symbols, numbers and densities of snags and downed logs in one line.
    fn deadwood_legend(&mut self, [x, y]: [u32; 2], deadwood: &Deadwood, land_ha: f64) {
        let [rim, snag, downed_log] = deadwood_layer::LEGEND;
        let numbers =
            [("Snags", deadwood.snags.len()), ("Downed logs", deadwood.downed_logs.len())];
        let mut left = x as f32;
        let middle = y as f32 - 5.0;
        for (is_log, (name, number)) in [false, true].into_iter().zip(numbers) {
            if is_log {
                let line = [[left + 1.0, middle], [left + 15.0, middle]];
                self.canvas.polyline(&line, 2.0, downed_log, 1.0);
            } else {
                let dot = [[left + 7.0, middle]];
                self.canvas.polyline(&dot, 10.0, rim, 1.0);
                self.canvas.polyline(&dot, 7.0, snag, 1.0);
            }
            let per_ha = number as f64 / land_ha.max(f64::MIN_POSITIVE);
            let decimals = if per_ha < 10.0 { 1 } else { 0 };
            let count = species_legend::thousands(number);
            let facts = format!("{count}, {} a hectare", scale::trimmed(per_ha, decimals));
            let after = left + 24.0 + self.lettering.width_px(name, LABEL) + 8.0;
            self.lettering.draw(&mut self.canvas, left + 24.0, y as f32, Align::Left, name, LABEL);
            self.lettering.draw(&mut self.canvas, after, y as f32, Align::Left, &facts, UNIT);
            left = after + self.lettering.width_px(&facts, UNIT) + 28.0;
        }
    }

    /// Title and unit above a small map; beside narrow maps only as much of the unit as there is room for.
    fn caption(&mut self, rect: Rect, panel: &Panel<'_>) {
        let y = rect.y - 10;
        self.text(rect.x, y, Align::Left, panel.title, CAPTION);
        let title_px = self.lettering.width_px(panel.title, CAPTION) + 9.0;
        let room_px = (rect.width as f32).max(layout::LEAST_SLOT_PX as f32) - title_px;
        let short = panel.unit.split(',').next().unwrap_or_default();
        let fits = |unit: &&str| self.lettering.width_px(unit, UNIT) <= room_px;
        if let Some(unit) = [panel.unit, short].into_iter().find(fits) {
            self.text(rect.x + title_px as u32, y, Align::Left, unit, UNIT);
        }
    }

    fn ramp(&mut self, bar: Rect, color: impl Fn(f32) -> [f32; 3]) {
        let last = (bar.width - 1).max(1) as f32;
        self.canvas.paint(bar, |x, _| rounded(color(x as f32 / last)));
        self.canvas.frame(bar, FRAME_INK);
    }

    fn footer(&mut self, sheet: &Sheet, frame: &Frame, elevation_m: Option<Spread>) {
        let (x, y) = (sheet.footer.x, sheet.footer.y);
        let m_per_px = frame.cols as f64 * frame.transform.cell_m / f64::from(sheet.map.width);
        furniture::scale_bar(&mut self.canvas, &self.lettering, [x, y + 34], m_per_px);
        furniture::north_arrow(&mut self.canvas, &self.lettering, [x + 345, y + 8]);
        if let Some(range) = elevation_m {
            self.elevation_legend(x + 430, y, range, sheet.species.is_some());
        }
        let signature = Style { size_px: 13.0, ..UNIT };
        if sheet.species.is_some() {
            self.text(sheet.footer.right(), layout::MARGIN_PX + 57, Align::Right, NAME, signature);
        } else {
            self.text(sheet.footer.right(), y + 62, Align::Right, NAME, signature);
        }
    }

    fn elevation_legend(&mut self, x: u32, y: u32, range: Spread, forest: bool) {
        self.text(x, y + 24, Align::Left, "Elevation", CAPTION);
        let after = x + self.lettering.width_px("Elevation", CAPTION) as u32 + 9;
        self.text(after, y + 24, Align::Left, "metres above sea level", UNIT);
        let bar = Rect { x, y: y + 34, width: 360, height: 12 };
        self.ramp(bar, |along| ground_tint(along, forest));
        let (low, high) = (f64::from(range.low), f64::from(range.high));
        let ticks = scale::ticks(low, high, 8);
        let decimals = decimals_for(range);
        for tick in ticks {
            let at = bar.x + ((tick - low) / (high - low) * f64::from(bar.width)).round() as u32;
            for down in 0..5 {
                self.canvas.blend(i64::from(at), i64::from(bar.bottom() + down), INK, 1.0);
            }
            let label = scale::trimmed(tick, decimals);
            self.text(at, bar.bottom() + 20, Align::Center, &label, LABEL);
        }
    }
}

/// Decimals that tell the ends of a range apart in about three digits.
fn decimals_for(range: Spread) -> usize {
    match range.high - range.low {
        span if span >= 20.0 => 0,
        span if span >= 1.0 => 1,
        span if span >= 0.1 => 2,
        _ => 3,
    }
}

fn facts(frame: &Frame) -> String {
    let t = frame.transform;
    let crs = furniture::crs_name(&frame.crs);
    let (width_m, height_m) = (frame.cols as f64 * t.cell_m, frame.rows as f64 * t.cell_m);
    let mut text = format!(
        "{} × {}   ·   {} × {} cells of {}   ·   {crs}",
        scale::length_label(width_m),
        scale::length_label(height_m),
        frame.cols,
        frame.rows,
        scale::length_label(t.cell_m),
    );
    if frame.crs != Crs::Local {
        text += &format!(
            "   ·   E {:.0}–{:.0}, N {:.0}–{:.0}",
            t.west_m,
            t.west_m + width_m,
            t.north_m - height_m,
            t.north_m
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::sync::Arc;

    use super::*;
    use crate::export::crown_layer;
    use crate::raster::Mask;

    fn hills(rows: usize, cols: usize) -> Terrain {
        let elevation_m = Grid::from_fn(rows, cols, 2.0, |c| {
            let (x, y) = (c.col as f32 / 12.0, c.row as f32 / 9.0);
            300.0 + 20.0 * crate::math::sin(x) * crate::math::cos(y) + y
        });
        Terrain { elevation_m, latitude_rad: 0.7, grid_convergence_rad: 0.0 }
    }

    fn maps(terrain: &Terrain) -> PreviewMaps<'static> {
        let z = &terrain.elevation_m;
        let map =
            |f: fn(f32) -> f32| Some(z.with_values(z.values().iter().map(|z| f(*z)).collect()));
        PreviewMaps {
            sunlight_h: map(|z| z / 30.0),
            moisture_mm: map(|z| 900.0 - z),
            temperature_c: map(|z| 12.0 - z * 0.0065),
            slope_rad: map(|z| z / 900.0),
            discharge_m3_s: map(|z| (330.0 - z).max(0.0)),
            river: None,
            canopy: None,
        }
    }

    #[test]
    fn the_picture_is_the_same_for_any_number_of_threads() {
        let terrain = hills(60, 80);
        let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        let draw = || preview(&terrain, &maps(&terrain), &PreviewOptions::default());
        assert!(pool(1).install(draw) == pool(3).install(draw));
    }

    #[test]
    fn the_picture_has_content_and_png_keeps_it() {
        let terrain = hills(60, 60);
        let picture = preview(&terrain, &maps(&terrain), &PreviewOptions::default());
        let colors: BTreeSet<[u8; 3]> = picture.pixels().map(|p| p.0).collect();
        assert!(colors.len() > 2_000, "{} colours", colors.len());
        let bytes = encode_png(&picture).unwrap();
        let back = image::load_from_memory(&bytes).unwrap().into_rgb8();
        assert!(back == picture);
    }

    #[test]
    fn crowns_and_their_legend_are_drawn_and_no_plants_are_no_trouble() {
        let terrain = hills(60, 60);
        let biome = Biome::builtin("sonoma").unwrap();
        let grid = &terrain.elevation_m;
        let chm_m = grid.with_values(vec![12.0; 3600]);
        let species = grid.with_values(vec![8; 3600]);
        let trees = [(40.0, 60.0, 9.0, 20.0, 8), (80.0, 70.0, 7.0, 22.0, 14)];
        let forest = crown_layer::tests::plants(120.0, &trees);
        let draw = |plants: &Plants| {
            let canopy = CanopyLayer {
                plants,
                biome: &biome,
                chm_m: &chm_m,
                species: &species,
                deadwood: None,
            };
            let maps = PreviewMaps { canopy: Some(canopy), ..maps(&terrain) };
            preview(&terrain, &maps, &PreviewOptions::default())
        };
        let (with, without) = (draw(&forest), draw(&Plants::default()));
        let of_color = |p: &RgbImage, s: usize| {
            p.pixels().filter(|q| q.0 == biome.species[s].color_srgb).count()
        };
        // the swatch of douglas-fir, which the small map does not show
        assert!(of_color(&with, 14) >= 14 * 14 && of_color(&without, 14) == 0);
        assert!(with.width() == without.width() && with.height() >= without.height());
    }

    /// Two trees on hills, without anything dead.
    fn forest_sheet(deadwood: Option<&Deadwood>) -> RgbImage {
        let terrain = hills(60, 60);
        let biome = Biome::builtin("sonoma").unwrap();
        let grid = &terrain.elevation_m;
        let chm_m = grid.with_values(vec![12.0; 3600]);
        let species = grid.with_values(vec![8; 3600]);
        let trees = [(40.0, 60.0, 9.0, 20.0, 8), (80.0, 70.0, 7.0, 22.0, 14)];
        let plants = &crown_layer::tests::plants(120.0, &trees);
        let canopy =
            CanopyLayer { plants, biome: &biome, chm_m: &chm_m, species: &species, deadwood };
        let maps = PreviewMaps { canopy: Some(canopy), ..maps(&terrain) };
        preview(&terrain, &maps, &PreviewOptions::default())
    }

    #[test]
    fn sheets_without_deadwood_are_what_they_were_before_it_could_be_drawn() {
        let sheet = forest_sheet(None);
        let hash = blake3::hash(sheet.as_raw()).to_hex();
        assert_eq!((sheet.width(), sheet.height(), &hash[..16]), (1600, 1070, "f0d6dc0387cfab06"));
    }

    #[test]
    fn deadwood_is_drawn_and_counted_below_the_species() {
        let none = forest_sheet(Some(&Deadwood::default()));
        let deadwood = Deadwood {
            snags: deadwood_layer::tests::snags(&[(20.0, 20.0, 15.0, 15.0, 0.6, 0.5, 2)]),
            downed_logs: deadwood_layer::tests::downed_logs(&[(60.0, 20.0, 30.0, 0.6, 0.4, 1)]),
        };
        let some = forest_sheet(Some(&deadwood));
        let plain = forest_sheet(None);
        assert!(none.height() > plain.height(), "a line more");
        // an empty layer leaves the map as it was
        let map = layout::arrange(1.0, 4).map;
        let differ = |a: &RgbImage, b: &RgbImage| {
            let pixels =
                (map.y..map.bottom()).flat_map(|y| (map.x..map.right()).map(move |x| [x, y]));
            pixels.filter(|&[x, y]| a.get_pixel(x, y) != b.get_pixel(x, y)).count()
        };
        assert_eq!(differ(&none, &plain), 0);
        // 30 m of 0.4 m, and a dot, at 6 pixels a metre
        let changed = differ(&some, &plain);
        assert!((300..900).contains(&changed), "{changed}");
    }

    #[test]
    fn slopes_towards_the_light_are_brighter_on_the_map() {
        let face = |sign: f32| {
            let elevation_m = Grid::from_fn(40, 40, 1.0, |c| sign * 0.5 * (c.row + c.col) as f32);
            Ground::of(&elevation_m, Rect { x: 0, y: 0, width: 40, height: 40 }).light[820]
        };
        assert!(face(1.0) > 0.3, "{}", face(1.0));
        assert!(face(-1.0) < -0.3, "{}", face(-1.0));
    }

    #[test]
    fn sheets_of_odd_shapes_and_missing_maps_are_drawn() {
        for (rows, cols) in [(1, 1), (2, 2), (20, 20), (10, 200), (200, 10)] {
            let terrain = hills(rows, cols);
            for maps in [PreviewMaps::default(), maps(&terrain)] {
                let picture = preview(&terrain, &maps, &PreviewOptions::default());
                assert!(picture.width() >= 900 && picture.height() > 200);
            }
        }
    }

    #[test]
    fn voids_are_pale_and_an_empty_map_is_no_trouble() {
        let terrain = hills(40, 40);
        let grid = &terrain.elevation_m;
        let masked = |valid: Vec<bool>| Terrain {
            elevation_m: Grid::new(
                Arc::clone(grid.frame()),
                Arc::new(Mask::new(valid)),
                grid.values().to_vec(),
            ),
            ..terrain.clone()
        };
        let count = |t: &Terrain| {
            let picture = preview(t, &PreviewMaps::default(), &PreviewOptions::default());
            picture
                .pixels()
                .filter(|p| [furniture::VOID, furniture::VOID_HATCH].contains(&p.0))
                .count()
        };
        let half = count(&masked((0..1600).map(|i| i % 40 < 20).collect()));
        let all = count(&masked(vec![false; 1600]));
        assert_eq!(all, 900 * 900);
        assert!((half as f64 / all as f64 - 0.5).abs() < 0.03, "{half} of {all}");
    }
}
