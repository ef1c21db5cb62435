//! Opens every source once, and says what it found.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

use serde::Serialize;

use crate::clocks::clock::{ClockSource, RunClock};
use crate::conductor::views::Views;
use crate::error::{Error, Result};
use crate::feed::{Message, Report};
use crate::options::Options;
use crate::output::metrics::Metrics;
use crate::shared::Shared;

/// A source that does not answer in this time is not there.
const MAX_COUNT: Duration = Duration::from_secs(8);
const WAIT: Duration = Duration::from_millis(50);

/// A source that was opened.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Found {
    /// Name of the view.
    pub view: String,
    /// The source, without secrets.
    pub source: String,
    /// FFmpeg's name of the codec; null if it is not there.
    pub codec: Option<&'static str>,
    /// Columns and rows of its images.
    pub size_px: Option<[u32; 2]>,
    /// Source of the times of its first images.
    pub clock: Option<ClockSource>,
    /// Cause if it has no images.
    pub why: Option<String>,
}

/// Opens all sources until each has shown an image.
///
/// # Errors
/// The run has other views, or a source can never be used.
pub fn check(options: &Options, is_stopped: &dyn Fn() -> bool) -> Result<Vec<Found>> {
    options.check()?;
    let metrics = Arc::new(Metrics::new(
        options.run.blake3().to_string(),
        options.run.views(),
    ));
    let stop = Arc::new(AtomicBool::new(false));
    let (clock, pace) = (RunClock::start(), options.pace());
    let shared = Shared::new(
        clock,
        pace,
        stop,
        metrics,
        options.given_s(),
        options.is_measured(),
    );
    let shared = Arc::new(shared);
    let views = Views::start(options, &shared, false)?;
    let found = |view: &crate::conductor::views::View| {
        Some(Found {
            view: view.name.clone(),
            source: view.source.clone()?,
            codec: None,
            size_px: None,
            clock: None,
            why: Some(format!("no image in {} s", MAX_COUNT.as_secs())),
        })
    };
    let mut all: Vec<Option<Found>> = views.all.iter().map(found).collect();
    let until = Instant::now() + MAX_COUNT;
    let is_open = |found: &Found| found.size_px.is_none();
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
