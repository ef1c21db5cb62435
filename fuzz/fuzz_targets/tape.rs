//! Any bytes as a tape, or (selected by the first one) as the content of a chunk of a valid tape, which compression and checksums
//! would hide from the fuzzer: no panic, every message is found again at its location, and messages of the link are parsed as in
//! the stand-in.

#![no_main]

use std::sync::LazyLock;

use dtd_fuzz::as_file;
use libfuzzer_sys::fuzz_target;
use xplane_tape::{LinkMessage, TapeReader, Traffic};

static SESSION: &[u8] = include_bytes!("../../tests/data/tape/session.mcap");
const MAGIC_BYTES: usize = 8;
/// Lengths of the header and the payload of a message of the link.
const LENGTHS_BYTES: usize = 8;
/// Code and length of a record.
const HEAD_BYTES: usize = 9;
const CHUNK: u8 = 0x06;
const DATA_END: [u8; HEAD_BYTES + 4] = [0x0F, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];

/// A tape up to its first chunk.
static BEGINNING: LazyLock<&[u8]> = LazyLock::new(|| {
    let mut at = MAGIC_BYTES;
    while SESSION[at] != CHUNK {
        let length = SESSION[at + 1..at + HEAD_BYTES].try_into().unwrap();
        at += HEAD_BYTES + u64::from_le_bytes(length) as usize;
    }
    &SESSION[..at]
});

fuzz_target!(|bytes: &[u8]| {
    let (kind, bytes) = bytes.split_first().unwrap_or((&0, &[]));
    match kind % 2 {
        0 => as_file(bytes, "session.mcap", read),
        _ => as_file(&with_chunk(bytes), "session.mcap", read),
    }
});

fn read(path: &std::path::Path) {
    let Ok(mut tape) = TapeReader::open(path) else {
        return;
    };
    let mut places = Vec::new();
    while let Ok(Some(entry)) = tape.next_entry() {
        if places.len() < 64 {
            places.push(entry.place);
        }
        if entry.channel.traffic == Traffic::Link
            && let Ok(message) = LinkMessage::parse(entry.data.clone())
        {
            let _ = message.token();
            let payload = &entry.data[LENGTHS_BYTES + message.header().len()..];
            assert_eq!(
                LinkMessage::new(message.header(), payload).bytes(),
                entry.data
            );
        }
    }
    for place in places {
        assert!(tape.read_again(place).is_ok(), "{place:?}");
    }
}

/// A tape with one uncompressed chunk, whose checksum is ignored because it is 0.
fn with_chunk(records: &[u8]) -> Vec<u8> {
    let length = (records.len() as u64).to_le_bytes();
    let no_times = [0; 16];
    let no_checksum = [0; 4];
    let no_compression = [0; 4];
    let chunk = [
        &no_times[..],
        &length,
        &no_checksum,
        &no_compression,
        &length,
        records,
    ]
    .concat();
    let chunk_length = (chunk.len() as u64).to_le_bytes();
    [*BEGINNING, &[CHUNK], &chunk_length, &chunk, &DATA_END].concat()
}
