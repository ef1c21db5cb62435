//! Parts of a row that several tables share: structs of numbers with a column per field, and enums with a word per variant.

use std::fmt::Display;

use crate::error::{Error, Result};
use crate::numbers::limits::Limits;
use crate::tables::columns::{Table, TableWriter};

/// Name of a column of numbers, and its limits.
pub(crate) type NumberColumn<S = &'static str> = (S, Limits);

/// A struct of `N` numbers. Each has a column with the name of its field.
pub(crate) trait Numbers<const N: usize>: Copy {
    const COLUMNS: [NumberColumn; N];

    fn to_array(self) -> [f64; N];

    fn of_array(numbers: [f64; N]) -> Self;
}

/// Implements [`Numbers`] for a struct: its number of fields, and the fields with their limits.
macro_rules! numbers {
    ($type:ident, $count:literal, { $($field:ident: $limits:expr),+ $(,)? }) => {
        impl $crate::tables::row_parts::Numbers<$count> for $type {
            const COLUMNS: [$crate::tables::row_parts::NumberColumn; $count] =
                [$((stringify!($field), $limits)),+];

            fn to_array(self) -> [f64; $count] {
                [$(self.$field),+]
            }

            fn of_array([$($field),+]: [f64; $count]) -> Self {
                Self { $($field),+ }
            }
        }
    };
}
pub(crate) use numbers;

/// An enum that a column holds as a word.
pub(crate) trait Word: Copy + Display + 'static {
    const WORDS: &'static [(&'static str, Self)];
}

/// Gives an enum its words: the list of all variants, the word of each, and its text.
macro_rules! words {
    ($type:ident, $count:literal, { $($variant:ident: $word:literal),+ $(,)? }) => {
        impl $type {
            /// All variants.
            pub const ALL: [Self; $count] = [$(Self::$variant),+];

            /// The variant's word in the table.
            pub fn word(self) -> &'static str {
                match self {
                    $(Self::$variant => $word),+
                }
            }
        }

        impl $crate::tables::row_parts::Word for $type {
            const WORDS: &'static [(&'static str, Self)] = &[$(($word, Self::$variant)),+];
        }

        impl std::fmt::Display for $type {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.word())
            }
        }
    };
}
pub(crate) use words;

impl TableWriter {
    /// Adds a column of floats for each number of the rows.
    pub(crate) fn numbers<const N: usize>(
        self,
        columns: [NumberColumn<impl AsRef<str>>; N],
        rows: impl Iterator<Item = [f64; N]> + Clone,
    ) -> Self {
        let columns = columns.iter().enumerate();
        columns.fold(self, |table, (at, (name, limits))| {
            let numbers = rows.clone().map(move |row| row[at]);
            table.f64_within(name.as_ref(), *limits, numbers)
        })
    }

    /// Adds a column of floats for each number of the rows, which may have none.
    pub(crate) fn optional_numbers<const N: usize>(
        self,
        columns: [NumberColumn; N],
        rows: impl Iterator<Item = Option<[f64; N]>> + Clone,
    ) -> Self {
        let columns = columns.into_iter().enumerate();
        columns.fold(self, |table, (at, (name, limits))| {
            let numbers = rows.clone().map(move |row| Some(row?[at]));
            table.optional_f64_within(name, limits, numbers)
        })
    }
}

impl Table {
    /// The numbers of each row from these columns.
    pub(crate) fn numbers<const N: usize>(
        &mut self,
        columns: [NumberColumn<impl AsRef<str>>; N],
    ) -> Result<Vec<[f64; N]>> {
        let mut rows = vec![[0.0; N]; self.rows()];
        for (at, (name, limits)) in columns.iter().enumerate() {
            let numbers = self.f64_within(name.as_ref(), *limits)?;
            rows.iter_mut()
                .zip(numbers)
                .for_each(|(row, number)| row[at] = number);
        }
        Ok(rows)
    }

    /// The numbers of each row from these columns, or their count if some are missing.
    pub(crate) fn optional_numbers<const N: usize>(
        &mut self,
        columns: [NumberColumn; N],
    ) -> Result<Vec<std::result::Result<[f64; N], usize>>> {
        let mut rows = vec![([0.0; N], 0); self.rows()];
        for (at, (name, limits)) in columns.into_iter().enumerate() {
            let numbers = self.optional_f64_within(name, limits)?;
            for ((row, count), number) in rows.iter_mut().zip(numbers) {
                *count += usize::from(number.is_some());
                row[at] = number.unwrap_or_default();
            }
        }
        let whole = |(row, count)| if count == N { Ok(row) } else { Err(count) };
        Ok(rows.into_iter().map(whole).collect())
    }

    /// A column of words that may be missing.
    pub(crate) fn optional_words<W: Word>(&self, column: &str) -> Result<Vec<Option<W>>> {
        let words = self.optional_text(column)?.into_iter().enumerate();
        words
            .map(|(row, word)| {
                word.map(|word| self.meaning(column, row, &word))
                    .transpose()
            })
            .collect()
    }

    /// A column of words without gaps.
    pub(crate) fn words<W: Word>(&self, column: &str) -> Result<Vec<W>> {
        let words = self.text(column)?.into_iter().enumerate();
        words
            .map(|(row, word)| self.meaning(column, row, &word))
            .collect()
    }

    /// Error about a row that has neither all numbers nor a reason for having none. `counts`: its numbers, and all.
    pub(crate) fn neither_whole_nor_absent<W: Word>(
        &self,
        row: usize,
        [count, all]: [usize; 2],
        reason: Option<W>,
    ) -> Error {
        let reason = reason.map_or("no reason".into(), |word| format!("reason \"{word}\""));
        self.fault(format!(
            "row {row} has {count} of {all} numbers and {reason}, expected all numbers, or none and a reason"
        ))
    }

    fn meaning<W: Word>(&self, column: &str, row: usize, word: &str) -> Result<W> {
        let known = W::WORDS.iter().find(|(known, _)| *known == word);
        known.map(|(_, meaning)| *meaning).ok_or_else(|| {
            let known: Vec<_> = W::WORDS.iter().map(|(known, _)| *known).collect();
            let known = known.join(", ");
            self.fault(format!(
                "row {row}: {column} is {word:?}, expected one of {known}"
            ))
        })
    }
}
