//! Views and their threads.

pub(crate) mod feed;
mod lockstep;
mod read_limit;
pub(crate) mod search;
pub(crate) mod shared;

use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use dataset::video::start_ffmpeg;
use labeller::Searcher;
use trainer::live::OnlineRun;

use crate::error::{Error, Result};
use crate::options::Pace;
use crate::queue::Queue;
use crate::source::Source;
use crate::view_state::ViewWatch;
use feed::{Feed, Message, OPEN_MS};
use lockstep::Lockstep;
use read_limit::ReadLimit;
use search::{Direction, Search};
use shared::Shared;

/// Maximum number of images that wait for the search.
const MAX_WAITING: usize = 4;

pub(crate) struct View {
    pub(crate) name: String,
    /// Source without secrets; `None` for a view that is left out.
    pub(crate) source: Option<String>,
    pub(crate) status: Arc<Mutex<ViewWatch>>,
}

pub(crate) struct Views {
    pub(crate) all: Vec<View>,
    pub(crate) messages: Receiver<Message>,
    threads: Vec<JoinHandle<()>>,
    shared: Arc<Shared>,
}

impl Views {
    /// Starts the threads of all views that have a source.
    pub(crate) fn start(
        run: &OnlineRun,
        searcher: Searcher,
        sources: &BTreeMap<String, Source>,
        shared: &Arc<Shared>,
    ) -> Result<Self> {
        start_ffmpeg();
        let (send, messages) = channel();
        let names = run.views();
        let lockstep = Arc::new(Lockstep::of(names.len()));
        let mut threads = Vec::new();
        let mut all = Vec::new();
        for (view, name) in names.iter().enumerate() {
            let status = Arc::<Mutex<ViewWatch>>::default();
            let source = sources.get(name);
            all.push(View {
                name: name.clone(),
                source: source.map(ToString::to_string),
                status: status.clone(),
            });
            let Some(source) = source else {
                lockstep.leave(view);
                continue;
            };
            let camera = run.camera(view);
            let queue = Arc::new(Queue::of(MAX_WAITING));
            let feed = Feed {
                view,
                name: name.clone(),
                source: source.clone(),
                size_px: [camera.width_px, camera.height_px],
                queue: queue.clone(),
                status: status.clone(),
                messages: send.clone(),
                shared: shared.clone(),
                last_time_s: None,
                connections: 0,
                open_ms: OPEN_MS,
                read_limit: ReadLimit::default(),
            };
            let thread = format!("feed {name}");
            threads.push(spawn(thread, send.clone(), move || feed.run())?);
            let search = searcher.view_search(&camera)?;
            let search = Search {
                view,
                name: name.clone(),
                search: match shared.pace {
                    Pace::AsFastAsPossible => search,
                    _ => search.spread(),
                },
                direction: Direction::default(),
                tracks: [0; 2],
                queue,
                status,
                messages: send.clone(),
                shared: shared.clone(),
                lockstep: lockstep.clone(),
            };
            let thread = format!("search {name}");
            threads.push(spawn(thread, send.clone(), move || search.run())?);
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

/// Starts a thread whose panic is told to the conductor: otherwise the view would stay as it was.
fn spawn(
    name: String,
    messages: Sender<Message>,
    work: impl FnOnce() + Send + 'static,
) -> Result<JoinHandle<()>> {
    let thread = thread::Builder::new().name(name.clone());
    let guard = PanicGuard { name, messages };
    let guarded = move || {
        let _guard = guard;
        work();
    };
    thread.spawn(guarded).map_err(Error::Thread)
}

/// Reports its thread's panic when it is dropped.
struct PanicGuard {
    name: String,
    messages: Sender<Message>,
}

impl Drop for PanicGuard {
    fn drop(&mut self) {
        if thread::panicking() {
            let thread = std::mem::take(&mut self.name);
            // Whoever reads it has ended if it fails.
            let _ = (self.messages).send(Message::Failed(Error::Panicked { thread }));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_of_a_thread_is_told_and_its_regular_end_is_not() {
        let (send, messages) = channel();
        spawn("feed left".into(), send.clone(), || {}).unwrap();
        spawn("search left".into(), send, || panic!("of the test")).unwrap();
        let told: Vec<Message> = messages.iter().collect();
        let [Message::Failed(error)] = &told[..] else {
            panic!("{} messages", told.len())
        };
        assert!(!error.is_bad_input() && error.to_string().contains("search left"));
    }
}
