//! Opens every source once and reports the result.

use std::sync::Arc;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

use serde::Serialize;

use crate::clock::ClockSource;
use crate::error::{Error, Result};
use crate::options::Options;
use crate::output::metrics::Metrics;
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
    /// Cause if it has no images.
    pub why: Option<String>,
}

/// Opens all sources until each has shown an image.
///
/// # Errors
/// The run has other views, or a source can never be used.
pub fn check(options: &Options, is_stopped: &dyn Fn() -> bool) -> Result<Vec<CheckedSource>> {
    options.check()?;
    let metrics = Metrics::new(options.run.blake3().to_string(), options.run.views());
    let shared = Arc::new(Shared::of(options, Arc::new(metrics)));
    let views = Views::start(options, &shared, false)?;
    let found = |view: &View| {
        Some(CheckedSource {
            view: view.name.clone(),
            source: view.source.clone()?,
            codec: None,
            size_px: None,
            clock: None,
            why: Some(format!("no image in {} s", TIMEOUT.as_secs())),
        })
    };
    let mut all: Vec<Option<CheckedSource>> = views.all.iter().map(found).collect();
    let until = Instant::now() + TIMEOUT;
    let is_open = |found: &CheckedSource| found.size_px.is_none();
    let mut refused = None;
    while all.iter().flatten().any(is_open) && Instant::now() < until && !is_stopped() {
        let (view, report) = match views.messages.recv_timeout(WAIT) {
            Ok(Message::Report(view, report)) => (view, report),
            Ok(Message::Failed(error)) => {
                refused = Some(error);
                break;
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
    match refused {
        Some(error) => Err(error),
        None => Ok(all.into_iter().flatten().collect()),
    }
}
