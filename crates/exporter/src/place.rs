//! The folder of an export, and the one beside it in which it is made.
//!
//! ```text
//! DIR              complete, sealed with MANIFEST.b3 and DONE.json
//! DIR.partial/
//!   claim          locked by the process that makes it
//!   begun.json     what it is an export of
//!   parts/<id>.json    scenarios whose files are all written
//!   new/           its files
//! ```

use std::fs;
use std::io::ErrorKind;
use std::path::{self, Path, PathBuf};

use dataset::corpus::Corpus;
use dataset::corpus::claim::{Claim, Claimed};
use dataset::corpus::seal;
use dataset::files::json_file::{read_json, write_json};
use dataset::files::new_file::clear_leftovers;
use dataset::files::own_path::resolved;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

const CLAIM: &str = "claim";
const BEGUN: &str = "begun.json";
const PARTS: &str = "parts";
const NEW: &str = "new";

/// Hash of the request and of the seals of its scenarios, which identifies an export.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Begun {
    source_blake3: String,
}

/// An export that is being made; locked until this is dropped.
#[derive(Debug)]
pub(crate) struct Place {
    out: PathBuf,
    partial: PathBuf,
    source_blake3: String,
    claim: Option<Claim>,
}

/// The state of a destination.
pub(crate) enum Found {
    /// This very export is there, with files of this size.
    Complete { bytes: u64 },
    /// It is to be made, or to be continued.
    Place(Place),
}

impl Place {
    /// Takes the destination for an export of this source.
    pub(crate) fn take(out: &Path, source_blake3: &str) -> Result<Found> {
        // A relative name of one part has no parent to name, and a slash at the end would put `.partial` into the folder.
        let out = path::absolute(out).map_err(dataset::Error::io("resolve", out))?;
        let out = &out.components().collect::<PathBuf>();
        let partial = partial_of(out);
        refuse_other_than_folder(out)?;
        refuse_other_than_folder(&partial)?;
        if let Some(sealed) = seal::read_seal(out)? {
            let out = out.to_owned();
            if sealed.config_hash != source_blake3 {
                return Err(Error::OtherFinished { out });
            }
            if let Some(fault) = seal::faults(&out)?.into_iter().next() {
                return Err(Error::Changed { out, fault });
            }
            let bytes = bytes_in(&out).map_err(dataset::Error::io("read the size of", &out))?;
            if partial.join(BEGUN).exists() && !partial.join(NEW).exists() {
                // Killed, or failed, after its files were moved.
                if let Claimed::Mine(claim) = Claim::take_in(&partial, CLAIM)? {
                    remove_notes(&partial)?;
                    drop(claim);
                }
            }
            return Ok(Found::Complete { bytes });
        }
        refuse_content(out)?;
        let claim = match Claim::take_in(&partial, CLAIM)? {
            Claimed::Mine(claim) => claim,
            Claimed::Theirs(holder) => {
                return Err(Error::Held {
                    out: out.to_owned(),
                    holder: holder.to_string(),
                });
            }
        };
        if !partial.join(NEW).is_dir() {
            // Killed after its files were moved: what is noted of them is no longer here.
            remove_parts(&partial)?;
        }
        let begun = partial.join(BEGUN);
        let mine = Begun {
            source_blake3: source_blake3.to_owned(),
        };
        if begun.exists() {
            let found: Begun = read_json(&begun, "record of an export")?;
            if found != mine {
                return Err(Error::OtherExport { partial });
            }
        } else {
            write_json(&begun, &mine)?;
        }
        for folder in [PARTS, NEW] {
            let folder = partial.join(folder);
            fs::create_dir_all(&folder).map_err(dataset::Error::io("create", &folder))?;
            clear_leftovers(&folder);
        }
        Ok(Found::Place(Self {
            out: out.to_owned(),
            partial,
            source_blake3: source_blake3.to_owned(),
            claim: Some(claim),
        }))
    }

    /// The folder for its files.
    pub(crate) fn files(&self) -> PathBuf {
        self.partial.join(NEW)
    }

    /// True if the files of a scenario are all written.
    pub(crate) fn has_part(&self, scenario: &str) -> bool {
        self.part_path(scenario).exists()
    }

    /// The note on a scenario.
    pub(crate) fn part<T: DeserializeOwned>(&self, scenario: &str) -> Result<T> {
        Ok(read_json(&self.part_path(scenario), "part of an export")?)
    }

    /// Notes that the files of a scenario are all written, with the data needed at the end.
    pub(crate) fn note(&self, scenario: &str, part: &impl Serialize) -> Result<()> {
        Ok(write_json(&self.part_path(scenario), part)?)
    }

    fn part_path(&self, scenario: &str) -> PathBuf {
        self.partial.join(PARTS).join(format!("{scenario}.json"))
    }

    /// Removes what was made: of a corpus with faults, of which another export is made once they are mended.
    pub(crate) fn abandon(mut self) -> Result<()> {
        // The records of finished work are removed first, so that an export killed in between is not resumed.
        for folder in [PARTS, NEW] {
            let folder = self.partial.join(folder);
            fs::remove_dir_all(&folder).map_err(dataset::Error::io("remove", &folder))?;
        }
        let begun = self.partial.join(BEGUN);
        fs::remove_file(&begun).map_err(dataset::Error::io("remove", &begun))?;
        // Takes the folder with it.
        drop(self.claim.take());
        Ok(())
    }

    /// Seals the files and moves them to the destination. Returns their size in bytes.
    pub(crate) fn finish(mut self) -> Result<u64> {
        let files = self.files();
        seal::seal_folder(&files, &self.source_blake3)?;
        let bytes = bytes_in(&files).map_err(dataset::Error::io("read the size of", &files))?;
        if self.out.exists() {
            // Empty: this was checked.
            fs::remove_dir(&self.out).map_err(dataset::Error::io("replace", &self.out))?;
        }
        seal::commit_folder(&files, &self.out)?;
        remove_notes(&self.partial)?;
        // Takes the folder with it.
        drop(self.claim.take());
        Ok(bytes)
    }
}

/// Removes what was noted of an export whose files are in their place.
fn remove_notes(partial: &Path) -> Result<()> {
    remove_parts(partial)?;
    let begun = partial.join(BEGUN);
    fs::remove_file(&begun).map_err(dataset::Error::io("remove", &begun))?;
    Ok(())
}

fn remove_parts(partial: &Path) -> Result<()> {
    let parts = partial.join(PARTS);
    match fs::remove_dir_all(&parts) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(dataset::Error::io("remove", &parts)(error).into())
        }
        _ => Ok(()),
    }
}

/// Temporary folder of an export in progress.
fn partial_of(out: &Path) -> PathBuf {
    let mut partial = out.as_os_str().to_owned();
    partial.push(".partial");
    partial.into()
}

/// Refuses a destination within the corpus, to which only its own files may be written, or around it.
pub(crate) fn refuse_corpus(corpus: &Corpus, out: &Path) -> Result<()> {
    let corpus = resolved(corpus.root())?;
    let place = resolved(out)?;
    let is_around = [place.clone(), partial_of(&place)]
        .iter()
        .any(|folder| corpus.starts_with(folder));
    match is_around || place.starts_with(&corpus) {
        true => Err(Error::InCorpus {
            out: out.to_owned(),
            corpus,
        }),
        false => Ok(()),
    }
}

/// Refuses a file, and a link, which a folder cannot replace.
fn refuse_other_than_folder(path: &Path) -> Result<()> {
    let found = match fs::symlink_metadata(path) {
        Ok(there) if there.is_dir() => return Ok(()),
        Ok(there) if there.is_symlink() => "a symbolic link",
        Ok(_) => "a file",
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) if error.kind() == ErrorKind::NotADirectory => "inside a file",
        Err(error) => return Err(dataset::Error::io("look at", path)(error).into()),
    };
    Err(Error::NoFolder {
        path: path.to_owned(),
        found,
    })
}

/// Refuses a destination that contains anything.
fn refuse_content(out: &Path) -> Result<()> {
    match fs::read_dir(out) {
        Ok(mut entries) => match entries.next() {
            None => Ok(()),
            Some(entry) => {
                let entry = entry.map_err(dataset::Error::io("list", out))?;
                Err(Error::Occupied {
                    out: out.to_owned(),
                    found: entry.file_name().to_string_lossy().into_owned(),
                })
            }
        },
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Err(error) => Err(dataset::Error::io("list", out)(error).into()),
    }
}

fn bytes_in(folder: &Path) -> std::io::Result<u64> {
    let mut bytes = 0;
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        bytes += match entry.file_type()?.is_dir() {
            true => bytes_in(&entry.path())?,
            false => entry.metadata()?.len(),
        };
    }
    Ok(bytes)
}
