//! Flight request to a simulator or to the flight model.

use dataset::numbers::units::Degrees;
use dataset::plan::{Common, LiveStart, PlannedScenario};
use xplane_bridge::fly::{FlightStart, FlyRequest};

/// A live flight may take this many times as long as expected, plus this many seconds, before the simulator gives up.
const FLIGHT_TIME_MARGIN: (f64, f64) = (2.0, 120.0);

pub(crate) fn fly_request(
    common: &Common,
    scenario: &PlannedScenario,
    live: &LiveStart,
) -> FlyRequest {
    let Common {
        runway, picture, ..
    } = common;
    let altitude_msl_m = live.profile.start_altitude_msl_m() + live.above_profile_m;
    let (factor, more_s) = FLIGHT_TIME_MARGIN;
    FlyRequest {
        start: FlightStart {
            position: runway
                .point_on_approach(scenario.parameters.start_dtd_m, live.cross_track_m)
                .at_altitude_m(altitude_msl_m),
            heading_true_deg: Degrees(runway.course_true_deg + live.heading_offset_deg)
                .wrapped_360()
                .0,
            speed_mps: live.speed_mps,
        },
        runway: runway.clone(),
        profile: live.profile,
        seed: scenario.seed,
        time_limit_s: f64::from(scenario.ticks) * picture.frame_rate.period_s() * factor + more_s,
        already_started: false,
    }
}
