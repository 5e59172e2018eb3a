//! The LAS public header block and the variable length records, checked against the file's length.
//!
//! # Reference
//! ASPRS, LAS Specification 1.4 – R15, 2019, tables 3, 9 and 26.

use std::io::{Read, Seek, SeekFrom};

use crate::io::ParseError;

/// Size of the LAS 1.4 header block, the longest there is.
const LONGEST_HEADER: usize = 375;
/// Header block sizes of LAS 1.0 to 1.4.
const HEADER_SIZES: [usize; 5] = [227, 227, 227, 235, LONGEST_HEADER];
/// Record lengths of point formats 0 to 10 without extra bytes (LAS 1.4 R15, tables 7–17).
const RECORD_LENGTHS: [u16; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];
const VLR_HEADER: u64 = 54;
const EVLR_HEADER: u64 = 60;
/// Longest WKT read from an extended record. chosen: compound CRSs in WKT2 take some 10 kB.
const MAX_WKT_BYTES: u64 = 1 << 20;

/// What is needed of the public header block.
#[derive(Clone, Debug)]
pub(super) struct Header {
    /// Byte at which point records begin.
    pub points_start: u64,
    /// Point data record format, 0–10.
    pub format: u8,
    /// Whether records are LASzip-compressed.
    pub compressed: bool,
    /// Bytes a record.
    pub record_bytes: usize,
    /// Number of point records.
    pub points: u64,
    /// Map units a step, x, y, z.
    pub scale: [f64; 3],
    /// Map coordinates of integer 0, x, y, z.
    pub offset: [f64; 3],
}

/// The contents of the variable length records that matter here; empty where absent.
#[derive(Clone, Debug, Default)]
pub(super) struct Records {
    /// Record 34735: GeoTIFF key directory.
    pub geo_keys: Vec<u16>,
    /// Record 34736: GeoTIFF doubles.
    pub geo_doubles: Vec<f64>,
    /// Record 34737: GeoTIFF text.
    pub geo_ascii: String,
    /// Record 2112: coordinate system WKT.
    pub wkt: String,
    /// Record 22204: LASzip's own.
    pub laszip: Vec<u8>,
}

/// The error for bytes that end too early.
pub(super) fn truncated(what: &str) -> ParseError {
    ParseError::new(
        format!("the file ends within {what}"),
        "it was cut short: copy or download it again",
    )
}

/// The error for a header that cannot be right.
pub(super) fn damaged(what: impl Into<String>) -> ParseError {
    ParseError::new(
        what,
        "the file is damaged: copy or download it again, or check it with `pdal info`",
    )
}

/// Turns a read error into a parse error; `what` was being read.
pub(super) fn reading(what: &str) -> impl Fn(std::io::Error) -> ParseError + '_ {
    move |error| match error.kind() {
        std::io::ErrorKind::UnexpectedEof => truncated(what),
        _ => ParseError::new(format!("cannot read {what}: {error}"), "check the disk"),
    }
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from(u32_at(bytes, at)) | u64::from(u32_at(bytes, at + 4)) << 32
}

fn f64_at(bytes: &[u8], at: usize) -> f64 {
    f64::from_bits(u64_at(bytes, at))
}

/// Reads and checks the header block and the records after it.
///
/// # Errors
/// What of the header contradicts the file's length or itself.
pub(super) fn parse<R: Read + Seek>(
    reader: &mut R,
    length_bytes: u64,
) -> Result<(Header, Records), ParseError> {
    let bytes = header_block(reader)?;
    let minor = usize::from(bytes[25]);
    let header_bytes = u64::from(u16_at(&bytes, 94));
    let points_start = u64::from(u32_at(&bytes, 96));
    if header_bytes < HEADER_SIZES[minor] as u64 || points_start < header_bytes {
        return Err(damaged(format!(
            "the header says it takes {header_bytes} bytes and points begin at byte {points_start}, which cannot be"
        )));
    }
    if points_start > length_bytes {
        return Err(truncated("the header"));
    }
    let header = point_layout(&bytes, minor, points_start)?;

    let mut records = Records::default();
    let record_count = u64::from(u32_at(&bytes, 100));
    read_records(reader, header_bytes, record_count, points_start, VLR_HEADER, &mut records)?;
    if minor >= 4 {
        let (start, count) = (u64_at(&bytes, 235), u64::from(u32_at(&bytes, 243)));
        if start > 0 && count > 0 {
            read_records(reader, start, count, length_bytes, EVLR_HEADER, &mut records)?;
        }
    }
    Ok((header, records))
}

/// The header block, padded with zeros to the longest version's size.
fn header_block<R: Read + Seek>(reader: &mut R) -> Result<Vec<u8>, ParseError> {
    let mut bytes = Vec::with_capacity(LONGEST_HEADER);
    reader.seek(SeekFrom::Start(0)).map_err(reading("the header"))?;
    reader.take(LONGEST_HEADER as u64).read_to_end(&mut bytes).map_err(reading("the header"))?;
    if bytes.len() < 4 || &bytes[..4] != b"LASF" {
        return Err(ParseError::new(
            "this is no LAS or LAZ file (it does not begin with `LASF`)",
            "give a .las, .laz or .copc.laz file",
        ));
    }
    if bytes.len() < HEADER_SIZES[0] {
        return Err(truncated("the header"));
    }
    let (major, minor) = (bytes[24], bytes[25]);
    let Some(&size) = HEADER_SIZES.get(usize::from(minor)).filter(|_| major == 1) else {
        return Err(ParseError::new(
            format!("LAS version {major}.{minor} is not known"),
            "convert it to LAS 1.4 (`pdal translate`)",
        ));
    };
    if bytes.len() < size {
        return Err(truncated("the header"));
    }
    bytes.resize(LONGEST_HEADER, 0);
    Ok(bytes)
}

/// Format, number and coordinates of the point records.
fn point_layout(bytes: &[u8], minor: usize, points_start: u64) -> Result<Header, ParseError> {
    let format = bytes[104] & 0x3f;
    let record_bytes = u16_at(bytes, 105);
    let Some(&least) = RECORD_LENGTHS.get(usize::from(format)) else {
        return Err(ParseError::new(
            format!("point format {format} is not known"),
            "convert it to LAS 1.4 (`pdal translate`)",
        ));
    };
    if record_bytes < least {
        return Err(damaged(format!(
            "point records of format {format} take {least} bytes or more, not {record_bytes}"
        )));
    }
    // the 32-bit count is a leftover in LAS 1.4, and zero for formats 6 and up
    let few = u64::from(u32_at(bytes, 107));
    let many = if minor >= 4 { u64_at(bytes, 247) } else { 0 };
    let points = if many > 0 && (format >= 6 || few == 0) { many } else { few };

    let scale: [f64; 3] = std::array::from_fn(|axis| f64_at(bytes, 131 + 8 * axis));
    let offset: [f64; 3] = std::array::from_fn(|axis| f64_at(bytes, 155 + 8 * axis));
    for axis in 0..3 {
        let reach = scale[axis] * 2_147_483_648.0 + offset[axis].abs(); // i32's range
        let resolves = scale[axis] > 0.0 && scale[axis].is_normal();
        if !resolves || !reach.is_finite() || !(-1e12..1e12).contains(&offset[axis]) {
            return Err(damaged(format!(
                "coordinate scale {} and offset {} of axis {} place no points",
                scale[axis],
                offset[axis],
                ["x", "y", "z"][axis]
            )));
        }
    }
    Ok(Header {
        points_start,
        format,
        compressed: bytes[104] & 0x80 != 0,
        record_bytes: usize::from(record_bytes),
        points,
        scale,
        offset,
    })
}

/// Walks `count` records from `start`, none of which may pass `end`, and keeps the first of each kind.
fn read_records<R: Read + Seek>(
    reader: &mut R,
    start: u64,
    count: u64,
    end: u64,
    head_bytes: u64,
    records: &mut Records,
) -> Result<(), ParseError> {
    let extended = head_bytes == EVLR_HEADER;
    let what = if extended { "its extended records" } else { "its variable length records" };
    let mut position = start;
    for _ in 0..count {
        // a head or a body past the end stops the walk: no count or length is trusted
        if position.checked_add(head_bytes).is_none_or(|p| p > end) {
            return Err(truncated(what));
        }
        let mut head = [0_u8; EVLR_HEADER as usize];
        reader.seek(SeekFrom::Start(position)).map_err(reading(what))?;
        reader.read_exact(&mut head[..head_bytes as usize]).map_err(reading(what))?;
        let id = u16_at(&head, 18);
        let body = if extended { u64_at(&head, 20) } else { u64::from(u16_at(&head, 20)) };
        position += head_bytes;
        if body > end - position {
            return Err(truncated(what));
        }
        if body <= MAX_WKT_BYTES && records.wants(&head[2..18], id) {
            let mut data = vec![0; body as usize]; // ≤ 1 MiB, checked above
            reader.read_exact(&mut data).map_err(reading(what))?;
            records.keep(id, &data);
        }
        position += body;
    }
    Ok(())
}

impl Records {
    /// Whether a record of this owner and number is wanted and not there yet.
    fn wants(&self, user: &[u8], id: u16) -> bool {
        let name = user.split(|b| *b == 0).next().unwrap_or_default();
        // libLAS wrote the WKT under its own name
        let coordinates =
            name.eq_ignore_ascii_case(b"LASF_Projection") || name.eq_ignore_ascii_case(b"liblas");
        match id {
            34735 => coordinates && self.geo_keys.is_empty(),
            34736 => coordinates && self.geo_doubles.is_empty(),
            34737 => coordinates && self.geo_ascii.is_empty(),
            2112 => coordinates && self.wkt.is_empty(),
            22204 => name == b"laszip encoded" && self.laszip.is_empty(),
            _ => false,
        }
    }

    fn keep(&mut self, id: u16, data: &[u8]) {
        match id {
            34735 => self.geo_keys = data.chunks_exact(2).map(|b| u16_at(b, 0)).collect(),
            34736 => self.geo_doubles = data.chunks_exact(8).map(|b| f64_at(b, 0)).collect(),
            34737 => self.geo_ascii = String::from_utf8_lossy(data).into_owned(),
            2112 => self.wkt = String::from_utf8_lossy(data).trim_end_matches('\0').to_owned(),
            _ => self.laszip = data.to_vec(),
        }
    }
}
