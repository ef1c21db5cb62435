//! Positions on and above the WGS-84 ellipsoid.
//!
//! Distances over ground are geodesics (Karney 2013, through the `geo` crate); everything that a camera sees uses earth-centred,
//! earth-fixed (ECEF) metres. Heights above mean sea level are taken as heights above the ellipsoid: X-Plane has no geoid. A corpus that
//! uses one must name it in `scenario.json`.

use geo::{Bearing, Destination, Distance, Geodesic, Point};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::numbers::limits::{self, Check, Limits};

/// Semi-major axis of the WGS-84 ellipsoid, metres.
pub const WGS84_SEMI_MAJOR_M: f64 = 6_378_137.0;
/// Flattening of the WGS-84 ellipsoid.
pub const WGS84_FLATTENING: f64 = 1.0 / 298.257_223_563;

const ECCENTRICITY_SQUARED: f64 = WGS84_FLATTENING * (2.0 - WGS84_FLATTENING);

/// A point on the ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LatLon {
    /// Geodetic latitude, degrees, north positive.
    pub latitude_deg: f64,
    /// Longitude, degrees, east positive.
    pub longitude_deg: f64,
}

/// A point with a height.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Geodetic {
    /// Geodetic latitude, degrees, north positive.
    pub latitude_deg: f64,
    /// Longitude, degrees, east positive.
    pub longitude_deg: f64,
    /// Height above mean sea level, taken as height above the ellipsoid, metres.
    pub altitude_msl_m: f64,
}

impl Geodetic {
    /// Checks for numbers outside their limits.
    pub fn check(&self, altitude_msl_m: Limits, check: &mut Check) {
        check.number("latitude_deg", self.latitude_deg, limits::LATITUDE_DEG);
        check.number("longitude_deg", self.longitude_deg, limits::LONGITUDE_DEG);
        check.number("altitude_msl_m", self.altitude_msl_m, altitude_msl_m);
    }
}

impl LatLon {
    /// Geodesic distance to `other`, metres.
    pub fn distance_m(self, other: Self) -> f64 {
        Geodesic.distance(self.point(), other.point())
    }

    /// Azimuth of the geodesic to `other` where it starts, degrees true in [0, 360).
    pub fn azimuth_to_deg(self, other: Self) -> f64 {
        Geodesic.bearing(self.point(), other.point())
    }

    /// The point `distance_m` metres along the geodesic that leaves at `azimuth_deg` (true). Negative distances go backwards.
    pub fn destination(self, azimuth_deg: f64, distance_m: f64) -> Self {
        let point = Geodesic.destination(self.point(), azimuth_deg, distance_m);
        Self {
            latitude_deg: point.y(),
            longitude_deg: point.x(),
        }
    }

    /// The point at a height.
    pub fn at_altitude_m(self, altitude_msl_m: f64) -> Geodetic {
        Geodetic {
            latitude_deg: self.latitude_deg,
            longitude_deg: self.longitude_deg,
            altitude_msl_m,
        }
    }

    fn point(self) -> Point<f64> {
        Point::new(self.longitude_deg, self.latitude_deg)
    }
}

impl Geodetic {
    /// The point directly below on the ellipsoid.
    pub fn lat_lon(self) -> LatLon {
        LatLon {
            latitude_deg: self.latitude_deg,
            longitude_deg: self.longitude_deg,
        }
    }

    /// ECEF coordinates, metres.
    pub fn to_ecef(self) -> DVec3 {
        let (sin_lat, cos_lat) = self.latitude_deg.to_radians().sin_cos();
        let (sin_lon, cos_lon) = self.longitude_deg.to_radians().sin_cos();
        let prime_vertical =
            WGS84_SEMI_MAJOR_M / (1.0 - ECCENTRICITY_SQUARED * sin_lat * sin_lat).sqrt();
        let h = self.altitude_msl_m;
        DVec3::new(
            (prime_vertical + h) * cos_lat * cos_lon,
            (prime_vertical + h) * cos_lat * sin_lon,
            (prime_vertical * (1.0 - ECCENTRICITY_SQUARED) + h) * sin_lat,
        )
    }

    /// The point with these ECEF coordinates (fixed-point iteration on the latitude; exact to below a nanometre for heights within +-100 km
    /// of the surface, away from the poles).
    pub fn from_ecef(ecef: DVec3) -> Self {
        let p = ecef.x.hypot(ecef.y);
        let longitude = ecef.y.atan2(ecef.x);
        let mut latitude = ecef.z.atan2(p * (1.0 - ECCENTRICITY_SQUARED));
        let mut height = 0.0;
        for _ in 0..8 {
            let (sin_lat, cos_lat) = latitude.sin_cos();
            let prime_vertical =
                WGS84_SEMI_MAJOR_M / (1.0 - ECCENTRICITY_SQUARED * sin_lat * sin_lat).sqrt();
            // This formula for the height has no 0/0, neither at the equator nor near a pole.
            height = p * cos_lat + ecef.z * sin_lat
                - WGS84_SEMI_MAJOR_M * WGS84_SEMI_MAJOR_M / prime_vertical;
            latitude = ecef.z.atan2(
                p * (1.0 - ECCENTRICITY_SQUARED * prime_vertical / (prime_vertical + height)),
            );
        }
        Self {
            latitude_deg: latitude.to_degrees(),
            longitude_deg: longitude.to_degrees(),
            altitude_msl_m: height,
        }
    }

    /// Rotation whose columns are north, east and down at this point, in ECEF.
    pub fn ecef_from_ned(self) -> DMat3 {
        let (sin_lat, cos_lat) = self.latitude_deg.to_radians().sin_cos();
        let (sin_lon, cos_lon) = self.longitude_deg.to_radians().sin_cos();
        DMat3::from_cols(
            DVec3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat),
            DVec3::new(-sin_lon, cos_lon, 0.0),
            DVec3::new(-cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHANGI: Geodetic = Geodetic {
        latitude_deg: 1.35,
        longitude_deg: 103.98,
        altitude_msl_m: 6.71,
    };

    #[test]
    fn ecef_of_published_point_is_met() {
        // NIMA TR8350.2 style check point: 0 N 0 E at 0 m lies on the x axis at the semi-major axis.
        let origin = Geodetic {
            latitude_deg: 0.0,
            longitude_deg: 0.0,
            altitude_msl_m: 0.0,
        };
        assert!(
            origin
                .to_ecef()
                .abs_diff_eq(DVec3::new(WGS84_SEMI_MAJOR_M, 0.0, 0.0), 1e-9)
        );
        // Polar radius of WGS-84: 6356752.3142 m.
        let pole = Geodetic {
            latitude_deg: 90.0,
            longitude_deg: 0.0,
            altitude_msl_m: 0.0,
        };
        assert!((pole.to_ecef().z - 6_356_752.314_2).abs() < 1e-4);
    }

    #[test]
    fn ecef_goes_there_and_back_within_a_micrometre() {
        for height in [-50.0, 0.0, 800.0, 20_000.0] {
            for latitude in [-60.0, -1.35, 0.0, 1.35, 48.0] {
                let point = Geodetic {
                    latitude_deg: latitude,
                    altitude_msl_m: height,
                    ..CHANGI
                };
                let back = Geodetic::from_ecef(point.to_ecef());
                assert!(
                    back.to_ecef().distance(point.to_ecef()) < 1e-6,
                    "{point:?} came back as {back:?}"
                );
            }
        }
    }

    #[test]
    fn ned_axes_are_a_right_handed_rotation() {
        let axes = CHANGI.ecef_from_ned();
        assert!((axes.determinant() - 1.0).abs() < 1e-12);
        let up_one = Geodetic {
            altitude_msl_m: CHANGI.altitude_msl_m + 1.0,
            ..CHANGI
        };
        assert!((up_one.to_ecef() - CHANGI.to_ecef()).abs_diff_eq(-axes.z_axis, 1e-8));
    }

    #[test]
    fn destination_lies_at_the_asked_distance_and_azimuth() {
        let start = CHANGI.lat_lon();
        let end = start.destination(203.02, 18_520.0);
        assert!((start.distance_m(end) - 18_520.0).abs() < 1e-6);
        assert!((start.azimuth_to_deg(end) - 203.02).abs() < 1e-9);
    }
}
