//! The folder of an export, and its workshop.
//!
//! ```text
//! DIR              complete, sealed with MANIFEST.b3 and DONE.json
//! DIR.partial/
//!   begun.json     what it is an export of
//!   parts/<id>.json    scenarios whose files are all written
//!   new/           its files
//! ```

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use dataset::corpus::Corpus;
use dataset::corpus::seal;
use dataset::corpus::workshop::{NEW, Workshop, refuse_strangers, resolve};
use dataset::files::folder::bytes_below;
use dataset::files::json_file::{read_json, write_json};
use dataset::files::new_file::clear_leftovers;
use dataset::files::own_path::resolved;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

const BEGUN: &str = "begun.json";
const PARTS: &str = "parts";

/// Hash of the request and its scenarios' seals, which identifies an export.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Begun {
    source_blake3: String,
}

/// An export that is being made; locked until this is dropped.
#[derive(Debug)]
pub(crate) struct UnfinishedExport {
    workshop: Workshop,
    source_blake3: String,
}

/// State of a destination.
pub(crate) enum Destination {
    /// Already complete, with files of this size.
    Complete { bytes: u64 },
    /// The export is to be made or resumed.
    Unfinished(UnfinishedExport),
}

impl UnfinishedExport {
    /// Takes the destination for an export of this source.
    pub(crate) fn take(out: &Path, source_blake3: &str) -> Result<Destination> {
        let out = resolve(out)?;
        let enter = || Workshop::enter(&out, &[BEGUN, PARTS], Duration::ZERO);
        if let Some(sealed) = seal::read_seal(&out)? {
            if sealed.config_hash != source_blake3 {
                let out = out.display();
                return Err(Error::Request(format!(
                    "{out} is an export with other options or of other files; remove it, or export to another folder"
                )));
            }
            if let Some(fault) = seal::faults(&out)?.into_iter().next() {
                let out = out.display();
                return Err(Error::Request(format!(
                    "{out} was exported, but then changed: {fault}; remove it to export again"
                )));
            }
            let bytes = bytes_below(&out)?;
            let partial = Workshop::beside(&out);
            if partial.join(BEGUN).exists() && !partial.join(NEW).exists() {
                // Killed, or failed, after its files were moved.
                match enter() {
                    Err(error) if error.is_passing() => {}
                    workshop => remove_notes(&workshop?)?,
                }
            }
            return Ok(Destination::Complete { bytes });
        }
        refuse_strangers(&out, "is not empty:", |_| false)?;
        let workshop = enter()?;
        if !workshop.path(NEW).is_dir() {
            // Killed after its files were moved: the notes on them are obsolete.
            workshop.remove(PARTS)?;
        }
        let begun = workshop.path(BEGUN);
        let mine = Begun {
            source_blake3: source_blake3.to_owned(),
        };
        if begun.exists() {
            let found: Begun = read_json(&begun, "record of an export")?;
            if found != mine {
                let partial = Workshop::beside(&out);
                return Err(Error::Request(format!(
                    "{} is an unfinished export with other options or of other files; remove it, or export to another folder",
                    partial.display()
                )));
            }
        } else {
            write_json(&begun, &mine)?;
        }
        for folder in [PARTS, NEW] {
            let folder = workshop.path(folder);
            fs::create_dir_all(&folder).map_err(dataset::Error::io("create", &folder))?;
            clear_leftovers(&folder);
        }
        Ok(Destination::Unfinished(Self {
            workshop,
            source_blake3: source_blake3.to_owned(),
        }))
    }

    /// The folder for its files.
    pub(crate) fn files(&self) -> PathBuf {
        self.workshop.path(NEW)
    }

    pub(crate) fn has_part(&self, scenario: &str) -> bool {
        self.part_path(scenario).exists()
    }

    /// The note on a scenario.
    pub(crate) fn part<T: DeserializeOwned>(&self, scenario: &str) -> Result<T> {
        Ok(read_json(&self.part_path(scenario), "part of an export")?)
    }

    /// Records a scenario as written, with the data needed at the end.
    pub(crate) fn note(&self, scenario: &str, part: &impl Serialize) -> Result<()> {
        Ok(write_json(&self.part_path(scenario), part)?)
    }

    fn part_path(&self, scenario: &str) -> PathBuf {
        self.workshop.path(PARTS).join(format!("{scenario}.json"))
    }

    /// Removes the unfinished files, so that a new export starts once the corpus is repaired.
    pub(crate) fn abandon(self) -> Result<()> {
        // The records of finished work are removed first, so that an export killed in between is not resumed.
        self.workshop.remove(PARTS)?;
        self.workshop.remove(NEW)?;
        Ok(self.workshop.remove(BEGUN)?)
    }

    /// Seals the files and moves them to the destination. Returns their size in bytes.
    pub(crate) fn finish(self) -> Result<u64> {
        let files = self.files();
        seal::seal_folder(&files, &self.source_blake3)?;
        let bytes = bytes_below(&files)?;
        self.workshop.put_in_place()?;
        remove_notes(&self.workshop)?;
        Ok(bytes)
    }
}

/// Removes the notes on an export whose files are in place.
fn remove_notes(workshop: &Workshop) -> Result<()> {
    workshop.remove(PARTS)?;
    Ok(workshop.remove(BEGUN)?)
}

/// Refuses a destination within the corpus, to which only its own files may be written, or around it.
pub(crate) fn refuse_corpus(corpus: &Corpus, out: &Path) -> Result<()> {
    let corpus = resolved(corpus.root())?;
    let place = resolved(out)?;
    let is_around = [place.clone(), Workshop::beside(&place)]
        .iter()
        .any(|folder| corpus.starts_with(folder));
    if is_around || place.starts_with(&corpus) {
        Err(Error::Request(format!(
            "{} is the corpus {}, in it, or around it; choose a folder elsewhere",
            out.display(),
            corpus.display()
        )))
    } else {
        Ok(())
    }
}
