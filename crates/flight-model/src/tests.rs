//! Observable flight properties: capture, path, landing, wind, determinism.

use dataset::geometry::approach_profile::ApproachProfile;
use testkit::approach::{above_path_m, relative, touchdown_past_threshold_m};
use testkit::changi_02l;
use xplane_bridge::fly::FlightStart;

use super::*;

mod golden;

/// A flight of the 737.
fn fly(request: &FlyRequest, weather: &Weather) -> Vec<FlightState> {
    super::fly(request, AircraftType::boeing_737_800(), weather)
}

fn weather(wind_from_true_deg: f64, wind_speed_mps: f64, turbulence_ratio: f64) -> Weather {
    Weather {
        visibility_m: 40_000.0,
        clouds: vec![],
        rain_ratio: 0.0,
        wind_speed_mps,
        wind_from_true_deg,
        turbulence_ratio,
    }
}

fn request(
    to_target_m: f64,
    right_of_course_m: f64,
    heading_true_deg: f64,
    seed: u64,
) -> FlyRequest {
    let runway = changi_02l();
    FlyRequest {
        start: FlightStart {
            position: runway
                .point_on_approach(to_target_m, right_of_course_m)
                .at_altitude_m(762.0),
            heading_true_deg,
            speed_mps: 96.0,
        },
        runway,
        profile: ApproachProfile::GlidePath {
            level_altitude_msl_m: 762.0,
        },
        seed,
        time_limit_s: 900.0,
        already_started: false,
    }
}

fn straight_in(seed: u64) -> FlyRequest {
    request(18_860.0, 0.0, 23.02, seed)
}

#[test]
fn an_offset_start_captures_the_localizer_and_stays_on_it() {
    for (right_m, heading_true_deg) in [
        (900.0, 11.0),
        (-900.0, 35.0),
        (600.0, 23.02),
        (-300.0, 23.02),
    ] {
        let states = fly(
            &request(22_000.0, right_m, heading_true_deg, 3),
            &weather(0.0, 0.0, 0.0),
        );
        let worst = states
            .iter()
            .filter(|state| relative(state).along_track_m < 13_000.0)
            .map(|state| relative(state).cross_track_m.abs())
            .fold(0.0, f64::max);
        assert!(worst < 3.0, "from {right_m} m: {worst} m off");
        let overshoot = states
            .iter()
            .map(|state| -relative(state).cross_track_m * right_m.signum())
            .fold(0.0, f64::max);
        assert!(
            overshoot < 60.0,
            "from {right_m} m: overshoots by {overshoot} m"
        );
    }
}

#[test]
fn calm_air_is_flown_level_and_then_on_the_glide_path_within_a_metre() {
    let states = fly(&straight_in(0), &weather(0.0, 0.0, 0.0));
    for state in &states {
        let to_target_m = relative(state).along_track_m;
        if to_target_m > 15_500.0 {
            assert!((state.pose.altitude_msl_m - 762.0).abs() < 1.0, "{state:?}");
        }
        if (400.0..9_000.0).contains(&to_target_m) {
            assert!(
                above_path_m(state).abs() < 1.0,
                "{} m at {to_target_m}",
                above_path_m(state)
            );
            assert!(relative(state).cross_track_m.abs() < 1.0);
        }
    }
}

#[test]
fn calm_landings_touch_down_gently_where_the_recorded_ones_do() {
    for seed in 0..12 {
        let states = fly(&straight_in(seed), &weather(0.0, 0.0, 0.0));
        let touchdown_m = touchdown_past_threshold_m(&states);
        assert!(
            (290.0..630.0).contains(&touchdown_m),
            "seed {seed}: {touchdown_m} m"
        );
        let contact = states.iter().position(|state| state.on_ground).unwrap();
        let sink_mps = states[contact - 1].velocity_down_mps;
        assert!(
            (0.3..2.5).contains(&sink_mps),
            "seed {seed}: {sink_mps} m/s"
        );
        let last = states.last().unwrap();
        let at_rest_msl_m = 6.71 + airframe::WHEEL_HEIGHT_BELOW_CG_M;
        assert!(
            (last.pose.altitude_msl_m - at_rest_msl_m).abs() < 0.05,
            "{last:?}"
        );
        assert!((last.time_s - states[contact].time_s - ROLL_OUT_S).abs() < 0.05);
        assert!(last.true_airspeed_mps < states[contact].true_airspeed_mps - 4.0);
    }
}

#[test]
fn landings_in_hard_weather_still_end_on_the_runway() {
    for seed in 0..10 {
        for air in [
            weather(340.0, 11.3, 0.5),
            weather(100.0, 10.0, 0.5),
            weather(203.0, 5.0, 0.3),
            weather(20.0, 10.0, 1.0),
        ] {
            let states = fly(&straight_in(seed), &air);
            let touchdown = states.iter().find(|state| state.on_ground).expect("landed");
            let past_m = 340.1 - relative(touchdown).along_track_m;
            assert!(
                (-50.0..1_100.0).contains(&past_m),
                "seed {seed} {air:?}: {past_m} m"
            );
            let off_m = relative(touchdown).cross_track_m;
            assert!(
                off_m.abs() < 20.0,
                "seed {seed} {air:?}: {off_m} m off the centreline"
            );
            let roll_deg = touchdown.pose.roll_deg;
            assert!(
                roll_deg.abs() < 12.0,
                "seed {seed} {air:?}: lands with {roll_deg} degrees of bank"
            );
        }
    }
}

#[test]
fn states_move_as_their_velocities_say() {
    // 30 Hz, no jump: positions follow velocities, also through the touchdown.
    let states = fly(&straight_in(1), &weather(340.0, 11.0, 0.5));
    for pair in states.windows(2) {
        let seconds = pair[1].time_s - pair[0].time_s;
        assert!((seconds - 1.0 / 30.0).abs() < 1e-9);
        let from = pair[0].pose.position();
        let moved =
            from.ecef_from_ned().transpose() * (pair[1].pose.position().to_ecef() - from.to_ecef());
        let velocity = |state: &FlightState| {
            DVec3::new(
                state.velocity_north_mps,
                state.velocity_east_mps,
                state.velocity_down_mps,
            )
        };
        let expected = (velocity(&pair[0]) + velocity(&pair[1])) * 0.5 * seconds;
        assert!(
            moved.distance(expected) < 0.02,
            "{moved} {expected} at {}",
            pair[0].time_s
        );
    }
}

#[test]
fn wind_from_the_right_points_the_nose_right_and_the_track_stays_on_course() {
    for (from_true_deg, sign) in [(113.0, 1.0), (293.0, -1.0)] {
        let states = fly(&straight_in(0), &weather(from_true_deg, 8.0, 0.0));
        let state = states
            .iter()
            .find(|state| relative(state).along_track_m < 6_000.0)
            .unwrap();
        let crab_deg = state.pose.heading_true_deg - 23.02;
        assert!((4.0..14.0).contains(&(crab_deg * sign)), "crab {crab_deg}");
        let track_deg = state
            .velocity_east_mps
            .atan2(state.velocity_north_mps)
            .to_degrees();
        assert!((track_deg - 23.02).abs() < 0.5, "track {track_deg}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_another_flight() {
    let air = weather(60.0, 6.0, 0.3);
    let text = |seed| serde_json::to_string(&fly(&straight_in(seed), &air)).unwrap();
    assert_eq!(text(0), text(0));
    assert_ne!(text(0), text(1));
}

#[test]
fn seeds_change_the_turbulence_and_not_only_the_crew() {
    let air = weather(60.0, 6.0, 0.3);
    let (first, second) = (fly(&straight_in(0), &air), fly(&straight_in(7), &air));
    // In the first ten seconds all crews fly level at the same speed: only the air differs.
    let differs = first
        .iter()
        .zip(&second)
        .take(300)
        .any(|(a, b)| (a.pose.pitch_deg - b.pose.pitch_deg).abs() > 0.1);
    assert!(differs);
}

#[test]
fn the_charted_step_down_levels_at_1500_ft_before_the_glide_path() {
    let mut request = straight_in(2);
    request.profile = ApproachProfile::charted_step_down(0.0);
    let states = fly(&request, &weather(0.0, 0.0, 0.0));
    let level = states
        .iter()
        .filter(|state| (state.pose.altitude_msl_m - 457.2).abs() < 3.0)
        .count();
    assert!(
        level > 4 * OUTPUT_RATE_HZ as usize,
        "level for {level} states"
    );
    let lowest = states
        .iter()
        .filter(|state| (8_500.0..13_500.0).contains(&relative(state).along_track_m))
        .map(above_path_m)
        .fold(f64::INFINITY, f64::min);
    assert!(
        (-80.0..-25.0).contains(&lowest),
        "goes {lowest} m under the path"
    );
    assert!((290.0..630.0).contains(&touchdown_past_threshold_m(&states)));
}

#[test]
fn a_continuous_descent_has_no_level_segment_from_above_or_below_the_path() {
    for start_altitude_msl_m in [850.0, 915.0, 1_100.0] {
        let mut request = straight_in(2);
        request.start.position.altitude_msl_m = start_altitude_msl_m;
        request.profile = ApproachProfile::ContinuousDescent {
            start_altitude_msl_m,
        };
        let states = fly(&request, &weather(0.0, 0.0, 0.0));
        let before_flare = states
            .iter()
            .filter(|state| relative(state).along_track_m > 500.0);
        let slowest = before_flare
            .map(|state| state.velocity_down_mps)
            .fold(f64::INFINITY, f64::min);
        assert!(
            slowest > 0.5,
            "from {start_altitude_msl_m} m: slowest descent {slowest} m/s"
        );
        let at_3_nm = states
            .iter()
            .find(|state| relative(state).along_track_m < 5_556.0)
            .unwrap();
        assert!(
            above_path_m(at_3_nm).abs() < 1.5,
            "from {start_altitude_msl_m} m"
        );
    }
}

#[test]
fn a_flight_that_runs_out_of_time_ends_in_the_air() {
    let mut request = straight_in(0);
    request.time_limit_s = 10.0;
    let states = fly(&request, &weather(0.0, 0.0, 0.0));
    assert_eq!(states.len(), 301);
    assert!(states.iter().all(|state| !state.on_ground));
}

#[test]
fn each_type_lands_on_its_own_wheels_at_its_own_speed() {
    for aircraft in AircraftType::all() {
        let states = super::fly(&straight_in(3), aircraft, &weather(0.0, 0.0, 0.0));
        let name = &aircraft.name;
        let last = states.last().unwrap();
        assert!(last.on_ground, "{name} has not landed");
        let over_ground_m = last.pose.altitude_msl_m - 6.71;
        let wheels_m = aircraft.wheel_height_below_cg_m();
        assert!(
            (over_ground_m - wheels_m).abs() < 0.1,
            "{name}: {over_ground_m} m, its wheels reach {wheels_m} m"
        );
        let final_approach = states
            .iter()
            .find(|state| state.pose.altitude_msl_m < 120.0)
            .unwrap();
        let off_mps = final_approach.true_airspeed_mps - aircraft.approach_speed_mps;
        // Crews differ by 0.8 m/s, and true airspeed is equivalent airspeed at sea level within half a percent.
        assert!(off_mps.abs() < 1.6, "{name}: {off_mps} m/s off");
        let pitch_deg = final_approach.pose.pitch_deg;
        assert!((2.0..5.0).contains(&pitch_deg), "{name}: {pitch_deg}");
    }
}
