//! Abiotic maps: what the site offers before any plant competes for it.
//!
//! Reading order: [`solar`], [`temperature`].

pub mod solar;
pub mod temperature;
