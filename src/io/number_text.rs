//! Words and numbers of a text file, with the line they stand on.

use super::ParseError;

/// Words separated by white space.
#[derive(Debug)]
pub(super) struct Words<'a> {
    rest: &'a [u8],
    line: usize,
}

impl<'a> Words<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        // a mark of UTF-8 in front belongs to no word
        Self { rest: bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), line: 1 }
    }

    /// The line of the word last read, from 1.
    pub(super) fn line(&self) -> usize {
        self.line
    }

    /// Number of bytes not yet read.
    pub(super) fn bytes_left(&self) -> usize {
        self.rest.len()
    }

    /// The next word; nothing at the end.
    pub(super) fn next(&mut self) -> Option<&'a [u8]> {
        let start = self.rest.iter().position(|byte| {
            self.line += usize::from(*byte == b'\n');
            !byte.is_ascii_whitespace()
        });
        let rest = &self.rest[start.unwrap_or(self.rest.len())..];
        let len = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        let (word, rest) = rest.split_at(len);
        self.rest = rest;
        (!word.is_empty()).then_some(word)
    }

    /// The next word without reading it.
    pub(super) fn peek(&self) -> Option<&'a [u8]> {
        Words { rest: self.rest, line: self.line }.next()
    }

    /// The next word as a number; `what` names it in errors.
    ///
    /// # Errors
    /// If there is no word, or it is no number.
    pub(super) fn number(&mut self, what: &str) -> Result<f64, ParseError> {
        let word = self.next().ok_or_else(|| {
            ParseError::new(
                format!("the file ends where {what} should stand"),
                "the file is cut short: copy or download it again",
            )
        })?;
        std::str::from_utf8(word).ok().and_then(|word| word.parse().ok()).ok_or_else(|| {
            let shown: String = String::from_utf8_lossy(word).chars().take(20).collect();
            ParseError::new(
                format!("line {}: {shown:?} stands where {what} should", self.line),
                "write numbers with a decimal point, separated by spaces",
            )
        })
    }

    /// The next word as a count of rows or columns.
    ///
    /// # Errors
    /// If it is no whole number above 0.
    pub(super) fn count(&mut self, what: &str) -> Result<usize, ParseError> {
        let number = self.number(what)?;
        if number >= 1.0 && number.fract() == 0.0 && number <= f64::from(u32::MAX) {
            Ok(number as usize) // whole and below 2³²
        } else {
            Err(ParseError::new(
                format!("line {}: {what} is {number}", self.line),
                "give a whole number above 0",
            ))
        }
    }
}

/// Values of a grid as text gives them.
#[derive(Debug)]
pub(super) struct GridText {
    /// 0 where invalid.
    pub(super) values: Vec<f32>,
    pub(super) valid: Vec<bool>,
    pub(super) non_finite_cells: usize,
}

/// Reads `rows` × `cols` numbers to the end of the text, once the bytes left can hold them.
///
/// # Errors
/// If there are fewer or more, or one is no number.
pub(super) fn grid(
    words: &mut Words<'_>,
    rows: usize,
    cols: usize,
    nodata: Option<f64>,
) -> Result<GridText, ParseError> {
    // each number is at least a digit and a space; the last needs no space
    let most = words.bytes_left().div_ceil(2);
    let cells = rows.checked_mul(cols).filter(|cells| *cells <= most).ok_or_else(|| {
        ParseError::new(
            format!(
                "the header promises {rows} rows of {cols} values, but only {} bytes follow",
                words.bytes_left()
            ),
            "the file is cut short, or its header is wrong: copy or download it again",
        )
    })?;
    let mut grid =
        GridText { values: vec![0.0; cells], valid: vec![false; cells], non_finite_cells: 0 };
    for (index, (value, valid)) in grid.values.iter_mut().zip(&mut grid.valid).enumerate() {
        if words.peek().is_none() {
            return Err(ParseError::new(
                format!("the file ends after {index} of {cells} values"),
                "the file is cut short, or its header is wrong: copy or download it again",
            ));
        }
        let number = words.number("a height")?;
        let height = number as f32; // beyond f32: infinite, caught below
        if nodata == Some(number) || (number.is_nan() && nodata.is_some_and(f64::is_nan)) {
        } else if height.is_finite() {
            (*value, *valid) = (height, true);
        } else {
            grid.non_finite_cells += 1;
        }
    }
    if words.next().is_some() {
        return Err(ParseError::new(
            format!("line {}: more than the {cells} values that the header promises", words.line()),
            "correct the number of rows or columns in the header",
        ));
    }
    Ok(grid)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_know_their_line() {
        let mut words = Words::new(b"\xef\xbb\xbf a\r\n\n bb\tc");
        let mut seen = Vec::new();
        while let Some(word) = words.next() {
            seen.push((String::from_utf8_lossy(word).into_owned(), words.line()));
        }
        assert_eq!(seen, [("a".into(), 1), ("bb".into(), 3), ("c".into(), 3)]);
    }

    #[test]
    fn grids_are_neither_short_nor_long() {
        let read = |text: &str| grid(&mut Words::new(text.as_bytes()), 2, 2, Some(-1.0));
        let full = read("1 -1 nan 4").unwrap();
        assert_eq!((full.values, full.non_finite_cells), (vec![1.0, 0.0, 0.0, 4.0], 1));
        assert_eq!(full.valid, [true, false, false, true]);
        assert!(read("1 2 3000000").unwrap_err().what.contains("after 3 of 4"));
        assert!(read("1 2 3 4\n5").unwrap_err().what.contains("line 2: more than the 4"));
        assert!(read("1 2\n3,5 4").unwrap_err().what.contains("line 2: \"3,5\""));
        assert!(read("1").unwrap_err().what.contains("only 1 bytes follow"));
    }
}
