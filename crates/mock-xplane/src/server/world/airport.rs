//! The only airport of the stand-in's world: WSSS, with runway 02L.

use dataset::geometry::pose::Pose;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;

/// The stand-in's ground has the elevation of WSSS 02L everywhere.
pub(in crate::server) const GROUND_MSL_M: f64 = 6.71;
/// Pose on the threshold, with the wheels on the ground.
pub(crate) const ON_THRESHOLD: Pose = Pose {
    latitude_deg: 1.348_971_96,
    longitude_deg: 103.977_501_24,
    altitude_msl_m: GROUND_MSL_M + airframe::WHEEL_HEIGHT_BELOW_CG_M,
    heading_true_deg: 23.02,
    pitch_deg: 0.0,
    roll_deg: 0.0,
};
const FAR_AWAY_NM: f64 = 500.0;
#[cfg(test)]
const GLIDE_PATH_DEG: f64 = 3.0;

/// Pose of a forgotten aircraft: 500 NM to the north, on the ground.
pub(crate) fn far_away() -> Pose {
    let threshold = ON_THRESHOLD.position().lat_lon();
    let place = threshold.destination(0.0, FAR_AWAY_NM * METERS_PER_NAUTICAL_MILE);
    ON_THRESHOLD.moved_to(place.at_altitude_m(ON_THRESHOLD.altitude_msl_m))
}

/// Pose on the extended centreline and the glide path, this far before the threshold.
#[cfg(test)]
pub(crate) fn on_final(distance_nm: f64) -> Pose {
    let distance_m = distance_nm * METERS_PER_NAUTICAL_MILE;
    let threshold = ON_THRESHOLD.position().lat_lon();
    let place = threshold.destination(ON_THRESHOLD.heading_true_deg + 180.0, distance_m);
    let above_m = distance_m * GLIDE_PATH_DEG.to_radians().tan();
    ON_THRESHOLD.moved_to(place.at_altitude_m(ON_THRESHOLD.altitude_msl_m + above_m))
}
