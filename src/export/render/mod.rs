//! Pictures of a forest: its instances and its terrain in sun, shade and haze, drawn on the CPU.
//!
//! Reading order: [`world`] (what is drawn), [`camera`], [`view`] (where one looks from), [`picture`] (how a picture comes about): its
//! [`draw_list`], [`coverage`] and [`surface_buffer`], [`foliage`], [`ground`] with [`ground_mesh`], [`ground_color`] and [`strew`]; light: [`sky`],
//! [`shadow`], [`sky_light`], [`shading`], [`tone`]; [`noise`] and [`vector`] beneath all.

pub mod camera;
pub mod coverage;
pub mod draw_list;
pub mod figures;
pub mod foliage;
pub mod ground;
pub mod ground_color;
pub mod ground_mesh;
pub mod lighting;
pub mod noise;
pub mod picture;
pub mod shading;
pub mod shadow;
pub mod sky;
pub mod sky_light;
pub mod strew;
pub mod surface_buffer;
pub mod tone;
pub mod vector;
pub mod view;
pub mod world;
