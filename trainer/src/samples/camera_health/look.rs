//! The images of a tick: usable or not, with a background that shows where the camera looks or without one.

use dataset::tables::health::HealthState;

/// The image of a view at a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Look {
    /// There is none, or it must not be measured.
    #[default]
    Blind,
    /// Its background is hidden: the camera may have been turned.
    Unplaced,
    /// Its background shows where the camera looks, compared with the other images of the flight, or there was no check.
    Placed,
}

impl Look {
    /// Of an image with this condition by the images up to it.
    pub fn of(state: HealthState) -> Self {
        match state {
            HealthState::Unknown => Self::Unplaced,
            _ if state.is_well() => Self::Placed,
            _ => Self::Blind,
        }
    }
}
