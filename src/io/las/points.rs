//! Point records to columns: plain LAS in blocks, LAZ chunk by chunk on all cores.
//!
//! `las`'s own reader believes the chunk table: a damaged one makes it ask for memory without bound,
//! or panic. Here the table is checked against file and header first, and columns grow as points arrive.

use std::io::{Cursor, Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};

use laz::laszip::{ChunkTable, CompressorType};
use laz::record::{
    LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor,
};
use laz::{DecompressionSelection, LazItem, LazItemType, LazVlr};
use rayon::prelude::*;

use super::Columns;
use super::header::{Header, damaged, reading, truncated};
use crate::io::{Limits, ParseError};
use crate::raster::MapWindow;

/// Most points a byte of LAZ may claim. chosen: real files need 15 bits a point and more;
/// even a million copies of one point take more than one.
const MAX_POINTS_PER_LAZ_BYTE: u64 = 8;
/// Records decoded at a time. chosen: 4096 records of 30 bytes stay in the L2 cache.
const BLOCK_RECORDS: usize = 4096;
/// Chunks read before they are decoded side by side. chosen: 64 × 50,000 points keep 16 cores
/// busy and hold some 30 MB of compressed bytes.
const BATCH_CHUNKS: usize = 64;

/// Classes that are noise: low points and high points (LAS 1.4 R15, table 17).
const NOISE: [u8; 2] = [7, 18];

/// Which points are kept.
#[derive(Clone, Copy)]
struct Filter {
    extended: bool,
    /// Inclusive ranges of the integer coordinates.
    x: (i32, i32),
    y: (i32, i32),
}

impl Filter {
    fn new(header: &Header, window: Option<MapWindow>) -> Self {
        let everything = (i32::MIN, i32::MAX);
        let steps = |axis: usize, low: f64, high: f64| {
            let step = |v: f64| (v - header.offset[axis]) / header.scale[axis];
            // `as` saturates: a window beyond the integers' reach is no limit. The slack of a
            // thousandth of a step keeps points that stand on the window's edge.
            ((step(low) - 1e-3).ceil() as i32, (step(high) + 1e-3).floor() as i32)
        };
        let (x, y) = match window {
            None => (everything, everything),
            Some(w) => (steps(0, w.west, w.east), steps(1, w.south, w.north)),
        };
        Self { extended: header.format >= 6, x, y }
    }

    /// Appends the records that are wanted to `columns`.
    fn take(&self, records: &[u8], record_bytes: usize, columns: &mut Columns) {
        for record in records.chunks_exact(record_bytes) {
            let step = |at: usize| {
                i32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]])
            };
            // formats 0–5 pack class and flags in one byte, 6–10 have a byte for each
            let (class, withheld) = if self.extended {
                (record[16], record[15] & 0b100 != 0)
            } else {
                (record[15] & 0b1_1111, record[15] & 0b1000_0000 != 0)
            };
            let (x, y) = (step(0), step(4));
            if x < self.x.0 || x > self.x.1 || y < self.y.0 || y > self.y.1 {
                continue;
            }
            if withheld || NOISE.contains(&class) {
                columns.dropped += 1;
                continue;
            }
            columns.x.push(x);
            columns.y.push(y);
            columns.z.push(step(8));
            columns.class.push(class);
        }
    }
}

/// Reads the points that lie in the window and are neither withheld nor noise.
///
/// # Errors
/// If the records are fewer than the header says, damaged, or more than the limit.
pub(super) fn parse<R: Read + Seek>(
    reader: &mut R,
    length_bytes: u64,
    header: &Header,
    laszip: &[u8],
    window: Option<MapWindow>,
    limits: &Limits,
) -> Result<Columns, ParseError> {
    if window.is_none() && header.points > limits.max_points as u64 {
        return Err(too_many(header.points, limits));
    }
    let filter = Filter::new(header, window);
    if header.compressed {
        parse_compressed(reader, length_bytes, header, laszip, filter, limits)
    } else {
        parse_plain(reader, length_bytes, header, filter, limits)
    }
}

fn too_many(points: u64, limits: &Limits) -> ParseError {
    ParseError::new(
        format!("{points} points are more than the {} that may be read", limits.max_points),
        "give --bbox, or tile the cloud (`pdal tile`)",
    )
}

fn check_limit(columns: &Columns, limits: &Limits) -> Result<(), ParseError> {
    match columns.x.len() {
        kept if kept > limits.max_points => Err(too_many(kept as u64, limits)),
        _ => Ok(()),
    }
}

fn parse_plain<R: Read + Seek>(
    reader: &mut R,
    length_bytes: u64,
    header: &Header,
    filter: Filter,
    limits: &Limits,
) -> Result<Columns, ParseError> {
    let there = (length_bytes - header.points_start) / header.record_bytes as u64;
    if there < header.points {
        return Err(ParseError::new(
            format!("the header says {} points, the file holds {there}", header.points),
            "it was cut short: copy or download it again",
        ));
    }
    reader.seek(SeekFrom::Start(header.points_start)).map_err(reading("its points"))?;
    let mut columns = Columns::default();
    let mut block = vec![0; BLOCK_RECORDS * header.record_bytes];
    let mut left = header.points;
    while left > 0 {
        let records = left.min(BLOCK_RECORDS as u64);
        let bytes = &mut block[..records as usize * header.record_bytes]; // ≤ BLOCK_RECORDS
        reader.read_exact(bytes).map_err(reading("its points"))?;
        filter.take(bytes, header.record_bytes, &mut columns);
        check_limit(&columns, limits)?;
        left -= records;
    }
    Ok(columns)
}

/// One chunk of compressed points.
#[derive(Clone, Copy, Debug)]
struct Chunk {
    points: u64,
    bytes: u64,
}

fn parse_compressed<R: Read + Seek>(
    reader: &mut R,
    length_bytes: u64,
    header: &Header,
    laszip: &[u8],
    filter: Filter,
    limits: &Limits,
) -> Result<Columns, ParseError> {
    if header.points == 0 {
        return Ok(Columns::default());
    }
    if header.points > (length_bytes - header.points_start).saturating_mul(MAX_POINTS_PER_LAZ_BYTE)
    {
        return Err(ParseError::new(
            format!("the header says {} points, far more than the file can hold", header.points),
            "it was cut short or damaged: copy or download it again",
        ));
    }
    let vlr = LazVlr::from_buffer(laszip)
        .map_err(|e| damaged(format!("its LASzip record cannot be used ({e})")))?;
    check_items(&vlr, laszip, header)?;
    let chunks = chunk_table(reader, length_bytes, header, &vlr)?;

    let mut columns = Columns::default();
    reader.seek(SeekFrom::Start(header.points_start + 8)).map_err(reading("its points"))?;
    for batch in chunks.chunks(BATCH_CHUNKS) {
        let batch_bytes: u64 = batch.iter().map(|c| c.bytes).sum();
        let mut bytes = Vec::new();
        reader.take(batch_bytes).read_to_end(&mut bytes).map_err(reading("its points"))?;
        if (bytes.len() as u64) < batch_bytes {
            return Err(truncated("its points"));
        }
        let mut jobs = Vec::with_capacity(batch.len());
        let mut rest = bytes.as_slice();
        for chunk in batch {
            let (head, tail) = rest.split_at(chunk.bytes as usize); // the sum was read above
            jobs.push((*chunk, head));
            rest = tail;
        }
        let decoded: Vec<Result<Columns, ParseError>> = jobs
            .into_par_iter()
            .map(|(chunk, bytes)| decode(chunk, bytes, header, vlr.items(), filter))
            .collect();
        for part in decoded {
            columns.append(part?);
        }
        check_limit(&columns, limits)?;
    }
    Ok(columns)
}

/// Whether the compressed fields are those of the header's point format.
fn check_items(vlr: &LazVlr, laszip: &[u8], header: &Header) -> Result<(), ParseError> {
    let compressor = laszip.first_chunk().map_or(0, |b| u16::from_le_bytes(*b));
    let chunked = [CompressorType::PointWiseChunked, CompressorType::LayeredChunked];
    if !chunked.iter().any(|c| *c as u16 == compressor) {
        return Err(ParseError::new(
            format!("LASzip compressor {compressor} is not supported"),
            "write the file anew (`pdal translate in.laz out.laz`)",
        ));
    }
    let item_bytes: usize = vlr.items().iter().map(|item| usize::from(item.size())).sum();
    let first = vlr.items().first().map(LazItem::item_type);
    let fits = match first {
        Some(LazItemType::Point10) => header.format <= 5,
        Some(LazItemType::Point14) => header.format >= 6,
        _ => false,
    };
    let layered = compressor == CompressorType::LayeredChunked as u16;
    if !fits || item_bytes != header.record_bytes || layered != (header.format >= 6) {
        return Err(damaged(format!(
            "its LASzip record does not describe points of format {} with {} bytes",
            header.format, header.record_bytes
        )));
    }
    Ok(())
}

/// Points and bytes of each chunk, checked to fit the file and to add up to the header's count.
fn chunk_table<R: Read + Seek>(
    reader: &mut R,
    length_bytes: u64,
    header: &Header,
    vlr: &LazVlr,
) -> Result<Vec<Chunk>, ParseError> {
    const WHAT: &str = "its LAZ chunk table";
    let data_start = header.points_start + 8;
    let mut word = [0_u8; 8];
    let mut read_word = |reader: &mut R, at| {
        reader.seek(at).and_then(|_| reader.read_exact(&mut word)).map_err(reading(WHAT))?;
        Ok(u64::from_le_bytes(word))
    };
    let mut start = read_word(reader, SeekFrom::Start(header.points_start))?;
    if start == u64::MAX || start <= header.points_start {
        // written to a pipe: the offset stands in the last eight bytes
        start = read_word(reader, SeekFrom::End(-8))?;
    }
    if start < data_start || start.checked_add(8).is_none_or(|end| end > length_bytes) {
        return Err(truncated(WHAT));
    }
    let count = read_word(reader, SeekFrom::Start(start))? >> 32; // version, then number of chunks
    let room = start - data_start;
    if count > room / header.record_bytes as u64 {
        return Err(damaged(format!("{count} LAZ chunks do not fit in {room} bytes")));
    }

    reader.seek(SeekFrom::Start(start)).map_err(reading(WHAT))?;
    let variable = vlr.uses_variable_size_chunks();
    // the arithmetic decoder may trip over damaged bits
    let table = catch_unwind(AssertUnwindSafe(|| ChunkTable::read(reader, variable)))
        .map_err(|_| damaged("its LAZ chunk table is damaged"))?
        .map_err(reading(WHAT))?;

    let mut chunks = Vec::with_capacity(table.len());
    let (mut points_left, mut bytes_left) = (header.points, room);
    for entry in &table {
        if points_left == 0 {
            break;
        }
        let points =
            if variable { entry.point_count } else { u64::from(vlr.chunk_size()).min(points_left) };
        if entry.byte_count > bytes_left || points > points_left {
            return Err(damaged("the LAZ chunk table disagrees with file length and point count"));
        }
        points_left -= points;
        bytes_left -= entry.byte_count;
        chunks.push(Chunk { points, bytes: entry.byte_count });
    }
    if points_left > 0 {
        return Err(damaged(format!("its LAZ chunks lack {points_left} points of the header's")));
    }
    Ok(chunks)
}

/// The kept points of one chunk.
fn decode(
    chunk: Chunk,
    bytes: &[u8],
    header: &Header,
    items: &Vec<LazItem>,
    filter: Filter,
) -> Result<Columns, ParseError> {
    const DAMAGED: &str = "a LAZ chunk is damaged";
    if chunk.points == 0 {
        return Ok(Columns::default());
    }
    if chunk.points > chunk.bytes.saturating_mul(MAX_POINTS_PER_LAZ_BYTE) {
        return Err(damaged(DAMAGED));
    }
    if header.format >= 6 {
        check_layers(bytes, header.record_bytes, items)?;
    }
    // damaged bits inside a chunk can make the decoder panic; no state outlives the attempt
    let attempt = catch_unwind(AssertUnwindSafe(|| -> laz::Result<Columns> {
        let mut decoder: Box<dyn RecordDecompressor<Cursor<&[u8]>>> = if header.format >= 6 {
            Box::new(LayeredPointRecordDecompressor::new(Cursor::new(bytes)))
        } else {
            Box::new(SequentialPointRecordDecompressor::new(Cursor::new(bytes)))
        };
        decoder.set_fields_from(items)?;
        decoder.set_selection(
            DecompressionSelection::base()
                .decompress_z()
                .decompress_classification()
                .decompress_flags(),
        );
        if decoder.record_size() != header.record_bytes {
            return Err(std::io::Error::other("fields of another size").into());
        }
        let mut columns = Columns::default();
        let mut block = vec![0; BLOCK_RECORDS * header.record_bytes];
        let mut left = chunk.points;
        while left > 0 {
            let records = left.min(BLOCK_RECORDS as u64);
            let records_bytes = &mut block[..records as usize * header.record_bytes];
            decoder.decompress_many(records_bytes)?;
            filter.take(records_bytes, header.record_bytes, &mut columns);
            left -= records;
        }
        Ok(columns)
    }));
    match attempt {
        Ok(Ok(columns)) => Ok(columns),
        Ok(Err(error)) => Err(damaged(format!("{DAMAGED} ({error})"))),
        Err(_) => Err(damaged(DAMAGED)),
    }
}

/// Whether the layers of a chunk (formats 6–10) fit in it: the decoder would set aside what they claim.
///
/// A chunk is its first point as it is, the number of points, a size for each layer, the layers.
fn check_layers(bytes: &[u8], record_bytes: usize, items: &[LazItem]) -> Result<(), ParseError> {
    let layers: usize = items
        .iter()
        .map(|item| match item.item_type() {
            LazItemType::Point14 => 9,
            LazItemType::RGBNIR14 => 2,
            LazItemType::Byte14(count) => usize::from(count),
            _ => 1,
        })
        .sum();
    let head = record_bytes + 4;
    let fit = bytes.get(head..head + 4 * layers).is_some_and(|sizes| {
        let claimed: u64 = sizes
            .chunks_exact(4)
            .map(|s| u64::from(u32::from_le_bytes([s[0], s[1], s[2], s[3]])))
            .sum();
        claimed <= (bytes.len() - head - 4 * layers) as u64
    });
    if fit { Ok(()) } else { Err(damaged("the layers of a LAZ chunk do not fit in it")) }
}
