//! Colours that stand for a figure of each plant, species, age, vigor or decay, and the key that tells which.

use super::vector::Vec3;
use super::world::linear_rgb;
use crate::export::canvas::{Canvas, Rect};
use crate::export::furniture::{self, rounded};
use crate::export::instances::{FeatureTable, Instances};
use crate::export::lettering::{Align, Lettering};
use crate::export::ramp::{Ramp, Rgb, Spread};
use crate::export::scale;
use crate::export::selection::Selection;
use crate::plants::{Layer, Plants};

/// What colours mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Colour {
    /// Leaves, bark and wood as they are.
    #[default]
    Natural,
    /// Species, in the colours of maps.
    Species,
    /// Age of plants; deadwood is grey.
    Age,
    /// Vigor of plants; deadwood is grey.
    Vigor,
    /// Decay class of deadwood; plants are pale stems without leaves, which would hide it.
    Decay,
}

impl Colour {
    /// Every meaning.
    pub const ALL: [Self; 5] = [Self::Natural, Self::Species, Self::Age, Self::Vigor, Self::Decay];

    /// Its name in flags.
    pub fn name(self) -> &'static str {
        match self {
            Self::Natural => "natural",
            Self::Species => "species",
            Self::Age => "age",
            Self::Vigor => "vigor",
            Self::Decay => "decay",
        }
    }

    /// The meaning of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|colour| colour.name() == name)
    }
}

/// Deadwood where colours stand for a figure of the living, and the living where they stand for one of the dead.
const GREY: [u8; 3] = [150, 148, 144];
const PALE: [u8; 3] = [196, 202, 190];
/// Decay classes from fresh to crumbling. chosen: from pale wood to dark earth, told apart in grey too.
const DECAY: [[u8; 3]; 5] =
    [[250, 222, 140], [240, 160, 80], [206, 92, 66], [130, 48, 76], [58, 28, 64]];

/// The ramp of a figure of plants, and the values it is spread over; `None` where colours are no ramp's.
fn scale_of(colour: Colour, plants: &Plants) -> Option<(Ramp, Spread)> {
    match colour {
        Colour::Age => {
            // undergrowth outnumbers the canopy, and would leave one colour for all of it
            let is_canopy = |layer: &Layer| *layer == Layer::Canopy;
            let ages = plants.layer.iter().zip(&plants.age_years);
            let ages = ages.filter(|(layer, _)| is_canopy(layer)).map(|(_, age)| *age);
            let ages = Spread::robust(ages).or(Spread::robust(plants.age_years.iter().copied()));
            Some((Ramp::SUNLIGHT, Spread { low: 0.0, high: ages.map_or(1.0, |ages| ages.high) }))
        }
        Colour::Vigor => Some((Ramp::CANOPY_HEIGHT, Spread { low: -0.2, high: 1.0 })),
        Colour::Natural | Colour::Species | Colour::Decay => None,
    }
}

/// Colours of each instance, by group; `None` where they are natural.
pub fn paint(
    colour: Colour,
    selection: &Selection,
    instances: &Instances,
) -> Option<Vec<Vec<Vec3>>> {
    if colour == Colour::Natural {
        return None;
    }
    let plants = &selection.plants;
    let scale = scale_of(colour, plants);
    let of_plant = |row: usize| {
        let values = if colour == Colour::Age { &plants.age_years } else { &plants.vigor };
        let living = if colour == Colour::Decay { PALE } else { GREY };
        let color = scale.map(|(ramp, spread)| rounded(ramp.color(spread.place(values[row]))));
        linear_rgb(color.unwrap_or(living))
    };
    let decay =
        |classes: &[u8], row: usize| linear_rgb(DECAY[usize::from(classes[row].clamp(1, 5)) - 1]);
    let of_row = |table: FeatureTable, species: u16, row: usize| match (colour, table) {
        (Colour::Species, _) => {
            linear_rgb(selection.biome.species[usize::from(species)].color_srgb)
        }
        (_, FeatureTable::Plants) => of_plant(row),
        (Colour::Decay, FeatureTable::Snags) => decay(&selection.snags.decay_class, row),
        (Colour::Decay, FeatureTable::DownedLogs) => decay(&selection.downed_logs.decay_class, row),
        _ => linear_rgb(GREY),
    };
    let groups = instances.groups.iter().map(|group| {
        let species = instances.archetypes[group.archetype].species;
        // rows fit into memory
        group.row.iter().map(|row| of_row(group.table, species, *row as usize)).collect()
    });
    Some(groups.collect())
}

/// Pictures smaller than this have no key: it would hide them.
const LEAST_KEY_SIZE_PX: [u32; 2] = [480, 320];
/// The plate under a key: distance from the picture's edge, width, and room around its content.
const PLATE_MARGIN_PX: u32 = 12;
const PLATE_WIDTH_PX: u32 = 264;
const PADDING_PX: u32 = 14;
/// Height of a swatch's row, and of the rest of a plate.
const ROW_PX: u32 = 22;
const HEAD_PX: u32 = 44;
const BAR_PX: u32 = 12;

/// Draws what colours mean into the upper left corner of a picture that is large enough.
pub fn draw_key(canvas: &mut Canvas, colour: Colour, selection: &Selection) {
    let (width, height) = canvas.image().dimensions();
    let [least_width, least_height] = LEAST_KEY_SIZE_PX;
    if colour == Colour::Natural || width < least_width || height < least_height {
        return;
    }
    let swatches = swatches(colour, selection);
    let room = (height - 2 * PLATE_MARGIN_PX - HEAD_PX) / ROW_PX;
    let rows = (swatches.len() as u32).min(room); // biomes have some dozens
    let is_cut = (rows as usize) < swatches.len();
    let scale = scale_of(colour, &selection.plants);
    let tall = HEAD_PX + rows * ROW_PX + if scale.is_some() { ROW_PX + BAR_PX } else { 0 };
    let (x, y) = (PLATE_MARGIN_PX, PLATE_MARGIN_PX);
    canvas.paint(Rect { x, y, width: PLATE_WIDTH_PX, height: tall }, |_, _| furniture::PAPER);
    let lettering = Lettering::default();
    let (left, mut top) = (x + PADDING_PX, y + HEAD_PX - 10);
    let title = match colour {
        Colour::Natural => "",
        Colour::Species => "Species",
        Colour::Age => "Age, years",
        Colour::Vigor => "Vigor",
        Colour::Decay => "Decay class",
    };
    // pixels of a picture: exact in f32
    let baseline = (y + 26) as f32;
    lettering.draw(canvas, left as f32, baseline, Align::Left, title, furniture::CAPTION);
    if let Some((ramp, spread)) = scale {
        let bar = Rect { x: left, y: top, width: PLATE_WIDTH_PX - 2 * PADDING_PX, height: BAR_PX };
        let across = bar.width as f32;
        canvas.paint(bar, |px, _| rounded(ramp.color((px as f32 + 0.5) / across)));
        canvas.frame(bar, furniture::INK);
        top = bar.bottom() + 4;
        let [low, high] = [spread.low, spread.high].map(f64::from);
        for tick in scale::ticks(low, high, 5) {
            // places along a bar need no more digits
            let at = left as f32 + across * spread.place(tick as f32);
            let text = scale::trimmed(tick, 2);
            let baseline = (top + 13) as f32;
            lettering.draw(canvas, at, baseline, Align::Center, &text, furniture::LABEL);
        }
        top += ROW_PX - 4;
    }
    for (row, (name, color)) in swatches.iter().take(rows as usize).enumerate() {
        if is_cut && row + 1 == rows as usize {
            let text = format!("and {} more", swatches.len() - row);
            let y = (top + 12) as f32;
            lettering.draw(canvas, left as f32, y, Align::Left, &text, furniture::LABEL);
            break;
        }
        let swatch = Rect { x: left, y: top, width: 16, height: 14 };
        canvas.paint(swatch, |_, _| *color);
        canvas.frame(swatch, furniture::INK);
        let (x, y) = ((left + 26) as f32, (top + 12) as f32);
        let room_px = (PLATE_WIDTH_PX - 2 * PADDING_PX - 26) as f32;
        let name = lettering.shortened(name, furniture::LABEL, room_px);
        lettering.draw(canvas, x, y, Align::Left, &name, furniture::LABEL);
        top += ROW_PX;
    }
}

/// Species that are there, live or dead: those of most crown area first, of all plants.
fn species_entries(selection: &Selection) -> Vec<(String, Rgb)> {
    let species = &selection.biome.species;
    let mut area_m2 = vec![0.0_f64; species.len()];
    let mut is_there = vec![false; species.len()];
    let plants = &selection.plants;
    for (index, radius_m) in plants.species.iter().zip(&plants.crown_radius_m) {
        area_m2[usize::from(*index)] += f64::from(radius_m * radius_m);
    }
    let dead = selection.snags.species.iter().chain(&selection.downed_logs.species);
    for index in plants.species.iter().chain(dead) {
        is_there[usize::from(*index)] = true;
    }
    let mut order: Vec<usize> = (0..species.len()).filter(|s| is_there[*s]).collect();
    order.sort_by(|a, b| area_m2[*b].total_cmp(&area_m2[*a]));
    order.into_iter().map(|s| (species[s].common_name.clone(), species[s].color_srgb)).collect()
}

/// Names of colours that stand for one thing each.
fn swatches(colour: Colour, selection: &Selection) -> Vec<(String, Rgb)> {
    let dead = || ("Deadwood".to_owned(), GREY);
    match colour {
        Colour::Natural => Vec::new(),
        Colour::Species => species_entries(selection),
        Colour::Age | Colour::Vigor => vec![dead()],
        Colour::Decay => {
            let words = ["fresh", "firm", "softening", "soft", "crumbling"];
            let classes = (1..).zip(words).zip(DECAY);
            let mut entries: Vec<_> =
                classes.map(|((class, word), color)| (format!("{class}, {word}"), color)).collect();
            entries.push(("Living stems".to_owned(), PALE));
            entries
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::selection::Filter;
    use crate::plants::deadwood::Deadwood;

    fn selection() -> Selection {
        let biome = crate::species::Biome::builtin("sonoma").unwrap();
        let sorrel = biome.species_index("redwood-sorrel").unwrap() as u16;
        let redwood = biome.species_index("redwood").unwrap() as u16;
        let plants = Plants {
            id: vec![1, 2],
            species: vec![sorrel, redwood],
            layer: vec![Layer::Undergrowth, Layer::Canopy],
            east_m: vec![1.0, 2.0],
            north_m: vec![1.0, 2.0],
            z_m: vec![0.0; 2],
            height_m: vec![0.2, 30.0],
            crown_radius_m: vec![0.4, 4.0],
            dbh_m: vec![0.0, 0.6],
            age_years: vec![2.0, 90.0],
            vigor: vec![0.5; 2],
        };
        let elevation_m = crate::raster::Grid::from_fn(4, 4, 1.0, |_| 0.0);
        let scene = crate::export::selection::SceneContent {
            name: "wood".to_owned(),
            biome,
            elevation_m,
            plants,
            deadwood: Some(Deadwood::default()),
            years: 0,
        };
        Selection::new(scene, &Filter::default()).unwrap()
    }

    #[test]
    fn keys_name_what_is_there_the_widest_first() {
        let names: Vec<String> =
            swatches(Colour::Species, &selection()).into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["Redwood", "Redwood Sorrel"]);
        assert_eq!(swatches(Colour::Decay, &selection()).len(), 6);
    }

    #[test]
    fn ages_are_spread_over_the_canopy_not_the_undergrowth() {
        let (_, spread) = scale_of(Colour::Age, &selection().plants).unwrap();
        assert_eq!((spread.low, spread.high), (0.0, 90.0));
    }

    #[test]
    fn keys_lie_on_large_pictures_of_figures_only() {
        let drawn = |colour: Colour, size: [u32; 2]| {
            let mut canvas = Canvas::new(size[0], size[1], [0; 3]);
            draw_key(&mut canvas, colour, &selection());
            canvas.image().get_pixel(PLATE_MARGIN_PX + 2, PLATE_MARGIN_PX + 2).0
        };
        for colour in [Colour::Species, Colour::Age, Colour::Vigor, Colour::Decay] {
            assert_eq!(drawn(colour, [480, 320]), furniture::PAPER, "{colour:?}");
            assert_eq!(drawn(colour, [479, 320]), [0; 3], "{colour:?}");
        }
        assert_eq!(drawn(Colour::Natural, [480, 320]), [0; 3]);
    }
}
