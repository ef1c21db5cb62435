//! A small cache of results for numbered instants: frames are requested in order, sometimes by several threads.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Size of the cache. Sky rows take 5 MB per full-size image.
const MAX_INSTANTS: usize = 3;

/// The results for some instants.
pub(crate) struct InstantCache<T>(Mutex<BTreeMap<i64, Arc<T>>>);

impl<T> Default for InstantCache<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T> InstantCache<T> {
    /// The result for an instant, computed if it is not cached.
    pub(crate) fn get(&self, instant: i64, compute: impl FnOnce() -> T) -> Arc<T> {
        // The lock is not held while computing: a rayon worker that waits inside could pick up a job that needs the lock as well.
        if let Some(found) = self.lock().get(&instant) {
            return Arc::clone(found);
        }
        let computed = Arc::new(compute());
        let mut kept = self.lock();
        kept.insert(instant, Arc::clone(&computed));
        while kept.len() > MAX_INSTANTS {
            // The one farthest in time from the requested instant.
            let farthest = kept
                .keys()
                .copied()
                .max_by_key(|&kept| (kept - instant).abs());
            farthest.and_then(|key| kept.remove(&key));
        }
        computed
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, BTreeMap<i64, Arc<T>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
