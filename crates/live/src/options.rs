//! Options of a live estimation, checked against the run.

use std::collections::BTreeMap;
use std::net::SocketAddr;

use labeller::Searcher;
use trainer::live::OnlineRun;

use crate::error::{Error, Result};
use crate::feed::Pace;
use crate::source::Source;

/// Options of a live estimation.
pub struct Options {
    /// The run.
    pub run: OnlineRun,
    /// Search of the images.
    pub searcher: Searcher,
    /// Sources by view.
    pub sources: BTreeMap<String, Source>,
    /// Views that have none.
    pub without: Vec<String>,
    /// Seconds that are added to the times of a view's images.
    pub offsets_s: BTreeMap<String, f64>,
    /// Recordings are read as fast as they can be searched.
    pub as_fast_as_possible: bool,
    /// Address of the metrics.
    pub metrics: Option<SocketAddr>,
}

impl Options {
    /// Checks the views against those of the run.
    ///
    /// # Errors
    /// A view is unknown, missing or given twice, or a camera cannot be read faster than it delivers.
    pub fn check(&self) -> Result<()> {
        let known = self.run.views();
        let listed = known.join(", ");
        let named = (self.sources.keys().map(|view| ("--view", view)))
            .chain(self.without.iter().map(|view| ("--without", view)))
            .chain(self.offsets_s.keys().map(|view| ("--offset", view)));
        for (option, view) in named {
            if !known.contains(view) {
                return Err(Error::Views(format!(
                    "{option} {view}: the run has no such view; its views are {listed}"
                )));
            }
        }
        for view in known {
            let is_out = self.without.contains(view);
            match self.sources.get(view) {
                None if !is_out => {
                    return Err(Error::Views(format!(
                        "view {view} of the run has no source; give --view {view}=SOURCE, or --without {view} to estimate without it"
                    )));
                }
                Some(_) if is_out => {
                    return Err(Error::Views(format!(
                        "view {view} has a source and --without; leave one of them out"
                    )));
                }
                _ => {}
            }
        }
        if self.sources.is_empty() {
            return Err(Error::Views(format!(
                "no view has a source; give at least one of {listed}"
            )));
        }
        let mut offsets = self.offsets_s.iter();
        if let Some((view, _)) = offsets.find(|(_, offset_s)| !offset_s.is_finite()) {
            return Err(Error::Views(format!(
                "--offset {view}: expected a number of seconds"
            )));
        }
        let camera = self.sources.values().find(|source| !source.is_recorded());
        match camera {
            Some(camera) if self.as_fast_as_possible => Err(Error::Views(format!(
                "--as-fast-as-possible needs recordings, and {camera} is a camera; leave the option out"
            ))),
            _ => Ok(()),
        }
    }

    /// Seconds that are added to the times of each view's images.
    pub(crate) fn offsets_s(&self) -> Vec<f64> {
        let views = self.run.views().iter();
        views
            .map(|view| self.offsets_s.get(view).copied().unwrap_or(0.0))
            .collect()
    }

    pub(crate) fn pace(&self) -> Pace {
        if self.as_fast_as_possible {
            Pace::AsFastAsPossible
        } else if self.sources.values().all(Source::is_recorded) {
            Pace::RealTime
        } else {
            Pace::Cameras
        }
    }
}
