//! `[airport.ICAO.runway.NAME]`: a complete runway, or the differences from the built-in one of this name.

use std::collections::BTreeMap;

use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::runway::Runway;
use dataset::numbers::limits;
use schemars::JsonSchema;
use serde::Deserialize;

use super::check::fault::{Checked, Fault, list};
use super::check::limits::in_schema;
use crate::airports;

/// `[airport.ICAO]`
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct AirportTable {
    /// Time zone, e.g. `Europe/Zurich`; `utc_offset_h` of the grid follows from it and the day.
    pub(crate) time_zone: Option<String>,
    /// Runways by designator, e.g. `02L`.
    #[serde(default)]
    pub(crate) runway: BTreeMap<String, RunwayTable>,
}

/// `[airport.ICAO.runway.NAME]`
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RunwayTable {
    /// The landing threshold on the centreline.
    threshold: Option<Threshold>,
    /// Landing course, degrees true, on the WGS-84 ellipsoid at the threshold.
    #[schemars(transform = in_schema(limits::COURSE_TRUE_DEG))]
    course_true_deg: Option<f64>,
    /// Glide path angle, degrees.
    #[schemars(transform = in_schema(limits::GLIDE_PATH_DEG))]
    glide_path_deg: Option<f64>,
    /// Distance of the touchdown target past the threshold along the centreline, metres.
    #[schemars(transform = in_schema(limits::TOUCHDOWN_PAST_THRESHOLD_M))]
    touchdown_past_threshold_m: Option<f64>,
    /// Frequency of the instrument landing system, MHz, if there is one.
    #[schemars(transform = in_schema(limits::ILS_MHZ))]
    ils_frequency_mhz: Option<f64>,
    /// Magnetic course of the localizer as a pilot would set it, degrees.
    #[schemars(transform = in_schema(limits::COURSE_MAGNETIC_DEG))]
    course_magnetic_deg: Option<f64>,
    /// Length of the pavement from the landing threshold on, metres; the bundled simulator draws 4,000 m if it is not given.
    #[schemars(transform = in_schema(limits::RUNWAY_LENGTH_M))]
    length_m: Option<f64>,
    /// Width of the pavement, metres; the bundled simulator draws 60 m if it is not given.
    #[schemars(transform = in_schema(limits::RUNWAY_WIDTH_M))]
    width_m: Option<f64>,
}

/// A position on the ellipsoid.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Threshold {
    /// Geodetic latitude, degrees, north positive.
    #[schemars(transform = in_schema(limits::LATITUDE_DEG))]
    latitude_deg: f64,
    /// Longitude, degrees, east positive.
    #[schemars(transform = in_schema(limits::LONGITUDE_DEG))]
    longitude_deg: f64,
    /// Height above mean sea level, metres.
    #[schemars(transform = in_schema(limits::ELEVATION_MSL_M))]
    altitude_msl_m: f64,
}

/// The runway that a sweep uses: the built-in one with the sweep's overrides, or one that the sweep defines completely.
pub(super) fn runway(
    icao: &str,
    name: &str,
    airports: &BTreeMap<String, AirportTable>,
) -> Checked<Runway> {
    let table = airports
        .get(icao)
        .and_then(|airport| airport.runway.get(name));
    let known = airports::bundled(icao, name);
    let Some(table) = table else {
        return known.ok_or_else(|| unknown(icao, name, airports));
    };
    table
        .complete(icao, name, known.as_ref())
        .map_err(|missing| Fault {
            key: format!("airport.{icao}.runway.{name}"),
            message: format!(
                "{missing} is missing: the program does not know this runway, so the sweep must define it completely"
            ),
        })
}

impl RunwayTable {
    /// The runway, completed from the built-in one; or the name of the first missing value.
    pub(crate) fn complete(
        &self,
        icao: &str,
        name: &str,
        known: Option<&Runway>,
    ) -> Result<Runway, &'static str> {
        let threshold = self.threshold.map(|t| Geodetic {
            latitude_deg: t.latitude_deg,
            longitude_deg: t.longitude_deg,
            altitude_msl_m: t.altitude_msl_m,
        });
        // The built-in pavement does not belong to a runway that the sweep places itself.
        let pavement = known.filter(|_| self.threshold.is_none());
        let needed = |own: Option<f64>, of: fn(&Runway) -> f64, missing: &'static str| {
            own.or(known.map(of)).ok_or(missing)
        };
        Ok(Runway {
            airport: icao.into(),
            name: name.into(),
            threshold: threshold
                .or(known.map(|k| k.threshold))
                .ok_or("threshold")?,
            course_true_deg: needed(
                self.course_true_deg,
                |k| k.course_true_deg,
                "course_true_deg",
            )?,
            glide_path_deg: needed(self.glide_path_deg, |k| k.glide_path_deg, "glide_path_deg")?,
            touchdown_past_threshold_m: needed(
                self.touchdown_past_threshold_m,
                |k| k.touchdown_past_threshold_m,
                "touchdown_past_threshold_m",
            )?,
            ils_frequency_mhz: self
                .ils_frequency_mhz
                .or(known.and_then(|k| k.ils_frequency_mhz)),
            course_magnetic_deg: self
                .course_magnetic_deg
                .or(known.and_then(|k| k.course_magnetic_deg)),
            length_m: self.length_m.or(pavement.and_then(|k| k.length_m)),
            width_m: self.width_m.or(pavement.and_then(|k| k.width_m)),
        })
    }
}

fn unknown(icao: &str, name: &str, airports: &BTreeMap<String, AirportTable>) -> Fault {
    let defined = airports
        .iter()
        .flat_map(|(airport, table)| table.runway.keys().map(move |r| format!("{airport} {r}")));
    let bundled = airports::all().map(|(airport, runway)| format!("{airport} {runway}"));
    let all = list(bundled.chain(defined));
    let airport_is_known =
        airports.contains_key(icao) || airports::all().any(|(airport, _)| airport == icao);
    let (key, what) = if airport_is_known {
        ("approach.runway", format!("runway {name:?} of {icao}"))
    } else {
        ("approach.airport", format!("airport {icao:?}"))
    };
    Fault {
        key: key.into(),
        message: format!(
            "{what} is not known; known are {all}; define it in [airport.{icao}.runway.{name}]"
        ),
    }
}
