//! Pixel sources for drawn frames, and the proof that the pixels belong to the frame.
//!
//! Three sources ([`PixelKind`]): the stand-in sends its images over the capture link (`link`); the plugin reads X-Plane's frame back from
//! OpenGL, proves that it is the requested one, and sends it (`gl`); or the simulator only reports that the frame is drawn, and the image
//! is grabbed from the screen (`screen`): X-Plane 12 does not let plugins read its frame back. For the screen, [`ScreenSource`] proves by a
//! check pattern, before the first image and after the last, that the grabbed area is the window, complete and unscaled, and never an older
//! frame than the requested one.

mod cell_grid;
pub mod check_pattern;
mod choice;
mod error;
mod rgb_picture;
mod screen;
pub(crate) mod still_scene;

use std::pin::Pin;

pub use choice::PixelChoice;
pub use error::PixelError;
pub use rgb_picture::{Rectangle, RgbPicture};
pub(crate) use screen::{CodedGrabs, CodedPicture, CodedWindow};
pub use screen::{FfmpegScreen, Grab, Lag, RemoteScreen, Screen, ScreenSource};

use crate::error::BridgeError;
pub use crate::link::PixelKind;

/// A pending proof.
pub type Confirmed<'a> = Pin<Box<dyn Future<Output = Result<(), BridgeError>> + Send + 'a>>;

/// Shows check patterns: the simulator at the other end of the link.
pub trait PatternDisplay: Send {
    /// Shows a code's pattern over the window, or removes it; done when the simulator reports that it is drawn.
    fn show(&mut self, code: Option<u32>) -> Confirmed<'_>;

    /// Shows it over the scene, but under the windows of the user interface and plugins. `None` if the simulator cannot.
    fn show_under_windows(&mut self, _code: u32) -> Option<Confirmed<'_>> {
        None
    }
}

/// A source of the images of frames that the simulator reports as drawn.
#[derive(Debug)]
pub(crate) enum PixelSource {
    /// The source `link` or `gl`: the answer's payload is the image.
    Payload(PixelKind),
    /// The simulator's window.
    Screen(Box<ScreenSource>),
}

impl PixelSource {
    pub(crate) fn kind(&self) -> PixelKind {
        match self {
            Self::Payload(kind) => *kind,
            Self::Screen(_) => PixelKind::Screen,
        }
    }

    /// Window for grabbing numbered frames, if it has margins for the numbers.
    pub(crate) fn coded_window(&self) -> Option<CodedWindow> {
        match self {
            Self::Screen(source) => source.coded_window(),
            _ => None,
        }
    }

    /// The image of the frame just drawn. `payload` came with the simulator's answer: the image, or memory for it.
    pub(crate) async fn picture(&mut self, payload: Vec<u8>) -> Result<Vec<u8>, PixelError> {
        match self {
            Self::Payload(_) => Ok(payload),
            Self::Screen(source) => source.picture(payload).await,
        }
    }
}
