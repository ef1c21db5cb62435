//! Pixel sources for drawn frames, and the proof that the pixels belong to the frame.
//!
//! Four sources ([`PixelKind`]): the stand-in sends its images over the capture link (`link`); the plugin reads X-Plane's frame back from
//! OpenGL and sends it (`gl`); the simulator only reports that the frame is drawn, and the image is grabbed from the screen (`screen`); or
//! X-Plane writes a file, which the plugin sends (`screenshot`). To the client's core they are one trait, [`PixelSource`]. The plugin
//! proves that it sends the requested frame; for the screen, [`ScreenSource`] proves by a check pattern, before the first image and after
//! the last, that the grabbed area is the window, complete and unscaled, and never an older frame than the requested one.
//!
//! X-Plane 12 does not let plugins read its frame back, which leaves the screen, or screenshots where an image may take a second.

mod cell_grid;
pub mod check_pattern;
mod choice;
mod error;
mod payload;
mod rgb_picture;
mod screen;
mod screenshots;
pub(crate) mod still_scene;

use std::fmt::Debug;
use std::pin::Pin;

pub use choice::PixelChoice;
pub use error::PixelError;
pub(crate) use payload::Payload;
pub use rgb_picture::{Rectangle, RgbPicture};
pub(crate) use screen::{CodedGrabs, CodedPicture, CodedWindow};
pub use screen::{FfmpegScreen, Grab, Lag, RemoteScreen, Screen, ScreenSource};
pub(crate) use screenshots::Screenshots;

use crate::error::BridgeError;
pub use crate::link::PixelKind;

/// A pending image.
pub type ComingPicture<'a> = Pin<Box<dyn Future<Output = Result<Vec<u8>, PixelError>> + Send + 'a>>;

/// A pending proof.
pub type Confirmed<'a> = Pin<Box<dyn Future<Output = Result<(), BridgeError>> + Send + 'a>>;

/// A pending look for a cover.
pub type CoveredPart<'a> =
    Pin<Box<dyn Future<Output = Result<Option<Rectangle>, BridgeError>> + Send + 'a>>;

/// Shows check patterns: the simulator at the other end of the link.
pub trait PatternDisplay: Send {
    /// Shows a code's pattern over the window, or removes it; done when the simulator reports that it is drawn.
    fn show(&mut self, code: Option<u32>) -> Confirmed<'_>;

    /// Shows it over the scene, but under the windows of the user interface and plugins. `None` if the simulator cannot.
    fn show_under_windows(&mut self, _code: u32) -> Option<Confirmed<'_>> {
        None
    }
}

/// Returns the images of frames that the simulator reports as drawn.
pub trait PixelSource: Debug + Send {
    /// The kind of the source.
    fn kind(&self) -> PixelKind;

    /// Maximum outstanding captures. A frame that must stay on the screen until it is grabbed allows one.
    fn most_outstanding(&self) -> usize;

    /// Maximum image delay, if measured.
    fn lag(&self) -> Option<Lag> {
        None
    }

    /// Window for grabbing numbered frames, if it has margins for the numbers.
    fn coded_window(&self) -> Option<CodedWindow> {
        None
    }

    /// The image of the frame just drawn. `payload` came with the simulator's answer: the image, or memory for it.
    fn picture(&mut self, payload: Vec<u8>) -> ComingPicture<'_>;

    /// The part of the image that something covers now; `None` as well if that cannot be found out.
    fn covered_part<'a>(&'a mut self, _: &'a mut dyn PatternDisplay) -> CoveredPart<'a> {
        Box::pin(std::future::ready(Ok(None)))
    }

    /// Proves after the last image that the initial proof still holds, if there was one.
    fn confirm<'a>(&'a mut self, _: &'a mut dyn PatternDisplay) -> Confirmed<'a> {
        Box::pin(std::future::ready(Ok(())))
    }
}
