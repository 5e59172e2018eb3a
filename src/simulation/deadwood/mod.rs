//! Deadwood: what becomes of trees that die.
//!
//! Reading order: `decay` (how long wood lasts), `branches`, `snag`, `falling` (where stems fall), `downed_log`, `stock` (all of a
//! forest, and its year).
//!
//! # Reference
//! Peytavie et al. 2024, section 5.2, doi:10.1145/3641816.

pub mod branches;
pub mod decay;
pub mod downed_log;
pub mod falling;
pub mod snag;
pub mod stock;

pub use decay::DecayParameters;
pub use downed_log::DownedLog;
pub use snag::Snag;
pub use stock::Stock;
