//! Pictures of a forest: its instances and its terrain in sun, shade and haze, drawn by the CPU or a graphics card.
//!
//! Reading order: [`world`] (what is drawn), [`camera`], [`view`] (where one looks from), [`picture`] (how a picture comes about): its
//! [`draw_list`], [`coverage`] and [`surface_buffer`], [`foliage`], [`ground`] with [`ground_mesh`], [`ground_color`] and [`strew`]; light: [`sky`],
//! [`shadow`], [`sky_light`], [`shading`], [`tone`]; [`noise`] and [`vector`] beneath all. [`painter`] is who draws: the CPU by these, or a
//! graphics card by their twins `picture_gpu`, `draw_list_gpu`, `models_gpu` and `camera_gpu` and by the WGSL texts in `shaders/render`.

pub mod camera;
#[cfg(feature = "gpu")]
pub mod camera_gpu;
pub mod coverage;
pub mod draw_list;
#[cfg(feature = "gpu")]
pub mod draw_list_gpu;
pub mod figures;
pub mod foliage;
pub mod ground;
pub mod ground_color;
pub mod ground_mesh;
pub mod lighting;
#[cfg(feature = "gpu")]
pub mod models_gpu;
pub mod noise;
pub mod painter;
pub mod picture;
#[cfg(feature = "gpu")]
pub mod picture_gpu;
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
