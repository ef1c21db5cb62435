//! JSON lines of `jet1090`: decoded Mode S messages, one per line. Positions have no speed, geometric altitude and roll; the last messages
//! that have them supply these.

use std::collections::BTreeMap;
use std::io::BufRead;

use dataset::geometry::geodesy::LatLon;
use dataset::numbers::units::{METERS_PER_FOOT, MPS_PER_KNOT};
use serde::Deserialize;

use super::{Fix, NearFixes, Track};

/// Maximum age of what other messages have reported, seconds.
const MAX_AGE_S: f64 = 5.0;
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
    geo_minus_baro: Option<f64>,
    roll: Option<f64>,
}

/// The last velocity with the geometric altitude relative to the other one, and the last roll, each with its time.
#[derive(Default)]
struct Heard {
    velocity: Option<(f64, f64, f64, Option<f64>)>,
    roll: Option<(f64, f64)>,
}

pub(super) fn is_one(head: &[u8]) -> bool {
    let first = head.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let contains = |word: &[u8]| first.windows(word.len()).any(|part| part == word);
    contains(b"\"frame\"") && contains(b"\"timestamp\"")
}

/// The tracks near a place; the error is a line and the reason.
pub(super) fn read<R: BufRead>(file: R, target: LatLon) -> Result<Vec<Track>, String> {
    let mut tracks: BTreeMap<String, NearFixes> = BTreeMap::new();
    let mut heard: BTreeMap<String, Heard> = BTreeMap::new();
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
        let now_s = message.timestamp;
        let heard = heard.entry(aircraft).or_default();
        if let (Some(knots), Some(track_deg)) = (message.groundspeed, message.track) {
            let higher_m = message.geo_minus_baro.map(|feet| feet * METERS_PER_FOOT);
            heard.velocity = Some((now_s, knots * MPS_PER_KNOT, track_deg, higher_m));
        }
        if let Some(roll_deg) = message.roll {
            heard.roll = Some((now_s, roll_deg));
        }
        let (Some(latitude_deg), Some(longitude_deg)) = (message.latitude, message.longitude)
        else {
            continue;
        };
        let is_recent = |heard_s: f64| (now_s - heard_s).abs() < MAX_AGE_S;
        let velocity = heard.velocity.filter(|velocity| is_recent(velocity.0));
        let altitude_m = message.altitude.map(|feet| feet * METERS_PER_FOOT);
        let higher_m = velocity.and_then(|velocity| velocity.3);
        let roll = heard.roll.filter(|roll| is_recent(roll.0));
        let fix = Fix {
            time_s: now_s,
            latitude_deg,
            longitude_deg,
            altitude_m,
            geometric_m: altitude_m.zip(higher_m).map(|(low, more)| low + more),
            ground_speed_mps: velocity.map(|velocity| velocity.1),
            track_deg: velocity.map(|velocity| velocity.2),
            roll_deg: roll.map(|roll| roll.1),
            on_ground: message.bds.as_deref() == Some(SURFACE),
            ..Fix::default()
        };
        kept.add(fix, target);
    }
    Ok(super::tracks_of(tracks))
}
