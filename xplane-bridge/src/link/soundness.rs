//! Range checks of requests: a server runs them before it flies or draws anything.

use dataset::approach_profile::ApproachProfile;
use dataset::geodesy::Geodetic;
use dataset::runway::Runway;

use super::Request;
use crate::fly::FlyRequest;

/// Altitudes of aircraft and ground, metres.
const ALTITUDES_M: [f64; 2] = [-500.0, 30_000.0];
/// Maximum distance of anything of an approach from its runway, metres.
const LENGTHS_M: [f64; 2] = [-1e6, 1e6];
const ANGLES_DEG: [f64; 2] = [-720.0, 720.0];

/// A number out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{key} is {found}, expected {low} to {high}")]
pub struct OutOfRange {
    key: &'static str,
    found: f64,
    low: f64,
    high: f64,
}

impl Request {
    /// Rejects an impossible runway or flight. Captures have further checks: [`super::CaptureRequest::check`].
    pub fn check(&self) -> Result<(), OutOfRange> {
        match self {
            Self::Freeze { runway, .. } => check_runway(runway),
            Self::Fly(request) => check_flight(request),
            _ => Ok(()),
        }
    }
}

fn within(key: &'static str, found: f64, [low, high]: [f64; 2]) -> Result<(), OutOfRange> {
    // False for NaN.
    if found >= low && found <= high {
        return Ok(());
    }
    Err(OutOfRange {
        key,
        found,
        low,
        high,
    })
}

fn check_place(place: &Geodetic) -> Result<(), OutOfRange> {
    within("latitude_deg", place.latitude_deg, [-90.0, 90.0])?;
    within("longitude_deg", place.longitude_deg, [-360.0, 360.0])?;
    within("altitude_msl_m", place.altitude_msl_m, ALTITUDES_M)
}

fn check_runway(runway: &Runway) -> Result<(), OutOfRange> {
    check_place(&runway.threshold)?;
    within("course_true_deg", runway.course_true_deg, ANGLES_DEG)?;
    within("glide_path_deg", runway.glide_path_deg, [0.5, 15.0])?;
    within(
        "touchdown_past_threshold_m",
        runway.touchdown_past_threshold_m,
        LENGTHS_M,
    )
}

fn check_flight(request: &FlyRequest) -> Result<(), OutOfRange> {
    check_runway(&request.runway)?;
    check_place(&request.start.position)?;
    within(
        "heading_true_deg",
        request.start.heading_true_deg,
        ANGLES_DEG,
    )?;
    within("speed_mps", request.start.speed_mps, [30.0, 400.0])?;
    within("time_limit_s", request.time_limit_s, [1.0, 86_400.0])?;
    match request.profile {
        ApproachProfile::GlidePath {
            level_altitude_msl_m,
        } => within("level_altitude_msl_m", level_altitude_msl_m, ALTITUDES_M),
        ApproachProfile::StepDown {
            upper_altitude_msl_m,
            step_from_threshold_m,
            lower_altitude_msl_m,
        } => {
            within("upper_altitude_msl_m", upper_altitude_msl_m, ALTITUDES_M)?;
            within("lower_altitude_msl_m", lower_altitude_msl_m, ALTITUDES_M)?;
            within("step_from_threshold_m", step_from_threshold_m, LENGTHS_M)
        }
        ApproachProfile::ContinuousDescent {
            start_altitude_msl_m,
        } => within("start_altitude_msl_m", start_altitude_msl_m, ALTITUDES_M),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flight_with_a_number_that_cannot_be_is_refused_by_its_key() {
        let sound = r#"{"message":"fly","seed":0,"time_limit_s":900,
            "start":{"position":{"latitude_deg":1,"longitude_deg":104,"altitude_msl_m":762},"heading_true_deg":23,"speed_mps":80},
            "runway":{"airport":"WSSS","name":"02L","threshold":{"latitude_deg":1.35,"longitude_deg":103.98,"altitude_msl_m":6.7},
                "course_true_deg":23.0,"glide_path_deg":3,"touchdown_past_threshold_m":340,"ils_frequency_mhz":null,"course_magnetic_deg":null},
            "profile":{"kind":"glide_path","level_altitude_msl_m":763}}"#;
        let check = |text: &str| serde_json::from_str::<Request>(text).unwrap().check();
        assert_eq!(check(sound), Ok(()));
        for (key, from, to) in [
            ("time_limit_s", "900", "1e308"),
            ("speed_mps", "80", "0"),
            (
                "latitude_deg",
                "\"latitude_deg\":1,",
                "\"latitude_deg\":91,",
            ),
            ("altitude_msl_m", "762", "1e308"),
            (
                "glide_path_deg",
                "\"glide_path_deg\":3",
                "\"glide_path_deg\":-1e17",
            ),
            ("course_true_deg", "23.0", "1e300"),
            ("level_altitude_msl_m", "763", "-1e9"),
        ] {
            let refused = check(&sound.replacen(from, to, 1)).unwrap_err();
            assert_eq!(refused.key, key);
        }
    }
}
