//! Runways that need no definition in a sweep.

use dataset::geodesy::Geodetic;
use dataset::runway::Runway;

/// The runway that the program knows under these names. Sources: threshold and pavement from the X-Plane Scenery Gateway, course on
/// WGS-84 between thresholds and between localizers (23.015 to 23.028; the often quoted 22.89 is spherical and puts the path
/// 42 m aside at 10 NM), glide path antenna 340.1 m past the threshold, which is where the 3 degree path meets the runway.
pub fn bundled(airport: &str, runway: &str) -> Option<Runway> {
    match (airport, runway) {
        ("WSSS", "02L") => Some(Runway {
            airport: airport.into(),
            name: runway.into(),
            threshold: Geodetic {
                latitude_deg: 1.348_971_96,
                longitude_deg: 103.977_501_24,
                altitude_msl_m: 6.71,
            },
            course_true_deg: 23.02,
            glide_path_deg: 3.0,
            touchdown_past_threshold_m: 340.1,
            ils_frequency_mhz: Some(110.9),
            course_magnetic_deg: Some(23.0),
        }),
        _ => None,
    }
}

/// All of them: airport and runway.
pub const BUNDLED: [(&str, &str); 1] = [("WSSS", "02L")];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_listed_runway_is_there_under_its_own_name() {
        for (airport, name) in BUNDLED {
            let runway = bundled(airport, name).unwrap();
            assert_eq!(
                (runway.airport.as_str(), runway.name.as_str()),
                (airport, name)
            );
        }
    }
}
