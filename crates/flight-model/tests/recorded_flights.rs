//! Compares the flight model with an independent model's six flights; see `testkit_simulator::recorded_flights`.
//!
//! A flight in turbulence is one draw of many, so twins are flown with several seeds, and figures are compared by the geometric
//! mean of their ratios over the five flights in moving air.
//! `cargo test -p flight-model recorded -- --nocapture` prints the figures.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use dataset::geometry::pose::FlightState;
use dataset::numbers::spread::mean_and_deviation;
use testkit::approach::{above_path_m, relative, touchdown_past_threshold_m};
use testkit_simulator::recorded_flights::{RecordedFlight, recorded_flights, spectrum};

const SEEDS: u64 = 8;
/// Stabilised final approach: distance to the target, metres.
const FINAL_M: std::ops::Range<f64> = 740.0..7_840.0;

struct Recorded {
    flight: RecordedFlight,
    twins: Vec<Vec<FlightState>>,
}

static RECORDED: LazyLock<Vec<Recorded>> = LazyLock::new(|| {
    let with_twins = |flight: RecordedFlight| Recorded {
        twins: (0..SEEDS).map(|seed| flight.twin(seed)).collect(),
        flight,
    };
    recorded_flights().into_iter().map(with_twins).collect()
});

fn final_approach(states: &[FlightState]) -> Vec<FlightState> {
    let on_final = |state: &&FlightState| FINAL_M.contains(&relative(state).along_track_m);
    states.iter().filter(on_final).copied().collect()
}

fn spread(values: &[f64]) -> f64 {
    mean_and_deviation(values.iter().copied())[1]
}

/// Root of the power of a series within a band of frequencies.
fn band_amplitude(values: &[f64], (from_hz, to_hz): (f64, f64)) -> f64 {
    let in_band =
        |(hz, amplitude): (f64, f64)| (from_hz..to_hz).contains(&hz).then_some(amplitude.powi(2));
    spectrum(values)
        .into_iter()
        .filter_map(in_band)
        .sum::<f64>()
        .sqrt()
}

/// Final approach figures that must match the recorded flights.
fn figures(states: &[FlightState]) -> BTreeMap<&'static str, f64> {
    let states = final_approach(states);
    let series = |of: fn(&FlightState) -> f64| -> Vec<f64> { states.iter().map(of).collect() };
    let airspeed = series(|state| state.true_airspeed_mps);
    let sink = series(|state| state.velocity_down_mps);
    BTreeMap::from([
        (
            "spread of height over the path, m",
            spread(&series(above_path_m)),
        ),
        (
            "spread of cross-track, m",
            spread(&series(|state| relative(state).cross_track_m)),
        ),
        ("spread of vertical speed, m/s", spread(&sink)),
        (
            "spread of pitch, deg",
            spread(&series(|state| state.pose.pitch_deg)),
        ),
        (
            "spread of roll, deg",
            spread(&series(|state| state.pose.roll_deg)),
        ),
        (
            "spread of heading, deg",
            spread(&series(|state| state.pose.heading_true_deg)),
        ),
        (
            "airspeed 0.03 to 0.1 Hz, m/s",
            band_amplitude(&airspeed, (0.03, 0.1)),
        ),
        (
            "airspeed 0.1 to 0.4 Hz, m/s",
            band_amplitude(&airspeed, (0.1, 0.4)),
        ),
        (
            "airspeed 0.4 to 1.5 Hz, m/s",
            band_amplitude(&airspeed, (0.4, 1.5)),
        ),
        (
            "vertical speed 0.03 to 0.1 Hz, m/s",
            band_amplitude(&sink, (0.03, 0.1)),
        ),
        (
            "vertical speed 0.1 to 0.4 Hz, m/s",
            band_amplitude(&sink, (0.1, 0.4)),
        ),
        (
            "vertical speed 0.4 to 1.5 Hz, m/s",
            band_amplitude(&sink, (0.4, 1.5)),
        ),
    ])
}

#[test]
fn spreads_and_spectra_are_within_a_factor_1_5_of_the_recorded_flights() {
    let mut logs: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for flight in RECORDED.iter().filter(|flight| !flight.flight.is_calm()) {
        let truth = figures(&flight.flight.states);
        let twins: Vec<_> = flight.twins.iter().map(|twin| figures(twin)).collect();
        for (name, value) in &truth {
            let mean_square =
                twins.iter().map(|twin| twin[name].powi(2)).sum::<f64>() / SEEDS as f64;
            let ratio = mean_square.sqrt() / value;
            println!(
                "{:26} {name:36} recorded {value:6.3} ratio {ratio:5.2}",
                flight.flight.name
            );
            // A single flight is one draw, and one autopilot: a factor of 2.6 catches bugs, the mean below is the real test.
            assert!(
                (1.0 / 2.6..2.6).contains(&ratio),
                "{} {name}: {ratio}",
                flight.flight.name
            );
            logs.entry(name).or_default().push(ratio.ln());
        }
    }
    for (name, logs) in logs {
        let ratio = (logs.iter().sum::<f64>() / logs.len() as f64).exp();
        println!("{:26} {name:36} ratio {ratio:5.2}", "mean of five");
        assert!((1.0 / 1.5..1.5).contains(&ratio), "{name}: {ratio}");
    }
}

#[test]
fn speed_by_distance_follows_the_recorded_flights() {
    for flight in RECORDED.iter() {
        for to_target_m in [16_000.0, 14_000.0, 12_000.0, 10_000.0, 6_000.0, 2_000.0] {
            // Over a kilometre, not at a point: single gusts average out.
            let mean = |states: &[FlightState]| {
                let near = |state: &&FlightState| {
                    (relative(state).along_track_m - to_target_m).abs() < 500.0
                };
                let (sum, count) = states
                    .iter()
                    .filter(near)
                    .fold((0.0, 0.0), |(sum, count), state| {
                        (sum + state.true_airspeed_mps, count + 1.0)
                    });
                sum / count
            };
            let flown = flight.twins.iter().map(|twin| mean(twin)).sum::<f64>() / SEEDS as f64;
            let expected = mean(&flight.flight.states);
            println!(
                "{:26} {to_target_m:6} m: {flown:5.1} recorded {expected:5.1} m/s",
                flight.flight.name
            );
            assert!(
                (flown - expected).abs() < 7.0,
                "{} at {to_target_m} m: {flown} {expected}",
                flight.flight.name
            );
        }
    }
}

#[test]
fn height_and_vertical_speed_by_distance_follow_the_recorded_flights() {
    for flight in RECORDED.iter() {
        let twin = &flight.twins[0];
        for to_target_m in [
            17_000.0, 14_500.0, 12_000.0, 9_500.0, 8_000.0, 4_000.0, 1_000.0,
        ] {
            let over_a_kilometre = |states: &[FlightState]| {
                let near: Vec<_> = states
                    .iter()
                    .filter(|state| (relative(state).along_track_m - to_target_m).abs() < 500.0)
                    .collect();
                let count = near.len() as f64;
                let height = near.iter().map(|state| above_path_m(state)).sum::<f64>() / count;
                (
                    height,
                    near.iter()
                        .map(|state| state.velocity_down_mps)
                        .sum::<f64>()
                        / count,
                )
            };
            let (height, sink) = over_a_kilometre(twin);
            let (expected_height, expected_sink) = over_a_kilometre(&flight.flight.states);
            println!(
                "{:26} {to_target_m:6} m: {height:6.1} recorded {expected_height:6.1} m over the path, sinks {sink:4.1} recorded {expected_sink:4.1} m/s",
                flight.flight.name
            );
            assert!(
                (height - expected_height).abs() < 30.0,
                "{} at {to_target_m} m",
                flight.flight.name
            );
            if to_target_m < 8_500.0 {
                let ratio = sink / expected_sink;
                assert!(
                    (1.0 / 1.5..1.5).contains(&ratio),
                    "{} at {to_target_m} m: {ratio}",
                    flight.flight.name
                );
            }
        }
    }
}

#[test]
fn crab_angles_are_those_of_the_recorded_flights() {
    for flight in RECORDED.iter() {
        let heading = |states: &[FlightState]| {
            let states = final_approach(states);
            states
                .iter()
                .map(|state| state.pose.heading_true_deg)
                .sum::<f64>()
                / states.len() as f64
        };
        let (flown, expected) = (heading(&flight.twins[0]), heading(&flight.flight.states));
        assert!(
            (flown - expected).abs() < 2.5,
            "{}: {flown} recorded {expected}",
            flight.flight.name
        );
    }
}

#[test]
fn touchdowns_scatter_about_those_of_the_recorded_flights() {
    let (mut flown, mut expected) = (vec![], vec![]);
    for flight in RECORDED.iter() {
        expected.push(touchdown_past_threshold_m(&flight.flight.states));
        flown.extend(
            flight
                .twins
                .iter()
                .map(|twin| touchdown_past_threshold_m(twin)),
        );
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    println!(
        "recorded {:.0} +- {:.0} m, flown {:.0} +- {:.0} m",
        mean(&expected),
        spread(&expected),
        mean(&flown),
        spread(&flown)
    );
    assert!((mean(&flown) - mean(&expected)).abs() < 60.0, "{flown:?}");
    assert!(
        (1.0 / 1.5..1.5).contains(&(spread(&flown) / spread(&expected))),
        "{flown:?}"
    );
}
