//! Makes the table of a runway from published ones, and compares them: a course that is off by 0.1 degrees moves the path by 32 m at 10 NM.
//!
//! Courses are geodesics between the ends, never the stated ones. Where tables differ, the one is recommended whose centreline meets the
//! localizer's antenna, else the one whose length is the stated one.

use std::fmt::Write;
use std::path::PathBuf;

use dataset::geometry::geodesy::{Geodetic, LatLon};
use dataset::geometry::runway::{Runway, RunwayCoordinates};
use dataset::numbers::units::Degrees;
use serde::Serialize;

use super::sources::{Aid, Ends, Facts, SourceError, Wanted};

/// Tables contradict each other beyond these differences: degrees, metres over ground, metres of height.
const COURSE_DEG: f64 = 0.05;
const PLACE_M: f64 = 10.0;
const HEIGHT_M: f64 = 5.0;
/// The distance of the ends may differ from the stated length by this much, metres: overruns are counted differently.
const LENGTH_M: f64 = 50.0;
/// A localizer further from the centreline, metres, belongs to an approach at an angle.
const OFFSET_LOCALIZER_M: f64 = 100.0;
/// Two centrelines are equally near to the localizer within this, metres.
const EQUALLY_NEAR_M: f64 = 3.0;
/// Distances of glide path antennas past the threshold, metres; others belong to another threshold.
const ANTENNA_M: std::ops::RangeInclusive<f64> = 150.0..=600.0;
/// Without a glide path antenna: 3 degrees, over the threshold at a height of 50 ft.
const USUAL_GLIDE_PATH_DEG: f64 = 3.0;
const USUAL_TOUCHDOWN_M: f64 = 291.0;

/// Reasons why no runway could be made.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A file says nothing.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// No file has the runway.
    #[error(
        "no ends of {airport} {runway} in {}; {}",
        files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join(", "),
        if seen.is_empty() { "the airport is in none of them".to_owned() } else { format!("they have runways {}", seen.join(", ")) }
    )]
    NoRunway {
        /// The airport.
        airport: String,
        /// The runway.
        runway: String,
        /// The files.
        files: Vec<PathBuf>,
        /// Runways of this airport in them.
        seen: Vec<String>,
    },
    /// No file has its height.
    #[error(
        "no elevation of {airport} {runway}: apt.dat has none for a runway; add OurAirports' runways.csv or earth_nav.dat"
    )]
    NoElevation {
        /// The airport.
        airport: String,
        /// The runway.
        runway: String,
    },
}

/// A figure of two tables that differ.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Conflict {
    /// The key of the sweep.
    pub figure: &'static str,
    /// The figures by table.
    pub found: String,
    /// The recommended table, and the reason.
    pub recommended: String,
}

/// A runway with the source of each figure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Imported {
    /// The runway.
    pub runway: Runway,
    /// Figures on which tables differ.
    pub conflicts: Vec<Conflict>,
    /// Source of threshold and course.
    ends_from: String,
    elevation_from: String,
    glide_path_from: String,
}

/// A runway by one table.
struct Line<'a> {
    ends: &'a Ends,
    threshold: LatLon,
    course_deg: f64,
    /// Between the ends of the pavement, metres.
    length_m: f64,
    /// From the landing threshold on, metres.
    landing_m: f64,
    /// Distance of the localizer's antenna from the centreline, metres.
    localizer_m: Option<f64>,
}

/// Reads `files` and makes the runway.
///
/// # Errors
/// A file that is no table, or none with the runway.
pub fn import(airport: &str, runway: &str, files: &[PathBuf]) -> Result<Imported, ImportError> {
    let mut facts = Facts::default();
    for file in files {
        facts.read(file, &Wanted { airport, runway })?;
    }
    let localizer = facts.aids.iter().find_map(|aid| match aid {
        Aid::Localizer {
            place,
            frequency_mhz,
        } => Some((*place, *frequency_mhz)),
        Aid::GlidePath { .. } => None,
    });
    let lines: Vec<Line<'_>> = facts
        .ends
        .iter()
        .map(|ends| Line::of(ends, localizer.map(|(place, _)| place)))
        .collect();
    let Some((best, reason)) = recommended(&lines) else {
        let mut seen = facts.seen;
        seen.sort();
        seen.dedup();
        return Err(ImportError::NoRunway {
            airport: airport.to_owned(),
            runway: runway.to_owned(),
            files: files.to_vec(),
            seen,
        });
    };
    let mut conflicts = Vec::new();
    for other in &lines {
        conflicts.extend(differences(best, other, &reason));
    }
    if let Some(localizer_m) = best
        .localizer_m
        .filter(|localizer_m| *localizer_m > PLACE_M)
    {
        conflicts.push(Conflict {
            figure: "course_true_deg",
            found: format!(
                "the centreline of {} misses the localizer by {localizer_m:.0} m, or the localizer stands beside it",
                best.ends.source
            ),
            recommended: format!("{}: a chart, or arrivals, decide", best.ends.source),
        });
    }
    let stated_m = lines.iter().find_map(|line| line.ends.stated_length_m);
    let off_m = stated_m.map_or(0.0, |stated_m| best.off_length_m(stated_m));
    if off_m > LENGTH_M {
        conflicts.push(Conflict {
            figure: "threshold",
            found: format!(
                "the ends by {} are {:.0} m apart, {off_m:.0} m from the stated length",
                best.ends.source, best.length_m
            ),
            recommended: format!("{}: a chart decides", best.ends.source),
        });
    }
    let antenna = facts.aids.iter().find_map(|aid| match aid {
        Aid::GlidePath {
            place,
            elevation_m,
            angle_deg,
        } => {
            let past_m = -best.along_m(*place);
            ANTENNA_M
                .contains(&past_m)
                .then_some((past_m, *elevation_m, *angle_deg))
        }
        Aid::Localizer { .. } => None,
    });
    let (altitude_msl_m, elevation_from) =
        elevation(&lines, antenna.map(|antenna| antenna.1), &mut conflicts).ok_or_else(|| {
            ImportError::NoElevation {
                airport: airport.to_owned(),
                runway: runway.to_owned(),
            }
        })?;
    let (touchdown_past_threshold_m, glide_path_deg, glide_path_from) = match antenna {
        Some((past_m, _, angle_deg)) => (
            past_m,
            angle_deg,
            "glide path antenna in earth_nav.dat".to_owned(),
        ),
        None => (
            USUAL_TOUCHDOWN_M,
            USUAL_GLIDE_PATH_DEG,
            "assumed: no glide path antenna of this threshold was found; 50 ft over the threshold"
                .to_owned(),
        ),
    };
    Ok(Imported {
        runway: Runway {
            airport: airport.to_owned(),
            name: runway.to_owned(),
            threshold: rounded(best.threshold.at_altitude_m(altitude_msl_m)),
            course_true_deg: round(best.course_deg, 3),
            glide_path_deg,
            touchdown_past_threshold_m: round(touchdown_past_threshold_m, 1),
            ils_frequency_mhz: localizer.map(|(_, frequency_mhz)| frequency_mhz),
            course_magnetic_deg: None,
            length_m: Some(round(best.landing_m, 0)),
            width_m: best.ends.width_m.map(|width_m| round(width_m, 0)),
        },
        conflicts,
        ends_from: format!("geodesic between the ends of {}{reason}", best.ends.source),
        elevation_from,
        glide_path_from,
    })
}

impl Imported {
    /// The table of a sweep.
    pub fn toml(&self) -> String {
        let Runway {
            airport,
            name,
            threshold:
                Geodetic {
                    latitude_deg,
                    longitude_deg,
                    altitude_msl_m,
                },
            course_true_deg,
            glide_path_deg,
            touchdown_past_threshold_m,
            ils_frequency_mhz,
            length_m,
            width_m,
            ..
        } = &self.runway;
        let mut text = format!("[airport.{airport}.runway.{name}]\n");
        let mut line = |key: &str, value: String, source: &str| {
            // A string has room for everything.
            let _ = writeln!(text, "{key} = {value}   # {source}");
        };
        let threshold = format!(
            "{{ latitude_deg = {latitude_deg}, longitude_deg = {longitude_deg}, altitude_msl_m = {altitude_msl_m} }}"
        );
        line("threshold", threshold, &self.elevation_from);
        line(
            "course_true_deg",
            course_true_deg.to_string(),
            &self.ends_from,
        );
        line(
            "glide_path_deg",
            glide_path_deg.to_string(),
            &self.glide_path_from,
        );
        line(
            "touchdown_past_threshold_m",
            touchdown_past_threshold_m.to_string(),
            &self.glide_path_from,
        );
        if let Some(frequency_mhz) = ils_frequency_mhz {
            line(
                "ils_frequency_mhz",
                frequency_mhz.to_string(),
                "localizer in earth_nav.dat",
            );
        }
        for (key, value) in [("length_m", length_m), ("width_m", width_m)] {
            if let Some(metres) = value {
                line(key, metres.to_string(), "by the table of the ends");
            }
        }
        text
    }
}

impl<'a> Line<'a> {
    fn of(ends: &'a Ends, localizer: Option<LatLon>) -> Self {
        let (near, far) = (&ends.near, &ends.far);
        let towards_deg = near.place.azimuth_to_deg(far.place);
        let threshold = match near.displaced_m {
            0.0 => near.place,
            displaced_m => near.place.destination(towards_deg, displaced_m),
        };
        let mut line = Self {
            ends,
            threshold,
            course_deg: Degrees(threshold.azimuth_to_deg(far.place)).wrapped_360().0,
            length_m: near.place.distance_m(far.place),
            landing_m: threshold.distance_m(far.place),
            localizer_m: None,
        };
        let offset_m = localizer.map(|place| line.place(place).cross_track_m.abs());
        line.localizer_m = offset_m.filter(|offset_m| *offset_m < OFFSET_LOCALIZER_M);
        line
    }

    /// A place in coordinates of the threshold.
    fn place(&self, place: LatLon) -> RunwayCoordinates {
        RunwayCoordinates::of(
            place.at_altitude_m(0.0),
            self.threshold.at_altitude_m(0.0),
            self.course_deg,
        )
    }

    fn along_m(&self, place: LatLon) -> f64 {
        self.place(place).along_track_m
    }

    /// By how much its length is not the stated one, metres.
    fn off_length_m(&self, stated_m: f64) -> f64 {
        (self.length_m - stated_m).abs()
    }
}

/// The table that agrees best with what is independent of it, and why.
fn recommended<'a, 'b>(lines: &'b [Line<'a>]) -> Option<(&'b Line<'a>, String)> {
    let stated_m = lines.iter().find_map(|line| line.ends.stated_length_m);
    // A centreline that is far from the localizer is the worst, unless all are: then it belongs to an approach at an angle.
    let is_on_axis = lines.iter().any(|line| line.localizer_m.is_some());
    let far_m = if is_on_axis { f64::MAX } else { 0.0 };
    let localizer_m = |line: &Line<'_>| line.localizer_m.unwrap_or(far_m);
    let off_m = |line: &Line<'_>| stated_m.map_or(0.0, |stated_m| line.off_length_m(stated_m));
    let mut best = lines.first()?;
    for line in &lines[1..] {
        let nearer_m = localizer_m(best) - localizer_m(line);
        let is_better = if nearer_m.abs() > EQUALLY_NEAR_M {
            nearer_m > 0.0
        } else {
            off_m(line) + PLACE_M < off_m(best)
        };
        if is_better {
            best = line;
        }
    }
    let of_each = |what: &dyn Fn(&Line<'_>) -> Option<f64>| {
        let each = lines
            .iter()
            .filter_map(|line| Some((line.ends.source, what(line)?)));
        each.map(|(source, metres)| format!("{metres:.1} m ({source})"))
            .collect::<Vec<_>>()
            .join(", ")
    };
    let mut reasons = Vec::new();
    if best.localizer_m.is_some() {
        reasons.push(format!(
            "its centreline misses the localizer by {}",
            of_each(&|line| line.localizer_m)
        ));
    }
    if let Some(stated_m) = stated_m {
        let lengths = of_each(&|line| Some(line.off_length_m(stated_m)));
        reasons.push(format!(
            "its length differs from the stated {stated_m:.0} m by {lengths}"
        ));
    }
    let reason = reasons.join("; ");
    Some((
        best,
        if reason.is_empty() {
            reason
        } else {
            format!("; {reason}")
        },
    ))
}

/// Figures of another table that contradict those of the recommended one.
fn differences(best: &Line<'_>, other: &Line<'_>, reason: &str) -> Vec<Conflict> {
    let (one, two) = (best.ends.source, other.ends.source);
    let recommended = format!("{one}{reason}");
    let mut found = Vec::new();
    let off_deg = Degrees(other.course_deg - best.course_deg).wrapped_180().0;
    if off_deg.abs() > COURSE_DEG {
        found.push(Conflict {
            figure: "course_true_deg",
            found: format!(
                "{:.3} by {one}, {:.3} by {two}: {:.0} m at 10 NM",
                best.course_deg,
                other.course_deg,
                18_520.0 * off_deg.abs().to_radians().sin()
            ),
            recommended: recommended.clone(),
        });
    }
    let place = best.place(other.threshold);
    if place.dtd_m > PLACE_M {
        found.push(Conflict {
            figure: "threshold",
            found: format!(
                "{two} has it {:.1} m further along the runway and {:.1} m to the right of {one}'s",
                -place.along_track_m, place.cross_track_m
            ),
            recommended,
        });
    }
    found
}

/// Height of the threshold, and its source.
fn elevation(
    lines: &[Line<'_>],
    antenna_m: Option<f64>,
    conflicts: &mut Vec<Conflict>,
) -> Option<(f64, String)> {
    let of_end = lines
        .iter()
        .find_map(|line| Some((line.ends.near.elevation_m?, line.ends.source)));
    match (of_end, antenna_m) {
        (Some((end_m, source)), antenna_m) => {
            if let Some(antenna_m) =
                antenna_m.filter(|antenna_m| (antenna_m - end_m).abs() > HEIGHT_M)
            {
                conflicts.push(Conflict {
                    figure: "threshold.altitude_msl_m",
                    found: format!("{end_m:.1} by {source}, {antenna_m:.1} at the glide path antenna in earth_nav.dat"),
                    recommended: format!("{source}: it is the height of the threshold itself"),
                });
            }
            Some((end_m, format!("height by {source}")))
        }
        (None, Some(antenna_m)) => Some((
            antenna_m,
            "height of the glide path antenna in earth_nav.dat".to_owned(),
        )),
        (None, None) => None,
    }
}

fn round(value: f64, digits: i32) -> f64 {
    let factor = 10.0_f64.powi(digits);
    (value * factor).round() / factor
}

/// To a centimetre.
fn rounded(place: Geodetic) -> Geodetic {
    Geodetic {
        latitude_deg: round(place.latitude_deg, 7),
        longitude_deg: round(place.longitude_deg, 7),
        altitude_msl_m: round(place.altitude_msl_m, 2),
    }
}
