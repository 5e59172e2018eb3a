//! The first directory of a TIFF file, with every value checked against the file's length.
//!
//! # Reference
//! Adobe, TIFF Revision 6.0, 1992, sections 2 and 8; BigTIFF as libtiff 4 reads it.

use std::collections::BTreeMap;

use super::source::{ByteSource, Positioned};
use crate::io::{ParseError, ParseErrorKind};
use std::io::Read;

/// Most tags of a directory; real files have under 40.
const MAX_TAGS: u64 = 1024;

/// Most bytes of a tag that is read; offsets of eight million tiles.
const MAX_TAG_BYTES: u64 = 64 << 20;

/// Where one tag's values lie.
#[derive(Clone, Copy, Debug)]
struct Entry {
    kind: u16,
    count: u64,
    offset: u64,
}

/// Tags of a TIFF file's first image. The values lie inside the file, so none is larger than it.
#[derive(Debug)]
pub struct Directory<'a, S: ?Sized> {
    source: &'a S,
    little_endian: bool,
    entries: BTreeMap<u16, Entry>,
    is_big: bool,
    /// Where the next directory lies; 0 after the last.
    next: u64,
}

/// Most directories looked at: an image, its mask, and overviews of both by halves down from 2³¹.
const MAX_DIRECTORIES: usize = 64;

pub(super) fn damaged(what: impl Into<String>) -> ParseError {
    ParseError::new(what, "the file is damaged or cut short: copy or download it again")
}

/// Trouble while reading bytes that lie in the file: the device's, unless the file has shrunk.
pub(super) fn unreadable(what: impl Into<String>, error: &std::io::Error) -> ParseError {
    let problem = damaged(format!("{}: {error}", what.into()));
    match error.kind() {
        std::io::ErrorKind::UnexpectedEof => problem,
        kind => problem.of_kind(ParseErrorKind::Device(kind)),
    }
}

/// Bytes of one value of a TIFF type.
fn size_of(kind: u16) -> Option<u64> {
    match kind {
        1 | 2 | 6 | 7 => Some(1),
        3 | 8 => Some(2),
        4 | 9 | 11 | 13 => Some(4),
        5 | 10 | 12 | 16 | 17 | 18 => Some(8),
        _ => None,
    }
}

struct Fields<'a, S: ?Sized> {
    stream: std::io::BufReader<Positioned<'a, S>>,
    little_endian: bool,
}

impl<'a, S: ByteSource + ?Sized> Fields<'a, S> {
    fn at(source: &'a S, offset: u64, little_endian: bool) -> Self {
        let stream = std::io::BufReader::with_capacity(1024, Positioned::at(source, offset));
        Self { stream, little_endian }
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], ParseError> {
        let mut bytes = [0; N];
        self.stream
            .read_exact(&mut bytes)
            .map_err(|e| unreadable("the TIFF directory cannot be read", &e))?;
        Ok(bytes)
    }

    fn u16(&mut self) -> Result<u16, ParseError> {
        let bytes = self.bytes()?;
        Ok(if self.little_endian { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
    }

    /// An offset or count: four bytes, or eight in BigTIFF.
    fn word(&mut self, big: bool) -> Result<u64, ParseError> {
        if big {
            let bytes = self.bytes()?;
            Ok(if self.little_endian {
                u64::from_le_bytes(bytes)
            } else {
                u64::from_be_bytes(bytes)
            })
        } else {
            let bytes = self.bytes()?;
            let word = if self.little_endian {
                u32::from_le_bytes(bytes)
            } else {
                u32::from_be_bytes(bytes)
            };
            Ok(u64::from(word))
        }
    }
}

impl<'a, S: ByteSource + ?Sized> Directory<'a, S> {
    /// # Errors
    /// If the bytes are no TIFF file, or a value lies outside them.
    pub fn read(source: &'a S) -> Result<Self, ParseError> {
        // Header: byte order, version, offset of the first directory
        let mut header = Fields::at(source, 0, true);
        let little_endian = match &header.bytes()? {
            b"II" => true,
            b"MM" => false,
            _ => return Err(damaged("the file is no TIFF: it starts with neither II nor MM")),
        };
        header.little_endian = little_endian;
        let big = match header.u16()? {
            42 => false,
            43 => {
                if (header.u16()?, header.u16()?) != (8, 0) {
                    return Err(damaged("the BigTIFF header is not valid"));
                }
                true
            }
            version => return Err(damaged(format!("the TIFF version is {version}, not 42 or 43"))),
        };
        let start = header.word(big)?;
        Self::read_at(source, start, big, little_endian)
    }

    /// The directories behind this one, as far as they can be read.
    pub fn following(&self) -> Vec<Self> {
        let mut found: Vec<Self> = Vec::new();
        let mut next = self.next;
        while next != 0 && found.len() < MAX_DIRECTORIES {
            let read = Self::read_at(self.source, next, self.is_big, self.little_endian);
            let Ok(directory) = read else { break };
            next = directory.next;
            found.push(directory);
        }
        found
    }

    /// Number of entries, then tag, type, count, and the values or their offset, then the next directory's place.
    fn read_at(
        source: &'a S,
        start: u64,
        big: bool,
        little_endian: bool,
    ) -> Result<Self, ParseError> {
        let mut fields = Fields::at(source, start, little_endian);
        let count = if big { fields.word(true)? } else { u64::from(fields.u16()?) };
        if count > MAX_TAGS {
            return Err(damaged(format!("the TIFF directory names {count} tags")));
        }
        let (head, entry_size, inline) = if big { (8, 20, 8) } else { (2, 12, 4) };
        let mut entries = BTreeMap::new();
        for index in 0..count {
            let (tag, kind) = (fields.u16()?, fields.u16()?);
            let count = fields.word(big)?;
            let pointer = fields.word(big)?;
            let Some(size) = size_of(kind) else { continue };
            let len = count.checked_mul(size).filter(|len| *len <= source.len());
            let offset = match len {
                Some(len) if len <= inline => {
                    // inside the entry: its last field; cannot overflow, the field was just read
                    start + head + index * entry_size + entry_size - inline
                }
                _ => pointer,
            };
            let end = len.and_then(|len| offset.checked_add(len));
            if end.is_none_or(|end| end > source.len()) {
                return Err(damaged(format!(
                    "tag {tag} claims {count} values beyond the end of the file"
                )));
            }
            if entries.insert(tag, Entry { kind, count, offset }).is_some() {
                return Err(damaged(format!("tag {tag} occurs twice")));
            }
        }
        // a file cut behind its last entry is read all the same
        let next = fields.word(big).unwrap_or(0);
        Ok(Self { source, little_endian, entries, is_big: big, next })
    }

    /// Whether numbers in the file have their lowest byte first.
    pub fn is_little_endian(&self) -> bool {
        self.little_endian
    }

    /// Number of a tag's values; 0 where it is missing.
    pub fn count(&self, tag: u16) -> u64 {
        self.entries.get(&tag).map_or(0, |e| e.count)
    }

    /// A tag's raw values with the size of one.
    fn raw(&self, tag: u16) -> Result<Option<(Entry, Vec<u8>)>, ParseError> {
        let Some(entry) = self.entries.get(&tag).copied() else { return Ok(None) };
        let size = size_of(entry.kind).unwrap_or(1);
        let len = entry.count.saturating_mul(size);
        if len > MAX_TAG_BYTES {
            return Err(damaged(format!("tag {tag} holds {len} bytes")));
        }
        let mut bytes = vec![0; len as usize]; // at most the constant above
        Positioned::at(self.source, entry.offset)
            .read_exact(&mut bytes)
            .map_err(|e| unreadable(format!("tag {tag} cannot be read"), &e))?;
        if self.little_endian != cfg!(target_endian = "little") {
            let word = if matches!(entry.kind, 5 | 10) { 4 } else { size as usize }; // 1, 2, 4 or 8
            bytes.chunks_exact_mut(word).for_each(<[u8]>::reverse);
        }
        Ok(Some((entry, bytes)))
    }

    /// A tag's whole numbers; empty where it is missing.
    ///
    /// # Errors
    /// If the tag is of another type or cannot be read.
    pub fn integers(&self, tag: u16) -> Result<Vec<u64>, ParseError> {
        let Some((entry, bytes)) = self.raw(tag)? else { return Ok(Vec::new()) };
        match entry.kind {
            1 | 7 => Ok(bytes.into_iter().map(u64::from).collect()),
            3 => {
                Ok(bytes.as_chunks().0.iter().map(|b| u64::from(u16::from_ne_bytes(*b))).collect())
            }
            4 => {
                Ok(bytes.as_chunks().0.iter().map(|b| u64::from(u32::from_ne_bytes(*b))).collect())
            }
            16 => Ok(bytes.as_chunks().0.iter().map(|b| u64::from_ne_bytes(*b)).collect()),
            kind => Err(damaged(format!("tag {tag} has type {kind} where whole numbers belong"))),
        }
    }

    /// A tag's first whole number.
    ///
    /// # Errors
    /// If the tag is of another type or cannot be read.
    pub fn integer(&self, tag: u16) -> Result<Option<u64>, ParseError> {
        Ok(self.integers(tag)?.first().copied())
    }

    /// A tag's doubles; empty where it is missing.
    ///
    /// # Errors
    /// If the tag is of another type or cannot be read.
    pub fn doubles(&self, tag: u16) -> Result<Vec<f64>, ParseError> {
        let Some((entry, bytes)) = self.raw(tag)? else { return Ok(Vec::new()) };
        match entry.kind {
            11 => {
                Ok(bytes.as_chunks().0.iter().map(|b| f64::from(f32::from_ne_bytes(*b))).collect())
            }
            12 => Ok(bytes.as_chunks().0.iter().map(|b| f64::from_ne_bytes(*b)).collect()),
            kind => Err(damaged(format!("tag {tag} has type {kind} where numbers belong"))),
        }
    }

    /// A tag's text up to its first zero byte; empty where it is missing.
    ///
    /// # Errors
    /// If the tag cannot be read.
    pub fn text(&self, tag: u16) -> Result<String, ParseError> {
        let Some((_, mut bytes)) = self.raw(tag)? else { return Ok(String::new()) };
        bytes.truncate(bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len()));
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A classic little-endian file with one directory of (tag, type, count, value).
    fn file(entries: &[(u16, u16, u32, u32)]) -> Vec<u8> {
        let mut bytes = b"II\x2a\0\x08\0\0\0".to_vec();
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

    #[test]
    fn inline_values_are_read() {
        let bytes = file(&[(256, 3, 1, 640), (257, 4, 1, 70_000), (258, 3, 2, 0x0010_0020)]);
        let directory = Directory::read(&bytes[..]).unwrap();
        assert_eq!(directory.integer(256).unwrap(), Some(640));
        assert_eq!(directory.integer(257).unwrap(), Some(70_000));
        assert_eq!(directory.integers(258).unwrap(), [32, 16]);
        assert_eq!(directory.integer(259).unwrap(), None);
        assert!(directory.doubles(256).is_err());
    }

    #[test]
    fn big_endian_files_give_the_same() {
        let bytes = b"MM\0\x2a\0\0\0\x08\0\x01\x01\0\0\x03\0\0\0\x01\x02\x80\0\0\0\0\0\0";
        assert_eq!(Directory::read(&bytes[..]).unwrap().integer(256).unwrap(), Some(640));
    }

    #[test]
    fn values_beyond_the_file_are_refused_before_they_are_allocated() {
        for entry in [(273, 4, u32::MAX, 8), (273, 16, 100, 8), (273, 4, 2, u32::MAX)] {
            let error = Directory::read(&file(&[entry])[..]).unwrap_err();
            assert!(error.what.contains("tag 273"), "{error}");
        }
    }

    #[test]
    fn other_bytes_are_no_tiff() {
        for bytes in [&b""[..], b"II", b"II\x2a\0", b"PK\x03\x04", b"II\x2c\0\x08\0\0\0\0\0"] {
            assert!(Directory::read(bytes).is_err());
        }
    }
}
