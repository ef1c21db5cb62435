//! Range checks of requests: a server runs them before it flies or draws anything.

use dataset::corpus::scenario::MAX_TRAFFIC;
use dataset::geometry::approach_profile::ApproachProfile;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::runway::Runway;
use dataset::numbers::limits;

use super::{Request, TrafficPart};
use crate::fly::{FlightStart, FlyRequest};

/// Altitudes of aircraft and ground, metres.
const ALTITUDES_M: [f64; 2] = [-500.0, 30_000.0];
/// Maximum distance between an approach and its runway, metres.
const LENGTHS_M: [f64; 2] = [-1e6, 1e6];
const ANGLES_DEG: [f64; 2] = [-720.0, 720.0];

/// Largest [`Request::KeepProfile`] profile as it is sent, bytes: a hello contains it, and has to stay a header that can be sent.
pub(crate) const MAX_PROFILE_BYTES: usize = 16 << 10;

/// Reason why a request cannot be met.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct UnsoundRequest(String);

impl Request {
    /// Rejects an impossible runway, start or flight, and a profile that is too long. Captures have further checks:
    /// [`super::CaptureRequest::check`].
    pub fn check(&self) -> Result<(), UnsoundRequest> {
        match self {
            Self::Freeze { runway, .. } => check_runway(runway),
            Self::Travel { start, .. } => check_start(start),
            Self::Traffic(part) => check_traffic(part),
            Self::Fly(request) => check_flight(request),
            Self::KeepProfile { profile } => match profile.to_string().len() {
                bytes if bytes > MAX_PROFILE_BYTES => Err(UnsoundRequest(format!(
                    "the profile has {bytes} bytes, expected at most {MAX_PROFILE_BYTES}"
                ))),
                _ => Ok(()),
            },
            _ => Ok(()),
        }
    }
}

fn within(key: &'static str, found: f64, [low, high]: [f64; 2]) -> Result<(), UnsoundRequest> {
    // False for NaN.
    if found >= low && found <= high {
        return Ok(());
    }
    Err(UnsoundRequest(format!(
        "{key} is {found}, expected {low} to {high}"
    )))
}

fn check_place(place: &Geodetic) -> Result<(), UnsoundRequest> {
    within("latitude_deg", place.latitude_deg, [-90.0, 90.0])?;
    within("longitude_deg", place.longitude_deg, [-360.0, 360.0])?;
    within("altitude_msl_m", place.altitude_msl_m, ALTITUDES_M)
}

fn check_runway(runway: &Runway) -> Result<(), UnsoundRequest> {
    check_place(&runway.threshold)?;
    within("course_true_deg", runway.course_true_deg, ANGLES_DEG)?;
    within("glide_path_deg", runway.glide_path_deg, [0.5, 15.0])?;
    within(
        "touchdown_past_threshold_m",
        runway.touchdown_past_threshold_m,
        LENGTHS_M,
    )?;
    if let Some(frequency_mhz) = runway.ils_frequency_mhz {
        let range = [limits::ILS_MHZ.least, limits::ILS_MHZ.most];
        within("ils_frequency_mhz", frequency_mhz, range)?;
    }
    if let Some(course_deg) = runway.course_magnetic_deg {
        within("course_magnetic_deg", course_deg, ANGLES_DEG)?;
    }
    for (field, value, limits) in [
        ("length_m", runway.length_m, limits::RUNWAY_LENGTH_M),
        ("width_m", runway.width_m, limits::RUNWAY_WIDTH_M),
    ] {
        if let Some(value) = value {
            within(field, value, [limits.least, limits.most])?;
        }
    }
    Ok(())
}

fn check_start(start: &FlightStart) -> Result<(), UnsoundRequest> {
    check_place(&start.position)?;
    within("heading_true_deg", start.heading_true_deg, ANGLES_DEG)?;
    within("speed_mps", start.speed_mps, [30.0, 400.0])
}

fn check_traffic(part: &TrafficPart) -> Result<(), UnsoundRequest> {
    within("number", f64::from(part.number), [1.0, MAX_TRAFFIC as f64])?;
    for state in &part.states {
        check_place(&state.pose.position())?;
        within("heading_true_deg", state.pose.heading_true_deg, ANGLES_DEG)?;
        within("pitch_deg", state.pose.pitch_deg, ANGLES_DEG)?;
        within("roll_deg", state.pose.roll_deg, ANGLES_DEG)?;
        within("flap_ratio", state.controls.flap_ratio, [0.0, 1.0])?;
        within("gear_ratio", state.controls.gear_ratio, [0.0, 1.0])?;
    }
    Ok(())
}

fn check_flight(request: &FlyRequest) -> Result<(), UnsoundRequest> {
    check_runway(&request.runway)?;
    check_start(&request.start)?;
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

    fn refused_key(checked: Result<(), UnsoundRequest>) -> String {
        let text = checked.unwrap_err().to_string();
        text.split(" is ").next().unwrap().to_owned()
    }

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
            assert_eq!(refused_key(check(&sound.replacen(from, to, 1))), key);
        }
    }

    #[test]
    fn a_start_somewhere_in_space_is_refused_for_travel_as_for_flights() {
        let travel = |latitude_deg: &str, altitude_msl_m: &str, speed_mps: &str| {
            let text = format!(
                r#"{{"message":"travel","start":{{"position":{{"latitude_deg":{latitude_deg},"longitude_deg":104,
                    "altitude_msl_m":{altitude_msl_m}}},"heading_true_deg":23,"speed_mps":{speed_mps}}}}}"#
            );
            serde_json::from_str::<Request>(&text).unwrap().check()
        };
        assert_eq!(travel("1", "30000", "30"), Ok(()));
        assert_eq!(refused_key(travel("1", "30001", "80")), "altitude_msl_m");
        assert_eq!(refused_key(travel("1", "1e12", "80")), "altitude_msl_m");
        assert_eq!(refused_key(travel("91", "762", "80")), "latitude_deg");
        assert_eq!(refused_key(travel("1", "762", "29.9")), "speed_mps");
    }

    #[test]
    fn a_profile_may_have_16_kib_as_it_is_sent() {
        let keep = |text: String| {
            let profile = serde_json::json!({ "format": text });
            Request::KeepProfile { profile }.check()
        };
        let around = r#"{"format":""}"#.len();
        assert_eq!(keep("x".repeat(MAX_PROFILE_BYTES - around)), Ok(()));
        let beyond = keep("x".repeat(MAX_PROFILE_BYTES - around + 1)).unwrap_err();
        assert!(
            beyond
                .to_string()
                .contains("16385 bytes, expected at most 16384"),
            "{beyond}"
        );
        assert!(keep("é".repeat(20_000)).is_err());
    }
}
