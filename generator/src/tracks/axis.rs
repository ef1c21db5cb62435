//! The line that arrivals fly on final approach, which shows the errors of published runway figures.

use std::path::PathBuf;

use dataset::geometry::runway::Runway;
use dataset::numbers::spread::{mean_and_deviation, median};
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use serde::Serialize;

use super::RefusedTrack;
use super::arrival::{arrival, without_jumps};
use super::formats;
use super::height::line_through_medians;

/// Distances to go between which arrivals follow the centreline, metres.
const FOLLOWS_M: (f64, f64) = (
    0.5 * METERS_PER_NAUTICAL_MILE,
    6.0 * METERS_PER_NAUTICAL_MILE,
);
const MIN_FIXES: usize = 10;
/// Minimum number of arrivals: a single one may be anywhere.
const MIN_ARRIVALS: usize = 2;
/// Arrivals contradict a runway beyond these differences: metres, degrees. They keep to the centreline within about 10 m.
const ELSEWHERE_M: f64 = 12.0;
const ELSEWHERE_DEG: f64 = 0.1;
/// Ratio between the standard errors of median and mean.
const MEDIAN_ERROR: f64 = 1.25;

/// Common line flown by arrivals, relative to the runway's centreline.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ArrivalAxis {
    /// Number of arrivals.
    pub arrivals: usize,
    /// Offset at the touchdown target, to the right when landing, metres: median of the arrivals.
    pub offset_m: f64,
    /// Standard error of the offset, metres; absent for a single arrival.
    pub offset_error_m: Option<f64>,
    /// Course relative to the runway's, degrees.
    pub turned_deg: f64,
    /// Standard error of the course.
    pub turned_error_deg: Option<f64>,
}

impl ArrivalAxis {
    /// There are enough arrivals to judge a runway.
    pub(crate) fn is_judge(&self) -> bool {
        self.arrivals >= MIN_ARRIVALS
    }

    /// The arrivals contradict the runway.
    pub(crate) fn is_elsewhere(&self) -> bool {
        self.is_judge() && !self.is_near()
    }

    /// The arrivals confirm the runway.
    pub(crate) fn is_on_it(&self) -> bool {
        self.is_judge() && self.is_near()
    }

    fn is_near(&self) -> bool {
        self.offset_m.abs() <= ELSEWHERE_M && self.turned_deg.abs() <= ELSEWHERE_DEG
    }

    /// Distance from the centreline, metres, averaged over the touchdown target and a place before it.
    pub(crate) fn aside_m(&self, before_m: f64) -> f64 {
        let there_m = self.offset_m - before_m * self.turned_deg.to_radians().tan();
        (self.offset_m.abs() + there_m.abs()) / 2.0
    }
}

/// The arrivals in some files: their common line, and the excluded tracks.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct JudgedTracks {
    /// The line; `None` if no track lands on the runway with enough positions on final approach.
    pub axis: Option<ArrivalAxis>,
    /// All other tracks, with the reason.
    pub left_out: Vec<RefusedTrack>,
}

/// Fits the arrivals in files of tracks.
///
/// # Errors
/// A file that cannot be read.
pub(crate) fn arrival_axis(files: &[PathBuf], runway: &Runway) -> dataset::Result<JudgedTracks> {
    let mut lines = Vec::new();
    let mut left_out = Vec::new();
    for file in files {
        for track in formats::read(file, &[], runway)? {
            let mut refuse = |reason: String| {
                left_out.push(RefusedTrack {
                    file: file.clone(),
                    aircraft: track.aircraft.clone(),
                    reason,
                });
            };
            let (fixes, _) = without_jumps(&track.fixes);
            let seen = match arrival(&fixes, runway) {
                Ok(seen) => seen,
                Err(reason) => {
                    refuse(reason.to_string());
                    continue;
                }
            };
            let follows = seen
                .iter()
                .filter(|at| (FOLLOWS_M.0..=FOLLOWS_M.1).contains(&at.to_go_m));
            let points: Vec<(f64, f64)> = follows.map(|at| (at.to_go_m, at.right_m)).collect();
            if points.len() >= MIN_FIXES {
                lines.push(line_through_medians(&points));
            } else {
                let found = points.len();
                refuse(format!(
                    "it has {found} positions between 6 and 0.5 NM, expected at least {MIN_FIXES}"
                ));
            }
        }
    }
    if lines.is_empty() {
        return Ok(JudgedTracks {
            axis: None,
            left_out,
        });
    }
    let of = |what: fn(&(f64, f64)) -> f64| {
        let mut values: Vec<f64> = lines.iter().map(what).collect();
        let [_, deviation] = mean_and_deviation(values.iter().copied());
        let count = values.len() as f64;
        let error = (count > 1.0).then(|| MEDIAN_ERROR * deviation / (count - 1.0).sqrt());
        (median(&mut values), error)
    };
    let (offset_m, offset_error_m) = of(|line| line.0);
    // An arrival that is further to the right when further out flies to the left.
    let (turned_deg, turned_error_deg) = of(|line| -line.1.atan().to_degrees());
    let axis = ArrivalAxis {
        arrivals: lines.len(),
        offset_m,
        offset_error_m,
        turned_deg,
        turned_error_deg,
    };
    Ok(JudgedTracks {
        axis: Some(axis),
        left_out,
    })
}
