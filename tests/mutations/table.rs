//! Mutations of Parquet tables: of values and columns, rewritten as a valid file, and of bytes.

use std::path::Path;

use dataset::tables::columns::{Table, TableWriter};
use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::json::pick;
use super::text;

/// Number of rows, more than in any table of the tiny corpus.
const MAX_ROWS: u64 = 1_000_000;

enum Column {
    Floats(Vec<Option<f64>>),
    Signed(Vec<i64>),
    Small(Vec<Option<u32>>),
    Large(Vec<u64>),
    Flags(Vec<bool>),
    Words(Vec<Option<String>>),
}

/// Changes a table on disk. Returns the change.
pub(super) fn mutate(path: &Path, random: &mut ChaCha12Rng) -> String {
    if random.random_bool(0.2) {
        let (bytes, what) = text::mutate(&std::fs::read(path).unwrap(), random);
        std::fs::write(path, bytes).unwrap();
        return what;
    }
    let mut columns = read(path);
    let index = random.random_range(0..columns.len());
    let name = columns[index].0.clone();
    let what = match random.random_range(0..10) {
        0 => {
            columns.remove(index);
            format!("without column {name}")
        }
        1 => {
            let rows = length(&columns[index].1);
            columns[index].1 = Column::Words(vec![Some("word".into()); rows]);
            format!("column {name} holds words")
        }
        2 => {
            let keep = length(&columns[index].1) / 2;
            columns
                .iter_mut()
                .for_each(|(_, column)| repeat(column, keep));
            format!("{keep} rows")
        }
        3 => {
            let rows = *pick(&[0, 1_000, 2_000_000], random);
            columns
                .iter_mut()
                .for_each(|(_, column)| repeat(column, rows));
            format!("{rows} rows, each as the last")
        }
        _ => {
            let rows = length(&columns[index].1);
            match rows {
                0 => format!("column {name} has no row to change"),
                _ => value(
                    &name,
                    &mut columns[index].1,
                    random.random_range(0..rows),
                    random,
                ),
            }
        }
    };
    let table =
        columns
            .into_iter()
            .fold(TableWriter::new(), |table, (name, column)| match column {
                Column::Floats(values) if values.iter().all(Option::is_some) => {
                    table.f64(&name, values.into_iter().flatten())
                }
                Column::Floats(values) => table.optional_f64(&name, values),
                Column::Signed(values) => table.i64(&name, values),
                Column::Small(values) if values.iter().all(Option::is_some) => {
                    table.u32(&name, values.into_iter().flatten())
                }
                Column::Small(values) => table.optional_u32(&name, values),
                Column::Large(values) => table.u64(&name, values),
                Column::Flags(values) => table.bool(&name, values),
                Column::Words(values) if values.iter().all(Option::is_some) => {
                    table.text(&name, values.into_iter().flatten())
                }
                Column::Words(values) => table.optional_text(&name, values),
            });
    std::fs::remove_file(path).unwrap();
    table.write(path).unwrap();
    what
}

fn value(name: &str, column: &mut Column, row: usize, random: &mut ChaCha12Rng) -> String {
    let shown: String = match column {
        Column::Floats(values) => {
            let old = values[row].unwrap_or(1.0);
            let new = *pick(
                &[
                    f64::NAN,
                    f64::INFINITY,
                    f64::NEG_INFINITY,
                    1e308,
                    -1e308,
                    1e17,
                    -5.0,
                    179.0,
                    0.0,
                    -0.0,
                    5e-324,
                    old * 0.5,
                    old + 1e-3,
                    old.next_up(),
                ],
                random,
            );
            let everywhere = random.random_bool(0.2);
            for value in values.iter_mut() {
                *value = if everywhere { Some(new) } else { *value };
            }
            values[row] = Some(new);
            format!("{new}{}", if everywhere { " in every row" } else { "" })
        }
        Column::Signed(values) => {
            values[row] = *pick(
                &[
                    -1,
                    0,
                    i64::MIN,
                    i64::MAX,
                    1 << 53,
                    values[row].wrapping_add(1),
                ],
                random,
            );
            values[row].to_string()
        }
        Column::Small(values) => {
            let next = values[row].unwrap_or(0).wrapping_add(1);
            let new = *pick(&[0, 1, u32::MAX, next], random);
            values[row] = Some(new);
            new.to_string()
        }
        Column::Large(values) => {
            values[row] = *pick(&[0, 1, u64::MAX, values[row].wrapping_add(1)], random);
            values[row].to_string()
        }
        Column::Flags(values) => {
            values[row] = !values[row];
            values[row].to_string()
        }
        Column::Words(values) => {
            let new = *pick(&text::STRANGE_WORDS, random);
            values[row] = Some(new.into());
            format!("{new:?}")
        }
    };
    format!("{name} of row {row} = {shown}")
}

fn read(path: &Path) -> Vec<(String, Column)> {
    let table = Table::read(path, MAX_ROWS).unwrap();
    let names: Vec<String> = table.column_names().map(str::to_owned).collect();
    let column = |name: String| {
        let column = table.optional_f64(&name).map(Column::Floats);
        let column = column.or_else(|_| table.i64(&name).map(Column::Signed));
        let column = column.or_else(|_| table.optional_u32(&name).map(Column::Small));
        let column = column.or_else(|_| table.u64(&name).map(Column::Large));
        let column = column.or_else(|_| table.bool(&name).map(Column::Flags));
        let column = column
            .or_else(|_| table.optional_text(&name).map(Column::Words))
            .unwrap();
        (name, column)
    };
    names.into_iter().map(column).collect()
}

fn length(column: &Column) -> usize {
    match column {
        Column::Floats(values) => values.len(),
        Column::Signed(values) => values.len(),
        Column::Small(values) => values.len(),
        Column::Large(values) => values.len(),
        Column::Flags(values) => values.len(),
        Column::Words(values) => values.len(),
    }
}

/// Truncates a column to this many rows, or repeats its last one.
fn repeat(column: &mut Column, rows: usize) {
    fn to<T: Clone>(values: &mut Vec<T>, rows: usize) {
        if let Some(last) = values.last().cloned() {
            values.resize(rows, last);
        }
    }
    match column {
        Column::Floats(values) => to(values, rows),
        Column::Signed(values) => to(values, rows),
        Column::Small(values) => to(values, rows),
        Column::Large(values) => to(values, rows),
        Column::Flags(values) => to(values, rows),
        Column::Words(values) => to(values, rows),
    }
}
