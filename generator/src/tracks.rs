//! Real arrivals as recordings: tracks of ADS-B receivers, smoothed and completed to the states that a recording has.
//!
//! ```text
//! file -> formats: fixes per aircraft -> arrival: the last approach in runway coordinates, or why there is none
//!      -> smoother: path and speed -> height: true heights from barometric ones -> states: attitude, flaps, gear, touchdown -> CSV
//! ```
//!
//! Receivers measure times, positions, ground speeds and altitudes; X-Plane's recordings have the attitude as well. Everything else is
//! derived, and each row states the origin of position and attitude. Wind is not known: heading is the track, and airspeed the ground
//! speed.

mod arrival;
mod attitude;
mod axis;
mod flaps;
mod formats;
mod height;
mod smoother;
mod states;

use std::fmt;
use std::fs::Permissions;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use dataset::geometry::runway::Runway;
use serde::Serialize;

use arrival::FURTHEST_M;
pub use axis::ArrivalAxis;
pub(crate) use axis::{JudgedTracks, arrival_axis};

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

/// Makes recordings of the arrivals at a runway, in an existing folder. A file that cannot be read is refused like a track.
///
/// # Errors
/// A recording cannot be written.
pub fn import_tracks(
    files: &[PathBuf],
    runway: &Runway,
    folder: &Path,
) -> dataset::Result<TrackImport> {
    let mut outcome = TrackImport::default();
    for file in files {
        let mut refuse = |aircraft: Option<String>, reason: String| {
            outcome.refused.push(RefusedTrack {
                file: file.clone(),
                aircraft,
                reason,
            });
        };
        let tracks = match formats::read(file, runway) {
            Ok(tracks) => tracks,
            Err(error) if error.is_of_disk() => return Err(error),
            Err(error) => {
                refuse(None, error.to_string());
                continue;
            }
        };
        if tracks.is_empty() {
            refuse(None, "it has no positions".into());
        }
        let alone = tracks.len() == 1;
        for track in tracks {
            let made = match states::of_track(&track.fixes, runway) {
                Ok(made) => made,
                Err(reason) => {
                    refuse(track.aircraft, reason.to_string());
                    continue;
                }
            };
            let stem = file.file_stem().unwrap_or_default().to_string_lossy();
            let name = match &track.aircraft {
                Some(aircraft) if !alone => format!("{}.csv", plain(&format!("{stem}-{aircraft}"))),
                _ => format!("{}.csv", plain(&stem)),
            };
            let path = folder.join(name);
            match write_checked(&path, &made.csv(), runway)? {
                Some(reason) => refuse(track.aircraft, reason),
                None => outcome.imported.push(ImportedTrack {
                    file: file.clone(),
                    aircraft: track.aircraft,
                    recording: path,
                    along_sd_m: made.along_sd_m,
                    across_sd_m: made.across_sd_m,
                    outliers: made.outliers,
                    continued_s: made.continued_s,
                }),
            }
        }
    }
    Ok(outcome)
}

/// Replaces characters that mean something in a path.
fn plain(name: &str) -> String {
    let plain = |letter: char| letter.is_alphanumeric() || "-_.".contains(letter);
    name.chars()
        .map(|letter| if plain(letter) { letter } else { '_' })
        .collect()
}

/// Writes a recording beside its place, reads it as a sweep would, and puts it there if it is accepted; else returns the reason. An
/// existing file stays.
fn write_checked(path: &Path, text: &str, runway: &Runway) -> dataset::Result<Option<String>> {
    let failed = |error| dataset::Error::io("write", path)(error);
    let folder = path.parent().unwrap_or(Path::new("."));
    let staged = tempfile::Builder::new()
        .suffix(".csv")
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder)
        .map_err(failed)?;
    std::fs::write(staged.path(), text).map_err(failed)?;
    if let Err(error) = Recording::read(staged.path(), runway, FURTHEST_M, &[]) {
        let reason = match error {
            RecordingError::Implausible {
                fault: Implausible::NoApproach { how, .. },
                ..
            } => how,
            RecordingError::Implausible { fault, .. } => fault.to_string(),
            RecordingError::Flight { fault, .. } => fault.to_string(),
            RecordingError::Unreadable(error) if error.is_of_disk() => return Err(error),
            other => other.to_string(),
        };
        return Ok(Some(format!("its states are no approach: it {reason}")));
    }
    match staged.persist_noclobber(path) {
        Ok(_) => Ok(None),
        Err(error) if error.error.kind() == io::ErrorKind::AlreadyExists => {
            Ok(Some(format!("{} exists already", path.display())))
        }
        Err(error) => Err(failed(error.error)),
    }
}
