//! Reads columns by name, type and limits.
//!
//! Sizes that a file declares are checked before anything is decoded: a megabyte may decompress to gigabytes.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::types::Int32Type;
use arrow_array::{
    Array, ArrayRef, BinaryArray, BooleanArray, DictionaryArray, Float64Array, Int64Array,
    RecordBatch, StringArray, UInt32Array, UInt64Array,
};
use arrow_schema::{DataType, Field, Schema};
use bytes::Bytes;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder,
};
use parquet::basic::Compression;
use parquet::errors::ParquetError;

use super::page_sizes;
use crate::error::{Error, Result};
use crate::files::others_decoder;
use crate::files::outside_file::{self, FileKind};
use crate::numbers::limits::{FieldOutOfLimits, Limits, OutOfLimits};
use crate::work::memory;

/// Table columns: sixteen for each of some dozens of views.
const MAX_COLUMNS: usize = 2_048;
/// Identifiers of views and the like are file names.
const MAX_TEXT_BYTES: usize = 255;
/// Tables that need more memory than [`UNSUSPICIOUS_BYTES`] are larger on disk than this part: measured numbers hardly compress. One value
/// that is repeated millions of times takes thousands of times its size.
const MAX_EXPANSION: u64 = 200;
/// Memory that any table may need.
pub(super) const UNSUSPICIOUS_BYTES: u64 = 64 << 20;
/// Rows decoded at once.
const BATCH_ROWS: usize = 1_024;

/// True if pages of this compression can be read.
fn is_readable(codec: Compression) -> bool {
    matches!(
        codec,
        Compression::ZSTD(_) | Compression::SNAPPY | Compression::UNCOMPRESSED
    )
}

/// A table that was read.
pub struct Table {
    path: PathBuf,
    schema: Arc<Schema>,
    batches: Vec<RecordBatch>,
    /// Collects numbers outside their limits instead of failing, if set.
    collected: Option<Vec<ColumnOutOfLimits>>,
}

/// A column with numbers outside their limits.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnOutOfLimits {
    /// Name of the column.
    pub column: String,
    /// The first numbers, with their rows.
    pub first: Vec<(usize, OutOfLimits)>,
    /// Total number.
    pub count: usize,
}

/// Maximum number of values listed per column; the others are counted.
const NAMED: usize = 3;

impl Table {
    /// Reads a Parquet file; one with more rows than `most_rows` is rejected before any is decoded. The first number outside its limits
    /// ends the reading.
    pub fn read(path: &Path, most_rows: u64) -> Result<Self> {
        Self::parse(outside_file::read(path, FileKind::TABLE)?, path, most_rows)
    }

    /// Reads a file's bytes like [`Self::read`]; messages name it as `path`.
    pub fn parse(bytes: Vec<u8>, path: &Path, most_rows: u64) -> Result<Self> {
        let decoded = others_decoder::guarded(|| Self::decode(bytes, path, most_rows));
        decoded.map_err(|error| Error::table(path, error))?
    }

    fn decode(bytes: Vec<u8>, path: &Path, most_rows: u64) -> Result<Self> {
        let refused = |e: ParquetError| Error::table(path, e);
        let bytes = Bytes::from(bytes);
        let metadata =
            ArrowReaderMetadata::load(&bytes, ArrowReaderOptions::new()).map_err(refused)?;
        let rows = metadata.metadata().file_metadata().num_rows();
        let rows = u64::try_from(rows).unwrap_or(u64::MAX);
        if rows > most_rows {
            return Err(Error::table(
                path,
                format!("has {rows} rows, expected at most {most_rows}"),
            ));
        }
        let groups = metadata.metadata().row_groups().iter();
        let mut codecs = groups
            .flat_map(|group| group.columns())
            .map(|column| column.compression());
        if let Some(codec) = codecs.find(|codec| !is_readable(*codec)) {
            let codec = codec.to_string();
            // Without its level.
            let codec = codec.split('(').next().unwrap_or_default();
            return Err(Error::table(
                path,
                format!(
                    "is compressed with {codec}, expected zstd, snappy or none; write it again with one of these"
                ),
            ));
        }
        let schema = readable(metadata.schema()).map_err(|message| Error::table(path, message))?;
        let of_rows = rows.saturating_mul(schema.fields().iter().map(bytes_of).sum());
        // A few rows may have long texts.
        let of_pages = page_sizes::decompressed_bytes(&bytes, metadata.metadata());
        let of_pages =
            of_pages.ok_or_else(|| Error::table(path, "its pages do not fill its columns"))?;
        let needed = of_rows.max(of_pages);
        let size = bytes.len() as u64;
        if needed > UNSUSPICIOUS_BYTES.max(size.saturating_mul(MAX_EXPANSION)) {
            return Err(Error::table(
                path,
                format!(
                    "has {} on disk and would take about {} of memory, expected at most {MAX_EXPANSION} times its size: it was made to fill \
                     the memory, and is not read",
                    memory::Bytes(size),
                    memory::Bytes(needed)
                ),
            ));
        }
        memory::check(format!("table {}", path.display()), needed)?;
        let options = ArrowReaderOptions::new().with_schema(schema.clone());
        let reader = ParquetRecordBatchReaderBuilder::try_new_with_options(bytes, options)
            .map_err(refused)?
            .with_batch_size(BATCH_ROWS)
            .build()
            .map_err(refused)?;
        let mut batches = Vec::new();
        let mut left = rows;
        for batch in reader {
            let batch = batch.map_err(|e| Error::table(path, e))?;
            // The metadata may be wrong.
            left = left.checked_sub(batch.num_rows() as u64).ok_or_else(|| {
                Error::table(
                    path,
                    format!("has more rows than the {rows} that it claims"),
                )
            })?;
            batches.push(batch);
        }
        Ok(Self {
            path: path.to_owned(),
            schema,
            batches,
            collected: None,
        })
    }

    /// Reads a file's rows with all numbers outside their limits instead of ending at the first: for finding all faults.
    pub(crate) fn read_with_faults<T>(
        path: &Path,
        most_rows: u64,
        rows_of: impl FnOnce(&mut Self) -> Result<T>,
    ) -> Result<(T, Vec<ColumnOutOfLimits>)> {
        let mut table = Self {
            collected: Some(Vec::new()),
            ..Self::read(path, most_rows)?
        };
        let rows = rows_of(&mut table)?;
        Ok((rows, table.collected.unwrap_or_default()))
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.batches.iter().map(RecordBatch::num_rows).sum()
    }

    /// True if a column of this name exists.
    pub fn has(&self, column: &str) -> bool {
        self.schema.column_with_name(column).is_some()
    }

    /// Names of all columns, in order.
    pub fn column_names(&self) -> impl Iterator<Item = &str> {
        self.schema
            .fields()
            .iter()
            .map(|field| field.name().as_str())
    }

    /// A column of floats without gaps.
    pub fn f64(&self, column: &str) -> Result<Vec<f64>> {
        self.whole::<Float64Array, _>(column, "f64")
    }

    /// A column of signed integers without gaps.
    pub fn i64(&self, column: &str) -> Result<Vec<i64>> {
        self.whole::<Int64Array, _>(column, "i64")
    }

    /// A column of unsigned 32-bit integers without gaps.
    pub fn u32(&self, column: &str) -> Result<Vec<u32>> {
        self.whole::<UInt32Array, _>(column, "u32")
    }

    /// A column of unsigned 64-bit integers without gaps.
    pub fn u64(&self, column: &str) -> Result<Vec<u64>> {
        self.whole::<UInt64Array, _>(column, "u64")
    }

    /// A column of booleans without gaps.
    pub fn bool(&self, column: &str) -> Result<Vec<bool>> {
        self.whole::<BooleanArray, _>(column, "bool")
    }

    /// A column of strings without gaps.
    pub fn text(&self, column: &str) -> Result<Vec<String>> {
        let words = self.optional_text(column)?.into_iter();
        words
            .map(|word| word.ok_or_else(|| self.missing(column, 1)))
            .collect()
    }

    /// A column of strings that may be missing.
    pub fn optional_text(&self, column: &str) -> Result<Vec<Option<String>>> {
        let mut values = Vec::with_capacity(self.rows());
        for array in self.arrays(column)? {
            let typed = array.as_any().downcast_ref::<DictionaryArray<Int32Type>>();
            let words = typed.and_then(|typed| typed.downcast_dict::<StringArray>());
            let words = words.ok_or_else(|| self.wrong_type(column, "text", array))?;
            for word in words {
                if let Some(word) = word
                    && word.len() > MAX_TEXT_BYTES
                {
                    return Err(self.fault(format!(
                        "column {column} has a text of {} bytes in row {}, expected at most {MAX_TEXT_BYTES}",
                        word.len(),
                        values.len()
                    )));
                }
                values.push(word.map(str::to_owned));
            }
        }
        Ok(values)
    }

    /// A column of files, such as images, without gaps.
    pub fn bytes(&self, column: &str) -> Result<Vec<Vec<u8>>> {
        let mut values = Vec::with_capacity(self.rows());
        for array in self.arrays(column)? {
            let typed = array.as_any().downcast_ref::<DictionaryArray<Int32Type>>();
            let files = typed.and_then(|typed| typed.downcast_dict::<BinaryArray>());
            let files = files.ok_or_else(|| self.wrong_type(column, "binary", array))?;
            for file in files {
                let file = file.ok_or_else(|| self.missing(column, 1))?;
                values.push(file.to_vec());
            }
        }
        Ok(values)
    }

    /// A column of floats with limits and without gaps.
    pub(crate) fn f64_within(&mut self, column: &str, limits: Limits) -> Result<Vec<f64>> {
        let values = self.f64(column)?;
        self.look_at(column, limits, values.iter().copied().map(Some))?;
        Ok(values)
    }

    /// A column of floats with limits that may be missing.
    pub(crate) fn optional_f64_within(
        &mut self,
        column: &str,
        limits: Limits,
    ) -> Result<Vec<Option<f64>>> {
        let values = self.optional_f64(column)?;
        self.look_at(column, limits, values.iter().copied())?;
        Ok(values)
    }

    fn look_at(
        &mut self,
        column: &str,
        limits: Limits,
        values: impl Iterator<Item = Option<f64>>,
    ) -> Result<()> {
        let mut outside = values
            .enumerate()
            .filter_map(|(row, value)| Some((row, limits.check(value?).err()?)));
        match &mut self.collected {
            None => match outside.next() {
                None => Ok(()),
                Some((row, number)) => {
                    let field = column.to_owned();
                    let fault = FieldOutOfLimits { field, number };
                    Err(Error::out_of_limits(&self.path, Some(row), fault))
                }
            },
            Some(collected) => {
                let first: Vec<_> = outside.by_ref().take(NAMED).collect();
                let count = first.len() + outside.count();
                if count > 0 {
                    collected.push(ColumnOutOfLimits {
                        column: column.to_owned(),
                        first,
                        count,
                    });
                }
                Ok(())
            }
        }
    }

    /// A column of floats that may be missing.
    pub fn optional_f64(&self, column: &str) -> Result<Vec<Option<f64>>> {
        self.optional::<Float64Array, _>(column, "f64")
    }

    /// A column of unsigned 32-bit integers that may be missing.
    pub fn optional_u32(&self, column: &str) -> Result<Vec<Option<u32>>> {
        self.optional::<UInt32Array, _>(column, "u32")
    }

    /// A column of signed integers that may be missing.
    pub fn optional_i64(&self, column: &str) -> Result<Vec<Option<i64>>> {
        self.optional::<Int64Array, _>(column, "i64")
    }

    /// The values of a column of arrays of this type, which is called `word` in messages.
    fn optional<A: Array + 'static, V>(&self, column: &str, word: &str) -> Result<Vec<Option<V>>>
    where
        for<'a> &'a A: IntoIterator<Item = Option<V>>,
    {
        let mut values = Vec::with_capacity(self.rows());
        for array in self.arrays(column)? {
            let typed = array.as_any().downcast_ref::<A>();
            values.extend(typed.ok_or_else(|| self.wrong_type(column, word, array))?);
        }
        Ok(values)
    }

    fn whole<A: Array + 'static, V>(&self, column: &str, word: &str) -> Result<Vec<V>>
    where
        for<'a> &'a A: IntoIterator<Item = Option<V>>,
    {
        let values = self.optional::<A, V>(column, word)?;
        match values.iter().filter(|value| value.is_none()).count() {
            0 => Ok(values.into_iter().flatten().collect()),
            missing => Err(self.missing(column, missing)),
        }
    }

    /// An error about this table.
    pub fn fault(&self, message: impl ToString) -> Error {
        Error::table(&self.path, message)
    }

    pub(super) fn wrong_type(&self, column: &str, expected: &str, found: &ArrayRef) -> Error {
        let found = found.data_type();
        self.fault(format!(
            "column {column} should hold {expected}, but holds {found}"
        ))
    }

    fn missing(&self, column: &str, count: usize) -> Error {
        self.fault(format!(
            "column {column} has {count} missing values, expected none"
        ))
    }

    pub(super) fn arrays(&self, column: &str) -> Result<Vec<&ArrayRef>> {
        if !self.has(column) {
            let names = self.column_names().collect::<Vec<_>>().join(", ");
            return Err(self.fault(format!("has no column {column}; its columns are {names}")));
        }
        Ok(self
            .batches
            .iter()
            .filter_map(|batch| batch.column_by_name(column))
            .collect())
    }
}

/// The schema for reading a file's columns, or the reason why they are rejected. Strings are read through their dictionary, so that a long
/// repeated one takes its memory once; nested columns are rejected.
fn readable(schema: &Schema) -> std::result::Result<Arc<Schema>, String> {
    let columns = schema.fields().len();
    if columns > MAX_COLUMNS {
        return Err(format!(
            "has {columns} columns, expected at most {MAX_COLUMNS}"
        ));
    }
    let field = |field: &Arc<Field>| {
        let read_as = match field.data_type() {
            DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View => {
                DataType::Dictionary(DataType::Int32.into(), DataType::Utf8.into())
            }
            plain if plain.is_primitive() || *plain == DataType::Boolean => plain.clone(),
            // A value that is repeated takes no more memory, as of text.
            DataType::Binary | DataType::LargeBinary | DataType::BinaryView => {
                DataType::Dictionary(DataType::Int32.into(), DataType::Binary.into())
            }
            DataType::Dictionary(_, value)
                if matches!(**value, DataType::Utf8 | DataType::LargeUtf8) =>
            {
                DataType::Dictionary(DataType::Int32.into(), DataType::Utf8.into())
            }
            other => {
                return Err(format!(
                    "column {} holds {other}, expected numbers, booleans, text or binary",
                    field.name()
                ));
            }
        };
        Ok(Field::new(field.name(), read_as, field.is_nullable()))
    };
    let fields: std::result::Result<Vec<_>, String> = schema.fields().iter().map(field).collect();
    Ok(Arc::new(Schema::new(fields?)))
}

/// Memory per column value while it is read and as it is returned.
fn bytes_of(field: &Arc<Field>) -> u64 {
    match field.data_type() {
        DataType::Boolean => 2,
        DataType::Dictionary(..) => 64,
        plain => 3 * plain.primitive_width().unwrap_or(8) as u64,
    }
}
