//! Pairs the views of a tick, whichever worker decodes them: each view is registered with the reference view, the first one.
//!
//! A patch waits for its counterpart and is dropped with it. If both views are decoded at the same time, few patches wait; if one worker
//! decodes one view after the other, all patches of a view wait, some kilobytes each.

pub(crate) mod best_box;
pub(crate) mod fitted_cameras;

use std::collections::{BTreeMap, HashSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use dataset::corpus::detections::Detections;
use dataset::geometry::camera::Camera;
use dataset::tables::registrations::{NoShift, Registration, Shift};

use crate::registration::{Expected, Patch, register};

/// Result of a view at a tick: the surroundings of its best box, if there is one.
type Look = Arc<Result<Patch, NoShift>>;

/// The registrations of a scenario with several views.
pub(super) struct Pairs {
    /// Identifiers and cameras of the views; the first is the reference.
    views: Vec<(String, Camera)>,
    waiting: Mutex<BTreeMap<u32, Waiting>>,
    done: Mutex<Done>,
}

/// The views of a tick that are there.
#[derive(Default)]
struct Waiting {
    reference: Option<Look>,
    /// Views that came before the reference.
    others: Vec<(usize, Look)>,
    /// Views that were registered.
    registered: usize,
}

/// Registrations, and the time that they took.
#[derive(Default)]
pub(super) struct Done {
    pub(super) registrations: Vec<Registration>,
    pub(super) seconds: f64,
}

impl Done {
    /// Takes back the registrations of images of which no box was kept.
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

    /// Takes what a view shows at a tick, and registers all pairs that this completes.
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
                result: self.compare(&reference, view, &look),
            };
            let mut done = lock(&self.done);
            done.registrations.push(registration);
            done.seconds += started.elapsed().as_secs_f64();
        }
    }

    fn compare(&self, reference: &Look, view: usize, look: &Look) -> Result<Shift, NoShift> {
        let cameras = [0, view].map(|index| &self.views[index].1);
        registered(cameras, [reference.as_ref(), look.as_ref()])
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

/// The shift from the first view to the second, from the surroundings of their best boxes.
pub(crate) fn registered(
    [reference, view]: [&Camera; 2],
    looks: [&Result<Patch, NoShift>; 2],
) -> Result<Shift, NoShift> {
    let (from, to) = match looks {
        [Ok(from), Ok(to)] => (from, to),
        // No box says more than one that is cut off.
        [Err(NoShift::NoBox), _] | [_, Err(NoShift::NoBox)] => return Err(NoShift::NoBox),
        [Err(reason), _] | [_, Err(reason)] => return Err(*reason),
    };
    let expected = Expected::of(reference, view, from.centre_px(), to.centre_px());
    register(from, to, &expected)
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
