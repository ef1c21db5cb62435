//! Files of tracks: CSV as `traffic` and OpenSky write them, `trace_full` of readsb (JSON), JSON lines of `jet1090`, and X-Plane's
//! recordings. The names of the columns tell the units.

mod jet1090;
mod x_plane;

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use chrono::DateTime;
use dataset::files::outside_file::{self, FileKind};
use dataset::geometry::geodesy::LatLon;
use dataset::geometry::runway::Runway;
use dataset::numbers::units::{METERS_PER_FOOT, MPS_PER_KNOT};
use serde_json::Value;

/// The largest file that is read.
const TRACKS: FileKind = FileKind::new("file of tracks", 1 << 40);
/// File with an aircraft's day, read whole.
const TRACE: FileKind = FileKind::new("trace_full of readsb", 256 << 20);
/// Positions further from the runway are not kept, metres.
const NEAR_M: f64 = 150_000.0;
/// Times above this are milliseconds since 1970.
const MILLISECONDS: f64 = 1e11;

/// Receiver's report.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fix {
    pub(super) time_s: f64,
    pub(super) latitude_deg: f64,
    pub(super) longitude_deg: f64,
    /// Altitude above any datum: it is tied to the runway later.
    pub(super) altitude_m: Option<f64>,
    pub(super) ground_speed_mps: Option<f64>,
    pub(super) track_deg: Option<f64>,
    pub(super) on_ground: bool,
    pub(super) attitude: Option<Attitude>,
    /// True for a simulator's fix: position and altitude above mean sea level are exact.
    pub(super) is_simulated: bool,
}

impl Fix {
    pub(super) fn place(&self) -> LatLon {
        LatLon {
            latitude_deg: self.latitude_deg,
            longitude_deg: self.longitude_deg,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Attitude {
    pub(super) pitch_deg: f64,
    pub(super) roll_deg: f64,
    pub(super) heading_true_deg: Option<f64>,
}

/// An aircraft's fixes in order of time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Track {
    pub(super) aircraft: Option<String>,
    pub(super) fixes: Vec<Fix>,
}

/// Reads a file; a CSV may hold a continent's traffic, so only fixes near the runway are kept.
pub(super) fn read(path: &Path, runway: &Runway) -> dataset::Result<Vec<Track>> {
    let broken = |why: String| dataset::Error::corpus(path, why);
    let mut file = BufReader::new(outside_file::open(path, TRACKS)?);
    let head = file.fill_buf().map_err(|error| broken(error.to_string()))?;
    let first = head.iter().find(|byte| !byte.is_ascii_whitespace());
    let target = runway.touchdown_target().lat_lon();
    let mut tracks = if jet1090::is_one(head) {
        jet1090::read(file, target).map_err(broken)?
    } else if x_plane::is_data_txt(head) {
        x_plane::data_txt(file, target).map_err(broken)?
    } else if x_plane::is_fdr(head) {
        x_plane::fdr(file, target).map_err(broken)?
    } else if first == Some(&b'{') {
        let bytes = outside_file::read(path, TRACE)?;
        let trace = serde_json::from_slice(&bytes).map_err(|error| broken(error.to_string()))?;
        vec![trace_full(&trace).ok_or_else(|| {
            broken("no `timestamp` and `trace` as in trace_full of readsb".into())
        })?]
    } else {
        csv_tracks(path, file, runway)?
    };
    for track in &mut tracks {
        track.fixes.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        // Receivers repeat the last position until there is a new one.
        track.fixes.dedup_by(|next, before| {
            next.time_s <= before.time_s || next.place() == before.place()
        });
    }
    Ok(tracks)
}

/// Columns by meaning, with the factors to metres and seconds.
struct Columns {
    time: &'static str,
    latitude: &'static str,
    longitude: &'static str,
    altitude: &'static str,
    speed: &'static str,
    track: &'static str,
    altitude_m: f64,
    speed_mps: f64,
}

const KINDS: [Columns; 2] = [
    Columns {
        time: "timestamp",
        latitude: "latitude",
        longitude: "longitude",
        altitude: "altitude",
        speed: "groundspeed",
        track: "track",
        altitude_m: METERS_PER_FOOT,
        speed_mps: MPS_PER_KNOT,
    },
    Columns {
        time: "time",
        latitude: "lat",
        longitude: "lon",
        altitude: "baroaltitude",
        speed: "velocity",
        track: "heading",
        altitude_m: 1.0,
        speed_mps: 1.0,
    },
];

/// Fixes kept while a file is read.
#[derive(Default)]
struct NearFixes {
    fixes: Vec<Fix>,
    /// Nearest fix far from the runway, and its distance, metres.
    nearest: Option<(f64, Fix)>,
}

impl NearFixes {
    fn add(&mut self, fix: Fix, target: LatLon) {
        // Receivers repeat the last position until there is a new one.
        let is_repeated = self
            .fixes
            .last()
            .is_some_and(|last| last.time_s <= fix.time_s && last.place() == fix.place());
        if is_repeated {
            return;
        }
        let far_m = target.distance_m(fix.place());
        if far_m < NEAR_M {
            self.fixes.push(fix);
        } else if self.nearest.is_none_or(|(nearest_m, _)| far_m < nearest_m) {
            self.nearest = Some((far_m, fix));
        }
    }

    /// An aircraft that was never near has only its nearest position, for the message.
    fn fixes(self) -> Vec<Fix> {
        match self.nearest {
            Some((_, fix)) if self.fixes.is_empty() => vec![fix],
            _ => self.fixes,
        }
    }
}

fn csv_tracks<R: Read>(path: &Path, file: R, runway: &Runway) -> dataset::Result<Vec<Track>> {
    let broken = |why: String| dataset::Error::corpus(path, why);
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(file);
    let header = reader
        .headers()
        .map_err(|error| broken(error.to_string()))?
        .clone();
    let place = |name: &str| header.iter().position(|found| found == name);
    let needed = |kind: &Columns| [kind.time, kind.latitude, kind.longitude, kind.altitude];
    let kind = KINDS
        .iter()
        .find(|kind| needed(kind).iter().all(|name| place(name).is_some()));
    let Some(kind) = kind else {
        let missing = needed(&KINDS[0])
            .into_iter()
            .filter(|name| place(name).is_none());
        return Err(broken(format!(
            "no column for {}; its columns are {}. Expected the columns of traffic (timestamp, latitude, longitude, altitude), of OpenSky \
             (time, lat, lon, baroaltitude), trace_full of readsb, JSON lines of jet1090, or X-Plane's Data.txt or .fdr",
            missing.collect::<Vec<_>>().join(", "),
            header.iter().collect::<Vec<_>>().join(", ")
        )));
    };
    let [time, latitude, longitude, altitude] =
        needed(kind).map(|name| place(name).unwrap_or_default());
    let [speed, track, ground, aircraft] =
        [kind.speed, kind.track, "onground", "icao24"].map(place);
    let position_time = place("last_position").or_else(|| place("lastposupdate"));
    let target = runway.touchdown_target().lat_lon();
    let mut tracks: BTreeMap<String, NearFixes> = BTreeMap::new();
    for record in reader.records() {
        let record = record.map_err(|error| broken(error.to_string()))?;
        let line = record.position().map_or(0, csv::Position::line);
        let number = |at: usize, what: &str| match record.get(at).unwrap_or_default() {
            "" => Ok(None),
            text => match text.parse::<f64>() {
                Ok(number) if number.is_finite() => Ok(Some(number)),
                Ok(_) => Ok(None),
                Err(_) => Err(broken(format!(
                    "line {line}: {what} is {text:?}; expected a number"
                ))),
            },
        };
        let optional = |at: Option<usize>, what: &str| at.map_or(Ok(None), |at| number(at, what));
        let seconds = |at: usize, what: &str| match date_s(record.get(at).unwrap_or_default()) {
            Some(date_s) => Ok(Some(date_s)),
            None => number(at, what),
        };
        let stated_s = seconds(time, kind.time)?;
        let name = aircraft.and_then(|at| record.get(at)).unwrap_or_default();
        // An aircraft without any position is counted as well.
        let kept = tracks.entry(name.to_owned()).or_default();
        let valid_s =
            position_time.map_or(Ok(None), |at| seconds(at, "the time of the position"))?;
        let (Some(time_s), Some(latitude_deg), Some(longitude_deg)) = (
            valid_s.or(stated_s),
            number(latitude, kind.latitude)?,
            number(longitude, kind.longitude)?,
        ) else {
            continue;
        };
        let on_ground = ground.and_then(|at| record.get(at)).unwrap_or_default();
        let fix = Fix {
            time_s: if time_s > MILLISECONDS {
                time_s / 1e3
            } else {
                time_s
            },
            latitude_deg,
            longitude_deg,
            altitude_m: number(altitude, kind.altitude)?.map(|value| value * kind.altitude_m),
            ground_speed_mps: optional(speed, kind.speed)?.map(|value| value * kind.speed_mps),
            track_deg: optional(track, kind.track)?,
            on_ground: matches!(
                on_ground.to_ascii_lowercase().as_str(),
                "true" | "1" | "1.0" | "t"
            ),
            attitude: None,
            is_simulated: false,
        };
        kept.add(fix, target);
    }
    Ok(tracks_of(tracks))
}

fn tracks_of(kept: BTreeMap<String, NearFixes>) -> Vec<Track> {
    let track = |(name, kept): (String, NearFixes)| Track {
        aircraft: (!name.is_empty()).then_some(name),
        fixes: kept.fixes(),
    };
    kept.into_iter().map(track).collect()
}

/// Parses a date such as `2021-10-07 13:35:44+00:00` to seconds since 1970; without a zone it is UTC.
fn date_s(text: &str) -> Option<f64> {
    let has_date = text.len() > 10 && text.as_bytes().get(4) == Some(&b'-');
    let text = has_date.then(|| text.replacen(' ', "T", 1))?;
    let date = DateTime::parse_from_rfc3339(&text)
        .or_else(|_| DateTime::parse_from_rfc3339(&format!("{text}Z")))
        .ok()?;
    Some(date.timestamp_micros() as f64 / 1e6)
}

/// An aircraft's day: rows of seconds, latitude, longitude, altitude in feet or "ground", knots, track.
fn trace_full(trace: &Value) -> Option<Track> {
    let start_s = trace.get("timestamp")?.as_f64()?;
    let rows = trace.get("trace")?.as_array()?;
    let fix = |row: &Value| {
        let number = |at: usize| row.get(at).and_then(Value::as_f64);
        Some(Fix {
            time_s: start_s + number(0)?,
            latitude_deg: number(1)?,
            longitude_deg: number(2)?,
            altitude_m: number(3).map(|feet| feet * METERS_PER_FOOT),
            ground_speed_mps: number(4).map(|knots| knots * MPS_PER_KNOT),
            track_deg: number(5),
            on_ground: row.get(3).and_then(Value::as_str) == Some("ground"),
            attitude: None,
            is_simulated: false,
        })
    };
    Some(Track {
        aircraft: trace.get("icao").and_then(Value::as_str).map(str::to_owned),
        fixes: rows.iter().filter_map(fix).collect(),
    })
}
