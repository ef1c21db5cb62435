//! Parquet tables as named, typed columns.
//!
//! Writing is deterministic: the same columns give the same bytes. Reading asks for a column by name and type and says in
//! its error what the file holds instead.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::{
    Array, ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch, StringArray, UInt32Array,
    UInt64Array,
};
use arrow_schema::{Field, Schema};
use bytes::Bytes;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::properties::WriterProperties;

use crate::error::{Error, Result};
use crate::new_file::NewFile;
use crate::outside_file::{self, FileKind};

/// Collects columns and writes them as one Parquet file.
#[derive(Default)]
pub struct TableWriter {
    fields: Vec<Field>,
    arrays: Vec<ArrayRef>,
}

impl TableWriter {
    /// An empty table.
    pub fn new() -> Self {
        Self::default()
    }

    fn push(mut self, name: &str, nullable: bool, array: ArrayRef) -> Self {
        self.fields
            .push(Field::new(name, array.data_type().clone(), nullable));
        self.arrays.push(array);
        self
    }

    /// Adds a column of floats.
    pub fn f64(self, name: &str, values: impl IntoIterator<Item = f64>) -> Self {
        self.push(
            name,
            false,
            Arc::new(Float64Array::from_iter_values(values)),
        )
    }

    /// Adds a column of floats that may be missing.
    pub fn optional_f64(self, name: &str, values: impl IntoIterator<Item = Option<f64>>) -> Self {
        self.push(
            name,
            true,
            Arc::new(values.into_iter().collect::<Float64Array>()),
        )
    }

    /// Adds a column of signed integers.
    pub fn i64(self, name: &str, values: impl IntoIterator<Item = i64>) -> Self {
        self.push(name, false, Arc::new(Int64Array::from_iter_values(values)))
    }

    /// Adds a column of unsigned 32-bit integers.
    pub fn u32(self, name: &str, values: impl IntoIterator<Item = u32>) -> Self {
        self.push(name, false, Arc::new(UInt32Array::from_iter_values(values)))
    }

    /// Adds a column of unsigned 64-bit integers.
    pub fn u64(self, name: &str, values: impl IntoIterator<Item = u64>) -> Self {
        self.push(name, false, Arc::new(UInt64Array::from_iter_values(values)))
    }

    /// Adds a column of booleans.
    pub fn bool(self, name: &str, values: impl IntoIterator<Item = bool>) -> Self {
        self.push(
            name,
            false,
            Arc::new(values.into_iter().map(Some).collect::<BooleanArray>()),
        )
    }

    /// Adds a column of words.
    pub fn text<S: AsRef<str>>(self, name: &str, values: impl IntoIterator<Item = S>) -> Self {
        self.push(name, false, Arc::new(StringArray::from_iter_values(values)))
    }

    /// Writes the file (zstd, one row group a million rows), whole or not at all.
    pub fn write(self, path: &Path) -> Result<()> {
        let schema = Arc::new(Schema::new(self.fields));
        let batch =
            RecordBatch::try_new(schema.clone(), self.arrays).map_err(|e| Error::table(path, e))?;
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_created_by(format!("dtd {}", env!("CARGO_PKG_VERSION")))
            .build();
        let file = NewFile::create(path)?;
        let mut writer = ArrowWriter::try_new(file, schema, Some(properties))
            .map_err(|e| Error::table(path, e))?;
        writer.write(&batch).map_err(|e| Error::table(path, e))?;
        let file = writer.into_inner().map_err(|e| Error::table(path, e))?;
        file.commit()
    }
}

/// A table that was read.
pub struct Table {
    path: PathBuf,
    schema: Arc<Schema>,
    batches: Vec<RecordBatch>,
}

macro_rules! typed_column {
    ($(#[$doc:meta])* $name:ident, $array:ty, $value:ty, $convert:expr) => {
        $(#[$doc])*
        pub fn $name(&self, column: &str) -> Result<Vec<$value>> {
            let mut values = Vec::with_capacity(self.rows());
            for array in self.arrays(column)? {
                let typed = array.as_any().downcast_ref::<$array>().ok_or_else(|| {
                    self.fault(format!("column {column} should hold {}, but holds {}", stringify!($name), array.data_type()))
                })?;
                if typed.null_count() > 0 {
                    return Err(self.fault(format!(
                        "column {column} has {} missing values, expected none",
                        typed.null_count()
                    )));
                }
                values.extend((0..typed.len()).map(|row| $convert(typed.value(row))));
            }
            Ok(values)
        }
    };
}

impl Table {
    /// Reads a Parquet file whole.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(outside_file::read(path, FileKind::TABLE)?, path)
    }

    /// Reads the bytes of a Parquet file; messages name it as `path`.
    pub fn parse(bytes: Vec<u8>, path: &Path) -> Result<Self> {
        let builder = ParquetRecordBatchReaderBuilder::try_new(Bytes::from(bytes))
            .map_err(|e| Error::table(path, e))?;
        let schema = builder.schema().clone();
        let reader = builder.build().map_err(|e| Error::table(path, e))?;
        let batches = reader
            .collect::<std::result::Result<Vec<_>, _>>()
            .map_err(|e| Error::table(path, e))?;
        Ok(Self {
            path: path.to_owned(),
            schema,
            batches,
        })
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.batches.iter().map(RecordBatch::num_rows).sum()
    }

    /// Whether a column of this name exists.
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

    typed_column!(
        /// A column of floats without gaps.
        f64, Float64Array, f64, |v| v
    );
    typed_column!(
        /// A column of signed integers without gaps.
        i64, Int64Array, i64, |v| v
    );
    typed_column!(
        /// A column of unsigned 32-bit integers without gaps.
        u32, UInt32Array, u32, |v| v
    );
    typed_column!(
        /// A column of unsigned 64-bit integers without gaps.
        u64, UInt64Array, u64, |v| v
    );
    typed_column!(
        /// A column of booleans without gaps.
        bool, BooleanArray, bool, |v| v
    );
    typed_column!(
        /// A column of words without gaps.
        text, StringArray, String, |v: &str| v.to_owned()
    );

    /// A column of finite floats without gaps.
    pub fn finite_f64(&self, column: &str) -> Result<Vec<f64>> {
        let values = self.f64(column)?;
        match values.iter().position(|value| !value.is_finite()) {
            Some(row) => Err(self.fault(format!(
                "row {row}, column {column}: expected a finite number, found {}",
                values[row]
            ))),
            None => Ok(values),
        }
    }

    /// A column of floats that may be missing.
    pub fn optional_f64(&self, column: &str) -> Result<Vec<Option<f64>>> {
        let mut values = Vec::with_capacity(self.rows());
        for array in self.arrays(column)? {
            let typed = array
                .as_any()
                .downcast_ref::<Float64Array>()
                .ok_or_else(|| {
                    self.fault(format!(
                        "column {column} should hold f64, but holds {}",
                        array.data_type()
                    ))
                })?;
            values.extend(typed.iter());
        }
        Ok(values)
    }

    /// An error about this table.
    pub fn fault(&self, message: impl ToString) -> Error {
        Error::table(&self.path, message)
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
