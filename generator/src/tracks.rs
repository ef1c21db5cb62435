//! Real arrivals as recordings: tracks of ADS-B receivers, smoothed and completed to the states that a recording has.
//!
//! ```text
//! file -> formats: fixes per aircraft -> arrival: the last approach in runway coordinates, or why there is none
//!      -> smoother: path and speed -> height: true heights from barometric ones -> states: attitude, flaps, gear, touchdown -> CSV
//! ```
//!
//! Measured are times, positions, ground speeds and altitudes; everything else is derived, and each row of a recording says which of both
//! its position is. Wind is not known: heading is the track, and airspeed the ground speed.

mod arrival;
mod formats;
mod height;
mod smoother;
mod states;

use std::io;
use std::path::{Path, PathBuf};

use dataset::geometry::runway::Runway;
use serde::Serialize;

pub use arrival::NoArrival;
pub use formats::TrackFileError;

use crate::recording::{Recording, RecordingError};

/// A track that became a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ImportedTrack {
    /// The file with the track.
    pub file: PathBuf,
    /// The aircraft's 24-bit address, if the file has one.
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
    /// The aircraft's 24-bit address, if the file has one.
    pub aircraft: Option<String>,
    /// The reason.
    pub reason: String,
}

/// The outcome for some files.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct TrackImport {
    /// Tracks that became recordings.
    pub imported: Vec<ImportedTrack>,
    /// All others.
    pub refused: Vec<RefusedTrack>,
}

/// Reasons why no recording can be written.
#[derive(Debug, thiserror::Error)]
pub enum TrackImportError {
    /// A recording cannot be written.
    #[error("cannot write {}: {cause}", path.display())]
    Write {
        /// The recording.
        path: PathBuf,
        /// Cause.
        cause: io::Error,
    },
}

/// Makes recordings of the arrivals at a runway, in an existing folder. A file that cannot be read is refused like a track.
///
/// # Errors
/// A recording cannot be written.
pub fn import_tracks(
    files: &[PathBuf],
    runway: &Runway,
    folder: &Path,
) -> Result<TrackImport, TrackImportError> {
    let mut outcome = TrackImport::default();
    for file in files {
        let refused = |aircraft: Option<String>, reason: String| RefusedTrack {
            file: file.clone(),
            aircraft,
            reason,
        };
        let tracks = match formats::read(file) {
            Ok(tracks) => tracks,
            Err(error) => {
                outcome.refused.push(refused(None, error.to_string()));
                continue;
            }
        };
        let alone = tracks.len() == 1;
        for track in tracks {
            let made = match states::of_track(&track.fixes, runway) {
                Ok(made) => made,
                Err(reason) => {
                    outcome
                        .refused
                        .push(refused(track.aircraft, reason.to_string()));
                    continue;
                }
            };
            let stem = file.file_stem().unwrap_or_default().to_string_lossy();
            let name = match &track.aircraft {
                Some(aircraft) if !alone => format!("{stem}-{aircraft}.csv"),
                _ => format!("{stem}.csv"),
            };
            let path = folder.join(name);
            // The gate of all recordings has the last word.
            match write_checked(&path, &made.csv(), runway)? {
                Some(error) => outcome
                    .refused
                    .push(refused(track.aircraft, error.to_string())),
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

/// Writes a recording beside its place, reads it as a sweep would, and puts it there if it is accepted.
fn write_checked(
    path: &Path,
    text: &str,
    runway: &Runway,
) -> Result<Option<RecordingError>, TrackImportError> {
    let failed = |cause| TrackImportError::Write {
        path: path.to_owned(),
        cause,
    };
    let folder = path.parent().unwrap_or(Path::new("."));
    let staged = tempfile::Builder::new()
        .suffix(".csv")
        .tempfile_in(folder)
        .map_err(failed)?;
    std::fs::write(staged.path(), text).map_err(failed)?;
    if let Err(error) = Recording::read(staged.path(), runway, f64::MAX, &[]) {
        return Ok(Some(error));
    }
    staged.persist(path).map_err(|error| failed(error.error))?;
    Ok(None)
}
