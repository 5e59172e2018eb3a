//! Cloud-optimised GeoTIFF out: any number of `f32` bands on one frame, with overviews.
//!
//! Layout: header, a line that tells readers the layout, all directories, overviews from the smallest, the full
//! image. Bands lie apart, each cut into tiles. Two passes: overviews are packed in memory (up to a third of the
//! file), then the full image streams out, a few tiles at a time. Tiles are packed in parallel and written in
//! order, so the bytes depend on no thread count.
//!
//! # Reference
//! OGC Cloud Optimized GeoTIFF Standard 1.0 (OGC 21-026); GDAL's COG driver documentation for the layout line;
//! Adobe Photoshop TIFF Technical Note 3 (predictor 3).

use std::io::{Seek, SeekFrom, Write};

use rayon::prelude::*;

use super::head::{Head, Image};
use super::pyramid;
use super::tiles::{self, Packing, TILE_CELLS, TileGrid};
use crate::raster::{Crs, Frame, Mask};

/// What masked cells hold in the file.
pub const NODATA: f32 = -9999.0;

/// Tiles packed before they are written; bounds memory, changes no byte.
const TILES_IN_FLIGHT: usize = 64;

/// Bands whose overviews are made at a time; bounds memory, changes no byte.
const BANDS_IN_FLIGHT: usize = 4;

/// Bytes up to which offsets of 32 bits are safe, with room for directories.
const CLASSIC_MAX_BYTES: u64 = u32::MAX as u64 - (64 << 20);

/// Name and unit of a band, as GIS programs show them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Band {
    /// What the band shows, e.g. `January`.
    pub name: String,
    /// Unit of its values, e.g. `h/day`; empty for none.
    pub unit: String,
}

/// Values of bands, asked for piece by piece, so that derived ones need not be stored.
pub trait BandSource: Sync {
    /// Fills `values` with band `band` from cell (`row`, `first_col`) eastward.
    ///
    /// Called from many threads, more than once for a cell. Masked cells may get anything, others finite values.
    fn read(&self, band: usize, row: usize, first_col: usize, values: &mut [f32]);
}

/// Bands stored whole.
#[derive(Clone, Debug)]
pub struct StoredBands<'a> {
    cols: usize,
    bands: Vec<&'a [f32]>,
}

impl<'a> StoredBands<'a> {
    /// Bands of `frame`, row-major from the north-west.
    ///
    /// # Panics
    /// If a band does not fill the frame.
    pub fn new(frame: &Frame, bands: Vec<&'a [f32]>) -> Self {
        for band in &bands {
            assert_eq!(band.len(), frame.len(), "a band does not fill the frame");
        }
        Self { cols: frame.cols, bands }
    }
}

impl BandSource for StoredBands<'_> {
    fn read(&self, band: usize, row: usize, first_col: usize, values: &mut [f32]) {
        let start = row * self.cols + first_col;
        values.copy_from_slice(&self.bands[band][start..start + values.len()]);
    }
}

/// What a file is to hold.
#[derive(Clone, Copy)]
pub struct CogBands<'a> {
    /// Size and place.
    pub frame: &'a Frame,
    /// Cells that hold a value; the others are written as [`NODATA`].
    pub mask: &'a Mask,
    /// Names and units, one a band.
    pub bands: &'a [Band],
    /// The values.
    pub source: &'a dyn BandSource,
}

/// How a file is packed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CogOptions {
    /// Effort of the packing, 1–9.
    pub deflate_level: u32,
    /// Whether to use offsets of 64 bits even where 32 do; files of over 4 GiB do so anyway.
    pub always_big: bool,
}

impl Default for CogOptions {
    fn default() -> Self {
        // chosen: twelve months of 1000² cells took 0.41 s and 26 MB at level 1, 0.68 s and 20 MB at 2,
        // 1.5 s and 19 MB at 6
        Self { deflate_level: 1, always_big: false }
    }
}

/// Why a GeoTIFF could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CogError {
    /// The writer failed.
    #[error(transparent)]
    Write(#[from] std::io::Error),
    /// The CRS has no code that fits.
    #[error("{crs:?} cannot be written to GeoTIFF; use a CRS with an EPSG code below 32767")]
    Crs {
        /// The CRS.
        crs: Crs,
    },
    /// The format cannot hold the raster.
    #[error(
        "{rows} × {cols} cells in {bands} bands do not fit GeoTIFF; write fewer bands or a part"
    )]
    Size {
        /// Rows asked for.
        rows: usize,
        /// Columns asked for.
        cols: usize,
        /// Bands asked for.
        bands: usize,
    },
}

/// Writes a cloud-optimised GeoTIFF; `writer` should be buffered.
///
/// # Errors
/// If the writer fails, the CRS is neither local nor an EPSG code, or the raster is empty or too large to be one.
///
/// # Panics
/// If the mask does not fill the frame, or a valid cell is not finite.
pub fn write_cog<W: Write + Seek>(
    mut writer: W,
    raster: &CogBands<'_>,
    options: &CogOptions,
) -> Result<(), CogError> {
    let CogBands { frame, mask, bands, source } = *raster;
    assert_eq!(mask.as_slice().len(), frame.len(), "the mask does not fill the frame");
    match &frame.crs {
        Crs::Local => {}
        Crs::Epsg(code) if (1024..32767).contains(code) => {}
        crs => return Err(CogError::Crs { crs: crs.clone() }),
    }
    let too_large = frame.rows.max(frame.cols) > i32::MAX as usize || bands.len() > 4096;
    if frame.is_empty() || bands.is_empty() || too_large {
        let (rows, cols) = (frame.rows, frame.cols);
        return Err(CogError::Size { rows, cols, bands: bands.len() });
    }
    let packing = Packing { deflate_level: options.deflate_level.clamp(1, 9) };

    // Sizes of images
    let grid = |(rows, cols): (usize, usize)| TileGrid::new(rows, cols);
    let overviews = pyramid::sizes(frame.rows, frame.cols, TILE_CELLS).into_iter().map(grid);
    let grids: Vec<TileGrid> =
        [grid((frame.rows, frame.cols))].into_iter().chain(overviews).collect();
    // at worst tiles do not shrink at all, edge tiles are full, and headers add 0.1 %
    let most_bytes: u64 = grids
        .iter()
        .map(|g| (g.len() * bands.len()) as u64 * (g.tile_rows * g.tile_cols) as u64 * 4)
        .sum();
    let mut head = Head {
        frame,
        bands,
        big: options.always_big || most_bytes + most_bytes / 1000 > CLASSIC_MAX_BYTES,
        images: grids.iter().map(|g| Image::unwritten(g.clone(), bands.len())).collect(),
    };

    // First pass: overviews, by level, then band, then tile
    let packed = pack_overviews(raster, &grids, packing);

    // Second pass: everything in its place; the head once to make room, again when places are known
    let place = head.bytes();
    let mut position = place.len() as u64;
    writer.write_all(&place)?;
    for (level, tiles) in packed.iter().enumerate().rev() {
        let image = &mut head.images[level + 1];
        for (index, tile) in tiles.iter().enumerate() {
            put(&mut writer, &mut position, image, index, tile)?;
        }
    }
    drop(packed);
    let (full, valid) = (&grids[0], mask.as_slice());
    let all: Vec<usize> = (0..full.len() * bands.len()).collect();
    for batch in all.chunks(TILES_IN_FLIGHT) {
        let packed: Vec<Vec<u8>> = batch
            .par_iter()
            .map(|index| {
                let (band, tile) = (index / full.len(), index % full.len());
                let read = |row, col, values: &mut [f32]| source.read(band, row, col, values);
                tiles::pack(full, tile, packing, read, valid)
            })
            .collect();
        for (index, tile) in batch.iter().zip(&packed) {
            put(&mut writer, &mut position, &mut head.images[0], *index, tile)?;
        }
    }
    writer.seek(SeekFrom::Start(0))?;
    writer.write_all(&head.bytes())?;
    writer.flush()?;
    Ok(())
}

/// Writes a tile and notes its place.
fn put(
    writer: &mut impl Write,
    position: &mut u64,
    image: &mut Image,
    index: usize,
    tile: &[u8],
) -> std::io::Result<()> {
    writer.write_all(tile)?;
    image.offsets[index] = *position;
    image.byte_counts[index] = tile.len() as u64;
    *position += tile.len() as u64;
    Ok(())
}

/// Packed tiles of all overviews: by level from the largest, then by band and tile.
fn pack_overviews(
    raster: &CogBands<'_>,
    grids: &[TileGrid],
    packing: Packing,
) -> Vec<Vec<Vec<u8>>> {
    let levels = grids.len() - 1;
    let mut packed = vec![Vec::new(); levels];
    // Masks are the same for all bands: index 0 is the full image's
    let mut masks: Vec<Vec<bool>> = Vec::with_capacity(levels);
    for grid in &grids[..levels] {
        let valid = masks.last().map_or(raster.mask.as_slice(), Vec::as_slice);
        masks.push(pyramid::halve_mask(valid, grid.cols));
    }
    let bands: Vec<usize> = (0..raster.bands.len()).collect();
    for some in bands.chunks(BANDS_IN_FLIGHT) {
        let of_bands: Vec<Vec<Vec<Vec<u8>>>> = some
            .par_iter()
            .map(|&band| {
                let mut of_levels = Vec::with_capacity(levels);
                let mut image: Vec<f32> = Vec::new();
                for level in 0..levels {
                    let cols = grids[level].cols;
                    image = if level == 0 {
                        let read = |row, line: &mut [f32]| raster.source.read(band, row, 0, line);
                        pyramid::halve(raster.mask.as_slice(), cols, read)
                    } else {
                        let above = image;
                        pyramid::halve(&masks[level - 1], cols, |row, line: &mut [f32]| {
                            line.copy_from_slice(&above[row * cols..(row + 1) * cols]);
                        })
                    };
                    let grid = &grids[level + 1];
                    let read = |row: usize, col: usize, values: &mut [f32]| {
                        let start = row * grid.cols + col;
                        values.copy_from_slice(&image[start..start + values.len()]);
                    };
                    let tiles: Vec<Vec<u8>> = (0..grid.len())
                        .into_par_iter()
                        .map(|tile| tiles::pack(grid, tile, packing, read, &masks[level]))
                        .collect();
                    of_levels.push(tiles);
                }
                of_levels
            })
            .collect();
        for of_levels in of_bands {
            for (level, tiles) in of_levels.into_iter().enumerate() {
                packed[level].extend(tiles);
            }
        }
    }
    packed
}
