//! Makes a runway's table from published ones, and compares them: a course that is off by 0.1 degrees moves the path by 32 m at 10 NM.
//!
//! Courses are geodesics between the ends, never the stated ones. Where tables differ, the one is recommended whose centreline meets the
//! localizer's antenna, else the one whose length is the stated one.

mod line;
mod magnetic;
mod second_source;

use std::fmt::Write;
use std::path::PathBuf;

use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::runway::Runway;
use dataset::geometry::sun;
use serde::Serialize;

use line::{Line, differences, recommended};

use super::sources::{Aid, Facts, Wanted};

/// Tables contradict each other beyond these differences: metres over ground, metres of height.
const PLACE_TOLERANCE_M: f64 = 10.0;
const HEIGHT_TOLERANCE_M: f64 = 5.0;
/// The distance of the ends may differ from the stated length by this much, metres: overruns are counted differently.
const LENGTH_TOLERANCE_M: f64 = 50.0;
/// Distances of glide path antennas past the threshold, metres; others belong to a different threshold.
const ANTENNA_M: std::ops::RangeInclusive<f64> = 150.0..=600.0;
/// Default without a glide path antenna: 3 degrees, 50 ft over the threshold.
const USUAL_GLIDE_PATH_DEG: f64 = 3.0;
const USUAL_TOUCHDOWN_M: f64 = 291.0;

/// Distances of the ends of runways, metres: the longest ones for airliners have 5.5 km.
const RUNWAY_M: std::ops::RangeInclusive<f64> = 300.0..=8_000.0;
/// Source of an elevation that no table has for the runway.
const OF_FIELD: &str =
    "ASSUMED: elevation of the field in apt.dat, from which the threshold's may differ by metres";

/// A runway without a second source.
pub const UNCONFIRMED: &str =
    "unconfirmed: no second source agrees within 5 m across and 0.02 degrees";

/// Reasons why no runway could be made.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A file cannot be used.
    #[error(transparent)]
    File(#[from] dataset::Error),
    /// The files lack the runway or its elevation.
    #[error("{0}")]
    Missing(String),
}

/// Figure on which two tables differ.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Conflict {
    /// The key of the sweep.
    pub figure: &'static str,
    /// The figures by table.
    pub found: String,
    /// The recommended table, and the reason.
    pub recommended: String,
}

/// Runway with a source per figure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Imported {
    /// The runway.
    pub runway: Runway,
    /// Figures on which tables differ.
    pub conflicts: Vec<Conflict>,
    /// Sources that agree with the centreline within 5 m across and 0.02 degrees. Empty: unconfirmed.
    pub confirmed_by: Vec<String>,
    /// Source of threshold and course.
    ends_from: String,
    elevation_from: String,
    glide_path_from: String,
}

/// Reads `files` and makes the runway.
///
/// # Errors
/// A file is no table, or no table has the runway.
pub fn import(airport: &str, runway: &str, files: &[PathBuf]) -> Result<Imported, ImportError> {
    let mut facts = Facts::default();
    for file in files {
        facts.read(file, &Wanted { airport, runway })?;
    }
    let localizer = facts.aids.iter().find_map(|aid| match aid {
        Aid::Localizer {
            place,
            frequency_mhz,
            course_magnetic_deg,
        } => Some((*place, *frequency_mhz, *course_magnetic_deg)),
        Aid::GlidePath { .. } => None,
    });
    let lines: Vec<Line<'_>> = facts
        .ends
        .iter()
        .map(|ends| Line::of(ends, localizer.map(|(place, ..)| place)))
        .collect();
    if let Some(line) = lines.iter().find(|line| !RUNWAY_M.contains(&line.length_m)) {
        return Err(ImportError::Missing(format!(
            "the ends of {airport} {runway} by {} are {:.0} m apart, expected {} to {} m; correct its coordinates, or leave that file out",
            line.ends.source,
            line.length_m,
            RUNWAY_M.start(),
            RUNWAY_M.end()
        )));
    }
    let Some((table, reason)) = recommended(&lines) else {
        let mut seen = facts.seen;
        seen.sort();
        seen.dedup();
        let names: Vec<String> = files
            .iter()
            .map(|file| file.display().to_string())
            .collect();
        let found = if seen.is_empty() {
            "the airport is in none of them".to_owned()
        } else {
            format!("they have runways {}", seen.join(", "))
        };
        return Err(ImportError::Missing(format!(
            "no ends of {airport} {runway} in {}; {found}",
            names.join(", ")
        )));
    };
    let mut conflicts = Vec::new();
    let localizers = localizer.map(|(place, ..)| place).zip(facts.opposite);
    let moved = localizers
        .filter(|_| is_beside_localizers(table, &lines))
        .and_then(|(localizer, opposite)| table.onto_axis(opposite, localizer));
    let on_axis = moved.as_ref().map(|ends| Line::of(ends, None));
    let best = on_axis.as_ref().unwrap_or(table);
    let reason = match &on_axis {
        Some(_) => format!(
            "; the ends of {} moved onto it, as no table meets it{reason}",
            table.ends.source
        ),
        None => reason,
    };
    for other in &lines {
        conflicts.extend(differences(best, other, &reason));
    }
    let source = best.ends.source;
    let mut add = |figure, found: String, decides: &str| {
        conflicts.push(Conflict {
            figure,
            found,
            recommended: format!("{source}: {decides}"),
        });
    };
    if let Some(localizer_m) = best
        .localizer_m
        .filter(|localizer_m| *localizer_m > PLACE_TOLERANCE_M)
    {
        let found = format!(
            "the centreline of {source} misses the localizer by {localizer_m:.0} m, or the localizer stands beside it"
        );
        add("course_true_deg", found, "a chart decides");
    }
    let stated_m = lines.iter().find_map(|line| line.ends.stated_length_m);
    let off_m = stated_m.map_or(0.0, |stated_m| best.off_length_m(stated_m));
    if off_m > LENGTH_TOLERANCE_M {
        let found = format!(
            "the ends by {source} are {:.0} m apart, {off_m:.0} m from the stated length",
            best.length_m
        );
        add("threshold", found, "a chart decides");
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
        elevation(&lines, antenna.map(|antenna| antenna.1), &mut conflicts)
            .or_else(|| Some((facts.field_elevation_m?, OF_FIELD.to_owned())))
            .ok_or_else(|| {
                ImportError::Missing(format!(
                    "no elevation of {airport} {runway}; add apt.dat, OurAirports' runways.csv or earth_nav.dat"
                ))
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
    let course_magnetic_deg = magnetic::course_magnetic_deg(
        best.course_deg,
        best.threshold.at_altitude_m(altitude_msl_m),
    );
    if let Some(magnetic_deg) = course_magnetic_deg {
        let stated_deg = localizer.and_then(|(.., stated_deg)| stated_deg);
        conflicts.extend(magnetic::contradictions(magnetic_deg, stated_deg, runway));
    }
    let confirmed_by = second_source::confirmed_by(best, &lines, localizers);
    Ok(Imported {
        runway: Runway {
            airport: airport.to_owned(),
            name: runway.to_owned(),
            threshold: rounded(best.threshold.at_altitude_m(altitude_msl_m)),
            course_true_deg: round(best.course_deg, 3),
            glide_path_deg,
            touchdown_past_threshold_m: round(touchdown_past_threshold_m, 1),
            ils_frequency_mhz: localizer.map(|(_, frequency_mhz, _)| frequency_mhz),
            course_magnetic_deg: course_magnetic_deg.map(|course_deg| round(course_deg, 1)),
            length_m: Some(round(best.landing_m, 0)),
            width_m: best.ends.width_m.map(|width_m| round(width_m, 0)),
        },
        conflicts,
        ends_from: format!(
            "geodesic between the ends of {source}, {}{reason}",
            match &confirmed_by[..] {
                [] => UNCONFIRMED.to_owned(),
                sources => format!("confirmed by {}", sources.join(", ")),
            }
        ),
        confirmed_by,
        elevation_from,
        glide_path_from,
    })
}

impl Imported {
    /// The runway as a sweep table.
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
            course_magnetic_deg,
            length_m,
            width_m,
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
        if let Some(course_deg) = course_magnetic_deg {
            let source = format!("World Magnetic Model, middle of {}", sun::YEAR);
            line("course_magnetic_deg", course_deg.to_string(), &source);
        }
        for (key, value) in [("length_m", length_m), ("width_m", width_m)] {
            if let Some(metres) = value {
                line(key, metres.to_string(), "by the table of the ends");
            }
        }
        text
    }
}

/// True if all tables miss the localizer, and no other table confirms the recommended one: where one does, the localizer stands beside the
/// runway.
fn is_beside_localizers(table: &Line<'_>, lines: &[Line<'_>]) -> bool {
    let misses = |line: &Line<'_>| {
        line.localizer_m
            .is_none_or(|localizer_m| localizer_m > PLACE_TOLERANCE_M)
    };
    let agreeing = lines
        .iter()
        .filter(|line| differences(table, line, "").is_empty());
    // It agrees with itself.
    table.localizer_m.is_some() && lines.iter().all(misses) && agreeing.count() == 1
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
                antenna_m.filter(|antenna_m| (antenna_m - end_m).abs() > HEIGHT_TOLERANCE_M)
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

fn rounded(place: Geodetic) -> Geodetic {
    Geodetic {
        latitude_deg: round(place.latitude_deg, 7),
        longitude_deg: round(place.longitude_deg, 7),
        altitude_msl_m: round(place.altitude_msl_m, 2),
    }
}
