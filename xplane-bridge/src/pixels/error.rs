//! Reasons why there are no images, with remedies for the user.

use std::net::SocketAddr;
use std::time::Duration;

use super::check_pattern::Unreadable;
use super::{PixelChoice, PixelKind, Rectangle};
use crate::link::{LinkError, PictureSize};

/// Reason why images are unavailable, or cannot be trusted.
#[derive(Debug, thiserror::Error)]
pub enum PixelError {
    /// The simulator has no such source.
    #[error("--pixels {wanted}: the simulator offers {}", offer(.offered))]
    NotOffered {
        /// The requested source.
        wanted: PixelChoice,
        /// The available sources.
        offered: Vec<PixelKind>,
    },
    /// Grabbing the screen is not supported on this system.
    #[error(
        "the screen of this system cannot be grabbed: Linux (X11), Windows and macOS can; use --pixels gl or run X-Plane there"
    )]
    NoScreenHere,
    /// FFmpeg was built without the device.
    #[error(
        "the FFmpeg of this machine was built without its input device {device}; install one that has it"
    )]
    NoDevice {
        /// The device.
        device: &'static str,
    },
    /// The screen cannot be opened.
    #[error("cannot grab the screen {input:?} with FFmpeg's {device}: {source}; {advice}")]
    Open {
        /// The device.
        device: &'static str,
        /// Name of the screen.
        input: String,
        /// FFmpeg's error.
        r#source: ffmpeg_next::Error,
        /// Hint for the user.
        advice: &'static str,
    },
    /// X-Plane runs on another computer, whose screen its plugin does not grab for us.
    #[error(
        "images come off the screen of X-Plane's computer, which is another one than this, and {reason}. Or run dtd there, \
         or, for few images, take --pixels screenshot (docs/x-plane.md, \"X-Plane on another computer\")"
    )]
    ScreenElsewhere {
        /// Reason why its plugin does not grab it.
        reason: String,
    },
    /// The connection to the plugin that grabs the screen fails.
    #[error(
        "the screen of X-Plane's computer cannot be grabbed through its plugin at {link}: {source}"
    )]
    RemoteScreen {
        /// The plugin's capture link.
        link: SocketAddr,
        /// Underlying error.
        r#source: LinkError,
    },
    /// The plugin does not provide an image.
    #[error("the plugin at {link} gives no image of its screen: {text}")]
    RemoteRefused {
        /// Its capture link.
        link: SocketAddr,
        /// Text of the refusal.
        text: String,
    },
    /// An image of the screen did not arrive.
    #[error("no image of the screen: {what}. Was the window closed, resized or the screen locked?")]
    Grab {
        /// Description of the failure.
        what: String,
    },
    /// The screen has a pixel format other than 8 bits of red, green, blue.
    #[error(
        "the screen has pixels of the form {found}, expected 8 bits each of red, green, blue: set it to 24-bit colour"
    )]
    PixelForm {
        /// Pixel format of the screen.
        found: String,
    },
    /// The pattern does not appear.
    #[error(
        "the simulator says that it shows the check pattern {code:08x}, but after {waited:.1?} the screen {screen} shows {found}. Is its \
         window open on this screen, in front of all others, not minimised and not reaching over the edge?"
    )]
    PatternNotSeen {
        /// The expected code.
        code: u32,
        /// Time waited.
        waited: Duration,
        /// Name of the searched screen.
        screen: String,
        /// The last state.
        found: Unreadable,
    },
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
    /// Another program covers the window.
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
    /// A cover does not go.
    #[error(
        "{rectangle} of the images has not looked like the beginning of the block for {waited:.0?}: a message, a window, a notification \
         or a pointer covers the scene, or covered it then and has gone. Close it, or move it away, and keep it from coming again"
    )]
    StaysCovered {
        /// Covered rectangle, from the images' top left.
        rectangle: Rectangle,
        /// Time waited.
        waited: Duration,
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
    /// An older pattern stays.
    #[error(
        "the simulator says that it shows the check pattern {code:08x}, but after {waited:.1?} the screen still shows {found:08x}: \
         it is drawn late or not at all, and images would show earlier ticks. Is the simulator paused or its window frozen?"
    )]
    StalePattern {
        /// The expected code.
        code: u32,
        /// Time waited.
        waited: Duration,
        /// The last code.
        found: u32,
    },
    /// There is no room for the numbers of frames.
    #[error(
        "the window has no margins around the images, in which the plugin could number its frames"
    )]
    NoMargins,
    /// No number of a frame can be read.
    #[error(
        "tick {tick}: no frame's number could be read off the screen for {waited:.0?}. Does something cover the edge of X-Plane's window, \
         or was it moved, resized or minimised?"
    )]
    NoCode {
        /// The tick that was waited for.
        tick: u32,
        /// Time waited.
        waited: Duration,
    },
    /// The simulator draws into a window of another size.
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
    /// No window on this screen can show such images.
    #[error(
        "images of {wanted} pixels do not fit this screen, which has {screen}: {}. The window's frame and the desktop's bars need room besides; \
         or let X-Plane run on a larger screen",
        fitting_advice(.fitting)
    )]
    ScreenTooSmall {
        /// The images.
        wanted: PictureSize,
        /// The screen.
        screen: PictureSize,
        /// Smaller ones of the same shape.
        fitting: Vec<PictureSize>,
    },
    /// The window is not as large as the images.
    #[error("the simulator's window is {} on the screen, the images must be {width_px}x{height_px}: {}", size(.window), size_advice(.window, .reported_px))]
    WrongSize {
        /// Its position and size on the screen.
        window: Rectangle,
        /// Its size as the simulator reports it, if it does.
        reported_px: Option<(u32, u32)>,
        /// Width of the images, pixels.
        width_px: u32,
        /// Height of the images, pixels.
        height_px: u32,
    },
    /// The window moved.
    #[error(
        "the simulator's window has moved or changed: the check pattern fills {found} of what is grabbed, expected {expected}. Leave it alone while recording"
    )]
    Moved {
        /// Its expected position.
        expected: Rectangle,
        /// Its actual position.
        found: Rectangle,
    },
    /// The pattern is in an image of the recording.
    #[error(
        "the check pattern is still on the screen where an image should be: the simulator did not remove it, or draws late"
    )]
    PatternStays,
    /// X-Plane's screenshot is not the requested image.
    #[error("X-Plane's screenshot cannot be used: {what}")]
    Screenshot {
        /// Reason.
        what: String,
    },
    /// After the recording, frames appeared later than before it.
    #[error(
        "frames took {found:.1?} to appear on the screen after the recording, more than the {allowed:.1?} waited for during it: \
         its images may show earlier ticks. Close what else draws on this machine"
    )]
    Slower {
        /// Measured after.
        found: Duration,
        /// Waited during the recording.
        allowed: Duration,
    },
}

impl PixelError {
    /// True if no image will come until somebody changes the window, the screen, this computer or the sweep.
    pub fn is_setup(&self) -> bool {
        self.is_bad_input()
            || matches!(
                self,
                Self::NoScreenHere
                    | Self::NoDevice { .. }
                    | Self::PixelForm { .. }
                    | Self::WrongSize { .. }
            )
    }

    /// True if the caller requested something that this simulator does not have: the same call will fail again.
    pub fn is_bad_input(&self) -> bool {
        matches!(
            self,
            Self::NotOffered { .. }
                | Self::OtherWindow { .. }
                | Self::ScreenElsewhere { .. }
                | Self::ScreenTooSmall { .. }
        )
    }
}

fn fitting_advice(fitting: &[PictureSize]) -> String {
    match fitting {
        [] => "nothing of this shape does; choose another shape in [picture] of the sweep".into(),
        sizes => {
            let sizes: Vec<String> = sizes.iter().map(ToString::to_string).collect();
            format!("{} do; change [picture] in the sweep", sizes.join(", "))
        }
    }
}

fn offer(offered: &[PixelKind]) -> String {
    match offered {
        [] => "no source of pixels: it can neither send nor show images".into(),
        kinds => {
            let names: Vec<&str> = kinds.iter().map(|kind| kind.name()).collect();
            format!("only {}", names.join(", "))
        }
    }
}

fn size(window: &Rectangle) -> String {
    format!("{}x{}", window.width_px, window.height_px)
}

fn size_advice(window: &Rectangle, reported_px: &Option<(u32, u32)>) -> String {
    match reported_px {
        Some(reported) if *reported != (window.width_px, window.height_px) => {
            let percent = 100.0 * f64::from(window.width_px) / f64::from(reported.0.max(1));
            format!(
                "the simulator draws {}x{}, and the desktop scales it to {percent:.0} %. Set the display's scaling to 100 %",
                reported.0, reported.1
            )
        }
        _ => "give the window exactly this size (X-Plane: Settings > Graphics, or --window=WIDTHxHEIGHT on its command line), or change [picture] in the sweep".into(),
    }
}
