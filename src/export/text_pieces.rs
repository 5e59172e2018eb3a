//! Large texts, made in parallel piece by piece and written in order, so that few of them are in memory.

use std::io::{self, Write};

use rayon::prelude::*;

/// Entries of an array in one piece. chosen: some 100 KB of text, enough to outweigh handing it over.
const PIECE_ENTRIES: usize = 8_192;
/// Pieces in memory at once. chosen: some 25 MB.
const BATCH_PIECES: usize = 256;

type Piece<'a> = Box<dyn Fn(&mut Vec<u8>) + Send + Sync + 'a>;

/// A text as pieces that know how to write themselves.
#[derive(Default)]
pub struct TextPieces<'a> {
    pieces: Vec<Piece<'a>>,
}

impl<'a> TextPieces<'a> {
    /// Adds a text.
    pub fn text(&mut self, text: impl Into<String>) {
        let text = text.into();
        self.pieces.push(Box::new(move |out| out.extend_from_slice(text.as_bytes())));
    }

    /// Adds what a function writes.
    pub fn piece(&mut self, write: impl Fn(&mut Vec<u8>) + Send + Sync + 'a) {
        self.pieces.push(Box::new(write));
    }

    /// Adds `count` entries, each written by `entry`, with `separator` between them.
    pub fn entries(
        &mut self,
        count: usize,
        separator: &'static str,
        entry: impl Fn(&mut Vec<u8>, usize) + Send + Sync + Clone + 'a,
    ) {
        for start in (0..count).step_by(PIECE_ENTRIES) {
            let entry = entry.clone();
            self.piece(move |out| {
                for i in start..(start + PIECE_ENTRIES).min(count) {
                    if i > 0 {
                        out.extend_from_slice(separator.as_bytes());
                    }
                    entry(out, i);
                }
            });
        }
    }

    /// Writes everything in order.
    ///
    /// # Errors
    /// Whatever writing gives.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        for batch in self.pieces.chunks(BATCH_PIECES) {
            let texts: Vec<Vec<u8>> = batch
                .par_iter()
                .map(|piece| {
                    let mut text = Vec::new();
                    piece(&mut text);
                    text
                })
                .collect();
            texts.iter().try_for_each(|text| out.write_all(text))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_stand_in_order_with_separators_between_entries() {
        let count = 3 * PIECE_ENTRIES + 5;
        let mut pieces = TextPieces::default();
        pieces.text("[");
        pieces.entries(count, ", ", |out, i| out.extend_from_slice(i.to_string().as_bytes()));
        pieces.text("]");
        pieces.entries(0, ", ", |_, _| unreachable!());
        let mut out = Vec::new();
        pieces.write(&mut out).unwrap();
        let expected: Vec<String> = (0..count).map(|i| i.to_string()).collect();
        assert_eq!(String::from_utf8(out).unwrap(), format!("[{}]", expected.join(", ")));
    }
}
