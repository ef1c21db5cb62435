//! Pairs the views at each tick, whichever worker decodes them: each view is registered with the reference view, the first one.
//!
//! A patch waits for its counterpart and is dropped with it. If both views are decoded at the same time, few patches wait; if one worker
//! decodes the views in turn, a whole view's patches wait, some kilobytes each.

pub(crate) mod best_box;
pub(crate) mod fitted_cameras;

use std::collections::{BTreeMap, HashSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use dataset::corpus::detections::Detections;
use dataset::geometry::camera::Camera;
use dataset::tables::registrations::{NoShift, Registration, Shift};

use crate::registration::{ExpectedDifference, Patch, register};

/// A view's best box at a tick, with its surroundings.
type SharedPatch = Arc<Result<Patch, NoShift>>;

/// Registrations between several views.
pub(super) struct Pairs {
    /// Identifiers and cameras of the views; the first is the reference.
    views: Vec<(String, Camera)>,
    waiting: Mutex<BTreeMap<u32, Waiting>>,
    done: Mutex<Done>,
}

/// Arrived views at one tick.
#[derive(Default)]
struct Waiting {
    reference: Option<SharedPatch>,
    others: Vec<(usize, SharedPatch)>,
    registered: usize,
}

/// Registrations, and the time that they took.
#[derive(Default)]
pub(super) struct Done {
    pub(super) registrations: Vec<Registration>,
    pub(super) seconds: f64,
}

impl Done {
    /// Takes back the registrations of images that keep no box.
    pub(super) fn without_boxes(mut self, detections: &Detections) -> Self {
        let boxes = detections.boxes.iter();
        let seen: HashSet<_> = boxes.map(|kept| (kept.tick, kept.view.as_str())).collect();
        for found in &mut self.registrations {
            let is_seen = |view: &String| seen.contains(&(found.tick, view.as_str()));
            if !is_seen(&found.view) || !is_seen(&found.reference) {
                found.result = Err(NoShift::NoBox);
            }
        }
        self
    }
}

impl Pairs {
    pub(super) fn new(views: Vec<(String, Camera)>) -> Self {
        Self {
            views,
            waiting: Mutex::default(),
            done: Mutex::default(),
        }
    }

    /// Identifier of the view that the others are compared with.
    pub(super) fn reference(&self) -> &str {
        &self.views[0].0
    }

    /// Takes a view's patch at a tick, and registers all pairs that it completes.
    pub(super) fn take(&self, view: usize, tick: u32, look: Result<Patch, NoShift>) {
        let look = Arc::new(look);
        let (reference, others) = {
            let mut waiting = lock(&self.waiting);
            let here = waiting.entry(tick).or_default();
            if view == 0 {
                here.reference = Some(look);
            } else {
                here.others.push((view, look));
            }
            let Some(reference) = here.reference.clone() else {
                return;
            };
            let others = std::mem::take(&mut here.others);
            here.registered += others.len();
            if here.registered + 1 == self.views.len() {
                waiting.remove(&tick);
            }
            (reference, others)
        };
        for (view, look) in others {
            let started = Instant::now();
            let registration = Registration {
                tick,
                view: self.views[view].0.clone(),
                reference: self.reference().to_owned(),
                result: register_views(
                    [0, view].map(|index| &self.views[index].1),
                    [&reference, &look],
                ),
            };
            let mut done = lock(&self.done);
            done.registrations.push(registration);
            done.seconds += started.elapsed().as_secs_f64();
        }
    }

    /// All registrations, by tick and then by view. Patches that still wait after a failure are dropped.
    pub(super) fn finish(&self) -> Done {
        lock(&self.waiting).clear();
        let mut done = std::mem::take(&mut *lock(&self.done));
        let order = |id: &str| self.views.iter().position(|(view, _)| view == id);
        done.registrations
            .sort_by_key(|found| (found.tick, order(&found.view)));
        done
    }
}

/// Measures the shift of the aircraft from the first view to the second, from the surroundings of their best boxes.
///
/// # Errors
/// The reason why there is no shift.
pub fn register_views(
    [reference, view]: [&Camera; 2],
    looks: [&Result<Patch, NoShift>; 2],
) -> Result<Shift, NoShift> {
    let (from, to) = match looks {
        [Ok(from), Ok(to)] => (from, to),
        // No box says more than one that is cut off.
        [Err(NoShift::NoBox), _] | [_, Err(NoShift::NoBox)] => return Err(NoShift::NoBox),
        [Err(reason), _] | [_, Err(reason)] => return Err(*reason),
    };
    let expected = ExpectedDifference::of(reference, view, from.centre_px(), to.centre_px());
    register(from, to, &expected)
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
