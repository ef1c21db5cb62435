//! Tables whose rows are about images, each of one view at one tick.

use std::path::Path;

use crate::error::Result;
use crate::tables::columns::{ColumnOutOfLimits, Table, TableWriter};
use crate::work::memory;

/// Bytes of a row's texts in memory.
const TEXT_BYTES: usize = 96;

/// A row about an image.
pub trait ImageRow: Sized {
    /// Name of the rows in messages.
    const NAME: &'static str;
    /// Maximum number of rows per image.
    const MAX_PER_IMAGE: u64 = 1;

    /// The table of these rows, with its columns.
    fn columns(rows: &[Self]) -> TableWriter;

    /// The rows of a table.
    ///
    /// # Errors
    /// A column is missing, a number is outside its limits, a word is unknown, or a row has only some of its numbers.
    fn of_table(table: &mut Table) -> Result<Vec<Self>>;

    /// Writes the rows if all numbers are within their limits.
    fn write(rows: &[Self], path: &Path) -> Result<()> {
        Self::columns(rows).write(path)
    }

    /// Reads a table's content for this number of images; messages name it as `path`.
    ///
    /// # Errors
    /// See [`Self::of_table`]; also fails if there are too many rows.
    fn parse(content: Vec<u8>, path: &Path, images: u64) -> Result<Vec<Self>> {
        let mut table = Table::parse(content, path, max_rows::<Self>(images))?;
        rows_of(&mut table)
    }

    /// Like [`Self::parse`], but collects numbers outside their limits.
    fn read_with_faults(path: &Path, images: u64) -> Result<(Vec<Self>, Vec<ColumnOutOfLimits>)> {
        Table::read_with_faults(path, max_rows::<Self>(images), rows_of)
    }
}

fn max_rows<R: ImageRow>(images: u64) -> u64 {
    images.saturating_mul(R::MAX_PER_IMAGE)
}

fn rows_of<R: ImageRow>(table: &mut Table) -> Result<Vec<R>> {
    let row_bytes = 2 * size_of::<R>() + TEXT_BYTES;
    let bytes = (table.rows() * row_bytes) as u64;
    memory::check(format_args!("table of {}", R::NAME), bytes)?;
    R::of_table(table)
}
