//! Timed boxes, and the tolerances for comparing them.

use dataset::tables::pixel_box::PixelBox;

/// Object memory, s: the time that it may be out of sight.
pub(crate) const MEMORY_S: f64 = 60.0;
/// Recent past, s: motion is measured over this time, and it establishes an object; older sightings carry no weight for the present.
pub(crate) const RECENT_S: f64 = 10.0;
/// Minimum time between remembered sightings, s.
pub(crate) const STEP_S: f64 = 1.0;
/// Maximum gap between compared sightings, s.
pub(crate) const MAX_GAP_S: f64 = 30.0;
/// Maximum residual for a new aircraft, in standard deviations.
pub(super) const MAX_DEVIATIONS: f64 = 6.0;
/// Minimum standard deviation of logarithmic sizes: aircraft of half and of double the training's size, or partly hidden by a cloud,
/// stay within [`MAX_DEVIATIONS`].
pub(super) const MIN_SIZE_SD: f64 = 0.12;
/// Growth that box errors explain, relative to the width: at 10 NM any aircraft grows by twice as much in ten seconds.
pub(crate) const STILL_GROWTH: f64 = 0.02;

/// A box at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sighting {
    pub(super) time_s: f64,
    pub(super) pixel_box: PixelBox,
}
