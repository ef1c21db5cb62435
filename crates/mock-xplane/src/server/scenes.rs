//! A cache of prepared images per camera, weather, clock and type of aircraft: preparing one costs as much as many frames.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use airframe::AircraftType;
use dataset::conditions::{Clock, Weather};
use dataset::geometry::camera::{Camera, CameraPose};
use dataset::geometry::imaging::Imaging;
use dataset::geometry::runway::Runway;

use super::engine::{Engine, SceneRenderer, SceneSetting};

/// Maximum prepared images: two rigs with a few cameras each.
const KEPT: usize = 8;

/// Inputs of a prepared image.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SceneKey {
    pub(super) camera: CameraPose,
    pub(super) imaging: Imaging,
    pub(super) width_px: u32,
    pub(super) height_px: u32,
    pub(super) runway: Runway,
    pub(super) weather: Weather,
    pub(super) clock: Clock,
    pub(super) aircraft: &'static AircraftType,
}

type Slot = Arc<OnceLock<Box<dyn SceneRenderer>>>;

/// The prepared images, the latest used first.
#[derive(Default)]
pub(super) struct Scenes {
    slots: Mutex<VecDeque<(SceneKey, Slot)>>,
}

impl Scenes {
    /// Calls `draw` with the image of `key`, preparing it first if necessary. Different ones are prepared in parallel.
    pub(super) fn with<T>(
        &self,
        engine: &dyn Engine,
        key: &SceneKey,
        draw: impl FnOnce(&dyn SceneRenderer) -> T,
    ) -> T {
        let slot = self.slot(key);
        let picture = slot.get_or_init(|| {
            let camera = Camera::from_pose(&key.camera, key.width_px, key.height_px)
                .seen_through(&key.imaging);
            engine.prepare(&SceneSetting {
                camera: &camera,
                runway: &key.runway,
                weather: &key.weather,
                clock: &key.clock,
                aircraft: key.aircraft,
                degradation: key.imaging.degradation.as_ref(),
            })
        });
        draw(picture.as_ref())
    }

    fn slot(&self, key: &SceneKey) -> Slot {
        let mut slots = self.slots.lock().unwrap_or_else(PoisonError::into_inner);
        let found = slots.iter().position(|(known, _)| known == key);
        let entry = found
            .and_then(|at| slots.remove(at))
            .unwrap_or_else(|| (key.clone(), Slot::default()));
        let slot = entry.1.clone();
        slots.push_front(entry);
        slots.truncate(KEPT);
        slot
    }
}
