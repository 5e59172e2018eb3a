//! Geometry of plants and deadwood: few models a species, instanced with every plant's own size.
//!
//! Reading order: [`mesh`] (triangles), [`archetype`] (a model and what it stands for). Botanical models come behind the same
//! interface: an atlas of archetypes, and a choice among them for each plant.

pub mod archetype;
pub mod mesh;
