//! The clocks of all views: which are compared with that of the first one, what is known of them, and what is kept for the next start.

use std::collections::BTreeMap;
use std::path::PathBuf;

use dataset::files::json_file::{read_json, write_json_unsynced};
use dataset::geometry::rays::Sighting;

use crate::clock_offset::Offset;
use crate::error::Result;
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
        let run = &options.run;
        let clock = |(view, name): (usize, &String)| {
            let is_given = view == 0 || options.offsets_s.contains_key(name);
            let cameras = [0, view].map(|view| run.camera(view));
            (!is_given).then(|| FreeClock::of(cameras, kept.get(name).copied()))
        };
        Ok(Self {
            names: run.views().to_vec(),
            clocks: run.views().iter().enumerate().map(clock).collect(),
            kept,
            file,
        })
    }

    /// True if a view's times can be compared with those of the first one.
    pub(crate) fn is_known(&self, view: usize) -> bool {
        self.clocks[view].as_ref().is_none_or(FreeClock::is_known)
    }

    /// Takes what the first view and another one with a free clock see at a time.
    pub(crate) fn take(
        &mut self,
        view: usize,
        time_s: f64,
        sighting: Option<Sighting>,
    ) -> Option<News> {
        let news = self.clocks[view].as_mut()?.take(time_s, sighting);
        if let Some(News::Known(offset)) = news {
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
        let kept = self.kept.get(&self.names[view]);
        // What is only told again at a start is not measured again.
        if kept.is_some_and(|kept| (kept.offset_s - offset.offset_s).abs() < 1e-9) {
            return;
        }
        self.kept.insert(self.names[view].clone(), offset);
        let written = self
            .file
            .as_ref()
            .map(|path| write_json_unsynced(path, &self.kept));
        if let Some(Err(error)) = written {
            tracing::warn!(
                "the offset of view {} is not kept: {error}",
                self.names[view]
            );
        }
    }
}
