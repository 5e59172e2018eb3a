//! Wildwood grows whole forests, living and dead, on real terrain.
#![warn(missing_docs)]
#![forbid(unsafe_code)]

pub mod abiotics;
pub mod export;
pub mod io;
pub mod math;
pub mod progress;
pub mod raster;
pub mod rng;
pub mod species;
pub mod terrain;
