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
use crate::io::geokeys::{self, GeoReference};
use crate::io::raster_file::RasterHead;
use crate::io::{Limits, ParseError, ParseErrorKind, window};
use crate::raster::{Affine, Crs, CrsProblem, LengthUnit, MapWindow, SourceRaster};

/// Tag numbers.
pub(super) mod tag {
    pub const NEW_SUBFILE_TYPE: u16 = 254;
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

/// Size and place that the header tells; no cell is read.
///
/// # Errors
/// If the header is damaged, or tells no place.
pub fn head<S: ByteSource + ?Sized>(source: &S) -> Result<RasterHead, ParseError> {
    let directory = Directory::read(source)?;
    let (reference, problem) = reference(&directory)?;
    let (rows, cols) = size(&directory)?;
    Ok(RasterHead {
        rows,
        cols,
        affine: affine(&directory, reference.pixel_is_point)?,
        crs: match problem {
            None => Some(reference.crs.unwrap_or(Crs::Local)),
            Some(_) => None,
        },
    })
}

/// Rows and columns.
fn size<S: ByteSource + ?Sized>(
    directory: &Directory<'_, S>,
) -> Result<(usize, usize), ParseError> {
    let size = |tag| Ok::<_, ParseError>(directory.integer(tag)?.unwrap_or(0));
    let (cols, rows) = (size(tag::IMAGE_WIDTH)?, size(tag::IMAGE_LENGTH)?);
    if cols == 0 || rows == 0 || cols > u64::from(u32::MAX) || rows > u64::from(u32::MAX) {
        return Err(super::directory::damaged(format!("the image has no cells ({cols} × {rows})")));
    }
    Ok((rows as usize, cols as usize)) // below 2³², just checked
}

fn reference<S: ByteSource + ?Sized>(
    directory: &Directory<'_, S>,
) -> Result<(GeoReference, Option<ParseError>), ParseError> {
    let keys: Vec<u16> = directory
        .integers(tag::GEO_KEY_DIRECTORY)?
        .into_iter()
        .map(|word| word as u16) // the tag holds 16-bit words
        .collect();
    Ok(geokeys::parse_understood(
        &keys,
        &directory.doubles(tag::GEO_DOUBLE_PARAMS)?,
        &directory.text(tag::GEO_ASCII_PARAMS)?,
    ))
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
    parse_band(source, 0, window, limits)
}

/// Like [`parse`], of another band, 0 being the first; only where bands are stored apart, as this module writes them.
///
/// # Errors
/// Like [`parse`], and if there is no such band.
pub fn parse_band<S: ByteSource + ?Sized>(
    source: &S,
    band: usize,
    window: Option<&MapWindow>,
    limits: &Limits,
) -> Result<SourceRaster, ParseError> {
    let directory = Directory::read(source)?;
    let chunks = chunks(&directory, source.len(), limits)?.of_band(band, source.len())?;
    if directory.following().iter().any(is_mask_of_full_image) {
        return Err(ParseError::new(
            "the file keeps its nodata as a mask of its own, which is not read",
            "turn the mask into a nodata value with: gdalwarp -dstnodata -9999 -ot Float32 IN OUT.tif",
        )
        .of_kind(ParseErrorKind::Unsupported));
    }
    let (rows, cols) = (chunks.rows, chunks.cols);

    // Place
    let (reference, crs_problem) = reference(&directory)?;
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
        crs_problem: crs_problem.map(|p| CrsProblem { text: p.to_string(), is_fatal: true }),
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
    .of_kind(ParseErrorKind::Unsupported)
}

/// Whether a directory holds the mask of the full image; those of overviews have bit 0 as well.
fn is_mask_of_full_image<S: ByteSource + ?Sized>(directory: &Directory<'_, S>) -> bool {
    let is = |tag, value| directory.integer(tag).is_ok_and(|found| found == Some(value));
    is(tag::NEW_SUBFILE_TYPE, 4) && is(tag::PHOTOMETRIC, 4)
}

/// The image's layout, checked against the file's length.
fn chunks<S: ByteSource + ?Sized>(
    directory: &Directory<'_, S>,
    file_len: u64,
    limits: &Limits,
) -> Result<Chunks, ParseError> {
    let (rows, cols) = size(directory)?;
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
        let size = |tag| Ok::<_, ParseError>(directory.integer(tag)?.unwrap_or(0));
        let (width, length) = (size(tag::TILE_WIDTH)?, size(tag::TILE_LENGTH)?);
        (width, length, tag::TILE_OFFSETS, tag::TILE_BYTE_COUNTS)
    } else {
        let rows_per_strip = directory.integer(tag::ROWS_PER_STRIP)?.unwrap_or(u64::MAX);
        (cols as u64, rows_per_strip.min(rows as u64), tag::STRIP_OFFSETS, tag::STRIP_BYTE_COUNTS)
    };
    if chunk_cols == 0 || chunk_rows == 0 {
        return Err(super::directory::damaged("the image's tiles or strips have no cells"));
    }
    let stored_bands = if planar { 1 } else { bands };
    let chunk_cells = chunk_cols.checked_mul(chunk_rows).and_then(|n| n.checked_mul(stored_bands));
    let chunk_cells = chunk_cells.and_then(|n| usize::try_from(n).ok());
    // tiles reach beyond a small image, but not without bounds: they are unpacked whole
    let image_cells = (rows as u64).saturating_mul(cols as u64);
    let most_values = image_cells.saturating_mul(4 * stored_bands).saturating_add(1 << 20);
    let most_values = usize::try_from(most_values).unwrap_or(usize::MAX);
    if chunk_cells.is_none_or(|n| n > limits.max_cells.max(1 << 20).min(most_values)) {
        return Err(ParseError::new(
            format!(
                "a single tile or strip of {chunk_cols} × {chunk_rows} × {stored_bands} values is too large"
            ),
            "rewrite it in tiles with: gdal_translate -b 1 -co TILED=YES IN OUT.tif",
        ));
    }
    let layout = Chunks {
        rows,
        cols,
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

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use proptest::prelude::*;

    use super::*;
    use crate::io::geotiff::{Band, CogBands, CogOptions, StoredBands, write_cog};
    use crate::raster::{Crs, Frame, Mask};

    /// A little-endian file of one uncompressed strip of f32; `extra` tags are doubles, `shorts` replace or add.
    struct Made {
        shorts: Vec<(u16, u32)>,
        doubles: Vec<(u16, Vec<f64>)>,
        text: Vec<(u16, &'static str)>,
        cells: Vec<f32>,
    }

    impl Made {
        fn new(cols: u32, rows: u32, cells: &[f32]) -> Self {
            let len = cells.len() as u32 * 4;
            let shorts = vec![
                (256, cols),
                (257, rows),
                (258, 32),
                (259, 1),
                (262, 1),
                (273, 8),
                (278, rows),
                (279, len),
                (339, 3),
            ];
            let doubles =
                vec![(33550, vec![2.0, 2.0, 0.0]), (33922, vec![0.0, 0.0, 0.0, 100.0, 50.0, 0.0])];
            Self { shorts, doubles, text: Vec::new(), cells: cells.to_vec() }
        }

        fn with(mut self, tag: u16, value: u32) -> Self {
            self.shorts.retain(|s| s.0 != tag);
            self.shorts.push((tag, value));
            self
        }

        fn with_doubles(mut self, tag: u16, values: &[f64]) -> Self {
            self.doubles.retain(|d| d.0 != tag);
            self.doubles.push((tag, values.to_vec()));
            self
        }

        fn with_text(mut self, tag: u16, text: &'static str) -> Self {
            self.text.push((tag, text));
            self
        }

        fn bytes(&self) -> Vec<u8> {
            let mut bytes = b"II\x2a\0\0\0\0\0".to_vec();
            bytes.extend(self.cells.iter().flat_map(|c| c.to_le_bytes()));
            let mut entries: Vec<(u16, u16, u32, u32)> =
                self.shorts.iter().map(|s| (s.0, 4, 1, s.1)).collect();
            for (tag, values) in &self.doubles {
                entries.push((*tag, 12, values.len() as u32, bytes.len() as u32));
                bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
            }
            for (tag, text) in &self.text {
                entries.push((*tag, 2, text.len() as u32, bytes.len() as u32));
                bytes.extend(text.bytes());
            }
            entries.sort_unstable();
            let start = bytes.len() as u32;
            bytes[4..8].copy_from_slice(&start.to_le_bytes());
            bytes.extend((entries.len() as u16).to_le_bytes());
            for (tag, kind, count, value) in entries {
                bytes.extend(tag.to_le_bytes());
                bytes.extend(kind.to_le_bytes());
                bytes.extend(count.to_le_bytes());
                bytes.extend(value.to_le_bytes());
            }
            bytes.extend([0; 4]);
            bytes
        }

        fn read(&self) -> Result<SourceRaster, ParseError> {
            parse(&self.bytes()[..], None, &Limits::default())
        }
    }

    /// A file of our own writer; two bands, so that a wrong band is seen.
    fn written(rows: usize, cols: usize, values: &[f32], valid: &[bool]) -> Vec<u8> {
        written_with(&CogOptions::default(), rows, cols, values, valid)
    }

    fn written_with(
        options: &CogOptions,
        rows: usize,
        cols: usize,
        values: &[f32],
        valid: &[bool],
    ) -> Vec<u8> {
        let frame = Frame { crs: Crs::Epsg(3794), ..Frame::local(rows, cols, 2.0) };
        let other = vec![-1.0; values.len()];
        let source = StoredBands::new(&frame, vec![values, &other]);
        let bands = vec![Band { name: "January".into(), unit: "m".into() }; 2];
        let raster = CogBands {
            frame: &frame,
            mask: &Mask::new(valid.to_vec()),
            bands: &bands,
            source: &source,
        };
        let mut out = Cursor::new(Vec::new());
        write_cog(&mut out, &raster, options).unwrap();
        out.into_inner()
    }

    #[test]
    fn other_bands_of_our_own_files_are_read() {
        let file = written(3, 2, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[true; 6]);
        let read = |band| parse_band(&file[..], band, None, &Limits::default());
        assert_eq!(read(0).unwrap().values, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(read(1).unwrap().values, [-1.0; 6]);
        assert!(read(2).unwrap_err().to_string().contains("band 3"));
    }

    #[test]
    fn a_plain_file_is_read() {
        let raster = Made::new(3, 2, &[1.0, 2.0, 3.0, 4.0, 5.0, f32::NAN]).read().unwrap();
        assert_eq!(raster.values, [1.0, 2.0, 3.0, 4.0, 5.0, 0.0]);
        assert_eq!((raster.valid[5], raster.non_finite_cells), (false, 1));
        let a = raster.affine;
        assert_eq!((a.origin_x, a.origin_y, a.col_dx, a.row_dy), (100.0, 50.0, 2.0, -2.0));
        assert_eq!(raster.crs, None);
    }

    #[test]
    fn a_tie_point_may_be_any_cell_and_a_matrix_may_turn() {
        let made = Made::new(1, 1, &[1.0]);
        let tied = made.with_doubles(33922, &[3.0, 4.0, 0.0, 100.0, 50.0, 0.0]).read().unwrap();
        assert_eq!((tied.affine.origin_x, tied.affine.origin_y), (94.0, 58.0));
        let matrix =
            [2.0, 0.5, 0.0, 100.0, -0.5, -2.0, 0.0, 50.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let turned = Made::new(1, 1, &[1.0]).with_doubles(34264, &matrix).read().unwrap().affine;
        assert_eq!((turned.row_dx, turned.col_dy, turned.origin_y), (0.5, -0.5, 50.0));
    }

    #[test]
    fn a_point_raster_starts_half_a_cell_earlier() {
        let mut bytes = Made::new(1, 1, &[1.0]).with_text(34735, "keys").bytes();
        // the text stands in for the words 1, 1, 0, 1 and the key 1025 = 2
        let place = bytes.windows(4).position(|w| w == b"keys").unwrap();
        let words: Vec<u8> =
            [1_u16, 1, 0, 1, 1025, 0, 1, 2].iter().flat_map(|w| w.to_le_bytes()).collect();
        let end = bytes.len() as u32;
        bytes.extend(words);
        let entry = bytes.windows(2).rposition(|w| w == 34735_u16.to_le_bytes()).unwrap();
        bytes[entry + 2..entry + 12].copy_from_slice(&[
            3,
            0,
            8,
            0,
            0,
            0,
            end as u8,
            (end >> 8) as u8,
            0,
            0,
        ]);
        assert!(place < entry);
        let affine = parse(&bytes[..], None, &Limits::default()).unwrap().affine;
        assert_eq!((affine.origin_x, affine.origin_y), (99.0, 51.0));
    }

    #[test]
    fn nodata_and_metadata_of_gdal_are_used() {
        let metadata = "<GDALMetadata><Item name=\"a\">b</Item>\
            <Item name=\"SCALE\" sample=\"0\" role=\"scale\">0.5</Item>\
            <Item name=\"OFFSET\" sample=\"0\" role=\"offset\">10</Item>\
            <Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">US survey foot</Item></GDALMetadata>";
        let raster = Made::new(3, 1, &[4.0, -32768.0, f32::NAN])
            .with_text(42112, metadata)
            .with_text(42113, "-32768 ")
            .read()
            .unwrap();
        assert_eq!((raster.values[0], raster.valid[1], raster.non_finite_cells), (12.0, false, 1));
        assert_eq!(raster.vertical_unit, Some(LengthUnit::UsSurveyFoot));
        let nan = Made::new(2, 1, &[4.0, f32::NAN]).with_text(42113, "nan  ").read().unwrap();
        assert_eq!((nan.valid, nan.non_finite_cells), (vec![true, false], 0));
        assert!(Made::new(1, 1, &[4.0]).with_text(42113, "nothing").read().is_err());
    }

    #[test]
    fn what_is_no_elevation_is_refused() {
        let says = |made: Made, text: &str| {
            let error = made.read().unwrap_err();
            assert!(error.what.contains(text), "{error}");
        };
        let made = || Made::new(2, 1, &[1.0, 2.0]);
        says(made().with(262, 3), "picture");
        says(made().with(262, 2), "picture");
        says(made().with(259, 7), "compression method 7");
        says(made().with(258, 16), "16 bits");
        says(made().with(317, 4), "predictor 4");
        says(made().with(256, 0), "no cells");
        says(made().with_doubles(33550, &[0.0, 2.0, 0.0]), "not positive");
        says(made().with_doubles(33550, &[-2.0, 2.0, 0.0]), "not positive");
        says(made().with_doubles(33550, &[f64::NAN, 2.0, 0.0]), "not positive");
        says(made().with_doubles(33922, &[0.0, 0.0, 0.0, f64::INFINITY, 0.0, 0.0]), "not a number");
        says(made().with_doubles(33922, &[]), "no map position");
        says(Made::new(2, 1, &[f32::NAN, f32::NAN]), "no valid cell");
    }

    #[test]
    fn headers_that_claim_too_much_are_refused() {
        let says = |made: Made, text: &str| {
            let error = made.read().unwrap_err();
            assert!(error.what.contains(text), "{error}");
        };
        let made = || Made::new(40_000, 40_000, &[0.0; 200]);
        says(made(), "too large");
        says(made().with(278, 1), "needs 40000 tiles or strips");
        says(Made::new(10_000, 10_000, &[0.0; 200]).with(278, 10_000), "cannot hold 400000000");
        says(Made::new(2, 2, &[0.0; 4]).with(279, u32::MAX), "beyond the file");
        says(Made::new(2, 2, &[0.0; 4]).with(273, u32::MAX), "beyond the file");
        says(Made::new(u32::MAX, u32::MAX, &[0.0; 4]).with(277, 4000), "too large");
        says(Made::new(2, 2, &[0.0; 4]).with(278, 0), "no cells");
    }

    #[test]
    fn issue_2_a_mask_directory_is_not_overlooked() {
        let image = Made::new(2, 2, &[1.0, 2.0, 3.0, 4.0]);
        let mut bytes = image.bytes();
        // a second directory behind the first, whose pointer to it are the last four bytes
        let second = bytes.len() as u32;
        let pointer = bytes.len() - 4;
        bytes[pointer..].copy_from_slice(&second.to_le_bytes());
        let with_second = |subfile: u32, photometric: u32| {
            let mut bytes = bytes.clone();
            bytes.extend(2_u16.to_le_bytes());
            for (tag, value) in [(254_u16, subfile), (262, photometric)] {
                bytes.extend(tag.to_le_bytes());
                bytes.extend(4_u16.to_le_bytes());
                bytes.extend(1_u32.to_le_bytes());
                bytes.extend(value.to_le_bytes());
            }
            bytes.extend([0; 4]);
            parse(&bytes[..], None, &Limits::default())
        };
        let masked = with_second(4, 4).unwrap_err();
        assert!(masked.hint.contains("-dstnodata"), "{masked}");
        assert_eq!(masked.kind, ParseErrorKind::Unsupported);
        assert!(with_second(1, 1).is_ok() && with_second(5, 4).is_ok());
    }

    #[test]
    fn issue_2_tiles_far_larger_than_the_image_are_refused() {
        let made = |side: u32| {
            let image = Made::new(20, 20, &[0.0; 400]);
            image.with(322, side).with(323, side).with(324, 8).with(325, 1600)
        };
        let error = made(20_000).read().unwrap_err();
        assert!(error.what.contains("too large"), "{error}");
        // 512² tiles of a small image are usual: the next check finds that 1600 bytes are too few
        assert!(made(512).read().unwrap_err().what.contains("cannot hold"));
    }

    #[test]
    fn issue_2_a_failing_device_is_not_damage() {
        struct Failing(Vec<u8>);
        impl ByteSource for Failing {
            fn len(&self) -> u64 {
                self.0.len() as u64
            }
            fn read_at(&self, offset: u64, buffer: &mut [u8]) -> std::io::Result<usize> {
                // cells lie in the first bytes behind the header
                if (8..24).contains(&offset) {
                    return Err(std::io::Error::from(std::io::ErrorKind::TimedOut));
                }
                self.0[..].read_at(offset, buffer)
            }
        }
        let source = Failing(Made::new(2, 2, &[1.0, 2.0, 3.0, 4.0]).bytes());
        let problem = parse(&source, None, &Limits::default()).unwrap_err();
        let error = problem.at(std::path::Path::new("a.tif"));
        assert!(matches!(error, crate::io::Error::Read { .. }), "{error}");
        assert!(error.is_machine_failure());
    }

    #[test]
    fn missing_strips_are_nodata() {
        let made = Made::new(2, 2, &[0.0; 4]).with(273, 0).with(279, 0);
        assert!(made.read().unwrap_err().what.contains("no valid cell"));
    }

    #[test]
    fn wide_offsets_hold_the_same() {
        let values: Vec<f32> = (0..600 * 530).map(|i| (i % 977) as f32 * 0.37).collect();
        let valid: Vec<bool> = (0..values.len()).map(|i| i % 11 != 0).collect();
        let options = CogOptions { always_big: true, ..CogOptions::default() };
        let big = written_with(&options, 600, 530, &values, &valid);
        assert_eq!(big[2], 43);
        let (big, small) = (big, written(600, 530, &values, &valid));
        let [big, small] =
            [big, small].map(|bytes| parse(&bytes[..], None, &Limits::default()).unwrap());
        assert!(big.values == small.values && big.valid == small.valid);
        assert_eq!((big.affine, big.crs), (small.affine, small.crs));
    }

    #[test]
    fn windows_cut_across_tiles() {
        let (rows, cols) = (700, 600);
        let values: Vec<f32> = (0..rows * cols).map(|i| i as f32).collect();
        let bytes = written(rows, cols, &values, &vec![true; values.len()]);
        // rows 500–519 and columns 505–529 lie in four tiles; north edge 1400 m, cells of 2 m
        let window = MapWindow { west: 1010.0, east: 1060.0, south: 360.0, north: 400.0 };
        let part = parse(&bytes[..], Some(&window), &Limits::default()).unwrap();
        assert_eq!((part.rows, part.cols), (20, 25));
        assert_eq!((part.affine.origin_x, part.affine.origin_y), (1010.0, 400.0));
        for (index, value) in part.values.iter().enumerate() {
            assert_eq!(*value, ((500 + index / 25) * cols + 505 + index % 25) as f32);
        }
        let few = Limits { max_cells: 499, ..Limits::default() };
        assert!(parse(&bytes[..], Some(&window), &few).is_err());
    }

    #[test]
    fn any_number_of_threads_reads_and_writes_the_same() {
        let values: Vec<f32> = (0..520 * 530).map(|i| (i % 977) as f32 * 0.37).collect();
        let valid: Vec<bool> = (0..values.len()).map(|i| i % 11 != 0).collect();
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let bytes = written(520, 530, &values, &valid);
                let raster = parse(&bytes[..], None, &Limits::default()).unwrap();
                (bytes, raster.values, raster.valid)
            })
        };
        assert!(run(1) == run(3));
    }

    /// A national tile: corner, CRS and heights as rasterio reads them.
    #[test]
    fn a_national_tile_is_read() {
        let data = std::env::var("WILDWOOD_DATA").unwrap_or_else(|_| "../shared/data".into());
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(data);
        let Ok(source) =
            crate::io::geotiff::SharedFile::open(&folder.join("dem/slovenia_TM1_564_146_1m.tif"))
        else {
            eprintln!("skipped: ../shared/data is missing");
            return;
        };
        let raster = parse(&source, None, &Limits::default()).unwrap();
        assert_eq!((raster.rows, raster.cols, raster.crs), (1000, 1000, Some(Crs::Epsg(3794))));
        assert_eq!((raster.affine.origin_x, raster.affine.origin_y), (563_999.5, 146_999.5));
        let sum: f64 = raster.values.iter().map(|v| f64::from(*v)).sum();
        assert!((sum / 1e6 - SLOVENIA_MEAN_M).abs() < 1e-3, "{}", sum / 1e6);
    }

    /// numpy's mean of the tile in f64.
    const SLOVENIA_MEAN_M: f64 = 274.3305;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn what_is_written_is_read(
            cols in 1..40_usize,
            cells in proptest::collection::vec((-9000_f32..9000.0, proptest::bool::weighted(0.9)), 1..900),
        ) {
            let rows = cells.len().div_ceil(cols);
            let mut cells = cells;
            cells.resize(rows * cols, (7.0, true));
            cells[0].1 = true;
            let (values, valid): (Vec<f32>, Vec<bool>) = cells.into_iter().unzip();
            let raster = parse(&written(rows, cols, &values, &valid)[..], None, &Limits::default()).unwrap();
            prop_assert_eq!((raster.rows, raster.cols, raster.crs), (rows, cols, Some(Crs::Epsg(3794))));
            prop_assert_eq!(raster.vertical_unit, Some(LengthUnit::Metre));
            prop_assert_eq!(&raster.valid, &valid);
            for (index, value) in values.iter().enumerate() {
                prop_assert_eq!(raster.values[index], if valid[index] { *value } else { 0.0 });
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3000))]

        #[test]
        fn damaged_files_never_panic(
            is_written in any::<bool>(),
            flips in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
            cut in any::<prop::sample::Index>(),
            is_cut in any::<bool>(),
        ) {
            let mut bytes = if is_written {
                DAMAGED.with(Clone::clone)
            } else {
                Made::new(3, 2, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).with_text(42113, "-9999 ").bytes()
            };
            let limits = Limits { max_cells: 1 << 20, ..Limits::default() };
            for (at, value) in flips {
                let at = at.index(bytes.len());
                bytes[at] = value;
            }
            if is_cut {
                bytes.truncate(cut.index(bytes.len()));
            }
            let _ = parse(&bytes[..], None, &limits);
            let window = MapWindow { west: 1.0, south: 1.0, east: 4.0, north: 5.0 };
            let _ = parse(&bytes[..], Some(&window), &limits);
        }
    }

    thread_local! {
        /// A file of our own writer that is damaged again and again.
        static DAMAGED: Vec<u8> = written(3, 2, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[true; 6]);
    }
}
