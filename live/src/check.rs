//! Opens every source, compares its surroundings with the training's, and reports the result.

use std::sync::Arc;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

use serde::Serialize;
use sight::background::IMAGES;

use crate::clock::ClockSource;
use crate::error::{Error, Result};
use crate::options::Options;
use crate::output::Surroundings;
use crate::output::metrics::Metrics;
use crate::source::Source;
use crate::views::feed::{Message, Report};
use crate::views::shared::Shared;
use crate::views::{View, Views};

/// A source that does not answer in this time is not there.
const TIMEOUT: Duration = Duration::from_secs(8);
const WAIT: Duration = Duration::from_millis(50);

/// A source that was opened.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckedSource {
    /// Name of the view.
    pub view: String,
    /// The source, without secrets.
    pub source: String,
    /// FFmpeg's name of the codec; null if it is not there.
    pub codec: Option<&'static str>,
    /// Columns and rows of the images.
    pub size_px: Option<[u32; 2]>,
    /// Origin of the first images' times.
    pub clock: Option<ClockSource>,
    /// Its surroundings beside the training's; null without enough images in time.
    pub surroundings: Option<Surroundings>,
    /// Cause if it has no images, or too few.
    pub why: Option<String>,
}

impl CheckedSource {
    /// True if it shows what another view showed in the training, or other surroundings.
    pub fn is_another_camera(&self) -> bool {
        let surroundings = self.surroundings.as_ref();
        surroundings.is_some_and(|of| ["other_view", "elsewhere"].contains(&of.shows))
    }
}

/// Opens all sources until each has shown its surroundings.
///
/// # Errors
/// The run has other views, or a source can never be used.
pub fn check(mut options: Options, is_stopped: &dyn Fn() -> bool) -> Result<Vec<CheckedSource>> {
    options.check()?;
    // Nobody waits for a recording's own pace.
    options.as_fast_as_possible = options.sources.values().all(Source::is_recorded);
    let metrics = Metrics::new(options.run.blake3().to_string(), options.run.views());
    let shared = Arc::new(Shared::of(&options, Arc::new(metrics)));
    let views = Views::start(&options.run, options.searcher, &options.sources, &shared)?;
    let found = |view: &View| {
        Some(CheckedSource {
            view: view.name.clone(),
            source: view.source.clone()?,
            codec: None,
            size_px: None,
            clock: None,
            surroundings: None,
            why: Some(format!("no image in {} s", TIMEOUT.as_secs())),
        })
    };
    let mut all: Vec<Option<CheckedSource>> = views.all.iter().map(found).collect();
    let until = Instant::now() + TIMEOUT;
    let mut has_finished = vec![false; all.len()];
    let mut refused = None;
    while Instant::now() < until && !is_stopped() {
        let waits = |(found, over): (&Option<CheckedSource>, &bool)| {
            let found = found.as_ref();
            !over && found.is_some_and(|found| found.surroundings.is_none())
        };
        if !all.iter().zip(&has_finished).any(waits) {
            break;
        }
        let (view, report) = match views.messages.recv_timeout(WAIT) {
            Ok(Message::Report(view, report)) => (view, report),
            Ok(Message::Failed(error)) => {
                refused = Some(error);
                break;
            }
            Ok(Message::Searched(view, searched)) => {
                if let (Some(found), Some(background)) =
                    (&mut all[view], &searched.looked.background)
                {
                    let shown = options.run.show(view, background);
                    found.surroundings = Some(Surroundings::of(&shown));
                }
                continue;
            }
            Ok(Message::Finished(view)) => {
                has_finished[view] = true;
                continue;
            }
            Ok(_) | Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => break,
        };
        let Some(found) = &mut all[view] else {
            continue;
        };
        match report {
            Report::Opened { codec } => found.codec = Some(codec),
            Report::FirstImage { size_px, clock } => {
                (found.size_px, found.clock, found.why) = (Some(size_px), Some(clock), None);
            }
            Report::Lost(why) => found.why = Some(why),
            Report::Useless(why) => {
                refused = Some(Error::View {
                    view: found.view.clone(),
                    source: found.source.clone(),
                    why,
                });
                break;
            }
            Report::Clock(_) | Report::Ended => {}
        }
    }
    views.stop(Duration::from_secs(1));
    for found in all.iter_mut().flatten() {
        if found.size_px.is_some() && found.surroundings.is_none() {
            let why = format!(
                "fewer than {IMAGES} images that show its surroundings in {} s",
                TIMEOUT.as_secs()
            );
            found.why.get_or_insert(why);
        }
    }
    match refused {
        Some(error) => Err(error),
        None => Ok(all.into_iter().flatten().collect()),
    }
}
