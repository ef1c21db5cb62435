//! Reads a chunk of a tape: an untrusted file whose lengths may be anything.
//!
//! MCAP's own chunk reader trusts the lengths of the records in it, and allocates that much memory. So the chunk goes through its
//! reader of whole files, which has a limit; and only the record types of a tape are parsed.

use std::path::Path;

use dataset::work::memory;
use mcap::McapError;
use mcap::read::parse_record;
use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::error::TapeError;

/// Maximum record length, bytes: a chunk with the largest image, with a margin.
pub(super) const MAX_RECORD_BYTES: u64 = 1 << 30;

/// The operation that errors name.
const READING: &str = "read a record";

/// Chunk header bytes without the compression's name.
const HEADER_BYTES: usize = 40;

/// The channels and the messages in a chunk, in their order. Its checksum is checked.
///
/// # Errors
/// The chunk is damaged, or larger than the available memory.
pub(super) fn channels_and_messages(
    body: &[u8],
    path: &Path,
) -> Result<Vec<Record<'static>>, TapeError> {
    let failed = |error| TapeError::mcap(path, READING, &error);
    let Record::Chunk { header, data } = parse(op::CHUNK, body, path)? else {
        return Ok(Vec::new());
    };
    if header.uncompressed_size > MAX_RECORD_BYTES {
        return Err(failed(McapError::ChunkTooLarge(header.uncompressed_size)));
    }
    // Bytes after the compressed ones would be taken for more records.
    let expected = HEADER_BYTES + header.compression.len() + data.len();
    if body.len() != expected {
        return Err(failed(McapError::BadChunkLength {
            header: expected as u64,
            available: body.len() as u64,
        }));
    }
    memory::check(
        format_args!("a chunk of tape {}", path.display()),
        2 * header.uncompressed_size,
    )
    .map_err(dataset::Error::from)?;
    let longest = body.len().max(header.uncompressed_size as usize);
    let mut reader = LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(longest),
    );
    for part in [&[op::CHUNK][..], &(body.len() as u64).to_le_bytes(), body] {
        reader.insert(part.len()).copy_from_slice(part);
        reader.notify_read(part.len());
    }
    let mut records = Vec::new();
    while let Some(event) = reader.next_event() {
        match event.map_err(failed)? {
            LinearReadEvent::Record {
                opcode: opcode @ (op::CHANNEL | op::MESSAGE),
                data,
            } => records.push(parse(opcode, data, path)?.into_owned()),
            LinearReadEvent::Record { .. } => {}
            // There is no more.
            LinearReadEvent::ReadRequest(_) => reader.notify_read(0),
        }
    }
    Ok(records)
}

/// A record of the kinds that a tape is made of.
pub(super) fn parse<'a>(op: u8, body: &'a [u8], path: &Path) -> Result<Record<'a>, TapeError> {
    parse_record(op, body).map_err(|error| TapeError::mcap(path, READING, &error))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chunk that claims this many bytes, with a checksum that is not checked.
    fn chunk(compression: &str, uncompressed_bytes: u64, data: &[u8]) -> Vec<u8> {
        [
            &[0; 16][..],
            &uncompressed_bytes.to_le_bytes(),
            &[0; 4],
            &(compression.len() as u32).to_le_bytes(),
            compression.as_bytes(),
            &(data.len() as u64).to_le_bytes(),
            data,
        ]
        .concat()
    }

    fn record(op: u8, length: u64, body: &[u8]) -> Vec<u8> {
        [&[op][..], &length.to_le_bytes(), body].concat()
    }

    fn read(chunk: &[u8]) -> Result<Vec<Record<'static>>, TapeError> {
        channels_and_messages(chunk, Path::new("session.mcap"))
    }

    #[test]
    fn lengths_that_nothing_has_are_damage_and_ask_for_no_memory() {
        for length in [u64::MAX, u64::MAX - 8, u64::MAX - 3, 1 << 60, 1 << 40, 23] {
            let records = record(op::MESSAGE, length, &[0; 22]);
            let size = records.len() as u64;
            assert!(read(&chunk("", size, &records)).is_err(), "{length}");
            // The same as a frame of zstd with one block that is not compressed.
            let frame = [
                &[0x28, 0xB5, 0x2F, 0xFD, 0x20, records.len() as u8][..],
                &(1 | (records.len() as u32) << 3).to_le_bytes()[..3],
                &records,
            ]
            .concat();
            assert!(read(&chunk("zstd", size, &frame)).is_err(), "{length}");
        }
        let whole = record(op::MESSAGE, 22, &[0; 22]);
        assert_eq!(read(&chunk("", 31, &whole)).unwrap().len(), 1);
        for size in [u64::MAX, MAX_RECORD_BYTES + 1] {
            assert!(read(&chunk("", size, &whole)).is_err());
            assert!(read(&chunk("zstd", size, &whole)).is_err());
        }
    }

    #[test]
    fn records_that_no_tape_has_are_passed_over_whatever_is_in_them() {
        let records = [
            record(op::ATTACHMENT, 3, &[0; 3]),
            record(op::MESSAGE, 22, &[0; 22]),
        ]
        .concat();
        let found = read(&chunk("", records.len() as u64, &records)).unwrap();
        assert!(matches!(found[..], [Record::Message { .. }]), "{found:?}");
    }

    #[test]
    fn bytes_behind_the_last_record_of_a_chunk_are_damage() {
        let mut chunk = chunk("", 31, &record(op::MESSAGE, 22, &[0; 22]));
        chunk.extend(record(op::MESSAGE, 22, &[0; 22]));
        assert!(read(&chunk).is_err());
    }
}
