//! Progress of unfinished videos: each image is a fragment of the file.

use std::io::{BufReader, ErrorKind, Read};
use std::path::Path;

use crate::error::{Error, Result};
use crate::files::outside_file::{self, FileKind};

/// Size and type of a file's box, bytes.
const HEADER_BYTES: u32 = 8;

/// The number of images in a video that is being written, or was left by a kill; `None` if it is finished.
///
/// # Errors
/// It cannot be read.
pub fn recorded_pictures(path: &Path) -> Result<Option<u64>> {
    let file = outside_file::open(path, FileKind::VIDEO.unlinked())?;
    let mut file = BufReader::new(file);
    let mut pictures = 0;
    loop {
        let mut header = [0; HEADER_BYTES as usize];
        match file.read_exact(&mut header) {
            Ok(()) => {}
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(Some(pictures)),
            Err(error) => return Err(Error::io("read", path)(error)),
        }
        let [a, b, c, d, kind @ ..] = header;
        let bytes = u32::from_be_bytes([a, b, c, d]);
        match &kind {
            b"moof" => pictures += 1,
            // A finished file's images are in one box, with a size of 0 or 1 if 32 bits are too few for it.
            b"mdat" if pictures == 0 => return Ok(None),
            _ => {}
        }
        let Some(rest) = bytes.checked_sub(HEADER_BYTES) else {
            return Ok(Some(pictures));
        };
        file.seek_relative(rest.into())
            .map_err(Error::io("read", path))?;
    }
}
