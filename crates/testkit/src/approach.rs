//! Poses on an approach to Changi 02L, and where a pose is on it.

use dataset::geometry::pose::{FlightState, Pose};
use dataset::geometry::runway::RunwayCoordinates;

use crate::changi_02l;

/// A pose on course with 3 degrees of pitch, `along_track_m` before the target and `cross_track_m` right of the centreline.
pub fn on_glide_path(along_track_m: f64, cross_track_m: f64) -> Pose {
    let runway = changi_02l();
    let height_m = along_track_m.max(0.0) * runway.glide_path_deg.to_radians().tan();
    let at = runway.point_on_approach(along_track_m, cross_track_m);
    Pose {
        latitude_deg: at.latitude_deg,
        longitude_deg: at.longitude_deg,
        altitude_msl_m: runway.threshold.altitude_msl_m + height_m,
        heading_true_deg: runway.course_true_deg,
        pitch_deg: 3.0,
        roll_deg: 0.0,
    }
}

/// Position relative to the touchdown target.
pub fn relative(state: &FlightState) -> RunwayCoordinates {
    let runway = changi_02l();
    RunwayCoordinates::of(
        state.pose.position(),
        runway.touchdown_target(),
        runway.course_true_deg,
    )
}

/// Height over the glide path, metres.
pub fn above_path_m(state: &FlightState) -> f64 {
    let relative = relative(state);
    relative.height_over_target_m - 3_f64.to_radians().tan() * relative.along_track_m
}

/// Distance of the first wheel contact past the threshold, metres.
pub fn touchdown_past_threshold_m(states: &[FlightState]) -> f64 {
    let touchdown = states
        .iter()
        .find(|state| state.on_ground)
        .expect("the flight landed");
    changi_02l().touchdown_past_threshold_m - relative(touchdown).along_track_m
}
