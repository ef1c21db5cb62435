//! Decompressed page sizes in a Parquet file, according to the page headers: the decoder allocates by these, whatever the file's metadata
//! says.
//!
//! A page's header is a structure of Thrift's compact protocol before the page: field 2 is the size of the decompressed page, field 3 the
//! size of the page in the file. All other fields are skipped.

use parquet::file::metadata::{ColumnChunkMetaData, ParquetMetaData};

/// Page header fields.
const DECOMPRESSED: i64 = 2;
const COMPRESSED: i64 = 3;
/// Levels of structures in a header; Parquet's have three.
const MAX_LEVELS: u32 = 8;

/// Bytes of all pages when they are decompressed; `None` if the pages cannot be followed to the end of their columns.
pub(super) fn decompressed_bytes(file: &[u8], metadata: &ParquetMetaData) -> Option<u64> {
    let groups = metadata.row_groups().iter();
    let mut columns = groups.flat_map(|group| group.columns());
    columns.try_fold(0_u64, |sum, column| {
        sum.checked_add(of_column(file, column)?)
    })
}

fn of_column(file: &[u8], column: &ColumnChunkMetaData) -> Option<u64> {
    let (begin, length) = column.byte_range();
    let end = begin.checked_add(length)?;
    let mut rest = file.get(usize::try_from(begin).ok()?..usize::try_from(end).ok()?)?;
    let mut sum = 0_u64;
    while !rest.is_empty() {
        let mut header = Header(rest);
        let [decompressed, compressed] = header.sizes()?;
        sum = sum.checked_add(decompressed)?;
        rest = header.0.get(usize::try_from(compressed).ok()?..)?;
    }
    Some(sum)
}

/// A header, and what follows it.
struct Header<'a>(&'a [u8]);

impl Header<'_> {
    /// The two sizes of the page; afterwards, the rest is the page.
    fn sizes(&mut self) -> Option<[u64; 2]> {
        let (mut decompressed, mut compressed, mut field) = (None, None, 0);
        while let Some(kind) = self.next_field(&mut field)? {
            match (field, kind) {
                (DECOMPRESSED, Kind::WHOLE) => decompressed = u64::try_from(self.whole()?).ok(),
                (COMPRESSED, Kind::WHOLE) => compressed = u64::try_from(self.whole()?).ok(),
                _ => self.skip(kind, MAX_LEVELS)?,
            }
        }
        Some([decompressed?, compressed?])
    }

    /// The kind of the next field, whose number is given relative to the one before; `Some(None)` at the structure's end.
    fn next_field(&mut self, field: &mut i64) -> Option<Option<Kind>> {
        let byte = self.byte()?;
        if byte == 0 {
            return Some(None);
        }
        *field = match byte >> 4 {
            0 => self.whole()?,
            step => field.checked_add(i64::from(step))?,
        };
        Some(Some(Kind(byte & 0x0f)))
    }

    fn skip(&mut self, kind: Kind, levels: u32) -> Option<()> {
        let levels = levels.checked_sub(1)?;
        match kind {
            Kind::TRUE | Kind::FALSE => Some(()),
            Kind::BYTE => self.leave_out(1),
            Kind::SHORT | Kind::WHOLE | Kind::LONG => self.varint().map(drop),
            Kind::DOUBLE => self.leave_out(8),
            Kind::BYTES => {
                let length = self.varint()?;
                self.leave_out(length)
            }
            Kind::STRUCTURE => {
                let mut field = 0;
                while let Some(kind) = self.next_field(&mut field)? {
                    self.skip(kind, levels)?;
                }
                Some(())
            }
            // No page header has lists or maps.
            _ => None,
        }
    }

    fn byte(&mut self) -> Option<u8> {
        let (&byte, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(byte)
    }

    fn leave_out(&mut self, bytes: u64) -> Option<()> {
        self.0 = self.0.get(usize::try_from(bytes).ok()?..)?;
        Some(())
    }

    fn varint(&mut self) -> Option<u64> {
        let mut number = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            number |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Some(number);
            }
        }
        None
    }

    /// A signed number, zigzag: 0, -1, 1, -2, ...
    fn whole(&mut self) -> Option<i64> {
        let number = self.varint()?;
        Some((number >> 1) as i64 ^ -((number & 1) as i64))
    }
}

/// A field's kind.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Kind(u8);

impl Kind {
    const TRUE: Self = Self(1);
    const FALSE: Self = Self(2);
    const BYTE: Self = Self(3);
    const SHORT: Self = Self(4);
    const WHOLE: Self = Self(5);
    const LONG: Self = Self(6);
    const DOUBLE: Self = Self(7);
    const BYTES: Self = Self(8);
    const STRUCTURE: Self = Self(12);
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use bytes::Bytes;
    use parquet::arrow::arrow_reader::{ArrowReaderMetadata, ArrowReaderOptions};

    use super::*;
    use crate::tables::columns::{Table, TableWriter};

    fn zigzag(number: u64) -> Vec<u8> {
        let mut left = 2 * number;
        let mut bytes = Vec::new();
        while left >= 0x80 {
            bytes.push(left as u8 | 0x80);
            left >>= 7;
        }
        bytes.push(left as u8);
        bytes
    }

    #[test]
    fn pages_unfold_to_what_the_metadata_of_an_honest_file_says_and_a_header_that_says_more_is_believed()
     {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("predictions.parquet");
        let text = "x".repeat(1_500_000);
        let table = TableWriter::new().text("scenario", [text]);
        table.write(&path).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        let decompressed = |bytes: &[u8]| {
            let whole = Bytes::copy_from_slice(bytes);
            let read = ArrowReaderMetadata::load(&whole, ArrowReaderOptions::new()).unwrap();
            let metadata = read.metadata();
            let said = metadata.row_group(0).total_byte_size() as u64;
            (decompressed_bytes(bytes, metadata).unwrap(), said)
        };
        let (found, said) = decompressed(&bytes);
        // The metadata counts the headers as well.
        assert!((said - 200..said).contains(&found), "{found} of {said}");
        assert!(Table::parse(bytes.clone(), &path, 1).is_ok());
        // The page of the dictionary: the text and its length.
        let honest = zigzag(1_500_004);
        let at = bytes.windows(4).position(|four| four == honest).unwrap();
        bytes[at..at + 4].copy_from_slice(&zigzag((1 << 27) - 1));
        assert_eq!(
            decompressed(&bytes),
            (found - 1_500_004 + (1 << 27) - 1, said)
        );
        let message = Table::parse(bytes, Path::new("x"), 1).err().unwrap();
        assert!(message.to_string().contains("times its size"), "{message}");
    }
}
