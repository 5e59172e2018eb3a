//! GeoTIFF: elevations in, cloud-optimised rasters out.
//!
//! Reading order: [`source`] (bytes by position), [`directory`] (tags, checked against the file's length),
//! [`read`] (place, cells), [`write`](mod@write) (cloud-optimised layout), [`encode`] (tiles, overviews).

mod chunks;
mod codec;
pub mod directory;
pub mod read;
pub mod source;

pub use read::parse;
pub use source::{ByteSource, SharedFile};
