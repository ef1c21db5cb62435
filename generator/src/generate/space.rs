//! Disk space: how much is free, and whether a failure means that the disk is full. How much a plan needs:
//! [`crate::plan::room_bytes`].

use std::path::Path;

use rustix::io::Errno;

/// Minimum usable free space, bytes: the size of an image.
const NOTHING_BYTES: u64 = 8 << 20;

/// Bytes available where a folder is, or will be; unknown if the system does not report it.
pub fn free_bytes(folder: &Path) -> Option<u64> {
    let there = folder
        .ancestors()
        // A relative path's last ancestor is empty and means the current folder.
        .map(|folder| {
            if folder.as_os_str().is_empty() {
                Path::new(".")
            } else {
                folder
            }
        })
        .find(|folder| folder.exists())?;
    let figures = rustix::fs::statvfs(there).ok()?;
    Some(figures.f_bavail.saturating_mul(figures.f_frsize))
}

/// True if the next scenario would fail for the same reason: the disk is full, or not writable.
pub(super) fn is_storage_failure(error: &dataset::Error, corpus: &Path) -> bool {
    let is_said = matches!(
        error.errno(),
        Some(Errno::NOSPC | Errno::DQUOT | Errno::FBIG | Errno::ROFS | Errno::ACCESS)
    );
    is_said || free_bytes(corpus).is_some_and(|free| free < NOTHING_BYTES)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_is_not_there_yet_has_the_space_of_where_it_will_be() {
        assert!(free_bytes(Path::new("/no/such/folder/yet")).is_some());
        assert!(free_bytes(Path::new("a-folder-to-be")).is_some());
    }

    #[test]
    fn a_full_disk_and_a_read_only_one_concern_all_scenarios_and_a_damaged_file_does_not() {
        let here = Path::new(".");
        let io = |errno: Errno| dataset::Error::io("write", here)(errno.into());
        assert!(is_storage_failure(&io(Errno::NOSPC), here));
        assert!(is_storage_failure(&io(Errno::ROFS), here));
        let video = |errno| dataset::Error::Video {
            path: here.into(),
            message: "cannot write".into(),
            errno,
        };
        let full = Some(Errno::NOSPC.raw_os_error());
        assert!(is_storage_failure(&video(full), here));
        assert!(!is_storage_failure(&video(None), here));
    }
}
