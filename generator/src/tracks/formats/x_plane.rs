//! `Data.txt`, X-Plane's data output to disk, with the simulator's exact states. It has columns between bars; a line with their names
//! begins it, and follows each change of the columns.

use std::io::BufRead;

use dataset::geometry::geodesy::LatLon;
use dataset::numbers::units::{METERS_PER_FOOT, MPS_PER_KNOT};

use super::{Attitude, Fix, NearFixes, Track};

/// Rows that follow sooner than this are left out, seconds.
const STEP_S: f64 = 0.2;
/// Step back in time that begins a new flight, seconds.
const JUMPS_BACK_S: f64 = 1.0;
/// An aircraft whose wheels are lower is on the ground, feet.
const ON_GROUND_FT: f64 = 1.0;

/// Names of columns in `Data.txt`, without underscores at their beginning; the first that is there counts. `p-alt` is above a pressure.
const TIMES: [&str; 3] = ["totl,_time", "missn,_time", "real,_time"];
const LATITUDE: &str = "lat,__deg";
const LONGITUDE: &str = "lon,__deg";
const TRUE_ALTITUDES: [&str; 2] = ["CG,ftMSL", "alt,ftmsl"];
const PRESSURE_ALTITUDE: &str = "p-alt,ftMSL";
const ABOVE_GROUND: &str = "alt,ftagl";
const GROUND_SPEED: &str = "Vtrue,_ktgs";
const TRACKS: [&str; 2] = ["hpath,_true", "hpath,__deg"];
const PITCH: &str = "pitch,__deg";
const ROLL: &str = "roll,__deg";
const HEADING: &str = "hding,_true";

/// Names of columns, without the underscores that fill them up on the left.
fn names(line: &str) -> Vec<&str> {
    let fields = line.trim().trim_end_matches('|').split('|');
    fields
        .map(|field| field.trim().trim_start_matches('_'))
        .collect()
}

/// True if a file begins with names of columns between bars.
pub(super) fn is_data_txt(head: &[u8]) -> bool {
    let lines = head.split(|byte| *byte == b'\n');
    let mut texts = lines.map(|line| std::str::from_utf8(line).unwrap_or_default());
    let first = texts.find(|line| !line.trim().is_empty());
    first.is_some_and(|first| first.contains('|') && first.contains(",_"))
}

/// Columns of `Data.txt`.
struct Columns {
    time: usize,
    latitude: usize,
    longitude: usize,
    altitude: usize,
    is_true_altitude: bool,
    above_ground: Option<usize>,
    ground_speed: Option<usize>,
    track: Option<usize>,
    attitude: Option<[usize; 3]>,
}

impl Columns {
    fn of(line: &str) -> Result<Self, String> {
        let found = names(line);
        let place = |name: &str| found.iter().position(|found| *found == name);
        let any = |names: &[&str]| names.iter().find_map(|name| place(name));
        let needed = |column: Option<usize>, what: &str| {
            column.ok_or_else(|| {
                format!(
                    "no column for {what}; its columns are {}. Select `times` and `latitude, longitude, & altitude` in X-Plane's data output",
                    found.join(", ")
                )
            })
        };
        let true_altitude = any(&TRUE_ALTITUDES);
        Ok(Self {
            time: needed(any(&TIMES), "the time")?,
            latitude: needed(place(LATITUDE), "the latitude")?,
            longitude: needed(place(LONGITUDE), "the longitude")?,
            altitude: needed(
                true_altitude.or_else(|| place(PRESSURE_ALTITUDE)),
                "the altitude",
            )?,
            is_true_altitude: true_altitude.is_some(),
            above_ground: place(ABOVE_GROUND),
            ground_speed: place(GROUND_SPEED),
            track: any(&TRACKS),
            attitude: place(PITCH)
                .zip(place(ROLL))
                .zip(place(HEADING))
                .map(|((pitch, roll), heading)| [pitch, roll, heading]),
        })
    }
}

/// The flights in a `Data.txt`; the error is a line and the reason.
pub(super) fn data_txt<R: BufRead>(file: R, target: LatLon) -> Result<Vec<Track>, String> {
    let mut columns: Option<Columns> = None;
    let mut rows = Rows::new(target);
    for (index, line) in file.lines().enumerate() {
        let bad = |why: String| format!("line {}: {why}", index + 1);
        let line = line.map_err(|error| bad(error.to_string()))?;
        if line.trim().is_empty() {
            continue;
        }
        if line.contains(",_") {
            columns = Some(Columns::of(&line).map_err(bad)?);
            continue;
        }
        let Some(columns) = &columns else {
            return Err(bad("numbers without names of columns before them".into()));
        };
        let fields: Vec<&str> = line.split('|').map(str::trim).collect();
        let number = |at: usize| number(&fields, at).map_err(bad);
        let optional = |at: Option<usize>| at.map(number).transpose();
        let above_ground_ft = optional(columns.above_ground)?;
        let attitude = match columns.attitude {
            Some([pitch, roll, heading]) => Some(Attitude {
                pitch_deg: number(pitch)?,
                roll_deg: number(roll)?,
                heading_true_deg: Some(number(heading)?),
            }),
            None => None,
        };
        rows.add(Fix {
            time_s: number(columns.time)?,
            latitude_deg: number(columns.latitude)?,
            longitude_deg: number(columns.longitude)?,
            altitude_m: Some(number(columns.altitude)? * METERS_PER_FOOT),
            ground_speed_mps: optional(columns.ground_speed)?.map(|knots| knots * MPS_PER_KNOT),
            track_deg: optional(columns.track)?,
            on_ground: above_ground_ft.is_some_and(|feet| feet < ON_GROUND_FT),
            attitude,
            is_simulated: columns.is_true_altitude,
            ..Fix::default()
        });
    }
    Ok(rows.tracks())
}

/// Rows, thinned out.
struct Rows {
    /// Flights before this one.
    ended: Vec<NearFixes>,
    kept: NearFixes,
    target: LatLon,
    last_s: f64,
}

impl Rows {
    fn new(target: LatLon) -> Self {
        Self {
            ended: Vec::new(),
            kept: NearFixes::default(),
            target,
            last_s: f64::NEG_INFINITY,
        }
    }

    fn add(&mut self, fix: Fix) {
        if fix.time_s < self.last_s - JUMPS_BACK_S {
            // A new flight in the same file.
            self.ended.push(std::mem::take(&mut self.kept));
        } else if fix.time_s < self.last_s + STEP_S {
            return;
        }
        self.last_s = fix.time_s;
        self.kept.add(fix, self.target);
    }

    fn tracks(mut self) -> Vec<Track> {
        self.ended.push(self.kept);
        let count = self.ended.len();
        let track = |(index, kept): (usize, NearFixes)| Track {
            aircraft: (count > 1).then(|| format!("flight-{}", index + 1)),
            fixes: kept.fixes(),
            coarse: 0,
        };
        self.ended.into_iter().enumerate().map(track).collect()
    }
}

fn number(fields: &[&str], at: usize) -> Result<f64, String> {
    let text = fields.get(at).copied().unwrap_or_default();
    let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
    number.ok_or_else(|| format!("field {} is {text:?}; expected a number", at + 1))
}
