//! Six flights of an independent flight model, and the tools to compare ours with them.
//!
//! Input: the folder `tests/data/flights`. Output: the recorded flights, and twins of them (same start, profile and wind, flown by
//! the built-in model). `crates/flight-model/tests/recorded_flights.rs` compares them.

use std::path::Path;

use airframe::AircraftType;
use dataset::conditions::Weather;
use dataset::geometry::approach_profile::ApproachProfile;
use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::numbers::units::MPS_PER_KNOT;
use flight_model::{OUTPUT_RATE_HZ, fly};
use testkit::scenario::calm;
use testkit::{changi_02l, repository};
use xplane_bridge::fly::{FlightStart, FlyRequest};

/// The recorded flights are stored at 5 Hz; their twins are compared at the same rate.
pub(crate) const RATE_HZ: u32 = 5;

/// Name, wind (from degrees true, knots) and turbulence. The recorded turbulence is described only in words: the ratio here was
/// fitted once to the airspeed's fluctuation; everything else (path, attitude, spectra) must then follow.
const FLIGHTS: [(&str, f64, f64, f64); 6] = [
    ("01_calm_ils", 0.0, 0.0, 0.0),
    ("03_xwind_right_mod_turb", 100.0, 17.0, 0.43),
    ("04_storm_gusts", 340.0, 22.0, 0.49),
    ("05_step_down_1500", 20.0, 6.0, 0.16),
    ("07_loc_offset_intercept", 60.0, 8.0, 0.26),
    ("10_from_3000ft_cda", 50.0, 12.0, 0.40),
];

/// A flight of the independent model.
#[derive(Debug, Clone)]
pub struct RecordedFlight {
    /// File name without the ending.
    pub name: &'static str,
    /// Wind direction (from), degrees true.
    pub wind_from_true_deg: f64,
    /// Speed of the wind, knots.
    pub wind_kt: f64,
    /// Turbulence by our measure, 0 to 1.
    pub turbulence_ratio: f64,
    /// Flight states, 5 per second.
    pub states: Vec<FlightState>,
}

/// Reads all recorded flights.
pub fn recorded_flights() -> Vec<RecordedFlight> {
    let folder = repository().join("tests/data/flights");
    let read_one = |(name, wind_from_true_deg, wind_kt, turbulence_ratio)| RecordedFlight {
        name,
        wind_from_true_deg,
        wind_kt,
        turbulence_ratio,
        states: read(&folder.join(format!("{name}.csv"))),
    };
    FLIGHTS.into_iter().map(read_one).collect()
}

fn read(path: &Path) -> Vec<FlightState> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let row = |record: Result<csv::StringRecord, csv::Error>| {
        let record = record.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let fields: Vec<f64> = record.iter().map(|text| text.parse().unwrap()).collect();
        state(fields.try_into().expect("14 fields a row"))
    };
    reader.records().map(row).collect()
}

fn state(fields: [f64; 14]) -> FlightState {
    FlightState {
        time_s: fields[0],
        pose: Pose {
            latitude_deg: fields[1],
            longitude_deg: fields[2],
            altitude_msl_m: fields[3],
            pitch_deg: fields[4],
            roll_deg: fields[5],
            heading_true_deg: fields[6],
        },
        true_airspeed_mps: fields[7],
        velocity_north_mps: fields[8],
        velocity_east_mps: fields[9],
        velocity_down_mps: fields[10],
        controls: Controls {
            flap_ratio: fields[11],
            gear_ratio: fields[12],
        },
        on_ground: fields[13] == 1.0,
    }
}

impl RecordedFlight {
    /// True if it was flown in still air.
    pub fn is_calm(&self) -> bool {
        self.turbulence_ratio == 0.0
    }

    /// The built-in model's flight from the same start, by the same profile, in the same wind; one draw of many. 5 states a second.
    pub fn twin(&self, seed: u64) -> Vec<FlightState> {
        let first = &self.states[0];
        // A start is requested in steady air: the first row's airspeed contains a gust, the mean of 20 s does not.
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
                "05_step_down_1500" => ApproachProfile::charted_step_down(0.0),
                "10_from_3000ft_cda" => ApproachProfile::ContinuousDescent {
                    start_altitude_msl_m: first.pose.altitude_msl_m,
                },
                _ => ApproachProfile::GlidePath {
                    level_altitude_msl_m: 762.0,
                },
            },
            seed,
            time_limit_s: 900.0,
            already_started: false,
        };
        let weather = Weather {
            wind_speed_mps: self.wind_kt * MPS_PER_KNOT,
            wind_from_true_deg: self.wind_from_true_deg,
            turbulence_ratio: self.turbulence_ratio,
            ..calm(40_000.0)
        };
        let every = (OUTPUT_RATE_HZ / RATE_HZ) as usize;
        let states = fly(&request, AircraftType::boeing_737_800(), &weather);
        states.into_iter().step_by(every).collect()
    }
}

/// Amplitude of a series (5 values per second) by frequency: pairs of hertz and root of the bin's power (Hann window, discrete Fourier
/// transform).
pub fn spectrum(values: &[f64]) -> Vec<(f64, f64)> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let bin = |bin: usize| {
        let (mut re, mut im) = (0.0, 0.0);
        for (i, value) in values.iter().enumerate() {
            let window = 1.0 - (std::f64::consts::TAU * i as f64 / count).cos();
            let (sin, cos) = (std::f64::consts::TAU * bin as f64 * i as f64 / count).sin_cos();
            re += window * (value - mean) * cos;
            im += window * (value - mean) * sin;
        }
        let frequency_hz = bin as f64 * f64::from(RATE_HZ) / count;
        (frequency_hz, re.hypot(im) / count)
    };
    (1..values.len() / 2).map(bin).collect()
}
