//! A sealed folder as readers see it. Reading takes no lock, does not write, and works on a read-only file system.
//!
//! The files alone determine the state of the folder. `DONE.json.new` if it exists, else `DONE.json`, names the manifest by its hash, and
//! the manifest names each file by its hash. So each file is searched by its hash: under its name, as `<name>.new`, and under its name
//! again, because a writer that completes a change may have renamed it in between. If no file has the hash and the seal has changed, a
//! writer was faster and reading starts again ([`Error::Changing`] for one file); if the seal is the same, the file is damaged.

use std::path::{Path, PathBuf};

use crate::corpus::seal::{
    DONE, MANIFEST, Seal, SealedFile, hash_sealed, read_seal, sealed_files, view_of,
    with_new_suffix,
};
use crate::error::{Error, Result};
use crate::files::outside_file::{self, FileKind};
use crate::files::own_path::{own_path, refuse_link};

/// Number of restarts before a reader gives up. A change takes milliseconds, and each step of the pipeline changes a scenario once.
pub(crate) const ATTEMPTS: u32 = 100;

/// A sealed folder: its seal and the files that it covers.
#[derive(Debug, Clone)]
pub struct Sealed {
    folder: PathBuf,
    seal: Seal,
    manifest: String,
    files: Vec<SealedFile>,
}

/// State of the sealed file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FileState<T> {
    /// The file has the sealed hash.
    Whole(T),
    /// No file has its name.
    Missing,
    /// The file with its name has a different hash.
    Other,
}

impl Sealed {
    /// Reads a folder's seal and manifest; `None` without a seal.
    ///
    /// # Errors
    /// The seal cannot be read, or the manifest does not match it.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        refuse_link(folder)?;
        for _ in 0..ATTEMPTS {
            let Some(seal) = read_seal(folder)? else {
                return Ok(None);
            };
            let manifest = find(folder, MANIFEST, &seal.manifest_blake3, |path| {
                let text = outside_file::read(path, FileKind::MANIFEST.unlinked())?;
                Ok((blake3::hash(&text).to_string(), text))
            })?;
            let path = folder.join(MANIFEST);
            if let FileState::Whole(text) = manifest {
                let text = String::from_utf8(text).map_err(|error| Error::corpus(&path, error))?;
                let files = sealed_files(&text, &seal).map_err(|bad| Error::corpus(folder, bad))?;
                return Ok(Some(Self {
                    folder: folder.to_owned(),
                    seal,
                    manifest: text,
                    files,
                }));
            }
            if read_seal(folder)?.as_ref() == Some(&seal) {
                return Err(match manifest {
                    FileState::Missing => Error::corpus(&path, "is missing"),
                    _ => Error::corpus(
                        folder,
                        format!("{MANIFEST} does not match the hash in {DONE}"),
                    ),
                });
            }
        }
        Err(changing(folder))
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The seal.
    pub fn seal(&self) -> &Seal {
        &self.seal
    }

    /// The bytes of the manifest.
    pub fn manifest(&self) -> &str {
        &self.manifest
    }

    /// All sealed files, in the order of the manifest.
    pub fn files(&self) -> &[SealedFile] {
        &self.files
    }

    /// A file's hash, if it is sealed.
    pub fn hash_of(&self, name: &str) -> Option<&str> {
        let file = self.files.iter().find(|file| file.name == name)?;
        Some(&file.blake3)
    }

    /// Name of the view's video, if one is sealed.
    pub fn video_of(&self, view: &str) -> Option<&str> {
        let mut names = self.files.iter().map(|file| file.name.as_str());
        names.find(|name| view_of(name) == Some(view))
    }

    /// A sealed file's content; `None` if it is not sealed.
    ///
    /// # Errors
    /// It is missing or damaged, or a writer has replaced it since the seal was read ([`Error::Changing`]).
    pub(crate) fn content(&self, name: &str, kind: FileKind) -> Result<Option<Vec<u8>>> {
        let Some(blake3) = self.hash_of(name) else {
            return Ok(None);
        };
        let found = find(&self.folder, name, blake3, |path| {
            let bytes = outside_file::read(path, kind)?;
            Ok((blake3::hash(&bytes).to_string(), bytes))
        })?;
        self.expect_whole(name, found).map(Some)
    }

    /// Reads the whole sealed file and rejects it if it does not match the seal.
    ///
    /// # Errors
    /// See [`Sealed::content`].
    pub fn check(&self, name: &str) -> Result<PathBuf> {
        let found = match self.hash_of(name) {
            Some(blake3) => self.find(name, blake3)?,
            None => FileState::Missing,
        };
        self.expect_whole(name, found)
    }

    /// Rejects a sealed file that is missing or, if it is a video, has a different size, without reading it.
    ///
    /// # Errors
    /// See [`Sealed::content`].
    pub(crate) fn check_unread(&self, name: &str) -> Result<PathBuf> {
        let found = match self.other_size(name)? {
            Some(_) => FileState::Other,
            None => self.find_unread(name)?,
        };
        self.expect_whole(name, found)
    }

    fn expect_whole<T>(&self, name: &str, found: FileState<T>) -> Result<T> {
        let fault = match found {
            FileState::Whole(content) => return Ok(content),
            _ if read_seal(&self.folder)?.as_ref() != Some(&self.seal) => {
                return Err(changing(&self.folder));
            }
            FileState::Missing => "is missing, though it was sealed".to_owned(),
            FileState::Other => {
                format!("does not match its seal: its hash differs from {MANIFEST}")
            }
        };
        let path = self.folder.join(name);
        Err(Error::corpus(
            &path,
            format!("{fault}; `dtd verify` lists all such faults"),
        ))
    }

    /// The path that has this sealed file's content now. The file is read completely, unless its size already differs.
    pub(crate) fn find(&self, name: &str, blake3: &str) -> Result<FileState<PathBuf>> {
        if self.other_size(name)?.is_some() {
            return Ok(FileState::Other);
        }
        find(&self.folder, name, blake3, |path| {
            Ok((hash_sealed(name, path)?, path.to_owned()))
        })
    }

    /// Sizes in bytes if the file's size differs from the seal: actual and sealed. Only the sizes of videos are sealed.
    pub(crate) fn other_size(&self, name: &str) -> Result<Option<(u64, u64)>> {
        let Some(&sealed) = self.seal.video_bytes.get(name) else {
            return Ok(None);
        };
        let about = own_path(&self.folder, name)?.metadata();
        let found = about.ok().filter(|about| about.is_file());
        Ok(found
            .map(|about| (about.len(), sealed))
            .filter(|(found, sealed)| found != sealed))
    }

    /// Finds a file by its name, without reading its content.
    pub(crate) fn find_unread(&self, name: &str) -> Result<FileState<PathBuf>> {
        let path = own_path(&self.folder, name)?;
        Ok(if path.is_file() {
            FileState::Whole(path)
        } else {
            FileState::Missing
        })
    }
}

/// Searches for the file with a hash under its name and the names used during a change; `read` returns hash and content.
pub(crate) fn find<T>(
    folder: &Path,
    name: &str,
    blake3: &str,
    read: impl Fn(&Path) -> Result<(String, T)>,
) -> Result<FileState<T>> {
    let path = own_path(folder, name)?;
    let new = with_new_suffix(&path);
    let mut found = FileState::Missing;
    for path in [&path, &new, &path] {
        if path == &new && refuse_link(path).is_err() {
            // Not left by any of our writers.
            continue;
        }
        match read(path) {
            Ok((hash, content)) if hash == blake3 => return Ok(FileState::Whole(content)),
            Ok(_) if path == &new => {}
            Ok(_) => found = FileState::Other,
            Err(error) if error.is_not_found() => {}
            Err(error) => return Err(error),
        }
    }
    Ok(found)
}

fn changing(folder: &Path) -> Error {
    Error::Changing {
        path: folder.to_owned(),
    }
}
