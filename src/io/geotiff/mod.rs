//! GeoTIFF: elevations in, cloud-optimised rasters out.
//!
//! Reading order: [`source`] (bytes by position), [`directory`] (tags, checked against the file's length),
//! [`read`] (place, unit), `chunks` (strips and tiles), `codec` (packing); then [`write`](mod@write) (layout),
//! `head` (directories), `pyramid` (overviews), `tiles`.

mod chunks;
mod codec;
pub mod directory;
mod head;
mod pyramid;
pub mod read;
pub mod source;
mod tiles;
pub mod write;

pub use read::{parse, parse_band};
pub use source::{ByteSource, SharedFile};
pub use write::{Band, BandSource, CogBands, CogError, CogOptions, NODATA, StoredBands, write_cog};
