//! Disk space: how much is free, and whether a failure means that the disk is full. How much a plan needs:
//! [`crate::plan::room_bytes`].

use std::io::ErrorKind;
use std::path::Path;

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
    let said_so = match error {
        dataset::Error::Io { source, .. } => matches!(
            source.kind(),
            ErrorKind::StorageFull
                | ErrorKind::QuotaExceeded
                | ErrorKind::FileTooLarge
                | ErrorKind::ReadOnlyFilesystem
                | ErrorKind::PermissionDenied
        ),
        // Libraries wrap the system's error.
        other => {
            let said = other.to_string();
            ["No space left", "File too large", "Disk quota exceeded"]
                .iter()
                .any(|words| said.contains(words))
        }
    };
    said_so || free_bytes(corpus).is_some_and(|free| free < NOTHING_BYTES)
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
        let io = |kind: ErrorKind| dataset::Error::io("write", here)(kind.into());
        assert!(is_storage_failure(&io(ErrorKind::StorageFull), here));
        assert!(is_storage_failure(&io(ErrorKind::ReadOnlyFilesystem), here));
        let video = dataset::Error::Video {
            path: here.into(),
            message: "cannot write: No space left on device".into(),
        };
        assert!(is_storage_failure(&video, here));
        assert!(!is_storage_failure(&io(ErrorKind::InvalidData), here));
    }
}
