//! Legend of species: swatches, names, numbers of trees and shares of crown area, the largest share first.

use super::canvas::{Canvas, Rect};
use super::lettering::{Align, Lettering, Style};
use super::ramp::Rgb;
use super::scale;
use crate::plants::{Layer, Plants};
use crate::species::Biome;

/// Room for the title above the entries.
pub const TITLE_PX: u32 = 34;
/// Room for the sum below the entries.
const SUM_PX: u32 = 24;
/// Height of an entry.
pub const ROW_PX: u32 = 23;
/// Least width of a column of entries.
pub const COLUMN_PX: u32 = 300;
/// Space between columns.
pub const COLUMN_GAP_PX: u32 = 28;
/// Most entries; those of the least shares are summed up in the last.
pub const MOST_ENTRIES: usize = 16;
const SWATCH_PX: u32 = 14;
const OTHERS: Rgb = [150, 150, 150];

/// A species of the legend.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Everyday name.
    pub name: String,
    /// Colour on the map.
    pub color: Rgb,
    /// Number of its canopy trees.
    pub trees: usize,
    /// Its share of the sum of all crowns' areas.
    pub crown_area_fraction: f64,
}

/// Entries of all species that have canopy trees: the largest share of crown area first, equal shares in the biome's order.
pub fn entries(plants: &Plants, biome: &Biome) -> Vec<Entry> {
    let mut trees = vec![0_usize; biome.species.len()];
    let mut areas = vec![0.0_f64; biome.species.len()];
    for index in (0..plants.len()).filter(|&i| plants.layer[i] == Layer::Canopy) {
        let species = usize::from(plants.species[index]);
        let radius_m = f64::from(plants.crown_radius_m[index]);
        trees[species] += 1;
        areas[species] += radius_m * radius_m;
    }
    let total: f64 = areas.iter().sum();
    let mut order: Vec<usize> = (0..trees.len()).filter(|&s| trees[s] > 0).collect();
    order.sort_by(|&a, &b| areas[b].total_cmp(&areas[a]).then(a.cmp(&b)));
    let entry = |&s: &usize| Entry {
        name: biome.species[s].common_name.clone(),
        color: biome.species[s].color_srgb,
        trees: trees[s],
        crown_area_fraction: areas[s] / total.max(f64::MIN_POSITIVE),
    };
    let mut entries: Vec<Entry> = order.iter().map(entry).collect();
    if entries.len() > MOST_ENTRIES {
        let rest = entries.split_off(MOST_ENTRIES - 1);
        entries.push(Entry {
            name: format!("{} other species", rest.len()),
            color: OTHERS,
            trees: rest.iter().map(|e| e.trees).sum(),
            crown_area_fraction: rest.iter().map(|e| e.crown_area_fraction).sum(),
        });
    }
    entries
}

/// A share of one in percent: whole from ten on, one decimal below.
pub fn percent(fraction: f64) -> String {
    let percent = 100.0 * fraction;
    match percent {
        p if p >= 9.95 => format!("{p:.0} %"),
        p if p >= 0.05 || p <= 0.0 => format!("{} %", scale::trimmed(p, 1)),
        _ => "<0.1 %".to_owned(),
    }
}

/// A whole number with its thousands apart.
pub fn thousands(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Draws the entries down one column after the other, as many columns as `rect` has room for.
pub fn draw(
    canvas: &mut Canvas,
    lettering: &Lettering,
    rect: Rect,
    entries: &[Entry],
    [ink, grey]: [Style; 2],
) {
    let columns = columns(rect.width);
    let rows = rows(entries.len(), rect.width).max(1);
    let width = (rect.width + COLUMN_GAP_PX) / columns as u32 - COLUMN_GAP_PX;
    // pixels of a sheet: small positive numbers
    let (share_x, trees_x) = (width as f32, width as f32 - 66.0);
    for column in 0..entries.len().div_ceil(rows) {
        let x = rect.x as f32 + column as f32 * (width + COLUMN_GAP_PX) as f32;
        let y = (rect.y + TITLE_PX - 10) as f32;
        lettering.draw(canvas, x + trees_x, y, Align::Right, "trees", grey);
        lettering.draw(canvas, x + share_x, y, Align::Right, "crowns", grey);
    }
    for (index, entry) in entries.iter().enumerate() {
        let (column, row) = ((index / rows) as u32, (index % rows) as u32);
        let x = rect.x + column * (width + COLUMN_GAP_PX);
        let y = rect.y + TITLE_PX + row * ROW_PX;
        let swatch = Rect { x, y: y + 1, width: SWATCH_PX, height: SWATCH_PX };
        canvas.paint(swatch, |_, _| entry.color);
        canvas.frame(swatch, grey.color);
        let (x, y) = (x as f32, (y + 13) as f32);
        let trees = thousands(entry.trees);
        let room = trees_x - lettering.width_px(&trees, ink) - 34.0;
        let name = lettering.shortened(&entry.name, ink, room);
        lettering.draw(canvas, x + 24.0, y, Align::Left, &name, ink);
        lettering.draw(canvas, x + trees_x, y, Align::Right, &trees, ink);
        let share = percent(entry.crown_area_fraction);
        lettering.draw(canvas, x + share_x, y, Align::Right, &share, ink);
    }
}

/// Columns that a width has room for.
pub fn columns(width_px: u32) -> usize {
    ((width_px + COLUMN_GAP_PX) / (COLUMN_PX + COLUMN_GAP_PX)).max(1) as usize
}

/// Rows of so many entries in a width.
pub fn rows(entries: usize, width_px: u32) -> usize {
    entries.div_ceil(columns(width_px))
}

/// Height of a legend of so many entries in a width.
pub fn height_px(entries: usize, width_px: u32) -> u32 {
    TITLE_PX + ROW_PX * rows(entries, width_px) as u32 + SUM_PX // a few rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::crown_layer::tests::plants;

    #[test]
    fn the_largest_share_of_crowns_comes_first_and_shares_add_up() {
        let biome = Biome::builtin("sonoma").unwrap();
        // species 9: two wide crowns; species 8: three narrow ones
        let trees = [(9, 6.0), (8, 1.0), (8, 2.0), (9, 5.0), (8, 2.0)];
        let trees: Vec<_> = trees.iter().map(|&(s, r)| (5.0, 5.0, r, 9.0, s)).collect();
        let mut plants = plants(50.0, &trees);
        let entries = entries(&plants, &biome);
        assert_eq!(entries.len(), 2);
        assert_eq!((entries[0].name.as_str(), entries[0].trees), ("Oregon White Oak", 2));
        assert_eq!(entries[1].trees, 3);
        assert!((entries[0].crown_area_fraction - 61.0 / 70.0).abs() < 1e-9);
        assert!((entries.iter().map(|e| e.crown_area_fraction).sum::<f64>() - 1.0).abs() < 1e-12);
        // undergrowth is not counted
        plants.layer[0] = Layer::Undergrowth;
        assert_eq!(super::entries(&plants, &biome)[0].trees, 1);
        assert!(super::entries(&Plants::default(), &biome).is_empty());
    }

    #[test]
    fn numbers_read_well() {
        assert_eq!([0, 999, 1000, 1_234_567].map(thousands), ["0", "999", "1,000", "1,234,567"]);
        assert_eq!(
            [0.4249, 0.0949, 0.02, 0.0001, 0.0].map(percent),
            ["42 %", "9.5 %", "2 %", "<0.1 %", "0 %"]
        );
    }
}
