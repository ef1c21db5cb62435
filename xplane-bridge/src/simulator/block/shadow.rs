//! Position of the aircraft's shadow in an image.
//!
//! The sun's direction by Spencer's series (1971), which is right to half a degree; the ground is level, as around a runway.

use dataset::conditions::Clock;
use dataset::geometry::camera::{Camera, CameraPose};
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::pose::Pose;
use glam::{DVec2, DVec3};

use super::aircraft_place::{Extent, corners};
use crate::pixels::Rectangle;

/// A lower sun casts shadows that are too long and too weak to matter.
const MIN_SUN_DEG: f64 = 4.0;
/// Possible error from the sun's direction and the ground's slope, as a share of the way from the aircraft to its shadow.
const UNSURE: f64 = 0.02;

/// Unit vector towards the sun: north, east, down.
fn to_sun(clock: &Clock, latitude_deg: f64, longitude_deg: f64) -> DVec3 {
    let hour = clock.zulu_time_s / 3_600.0;
    let year =
        std::f64::consts::TAU / 365.0 * (f64::from(clock.day_of_year) - 1.0 + (hour - 12.0) / 24.0);
    let (sin, cos) = year.sin_cos();
    let (sin2, cos2) = (2.0 * year).sin_cos();
    let (sin3, cos3) = (3.0 * year).sin_cos();
    let declination = 0.006_918 - 0.399_912 * cos + 0.070_257 * sin - 0.006_758 * cos2
        + 0.000_907 * sin2
        - 0.002_697 * cos3
        + 0.001_480 * sin3;
    let equation_min = 229.18
        * (0.000_075 + 0.001_868 * cos - 0.032_077 * sin - 0.014_615 * cos2 - 0.040_849 * sin2);
    let solar_min = clock.zulu_time_s / 60.0 + equation_min + 4.0 * longitude_deg;
    let (sin_hour, cos_hour) = (solar_min / 4.0 - 180.0).to_radians().sin_cos();
    let (sin_latitude, cos_latitude) = latitude_deg.to_radians().sin_cos();
    let (sin_decl, cos_decl) = declination.sin_cos();
    DVec3::new(
        sin_decl * cos_latitude - cos_decl * sin_latitude * cos_hour,
        -cos_decl * sin_hour,
        -(sin_latitude * sin_decl + cos_latitude * cos_decl * cos_hour),
    )
}

/// Rectangle of the aircraft's shadow on the ground, cut off at the image's edges; `None` if it is outside, or the sun is too low.
pub(super) fn shadow_place(
    placed: &CameraPose,
    (width_px, height_px): (u32, u32),
    pose: &Pose,
    clock: &Clock,
    ground_msl_m: f64,
) -> Option<Rectangle> {
    let camera = Camera::from_pose(placed, width_px, height_px);
    let position = pose.position();
    let sun_ned = to_sun(clock, position.latitude_deg, position.longitude_deg);
    if -sun_ned.z < MIN_SUN_DEG.to_radians().sin() {
        return None;
    }
    let sun_ecef = position.ecef_from_ned() * sun_ned;
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for corner in corners(pose) {
        let up_m = Geodetic::from_ecef(corner).altitude_msl_m - ground_msl_m;
        for share in [1.0 - UNSURE, 1.0 + UNSURE] {
            let way_m = up_m.max(0.0) / -sun_ned.z * share;
            let at = camera.project(corner - sun_ecef * way_m)?;
            (low, high) = (low.min(at), high.max(at));
        }
    }
    let (low, high) = (low.floor(), high.ceil());
    Extent { low, high }.cut_off(width_px, height_px)
}

#[cfg(test)]
mod tests {
    use super::super::aircraft_place::aircraft_place;
    use super::*;

    #[test]
    fn at_noon_in_june_the_sun_is_in_the_south_and_62_degrees_high_over_greenwich() {
        let noon = Clock {
            day_of_year: 172,
            zulu_time_s: 43_200.0,
        };
        let sun = to_sun(&noon, 51.48, 0.0);
        let elevation_deg = (-sun.z).asin().to_degrees();
        let azimuth_deg = sun.y.atan2(sun.x).to_degrees().rem_euclid(360.0);
        assert!((elevation_deg - 61.96).abs() < 0.5, "{elevation_deg}");
        assert!((azimuth_deg - 180.0).abs() < 1.5, "{azimuth_deg}");
        assert!((sun.length() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_shadow_lies_below_the_aircraft_by_day_and_nowhere_by_night() {
        let pose = |latitude_deg, altitude_msl_m, heading_true_deg| Pose {
            latitude_deg,
            longitude_deg: 0.0,
            altitude_msl_m,
            heading_true_deg,
            pitch_deg: 0.0,
            roll_deg: 0.0,
        };
        let camera = CameraPose {
            pose: pose(0.0, 60.0, 0.0),
            hfov_deg: 30.0,
        };
        let (size_px, aircraft) = ((480, 320), pose(0.01, 60.0, 180.0));
        let shadow = |hour: f64| {
            let clock = Clock {
                day_of_year: 81,
                zulu_time_s: hour * 3_600.0,
            };
            shadow_place(&camera, size_px, &aircraft, &clock, 0.0)
        };
        let own = aircraft_place(&camera, size_px, &aircraft).unwrap();
        let below = shadow(12.0).unwrap();
        assert!(below.y_px > own.bottom_px(), "{below} under {own}");
        let middle = |place: Rectangle| place.x_px + place.width_px / 2;
        assert!(
            middle(below).abs_diff(middle(own)) < 12,
            "{below} under {own}"
        );
        assert_eq!(shadow(0.0), None);
    }
}
