//! Recorded flights: CSV files with a row per state.
//!
//! Columns (by name, in any order): `t_s, latitude_deg, longitude_deg, altitude_msl_m, pitch_deg, roll_deg, heading_true_deg,
//! tas_mps, v_north_mps, v_east_mps, v_down_mps, flap_norm, gear_norm, on_ground`.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use dataset::pose::{Controls, FlightState, Pose};
use serde::Deserialize;

use crate::trajectory::Trajectory;

/// A recorded flight that was read and checked.
#[derive(Debug, Clone)]
pub struct Recording {
    /// File name without folders.
    pub file: String,
    /// BLAKE3 hash of the file.
    pub blake3: String,
    /// What was flown.
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
    /// Reads a recording; says in words, with the file and its line, why it cannot.
    pub fn read(path: &Path) -> Result<Self, String> {
        let bytes = fs::read(path).map_err(|e| format!("cannot read {}: {e}", path.display()))?;
        let mut reader = csv::Reader::from_reader(bytes.as_slice());
        let states = reader
            .deserialize::<Row>()
            .map(|row| row.map(FlightState::from))
            .collect::<Result<Vec<_>, _>>()
            .map_err(|e| format!("{}: {e}", path.display()))?;
        let trajectory = Trajectory::new(states).map_err(|e| format!("{} {e}", path.display()))?;
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

    /// Identifier of the trajectory: the file's name and the start of its hash, for two folders may hold files of one name.
    pub fn trajectory_id(&self) -> String {
        let stem = self
            .file
            .rsplit_once('.')
            .map_or(self.file.as_str(), |(stem, _)| stem);
        format!("recorded-{stem}-{}", &self.blake3[..8])
    }
}

/// The files that a path matches, sorted; `*` in the file name stands for any characters.
pub fn matching_files(pattern: &Path) -> Result<Vec<PathBuf>, String> {
    let name = pattern
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    if !name.contains('*') {
        return Ok(vec![pattern.to_owned()]);
    }
    let folder = match pattern.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let entries =
        fs::read_dir(folder).map_err(|e| format!("cannot list {}: {e}", folder.display()))?;
    let mut found = Vec::new();
    for entry in entries {
        let path = entry
            .map_err(|e| format!("cannot list {}: {e}", folder.display()))?
            .path();
        let matches = path
            .file_name()
            .is_some_and(|file| matches(&name, &file.to_string_lossy()));
        if matches && path.is_file() {
            found.push(path);
        }
    }
    found.sort();
    if found.is_empty() {
        Err(format!("no file matches {}", pattern.display()))
    } else {
        Ok(found)
    }
}

fn matches(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((head, rest)) => name.strip_prefix(head).is_some_and(|tail| {
            tail.char_indices()
                .map(|(i, _)| i)
                .chain([tail.len()])
                .any(|i| matches(rest, &tail[i..]))
        }),
    }
}

#[cfg(test)]
pub(crate) mod tests {
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
        let message = Recording::read(&path).unwrap_err();
        assert!(
            message.contains("bad.csv") && message.contains("line: 2"),
            "{message}"
        );
        fs::write(&path, "t_s,latitude_deg\n0,1\n").unwrap();
        assert!(
            Recording::read(&path)
                .unwrap_err()
                .contains("missing field")
        );
    }

    #[test]
    fn a_star_stands_for_any_characters_of_a_file_name() {
        assert!(matches("0*_ils*.csv", "01_calm_ils.csv"));
        assert!(matches("*", ""));
        assert!(!matches("0*.csv", "10.csv"));
        assert!(!matches("*.csv", "a.csv.gz"));
        let folder = tempfile::tempdir().unwrap();
        for name in ["b.csv", "a.csv", "a.txt"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        let found = matching_files(&folder.path().join("*.csv")).unwrap();
        assert_eq!(
            found,
            [folder.path().join("a.csv"), folder.path().join("b.csv")]
        );
        assert!(matching_files(&folder.path().join("x*.csv")).is_err());
    }
}
