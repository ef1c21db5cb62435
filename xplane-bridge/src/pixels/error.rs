//! Reasons why there are no images, with remedies for the user.

use std::fmt::Display;

use super::Rectangle;
use crate::link::PictureSize;

/// Reason why images are unavailable, or cannot be trusted.
#[derive(Debug, thiserror::Error)]
pub enum PixelError {
    /// The caller requested something that this simulator does not have: the same call will fail again.
    #[error("{0}")]
    BadInput(String),
    /// No image will come until somebody changes the window, the screen or this computer.
    #[error("{0}")]
    Setup(String),
    /// A source of images fails, or something is in its way.
    #[error("{0}")]
    Unusable(String),
    /// Windows of the simulator cover the scene.
    #[error(
        "X-Plane or one of its plugins draws a window over the scene: it covers {cover} of the {window} that X-Plane draws, and would be in \
         every image. Close it: a message of X-Plane by its button, a plugin's window by its cross or its menu"
    )]
    WindowOverScene {
        /// Covered rectangle, from the window's top left.
        cover: Rectangle,
        /// Size of the simulator's window.
        window: PictureSize,
    },
    /// A foreign program covers the window.
    #[error(
        "another program covers {cover} of the {window} of the simulator's window, and would be in every image. Close what lies there (a \
         notification, a window, a toolbar), or move the pointer away"
    )]
    ProgramOverWindow {
        /// Covered rectangle, from the window's top left.
        cover: Rectangle,
        /// Size of the simulator's window.
        window: PictureSize,
    },
    /// A cover was noticed too late.
    #[error(
        "something covered {rectangle} of the images, and was noticed only after images of it had been recorded: a message, \
         a window, a notification or a pointer that came in gradually, or in a pause between two images. Keep it from coming again"
    )]
    CoveredBefore {
        /// Covered rectangle, from the images' top left.
        rectangle: Rectangle,
    },
    /// Images cannot be recorded in blocks, only settled.
    #[error("images cannot be taken one per drawn frame: {0}")]
    NoBlocks(String),
    /// The simulator's window has the wrong size.
    #[error(
        "images of {wanted} pixels are wanted, and the simulator's window has {window}. {}, or change [picture] in the sweep",
        .wanted.window_advice(*.may_have_margins)
    )]
    OtherWindow {
        /// The images.
        wanted: PictureSize,
        /// The window.
        window: PictureSize,
        /// True if the window may be larger, with margins for the numbers of frames.
        may_have_margins: bool,
    },
    /// The pattern is in an image of the recording.
    #[error(
        "the check pattern is still on the screen where an image should be: the simulator did not remove it, or draws late"
    )]
    PatternStays,
}

impl PixelError {
    /// True if no image will come until somebody changes the window, the screen, this computer or the sweep.
    pub fn is_setup(&self) -> bool {
        self.is_bad_input() || matches!(self, Self::Setup(_))
    }

    /// True if the caller requested something that this simulator does not have: the same call will fail again.
    pub fn is_bad_input(&self) -> bool {
        matches!(self, Self::BadInput(_) | Self::OtherWindow { .. })
    }

    /// An image of the screen that did not arrive.
    pub(super) fn grab(what: impl Display) -> Self {
        Self::Unusable(format!(
            "no image of the screen: {what}. Was the window closed, resized or the screen locked?"
        ))
    }
}
