//! Recorded flights: CSV files with one row per state.
//!
//! Columns (by name, in any order): `t_s, latitude_deg, longitude_deg, altitude_msl_m, pitch_deg, roll_deg, heading_true_deg,
//! tas_mps, v_north_mps, v_east_mps, v_down_mps, flap_norm, gear_norm, on_ground`.

mod files;
mod plausibility;
mod survey;
mod table;

use std::io::{BufReader, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use dataset::files::outside_file::{self, FileKind};
use dataset::geometry::pose::FlightState;
use dataset::geometry::runway::Runway;
use dataset::numbers::limits::FieldOutOfLimits;

pub(crate) use files::matching_files;
use plausibility::ApproachPath;
pub use plausibility::{Allowed, Implausible};
pub(crate) use plausibility::{CORRIDOR_M, GO_AROUND_M, GRAVITY_MPS2};
pub(crate) use survey::AFTER_TARGET_S;
use survey::Survey;
use table::{HEAD_BYTES, Rows};

use crate::trajectory::{BadFlight, Trajectory};

/// Reasons why there are no recordings, or why one cannot be flown. Every message names the file or the pattern.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// There is no usable file, or a line that is none of a recording.
    #[error("{0}")]
    Unusable(String),
    /// The file cannot be read.
    #[error(transparent)]
    Unreadable(#[from] dataset::Error),
    /// The states are not a flight, or not an approach to the sweep's runway.
    #[error(
        "{}{} {fault}",
        path.display(),
        line.map_or_else(String::new, |line| format!(":{line}:"))
    )]
    Flight {
        /// The file.
        path: PathBuf,
        /// The line of the state that is at fault, if it is one.
        line: Option<u64>,
        /// Fault of the flight.
        fault: BadFlight,
    },
    /// A number that no airliner has, in the approach.
    #[error("{}:{line}: {fault}", path.display())]
    OutOfLimits {
        /// The file.
        path: PathBuf,
        /// The line.
        line: u64,
        /// Column, value and range.
        fault: FieldOutOfLimits,
    },
    /// The columns contradict each other, or the flight does not land on the runway.
    #[error("{} {fault}", path.display())]
    Implausible {
        /// The file.
        path: PathBuf,
        /// The contradiction.
        fault: Implausible,
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

impl Recording {
    /// Reads a recording and cuts its approach to a runway out: the last one, from `longest_dtd_m` on. Faults outside it do not matter.
    ///
    /// # Errors
    /// Name the file and, where there is one, the line.
    pub fn read(
        path: &Path,
        runway: &Runway,
        longest_dtd_m: f64,
        allow: &[Allowed],
    ) -> Result<Self, RecordingError> {
        let file = outside_file::open(path, FileKind::RECORDING)?;
        let implausible = |fault| RecordingError::Implausible {
            path: path.to_owned(),
            fault,
        };
        let no_flight = |line, fault| RecordingError::Flight {
            path: path.to_owned(),
            line,
            fault,
        };
        let survey = Survey::of(path, &file, runway, longest_dtd_m)?;
        if let Some(fault) = survey.rolls_in_the_air() {
            return Err(implausible(fault));
        }
        let again = || {
            (&file).rewind().map_err(dataset::Error::io("read", path))?;
            Rows::new(path, BufReader::with_capacity(HEAD_BYTES, &file))
        };
        let Some(found) = survey.approach() else {
            let states = again()?.filter_map(|row| Some(row.ok()?.state));
            return Err(match plausibility::elsewhere(states, runway) {
                Some(fault) => implausible(fault),
                None => no_flight(None, survey.never_there(runway, longest_dtd_m)),
            });
        };
        let (rows, inbound) = survey::rows_of(again()?, found)?;
        let line_of = |index: usize| rows.get(index).map(|row| row.line);
        if let Some((line, fault)) = rows
            .iter()
            .find_map(|row| Some((row.line, row.fault.clone()?)))
        {
            return Err(RecordingError::OutOfLimits {
                path: path.to_owned(),
                line,
                fault,
            });
        }
        let states: Vec<FlightState> = rows.iter().map(|row| row.state).collect();
        let path_flown = ApproachPath::new(&states, runway, inbound);
        let has_attitude = rows.iter().any(|row| !row.has_derived_attitude);
        path_flown.units(has_attitude).map_err(implausible)?;
        let trajectory = Trajectory::new(states.clone())
            .map_err(|fault| no_flight(fault.state().and_then(line_of), fault))?;
        trajectory
            .approach(runway, longest_dtd_m)
            .map_err(|fault| no_flight(None, fault))?;
        path_flown.path(allow).map_err(implausible)?;
        Ok(Self {
            file: path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            blake3: survey.blake3,
            trajectory: Arc::new(trajectory),
        })
    }

    /// Identifier of the trajectory: file name and start of the hash, because two folders may contain files with the same name.
    pub(crate) fn trajectory_id(&self) -> String {
        let stem = self
            .file
            .rsplit_once('.')
            .map_or(self.file.as_str(), |(stem, _)| stem);
        format!("recorded-{stem}-{}", &self.blake3[..8])
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

    fn read(path: &Path) -> Result<Recording, String> {
        let runway = crate::airports::bundled("WSSS", "02L").unwrap();
        Recording::read(path, &runway, 18_520.0, &[]).map_err(|error| error.to_string())
    }

    #[test]
    fn a_recording_is_read_and_named_by_file_and_content() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("calm.csv");
        write_example(&path, 1_000.0);
        let recording = read(&path).unwrap();
        assert_eq!(recording.file, "calm.csv");
        assert!(recording.trajectory_id().starts_with("recorded-calm-"));
        assert!(recording.trajectory.touchdown().is_some());
    }

    #[test]
    fn a_field_that_is_no_number_is_reported_with_line_column_and_form() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bad.csv");
        let sound = "0,1.3,103.9,700,2,0,23,75,69,29,4,0.5,1,0";
        for (at, value, words) in [
            (
                3,
                "high",
                r#"bad.csv:2: altitude_msl_m is "high"; expected a number, such as 2.5"#,
            ),
            (
                3,
                "",
                r#"altitude_msl_m is ""; expected a number in every row"#,
            ),
            (0, "12:30:05", "expected seconds since any moment"),
            (13, "2", r#"on_ground is "2"; expected 0, 1, false or true"#),
        ] {
            let mut fields: Vec<&str> = sound.split(',').collect();
            fields[at] = value;
            fs::write(&path, format!("{HEADER}\n{}\n", fields.join(","))).unwrap();
            let message = read(&path).unwrap_err();
            assert!(message.contains(words), "{message}");
        }
        fs::write(&path, "t_s;latitude_deg\n0;1\n").unwrap();
        let message = read(&path).unwrap_err();
        for part in [
            "no column longitude_deg, altitude_msl_m",
            "a semicolon",
            "names t_s, latitude_deg",
        ] {
            assert!(message.contains(part), "{message}");
        }
    }

    #[test]
    fn a_number_that_no_airliner_has_is_refused_with_line_column_and_range() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("odd.csv");
        write_example(&path, 1_000.0);
        let good = fs::read_to_string(&path).unwrap();
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
        ] {
            let mut lines: Vec<String> = good.lines().map(str::to_owned).collect();
            let mut fields: Vec<&str> = lines[2].split(',').collect();
            fields[at] = value;
            let odd = fields.join(",");
            lines[2] = odd;
            fs::write(&path, lines.join("\n")).unwrap();
            let message = read(&path).unwrap_err();
            let expected = format!("odd.csv:3: {words}");
            assert!(message.contains(&expected), "{message}");
        }
    }
}
