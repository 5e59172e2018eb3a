//! Grids on the map: values, place, mask. Row 0 lies north, values stand at cell centres.
//!
//! Reading order: [`frame`] (where cells lie), [`mask`] (which are valid), [`grid`] (values), [`crs`] and
//! [`projection`] (where on Earth), [`source`] (as files hold them), [`resample`] and [`warp`] (onto another grid),
//! [`burn`] (shapes onto a grid).

pub mod burn;
pub mod crs;
pub mod frame;
pub mod grid;
pub mod mask;
pub mod projection;
pub(crate) mod registry;
pub mod resample;
pub mod source;
pub mod warp;
pub mod window;

pub use crs::{Crs, CrsError, utm_zone_for};
pub use frame::{Cell, Frame, GeoTransform, MapPoint};
pub use grid::{Grid, MONTHS, MonthlyGrid};
pub use mask::Mask;
pub use projection::{Projection, Projector};
pub use source::{Affine, CrsProblem, LengthUnit, SourceRaster};
pub use window::MapWindow;
