//! A sweep: the TOML file in which a researcher says which scenarios a corpus shall hold.
//!
//! In goes the file, out comes a [`Sweep`] whose every value has been checked, or one message with file, line and column.
//! What a sweep expands to is the business of [`crate::plan`].

mod check;
mod document;
mod error;
mod frame_rate_text;
mod locate;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use dataset::conditions::Weather;
use dataset::runway::Runway;
use dataset::video::VideoSettings;
use xplane_bridge::fly::ApproachProfile;

pub use document::{Camera, Corpus, Grid, Picture, RecordedRule, SplitFractions, Start};
pub use error::SweepError;

use crate::recording::Recording;
use crate::time_of_day::TimeOfDay;

/// A checked sweep, with the recordings that it names already read.
#[derive(Debug, Clone)]
pub struct Sweep {
    /// Name of the corpus and its master seed.
    pub corpus: Corpus,
    /// Where the aircraft land.
    pub runway: Runway,
    /// Aircraft type.
    pub aircraft: String,
    /// Name of the camera rig in use.
    pub rig_name: String,
    /// Its cameras.
    pub cameras: Vec<Camera>,
    /// Which times, weathers and repeats are combined.
    pub grid: Grid,
    /// The times of [`Sweep::grid`], parsed.
    pub times: Vec<TimeOfDay>,
    /// Size and rate of the pictures.
    pub picture: Picture,
    /// How videos are coded.
    pub video: VideoSettings,
    /// How live flights begin.
    pub start: Start,
    /// Sizes of the sides of the split.
    pub split: SplitFractions,
    /// All weathers that the file defines.
    pub weathers: BTreeMap<String, Weather>,
    /// All flight profiles that the file defines.
    pub profiles: BTreeMap<String, ApproachProfile>,
    /// Which scenarios fly recordings.
    pub recorded: Vec<RecordedFlights>,
    /// The file as it was read.
    pub text: String,
}

/// A rule of the sweep and the recordings that its pattern found, in the order of their names.
#[derive(Debug, Clone)]
pub struct RecordedFlights {
    /// The rule.
    pub rule: RecordedRule,
    /// The recordings; never empty.
    pub recordings: Vec<Recording>,
}

impl Sweep {
    /// Reads and checks a sweep. Paths in it are relative to its own folder.
    pub fn read(path: &Path) -> Result<Self, SweepError> {
        let text =
            fs::read_to_string(path).map_err(|source| SweepError::unreadable(path, &source))?;
        let folder = path.parent().map(PathBuf::from).unwrap_or_default();
        Self::parse(path, &folder, text)
    }

    /// Checks the text of a sweep; `path` is what messages call it, `folder` is what its paths are relative to.
    pub fn parse(path: &Path, folder: &Path, text: String) -> Result<Self, SweepError> {
        let document: document::Document = toml::from_str(&text)
            .map_err(|error| SweepError::at(path, &text, error.span(), error.message().trim()))?;
        check::check(document, folder, &text).map_err(|fault| {
            let span = locate::span_of(&text, &fault.key);
            SweepError::at(path, &text, span, &fault.message)
        })
    }

    /// Number of scenarios that the sweep expands to.
    pub fn len(&self) -> usize {
        self.grid.repeats as usize * self.times.len() * self.grid.weathers.len()
    }

    /// Whether it expands to none: never, for a checked sweep.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

#[cfg(test)]
pub(crate) mod tests;
