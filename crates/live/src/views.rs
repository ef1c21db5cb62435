//! The threads of all views, and what they say.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crate::error::{Error, Result};
use crate::feed::{Feed, Message, Shared, ViewStatus};
use crate::lockstep::Lockstep;
use crate::options::Options;
use crate::search::Search;
use crate::slot::Slot;

/// Images of a view that wait for its search.
const MOST_WAITING: usize = 4;

/// A view of the run.
pub(crate) struct View {
    pub(crate) name: String,
    /// Its source, without secrets; `None` if it has none.
    pub(crate) source: Option<String>,
    pub(crate) status: Arc<ViewStatus>,
}

/// All views at work.
pub(crate) struct Views {
    pub(crate) all: Vec<View>,
    pub(crate) messages: Receiver<Message>,
    threads: Vec<JoinHandle<()>>,
    shared: Arc<Shared>,
}

impl Views {
    /// Starts the threads of all views that have a source. `searches`: false if images are only looked at.
    pub(crate) fn start(options: &Options, shared: &Arc<Shared>, searches: bool) -> Result<Self> {
        let (send, messages) = channel();
        let names = options.run.views();
        let lockstep = Arc::new(Lockstep::of(names.len()));
        let mut threads = Vec::new();
        let mut all = Vec::new();
        for (view, name) in names.iter().enumerate() {
            let status = Arc::<ViewStatus>::default();
            let source = options.sources.get(name);
            all.push(View {
                name: name.clone(),
                source: source.map(ToString::to_string),
                status: status.clone(),
            });
            let Some(source) = source else {
                lockstep.leave(view);
                continue;
            };
            let camera = options.run.camera(view);
            let slot = Arc::new(Slot::of(MOST_WAITING));
            let feed = Feed {
                view,
                name: name.clone(),
                source: source.clone(),
                size_px: [camera.width_px, camera.height_px],
                slot: slot.clone(),
                status: status.clone(),
                messages: send.clone(),
                shared: shared.clone(),
                last_time_s: None,
            };
            threads.push(spawn(format!("feed {name}"), move || feed.run())?);
            if !searches {
                continue;
            }
            let search = Search {
                view,
                name: name.clone(),
                search: options.searcher.view_search(&camera)?,
                slot,
                status,
                messages: send.clone(),
                shared: shared.clone(),
                lockstep: lockstep.clone(),
            };
            threads.push(spawn(format!("search {name}"), move || search.run())?);
        }
        Ok(Self {
            all,
            messages,
            threads,
            shared: shared.clone(),
        })
    }

    /// Ends all threads, and waits for them, but not longer than this: a device may hold one.
    pub(crate) fn stop(self, most: Duration) {
        self.shared.stop.store(true, Ordering::Relaxed);
        let until = Instant::now() + most;
        while self.threads.iter().any(|thread| !thread.is_finished()) && Instant::now() < until {
            thread::sleep(Duration::from_millis(5));
        }
    }
}

fn spawn(name: String, work: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>> {
    let thread = thread::Builder::new().name(name);
    thread.spawn(work).map_err(Error::Thread)
}
