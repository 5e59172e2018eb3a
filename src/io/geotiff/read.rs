//! Elevations from a GeoTIFF: place, unit, first band.
//!
//! Everything the header claims is checked against the file's length before cells are allocated.
//!
//! # Reference
//! Adobe, TIFF Revision 6.0, 1992; OGC GeoTIFF Standard 1.1; GDAL's tags 42112 (metadata) and 42113 (nodata).

use super::chunks::Chunks;
use super::codec::{Compression, Predictor, SampleType, Scaling};
use super::directory::Directory;
use super::source::ByteSource;
use crate::io::window::{self, MapWindow};
use crate::io::{Limits, ParseError, geokeys};
use crate::raster::{Affine, LengthUnit, SourceRaster};

/// Tag numbers.
pub(super) mod tag {
    pub const IMAGE_WIDTH: u16 = 256;
    pub const IMAGE_LENGTH: u16 = 257;
    pub const BITS_PER_SAMPLE: u16 = 258;
    pub const COMPRESSION: u16 = 259;
    pub const PHOTOMETRIC: u16 = 262;
    pub const STRIP_OFFSETS: u16 = 273;
    pub const SAMPLES_PER_PIXEL: u16 = 277;
    pub const ROWS_PER_STRIP: u16 = 278;
    pub const STRIP_BYTE_COUNTS: u16 = 279;
    pub const PLANAR_CONFIGURATION: u16 = 284;
    pub const PREDICTOR: u16 = 317;
    pub const TILE_WIDTH: u16 = 322;
    pub const TILE_LENGTH: u16 = 323;
    pub const TILE_OFFSETS: u16 = 324;
    pub const TILE_BYTE_COUNTS: u16 = 325;
    pub const SAMPLE_FORMAT: u16 = 339;
    pub const MODEL_PIXEL_SCALE: u16 = 33550;
    pub const MODEL_TIEPOINT: u16 = 33922;
    pub const MODEL_TRANSFORMATION: u16 = 34264;
    pub const GEO_KEY_DIRECTORY: u16 = 34735;
    pub const GEO_DOUBLE_PARAMS: u16 = 34736;
    pub const GEO_ASCII_PARAMS: u16 = 34737;
    pub const GDAL_METADATA: u16 = 42112;
    pub const GDAL_NODATA: u16 = 42113;
}

/// The first band of a GeoTIFF's full-resolution image, or the part of it that `window` (in the file's CRS)
/// touches; only strips and tiles of that part are decoded.
///
/// # Errors
/// If the bytes are damaged, hold no elevations, are larger than the limits, or are stored in a way not
/// supported. Headers that claim more than the file can hold are refused before cells are allocated.
pub fn parse<S: ByteSource + ?Sized>(
    source: &S,
    window: Option<&MapWindow>,
    limits: &Limits,
) -> Result<SourceRaster, ParseError> {
    let directory = Directory::read(source)?;
    let chunks = chunks(&directory, source.len(), limits)?;
    let (rows, cols) = (chunks.rows, chunks.cols);

    // Place
    let keys: Vec<u16> = directory
        .integers(tag::GEO_KEY_DIRECTORY)?
        .into_iter()
        .map(|word| word as u16) // the tag holds 16-bit words
        .collect();
    let reference = geokeys::parse(
        &keys,
        &directory.doubles(tag::GEO_DOUBLE_PARAMS)?,
        &directory.text(tag::GEO_ASCII_PARAMS)?,
    )?;
    let affine = affine(&directory, reference.pixel_is_point)?;
    window::check_affine(&affine, rows, cols)?;
    let range = window::cells(window, &affine, rows, cols, limits)?;

    // Cells
    let metadata = directory.text(tag::GDAL_METADATA)?;
    let scaling = Scaling {
        nodata: nodata(&directory.text(tag::GDAL_NODATA)?)?,
        scale: first_band_number(&metadata, "scale").unwrap_or(1.0),
        offset: first_band_number(&metadata, "offset").unwrap_or(0.0),
    };
    let decoded = chunks.decode(source, &range, &scaling)?;
    window::require_valid(SourceRaster {
        rows: range.rows.len(),
        cols: range.cols.len(),
        affine: window::shifted(&affine, range.rows.start as f64, range.cols.start as f64),
        crs: reference.crs,
        vertical_unit: reference
            .vertical_unit
            .or_else(|| first_band_item(&metadata, "unittype").and_then(unit_by_name)),
        latitude_deg: None,
        values: decoded.values,
        valid: decoded.valid,
        non_finite_cells: decoded.non_finite_cells,
    })
}

fn unsupported(what: impl Into<String>) -> ParseError {
    ParseError::new(
        what,
        "rewrite it with: gdal_translate -b 1 -ot Float32 -co COMPRESS=DEFLATE IN OUT.tif",
    )
}

/// The image's layout, checked against the file's length.
fn chunks<S: ByteSource + ?Sized>(
    directory: &Directory<'_, S>,
    file_len: u64,
    limits: &Limits,
) -> Result<Chunks, ParseError> {
    let size = |tag| Ok::<_, ParseError>(directory.integer(tag)?.unwrap_or(0));
    let (cols, rows) = (size(tag::IMAGE_WIDTH)?, size(tag::IMAGE_LENGTH)?);
    if cols == 0 || rows == 0 || cols > u64::from(u32::MAX) || rows > u64::from(u32::MAX) {
        return Err(super::directory::damaged(format!("the image has no cells ({cols} × {rows})")));
    }
    match directory.integer(tag::PHOTOMETRIC)? {
        Some(1) => {}
        Some(4) => return Err(unsupported("the first image is a mask, not elevations")),
        Some(_) => {
            return Err(ParseError::new(
                "the file is a picture (colours or a palette), not elevations",
                "give the elevation raster itself, not its rendering",
            ));
        }
        None => return Err(unsupported("the file does not say what its samples mean (tag 262)")),
    }

    // Samples: one type for all bands
    let bands = directory.integer(tag::SAMPLES_PER_PIXEL)?.unwrap_or(1);
    if bands == 0 || bands > 4096 {
        return Err(unsupported(format!("the file has {bands} bands")));
    }
    let bits = directory.integers(tag::BITS_PER_SAMPLE)?;
    let formats = directory.integers(tag::SAMPLE_FORMAT)?;
    let one_kind = bits.iter().all(|b| *b == bits[0]) && formats.iter().all(|f| *f == formats[0]);
    let kind = (formats.first().copied().unwrap_or(1), bits.first().copied().unwrap_or(1));
    let sample = one_kind.then(|| SampleType::new(kind.0, kind.1)).flatten().ok_or_else(|| {
        unsupported(format!("samples of {} bits and format {} are not supported", kind.1, kind.0))
    })?;
    let compression = directory.integer(tag::COMPRESSION)?.unwrap_or(1);
    let compression = Compression::new(compression).ok_or_else(|| {
        unsupported(format!("the compression method {compression} is not supported"))
    })?;
    let predictor = directory.integer(tag::PREDICTOR)?.unwrap_or(1);
    let predictor = Predictor::new(predictor, sample).ok_or_else(|| {
        unsupported(format!("the predictor {predictor} does not go with the samples"))
    })?;
    let planar = directory.integer(tag::PLANAR_CONFIGURATION)?.unwrap_or(1) == 2;

    // Chunks: tiles or strips
    let tiled = directory.count(tag::TILE_OFFSETS) > 0;
    let (chunk_cols, chunk_rows, offsets, byte_counts) = if tiled {
        let (width, length) = (size(tag::TILE_WIDTH)?, size(tag::TILE_LENGTH)?);
        (width, length, tag::TILE_OFFSETS, tag::TILE_BYTE_COUNTS)
    } else {
        let rows_per_strip = directory.integer(tag::ROWS_PER_STRIP)?.unwrap_or(rows).min(rows);
        (cols, rows_per_strip, tag::STRIP_OFFSETS, tag::STRIP_BYTE_COUNTS)
    };
    if chunk_cols == 0 || chunk_rows == 0 {
        return Err(super::directory::damaged("the image's tiles or strips have no cells"));
    }
    let stored_bands = if planar { 1 } else { bands };
    let chunk_cells = chunk_cols.checked_mul(chunk_rows).and_then(|n| n.checked_mul(stored_bands));
    let chunk_cells = chunk_cells.and_then(|n| usize::try_from(n).ok());
    if chunk_cells.is_none_or(|n| n > limits.max_cells.max(1 << 20)) {
        return Err(ParseError::new(
            format!(
                "a single tile or strip of {chunk_cols} × {chunk_rows} × {stored_bands} values is too large"
            ),
            "rewrite it in tiles with: gdal_translate -b 1 -co TILED=YES IN OUT.tif",
        ));
    }
    let layout = Chunks {
        rows: rows as usize, // both below 2³², checked above
        cols: cols as usize,
        chunk_rows: chunk_rows as usize, // below the limit, checked above
        chunk_cols: chunk_cols as usize,
        stored_bands: stored_bands as usize, // at most 4096
        sample,
        compression,
        predictor,
        little_endian: directory.is_little_endian(),
        tiled,
        offsets: directory.integers(offsets)?,
        byte_counts: directory.integers(byte_counts)?,
    };
    layout.check(if planar { bands } else { 1 }, file_len)?;
    Ok(layout)
}

/// The map position from the model tags.
fn affine<S: ByteSource + ?Sized>(
    directory: &Directory<'_, S>,
    pixel_is_point: bool,
) -> Result<Affine, ParseError> {
    let matrix = directory.doubles(tag::MODEL_TRANSFORMATION)?;
    let tie = directory.doubles(tag::MODEL_TIEPOINT)?;
    let scale = directory.doubles(tag::MODEL_PIXEL_SCALE)?;
    let corner = match (&matrix[..], &tie[..], &scale[..]) {
        (&[col_dx, row_dx, _, origin_x, col_dy, row_dy, _, origin_y, ..], ..) => {
            Affine { origin_x, origin_y, col_dx, col_dy, row_dx, row_dy }
        }
        (_, &[col, row, _, x, y, _, ..], &[width, height, ..]) => {
            if !(width > 0.0 && height > 0.0) {
                return Err(ParseError::new(
                    format!("the cell size {width} × {height} is not positive"),
                    "set it anew, e.g. with gdal_translate -a_ullr WEST NORTH EAST SOUTH",
                ));
            }
            Affine {
                origin_x: x - col * width,
                origin_y: y + row * height,
                col_dx: width,
                col_dy: 0.0,
                row_dx: 0.0,
                row_dy: -height,
            }
        }
        (_, [_, _, _, _, _, _, _, ..], []) => {
            return Err(ParseError::new(
                "the raster is tied to the map by control points only",
                "rectify it first with gdalwarp",
            ));
        }
        _ => {
            return Err(ParseError::new(
                "the raster has no map position",
                "add one, e.g. with gdal_translate -a_srs EPSG:n -a_ullr WEST NORTH EAST SOUTH",
            ));
        }
    };
    Ok(if pixel_is_point { window::shifted(&corner, -0.5, -0.5) } else { corner })
}

/// The value that GDAL's tag declares to be nodata.
fn nodata(text: &str) -> Result<Option<f64>, ParseError> {
    let text = text.trim();
    if text.is_empty() {
        return Ok(None);
    }
    text.parse().map(Some).map_err(|_| {
        ParseError::new(
            format!("the nodata value {text:?} is no number"),
            "set it anew with: gdal_edit.py -a_nodata -9999 FILE",
        )
    })
}

/// The text of the first band's item with `role` in GDAL's metadata.
fn first_band_item<'t>(metadata: &'t str, role: &str) -> Option<&'t str> {
    metadata.split("<Item ").skip(1).find_map(|item| {
        let (attributes, rest) = item.split_once('>')?;
        let is_wanted =
            attributes.contains(&format!("role=\"{role}\"")) && attributes.contains("sample=\"0\"");
        is_wanted.then(|| rest.split('<').next().unwrap_or("").trim())
    })
}

fn first_band_number(metadata: &str, role: &str) -> Option<f64> {
    first_band_item(metadata, role)?.parse().ok().filter(|number: &f64| number.is_finite())
}

/// The unit of heights by the names that GDAL and its users write.
pub(in crate::io) fn unit_by_name(name: &str) -> Option<LengthUnit> {
    match name.trim().to_ascii_lowercase().as_str() {
        "m" | "metre" | "metres" | "meter" | "meters" => Some(LengthUnit::Metre),
        "ft" | "foot" | "feet" | "international foot" => Some(LengthUnit::Foot),
        "us-ft" | "ftus" | "us survey foot" | "us survey feet" | "foot_us" | "survey foot" => {
            Some(LengthUnit::UsSurveyFoot)
        }
        _ => None,
    }
}
