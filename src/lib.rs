//! Wildwood grows whole forests, living and dead, on real terrain.
//!
//! Each stage is a function of its arguments; [`pipeline`] runs them in order, [`cli`] is the command.
//!
//! From bare ground to trees, on a hillside of 64 m that is made up; `examples/quickstart.rs` goes on from there:
//!
//! ```
//! use wildwood::canopy::{self, shares::Shares, site::Site};
//! use wildwood::pipeline::grow::{self, CanopyInput, CanopyRequest};
//! use wildwood::terrain::generate::{self, GenerateParams};
//! use wildwood::{abiotics, progress::Reporter, species::Biome};
//!
//! let reporter = Reporter::silent();
//! let biome = Biome::builtin("sonoma")?;
//! let landscape = GenerateParams { rows: 32, cols: 32, relief_m: 12.0, ..Default::default() };
//! let terrain = generate::generate(&landscape, &reporter)?;
//! // light, soil water, warmth and slope, and their means over the year
//! let maps = abiotics::run(&terrain, &biome.climate, &Default::default(), &reporter)?;
//! let site = Site::of(&maps);
//! // how high the canopy is, and the trees that make it up: half of it redwoods
//! let chm_m = canopy::generate::generate(&terrain, &site, &Default::default(), &reporter)?;
//! let input = CanopyInput::made_up(&terrain, &site, &chm_m, &biome);
//! let shares = Shares::parse("redwood=0.5", &biome)?;
//! let grown = grow::grow(&input, shares, 1, &CanopyRequest::default(), &reporter)?;
//!
//! let tallest_m = grown.plants.height_m.iter().copied().fold(0.0, f32::max);
//! assert!(grown.plants.len() > 20 && tallest_m > 10.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
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
