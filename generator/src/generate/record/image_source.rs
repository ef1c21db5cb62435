//! Source and size of a run's images: the same for all scenarios.

use std::sync::Arc;

use dataset::plan::Picture;
use xplane_bridge::pixels::{PixelChoice, PixelKind, Screen};
use xplane_bridge::{BridgeError, Simulator};

#[derive(Debug, Clone)]
pub(crate) struct ImageSource {
    choice: PixelChoice,
    width_px: u32,
    height_px: u32,
    screen: Arc<dyn Screen>,
}

impl ImageSource {
    pub(crate) fn new(choice: PixelChoice, screen: Arc<dyn Screen>, picture: Picture) -> Self {
        Self {
            choice,
            width_px: picture.width_px,
            height_px: picture.height_px,
            screen,
        }
    }

    /// The size of the window that our own stand-in needs, width and height in pixels, if it needs one.
    pub(crate) fn window_px(&self) -> Option<(u32, u32)> {
        let screen = PixelChoice::Only(PixelKind::Screen);
        (self.choice == screen).then_some((self.width_px, self.height_px))
    }

    /// Makes a new connection take its images from this source, and checks that it can. One that cannot is closed properly.
    pub(crate) async fn set_up(&self, mut simulator: Simulator) -> Result<Simulator, BridgeError> {
        let picture_px = (self.width_px, self.height_px);
        let used = simulator.use_pixels(self.choice, picture_px, &self.screen);
        match used.await {
            Ok(kind) => {
                tracing::info!(%kind, "pictures");
                Ok(simulator)
            }
            Err(error) => {
                if let Err(left) = simulator.release().await {
                    tracing::debug!(error = %left, "the simulator did not confirm its release");
                }
                Err(error)
            }
        }
    }
}
