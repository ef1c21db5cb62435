//! Output paths: the value parser of every `--out`, so that no verb writes among the files of others.
//!
//! A corpus, a run and a sealed folder contain their own files only, which their verbs replace as a whole and check by hash. So a verb may
//! not write inside one, whichever way the path leads there, and may write in its place only if it continues the existing content.

use std::fs;
use std::path::{Path, PathBuf};

use clap::builder::{PathBufValueParser, TypedValueParser};
use dataset::corpus::seal;
use dataset::corpus::{Corpus, own_folder_around};
use dataset::files::own_path::resolved;
use store::{CorpusLocation, StoreUrl};
use trainer::RunFolder;

use crate::args::local;

/// Kind of output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Output {
    /// A new file in a folder that is there.
    NewFile,
    /// A file that may replace an earlier one, which the verb checks.
    File,
    /// A folder; the verb checks existing files.
    Folder,
    /// A corpus, new or not.
    Corpus,
    /// A run, new or not.
    Run,
    /// A sealed export, new, or the same one again.
    Export,
}

/// Kind of folder that contains its own files only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Owner {
    Corpus,
    Run,
    Sealed,
}

impl Owner {
    fn of(folder: &Path) -> Option<Self> {
        if RunFolder::is_at(folder) {
            Some(Self::Run)
        } else if seal::is_at(folder) {
            Some(Self::Sealed)
        } else if Corpus::is_at(folder) {
            Some(Self::Corpus)
        } else {
            None
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Corpus => "a corpus",
            Self::Run => "a run",
            Self::Sealed => "a sealed folder (a scenario or an export)",
        }
    }
}

impl Output {
    /// Parser of a local output path. Unsuitable paths are rejected before any work.
    pub(crate) fn parser(self) -> impl TypedValueParser<Value = PathBuf> {
        PathBufValueParser::new()
            .try_map(local)
            .try_map(move |path| self.check(&path).map(|()| path))
    }

    /// Parser of a corpus to write: a folder or a store.
    pub(crate) fn corpus_or_url() -> impl TypedValueParser<Value = CorpusLocation> {
        PathBufValueParser::new().try_map(|path| match CorpusLocation::of(&path) {
            Ok(CorpusLocation::Folder(path)) => Self::Corpus
                .check(&path)
                .map(|()| CorpusLocation::Folder(path)),
            Ok(CorpusLocation::Store(url)) => {
                check_store(&url).map(|()| CorpusLocation::Store(url))
            }
            Err(error) => Err(error.to_string()),
        })
    }

    /// Parser of a store to write to.
    pub(crate) fn url() -> impl TypedValueParser<Value = StoreUrl> {
        clap::builder::StringValueParser::new().try_map(|text| {
            let url = text
                .parse()
                .map_err(|error: store::StoreError| error.to_string())?;
            check_store(&url).map(|()| url)
        })
    }

    /// Rejects an unsuitable path, such as one from a file of settings.
    pub(crate) fn check(self, path: &Path) -> Result<(), String> {
        // Without a slash at the end, which would follow a link.
        let path = &path.components().collect::<PathBuf>();
        self.check_kind(path)?;
        let place = match fs::read_link(path) {
            // A dangling link: where it leads, something would be made.
            Ok(to) if !path.exists() => resolved(&path.with_file_name("").join(to)),
            _ => resolved(path),
        };
        let place = place.map_err(|error| error.to_string())?;
        let existing = place.ancestors().find(|folder| folder.exists());
        if let Some(file) = existing.filter(|found| *found != place && !found.is_dir()) {
            return Err(format!(
                "is inside {}, which is a file; name another place",
                file.display()
            ));
        }
        let inside = place
            .ancestors()
            .skip(1)
            .find_map(|folder| Some((folder, Owner::of(folder)?)));
        if let Some((folder, owner)) = inside {
            return Err(format!(
                "is inside {}, which is {} and contains its own files only; name a place outside",
                folder.display(),
                owner.name()
            ));
        }
        if let Some(own) = own_folder_around(&place) {
            return Err(format!(
                "is inside {}, which a corpus reserves for its own files; name a place outside",
                own.display()
            ));
        }
        if let Some(folder) = place.parent().filter(|_| self == Self::NewFile)
            && !folder.exists()
        {
            return Err(format!(
                "is in {}, which does not exist; create that folder first",
                folder.display()
            ));
        }
        match Owner::of(&place) {
            Some(owner) if !self.goes_on_with(owner) => Err(format!(
                "is {}, which another verb wrote; name a new place",
                owner.name()
            )),
            _ => Ok(()),
        }
    }

    fn goes_on_with(self, owner: Owner) -> bool {
        matches!(
            (self, owner),
            (Self::Corpus, Owner::Corpus) | (Self::Run, Owner::Run) | (Self::Export, Owner::Sealed)
        )
    }

    /// Rejects other kinds of files. Renaming a file over a device would replace the device.
    fn check_kind(self, path: &Path) -> Result<(), String> {
        let is_link = fs::symlink_metadata(path).is_ok_and(|found| found.is_symlink());
        let found = fs::metadata(path).ok();
        let is_folder = found.as_ref().is_some_and(fs::Metadata::is_dir);
        let is_file = found.as_ref().is_some_and(fs::Metadata::is_file);
        let makes_file = matches!(self, Self::NewFile | Self::File);
        // A corpus or run on a second disk may be named by a link.
        let may_be_link = matches!(self, Self::Corpus | Self::Run);
        let fault = if found.is_some() && !is_folder && !is_file {
            "is a device, FIFO or socket, or a link to one; expected a name where a file or folder can be made"
        } else if is_link && !may_be_link {
            "is a symbolic link, and nothing is written where a link leads; name the place itself"
        } else if is_folder && makes_file {
            "is a folder; expected the name of a file"
        } else if is_file && !makes_file {
            "is a file; expected a folder, or the name of a new one"
        } else if is_file && self == Self::NewFile {
            "exists already and is not overwritten; name a new file, or move it away"
        } else {
            return Ok(());
        };
        Err(fault.into())
    }
}

/// Rejects a store in a local folder that contains files other than a corpus's.
fn check_store(url: &StoreUrl) -> Result<(), String> {
    match url.local_folder() {
        Some(folder) => Output::Corpus.check(&folder),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests;
