//! A recording in little memory: its hash, and the rows of the approach. A file may hold the hours before it.

use std::fs::File;
use std::io::{BufReader, Seek};
use std::path::Path;

use dataset::geometry::pose::FlightState;
use dataset::geometry::runway::Runway;

use super::RecordingError;
use super::plausibility::{self, Implausible};
use super::table::{HEAD_BYTES, Row, Rows};
use crate::trajectory::{Approaches, BadFlight, Inbound, MAX_GAP_S};

/// Time kept after the touchdown target, seconds: the landing roll, for the point of touchdown.
pub(crate) const AFTER_TARGET_S: f64 = 60.0;
/// Minimum speed, m/s, and height above the runway, metres, in flight: other airports of the recording may be as high.
const FLYING: (f64, f64) = (60.0, 100.0);

/// Findings from one pass over all rows.
pub(super) struct Survey {
    pub(super) blake3: String,
    approaches: Approaches,
    rows: usize,
    on_ground: usize,
    flying: usize,
    flying_on_ground: usize,
    /// Remaining distances of the first and the last row, metres.
    ends_m: Option<[f64; 2]>,
}

impl Survey {
    /// Reads `file`, which is at `path`, to its end.
    pub(super) fn of(
        path: &Path,
        file: &File,
        runway: &Runway,
        longest_dtd_m: f64,
    ) -> Result<Self, RecordingError> {
        let mut hasher = blake3::Hasher::new();
        let hashed = hasher
            .update_reader(file)
            .and_then(|_| (&mut &*file).rewind());
        hashed.map_err(dataset::Error::io("read", path))?;
        let target = runway.touchdown_target();
        let mut survey = Self {
            blake3: hasher.finalize().to_string(),
            approaches: Approaches::new(longest_dtd_m),
            rows: 0,
            on_ground: 0,
            flying: 0,
            flying_on_ground: 0,
            ends_m: None,
        };
        for row in Rows::new(path, BufReader::with_capacity(HEAD_BYTES, file))? {
            let state = row?.state;
            let to_go_m = plausibility::place(&state, target, runway).along_track_m;
            let speed_mps = state.velocity_north_mps.hypot(state.velocity_east_mps);
            let height_m = state.pose.altitude_msl_m - target.altitude_msl_m;
            let is_flying = speed_mps > FLYING.0 && height_m > FLYING.1;
            survey.approaches.add(to_go_m, !state.on_ground);
            survey.rows += 1;
            survey.on_ground += usize::from(state.on_ground);
            survey.flying += usize::from(is_flying);
            survey.flying_on_ground += usize::from(is_flying && state.on_ground);
            survey.ends_m.get_or_insert([to_go_m; 2])[1] = to_go_m;
        }
        Ok(survey)
    }

    /// A contradiction if all rows are on the ground, or most of those that cannot be there.
    pub(super) fn rolls_in_the_air(&self) -> Option<Implausible> {
        let why = if self.rows > 0 && self.on_ground == self.rows {
            "on_ground is true in every row".into()
        } else if 2 * self.flying_on_ground > self.flying {
            format!(
                "on_ground is true in {} of {} rows that are faster than {} m/s and more than {} m above the runway",
                self.flying_on_ground, self.flying, FLYING.0, FLYING.1
            )
        } else {
            return None;
        };
        Some(Implausible::Contradiction {
            why,
            expected: "a flight that lands",
        })
    }

    pub(super) fn approach(&self) -> Option<Inbound> {
        self.approaches.last()
    }

    /// Why there is no approach.
    pub(super) fn never_there(&self, runway: &Runway, start_dtd_m: f64) -> BadFlight {
        let [first_m, last_m] = self.ends_m.unwrap_or([f64::NAN; 2]);
        if self.rows < 2 {
            return BadFlight::TooFewStates { states: self.rows };
        }
        BadFlight::Elsewhere {
            start_dtd_m,
            runway: format!("{} {}", runway.airport, runway.name),
            first_m,
            last_m,
        }
    }
}

/// The rows that an approach needs, and the approach within them: a state before its beginning, so that the beginning can be
/// interpolated, and what follows the target.
pub(super) fn rows_of(
    rows: impl Iterator<Item = Result<Row, RecordingError>>,
    found: Inbound,
) -> Result<(Vec<Row>, Inbound), RecordingError> {
    let mut from = found.first.saturating_sub(1);
    let mut kept: Vec<Row> = Vec::new();
    let mut last_s = f64::INFINITY;
    for (index, row) in rows.enumerate().skip(from) {
        let row = row?;
        if found.passing == Some(index) {
            last_s = row.state.time_s + AFTER_TARGET_S;
        }
        if row.state.time_s > last_s {
            break;
        }
        kept.push(row);
    }
    let step_s = |states: [&FlightState; 2]| states[1].time_s - states[0].time_s;
    if let [before, first, ..] = &kept[..]
        && from < found.first
        && step_s([&before.state, &first.state]) > MAX_GAP_S
    {
        kept.remove(0);
        from += 1;
    }
    let inbound = Inbound {
        first: found.first - from,
        passing: found.passing.map(|passing| passing - from),
    };
    Ok((kept, inbound))
}
