//! JSON lines of `jet1090`: decoded Mode S messages, one per line. Positions have no speed; the last velocity message supplies it.

use std::collections::BTreeMap;
use std::io::BufRead;

use dataset::geometry::geodesy::LatLon;
use dataset::numbers::units::{METERS_PER_FOOT, MPS_PER_KNOT};
use serde::Deserialize;

use super::{Fix, NearFixes, Track};

/// A velocity is forgotten after this time, seconds.
const VELOCITY_S: f64 = 5.0;
/// Positions on the ground (BDS register).
const SURFACE: &str = "06";

#[derive(Deserialize)]
struct Message {
    timestamp: f64,
    icao24: Option<String>,
    bds: Option<String>,
    latitude: Option<f64>,
    longitude: Option<f64>,
    altitude: Option<f64>,
    groundspeed: Option<f64>,
    track: Option<f64>,
}

type Velocity = (f64, f64, f64);

pub(super) fn is_one(head: &[u8]) -> bool {
    let first = head.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let contains = |word: &[u8]| first.windows(word.len()).any(|part| part == word);
    contains(b"\"frame\"") && contains(b"\"timestamp\"")
}

/// The tracks near a place; the error is a line and the reason.
pub(super) fn read<R: BufRead>(file: R, target: LatLon) -> Result<Vec<Track>, String> {
    let mut tracks: BTreeMap<String, NearFixes> = BTreeMap::new();
    let mut velocities: BTreeMap<String, Velocity> = BTreeMap::new();
    for (index, line) in file.lines().enumerate() {
        let bad = |error: &dyn std::fmt::Display| format!("line {}: {error}", index + 1);
        let line = line.map_err(|error| bad(&error))?;
        if line.trim().is_empty() {
            continue;
        }
        let message: Message = serde_json::from_str(&line).map_err(|error| bad(&error))?;
        let Some(aircraft) = message.icao24 else {
            continue;
        };
        // An aircraft without any position is counted as well.
        let kept = tracks.entry(aircraft.clone()).or_default();
        if let (Some(knots), Some(track_deg)) = (message.groundspeed, message.track) {
            velocities.insert(
                aircraft.clone(),
                (message.timestamp, knots * MPS_PER_KNOT, track_deg),
            );
        }
        let (Some(latitude_deg), Some(longitude_deg)) = (message.latitude, message.longitude)
        else {
            continue;
        };
        let velocity = velocities
            .get(&aircraft)
            .filter(|(time_s, ..)| (message.timestamp - time_s).abs() < VELOCITY_S);
        let fix = Fix {
            time_s: message.timestamp,
            latitude_deg,
            longitude_deg,
            altitude_m: message.altitude.map(|feet| feet * METERS_PER_FOOT),
            ground_speed_mps: velocity.map(|velocity| velocity.1),
            track_deg: velocity.map(|velocity| velocity.2),
            on_ground: message.bds.as_deref() == Some(SURFACE),
            attitude: None,
            is_simulated: false,
        };
        kept.add(fix, target);
    }
    Ok(super::tracks_of(tracks))
}
