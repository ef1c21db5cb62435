//! A straight approach, for checks before anything is flown.

use airframe::AircraftType;
use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::geometry::runway::Runway;

use super::{BadFlight, Trajectory};

/// Ground speed, metres per second: the mean of a jet's last ten miles.
pub(crate) const SPEED_MPS: f64 = 72.0;
/// Roll-out, seconds, as the flight model's.
const ROLL_OUT_S: u32 = 6;

/// A flight down the glide path, from one second before `start_dtd_m`, with a landing on the target.
///
/// # Errors
/// The glide path is too steep.
pub(crate) fn straight_in(
    aircraft: &AircraftType,
    start_dtd_m: f64,
    runway: &Runway,
) -> Result<Trajectory, BadFlight> {
    let (sin, cos) = runway.course_true_deg.to_radians().sin_cos();
    let slope = runway.glide_path_deg.to_radians().tan();
    let ground_m = runway.threshold.altitude_msl_m + aircraft.wheel_height_below_cg_m();
    let seconds = (start_dtd_m / SPEED_MPS).ceil() as u32 + 1 + ROLL_OUT_S;
    let state = |second: u32| {
        let to_go_m = start_dtd_m + SPEED_MPS * (1.0 - f64::from(second));
        let at = runway.point_on_approach(to_go_m, 0.0);
        let is_down = to_go_m <= 0.0;
        FlightState {
            time_s: f64::from(second),
            pose: Pose {
                latitude_deg: at.latitude_deg,
                longitude_deg: at.longitude_deg,
                altitude_msl_m: ground_m + to_go_m.max(0.0) * slope,
                heading_true_deg: runway.course_true_deg,
                pitch_deg: 0.0,
                roll_deg: 0.0,
            },
            velocity_north_mps: SPEED_MPS * cos,
            velocity_east_mps: SPEED_MPS * sin,
            velocity_down_mps: if is_down { 0.0 } else { SPEED_MPS * slope },
            true_airspeed_mps: SPEED_MPS,
            controls: Controls {
                flap_ratio: 0.75,
                gear_ratio: 1.0,
            },
            on_ground: is_down,
        }
    };
    Trajectory::new((0..=seconds).map(state).collect())
}
