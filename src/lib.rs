//! Wildwood grows whole forests, living and dead, on real terrain.
//!
//! Each stage is a function of its arguments; [`pipeline`] runs them in order, [`cli`] is the command.
#![warn(missing_docs)]
#![forbid(unsafe_code)]

pub mod abiotics;
pub mod canopy;
pub mod cli;
pub mod export;
pub mod forest_floor;
pub mod gpu;
pub mod inference;
pub mod io;
pub mod math;
pub mod pipeline;
pub mod plants;
pub mod progress;
pub mod raster;
pub mod rng;
pub mod scene;
pub mod simulation;
pub mod species;
pub mod terrain;
pub mod tree;
pub mod undergrowth;
