use std::path::Path;
use std::sync::Arc;

use arrow_array::types::Int32Type;
use arrow_array::{ArrayRef, Float64Array, RecordBatch};
use parquet::arrow::ArrowWriter;
use parquet::file::properties::WriterProperties;

use super::reader::UNSUSPICIOUS_BYTES;
use super::*;
use crate::files::outside_file::{self, FileKind};
use crate::work::memory;

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
    let bytes = include_bytes!("gzip.parquet").to_vec();
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
    let mut writer = ArrowWriter::try_new(Vec::new(), batch.schema(), Some(plain.build())).unwrap();
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
