//! Systems other than Linux: no memory is shared, images are sent over the link.

use std::fs::File;
use std::io;

use super::UnusableMemory;

/// True if there are files in memory.
pub(super) const POSSIBLE: bool = false;

/// There are none.
pub(super) fn create(_bytes: u64) -> io::Result<File> {
    Err(io::ErrorKind::Unsupported.into())
}

/// There are none.
pub(super) fn open(_process: u32, _descriptor: i32, _bytes: u64) -> Result<File, UnusableMemory> {
    Err(UnusableMemory::NotHere)
}
