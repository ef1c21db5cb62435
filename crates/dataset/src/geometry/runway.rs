//! A runway, its touchdown target, and an aircraft's position relative to it.

use serde::{Deserialize, Serialize};

use crate::geometry::geodesy::{Geodetic, LatLon};
use crate::numbers::limits::{self, Check, check_fields};

/// A landing runway as a scenario uses it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Runway {
    /// ICAO code of the airport.
    pub airport: String,
    /// Designator, e.g. `02L`.
    pub name: String,
    /// The landing threshold on the centreline.
    pub threshold: Geodetic,
    /// Landing course, degrees true, on the WGS-84 ellipsoid at the threshold.
    pub course_true_deg: f64,
    /// Glide path angle, degrees.
    pub glide_path_deg: f64,
    /// Distance of the touchdown target past the threshold along the centreline, metres.
    pub touchdown_past_threshold_m: f64,
    /// Frequency of the instrument landing system, MHz, if there is one.
    pub ils_frequency_mhz: Option<f64>,
    /// Magnetic course of the localizer as a pilot would set it, degrees.
    pub course_magnetic_deg: Option<f64>,
    /// Length of the pavement from the landing threshold on, metres, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_m: Option<f64>,
    /// Width of the pavement, metres, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width_m: Option<f64>,
}

/// Position relative to the touchdown target: geodesic polar coordinates about the target, resolved along the course.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunwayCoordinates {
    /// Geodesic distance to the touchdown target over ground, metres. Never negative.
    pub dtd_m: f64,
    /// Remaining distance along the course: positive before the target, negative past it, metres.
    pub along_track_m: f64,
    /// Offset from the extended centreline, right of the landing course positive, metres.
    pub cross_track_m: f64,
    /// Height over the touchdown target, metres.
    pub height_over_target_m: f64,
}

impl Runway {
    /// Checks for numbers outside their limits.
    pub fn check(&self, check: &mut Check) {
        check.part("threshold", |check| {
            self.threshold.check(limits::ELEVATION_MSL_M, check);
        });
        check_fields!(check, self, {
            course_true_deg: limits::COURSE_TRUE_DEG,
            glide_path_deg: limits::GLIDE_PATH_DEG,
            touchdown_past_threshold_m: limits::TOUCHDOWN_PAST_THRESHOLD_M,
        });
        check_fields!(
            check,
            self,
            optional {
                ils_frequency_mhz: limits::ILS_MHZ,
                course_magnetic_deg: limits::COURSE_MAGNETIC_DEG,
                length_m: limits::RUNWAY_LENGTH_M,
                width_m: limits::RUNWAY_WIDTH_M,
            }
        );
    }

    /// The touchdown target: on the centreline, `touchdown_past_threshold_m` past the threshold, at the threshold's elevation.
    pub fn touchdown_target(&self) -> Geodetic {
        self.threshold
            .lat_lon()
            .destination(self.course_true_deg, self.touchdown_past_threshold_m)
            .at_altitude_m(self.threshold.altitude_msl_m)
    }

    /// The point `along_track_m` before the touchdown target and `cross_track_m` right of the course. The inverse of
    /// [`RunwayCoordinates::of`].
    pub fn point_on_approach(&self, along_track_m: f64, cross_track_m: f64) -> LatLon {
        let azimuth = self.course_true_deg + cross_track_m.atan2(-along_track_m).to_degrees();
        self.touchdown_target()
            .lat_lon()
            .destination(azimuth, along_track_m.hypot(cross_track_m))
    }
}

impl RunwayCoordinates {
    /// Coordinates of `position` about `target`, with the landing course at the target.
    pub fn of(position: Geodetic, target: Geodetic, course_true_deg: f64) -> Self {
        let dtd_m = target.lat_lon().distance_m(position.lat_lon());
        let off_course =
            (target.lat_lon().azimuth_to_deg(position.lat_lon()) - course_true_deg).to_radians();
        Self {
            dtd_m,
            along_track_m: -dtd_m * off_course.cos(),
            cross_track_m: dtd_m * off_course.sin(),
            height_over_target_m: position.altitude_msl_m - target.altitude_msl_m,
        }
    }

    /// True where an aircraft may touch down on this runway.
    pub fn may_be_touchdown(&self) -> bool {
        // Within half of the longest runway, and of the widest.
        self.dtd_m <= limits::RUNWAY_LENGTH_M.most / 2.0
            && self.cross_track_m.abs() <= limits::RUNWAY_WIDTH_M.most / 2.0
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The runway of all tests. `testkit` reads the same file; its `Runway` cannot be used here, because it belongs to another build of
    /// `dataset` than the one under test.
    pub(crate) fn changi_02l() -> Runway {
        serde_json::from_str(include_str!("../../../testkit/src/changi_02l.json")).unwrap()
    }

    #[test]
    fn changi_target_lies_where_the_glide_path_meets_the_runway() {
        let target = changi_02l().touchdown_target();
        let published = LatLon {
            latitude_deg: 1.351_803,
            longitude_deg: 103.978_697,
        };
        assert!(target.lat_lon().distance_m(published) < 1.0);
    }

    #[test]
    fn touchdown_point_has_zero_distance() {
        let runway = changi_02l();
        let target = runway.touchdown_target();
        assert_eq!(
            RunwayCoordinates::of(target, target, runway.course_true_deg).dtd_m,
            0.0
        );
    }

    #[test]
    fn an_aircraft_right_of_course_has_positive_cross_track_and_comes_back() {
        let runway = changi_02l();
        for (along, cross) in [
            (18_520.0, 0.0),
            (9_000.0, 120.0),
            (5_000.0, -300.0),
            (-200.0, 10.0),
        ] {
            let at = runway.point_on_approach(along, cross).at_altitude_m(300.0);
            let found =
                RunwayCoordinates::of(at, runway.touchdown_target(), runway.course_true_deg);
            assert!((found.along_track_m - along).abs() < 1e-6, "{found:?}");
            assert!((found.cross_track_m - cross).abs() < 1e-6, "{found:?}");
        }
        // Right of the north-north-easterly course is south-east: a larger longitude.
        assert!(
            runway.point_on_approach(5_000.0, 300.0).longitude_deg
                > runway.point_on_approach(5_000.0, 0.0).longitude_deg
        );
    }
}
