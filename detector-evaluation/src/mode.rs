//! The ways of searching that are compared.

use labeller::Mode;

/// A way to search all images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum EvaluatedMode {
    /// Every image as a whole, pixel by pixel: the paper's Auto Segmentation.
    AutoSegmentation,
    /// Every image as a whole, shrunk to the size of the network.
    Scaled,
    /// Around expected tracks and, at intervals, in the whole image.
    Tracked,
    /// Tracked where the aircraft is slow enough for it.
    Auto,
}

impl EvaluatedMode {
    /// All modes.
    pub const ALL: [Self; 4] = [
        Self::AutoSegmentation,
        Self::Scaled,
        Self::Tracked,
        Self::Auto,
    ];

    /// Key in `evaluation.json`.
    pub fn key(self) -> &'static str {
        match self {
            Self::AutoSegmentation => "auto_segmentation",
            Self::Scaled => "scaled",
            Self::Tracked => "tracked",
            Self::Auto => "auto",
        }
    }

    /// Title in reports.
    pub fn title(self) -> &'static str {
        match self {
            Self::AutoSegmentation => "Auto segmentation",
            Self::Scaled => "Scaled",
            Self::Tracked => "Tracked",
            Self::Auto => "Auto",
        }
    }

    /// The mode of `dtd detect`.
    pub(crate) fn detect_mode(self) -> Mode {
        match self {
            Self::AutoSegmentation => Mode::Full,
            Self::Scaled => Mode::Scaled,
            Self::Tracked => Mode::Tracked,
            Self::Auto => Mode::Auto,
        }
    }

    pub(crate) fn how(self) -> &'static str {
        match self {
            Self::AutoSegmentation => "every image, pixel by pixel",
            Self::Scaled => "every image, shrunk to the network's size",
            Self::Tracked => "a crop around each track, now and then the whole image",
            Self::Auto => "tracked, or the whole image where the aircraft is fast",
        }
    }

    /// Maximum and effective range of the paper's table 2, nautical miles.
    pub(crate) fn paper(self) -> Option<[&'static str; 2]> {
        match self {
            Self::AutoSegmentation => Some(["9.95", "9.74"]),
            Self::Scaled => Some(["7.00", "4.96"]),
            Self::Tracked | Self::Auto => None,
        }
    }
}

impl From<Mode> for EvaluatedMode {
    fn from(mode: Mode) -> Self {
        match mode {
            Mode::Full => Self::AutoSegmentation,
            Mode::Scaled => Self::Scaled,
            Mode::Tracked => Self::Tracked,
            Mode::Auto => Self::Auto,
        }
    }
}
