//! Lengths of Thrift structures, walked through without reading them: those of Parquet's directory and page headers.
//!
//! The Parquet library passes over unknown fields by counting as many elements as a list claims, though it may claim billions in
//! a few bytes. Here a list has no more elements than bytes are left.
//!
//! # Reference
//! Apache Thrift, compact protocol; Apache Parquet format, `PageHeader`.

/// Structures within structures, at most. chosen: Parquet's own have six.
const MOST_DEPTH: usize = 32;
/// `compressed_page_size` of a page header.
const PAGE_SIZE_FIELD: i64 = 3;

/// A structure's length in bytes, and the whole number in its third field: a page header's size of page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Walked {
    pub bytes: usize,
    pub third_field: Option<i64>,
}

/// Walks through the structure that `bytes` begin with; `None` where it does not end within them, or is none.
pub(super) fn walk(bytes: &[u8]) -> Option<Walked> {
    let mut walker = Walker { bytes, at: 0, third_field: None };
    walker.structure(0)?;
    Some(Walked { bytes: walker.at, third_field: walker.third_field })
}

struct Walker<'a> {
    bytes: &'a [u8],
    at: usize,
    third_field: Option<i64>,
}

impl Walker<'_> {
    fn byte(&mut self) -> Option<u8> {
        let byte = *self.bytes.get(self.at)?;
        self.at += 1;
        Some(byte)
    }

    fn skip(&mut self, count: u64) -> Option<()> {
        let left = (self.bytes.len() - self.at) as u64;
        if count > left {
            return None;
        }
        self.at += count as usize; // within the slice
        Some(())
    }

    fn varint(&mut self) -> Option<u64> {
        let mut value = 0_u64;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }

    fn zigzag(&mut self) -> Option<i64> {
        let value = self.varint()?;
        Some((value >> 1).cast_signed() ^ -((value & 1).cast_signed()))
    }

    fn structure(&mut self, depth: usize) -> Option<()> {
        let mut field = 0_i64;
        loop {
            let head = self.byte()?;
            if head == 0 {
                return Some(());
            }
            field = match head >> 4 {
                0 => self.zigzag()?,
                step => field.checked_add(i64::from(step))?,
            };
            match head & 15 {
                1 | 2 => {} // a truth value stands in the head
                4..=6 if depth == 0 && field == PAGE_SIZE_FIELD => {
                    self.third_field = Some(self.zigzag()?);
                }
                kind => self.value(kind, depth)?,
            }
        }
    }

    /// A value of a list or a field.
    fn value(&mut self, kind: u8, depth: usize) -> Option<()> {
        if depth >= MOST_DEPTH {
            return None;
        }
        match kind {
            1..=3 => self.skip(1),
            4..=6 => self.varint().map(drop),
            7 => self.skip(8),
            8 => {
                let length = self.varint()?;
                self.skip(length)
            }
            9 | 10 => {
                let head = self.byte()?;
                let count = if head >> 4 == 15 { self.varint()? } else { u64::from(head >> 4) };
                self.values(count, &[head & 15], depth)
            }
            11 => match self.varint()? {
                0 => Some(()),
                count => {
                    let kinds = self.byte()?;
                    self.values(count, &[kinds >> 4, kinds & 15], depth)
                }
            },
            12 => self.structure(depth + 1),
            13 => self.skip(16),
            _ => None,
        }
    }

    /// Elements of one value of each kind; each takes a byte or more.
    fn values(&mut self, count: u64, kinds: &[u8], depth: usize) -> Option<()> {
        if count > (self.bytes.len() - self.at) as u64 {
            return None;
        }
        for _ in 0..count {
            for kind in kinds {
                self.value(*kind, depth + 1)?;
            }
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_header_tells_its_length_and_the_size_of_its_page() {
        // type 0, uncompressed 40, compressed 33, a data page header of three numbers and an empty structure
        let header = [0x15, 0, 0x15, 80, 0x15, 66, 0x2c, 0x15, 10, 0x15, 0, 0x15, 6, 0x1c, 0, 0, 0];
        let walked = Some(Walked { bytes: header.len(), third_field: Some(33) });
        assert_eq!(walk(&header), walked);
        assert_eq!(
            walk(&[&header[..], &[7; 9]].concat()),
            walked,
            "what comes behind is not its own"
        );
        for end in 0..header.len() {
            assert_eq!(walk(&header[..end]), None, "cut at {end}");
        }
    }

    #[test]
    fn lists_that_claim_more_than_there_is_are_none() {
        // field 1: a list of 2³¹ truth values
        let claims = [0x19, 0xf1, 0x80, 0x80, 0x80, 0x80, 0x08, 0];
        assert_eq!(walk(&claims), None);
        let honest = [0x19, 0x31, 1, 2, 1, 0];
        assert_eq!(walk(&honest).map(|walked| walked.bytes), Some(honest.len()));
        let deep = [0x19_u8, 0x1c].repeat(MOST_DEPTH * 2);
        assert_eq!(walk(&deep), None);
    }
}
