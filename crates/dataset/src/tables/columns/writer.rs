//! Collects columns and writes them as one Parquet file. The same columns give the same bytes.

use std::collections::HashMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::{
    Array, ArrayRef, BinaryArray, BooleanArray, Float64Array, Int64Array, RecordBatch, StringArray,
    UInt32Array, UInt64Array,
};
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::schema::types::ColumnPath;

use crate::error::{Error, Result};
use crate::files::new_file::NewFile;
use crate::numbers::limits::{FieldOutOfLimits, Limits};

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

    pub(super) fn push(mut self, name: &str, nullable: bool, array: impl Array + 'static) -> Self {
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

    /// Adds a column of signed integers that may be missing.
    pub fn optional_i64(self, name: &str, values: impl IntoIterator<Item = Option<i64>>) -> Self {
        self.push(name, true, Int64Array::from_iter(values))
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
