//! Expected difference of the aircraft's image between two views, from the poses of the cameras: the part that is not shift.

use dataset::geometry::camera::Camera;
use dataset::geometry::rays::{self, Ray};
use glam::{DMat2, DVec2, DVec3};

/// Minimum distance where rays meet, m; otherwise the boxes do not show the same aircraft.
const MIN_RANGE_M: f64 = 10.0;

/// The difference of two views near the aircraft.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ExpectedDifference {
    /// Maps small displacements from the reference view to this view, for surfaces that face the cameras: scale and rotation.
    pub(super) view_from_reference: DMat2,
    /// Change of the shift per metre towards the cameras.
    pub(super) depth_px_per_m: DVec2,
}

impl ExpectedDifference {
    /// Shift alone.
    pub(crate) const SHIFT_ALONE: Self = Self {
        view_from_reference: DMat2::IDENTITY,
        depth_px_per_m: DVec2::ZERO,
    };

    /// The difference for an aircraft seen at these pixels; shift alone if the two lines of sight do not meet.
    pub(crate) fn of(
        reference: &Camera,
        view: &Camera,
        reference_px: DVec2,
        view_px: DVec2,
    ) -> Self {
        let derived = || {
            let place_m = meeting_point_m(reference, view, reference_px, view_px)?;
            let [right, down, forward] =
                [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| reference.ecef_from_camera * axis);
            // By a metre to both sides.
            let move_of = |camera: &Camera, by: DVec3| {
                let ahead = camera.project(place_m + by)?;
                let behind = camera.project(place_m - by)?;
                Some((ahead - behind) / 2.0)
            };
            let [from, to] = [reference, view].map(|camera| {
                Some(DMat2::from_cols(
                    move_of(camera, right)?,
                    move_of(camera, down)?,
                ))
            });
            let (from, to) = (from?, to?);
            let view_from_reference = to * from.inverse();
            let depth_px_per_m =
                move_of(view, -forward)? - view_from_reference * move_of(reference, -forward)?;
            (view_from_reference.is_finite() && depth_px_per_m.is_finite()).then_some(Self {
                view_from_reference,
                depth_px_per_m,
            })
        };
        derived().unwrap_or(Self::SHIFT_ALONE)
    }
}

/// The point where both lines of sight meet, at a plausible range from both cameras.
fn meeting_point_m(
    reference: &Camera,
    view: &Camera,
    reference_px: DVec2,
    view_px: DVec2,
) -> Option<DVec3> {
    let rays = [
        Ray::through(reference, reference_px),
        Ray::through(view, view_px),
    ];
    let point_m = rays::meeting_point_m(&rays)?;
    let plausible = |ray: &Ray| ray.along_m(point_m) >= MIN_RANGE_M;
    rays.iter().all(plausible).then_some(point_m)
}
