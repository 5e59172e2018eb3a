//! Tables of a TOML script with the lines their keys stand on, and checks that name both.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::schedule::{Interval, ScheduleError};

/// The text of a script and where its lines begin.
pub(super) struct Script<'t> {
    text: &'t str,
    line_starts: Vec<usize>,
}

impl<'t> Script<'t> {
    pub(super) fn new(text: &'t str) -> Self {
        let ends = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        let line_starts = std::iter::once(0).chain(ends.map(|(at, _)| at + 1)).collect();
        Self { text, line_starts }
    }

    /// Line of a byte, from 1.
    pub(super) fn line(&self, at: usize) -> usize {
        self.line_starts.partition_point(|&start| start <= at).max(1)
    }

    /// What the script has there, cut to what a message can hold.
    fn shown(&self, span: std::ops::Range<usize>) -> String {
        shown(self.text.get(span).unwrap_or(""))
    }
}

/// Text cut to what a message can hold: its first line, 40 letters of it.
pub(super) fn shown(text: &str) -> String {
    let first = text.lines().next().unwrap_or("");
    let cut: String = first.chars().take(40).collect();
    if cut.len() < text.len() { format!("{cut} …") } else { cut }
}

/// A table: the whole script, one of its events, or a place where a fire starts.
pub(super) struct Table<'t> {
    script: &'t Script<'t>,
    table: &'t DeTable<'t>,
    line: usize,
    prefix: String,
}

impl<'t> Table<'t> {
    /// The whole script.
    pub(super) fn root(script: &'t Script<'t>, table: &'t DeTable<'t>) -> Self {
        Self { script, table, line: 1, prefix: String::new() }
    }

    /// Refuses keys that are not known here; the first in the script is told.
    pub(super) fn check_keys(&self, known: &[&str]) -> Result<(), ScheduleError> {
        let unknown = self.table.keys().filter(|key| !known.contains(&key.get_ref().as_ref()));
        match unknown.min_by_key(|key| key.span().start) {
            None => Ok(()),
            Some(key) => Err(ScheduleError::UnknownKey {
                line: self.script.line(key.span().start),
                key: format!("{}{}", self.prefix, shown(key.get_ref())),
                known: known.join(", "),
            }),
        }
    }

    /// The value of a key.
    pub(super) fn get(&self, key: &str) -> Option<Entry<'t>> {
        let value = self.table.get(key)?;
        Some(Entry { script: self.script, value, key: format!("{}{key}", self.prefix) })
    }

    /// The value of a key that has to be there.
    pub(super) fn need(&self, key: &str, expected: &str) -> Result<Entry<'t>, ScheduleError> {
        self.get(key).ok_or_else(|| self.missing(key, expected))
    }

    /// Trouble: the key has to be there.
    pub(super) fn missing(&self, key: &str, expected: &str) -> ScheduleError {
        ScheduleError::Missing {
            line: self.line,
            key: format!("{}{key}", self.prefix),
            expected: expected.to_owned(),
        }
    }

    /// The number of a key, or the default.
    pub(super) fn number_or(
        &self,
        key: &str,
        default: f32,
        low: f32,
        high: f32,
    ) -> Result<f32, ScheduleError> {
        self.get(key).map_or(Ok(default), |entry| entry.number(low, high))
    }

    /// The number or `[low, high]` of a key, or the default.
    pub(super) fn interval_or(
        &self,
        key: &str,
        default: Interval<f32>,
        low: f32,
        high: f32,
    ) -> Result<Interval<f32>, ScheduleError> {
        self.get(key).map_or(Ok(default), |entry| entry.interval(low, high))
    }

    /// The whole number or `[low, high]` of a key, or the default.
    pub(super) fn whole_interval_or(
        &self,
        key: &str,
        default: Interval<u16>,
        low: u16,
        high: u16,
    ) -> Result<Interval<u16>, ScheduleError> {
        self.get(key).map_or(Ok(default), |entry| entry.whole_interval(low, high))
    }
}

/// A value and where it stands.
pub(super) struct Entry<'t> {
    script: &'t Script<'t>,
    value: &'t Spanned<DeValue<'t>>,
    key: String,
}

impl<'t> Entry<'t> {
    /// Its line, from 1.
    pub(super) fn line(&self) -> usize {
        self.script.line(self.value.span().start)
    }

    /// Its key, with what leads to it: `ignitions[1].radius_m`.
    pub(super) fn key(&self) -> &str {
        &self.key
    }

    /// What the script has there.
    pub(super) fn shown(&self) -> String {
        self.script.shown(self.value.span())
    }

    fn wrong_kind(&self, expected: &str) -> ScheduleError {
        ScheduleError::WrongKind {
            line: self.line(),
            key: self.key.clone(),
            found: self.shown(),
            expected: expected.to_owned(),
        }
    }

    fn outside(&self, low: f32, high: f32) -> ScheduleError {
        ScheduleError::OutOfRange {
            line: self.line(),
            key: self.key.clone(),
            value: self.shown(),
            low,
            high,
        }
    }

    /// A number within bounds.
    pub(super) fn number(&self, low: f32, high: f32) -> Result<f32, ScheduleError> {
        let value = match self.value.get_ref() {
            DeValue::Float(float) => float.as_str().parse::<f32>().ok(),
            // to the nearest number that an f32 holds
            DeValue::Integer(whole) => Some(
                i64::from_str_radix(whole.as_str(), whole.radix()).map_or(f32::NAN, |v| v as f32),
            ),
            _ => None,
        };
        let value = value.ok_or_else(|| self.wrong_kind(&format!("a number in {low}..={high}")))?;
        // false for NaN
        if (low..=high).contains(&value) { Ok(value) } else { Err(self.outside(low, high)) }
    }

    /// A whole number within bounds.
    pub(super) fn whole(&self, low: u16, high: u16) -> Result<u16, ScheduleError> {
        let DeValue::Integer(whole) = self.value.get_ref() else {
            return Err(self.wrong_kind(&format!("a whole number in {low}..={high}")));
        };
        match u16::from_str_radix(whole.as_str(), whole.radix()) {
            Ok(value) if (low..=high).contains(&value) => Ok(value),
            _ => Err(self.outside(f32::from(low), f32::from(high))),
        }
    }

    /// A number of months; `inf` is the greatest there is, 5,461 years.
    pub(super) fn months(&self, low: u16) -> Result<u16, ScheduleError> {
        match self.value.get_ref() {
            DeValue::Float(float) if float.as_str().parse() == Ok(f32::INFINITY) => Ok(u16::MAX),
            DeValue::Integer(_) => self.whole(low, u16::MAX),
            _ => Err(self.wrong_kind("a whole number of months, or inf")),
        }
    }

    /// A text.
    pub(super) fn text(&self, expected: &str) -> Result<&'t str, ScheduleError> {
        self.value.get_ref().as_str().ok_or_else(|| self.wrong_kind(expected))
    }

    /// The entries of a list of so many.
    pub(super) fn list(
        &self,
        low: usize,
        high: usize,
        expected: &str,
    ) -> Result<Vec<Entry<'t>>, ScheduleError> {
        let list = self.value.get_ref().as_array().ok_or_else(|| self.wrong_kind(expected))?;
        if !(low..=high).contains(&list.len()) {
            let (line, key, count) = (self.line(), self.key.clone(), list.len());
            return Err(ScheduleError::Count { line, key, count, low, high });
        }
        let entry = |(index, value)| Entry {
            script: self.script,
            value,
            key: format!("{}[{}]", self.key, index + 1),
        };
        Ok(list.iter().enumerate().map(entry).collect())
    }

    /// A table of these keys.
    pub(super) fn table(&self, expected: &str) -> Result<Table<'t>, ScheduleError> {
        let table = self.value.get_ref().as_table().ok_or_else(|| self.wrong_kind(expected))?;
        let prefix = format!("{}.", self.key);
        Ok(Table { script: self.script, table, line: self.line(), prefix })
    }

    /// Tables of an array of tables: their keys stand for themselves in messages.
    pub(super) fn tables(&self, most: usize) -> Result<Vec<Table<'t>>, ScheduleError> {
        let expected = format!("tables that begin with [[{}]], in two brackets", self.key);
        let mut tables = Vec::new();
        for entry in self.list(0, most, &expected)? {
            tables.push(Table { prefix: String::new(), ..entry.table(&expected)? });
        }
        Ok(tables)
    }

    /// The two ends of a range; a value alone is both. `None` where it is neither.
    fn ends(&self) -> Option<(Entry<'t>, Entry<'t>)> {
        let entry = |value, key| Entry { script: self.script, value, key };
        match self.value.get_ref() {
            DeValue::Array(list) if list.len() == 2 => {
                let key = |nth| format!("{}[{nth}]", self.key);
                Some((entry(list.first()?, key(1)), entry(list.get(1)?, key(2))))
            }
            DeValue::Integer(_) | DeValue::Float(_) => {
                Some((entry(self.value, self.key.clone()), entry(self.value, self.key.clone())))
            }
            _ => None,
        }
    }

    /// A number or `[from, to]`, in whichever order.
    pub(super) fn pair(&self, low: f32, high: f32) -> Result<(f32, f32), ScheduleError> {
        let expected = format!("a number in {low}..={high}, or two: [from, to]");
        let (from, to) = self.ends().ok_or_else(|| self.wrong_kind(&expected))?;
        Ok((from.number(low, high)?, to.number(low, high)?))
    }

    /// A number or `[low, high]`.
    pub(super) fn interval(&self, low: f32, high: f32) -> Result<Interval<f32>, ScheduleError> {
        let (from, to) = self.pair(low, high)?;
        self.ordered(from, to)
    }

    /// A whole number or `[low, high]`.
    pub(super) fn whole_interval(
        &self,
        low: u16,
        high: u16,
    ) -> Result<Interval<u16>, ScheduleError> {
        let expected = format!("a whole number in {low}..={high}, or two: [low, high]");
        let (from, to) = self.ends().ok_or_else(|| self.wrong_kind(&expected))?;
        self.ordered(from.whole(low, high)?, to.whole(low, high)?)
    }

    /// An interval whose ends are in order.
    pub(super) fn ordered<T: PartialOrd + ToString>(
        &self,
        low: T,
        high: T,
    ) -> Result<Interval<T>, ScheduleError> {
        if low <= high {
            return Ok(Interval { low, high });
        }
        Err(ScheduleError::OutOfOrder {
            line: self.line(),
            key: self.key.clone(),
            low: low.to_string(),
            high: high.to_string(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_count_from_one() {
        let script = Script::new("a\n\nbc\n");
        let lines: Vec<usize> = (0..7).map(|at| script.line(at)).collect();
        assert_eq!(lines, [1, 1, 2, 3, 3, 3, 4]);
        assert_eq!(Script::new("").line(0), 1);
    }

    #[test]
    fn what_is_shown_is_short() {
        assert_eq!(shown("12"), "12");
        assert_eq!(shown("[1,\n2]"), "[1, …");
        assert_eq!(shown(&"é".repeat(50)), format!("{} …", "é".repeat(40)));
    }
}
