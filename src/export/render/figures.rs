//! Colours that stand for a figure of each plant: species, age, vigor or decay.

use super::vector::Vec3;
use super::world::linear_rgb;
use crate::export::instances::{FeatureTable, Instances};
use crate::export::ramp::{Ramp, Spread};
use crate::export::selection::Selection;

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
    /// Decay class of deadwood; plants are pale.
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

/// Colours of each instance, by group; `None` where they are natural.
pub fn paint(
    colour: Colour,
    selection: &Selection,
    instances: &Instances,
) -> Option<Vec<Vec<Vec3>>> {
    if colour == Colour::Natural {
        return None;
    }
    let spread = |values: &[f32]| {
        Spread::robust(values.iter().copied()).unwrap_or(Spread { low: 0.0, high: 1.0 })
    };
    let (plants, ages, vigors) =
        (&selection.plants, spread(&selection.plants.age_years), Spread { low: -0.2, high: 1.0 });
    let ramp = |ramp: &Ramp, place: f32| {
        linear_rgb(ramp.color(place).map(|c| (c + 0.5).clamp(0.0, 255.0) as u8)) // clamped
    };
    let decay =
        |classes: &[u8], row: usize| linear_rgb(DECAY[usize::from(classes[row].clamp(1, 5)) - 1]);
    let of_row = |table: FeatureTable, species: u16, row: usize| match (colour, table) {
        (Colour::Species, _) => {
            linear_rgb(selection.biome.species[usize::from(species)].color_srgb)
        }
        (Colour::Age, FeatureTable::Plants) => {
            ramp(&Ramp::SUNLIGHT, ages.place(plants.age_years[row]))
        }
        (Colour::Vigor, FeatureTable::Plants) => {
            ramp(&Ramp::CANOPY_HEIGHT, vigors.place(plants.vigor[row]))
        }
        (Colour::Decay, FeatureTable::Snags) => decay(&selection.snags.decay_class, row),
        (Colour::Decay, FeatureTable::DownedLogs) => decay(&selection.downed_logs.decay_class, row),
        (Colour::Decay, FeatureTable::Plants) => linear_rgb(PALE),
        _ => linear_rgb(GREY),
    };
    let groups = instances.groups.iter().map(|group| {
        let species = instances.archetypes[group.archetype].species;
        // rows fit into memory
        group.row.iter().map(|row| of_row(group.table, species, *row as usize)).collect()
    });
    Some(groups.collect())
}
