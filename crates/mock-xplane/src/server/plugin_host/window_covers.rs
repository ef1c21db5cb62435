//! Windows that a test lets the hosted simulator draw over its scene, for some time: X-Plane's own or a plugin's.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Form of such a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WindowForm {
    /// X-Plane's message: an opaque box with text.
    Message,
    /// A plugin's window: half transparent, with a frame and text.
    Plugin,
}

/// A window with its place in the simulator's window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ShownWindow {
    pub(super) form: WindowForm,
    /// Left, top, right, bottom, pixels.
    pub(super) area_px: [u32; 4],
}

/// The windows over the scene now. Clones share them.
#[derive(Debug, Clone, Default)]
pub struct WindowCovers(Arc<Mutex<Vec<(ShownWindow, Instant)>>>);

impl WindowCovers {
    /// Shows a window at an area (left, top, right, bottom, pixels from the top left) for some time.
    pub fn show(&self, form: WindowForm, area_px: [u32; 4], time: Duration) {
        let window = ShownWindow { form, area_px };
        self.lock().push((window, Instant::now() + time));
    }

    /// Closes all windows.
    pub fn close_all(&self) {
        self.lock().clear();
    }

    /// Windows that have not ended.
    pub(super) fn shown(&self) -> Vec<ShownWindow> {
        let now = Instant::now();
        let mut windows = self.lock();
        windows.retain(|(_, end)| *end > now);
        windows.iter().map(|(window, _)| *window).collect()
    }

    fn lock(&self) -> MutexGuard<'_, Vec<(ShownWindow, Instant)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
