//! Strips and tiles of a GeoTIFF: where they lie, whether they can be what they claim, and their cells.

use std::io::Read;
use std::ops::Range;

use rayon::prelude::*;

use super::codec::{self, Compression, Predictor, SampleType, Scaling};
use super::directory::{damaged, unreadable};
use super::source::{ByteSource, Positioned};
use crate::io::ParseError;
use crate::io::window::{self, CellWindow};

/// Layout of the first band's chunks.
#[derive(Debug)]
pub(super) struct Chunks {
    pub(super) rows: usize,
    pub(super) cols: usize,
    pub(super) chunk_rows: usize,
    pub(super) chunk_cols: usize,
    /// Bands whose values alternate in a chunk.
    pub(super) stored_bands: usize,
    pub(super) sample: SampleType,
    pub(super) compression: Compression,
    pub(super) predictor: Predictor,
    pub(super) little_endian: bool,
    pub(super) tiled: bool,
    pub(super) offsets: Vec<u64>,
    pub(super) byte_counts: Vec<u64>,
}

/// Cells of a window.
#[derive(Debug)]
pub(super) struct Decoded {
    pub(super) values: Vec<f32>,
    pub(super) valid: Vec<bool>,
    pub(super) non_finite_cells: usize,
}

/// Unpacked bytes held at a time, or one chunk where it is larger; bounds memory, changes no cell.
const BYTES_IN_FLIGHT: u64 = 256 << 20;

/// Consecutive output rows that one row of chunks fills.
struct Band<'a> {
    chunk_row: usize,
    rows: Range<usize>,
    values: &'a mut [f32],
    valid: &'a mut [bool],
}

impl Chunks {
    fn across(&self) -> usize {
        self.cols.div_ceil(self.chunk_cols)
    }

    fn down(&self) -> usize {
        self.rows.div_ceil(self.chunk_rows)
    }

    /// Whether a chunk was never written, which stands for nodata.
    fn is_missing(&self, chunk: usize) -> bool {
        self.offsets[chunk] == 0 && self.byte_counts[chunk] == 0
    }

    /// Rows of the image in a chunk of row `chunk_row`.
    fn rows_of(&self, chunk_row: usize) -> Range<usize> {
        let first = chunk_row * self.chunk_rows;
        first..(first + self.chunk_rows).min(self.rows)
    }

    /// Bytes of an unpacked chunk: tiles are stored whole, the last strip only as far as the image goes.
    fn unpacked_bytes(&self, chunk: usize) -> u64 {
        let rows = if self.tiled { self.chunk_rows } else { self.rows_of(chunk).len() };
        let value_bytes = (self.stored_bands * self.sample.bytes()) as u64;
        (rows as u64 * self.chunk_cols as u64).saturating_mul(value_bytes)
    }

    /// Chunks that may be unpacked at the same time, at least one.
    fn chunks_in_flight(&self) -> usize {
        let values = self.chunk_rows * self.chunk_cols * self.stored_bands; // was bounded when read
        let chunk_bytes = (values * self.sample.bytes()) as u64;
        (BYTES_IN_FLIGHT / chunk_bytes.max(1)).max(1) as usize // below 2²⁸
    }

    /// Checks what the tags claim against each other and the file's length; `planes` bands are stored apart.
    pub(super) fn check(&self, planes: u64, file_len: u64) -> Result<(), ParseError> {
        // 1. as many chunks as the image has places for; both factors are below 2³²
        let per_plane = self.across() as u64 * self.down() as u64;
        let expected = per_plane.checked_mul(planes);
        let (offsets, counts) = (self.offsets.len() as u64, self.byte_counts.len() as u64);
        if Some(offsets) != expected || counts != offsets {
            return Err(damaged(format!(
                "the image of {} × {} cells needs {per_plane} tiles or strips a band, but {offsets} offsets and {counts} sizes are given",
                self.cols, self.rows
            )));
        }
        // 2. every chunk of the first band lies in the file and can unpack to its cells

        for chunk in 0..per_plane as usize {
            if self.is_missing(chunk) {
                continue;
            }
            let (offset, stored) = (self.offsets[chunk], self.byte_counts[chunk]);
            if offset.checked_add(stored).is_none_or(|end| end > file_len) {
                return Err(damaged(format!(
                    "tile or strip {chunk} lies at byte {offset} with {stored} bytes, beyond the file's {file_len}"
                )));
            }
            let unpacked = self.unpacked_bytes(chunk);
            if unpacked > stored.saturating_mul(self.compression.max_expansion()) {
                return Err(damaged(format!(
                    "tile or strip {chunk} has {stored} bytes and cannot hold {unpacked}"
                )));
            }
        }
        Ok(())
    }

    /// The chunks of another band, 0 being the first, where bands are stored apart.
    pub(super) fn of_band(mut self, band: usize, file_len: u64) -> Result<Self, ParseError> {
        if band == 0 {
            return Ok(self);
        }
        let per_plane = self.across() * self.down();
        let chunks = band.saturating_mul(per_plane)..(band + 1).saturating_mul(per_plane);
        if self.offsets.len() < chunks.end {
            return Err(damaged(format!("band {} is not there, or not stored apart", band + 1)));
        }
        self.offsets = self.offsets[chunks.clone()].to_vec();
        self.byte_counts = self.byte_counts[chunks].to_vec();
        self.check(1, file_len)?;
        Ok(self)
    }

    /// The first band's cells in `range`.
    pub(super) fn decode<S: ByteSource + ?Sized>(
        &self,
        source: &S,
        range: &CellWindow,
        scaling: &Scaling,
    ) -> Result<Decoded, ParseError> {
        let chunk_range =
            |cells: &Range<usize>, size: usize| cells.start / size..cells.end.div_ceil(size);
        let down = chunk_range(&range.rows, self.chunk_rows);
        let across = chunk_range(&range.cols, self.chunk_cols);
        let touched = |row: usize| across.clone().map(move |col| row * self.across() + col);
        if down.clone().flat_map(touched).all(|chunk| self.is_missing(chunk)) {
            return Err(window::nothing_valid());
        }
        let mut values = vec![0.0; range.len()];
        let mut valid = vec![false; range.len()];

        // Rows of chunks fill disjoint parts of the output
        let mut bands = Vec::with_capacity(down.len());
        let (mut values_left, mut valid_left) = (&mut values[..], &mut valid[..]);
        for chunk_row in down {
            let rows = self.rows_of(chunk_row);
            let rows = rows.start.max(range.rows.start)..rows.end.min(range.rows.end);
            let (values, rest) = values_left.split_at_mut(rows.len() * range.cols.len());
            values_left = rest;
            let (valid, rest) = valid_left.split_at_mut(rows.len() * range.cols.len());
            valid_left = rest;
            bands.push(Band { chunk_row, rows, values, valid });
        }
        let at_once = self.chunks_in_flight() / across.len().max(1);
        let mut non_finite_cells = 0;
        while !bands.is_empty() {
            let some: Vec<Band<'_>> = bands.drain(..at_once.clamp(1, bands.len())).collect();
            let counts: Vec<Result<usize, ParseError>> = some
                .into_par_iter()
                .map(|band| self.fill(band, source, &range.cols, scaling))
                .collect();
            for count in counts {
                non_finite_cells += count?;
            }
        }
        Ok(Decoded { values, valid, non_finite_cells })
    }

    /// Fills a band of output rows; gives the number of cells that are not finite.
    fn fill<S: ByteSource + ?Sized>(
        &self,
        band: Band<'_>,
        source: &S,
        cols: &Range<usize>,
        scaling: &Scaling,
    ) -> Result<usize, ParseError> {
        let across: Vec<usize> =
            (cols.start / self.chunk_cols..cols.end.div_ceil(self.chunk_cols)).collect();
        let mut non_finite_cells = 0;
        let first_row = band.chunk_row * self.chunk_rows;
        let decoded = across.chunks(self.chunks_in_flight()).flat_map(|some| {
            let decoded: Vec<Result<Option<Vec<u8>>, ParseError>> = some
                .par_iter()
                .map(|chunk_col| {
                    let chunk = band.chunk_row * self.across() + chunk_col;
                    let is_missing = self.is_missing(chunk);
                    if is_missing { Ok(None) } else { self.read(source, chunk).map(Some) }
                })
                .collect();
            some.iter().copied().zip(decoded)
        });
        for (chunk_col, samples) in decoded {
            let Some(samples) = samples? else { continue };
            let first_col = chunk_col * self.chunk_cols;
            let chunk_width = self.chunk_cols.min(self.cols - first_col);
            let part = first_col.max(cols.start)..(first_col + chunk_width).min(cols.end);
            for (index, row) in band.rows.clone().enumerate() {
                let from = (row - first_row) * self.chunk_cols + part.start - first_col;
                let to = index * cols.len() + part.start - cols.start;
                let values = &mut band.values[to..to + part.len()];
                let valid = &mut band.valid[to..to + part.len()];
                non_finite_cells +=
                    self.sample.heights(&samples, from, self.stored_bands, scaling, values, valid);
            }
        }
        Ok(non_finite_cells)
    }

    /// A chunk's samples, unpacked, in this machine's byte order.
    fn read<S: ByteSource + ?Sized>(
        &self,
        source: &S,
        chunk: usize,
    ) -> Result<Vec<u8>, ParseError> {
        let failed = |e: &dyn std::fmt::Display| {
            damaged(format!("tile or strip {chunk} cannot be unpacked: {e}"))
        };
        let unpacked = self.unpacked_bytes(chunk);
        // no method makes noise more than half as long again: what is beyond belongs to nobody
        let stored = self.byte_counts[chunk].min(unpacked.saturating_mul(2).saturating_add(1024));
        let mut packed = vec![0; usize::try_from(stored).map_err(|e| failed(&e))?];
        let mut stream = Positioned::at(source, self.offsets[chunk]);
        stream
            .read_exact(&mut packed)
            .map_err(|e| unreadable(format!("tile or strip {chunk} cannot be read"), &e))?;
        let unpacked = usize::try_from(unpacked).map_err(|e| failed(&e))?;
        let mut samples =
            codec::unpack(self.compression, packed, unpacked).map_err(|e| failed(&e))?;
        let row_values = self.chunk_cols * self.stored_bands;
        codec::undo_predictor(
            self.predictor,
            self.sample,
            self.little_endian,
            row_values,
            self.stored_bands,
            &mut samples,
        );
        Ok(samples)
    }
}
