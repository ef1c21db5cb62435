//! Search modes for consecutive images.

use serde::{Deserialize, Serialize};

/// Mode of the search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Every image whole.
    Full,
    /// Only around the followed aircraft; the whole image from time to time, and when one is lost.
    Tracked,
    /// Every image whole, but made as small as the model's usual input: for comparison.
    Scaled,
    /// Tracked, but an image whole if an aircraft moves by more than its length from one image to the next.
    #[default]
    Auto,
}

/// Search settings for a view's images.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModeSettings {
    /// Mode of the search.
    pub mode: Mode,
    /// Time between searches of whole images, seconds; longer at low image rates while an aircraft is followed.
    pub full_search_s: f64,
}

impl Default for ModeSettings {
    /// An aircraft that enters the image is found a second later, 70 m closer.
    fn default() -> Self {
        Self {
            mode: Mode::default(),
            full_search_s: 1.0,
        }
    }
}
