//! Recorded flights: CSV files with one row per state.
//!
//! Columns (by name, in any order): `t_s, latitude_deg, longitude_deg, altitude_msl_m, pitch_deg, roll_deg, heading_true_deg,
//! tas_mps, v_north_mps, v_east_mps, v_down_mps, flap_norm, gear_norm, on_ground`.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use dataset::files::outside_file::{self, FileKind};
use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::numbers::limits::{self, Check, FieldOutOfLimits};
use glob::Pattern;
use serde::Deserialize;

use crate::trajectory::{BadFlight, Trajectory};

/// Reasons why there are no recordings, or why one cannot be flown. Every message names the file or the pattern.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The folder of the sweep has a name that a pattern cannot contain.
    #[error("the folder {} is not UTF-8", folder.display())]
    FolderNotText {
        /// The folder.
        folder: PathBuf,
    },
    /// The pattern has no meaning.
    #[error("{pattern:?} is not a valid glob: {cause}")]
    BadPattern {
        /// The pattern.
        pattern: String,
        /// Cause.
        cause: glob::PatternError,
    },
    /// A folder cannot be searched.
    #[error("cannot list {}: {cause}", folder.display())]
    Unlistable {
        /// The folder.
        folder: PathBuf,
        /// Cause.
        cause: io::Error,
    },
    /// No file matches the pattern.
    #[error("no file matches {}; expected at least one recording", pattern.display())]
    NoMatch {
        /// The pattern in its folder.
        pattern: PathBuf,
    },
    /// The file cannot be read.
    #[error(transparent)]
    Unreadable(#[from] dataset::Error),
    /// The file is not a table of flight states.
    #[error("{}: {cause}", path.display())]
    NotATable {
        /// The file.
        path: PathBuf,
        /// Line and reason.
        cause: csv::Error,
    },
    /// A number that no airliner has.
    #[error("{}:{line}: {fault}", path.display())]
    OutOfLimits {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: u64,
        /// Column, value and range.
        fault: FieldOutOfLimits,
    },
    /// The states are not a flight, or not an approach to the sweep's runway.
    #[error("{} {fault}", path.display())]
    Flight {
        /// The file.
        path: PathBuf,
        /// Fault of the flight.
        fault: BadFlight,
    },
}

/// A recorded flight, read and checked.
#[derive(Debug, Clone)]
pub struct Recording {
    /// File name without folders.
    pub file: String,
    /// BLAKE3 hash of the file.
    pub blake3: String,
    /// The flown path.
    pub trajectory: Arc<Trajectory>,
}

#[derive(Debug, Deserialize)]
struct Row {
    t_s: f64,
    latitude_deg: f64,
    longitude_deg: f64,
    altitude_msl_m: f64,
    pitch_deg: f64,
    roll_deg: f64,
    heading_true_deg: f64,
    tas_mps: f64,
    v_north_mps: f64,
    v_east_mps: f64,
    v_down_mps: f64,
    flap_norm: f64,
    gear_norm: f64,
    on_ground: u8,
}

impl Row {
    /// The first number that is impossible for an airliner on approach.
    fn out_of_limits(&self) -> Option<FieldOutOfLimits> {
        let mut check = Check::default();
        for (column, value, limits) in [
            ("t_s", self.t_s, limits::FLIGHT_TIME_S),
            ("latitude_deg", self.latitude_deg, limits::LATITUDE_DEG),
            ("longitude_deg", self.longitude_deg, limits::LONGITUDE_DEG),
            (
                "altitude_msl_m",
                self.altitude_msl_m,
                limits::ALTITUDE_MSL_M,
            ),
            ("pitch_deg", self.pitch_deg, limits::PITCH_DEG),
            ("roll_deg", self.roll_deg, limits::ROLL_DEG),
            (
                "heading_true_deg",
                self.heading_true_deg,
                limits::HEADING_TRUE_DEG,
            ),
            ("tas_mps", self.tas_mps, limits::TRUE_AIRSPEED_MPS),
            ("v_north_mps", self.v_north_mps, limits::VELOCITY_MPS),
            ("v_east_mps", self.v_east_mps, limits::VELOCITY_MPS),
            ("v_down_mps", self.v_down_mps, limits::VELOCITY_DOWN_MPS),
            ("flap_norm", self.flap_norm, limits::RATIO),
            ("gear_norm", self.gear_norm, limits::RATIO),
        ] {
            check.number(column, value, limits);
        }
        check.first()
    }
}

impl From<Row> for FlightState {
    fn from(row: Row) -> Self {
        Self {
            time_s: row.t_s,
            pose: Pose {
                latitude_deg: row.latitude_deg,
                longitude_deg: row.longitude_deg,
                altitude_msl_m: row.altitude_msl_m,
                heading_true_deg: row.heading_true_deg,
                pitch_deg: row.pitch_deg,
                roll_deg: row.roll_deg,
            },
            velocity_north_mps: row.v_north_mps,
            velocity_east_mps: row.v_east_mps,
            velocity_down_mps: row.v_down_mps,
            true_airspeed_mps: row.tas_mps,
            controls: Controls {
                flap_ratio: row.flap_norm,
                gear_ratio: row.gear_norm,
            },
            on_ground: row.on_ground != 0,
        }
    }
}

impl Recording {
    /// Reads a recording; errors name the file and its line.
    pub fn read(path: &Path) -> Result<Self, RecordingError> {
        let bytes = outside_file::read(path, FileKind::RECORDING)?;
        let unreadable = |cause| RecordingError::NotATable {
            path: path.to_owned(),
            cause,
        };
        let mut reader = csv::Reader::from_reader(bytes.as_slice());
        let columns = reader.headers().cloned().map_err(unreadable)?;
        let mut states = Vec::new();
        for record in reader.records() {
            let record = record.map_err(unreadable)?;
            let row: Row = record.deserialize(Some(&columns)).map_err(unreadable)?;
            if let Some(fault) = row.out_of_limits() {
                let line = record.position().map_or(0, csv::Position::line);
                return Err(RecordingError::OutOfLimits {
                    path: path.to_owned(),
                    line,
                    fault,
                });
            }
            states.push(FlightState::from(row));
        }
        let trajectory = Trajectory::new(states).map_err(|fault| RecordingError::Flight {
            path: path.to_owned(),
            fault,
        })?;
        Ok(Self {
            file: path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            blake3: blake3::hash(&bytes).to_string(),
            trajectory: Arc::new(trajectory),
        })
    }

    /// Identifier of the trajectory: the file's name and the start of its hash, because two folders may contain files of one name.
    pub(crate) fn trajectory_id(&self) -> String {
        let stem = self
            .file
            .rsplit_once('.')
            .map_or(self.file.as_str(), |(stem, _)| stem);
        format!("recorded-{stem}-{}", &self.blake3[..8])
    }
}

/// The files that a glob matches, sorted; it is relative to `folder`. `*` and `?` match within a name, `**` across folders, `[..]`
/// one of several characters.
pub(crate) fn matching_files(folder: &Path, pattern: &str) -> Result<Vec<PathBuf>, RecordingError> {
    // The folder is not the author's choice: glob characters in it are literal.
    let whole = match folder.to_str() {
        Some("") => pattern.to_owned(),
        _ if Path::new(pattern).is_absolute() => pattern.to_owned(),
        Some(folder) => format!("{}/{pattern}", Pattern::escape(folder)),
        None => {
            return Err(RecordingError::FolderNotText {
                folder: folder.to_owned(),
            });
        }
    };
    let paths = glob::glob(&whole).map_err(|cause| RecordingError::BadPattern {
        pattern: pattern.to_owned(),
        cause,
    })?;
    let mut found = Vec::new();
    for path in paths {
        let path = path.map_err(|error| RecordingError::Unlistable {
            folder: error.path().to_owned(),
            cause: error.into(),
        })?;
        if path.is_file() {
            found.push(path);
        }
    }
    found.sort();
    if found.is_empty() {
        Err(RecordingError::NoMatch {
            pattern: folder.join(pattern),
        })
    } else {
        Ok(found)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::fs;

    use super::*;

    const HEADER: &str = "t_s,latitude_deg,longitude_deg,altitude_msl_m,pitch_deg,roll_deg,heading_true_deg,tas_mps,v_north_mps,v_east_mps,v_down_mps,flap_norm,gear_norm,on_ground";

    /// Writes a flight down the glide path of WSSS 02L as a recording, 2 Hz.
    pub(crate) fn write_example(path: &Path, from_m: f64) {
        let flown = crate::trajectory::tests::flight(from_m, 2.0);
        let mut text = HEADER.to_owned();
        let mut time_s = 0.0;
        while time_s < from_m / 75.0 + 4.0 {
            let s = flown.at(time_s);
            let p = s.pose;
            text += &format!(
                "\n{time_s},{},{},{},{},{},{},{},{},{},{},{},{},{}",
                p.latitude_deg,
                p.longitude_deg,
                p.altitude_msl_m,
                p.pitch_deg,
                p.roll_deg,
                p.heading_true_deg,
                s.true_airspeed_mps,
                s.velocity_north_mps,
                s.velocity_east_mps,
                s.velocity_down_mps,
                s.controls.flap_ratio,
                s.controls.gear_ratio,
                u8::from(s.on_ground)
            );
            time_s += 0.5;
        }
        fs::write(path, text).unwrap();
    }

    #[test]
    fn a_recording_is_read_and_named_by_file_and_content() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("calm.csv");
        write_example(&path, 1_000.0);
        let recording = Recording::read(&path).unwrap();
        assert_eq!(recording.file, "calm.csv");
        assert!(recording.trajectory_id().starts_with("recorded-calm-"));
        assert!(recording.trajectory.touchdown().is_some());
    }

    #[test]
    fn a_bad_row_is_reported_with_file_and_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bad.csv");
        fs::write(
            &path,
            format!("{HEADER}\n0,1,104,high,0,0,0,0,0,0,0,0,0,0\n"),
        )
        .unwrap();
        let message = Recording::read(&path).unwrap_err().to_string();
        assert!(
            message.contains("bad.csv") && message.contains("line: 2"),
            "{message}"
        );
        fs::write(&path, "t_s,latitude_deg\n0,1\n").unwrap();
        assert!(
            Recording::read(&path)
                .unwrap_err()
                .to_string()
                .contains("missing field")
        );
    }

    #[test]
    fn a_number_that_no_airliner_has_is_refused_with_line_column_and_range() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("odd.csv");
        let sound = "0,1.3,103.9,700,2,0,23,75,69,29,4,0.5,1,0";
        for (at, value, words) in [
            (
                4,
                "1e17",
                "pitch_deg 1e17 is out of range; expected an aircraft's pitch in degrees from -45 to 45",
            ),
            (5, "179", "roll_deg 179 is out of range"),
            (7, "1e308", "tas_mps 1e308 is out of range"),
            (7, "inf", "tas_mps inf is out of range"),
            (
                12,
                "-5",
                "gear_norm -5 is out of range; expected a ratio from 0 to 1",
            ),
            (1, "NaN", "latitude_deg NaN is out of range"),
        ] {
            let mut fields: Vec<&str> = sound.split(',').collect();
            fields[at] = value;
            let odd = fields.join(",");
            fs::write(&path, format!("{HEADER}\n{sound}\n{odd}\n")).unwrap();
            let message = Recording::read(&path).unwrap_err().to_string();
            let expected = format!("odd.csv:3: {words}");
            assert!(message.contains(&expected), "{message}");
        }
    }

    #[test]
    fn globs_find_files_in_order_and_through_folders() {
        let outer = tempfile::tempdir().unwrap();
        // A folder whose own name looks like a glob.
        let folder = outer.path().join("flights [old]");
        fs::create_dir_all(folder.join("more")).unwrap();
        for name in ["b.csv", "a.csv", "a.txt", "more/c.csv"] {
            fs::write(folder.join(name), "").unwrap();
        }
        let names = |pattern: &str| {
            let found = matching_files(&folder, pattern).map_err(|error| error.to_string());
            found.map(|files| {
                let names = files.iter().map(|file| file.strip_prefix(&folder).unwrap());
                names.map(|n| n.display().to_string()).collect::<Vec<_>>()
            })
        };
        assert_eq!(names("*.csv").unwrap(), ["a.csv", "b.csv"]);
        assert_eq!(names("[b-z].csv").unwrap(), ["b.csv"]);
        assert_eq!(names("**/*.csv").unwrap(), ["a.csv", "b.csv", "more/c.csv"]);
        assert_eq!(names("a.csv").unwrap(), ["a.csv"]);
        assert!(names("x*.csv").unwrap_err().contains("no file matches"));
        assert!(names("more").unwrap_err().contains("no file matches"));
        assert!(
            names("a**.csv")
                .unwrap_err()
                .contains("is not a valid glob")
        );
    }
}
