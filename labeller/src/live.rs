//! The search of cameras that have no end: one image after another, with bounded memory.
//!
//! ```text
//! image of a view -> ViewSearch: Sequence -> Tracker -> boxes that count at this moment    (as in dtd detect)
//!                                CameraWatch         -> condition of the camera
//!                                Patch               -> register_views, with the patch of another view
//! ```
//!
//! `dtd detect` calls the same code for the images of a video, and writes what counted at each moment: `counts_live` and `state_live`.
//! [`crate::Searcher::view_search`] begins a view.

use dataset::geometry::camera::Camera;
use dataset::tables::registrations::{NoShift, Shift};

use crate::detect::registered;
pub use crate::detect::{Image, Looked, SeenBox, ViewSearch};
pub use crate::registration::Patch;

/// The shift of the aircraft from the reference view to another one, from what [`Looked::patch`] has of both.
///
/// # Errors
/// The reason why there is none.
pub fn register_views(
    (reference, in_reference): (&Camera, &Result<Patch, NoShift>),
    (view, in_view): (&Camera, &Result<Patch, NoShift>),
) -> Result<Shift, NoShift> {
    registered([reference, view], [in_reference, in_view])
}
