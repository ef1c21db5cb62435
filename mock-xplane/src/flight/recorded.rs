//! The flight model against six flights of an independent one (`tests/data/flights`).
//!
//! Each recorded flight gets a twin: same start, profile and wind. A flight in turbulence is one draw of many, so twins are
//! flown with several seeds, and figures are compared by the geometric mean of their ratios over the five flights in
//! moving air. How strong the recorded turbulence was is told in words only: its `turbulence_ratio` here is fitted to the
//! airspeed's fluctuation, once; everything else (path, attitude, spectra) then has to follow.
//! `cargo test -p mock-xplane recorded -- --nocapture` prints the figures.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;

use dataset::pose::Pose;
use dataset::units::MPS_PER_KNOT;
use xplane_bridge::fly::{ApproachProfile, FlightStart};

use super::tests::{above_path_m, changi_02l, relative, touchdown_past_threshold_m, weather};
use super::*;

const SEEDS: u64 = 8;
/// The recorded flights are kept at 5 Hz; their twins are compared at the same rate.
const RATE_HZ: f64 = 5.0;
/// Stabilised final approach: distance to the target, metres.
const FINAL_M: std::ops::Range<f64> = 740.0..7_840.0;

struct Recorded {
    name: &'static str,
    wind_from_true_deg: f64,
    wind_kt: f64,
    turbulence_ratio: f64,
    states: Vec<FlightState>,
    /// One for each seed.
    twins: Vec<Vec<FlightState>>,
}

static RECORDED: LazyLock<Vec<Recorded>> = LazyLock::new(|| {
    [
        ("01_calm_ils", 0.0, 0.0, 0.0),
        ("03_xwind_right_mod_turb", 100.0, 17.0, 0.43),
        ("04_storm_gusts", 340.0, 22.0, 0.49),
        ("05_step_down_1500", 20.0, 6.0, 0.16),
        ("07_loc_offset_intercept", 60.0, 8.0, 0.26),
        ("10_from_3000ft_cda", 50.0, 12.0, 0.40),
    ]
    .map(|(name, wind_from_true_deg, wind_kt, turbulence_ratio)| {
        let mut flight = Recorded {
            name,
            wind_from_true_deg,
            wind_kt,
            turbulence_ratio,
            states: read(name),
            twins: vec![],
        };
        flight.twins = (0..SEEDS).map(|seed| flight.twin(seed)).collect();
        flight
    })
    .into()
});

fn read(name: &str) -> Vec<FlightState> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/flights");
    let mut reader = csv::Reader::from_path(folder.join(format!("{name}.csv"))).unwrap();
    let row = |record: csv::StringRecord| -> FlightState {
        let field = |index: usize| -> f64 { record[index].parse().unwrap() };
        FlightState {
            time_s: field(0),
            pose: Pose {
                latitude_deg: field(1),
                longitude_deg: field(2),
                altitude_msl_m: field(3),
                pitch_deg: field(4),
                roll_deg: field(5),
                heading_true_deg: field(6),
            },
            true_airspeed_mps: field(7),
            velocity_north_mps: field(8),
            velocity_east_mps: field(9),
            velocity_down_mps: field(10),
            controls: Controls {
                flap_ratio: field(11),
                gear_ratio: field(12),
            },
            on_ground: field(13) == 1.0,
        }
    };
    reader
        .records()
        .map(|record| row(record.unwrap()))
        .collect()
}

impl Recorded {
    fn is_calm(&self) -> bool {
        self.turbulence_ratio == 0.0
    }

    fn twin(&self, seed: u64) -> Vec<FlightState> {
        let first = &self.states[0];
        // A start is asked for in steady air: the first row's airspeed has a gust in it, the mean of 20 s has not.
        let first_100 = &self.states[..100];
        let speed_mps = first_100
            .iter()
            .map(|state| state.true_airspeed_mps)
            .sum::<f64>()
            / 100.0;
        let request = FlyRequest {
            start: FlightStart {
                position: first.pose.position(),
                heading_true_deg: first.pose.heading_true_deg,
                speed_mps,
            },
            runway: changi_02l(),
            profile: match self.name {
                "05_step_down_1500" => ApproachProfile::charted_step_down(),
                "10_from_3000ft_cda" => ApproachProfile::ContinuousDescent {
                    start_altitude_msl_m: first.pose.altitude_msl_m,
                },
                _ => ApproachProfile::GlidePath {
                    level_altitude_msl_m: 762.0,
                },
            },
            seed,
            time_limit_s: 900.0,
        };
        let air = weather(
            self.wind_from_true_deg,
            self.wind_kt * MPS_PER_KNOT,
            self.turbulence_ratio,
        );
        fly(&request, &air).into_iter().step_by(6).collect()
    }
}

fn final_approach(states: &[FlightState]) -> Vec<FlightState> {
    let on_final = |state: &&FlightState| FINAL_M.contains(&relative(state).along_track_m);
    states.iter().filter(on_final).copied().collect()
}

fn spread(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

/// Root of the power of a series within a band of frequencies (Hann window, discrete Fourier transform).
fn band_amplitude(values: &[f64], band_hz: (f64, f64)) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let (mut power, mut bin) = (0.0, 1.0);
    while bin * RATE_HZ / count < band_hz.1 {
        if bin * RATE_HZ / count >= band_hz.0 {
            let (mut re, mut im) = (0.0, 0.0);
            for (i, value) in values.iter().enumerate() {
                let window = 1.0 - (std::f64::consts::TAU * i as f64 / count).cos();
                let (sin, cos) = (std::f64::consts::TAU * bin * i as f64 / count).sin_cos();
                re += window * (value - mean) * cos;
                im += window * (value - mean) * sin;
            }
            power += (re * re + im * im) / (count * count);
        }
        bin += 1.0;
    }
    power.sqrt()
}

/// Figures of a final approach that must be like those of the recorded flights.
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
    for flight in RECORDED.iter().filter(|flight| !flight.is_calm()) {
        let truth = figures(&flight.states);
        let twins: Vec<_> = flight.twins.iter().map(|twin| figures(twin)).collect();
        for (name, value) in &truth {
            let mean_square =
                twins.iter().map(|twin| twin[name].powi(2)).sum::<f64>() / SEEDS as f64;
            let ratio = mean_square.sqrt() / value;
            println!(
                "{:26} {name:36} recorded {value:6.3} ratio {ratio:5.2}",
                flight.name
            );
            // A single flight is one draw, and one autopilot: a factor 2.6 catches what is broken, the mean below judges.
            assert!(
                (1.0 / 2.6..2.6).contains(&ratio),
                "{} {name}: {ratio}",
                flight.name
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
            let expected = mean(&flight.states);
            println!(
                "{:26} {to_target_m:6} m: {flown:5.1} recorded {expected:5.1} m/s",
                flight.name
            );
            assert!(
                (flown - expected).abs() < 7.0,
                "{} at {to_target_m} m: {flown} {expected}",
                flight.name
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
            let (expected_height, expected_sink) = over_a_kilometre(&flight.states);
            println!(
                "{:26} {to_target_m:6} m: {height:6.1} recorded {expected_height:6.1} m over the path, sinks {sink:4.1} recorded {expected_sink:4.1} m/s",
                flight.name
            );
            assert!(
                (height - expected_height).abs() < 30.0,
                "{} at {to_target_m} m",
                flight.name
            );
            if to_target_m < 8_500.0 {
                let ratio = sink / expected_sink;
                assert!(
                    (1.0 / 1.5..1.5).contains(&ratio),
                    "{} at {to_target_m} m: {ratio}",
                    flight.name
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
        let (flown, expected) = (heading(&flight.twins[0]), heading(&flight.states));
        assert!(
            (flown - expected).abs() < 2.5,
            "{}: {flown} recorded {expected}",
            flight.name
        );
    }
}

#[test]
fn touchdowns_scatter_about_those_of_the_recorded_flights() {
    let (mut flown, mut expected) = (vec![], vec![]);
    for flight in RECORDED.iter() {
        expected.push(touchdown_past_threshold_m(&flight.states));
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
