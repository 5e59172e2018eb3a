//! Geometry of plants and deadwood: few models a species, instanced with every plant's own size.
//!
//! Reading order: [`mesh`] (triangles), [`archetype`] (a model and what it stands for), [`atlas`] (a collection of archetypes, and the
//! choice among them for each plant), [`low_poly`] (the built-in atlas). What its models are made of: [`stem`], [`outline`],
//! [`habit`], [`color`]; how: [`sculptor`]; the models: [`crowns`], [`herbs`], [`snags`], [`downed_logs`].

pub mod archetype;
pub mod atlas;
pub mod color;
pub mod crowns;
pub mod downed_logs;
pub mod habit;
pub mod herbs;
pub mod low_poly;
pub mod mesh;
pub mod outline;
pub mod sculptor;
pub mod snags;
pub mod stem;
