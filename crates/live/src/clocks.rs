//! The clocks of all views: comparison with the first view's, their offsets, and the file that keeps these for the next start.

use std::collections::BTreeMap;
use std::path::PathBuf;

use dataset::files::json_file::{read_json, write_json};
use dataset::geometry::rays::Sighting;

use crate::clock_offset::{Offset, RECORDING_DRIFT_SD, STREAM_DRIFT_SD};
use crate::error::{Error, Result};
use crate::free_clocks::{FreeClock, News};
use crate::options::Options;

/// Offsets by view, as they are kept.
type Kept = BTreeMap<String, Offset>;

/// The clocks of all views.
#[derive(Debug)]
pub(crate) struct Clocks {
    names: Vec<String>,
    /// None of the first view, and of those whose offset is given.
    clocks: Vec<Option<FreeClock>>,
    /// Views that have had images.
    had_images: Vec<bool>,
    kept: Kept,
    file: Option<PathBuf>,
}

impl Clocks {
    /// Clocks that are compared where no offset is given.
    ///
    /// # Errors
    /// The file of an earlier start cannot be read.
    pub(crate) fn of(options: &Options) -> Result<Self> {
        let file = options.keep_offsets.clone();
        let kept: Kept = match &file {
            Some(path) if path.exists() => read_json(path, "file of kept offsets")?,
            _ => Kept::new(),
        };
        let unsound = kept.iter().find(|(_, offset)| !offset.is_sound());
        if let (Some(path), Some((view, _))) = (&file, unsound) {
            return Err(Error::Views(format!(
                "{}: the offset of view {view} cannot be one that was measured, because its standard deviations are not positive; remove \
                 the file",
                path.display()
            )));
        }
        let run = &options.run;
        let clock = |(view, name): (usize, &String)| {
            let is_given = view == 0 || options.offsets_s.contains_key(name);
            let cameras = [0, view].map(|view| run.camera(view));
            let drift_sd = if options.measured.contains(name) {
                RECORDING_DRIFT_SD
            } else {
                STREAM_DRIFT_SD
            };
            (!is_given).then(|| FreeClock::of(cameras, kept.get(name).copied(), drift_sd))
        };
        Ok(Self {
            names: run.views().to_vec(),
            had_images: vec![false; run.views().len()],
            clocks: run.views().iter().enumerate().map(clock).collect(),
            kept,
            file,
        })
    }

    /// True if a view's times can be compared with the first view's.
    pub(crate) fn is_known(&self, view: usize) -> bool {
        self.clocks[view].as_ref().is_none_or(FreeClock::is_known)
    }

    /// A view shows the first image of a connection. After an earlier one, its images may come by other ways.
    pub(crate) fn connected(&mut self, view: usize, time_s: f64) {
        if !std::mem::replace(&mut self.had_images[view], true) {
            return;
        }
        for (other, clock) in self.clocks.iter_mut().enumerate() {
            if let Some(clock) = clock.as_mut().filter(|_| view == 0 || view == other) {
                clock.restart(time_s);
            }
        }
    }

    /// Takes what the first view and another one with a free clock see at a time.
    pub(crate) fn take(
        &mut self,
        view: usize,
        time_s: f64,
        sighting: Option<Sighting>,
    ) -> Option<News> {
        let news = self.clocks[view].as_mut()?.take(time_s, sighting);
        let has_measured = self.clocks[view]
            .as_ref()
            .is_some_and(FreeClock::has_measured);
        if let Some(News::Known(offset)) = news
            && has_measured
        {
            self.keep(view, offset);
        }
        news
    }

    /// The offsets that the last arrivals told, by view.
    pub(crate) fn at_end(&mut self) -> Vec<(usize, Offset)> {
        let clocks = self.clocks.iter_mut().enumerate();
        let ends = clocks.filter_map(|(view, clock)| Some((view, clock.as_mut()?.at_end()?)));
        let ends: Vec<(usize, Offset)> = ends.collect();
        for (view, offset) in &ends {
            self.keep(*view, *offset);
        }
        ends
    }

    fn keep(&mut self, view: usize, offset: Offset) {
        self.kept.insert(self.names[view].clone(), offset);
        let written = self.file.as_ref().map(|path| write_json(path, &self.kept));
        if let Some(Err(error)) = written {
            tracing::warn!(
                "the offset of view {} is not kept: {error}",
                self.names[view]
            );
        }
    }
}
