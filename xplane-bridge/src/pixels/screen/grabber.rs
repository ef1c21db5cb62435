//! Grabs on a thread that may block, for a caller that may not.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::task::spawn_blocking;
use tokio::time::timeout;

use super::{Grab, Screen};
use crate::pixels::check_pattern::{self, Sighting, Unreadable};
use crate::pixels::{PixelError, Rectangle, RgbPicture};

/// Timeout per grab: macOS delivers none while the screen is locked.
const GRAB_TIMEOUT: Duration = Duration::from_secs(5);

/// Screen region that is being grabbed.
#[derive(Clone)]
pub(super) struct Grabber(Arc<Mutex<Box<dyn Grab>>>);

impl Grabber {
    /// Starts grabbing a region, or the whole screen.
    pub(super) async fn open(
        screen: &Arc<dyn Screen>,
        part: Option<Rectangle>,
    ) -> Result<Self, PixelError> {
        let screen = screen.clone();
        let grab = before_timeout(move || screen.open(part)).await?;
        Ok(Self(Arc::new(Mutex::new(grab))))
    }

    /// The image after this many discarded ones; `picture` provides its memory.
    pub(super) async fn grab(
        &self,
        mut picture: RgbPicture,
        skipped: u32,
    ) -> Result<RgbPicture, PixelError> {
        self.with(move |grab| {
            for _ in 0..=skipped {
                grab.grab(&mut picture)?;
            }
            Ok(picture)
        })
        .await
    }

    /// The next image, decoded as a check pattern.
    pub(super) async fn look(&self) -> Result<Result<Sighting, Unreadable>, PixelError> {
        self.with(|grab| {
            let mut picture = RgbPicture::default();
            grab.grab(&mut picture)?;
            Ok(check_pattern::read(&picture))
        })
        .await
    }

    async fn with<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut dyn Grab) -> Result<T, PixelError> + Send + 'static,
    ) -> Result<T, PixelError> {
        // Shared, so that a caller who stops waiting leaves it intact.
        let grab = self.0.clone();
        before_timeout(move || {
            let mut grab = grab.lock().unwrap_or_else(PoisonError::into_inner);
            work(grab.as_mut())
        })
        .await
    }
}

async fn before_timeout<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, PixelError> + Send + 'static,
) -> Result<T, PixelError> {
    match timeout(GRAB_TIMEOUT, spawn_blocking(work)).await {
        Ok(Ok(done)) => done,
        Ok(Err(panicked)) => Err(PixelError::grab(panicked)),
        Err(_) => Err(PixelError::grab(format!("none within {GRAB_TIMEOUT:?}"))),
    }
}
