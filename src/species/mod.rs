//! Species, biomes and climates: the facts every later stage draws on.

pub mod climate;

pub use climate::{Climate, Soil};
