//! A table as its writers and readers see it: named columns, and their values a run of rows at a time.

use std::borrow::Cow;
use std::ops::Range;

/// A column of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    /// Its name in files.
    pub name: &'static str,
    /// What it holds.
    pub kind: Kind,
}

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Whole numbers.
    Integer,
    /// Measures.
    Real {
        /// Digits behind the point, where the file is a text.
        decimals: usize,
    },
    /// Words, of which there are few.
    Word,
    /// Places in map coordinates.
    Point,
}

/// The values of a column in a run of rows.
#[derive(Clone, Debug, PartialEq)]
pub enum Values<'a> {
    /// Of [`Kind::Integer`].
    Integers(Cow<'a, [i64]>),
    /// Of [`Kind::Real`].
    Reals(Cow<'a, [f32]>),
    /// Of [`Kind::Word`].
    Words {
        /// Index into `words`, row by row.
        indices: Cow<'a, [u16]>,
        /// The words.
        words: Cow<'a, [Cow<'a, str>]>,
    },
    /// Of [`Kind::Point`]: eastings and northings.
    Points(Cow<'a, [[f64; 2]]>),
}

/// A table that is written.
pub trait Table: Sync {
    /// Number of rows.
    fn rows(&self) -> usize;

    /// The columns, in the order of files. At most one is of [`Kind::Point`].
    fn columns(&self) -> &[Column];

    /// The values of a column in some rows, of the column's kind and as many as the rows.
    fn values(&self, column: usize, rows: Range<usize>) -> Values<'_>;
}
