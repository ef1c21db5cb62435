//! Parquet tables as named, typed columns.
//!
//! Writing is deterministic: the same columns give the same bytes. Reading requests a column by name, type and limits, and errors state the
//! file's content instead. Sizes that a file declares are checked before anything is decoded: a megabyte may decompress to gigabytes.

mod any_numbers;
mod page_sizes;

use std::collections::HashMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::types::Int32Type;
use arrow_array::{
    Array, ArrayRef, BinaryArray, BooleanArray, DictionaryArray, Float64Array, Int64Array,
    RecordBatch, StringArray, UInt32Array, UInt64Array,
};
use arrow_schema::{DataType, Field, Schema};
use bytes::Bytes;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder,
};
use parquet::basic::{Compression, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::schema::types::ColumnPath;

use crate::error::{Error, Result};
use crate::files::new_file::NewFile;
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
const UNSUSPICIOUS_BYTES: u64 = 64 << 20;
/// Rows decoded at once.
const BATCH_ROWS: usize = 1_024;

/// Collects columns and writes them as one Parquet file.
#[derive(Default)]
pub struct TableWriter {
    fields: Vec<Field>,
    arrays: Vec<ArrayRef>,
    limits: HashMap<String, Limits>,
    out_of_limits: Option<(usize, FieldOutOfLimits)>,
}

impl TableWriter {
    /// An empty table.
    pub fn new() -> Self {
        Self::default()
    }

    fn push(mut self, name: &str, nullable: bool, array: impl Array + 'static) -> Self {
        self.fields
            .push(Field::new(name, array.data_type().clone(), nullable));
        self.arrays.push(Arc::new(array));
        self
    }

    /// Adds a column of floats.
    pub fn f64(self, name: &str, values: impl IntoIterator<Item = f64>) -> Self {
        self.push(name, false, Float64Array::from_iter_values(values))
    }

    /// Adds a column of floats that may be missing.
    pub fn optional_f64(self, name: &str, values: impl IntoIterator<Item = Option<f64>>) -> Self {
        self.push(name, true, Float64Array::from_iter(values))
    }

    /// Adds a column of floats with limits; a table with values outside them is not written.
    pub(crate) fn f64_within(
        mut self,
        name: &str,
        limits: Limits,
        values: impl IntoIterator<Item = f64> + Clone,
    ) -> Self {
        self.look_at(name, limits, values.clone().into_iter().map(Some));
        self.f64(name, values)
    }

    /// Adds a column of floats with limits that may be missing.
    pub(crate) fn optional_f64_within(
        mut self,
        name: &str,
        limits: Limits,
        values: impl IntoIterator<Item = Option<f64>> + Clone,
    ) -> Self {
        self.look_at(name, limits, values.clone());
        self.optional_f64(name, values)
    }

    /// The table with unchecked numbers, as a different program may write it.
    #[cfg(test)]
    pub(crate) fn unchecked(self) -> Self {
        Self {
            out_of_limits: None,
            ..self
        }
    }

    fn check(&self, path: &Path) -> Result<()> {
        match &self.out_of_limits {
            None => Ok(()),
            Some((row, fault)) => Err(Error::out_of_limits(path, Some(*row), fault.clone())),
        }
    }

    fn look_at(
        &mut self,
        name: &str,
        limits: Limits,
        values: impl IntoIterator<Item = Option<f64>>,
    ) {
        self.limits.insert(name.to_owned(), limits);
        let mut values = values.into_iter().enumerate();
        if self.out_of_limits.is_none() {
            self.out_of_limits = values.find_map(|(row, value)| {
                let number = limits.check(value?).err()?;
                let field = name.to_owned();
                Some((row, FieldOutOfLimits { field, number }))
            });
        }
    }

    /// Adds a column of signed integers.
    pub fn i64(self, name: &str, values: impl IntoIterator<Item = i64>) -> Self {
        self.push(name, false, Int64Array::from_iter_values(values))
    }

    /// Adds a column of unsigned 32-bit integers.
    pub fn u32(self, name: &str, values: impl IntoIterator<Item = u32>) -> Self {
        self.push(name, false, UInt32Array::from_iter_values(values))
    }

    /// Adds a column of unsigned 32-bit integers that may be missing.
    pub fn optional_u32(self, name: &str, values: impl IntoIterator<Item = Option<u32>>) -> Self {
        self.push(name, true, UInt32Array::from_iter(values))
    }

    /// Adds a column of unsigned 64-bit integers.
    pub fn u64(self, name: &str, values: impl IntoIterator<Item = u64>) -> Self {
        self.push(name, false, UInt64Array::from_iter_values(values))
    }

    /// Adds a column of booleans.
    pub fn bool(self, name: &str, values: impl IntoIterator<Item = bool>) -> Self {
        self.push(
            name,
            false,
            BooleanArray::from_iter(values.into_iter().map(Some)),
        )
    }

    /// Adds a column of strings.
    pub fn text<S: AsRef<str>>(self, name: &str, values: impl IntoIterator<Item = S>) -> Self {
        self.push(name, false, StringArray::from_iter_values(values))
    }

    /// Adds a column of strings that may be missing.
    pub fn optional_text<S: AsRef<str>>(
        self,
        name: &str,
        values: impl IntoIterator<Item = Option<S>>,
    ) -> Self {
        self.push(name, true, StringArray::from_iter(values))
    }

    /// Adds a column of files, such as images.
    pub fn bytes<B: AsRef<[u8]>>(self, name: &str, values: impl IntoIterator<Item = B>) -> Self {
        self.push(name, false, BinaryArray::from_iter_values(values))
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.arrays.first().map_or(0, |array| array.len())
    }

    /// The columns, in order, with their limits.
    pub fn columns(&self) -> impl Iterator<Item = (&Field, Option<Limits>)> {
        let with_limits = move |field| (field, self.limits.get(Field::name(field)).copied());
        self.fields.iter().map(with_limits)
    }

    /// Writes the file (zstd, one row group per million rows), atomically.
    ///
    /// # Errors
    /// A number is outside its limits, or an I/O error.
    pub fn write(self, path: &Path) -> Result<()> {
        let mut parts = TableParts::new(path);
        parts.add(self)?;
        parts.finish()
    }
}

/// Memory for rows that are not yet in the file, bytes.
const MAX_KEPT: usize = 16 << 20;

/// A table that is written part by part, because the whole does not fit into memory.
pub struct TableParts {
    path: PathBuf,
    writer: Option<(NewFile, ArrowWriter<File>)>,
}

impl TableParts {
    /// A table without parts; no file is written yet.
    pub fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            writer: None,
        }
    }

    /// Adds rows; every part has the columns of the first.
    ///
    /// # Errors
    /// A number is outside its limits, or an I/O error.
    pub fn add(&mut self, part: TableWriter) -> Result<()> {
        part.check(&self.path)?;
        let failed = |error| not_written(&self.path, error);
        let schema = Arc::new(Schema::new(part.fields));
        let batch = RecordBatch::try_new(schema.clone(), part.arrays)
            .map_err(|error| Error::table(&self.path, error))?;
        let (_, writer) = match &mut self.writer {
            Some(writer) => writer,
            none => {
                let properties = WriterProperties::builder()
                    .set_compression(Compression::ZSTD(ZstdLevel::default()))
                    .set_created_by(format!("dtd {}", env!("CARGO_PKG_VERSION")));
                let measured = schema.fields().iter();
                let measured = measured.filter(|field| field.data_type() == &DataType::Float64);
                // Measured numbers hardly repeat: a dictionary takes four times their memory.
                let properties = measured.fold(properties, |properties, field| {
                    let column = ColumnPath::from(field.name().as_str());
                    properties.set_column_dictionary_enabled(column, false)
                });
                let properties = properties.build();
                let mut file = NewFile::create(&self.path)?;
                let opened = file.file().try_clone();
                let opened = opened.map_err(Error::io("write", &self.path))?;
                let writer = ArrowWriter::try_new(opened, schema, Some(properties));
                none.insert((file, writer.map_err(failed)?))
            }
        };
        writer.write(&batch).map_err(failed)?;
        if writer.memory_size() > MAX_KEPT {
            writer.flush().map_err(failed)?;
        }
        Ok(())
    }

    /// Puts the file into its place, atomically.
    ///
    /// # Errors
    /// An I/O error.
    pub fn finish(self) -> Result<()> {
        self.written()?.map_or(Ok(()), NewFile::commit)
    }

    /// Puts the file into its place unless something exists there.
    ///
    /// # Errors
    /// Something exists at its path ([`Error::is_taken`]), or an I/O error.
    pub fn finish_new(self) -> Result<()> {
        self.written()?.map_or(Ok(()), NewFile::commit_new)
    }

    /// The complete file, not in its place yet.
    fn written(self) -> Result<Option<NewFile>> {
        let Some((file, writer)) = self.writer else {
            return Ok(None);
        };
        let closed = writer.close();
        closed.map_err(|error| not_written(&self.path, error))?;
        Ok(Some(file))
    }
}

/// True if pages of this compression can be read.
fn is_readable(codec: Compression) -> bool {
    matches!(
        codec,
        Compression::ZSTD(_) | Compression::SNAPPY | Compression::UNCOMPRESSED
    )
}

/// Error while a table is written: usually one of the disk, which is not the fault of the content.
fn not_written(path: &Path, error: ParquetError) -> Error {
    match error {
        ParquetError::External(source) => match source.downcast::<io::Error>() {
            Ok(source) => Error::io("write", path)(*source),
            Err(source) => Error::table(path, source),
        },
        error => Error::table(path, error),
    }
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

    fn wrong_type(&self, column: &str, expected: &str, found: &ArrayRef) -> Error {
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

    fn arrays(&self, column: &str) -> Result<Vec<&ArrayRef>> {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A table with one repeated value, which takes almost no space on disk.
    fn bomb(path: &Path, rows: usize) -> u64 {
        let values = std::iter::repeat_n("left", rows);
        TableWriter::new().text("view", values).write(path).unwrap();
        path.metadata().unwrap().len()
    }

    #[test]
    fn a_table_in_parts_has_the_rows_of_all_and_without_any_there_is_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let [whole, parts, none] = ["whole", "parts", "none"].map(|name| folder.path().join(name));
        let table = |rows: std::ops::Range<u32>| {
            let missing = rows
                .clone()
                .map(|row| (row % 7 > 0).then_some(f64::from(row)));
            TableWriter::new()
                .u32("tick", rows)
                .optional_f64("dtd_m", missing)
        };
        table(0..3_000).write(&whole).unwrap();
        let mut writer = TableParts::new(&parts);
        for part in [0..1_000, 1_000..1_000, 1_000..3_000] {
            writer.add(table(part)).unwrap();
        }
        writer.finish().unwrap();
        let read = |path: &Path| {
            let table = Table::read(path, u64::MAX).unwrap();
            (
                table.u32("tick").unwrap(),
                table.optional_f64("dtd_m").unwrap(),
            )
        };
        assert_eq!(read(&whole), read(&parts));
        TableParts::new(&none).finish().unwrap();
        assert!(!none.exists());
    }

    #[test]
    fn a_table_of_an_unreadable_compression_is_refused_with_the_readable_ones() {
        // pq.write_table(pa.table({"tick": pa.array([1], pa.uint32())}), "gzip.parquet", compression="gzip", store_schema=False)
        let bytes = include_bytes!("columns/gzip.parquet").to_vec();
        let refused = Table::parse(bytes, Path::new("frames.parquet"), 1).err();
        let message = refused.unwrap().to_string();
        let expected = "frames.parquet: is compressed with GZIP, expected zstd, snappy or none";
        assert!(message.contains(expected), "{message}");
    }

    #[test]
    fn a_table_with_more_rows_than_it_may_have_is_refused_before_it_unfolds() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("boxes.parquet");
        let bytes = bomb(&path, 3_000_000);
        assert!(bytes < 100_000, "{bytes}");
        let message = Table::read(&path, 1_000).err().unwrap().to_string();
        assert!(
            message.contains("has 3000000 rows, expected at most 1000"),
            "{message}"
        );
    }

    #[test]
    fn a_small_file_that_would_fill_the_memory_is_refused_and_measured_numbers_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("predictions.parquet");
        let most_rows = (UNSUSPICIOUS_BYTES / 64) as usize;
        bomb(&path, most_rows);
        assert!(Table::read(&path, u64::MAX).is_ok());
        bomb(&path, most_rows + 1);
        let message = Table::read(&path, u64::MAX).err().unwrap().to_string();
        assert!(
            message.contains("64.0 MiB of memory, expected at most 200 times its size"),
            "{message}"
        );
        let long = "x".repeat(UNSUSPICIOUS_BYTES as usize + 1);
        TableWriter::new()
            .text("view", [long])
            .write(&path)
            .unwrap();
        let message = Table::read(&path, 1).err().unwrap().to_string();
        assert!(message.contains("times its size"), "{message}");
        // As many numbers as measurements have: they take more than 64 MiB as well.
        let measured = (0..3_000_000).map(|row| f64::from(row).sqrt());
        let names = std::iter::repeat_n("approach", 3_000_000);
        let table = TableWriter::new().text("scenario", names);
        table.f64("dtd_m", measured).write(&path).unwrap();
        assert!(Table::read(&path, u64::MAX).is_ok());
    }

    #[test]
    fn a_table_that_does_not_fit_into_memory_is_refused_with_both_figures() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("boxes.parquet");
        bomb(&path, 1_000_000);
        let bytes = outside_file::read(&path, FileKind::TABLE).unwrap();
        let refused = memory::with_limit(memory::Bytes(1 << 20), || {
            Table::parse(bytes.clone(), &path, u64::MAX).err().unwrap()
        });
        let message = refused.to_string();
        assert!(
            message.contains("boxes.parquet needs about") && message.contains("--max-memory"),
            "{message}"
        );
        assert!(Table::parse(bytes, &path, u64::MAX).is_ok());
    }

    #[test]
    fn a_long_text_and_a_nested_column_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("boxes.parquet");
        let long = "x".repeat(100_000);
        let texts = std::iter::repeat_n(long.as_str(), 100);
        TableWriter::new().text("view", texts).write(&path).unwrap();
        let table = Table::read(&path, 2_000).unwrap();
        let message = table.text("view").unwrap_err().to_string();
        assert!(
            message.contains("a text of 100000 bytes in row 0"),
            "{message}"
        );
        let lists =
            arrow_array::ListArray::from_iter_primitive::<Int32Type, _, _>([Some(vec![Some(1)])]);
        TableWriter::new()
            .push("lists", true, lists)
            .write(&path)
            .unwrap();
        let message = Table::read(&path, 2_000).err().unwrap().to_string();
        assert!(message.contains("column lists holds List"), "{message}");
    }

    #[test]
    fn a_page_that_breaks_its_decoder_is_damage() {
        let values: ArrayRef = Arc::new(Float64Array::from(vec![1.0, 2.0]));
        let batch = RecordBatch::try_from_iter([("score", values)]).unwrap();
        let plain = WriterProperties::builder().set_dictionary_enabled(false);
        let mut writer =
            ArrowWriter::try_new(Vec::new(), batch.schema(), Some(plain.build())).unwrap();
        writer.write(&batch).unwrap();
        let mut bytes = writer.into_inner().unwrap();
        let path = Path::new("boxes.parquet");
        assert!(Table::parse(bytes.clone(), path, 2).is_ok());
        // In the page's header: the values are plain, the levels are run lengths. Now the values refer to a dictionary that does not exist.
        let header = [0x15, 0x00, 0x15, 0x06, 0x15, 0x06];
        let at = bytes.windows(6).position(|six| six == header).unwrap();
        bytes[at + 1] = 0x10;
        let message = Table::parse(bytes, path, 2).err().unwrap().to_string();
        assert!(
            message.contains("boxes.parquet") && message.contains("its decoder panicked"),
            "{message}"
        );
    }
}
