//! Learned canopies: heights as networks give them, brought onto a scene.
//!
//! Reading order: [`detail`] (from a network's cells to the terrain's), with `detail_trees` (which trees make up the
//! coarse heights) and `detail_surface` (their crowns as a height model shows them).

pub mod detail;
mod detail_surface;
mod detail_trees;
