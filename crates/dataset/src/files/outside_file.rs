//! Files from untrusted sources: opened only if they are regular files, read only up to a size limit.
//!
//! A FIFO, a terminal or an endless device in a file's place is rejected at once and never waited for: the file is opened without blocking,
//! and its type and size are queried from the open handle, so that it cannot be swapped in between.

use std::fs::{File, OpenOptions};
use std::io::Read;
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;

use rustix::fs::OFlags;

use crate::error::{Error, Result};

const MIB: u64 = 1 << 20;
const GIB: u64 = 1 << 30;

/// File content and its maximum size, which is far above any real file: a plan takes two kilobytes per scenario.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FileKind {
    what: &'static str,
    most_bytes: u64,
    follows_links: bool,
}

impl FileKind {
    /// A sweep.
    pub const SWEEP: Self = Self::new("sweep", 16 * MIB);
    /// A plan, with a million scenarios at most.
    pub const PLAN: Self = Self::new("plan", 4 * GIB);
    /// A recorded flight. It is not read into memory.
    pub const RECORDING: Self = Self::new("recording", 1 << 40);
    /// Settings of trainings and programs.
    pub const SETTINGS: Self = Self::new("settings", 16 * MIB);
    /// Hashes of scenario files.
    pub const MANIFEST: Self = Self::new("manifest", 16 * MIB);
    /// A Parquet table.
    pub const TABLE: Self = Self::new("table", 2 * GIB);
    /// A video. It is not read into memory.
    pub const VIDEO: Self = Self::new("video", 1 << 40);
    /// A recorded session with a simulator. It is not read into memory.
    pub const TAPE: Self = Self::new("tape", 1 << 40);
    /// A trained network: larger ones do not fit into the ONNX format.
    pub const MODEL: Self = Self::new("model", 2 * GIB);

    /// A JSON record of this name.
    pub const fn json(what: &'static str) -> Self {
        Self::new(what, 256 * MIB)
    }

    /// Files of any other kind.
    pub const fn new(what: &'static str, most_bytes: u64) -> Self {
        Self {
            what,
            most_bytes,
            follows_links: true,
        }
    }

    /// Maximum size of such a file, bytes.
    pub const fn most_bytes(self) -> u64 {
        self.most_bytes
    }

    /// This kind of file, where a symbolic link is rejected.
    #[must_use]
    pub const fn unlinked(self) -> Self {
        Self {
            follows_links: false,
            ..self
        }
    }
}

/// Opens a file for reading.
///
/// # Errors
/// It cannot be opened, is not a regular file, or exceeds the size limit for this content.
pub fn open(path: &Path, kind: FileKind) -> Result<File> {
    let mut flags = OFlags::NONBLOCK | OFlags::NOCTTY;
    if !kind.follows_links {
        flags |= OFlags::NOFOLLOW;
    }
    let file = OpenOptions::new()
        .read(true)
        .custom_flags(flags.bits() as i32)
        .open(path);
    // ELOOP or ENXIO alone would not explain the problem.
    let file = file.map_err(|source| match found_instead(path, kind) {
        Some(found) => not_regular(path, kind, found),
        None => Error::io("read", path)(source),
    })?;
    check(&file, path, kind)?;
    Ok(file)
}

/// Reads a file completely.
///
/// # Errors
/// See [`open`]; also fails if the file cannot be read or grows beyond its limit while being read.
pub fn read(path: &Path, kind: FileKind) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path, kind)?
        .take(kind.most_bytes + 1)
        .read_to_end(&mut bytes)
        .map_err(Error::io("read", path))?;
    check_size(bytes.len() as u64, path, kind)?;
    Ok(bytes)
}

/// Reads a text file completely.
///
/// # Errors
/// See [`read`]; also fails on invalid UTF-8.
pub fn read_text(path: &Path, kind: FileKind) -> Result<String> {
    String::from_utf8(read(path, kind)?).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        Error::corpus(
            path,
            format!("is not a valid {}: byte {at} is not UTF-8", kind.what),
        )
    })
}

/// Rejects an open file that is not regular or too large.
///
/// # Errors
/// See above.
pub fn check(file: &File, path: &Path, kind: FileKind) -> Result<()> {
    let metadata = file.metadata().map_err(Error::io("read", path))?;
    if !metadata.is_file() {
        return Err(not_regular(path, kind, name_of(metadata.file_type())));
    }
    check_size(metadata.len(), path, kind)
}

fn check_size(bytes: u64, path: &Path, kind: FileKind) -> Result<()> {
    if bytes > kind.most_bytes {
        return Err(Error::TooLarge {
            path: path.to_owned(),
            what: kind.what,
            bytes,
            most_bytes: kind.most_bytes,
        });
    }
    Ok(())
}

fn found_instead(path: &Path, kind: FileKind) -> Option<&'static str> {
    let metadata = if kind.follows_links {
        path.metadata()
    } else {
        path.symlink_metadata()
    };
    let file_type = metadata.ok()?.file_type();
    (!file_type.is_file()).then(|| name_of(file_type))
}

fn not_regular(path: &Path, kind: FileKind, found: &'static str) -> Error {
    Error::NotRegular {
        path: path.to_owned(),
        what: kind.what,
        found,
    }
}

/// Type of a folder entry, for messages.
pub(crate) fn name_of(file_type: std::fs::FileType) -> &'static str {
    if file_type.is_file() {
        "a file"
    } else if file_type.is_dir() {
        "a folder"
    } else if file_type.is_symlink() {
        "a symbolic link"
    } else if file_type.is_fifo() {
        "a FIFO"
    } else if file_type.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::symlink;
    use std::os::unix::net::UnixListener;

    use super::*;

    const TINY: FileKind = FileKind::new("note", 8);

    #[test]
    fn what_is_no_regular_file_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let fifo = folder.path().join("fifo");
        rustix::fs::mknodat(
            rustix::fs::CWD,
            &fifo,
            rustix::fs::FileType::Fifo,
            rustix::fs::Mode::RUSR,
            0,
        )
        .unwrap();
        let socket = folder.path().join("socket");
        let _listener = UnixListener::bind(&socket).unwrap();
        for (path, found) in [
            (fifo.as_path(), "a FIFO"),
            (socket.as_path(), "a socket"),
            (folder.path(), "a folder"),
            (Path::new("/dev/zero"), "a device"),
        ] {
            let error = read(path, TINY).unwrap_err();
            assert!(error.is_bad_content());
            assert_eq!(
                error.to_string(),
                format!(
                    "{} is {found}; expected a regular file with a note",
                    path.display()
                )
            );
        }
    }

    #[test]
    fn a_file_is_read_up_to_its_limit_and_not_beyond() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("note");
        fs::write(&path, "12345678").unwrap();
        assert_eq!(read_text(&path, TINY).unwrap(), "12345678");
        fs::write(&path, "123456789").unwrap();
        let message = read(&path, TINY).unwrap_err().to_string();
        assert!(
            message.contains("has 9 bytes") && message.contains("at most 8"),
            "{message}"
        );
        fs::write(&path, [b'a', 0xff]).unwrap();
        let message = read_text(&path, TINY).unwrap_err().to_string();
        assert!(message.contains("byte 1 is not UTF-8"), "{message}");
    }

    #[test]
    fn a_link_is_followed_only_where_it_may_be() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("target");
        fs::write(&target, "note").unwrap();
        let link = folder.path().join("link");
        symlink(&target, &link).unwrap();
        assert_eq!(read(&link, TINY).unwrap(), b"note");
        let message = read(&link, TINY.unlinked()).unwrap_err().to_string();
        assert!(message.contains("is a symbolic link"), "{message}");
    }
}
