//! Flights of this [`VERSION`], kept in `golden/flights.json`: plans with computed flights name the version, so different flights need a
//! new one. With a new version, `cargo test --release -p flight-model --lib golden -- --ignored` writes the file.

use std::path::PathBuf;

use dataset::geometry::approach_profile::ApproachProfile;
use serde_json::{Value, json};

use super::{fly, straight_in, weather};
use crate::{OUTPUT_RATE_HZ, VERSION};

/// Seconds between two states that are kept.
const EVERY_S: usize = 20;
/// Largest difference, in multiples of the larger of the value and 1: mathematical functions differ by less from system to system.
const TOLERANCE: f64 = 1e-9;

fn path() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("golden/flights.json")
}

fn kept() -> Value {
    serde_json::from_slice(&std::fs::read(path()).unwrap()).unwrap()
}

/// A flight per vertical profile, in calm, windy and rough air.
fn flown() -> Value {
    let descent = ApproachProfile::ContinuousDescent {
        start_altitude_msl_m: 762.0,
    };
    let flights = [
        (straight_in(1).profile, weather(0.0, 0.0, 0.0)),
        (
            ApproachProfile::charted_step_down(0.0),
            weather(60.0, 6.0, 0.3),
        ),
        (descent, weather(340.0, 11.3, 0.5)),
    ];
    let states = flights.map(|(profile, air)| {
        let mut request = straight_in(1);
        request.profile = profile;
        let every = EVERY_S * OUTPUT_RATE_HZ as usize;
        fly(&request, &air)
            .into_iter()
            .step_by(every)
            .collect::<Vec<_>>()
    });
    json!({ "version": VERSION, "flights": states })
}

/// The first difference of two values, by its place.
fn difference(place: &str, kept: &Value, flown: &Value) -> Option<String> {
    let differs = || Some(format!("{place} was {kept}, is {flown}"));
    match (kept, flown) {
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            let mut pairs = a.iter().zip(b).enumerate();
            pairs.find_map(|(at, (a, b))| difference(&format!("{place}[{at}]"), a, b))
        }
        (Value::Object(a), Value::Object(b)) if a.len() == b.len() => a
            .iter()
            .find_map(|(key, a)| difference(&format!("{place}.{key}"), a, b.get(key)?)),
        (Value::Number(a), Value::Number(b)) => {
            let (a, b) = (a.as_f64()?, b.as_f64()?);
            let is_near = (a - b).abs() <= TOLERANCE * a.abs().max(1.0);
            (!is_near).then(differs).flatten()
        }
        (a, b) => (a != b).then(differs).flatten(),
    }
}

#[test]
fn flights_are_those_of_the_version() {
    if let Some(difference) = difference("flights.json: ", &kept(), &flown()) {
        panic!(
            "{difference}: a model that flies otherwise has a new VERSION; raise it, and remake the file"
        );
    }
}

#[test]
#[ignore = "writes golden/flights.json"]
fn golden_flights_are_remade() {
    if path().exists() {
        assert_ne!(kept()["version"], VERSION, "raise VERSION first");
    }
    let text = serde_json::to_string_pretty(&flown()).unwrap();
    std::fs::write(path(), text + "\n").unwrap();
}
