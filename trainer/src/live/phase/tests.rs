//! Simulated flights beside the runway, with realistic errors.

use super::*;

/// Distance of the camera behind the target, metres.
const SETBACK_M: f64 = 1_500.0;

/// Relative fit errors: slowly varying and new ones.
#[derive(Clone, Copy)]
struct Errors {
    slow: f64,
    new: f64,
}

const REGISTERED: Errors = Errors {
    slow: 0.0003,
    new: 0.0003,
};
const OF_ONE_VIEW: Errors = Errors {
    slow: 0.02,
    new: 0.01,
};

/// A pseudorandom number from -1 to 1.
fn jitter(seed: u32, step: u32) -> f64 {
    let mixed =
        (seed.wrapping_mul(0x9E37_79B9) ^ step.wrapping_mul(0x85EB_CA6B)).wrapping_mul(0xC2B2_AE35);
    f64::from(mixed ^ mixed >> 15) / f64::from(u32::MAX) * 2.0 - 1.0
}

/// Phases during a flight with five ticks per second.
fn phases(seconds: u32, errors: Errors, at: impl Fn(f64) -> [f64; 2]) -> Vec<Phase> {
    let mut judge = PhaseJudge::default();
    let ticks = 0..5 * seconds;
    ticks
        .map(|tick| {
            let time_s = f64::from(tick) / 5.0;
            let [distance_m, height_m] = at(time_s);
            let slow = errors.slow * (time_s / 16.0).sin();
            let new = errors.new * 1.5 * jitter(5, tick);
            let measured_m = distance_m * (1.0 + slow + new);
            let range_m = distance_m + SETBACK_M;
            let elevation = (height_m / range_m).atan() + 3e-5 * jitter(9, tick);
            judge.push(TrackPoint {
                time_s,
                fit: 0,
                distance_m: measured_m,
                range_m: measured_m + SETBACK_M,
                slow_m: errors.slow * distance_m,
                half_time_s: 16.0,
                new_m: errors.new * distance_m,
                elevations: vec![None, Some(elevation)],
            });
            judge.phase()
        })
        .collect()
}

/// Start of the final phase, seconds.
fn from_s(phases: &[Phase], phase: Phase) -> Option<f64> {
    let last_other = phases.iter().rposition(|found| *found != phase);
    let first = last_other.map_or(0, |last| last + 1);
    (first < phases.len()).then_some(first as f64 / 5.0)
}

fn glide_m(distance_m: f64) -> f64 {
    distance_m * 3_f64.to_radians().tan()
}

#[test]
fn arrivals_on_the_glide_path_and_level_before_it_arrive_all_the_time() {
    for errors in [REGISTERED, OF_ONE_VIEW] {
        for speed_mps in [45.0, 70.0, 85.0] {
            let arrival = phases(240, errors, |time_s| {
                let distance_m = 22_000.0 - speed_mps * time_s;
                [distance_m, glide_m(distance_m).min(760.0)]
            });
            assert_eq!(
                from_s(&arrival, Phase::Arrival),
                Some(0.0),
                "{speed_mps} m/s"
            );
        }
    }
}

#[test]
fn what_taxies_departs_stands_or_crosses_does_not_arrive_after_five_seconds() {
    for (what, errors, from_m, speed_mps, climb_mps) in [
        ("stands", REGISTERED, 400.0, 0.0, 0.0),
        ("stands", OF_ONE_VIEW, 400.0, 0.0, 0.0),
        ("taxies", REGISTERED, 900.0, 9.0, 0.0),
        ("taxies", OF_ONE_VIEW, 500.0, -9.0, 0.0),
        ("departs", REGISTERED, 500.0, -75.0, 9.0),
        ("departs", OF_ONE_VIEW, 1_500.0, -75.0, 9.0),
        ("crosses", REGISTERED, 12_000.0, 5.0, 0.0),
    ] {
        let found = phases(60, errors, |time_s| {
            [from_m - speed_mps * time_s, 30.0 + climb_mps * time_s]
        });
        let since_s = from_s(&found, Phase::Other);
        assert!(since_s.is_some_and(|s| s <= 5.0), "{what}: {since_s:?}");
    }
}

#[test]
fn a_climb_after_a_missed_approach_is_another_phase_until_it_comes_down_again() {
    for errors in [REGISTERED, OF_ONE_VIEW] {
        let missed = phases(60, errors, |time_s| {
            let distance_m = 6_000.0 - 70.0 * time_s;
            let climbed_m = 10.0 * (time_s - 30.0).max(0.0);
            [distance_m, glide_m(distance_m.max(3_900.0)) + climbed_m]
        });
        assert!(missed[..150].iter().all(|phase| *phase == Phase::Arrival));
        let since_s = from_s(&missed, Phase::Other);
        assert!(since_s.is_some_and(|s| s <= 38.0), "{since_s:?}");
    }
    let again = phases(120, REGISTERED, |time_s| {
        let distance_m = 16_000.0 - 75.0 * time_s;
        let height_m = if time_s < 20.0 {
            300.0 + 8.0 * time_s
        } else {
            glide_m(distance_m).min(460.0)
        };
        [distance_m, height_m]
    });
    assert!(again[50..90].iter().all(|phase| *phase == Phase::Other));
    let since_s = from_s(&again, Phase::Arrival);
    assert!(since_s.is_some_and(|s| s <= 110.0), "{since_s:?}");
}

#[test]
fn an_aircraft_that_turns_to_its_final_approach_arrives_from_then_on() {
    let turns = phases(120, REGISTERED, |time_s| {
        let distance_m = 15_000.0 - 3.0 * time_s.min(40.0) - 72.0 * (time_s - 40.0).max(0.0);
        [distance_m, 600.0]
    });
    assert!(turns[25..200].iter().all(|phase| *phase == Phase::Other));
    let since_s = from_s(&turns, Phase::Arrival);
    assert!(since_s.is_some_and(|s| s <= 50.0), "{since_s:?}");
}
