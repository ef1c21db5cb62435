//! Prediction table cells, from a Parquet or a CSV file.

use std::collections::BTreeMap;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim};
use dataset::files::outside_file::{self, FileKind};
use dataset::tables::columns::Table;

use super::layout::{Layout, SCENARIO, listed};
use crate::error::{self, Error, PredictionsFault};

/// Magic bytes of Parquet files.
const PARQUET: &[u8] = b"PAR1";
/// Maximum number of rows, above the ticks of any corpus.
const MAX_ROWS: u64 = 1 << 30;

/// The used cells.
pub(super) struct Cells {
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
    pub(super) fn read(path: &Path) -> error::Result<Self> {
        let refused = |fault| Error::predictions(path, fault);
        let bytes = outside_file::read(path, FileKind::TABLE).map_err(|error| {
            if error.is_not_found() {
                refused(PredictionsFault::NotThere)
            } else {
                error.into()
            }
        })?;
        let blake3 = blake3::hash(&bytes).to_string();
        let is_csv = path
            .extension()
            .is_some_and(|ending| ending.eq_ignore_ascii_case("csv"));
        let cells = if is_csv {
            Self::of_csv(&bytes, blake3).map_err(refused)?
        } else if bytes.starts_with(PARQUET) {
            Self::of_parquet(bytes, blake3, path)?
        } else {
            return Err(refused(PredictionsFault::NotParquet));
        };
        if cells.scenario.is_empty() {
            return Err(refused(PredictionsFault::Empty));
        }
        Ok(cells)
    }

    fn of_parquet(bytes: Vec<u8>, blake3: String, path: &Path) -> error::Result<Self> {
        let table = Table::parse(bytes, path, MAX_ROWS)?;
        let names: Vec<&str> = table.column_names().collect();
        let layout = Layout::of(&names).map_err(|fault| Error::predictions(path, fault))?;
        let scenario = table.optional_text(SCENARIO)?;
        let columns = layout.numbers().into_iter();
        let numbers = columns.map(|column| Ok((column.to_owned(), table.any_numbers(column)?)));
        Ok(Self {
            numbers: numbers.collect::<dataset::Result<_>>()?,
            scenario,
            blake3,
            layout,
        })
    }

    fn of_csv(bytes: &[u8], blake3: String) -> Result<Self, PredictionsFault> {
        let mut reader = ReaderBuilder::new().trim(Trim::All).from_reader(bytes);
        let header = reader.headers().map_err(PredictionsFault::NotCsv)?.clone();
        let names: Vec<&str> = header.iter().collect();
        let layout = Layout::of(&names)?;
        let place = |column: &str| {
            let place = names.iter().position(|name| *name == column);
            place.ok_or_else(|| PredictionsFault::NoEstimator {
                found: listed(&names),
            })
        };
        let scenario_at = place(SCENARIO)?;
        let columns: Vec<usize> = (layout.numbers().into_iter())
            .map(place)
            .collect::<Result<_, _>>()?;
        let mut scenario = Vec::new();
        let mut numbers = vec![Vec::new(); columns.len()];
        for record in reader.records() {
            let record = record.map_err(PredictionsFault::NotCsv)?;
            let id = Some(&record[scenario_at]).filter(|id| !id.is_empty());
            scenario.push(id.map(str::to_owned));
            for (values, &column) in numbers.iter_mut().zip(&columns) {
                values.push(number(bytes, &record, column, names[column])?);
            }
        }
        let columns = columns.iter().map(|&column| names[column].to_owned());
        Ok(Self {
            numbers: columns.zip(numbers).collect(),
            layout,
            blake3,
            scenario,
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

fn number(
    bytes: &[u8],
    record: &StringRecord,
    column: usize,
    name: &str,
) -> Result<Option<f64>, PredictionsFault> {
    let field = &record[column];
    if field.is_empty() {
        return Ok(None);
    }
    let number = field.parse();
    number.map(Some).map_err(|_| PredictionsFault::NotANumber {
        line: line_of(bytes, record),
        column: name.to_owned(),
        found: field.chars().take(40).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bad_number_is_in_the_same_line_whatever_the_line_ends_are() {
        for end in ["\n", "\r\n"] {
            let rows = ["scenario,tick,m_dtd_m", "a,0,5", "a,1,5 m", ""];
            let fault = Cells::of_csv(rows.join(end).as_bytes(), String::new()).err();
            let is_there = matches!(fault, Some(PredictionsFault::NotANumber { line: 3, .. }));
            assert!(is_there, "{end:?}: {fault:?}");
        }
    }
}
