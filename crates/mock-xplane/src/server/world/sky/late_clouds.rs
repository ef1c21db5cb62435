//! Clouds that are delayed: until they come, all slots read the old ones.

use std::collections::BTreeMap;

use crate::datarefs::Datarefs;

/// Delay of clouds after the last of their writes, seconds.
const LATE_S: f64 = 55.0;

/// Clouds that were written and are still delayed.
#[derive(Debug, Clone, Default)]
pub(super) struct LateClouds {
    /// Values to come, by element.
    coming: BTreeMap<String, f64>,
    last_write_s: f64,
    show: bool,
}

/// Clouds that have just come.
#[derive(Debug)]
pub(super) struct Snapped {
    /// The datarefs that changed, without index.
    pub(super) names: Vec<String>,
    /// True if the image follows.
    pub(super) show: bool,
}

impl LateClouds {
    /// Holds back a client's write. `before` is the element's value until then; `show`: the image will follow.
    pub(super) fn hold_back(
        &mut self,
        path: &str,
        before: f64,
        datarefs: &mut Datarefs,
        now_s: f64,
        show: bool,
    ) {
        self.coming.insert(path.to_owned(), datarefs.get(path));
        datarefs.set(path, before);
        self.last_write_s = now_s;
        self.show |= show;
    }

    /// The image will follow them.
    pub(super) fn will_show(&mut self) {
        self.show = !self.coming.is_empty();
    }

    /// Releases them when it is time.
    pub(super) fn snap(&mut self, datarefs: &mut Datarefs, now_s: f64) -> Option<Snapped> {
        if self.coming.is_empty() || now_s < self.last_write_s + LATE_S {
            return None;
        }
        let Self { coming, show, .. } = std::mem::take(self);
        for (path, value) in &coming {
            datarefs.set(path, *value);
        }
        let name = |path: String| path.split('[').next().unwrap_or_default().to_owned();
        Some(Snapped {
            names: coming.into_keys().map(name).collect(),
            show,
        })
    }
}
