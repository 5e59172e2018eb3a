//! Disturbances: what happens to a forest from outside, and when.
//!
//! Reading order: `fire`, `storm`, `disease` (and `contagion`, who is near whom), then `schedule` and the two kinds of script that it
//! is read from.
//!
//! # Reference
//! Peytavie et al. 2024, section 5.3, doi:10.1145/3641816.

mod contagion;
pub mod disease;
pub mod fire;
pub mod schedule;
mod schedule_drawn;
mod schedule_keys;
mod schedule_kind;
mod schedule_recurring;
mod schedule_text;
mod schedule_toml;
pub mod storm;

pub use disease::Disease;
pub use fire::Wildfire;
pub use schedule::{Disturbance, Drought, Event, Schedule};
pub use storm::WindStorm;
