//! Atlases: collections of archetypes, and the choice among them for each plant, snag and downed log.
//!
//! The built-in one is [`low_poly`](super::low_poly); botanical models come as another.

use super::archetype::Archetype;
use crate::plants::deadwood::DownedLogKind;

/// What an atlas is told of a plant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlantMeasures {
    /// Index of its species in the biome.
    pub species: u16,
    /// Height.
    pub height_m: f32,
    /// Crown radius.
    pub crown_radius_m: f32,
    /// Stem diameter at breast height.
    pub dbh_m: f32,
    /// How crowded it stands: 0 alone, 1 among others.
    pub crowding_fraction: f32,
    /// A number of its own, for variety.
    pub variety: u32,
}

/// What an atlas is told of a snag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SnagMeasures {
    /// Index of its species in the biome.
    pub species: u16,
    /// Height that still stands.
    pub height_m: f32,
    /// Height at death.
    pub height_at_death_m: f32,
    /// Stem diameter at breast height, at death.
    pub dbh_m: f32,
    /// Decay class, 1–5.
    pub decay_class: u8,
    /// Share of its primary branches that it still has.
    pub branch_fraction: f32,
    /// A number of its own, for variety.
    pub variety: u32,
}

/// What an atlas is told of a downed log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DownedLogMeasures {
    /// Index of its species in the biome.
    pub species: u16,
    /// What part of the tree it is.
    pub kind: DownedLogKind,
    /// Length, along the slope that it lies on.
    pub length_m: f32,
    /// Diameter of the thick end.
    pub diameter_base_m: f32,
    /// Diameter of the thin end.
    pub diameter_tip_m: f32,
    /// Decay class, 1–5.
    pub decay_class: u8,
    /// A number of its own, for variety.
    pub variety: u32,
}

/// A model that was chosen for something, and how it is stretched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fitting {
    /// Number of the model, below [`Atlas::model_count`].
    pub model: u32,
    /// Factors of the model's x, y and z.
    pub scale: [f32; 3],
}

/// A collection of archetypes. Equal measures get equal answers.
pub trait Atlas: Sync {
    /// Number of models, whether anything uses them or not.
    fn model_count(&self) -> usize;

    /// The model of a number below [`Atlas::model_count`].
    fn archetype(&self, model: u32) -> Archetype;

    /// The model for a plant.
    fn plant(&self, plant: &PlantMeasures) -> Fitting;

    /// The model for a snag.
    fn snag(&self, snag: &SnagMeasures) -> Fitting;

    /// The model for a downed log.
    fn downed_log(&self, downed_log: &DownedLogMeasures) -> Fitting;
}
