//! Linux: files in memory without a name, whose size is sealed.

use std::fs::File;
use std::io;
use std::os::unix::fs::OpenOptionsExt;

use super::UnusableMemory;
use rustix::fs::{
    MemfdFlags, OFlags, SealFlags, fcntl_add_seals, fcntl_get_seals, ftruncate, memfd_create,
};

/// True if there are such files.
pub(super) const POSSIBLE: bool = true;

/// With these a file's size is fixed.
const SIZE_SEALS: SealFlags = SealFlags::SHRINK
    .union(SealFlags::GROW)
    .union(SealFlags::SEAL);

/// A file of this size, which takes memory only as it is written.
pub(super) fn create(bytes: u64) -> io::Result<File> {
    let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
    let file = File::from(memfd_create("dtd-pictures", flags)?);
    ftruncate(&file, bytes)?;
    fcntl_add_seals(&file, SIZE_SEALS)?;
    Ok(file)
}

/// Opens a file of another process that [`create`] made with this size.
pub(super) fn open(process: u32, descriptor: i32, bytes: u64) -> Result<File, UnusableMemory> {
    let path = format!("/proc/{process}/fd/{descriptor}");
    let not_opened = |cause| UnusableMemory::NotOpened {
        path: path.clone(),
        cause,
    };
    let file = File::options()
        .read(true)
        .write(true)
        // Opening anything else must not block.
        .custom_flags(OFlags::NONBLOCK.bits() as i32)
        .open(&path)
        .map_err(not_opened)?;
    // Any other file that a client might name is not sealed, and is left alone.
    let sealed = fcntl_get_seals(&file).is_ok_and(|seals| seals.contains(SIZE_SEALS));
    if !sealed {
        return Err(UnusableMemory::NotSealed { path });
    }
    match file.metadata() {
        Ok(found) if found.len() == bytes => Ok(file),
        Ok(found) => Err(UnusableMemory::OtherSize {
            path,
            bytes: found.len(),
            expected: bytes,
        }),
        Err(cause) => Err(not_opened(cause)),
    }
}
