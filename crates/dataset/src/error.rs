//! Errors of reading and writing a corpus.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::io::Errno;

use crate::numbers::limits::FieldOutOfLimits;
use crate::plain::shown;
use crate::work::memory::TooMuchMemory;

/// Errors of the system that concern no single file.
const DISK_ERRORS: [Errno; 8] = [
    Errno::NOSPC,
    Errno::DQUOT,
    Errno::FBIG,
    Errno::IO,
    Errno::ROFS,
    Errno::MFILE,
    Errno::NFILE,
    Errno::STALE,
];

/// A corpus or a corpus file that cannot be read or written. Every message says which file.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// An I/O error.
    #[error("cannot {action} {}: {source}", shown(path))]
    Io {
        /// The operation: "read", "create", ...
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The operating system's error.
        r#source: std::io::Error,
    },
    /// Something other than a regular file is in its place.
    #[error("{} is {found}; expected a regular file with a {what}", shown(path))]
    NotRegular {
        /// Path where the file was expected.
        path: PathBuf,
        /// Kind of content.
        what: &'static str,
        /// The type found instead: "a FIFO", "a folder", ...
        found: &'static str,
    },
    /// A file exceeds the size limit for this content.
    #[error(
        "{} has {bytes} bytes; expected a {what} of at most {most_bytes}",
        shown(path)
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Kind of content.
        what: &'static str,
        /// Actual size.
        bytes: u64,
        /// The limit.
        most_bytes: u64,
    },
    /// A JSON file has the wrong content.
    #[error("{} is not a valid {what}: {source}", shown(path))]
    Json {
        /// Expected kind of content.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// Line, column and reason.
        r#source: serde_json::Error,
    },
    /// A table lacks a column, has a wrong type, or is damaged.
    #[error("table {}: {message}", shown(path))]
    Table {
        /// The file.
        path: PathBuf,
        /// Expected and found content.
        message: String,
    },
    /// A number is outside its limits.
    #[error("{}{}: {fault}", shown(path), in_row(*row))]
    OutOfLimits {
        /// The file.
        path: PathBuf,
        /// Row of the table, from 0.
        row: Option<usize>,
        /// Field, value and range.
        fault: FieldOutOfLimits,
    },
    /// A request does not fit into memory.
    #[error(transparent)]
    Memory(#[from] TooMuchMemory),
    /// A video cannot be read or written.
    #[error("video {}: {message}", shown(path))]
    Video {
        /// The file.
        path: PathBuf,
        /// The operation and the failure.
        message: String,
        /// The operating system's number of the failure, if it is one of the system.
        errno: Option<i32>,
    },
    /// A different process works on a scenario, on the files of the whole corpus, or on a folder in the making.
    #[error("{} {}", shown(path), in_use_by(holder, *waited))]
    Held {
        /// Path of the scenario, corpus or folder.
        path: PathBuf,
        /// Process that holds it.
        holder: String,
        /// Time waited.
        waited: Duration,
    },
    /// Something appeared in the place of a new folder.
    #[error(
        "{}: was made by something else meanwhile and is not replaced; move it away and run the same command again, or name another folder",
        shown(path)
    )]
    Taken {
        /// The folder.
        path: PathBuf,
    },
    /// A different process kept changing a scenario while it was read.
    #[error(
        "{}: another process keeps changing it while it is read; run the same command again",
        shown(path)
    )]
    Changing {
        /// The scenario's folder.
        path: PathBuf,
    },
    /// The folder has no scenarios.
    #[error(
        "{} is not a corpus (expected a folder with scenarios/ in it); make one with `dtd generate SWEEP.toml --out CORPUS`",
        shown(path)
    )]
    NotACorpus {
        /// The folder.
        path: PathBuf,
    },
    /// The folder is not as expected.
    #[error("{}: {message}", shown(path))]
    Corpus {
        /// The folder or file.
        path: PathBuf,
        /// Expectation, finding and remedy.
        message: String,
    },
}

fn in_use_by(holder: &str, waited: Duration) -> String {
    if waited.is_zero() {
        format!("is in use by {holder}; try again when it has finished")
    } else {
        format!(
            "has been in use by {holder} for {:.1} s; if that hangs, end it and run the same command again",
            waited.as_secs_f64()
        )
    }
}

fn in_row(row: Option<usize>) -> String {
    row.map_or_else(String::new, |row| format!(" row {row}"))
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Wraps an I/O error; meant for `map_err(Error::io("read", path))`.
    pub fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io {
            action,
            path,
            source,
        }
    }

    /// The result, or `None` if the file or folder is missing.
    pub fn if_there<T>(found: Result<T>) -> Result<Option<T>> {
        match found {
            Err(error) if error.is_not_found() => Ok(None),
            found => found.map(Some),
        }
    }

    /// The message for a list of faults that names `file`, the end of the path, already: without it, if it is the file of this error.
    pub fn beside(&self, file: &Path) -> String {
        match self {
            Self::Io {
                action,
                path,
                source,
            } if path.ends_with(file) => format!("cannot {action} it: {source}"),
            Self::NotRegular { path, what, found } if path.ends_with(file) => {
                format!("is {found}; expected a regular file with a {what}")
            }
            Self::Json { what, path, source } if path.ends_with(file) => {
                format!("is not a valid {what}: {source}")
            }
            Self::OutOfLimits { path, row, fault } if path.ends_with(file) => match row {
                Some(row) => format!("row {row}: {fault}"),
                None => fault.to_string(),
            },
            Self::Table { path, message }
            | Self::Video { path, message, .. }
            | Self::Corpus { path, message }
                if path.ends_with(file) =>
            {
                message.clone()
            }
            _ => self.to_string(),
        }
    }

    /// True if a file or folder is missing.
    pub fn is_not_found(&self) -> bool {
        matches!(self, Self::Io { source, .. } if source.kind() == ErrorKind::NotFound)
    }

    /// True if a file or folder already exists at the path of the new one.
    pub fn is_taken(&self) -> bool {
        matches!(self, Self::Io { source, .. } if source.kind() == ErrorKind::AlreadyExists)
    }

    /// The operating system's error, if it is one.
    pub fn errno(&self) -> Option<Errno> {
        let number = match self {
            Self::Io { source, .. } => source.raw_os_error(),
            Self::Video { errno, .. } => *errno,
            _ => None,
        };
        number.map(Errno::from_raw_os_error)
    }

    /// Returns true for a disk that is full, broken or read-only, and for a process without descriptors: the same operation succeeds once
    /// that is mended.
    pub fn is_of_disk(&self) -> bool {
        (self.errno()).is_some_and(|errno| DISK_ERRORS.contains(&errno))
    }

    /// True if the files are not at fault, but the disk, permissions, or a process that works on them.
    pub fn is_of_environment(&self) -> bool {
        self.errno() == Some(Errno::ACCESS) || self.is_of_disk() || self.is_passing()
    }

    /// True if a different process was in the way: a retry may succeed.
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Held { .. } | Self::Changing { .. })
    }

    /// True if a file existed but had the wrong content, or more than fits into memory: reading it again gives the same result.
    pub fn is_bad_content(&self) -> bool {
        matches!(
            self,
            Self::Json { .. }
                | Self::NotACorpus { .. }
                | Self::Corpus { .. }
                | Self::Taken { .. }
                | Self::NotRegular { .. }
                | Self::TooLarge { .. }
                | Self::Table { .. }
                | Self::OutOfLimits { .. }
                | Self::Memory(_)
        )
    }

    /// True if files are damaged or must not be read, so that readers of many can go on without these. Content that does not fit into
    /// memory may be sound.
    pub fn is_damage(&self) -> bool {
        match self {
            Self::Io { source, .. } => source.kind() == ErrorKind::PermissionDenied,
            Self::Memory(_) => false,
            _ => self.is_bad_content(),
        }
    }

    /// A number in a file that is outside its limits.
    pub(crate) fn out_of_limits(path: &Path, row: Option<usize>, fault: FieldOutOfLimits) -> Self {
        Self::OutOfLimits {
            path: path.to_owned(),
            row,
            fault,
        }
    }

    /// Rejects a record with numbers outside their limits by the first of them.
    pub(crate) fn refuse_first(path: &Path, faults: Vec<FieldOutOfLimits>) -> Result<()> {
        match faults.into_iter().next() {
            None => Ok(()),
            Some(fault) => Err(Self::out_of_limits(path, None, fault)),
        }
    }

    pub(crate) fn table(path: &Path, message: impl ToString) -> Self {
        Self::Table {
            path: path.to_owned(),
            message: message.to_string(),
        }
    }

    /// A folder or file that is not as expected.
    pub fn corpus(path: &Path, message: impl ToString) -> Self {
        Self::Corpus {
            path: path.to_owned(),
            message: message.to_string(),
        }
    }
}
