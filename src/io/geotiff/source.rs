//! Bytes by position, for many threads at once.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result, Seek, SeekFrom};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Bytes that several threads read at positions of their own.
pub trait ByteSource: Sync {
    /// Number of bytes.
    fn len(&self) -> u64;

    /// Whether there are no bytes.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of bytes read into `buffer` from `offset`; 0 at the end.
    ///
    /// # Errors
    /// If the device fails.
    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> Result<usize>;
}

impl ByteSource for [u8] {
    fn len(&self) -> u64 {
        <[u8]>::len(self) as u64
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> Result<usize> {
        let start = usize::try_from(offset).unwrap_or(usize::MAX).min(<[u8]>::len(self));
        let count = buffer.len().min(<[u8]>::len(self) - start);
        buffer[..count].copy_from_slice(&self[start..start + count]);
        Ok(count)
    }
}

/// A file that threads take turns to read.
#[derive(Debug)]
pub struct SharedFile {
    file: Mutex<File>,
    len: u64,
}

impl SharedFile {
    /// # Errors
    /// If the file cannot be opened.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path)?;
        let len = file.metadata()?.len();
        Ok(Self { file: Mutex::new(file), len })
    }
}

impl ByteSource for SharedFile {
    fn len(&self) -> u64 {
        self.len
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> Result<usize> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(offset))?;
        file.read(buffer)
    }
}

/// A stream over a source, with a position of its own.
#[derive(Debug)]
pub(super) struct Positioned<'a, S: ?Sized> {
    source: &'a S,
    position: u64,
}

impl<'a, S: ByteSource + ?Sized> Positioned<'a, S> {
    pub(super) fn at(source: &'a S, position: u64) -> Self {
        Self { source, position }
    }
}

impl<S: ByteSource + ?Sized> Read for Positioned<'_, S> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let count = self.source.read_at(self.position, buffer)?;
        self.position = self.position.saturating_add(count as u64);
        Ok(count)
    }
}

impl<S: ByteSource + ?Sized> Seek for Positioned<'_, S> {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        let position = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::End(offset) => self.source.len().checked_add_signed(offset),
            SeekFrom::Current(offset) => self.position.checked_add_signed(offset),
        };
        self.position = position.ok_or_else(|| Error::from(ErrorKind::InvalidInput))?;
        Ok(self.position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_reads_seeks_and_ends() {
        let bytes: &[u8] = &[1, 2, 3, 4, 5];
        let mut stream = Positioned::at(bytes, 3);
        let mut out = Vec::new();
        stream.read_to_end(&mut out).unwrap();
        assert_eq!(out, [4, 5]);
        assert_eq!(stream.seek(SeekFrom::End(-4)).unwrap(), 1);
        assert!(stream.seek(SeekFrom::Current(-2)).is_err());
        stream.seek(SeekFrom::Start(u64::MAX)).unwrap();
        assert_eq!(stream.read(&mut [0]).unwrap(), 0);
    }
}
