//! Species, biomes and climates: the facts every later stage draws on.
//!
//! Reading order: `species` (what is known of one), `niche` (how well a place suits it), `allometry` (size from
//! height and age), `climate`, `biome` (all of them together), `format` (the TOML file and what it must satisfy), `checks`.

pub mod allometry;
pub mod biome;
mod checks;
pub mod climate;
mod format;
pub mod niche;
#[allow(clippy::module_inception, reason = "the folder holds biomes, the file one species")]
pub mod species;

pub use allometry::{GrownEnvelope, PowerLaw};
pub use biome::{Biome, BiomeError, ForestFloor, SubBiome};
pub use climate::{Climate, Soil};
pub use niche::{Niche, Tolerance, Trapezoid};
pub use species::{
    Crown, CrownShape, Decay, DecayResistance, Form, GrowingSeason, Leaf, LeafHabit, Species, Stem,
    Wood,
};
