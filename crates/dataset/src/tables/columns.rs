//! Parquet tables as named, typed columns.
//!
//! Writing is deterministic: the same columns give the same bytes. Reading requests a column by name, type and limits, and errors state the
//! file's content instead.

mod any_numbers;
mod page_sizes;
mod reader;
#[cfg(test)]
mod tests;
mod writer;

pub use reader::{ColumnOutOfLimits, Table};
pub use writer::{TableParts, TableWriter};
