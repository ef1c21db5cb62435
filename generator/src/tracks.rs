//! Real arrivals as recordings: tracks of ADS-B receivers, smoothed and completed to the states that a recording has.
//!
//! ```text
//! file -> formats: fixes per aircraft -> arrival: the approaches in runway coordinates, or why there is none
//!      -> smoother: path and speed -> height: true heights from barometric ones -> states: attitude, flaps, gear, touchdown -> CSV
//! ```
//!
//! Receivers measure times, positions, ground speeds, altitudes and sometimes the roll; X-Plane's recordings have the attitude as well.
//! Everything else is derived, and each row states the origin of position and attitude. Wind is not known: heading is the track, and
//! airspeed the ground speed.

mod arrival;
mod attitude;
mod flaps;
mod formats;
mod height;
mod smoother;
mod states;

use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use dataset::corpus::workshop;
use dataset::files::new_file::{NewFile, clear_leftovers, sync};
use dataset::files::own_path::resolved;
use dataset::geometry::runway::Runway;
use serde::Serialize;

use arrival::FURTHEST_M;
pub use formats::{NamedColumn, separator, utc_s};

use crate::recording::{Implausible, Recording, RecordingError};

/// A track that became a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ImportedTrack {
    /// The file with the track.
    pub file: PathBuf,
    /// The aircraft's 24-bit address, if the file has one, or the number of the flight in it.
    pub aircraft: Option<String>,
    /// The recording.
    pub recording: PathBuf,
    /// Deviation of the measured positions from the recorded path along and across the course, metres (standard deviation).
    pub along_sd_m: f64,
    /// See `along_sd_m`.
    pub across_sd_m: f64,
    /// Positions that were left out as outliers.
    pub outliers: usize,
    /// Seconds at the end that are derived: the track ended in the air.
    pub continued_s: f64,
}

/// A track that is no arrival on the runway.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RefusedTrack {
    /// The file with the track.
    pub file: PathBuf,
    /// The aircraft's 24-bit address, if the file has one, or the number of the flight in it.
    pub aircraft: Option<String>,
    /// The reason.
    pub reason: String,
}

impl fmt::Display for RefusedTrack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if let Some(aircraft) = &self.aircraft {
            write!(f, ", aircraft {aircraft}")?;
        }
        write!(f, ": {}", self.reason)
    }
}

/// The outcome for some files.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct TrackImport {
    /// Tracks that became recordings.
    pub imported: Vec<ImportedTrack>,
    /// All others.
    pub refused: Vec<RefusedTrack>,
}

/// Makes recordings of the arrivals at a runway, in a folder, which is created if missing. A file with the wrong content is refused like a
/// track. Recordings that are there already, from the same tracks, stay, so that a call that was interrupted can be repeated.
///
/// # Errors
/// A recording cannot be written, or another process imports to this folder.
pub fn import_tracks(
    files: &[PathBuf],
    columns: &[NamedColumn],
    runway: &Runway,
    folder: &Path,
) -> dataset::Result<TrackImport> {
    let is_new = !folder.is_dir();
    let claim = workshop::lock(folder, folder, Duration::ZERO)?;
    let _claim = if is_new {
        sync(resolved(folder)?.parent().unwrap_or(folder))?;
        claim
    } else {
        claim.in_existing_folder()
    };
    clear_leftovers(folder);
    let mut outcome = TrackImport::default();
    // Files by the recording made from them.
    let mut made_from: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    for file in files {
        let mut refuse = |aircraft: Option<String>, reason: String| {
            outcome.refused.push(RefusedTrack {
                file: file.clone(),
                aircraft,
                reason,
            });
        };
        let tracks = match formats::read(file, columns, runway) {
            Ok(tracks) => tracks,
            Err(error) if error.is_of_disk() => return Err(error),
            Err(error) => {
                refuse(None, error.beside(file));
                continue;
            }
        };
        if tracks.is_empty() {
            refuse(None, "it has no positions".into());
        }
        let alone = tracks.len() == 1;
        for track in tracks {
            let arrivals = states::of_track(&track, runway);
            let count = arrivals.len();
            for (number, made) in (1..).zip(arrivals) {
                let aircraft = track.aircraft.clone();
                let made = match made {
                    Ok(made) => made,
                    Err(reason) => {
                        refuse(aircraft, reason);
                        continue;
                    }
                };
                let of_aircraft = aircraft.as_deref().filter(|_| !alone);
                let number = (count > 1).then_some(number);
                let path = folder.join(recording_name(file, of_aircraft, number));
                if let Some(other) = made_from.insert(path.clone(), file) {
                    let other = other.display();
                    let path = path.display();
                    let why = format!("{path} is the recording of {other}; rename one file");
                    refuse(aircraft, why);
                    continue;
                }
                match write_checked(&path, &made.csv(), runway)? {
                    Some(reason) => refuse(aircraft, reason),
                    None => outcome.imported.push(ImportedTrack {
                        file: file.clone(),
                        aircraft,
                        recording: path,
                        along_sd_m: made.along_sd_m,
                        across_sd_m: made.across_sd_m,
                        outliers: made.outliers,
                        continued_s: made.continued_s,
                    }),
                }
            }
        }
    }
    Ok(outcome)
}

/// An arrival in a track, with its times.
#[derive(Debug, Clone)]
pub struct Arrival {
    /// UTC of time 0 of the trajectory, seconds since 1970, by the track's times.
    pub start_utc_s: f64,
    /// The states, as `dtd tracks import` writes them.
    pub recording: Recording,
    /// Standard deviations of the smoothed positions along the course and across it, and of the heights, metres.
    pub position_sd_m: [f64; 3],
    /// Standard deviation of an error of the heights in proportion to them.
    pub stretch_sd: f64,
}

/// The arrivals in a file of tracks with their times, and what cannot be used. `is_exact`: positions and altitudes (metres above the datum
/// of the runway) are right within a metre, as of satellite navigation with corrections. `scratch`: a folder for recordings.
///
/// # Errors
/// The file cannot be read, or a recording cannot be written.
pub fn arrivals(
    file: &Path,
    columns: &[NamedColumn],
    runway: &Runway,
    is_exact: bool,
    scratch: &Path,
) -> dataset::Result<(Vec<Arrival>, Vec<RefusedTrack>)> {
    let mut tracks = formats::read(file, columns, runway)?;
    let (mut arrivals, mut refused) = (Vec::new(), Vec::new());
    let alone = tracks.len() == 1;
    for track in &mut tracks {
        for fix in track.fixes.iter_mut().filter(|_| is_exact) {
            fix.is_simulated = true;
            fix.altitude_m = fix.altitude_m.or(fix.geometric_m);
        }
        let found = states::of_track(track, runway);
        let count = found.len();
        for (number, made) in (1..).zip(found) {
            let of_aircraft = track.aircraft.as_deref().filter(|_| !alone);
            let number = (count > 1).then_some(number);
            let path = scratch.join(recording_name(file, of_aircraft, number));
            let checked = match made {
                Ok(made) => {
                    fs::write(&path, made.csv()).map_err(dataset::Error::io("write", &path))?;
                    let checked = checked(&path, runway)?;
                    fs::remove_file(&path).map_err(dataset::Error::io("remove", &path))?;
                    checked.map(|recording| Arrival {
                        start_utc_s: made.start_utc_s,
                        recording,
                        position_sd_m: made.position_sd_m(),
                        stretch_sd: made.stretch_sd,
                    })
                }
                Err(reason) => Err(reason),
            };
            match checked {
                Ok(arrival) => arrivals.push(arrival),
                Err(reason) => refused.push(RefusedTrack {
                    file: file.to_owned(),
                    aircraft: track.aircraft.clone(),
                    reason,
                }),
            }
        }
    }
    if tracks.is_empty() {
        refused.push(RefusedTrack {
            file: file.to_owned(),
            aircraft: None,
            reason: "it has no positions".into(),
        });
    }
    Ok((arrivals, refused))
}

/// File name of the recording of a track: of which aircraft, if there are several, and the number of its arrival, if it has several.
fn recording_name(file: &Path, aircraft: Option<&str>, number: Option<u32>) -> String {
    let number = number.map(|number| number.to_string());
    let names = [Some(stem(file)), aircraft.map(str::to_owned), number];
    let name = names.into_iter().flatten().collect::<Vec<_>>().join("-");
    format!("{}.csv", plain(&name))
}

/// Name of a file without its ending, and without the one before `.gz`.
fn stem(file: &Path) -> String {
    let mut stem = Path::new(file.file_stem().unwrap_or_default());
    if file.extension().is_some_and(|ending| ending == "gz") {
        stem = Path::new(stem.file_stem().unwrap_or_default());
    }
    stem.to_string_lossy().into_owned()
}

/// Replaces characters that mean something in a path.
fn plain(name: &str) -> String {
    let plain = |letter: char| letter.is_alphanumeric() || "-_.".contains(letter);
    name.chars()
        .map(|letter| if plain(letter) { letter } else { '_' })
        .collect()
}

/// Reads a recording as a sweep would, or returns the reason why it is none.
fn checked(path: &Path, runway: &Runway) -> dataset::Result<Result<Recording, String>> {
    let reason = match Recording::read(path, runway, FURTHEST_M, &[]) {
        Ok(recording) => return Ok(Ok(recording)),
        Err(RecordingError::Unreadable(error)) => return Err(error),
        Err(RecordingError::Implausible {
            fault: Implausible::NoApproach { how, .. },
            ..
        }) => how,
        Err(RecordingError::Implausible { fault, .. }) => fault.to_string(),
        Err(RecordingError::Flight { fault, .. }) => fault.to_string(),
        Err(RecordingError::OutOfLimits { fault, .. }) => format!("has {fault}"),
        Err(RecordingError::Unusable(why)) => why,
    };
    Ok(Err(format!("its states are no approach: it {reason}")))
}

/// Writes a recording beside its place, reads it as a sweep would, and puts it there if it is accepted; else returns the reason. An
/// existing file stays.
fn write_checked(path: &Path, text: &str, runway: &Runway) -> dataset::Result<Option<String>> {
    let mut file = NewFile::create(path)?;
    let written = file.write_all(text.as_bytes());
    written.map_err(dataset::Error::io("write", path))?;
    if let Err(reason) = checked(file.temporary(), runway)? {
        return Ok(Some(reason));
    }
    match file.commit_new() {
        Err(error) if error.is_taken() => {
            let found = fs::read(path).map_err(dataset::Error::io("read", path))?;
            Ok((found != text.as_bytes()).then(|| {
                let path = path.display();
                format!(
                    "{path} exists already with other content; move it away, or name another folder"
                )
            }))
        }
        committed => committed.map(|()| None),
    }
}
