//! Search modes for consecutive images.

use serde::{Deserialize, Serialize};

/// Mode of the search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Every image whole.
    Full,
    /// Every image whole, but made as small as the model's usual input: for comparison.
    Scaled,
    /// Only around the followed aircraft; the whole image from time to time, and when one is lost.
    Tracked,
    /// Tracked, but an image whole if an aircraft moves by more than its length from one image to the next.
    #[default]
    Auto,
}

impl Mode {
    /// All modes, in the order of reports.
    pub const ALL: [Self; 4] = [Self::Full, Self::Scaled, Self::Tracked, Self::Auto];
}
