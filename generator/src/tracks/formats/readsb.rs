//! `trace_full` of readsb: an aircraft's day as JSON.

use dataset::numbers::units::{METERS_PER_FOOT, MPS_PER_KNOT};
use serde_json::Value;

use super::{Fix, Track};

/// Flags of a row: its position is older than 20 s; its altitude is geometric.
const STALE: u64 = 1;
const GEOMETRIC: u64 = 8;
/// Beginnings of sources whose positions scatter by tens of metres: multilateration, and radar by way of TIS-B.
const COARSE: [&str; 2] = ["mlat", "tisb"];

/// Rows: seconds, latitude, longitude, altitude in feet or "ground", knots, track, flags, vertical rate, details, source, geometric
/// altitude, its rate, indicated airspeed, roll.
pub(super) fn trace_full(trace: &Value) -> Option<Track> {
    let start_s = trace.get("timestamp")?.as_f64()?;
    let rows = trace.get("trace")?.as_array()?;
    let fix = |row: &Value| {
        let number = |at: usize| row.get(at).and_then(Value::as_f64);
        let feet = |at: usize| number(at).map(|feet| feet * METERS_PER_FOOT);
        let flags = row.get(6).and_then(Value::as_u64).unwrap_or_default();
        if flags & STALE != 0 {
            return None;
        }
        let is_geometric = flags & GEOMETRIC != 0;
        Some(Fix {
            time_s: start_s + number(0)?,
            latitude_deg: number(1)?,
            longitude_deg: number(2)?,
            altitude_m: feet(3).filter(|_| !is_geometric),
            geometric_m: feet(10).or(feet(3).filter(|_| is_geometric)),
            ground_speed_mps: number(4).map(|knots| knots * MPS_PER_KNOT),
            track_deg: number(5),
            roll_deg: number(13),
            on_ground: row.get(3).and_then(Value::as_str) == Some("ground"),
            ..Fix::default()
        })
    };
    let is_coarse = |row: &&Value| {
        let source = row.get(9).and_then(Value::as_str).unwrap_or_default();
        COARSE.iter().any(|begins| source.starts_with(begins))
    };
    let (coarse, sound): (Vec<_>, Vec<_>) = rows.iter().partition(is_coarse);
    Some(Track {
        aircraft: trace.get("icao").and_then(Value::as_str).map(str::to_owned),
        fixes: sound.into_iter().filter_map(fix).collect(),
        coarse: coarse.len(),
    })
}
