//! A table as its writers and readers see it: named columns, and their values a run of rows at a time.

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;

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
    /// Straight lines between two places in map coordinates.
    Line,
}

impl Kind {
    /// Whether it holds something that has a place on the map.
    pub fn is_geometry(self) -> bool {
        matches!(self, Self::Point | Self::Line)
    }
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
    /// Of [`Kind::Line`]: eastings and northings of both ends; the thick end comes first.
    Lines(Cow<'a, [[[f64; 2]; 2]]>),
}

/// A table that is written.
pub trait Table: Sync {
    /// Number of rows.
    fn rows(&self) -> usize;

    /// The columns, in the order of files. At most one is a geometry.
    fn columns(&self) -> &[Column];

    /// The values of a column in some rows, of the column's kind and as many as the rows.
    fn values(&self, column: usize, rows: Range<usize>) -> Values<'_>;
}

/// The order in which rows are written: that of a key; rows of one key stay as they stand.
#[derive(Clone, Debug)]
pub struct RowOrder(
    /// Where the rows stand, in the order of their keys; `None` where they stand that way.
    Option<Vec<u32>>,
);

impl RowOrder {
    /// The order of `rows` rows by what `key` gives for each.
    ///
    /// # Panics
    /// If there are 2³² rows and more.
    pub fn by_key<K: Ord>(rows: usize, key: impl Fn(usize) -> K + Sync) -> Self {
        let count = u32::try_from(rows);
        assert!(count.is_ok(), "a table of {rows} rows: their number stays below 2³²");
        if (1..rows).all(|row| key(row - 1) <= key(row)) {
            return Self(None);
        }
        let mut order: Vec<u32> = (0..count.unwrap_or(u32::MAX)).collect();
        // the place makes all keys differ: no memory is needed to keep equal ones in their order
        order.par_sort_unstable_by_key(|&row| (key(row as usize), row));
        Self(Some(order))
    }

    /// What `value` gives for some rows of the file, by where they stand.
    pub fn values<T>(&self, rows: Range<usize>, value: impl Fn(usize) -> T) -> Vec<T> {
        match &self.0 {
            None => rows.map(value).collect(),
            Some(order) => order[rows].iter().map(|&row| value(row as usize)).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_one_key_stay_as_they_stand() {
        let keys = [5, 1, 5, 0, 1, 5];
        let order = RowOrder::by_key(keys.len(), |row| keys[row]);
        assert_eq!(order.values(0..6, |row| row), [3, 1, 4, 0, 2, 5]);
        assert_eq!(order.values(1..3, |row| keys[row]), [1, 1]);
    }

    #[test]
    fn sorted_rows_need_no_order() {
        let order = RowOrder::by_key(4, |row| row / 2);
        assert!(order.0.is_none());
        assert_eq!(order.values(1..4, |row| row), [1, 2, 3]);
        assert!(RowOrder::by_key(0, |row| row).values(0..0, |row| row).is_empty());
    }
}
