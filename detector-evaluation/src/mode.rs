//! Keys and words of the compared search modes.

use labeller::Mode;

/// Key in `evaluation.json`; the paper calls the search of whole images Auto Segmentation.
pub fn key(mode: Mode) -> &'static str {
    match mode {
        Mode::Full => "auto_segmentation",
        Mode::Scaled => "scaled",
        Mode::Tracked => "tracked",
        Mode::Auto => "auto",
    }
}

/// Title in reports.
pub fn title(mode: Mode) -> &'static str {
    match mode {
        Mode::Full => "Auto segmentation",
        Mode::Scaled => "Scaled",
        Mode::Tracked => "Tracked",
        Mode::Auto => "Auto",
    }
}

pub(crate) fn how(mode: Mode) -> &'static str {
    match mode {
        Mode::Full => "every image, pixel by pixel",
        Mode::Scaled => "every image, shrunk to the network's size",
        Mode::Tracked => "a crop around each track, now and then the whole image",
        Mode::Auto => "tracked, or the whole image where the aircraft is fast",
    }
}

/// Maximum and effective range of the paper's table 2, nautical miles.
pub(crate) fn paper(mode: Mode) -> Option<[&'static str; 2]> {
    match mode {
        Mode::Full => Some(["9.95", "9.74"]),
        Mode::Scaled => Some(["7.00", "4.96"]),
        Mode::Tracked | Mode::Auto => None,
    }
}
