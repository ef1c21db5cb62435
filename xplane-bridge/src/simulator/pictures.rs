//! The source of this client's images: chosen after connecting, proven before the first image and after the last.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Instant;

use super::link_client::LinkClient;
use super::{SETTLE_FRAMES_ON_SCREEN, Simulator};
use crate::error::BridgeError;
use crate::link::{Deliver, MAX_OUTSTANDING_CAPTURES, PictureSize, ScreenOffer};
use crate::pixels::still_scene::Covered;
use crate::pixels::{
    CodedGrabs, Confirmed, PatternDisplay, PixelChoice, PixelError, PixelKind, PixelSource,
    Rectangle, RemoteScreen, Screen, ScreenSource,
};
use futures_util::future::BoxFuture;

/// The screen that the simulator draws on, as reported.
#[derive(Debug)]
pub(super) enum DrawnOn {
    /// A screen that the caller can grab.
    Here,
    /// A remote screen, which the plugin there grabs for us.
    Elsewhere(Arc<dyn Screen>),
    /// A remote screen, with the reason why it is not grabbed.
    OutOfReach(String),
}

impl DrawnOn {
    /// The screen in a hello, and the way to it with the link's `token`.
    pub(super) fn offered(
        offer: Option<ScreenOffer>,
        link: SocketAddr,
        token: Option<String>,
    ) -> Self {
        match offer {
            None => Self::Here,
            Some(ScreenOffer { refused: None }) => {
                Self::Elsewhere(Arc::new(RemoteScreen::new(link, token)))
            }
            Some(ScreenOffer {
                refused: Some(reason),
            }) => Self::OutOfReach(reason),
        }
    }
}

impl Simulator {
    /// The screen to grab: `here`, or the one of the simulator's computer.
    pub(super) fn screen(&self, here: &Arc<dyn Screen>) -> Result<Arc<dyn Screen>, PixelError> {
        match &self.drawn_on {
            DrawnOn::Here => Ok(here.clone()),
            DrawnOn::Elsewhere(there) => Ok(there.clone()),
            DrawnOn::OutOfReach(reason) => Err(PixelError::BadInput(format!(
                "images come off the screen of X-Plane's computer, which is another one than this, and {reason}. Or run dtd there \
                 (docs/x-plane.md, \"X-Plane on another computer\")"
            ))),
        }
    }

    /// True if the window may have margins around this source's images, in which the plugin numbers its frames. Over a network a grab takes
    /// longer than a frame is shown.
    pub(super) fn may_have_margins(&self, kind: PixelKind) -> bool {
        let is_near = matches!(self.drawn_on, DrawnOn::Here);
        kind == PixelKind::Screen && self.description.frame_codes && is_near
    }

    /// Chooses the source of images, and proves that it works: for the screen, that the simulator's window is visible, complete, and in the
    /// size of the images, width and height in pixels, on `screen`, or on the simulator's own screen if that is remote and the plugin grabs
    /// it. Without this call, images come over the link.
    ///
    /// # Errors
    /// The simulator does not offer the choice, or the proof fails; the message says what to change.
    pub fn use_pixels<'a>(
        &'a mut self,
        choice: PixelChoice,
        picture_px: (u32, u32),
        screen: &'a Arc<dyn Screen>,
    ) -> BoxFuture<'a, Result<PixelKind, BridgeError>> {
        Box::pin(async move {
            self.grabs = CodedGrabs::default();
            let kind = choice.among(&self.description.pixels)?;
            let (width_px, height_px) = picture_px;
            let wanted = PictureSize {
                width_px,
                height_px,
            };
            // A minimised window has none; looking for it reports what to do.
            let window = self.description.drawn_size;
            let has_codes = self.may_have_margins(kind);
            let fits = |window: &PictureSize| wanted.fits(*window, has_codes);
            if let Some(window) = window.filter(|size| size.width_px > 0 && !fits(size)) {
                let refused = PixelError::OtherWindow {
                    wanted,
                    window,
                    may_have_margins: has_codes,
                };
                return Err(refused.into());
            }
            self.pixels = match kind {
                PixelKind::Screen => {
                    let screen = &self.screen(screen)?;
                    let reported = self.description.window.as_ref();
                    self.settle_frames = self.settle_frames.max(SETTLE_FRAMES_ON_SCREEN);
                    let link = &mut self.link;
                    let source =
                        ScreenSource::set_up(screen, picture_px, has_codes, reported, link);
                    PixelSource::Screen(Box::new(source.await?))
                }
                PixelKind::Link | PixelKind::Gl => PixelSource::Payload(kind),
            };
            if has_codes && self.pixels.coded_window().is_none() {
                tracing::info!(
                    "the window has no margins around the images, so that each of them is settled, which takes several times as long: start \
                     X-Plane with --window={}",
                    wanted.with_margins()
                );
            }
            Ok(kind)
        })
    }

    /// Proves after the last image that the initial proof still holds.
    ///
    /// # Errors
    /// It does not: the images in between may be wrong.
    pub fn confirm_pixels(&mut self) -> BoxFuture<'_, Result<(), BridgeError>> {
        Box::pin(async move {
            self.grabs = CodedGrabs::default();
            match &mut self.pixels {
                PixelSource::Screen(source) => source.confirm(&mut self.link).await,
                _ => Ok(()),
            }
        })
    }

    /// The part of the images that something covers now. No capture is outstanding.
    pub(super) async fn covered_part(&mut self) -> Result<Option<Rectangle>, BridgeError> {
        match &mut self.pixels {
            PixelSource::Screen(source) => source.covered_part(&mut self.link).await,
            _ => Ok(None),
        }
    }

    /// Waits until nothing covers the images. Returns what did last.
    pub(super) async fn wait_until_uncovered(&mut self) -> Result<Option<Rectangle>, BridgeError> {
        let (mut covered, mut last) = (Covered::default(), None);
        while let Some(rectangle) = self.covered_part().await? {
            covered.note(rectangle, Instant::now())?;
            last = Some(rectangle);
        }
        Ok(last)
    }

    /// Draws the check pattern with a code over the simulator's window, or removes it. Returns the number of the first frame that
    /// shows it so. While it is shown, captures are rejected.
    ///
    /// # Errors
    /// The simulator cannot draw it, or the link is broken.
    pub fn check_pattern(&mut self, code: Option<u32>) -> BoxFuture<'_, Result<u64, BridgeError>> {
        Box::pin(self.link.check_pattern(code, false))
    }

    /// Source of the images.
    pub fn pixels(&self) -> PixelKind {
        self.pixels.kind()
    }

    /// The delivery that captures must request.
    pub fn deliver(&self) -> Deliver {
        match self.pixels.kind() {
            PixelKind::Screen => Deliver::Drawn,
            PixelKind::Link | PixelKind::Gl => Deliver::Picture,
        }
    }

    /// Maximum outstanding captures.
    pub fn most_outstanding(&self) -> usize {
        match self.pixels {
            PixelSource::Payload(_) => MAX_OUTSTANDING_CAPTURES,
            // A frame must stay on the screen until it is grabbed.
            PixelSource::Screen(_) => 1,
        }
    }
}

impl PatternDisplay for LinkClient {
    fn show(&mut self, code: Option<u32>) -> Confirmed<'_> {
        Box::pin(async move { self.check_pattern(code, false).await.map(|_| ()) })
    }

    fn show_under_windows(&mut self, code: u32) -> Option<Confirmed<'_>> {
        if !self.patterns_under {
            return None;
        }
        Some(Box::pin(async move {
            self.check_pattern(Some(code), true).await.map(|_| ())
        }))
    }
}
