//! Abiotic maps: what the site offers before any plant competes for it.
//!
//! Reading order: [`solar`], [`temperature`], [`moisture`] with its `water_balance` (one cell's year),
//! `drainage` (which way water runs), `routing` (from cell to cell) and `riparian` (land along rivers).

mod drainage;
pub mod moisture;
mod riparian;
mod routing;
pub mod solar;
pub mod temperature;
mod water_balance;
