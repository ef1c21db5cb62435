//! Samples in tar archives, with the same bytes on every machine: no times, owners or rights of this one.

use std::io;
use std::mem;

use tar::{Builder, EntryType, Header};

/// Archive unit: header size, and padding of contents.
const BLOCK_BYTES: u64 = 512;
/// End marker: two blocks of zeros.
pub(super) const END: [u8; 2 * BLOCK_BYTES as usize] = [0; 2 * BLOCK_BYTES as usize];

/// Name after the sample's key, and content.
pub(super) type SampleFile = (String, Vec<u8>);

/// A sample's archive entries. The names of its files begin with the key.
pub(super) fn entries(key: &str, files: &[SampleFile]) -> io::Result<Vec<u8>> {
    let mut archive = Builder::new(Vec::new());
    for (name, content) in files {
        let mut header = Header::new_ustar();
        header.set_entry_type(EntryType::Regular);
        header.set_mode(0o644);
        header.set_mtime(0);
        header.set_size(content.len() as u64);
        archive.append_data(&mut header, format!("{key}.{name}"), &content[..])?;
    }
    // Finished, it would end with the blocks that end an archive.
    Ok(mem::take(archive.get_mut()))
}

/// True if entries of this size fit into an archive that already has `written` bytes and may have `most_bytes` including its end marker.
pub(super) fn fits(written: u64, added: u64, most_bytes: u64) -> bool {
    written + added + END.len() as u64 <= most_bytes
}
