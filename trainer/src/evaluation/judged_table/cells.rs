//! Prediction table cells, from a Parquet or a CSV file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use csv::{ReaderBuilder, StringRecord, Trim};
use dataset::files::outside_file::{self, FileKind};
use dataset::tables::columns::Table;

use super::layout::{Layout, SCENARIO};
use crate::error::{Error, Result};

/// Magic bytes of Parquet files.
const PARQUET: &[u8] = b"PAR1";
/// Maximum number of rows, above the ticks of any corpus.
const MAX_ROWS: u64 = 1 << 30;

/// The used cells.
pub(super) struct Cells {
    path: PathBuf,
    pub layout: Layout,
    /// BLAKE3 hash of the file.
    pub blake3: String,
    /// Scenario per row.
    pub scenario: Vec<Option<String>>,
    /// The columns of [`Layout::numbers`], by name.
    pub numbers: BTreeMap<String, Vec<Option<f64>>>,
}

impl Cells {
    /// Reads a table: CSV if the file name ends in `.csv`, otherwise Parquet.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let refused = |fault: &str| Err(Error::predictions(path, fault));
        let bytes = match outside_file::read(path, FileKind::TABLE) {
            Err(error) if error.is_not_found() => {
                return refused(
                    "is not there; expected a table of `dtd predict`, or a Parquet or CSV file with the columns scenario, tick and \
                     NAME_dtd_m",
                );
            }
            read => read?,
        };
        let blake3 = blake3::hash(&bytes).to_string();
        let is_csv = path
            .extension()
            .is_some_and(|ending| ending.eq_ignore_ascii_case("csv"));
        let cells = if is_csv {
            Self::of_csv(&bytes, blake3, path)?
        } else if bytes.starts_with(PARQUET) {
            Self::of_parquet(bytes, blake3, path)?
        } else {
            return refused(
                "is not a Parquet file: it does not begin with PAR1; write it as Parquet, or give a CSV file a name that ends in .csv",
            );
        };
        if cells.scenario.is_empty() {
            return refused("has no rows, expected one for each scenario and tick");
        }
        Ok(cells)
    }

    pub(super) fn refused(&self, fault: String) -> Error {
        Error::predictions(&self.path, fault)
    }

    fn of_parquet(bytes: Vec<u8>, blake3: String, path: &Path) -> Result<Self> {
        let table = Table::parse(bytes, path, MAX_ROWS)?;
        let names: Vec<&str> = table.column_names().collect();
        let layout = Layout::of(path, &names)?;
        let scenario = table.optional_text(SCENARIO)?;
        let columns = layout.numbers().into_iter();
        let numbers = columns.map(|column| Ok((column.to_owned(), table.any_numbers(column)?)));
        Ok(Self {
            numbers: numbers.collect::<dataset::Result<_>>()?,
            scenario,
            blake3,
            layout,
            path: path.to_owned(),
        })
    }

    fn of_csv(bytes: &[u8], blake3: String, path: &Path) -> Result<Self> {
        let not_csv = |error: csv::Error| {
            let fault = format!(
                "is not a CSV table: {error}; expected a line of column names, then a line per tick with as many fields, separated by \
                 commas"
            );
            Error::predictions(path, fault)
        };
        let mut reader = ReaderBuilder::new().trim(Trim::All).from_reader(bytes);
        let header = reader.headers().map_err(not_csv)?.clone();
        let names: Vec<&str> = header.iter().collect();
        let layout = Layout::of(path, &names)?;
        let place = |column: &str| {
            let place = names.iter().position(|name| *name == column);
            place.expect("the layout has columns of the table")
        };
        let scenario_at = place(SCENARIO);
        let columns: Vec<usize> = layout.numbers().into_iter().map(place).collect();
        let mut scenario = Vec::new();
        let mut numbers = vec![Vec::new(); columns.len()];
        for record in reader.records() {
            let record = record.map_err(not_csv)?;
            let id = Some(&record[scenario_at]).filter(|id| !id.is_empty());
            scenario.push(id.map(str::to_owned));
            for (values, &column) in numbers.iter_mut().zip(&columns) {
                let value = number(&record[column]).map_err(|found| {
                    let (line, column) = (line_of(bytes, &record), names[column]);
                    let fault = format!(
                        "line {line}: {column} is {found:?}, expected a number, or an empty field for none"
                    );
                    Error::predictions(path, fault)
                })?;
                values.push(value);
            }
        }
        let columns = columns.iter().map(|&column| names[column].to_owned());
        Ok(Self {
            numbers: columns.zip(numbers).collect(),
            layout,
            blake3,
            scenario,
            path: path.to_owned(),
        })
    }
}

/// Line number where a record begins. The reader ends a record before the line feed in Windows line ends.
fn line_of(bytes: &[u8], record: &StringRecord) -> usize {
    let end = record.position().map_or(0, |place| place.byte() as usize);
    let rest = bytes.get(end..).unwrap_or_default();
    let ends = rest
        .iter()
        .take_while(|byte| b"\r\n".contains(byte))
        .count();
    let before = bytes.iter().take(end + ends);
    1 + before.filter(|byte| **byte == b'\n').count()
}

/// The number in a field, `None` if it is empty; the error is what else begins the field.
fn number(field: &str) -> std::result::Result<Option<f64>, String> {
    if field.is_empty() {
        return Ok(None);
    }
    let number = field.parse().map(Some);
    number.map_err(|_| field.chars().take(40).collect())
}
