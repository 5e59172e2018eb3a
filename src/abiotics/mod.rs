//! Abiotic maps: what the site offers before any plant competes for it.
//!
//! Reading order: [`solar`], [`horizon`], [`exposure`], [`sunlight`], [`slope`], [`temperature`].

pub mod exposure;
pub mod horizon;
mod sky_view;
pub mod slope;
pub mod solar;
mod sun_path;
pub mod sunlight;
pub mod temperature;
