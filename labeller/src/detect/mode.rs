//! Modes of searching the images of a view one after another.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// The longest time between searches of whole images that can be set, seconds.
const MAX_PERIOD_S: f64 = 3_600.0;

/// Mode of the search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Every image whole.
    Full,
    /// Only around the aircraft that are followed; the whole image from time to time, and when one of them is lost.
    Tracked,
    /// Every image whole, but made as small as the model's usual input: for comparison.
    Scaled,
    /// Tracked, but an image whole if an aircraft moves by more than its length from one image to the next.
    #[default]
    Auto,
}

/// Settings for searching the images of a view.
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

impl ModeSettings {
    /// Checks all ranges.
    pub fn check(&self) -> Result<()> {
        if (0.0..=MAX_PERIOD_S).contains(&self.full_search_s) {
            return Ok(());
        }
        Err(Error::Option {
            name: "--full-every",
            found: self.full_search_s.to_string(),
            expected: "a time from 0 to 3600 s".into(),
        })
    }
}
