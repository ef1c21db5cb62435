//! Options of the live estimation, checked against the run.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::path::PathBuf;

use labeller::Searcher;
use trainer::live::OnlineRun;

use crate::error::{Error, Result};
use crate::source::Source;

/// Offsets of clocks are smaller, seconds.
const MAX_OFFSET_S: f64 = 3_600.0;

/// Passing of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pace {
    /// There is a camera: clocks give the times of images.
    Cameras,
    /// All sources are recordings, played in their own time.
    RealTime,
    /// All sources are recordings, read as fast as they are searched.
    AsFastAsPossible,
}

/// Options of the live estimation.
pub struct Options {
    /// The run.
    pub run: OnlineRun,
    /// Search of the images.
    pub searcher: Searcher,
    /// Sources by view.
    pub sources: BTreeMap<String, Source>,
    /// Views that have none.
    pub without: Vec<String>,
    /// Added to the times of the views' images, s.
    pub offsets_s: BTreeMap<String, f64>,
    /// Views whose recordings have separate clocks, to be compared with the first view's.
    pub measured: BTreeSet<String>,
    /// Views whose servers may have any certificate; their sources have it as well.
    pub insecure_tls: BTreeSet<String>,
    /// File with the measured offsets for the next start.
    pub keep_offsets: Option<PathBuf>,
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
            .chain(self.offsets_s.keys().map(|view| ("--offset", view)))
            .chain(self.measured.iter().map(|view| ("--offset", view)))
            .chain((self.insecure_tls.iter()).map(|view| ("--insecure-tls", view)));
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
        let named = self.sources.iter().filter(|(_, of)| of.is_of_one_view());
        let mut seen: BTreeMap<String, &String> = BTreeMap::new();
        for (view, source) in named {
            if let Some(other) = seen.insert(source.identity(), view) {
                return Err(Error::Views(format!(
                    "views {other} and {view} have the same source, {source}; give each its own, or --without {view}"
                )));
            }
        }
        if self.sources.is_empty() {
            return Err(Error::Views(format!(
                "no view has a source; give at least one of {listed}"
            )));
        }
        if known
            .first()
            .is_some_and(|first| self.measured.contains(first))
        {
            return Err(Error::Views(format!(
                "--offset {}=auto: the other views are compared with the first one; give it for them",
                known[0]
            )));
        }
        check_offsets(&self.offsets_s)?;
        let camera = self.sources.values().find(|source| !source.is_recorded());
        match camera {
            Some(camera) if self.as_fast_as_possible => Err(Error::Views(format!(
                "--as-fast-as-possible needs recordings, and {camera} is a camera; leave the option out"
            ))),
            _ => Ok(()),
        }
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

/// Rejects offsets that are no numbers, or are too large.
fn check_offsets(offsets_s: &BTreeMap<String, f64>) -> Result<()> {
    let is_bad = |offset_s: &f64| !(-MAX_OFFSET_S..=MAX_OFFSET_S).contains(offset_s);
    match offsets_s.iter().find(|(_, offset_s)| is_bad(offset_s)) {
        None => Ok(()),
        Some((view, offset_s)) => Err(Error::Views(format!(
            "--offset {view} is {offset_s} s, expected -{MAX_OFFSET_S} to {MAX_OFFSET_S}; for a larger one set the clock of the camera"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_offset_of_more_than_an_hour_is_refused_with_the_limits() {
        let of = |offset_s: f64| check_offsets(&[("left".to_owned(), offset_s)].into());
        assert!(of(0.12).is_ok() && of(-3_600.0).is_ok());
        for offset_s in [1e300, -3_601.0, f64::NAN, f64::INFINITY] {
            let error = of(offset_s).unwrap_err();
            assert!(error.is_bad_input() && error.to_string().contains("-3600 to 3600"));
        }
    }
}
