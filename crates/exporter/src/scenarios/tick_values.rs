//! Values of a tick that tables have as columns.

use dataset::tables::frames::{TickLabels, TickRow};

/// Columns, each with its value.
type Columns<T, const N: usize> = [(&'static str, fn(&T) -> f64); N];

/// Pose, motion and controls.
pub(crate) const FLOWN: Columns<TickRow, 12> = [
    ("latitude_deg", |row| row.pose.latitude_deg),
    ("longitude_deg", |row| row.pose.longitude_deg),
    ("altitude_msl_m", |row| row.pose.altitude_msl_m),
    ("heading_true_deg", |row| row.pose.heading_true_deg),
    ("pitch_deg", |row| row.pose.pitch_deg),
    ("roll_deg", |row| row.pose.roll_deg),
    ("velocity_north_mps", |row| row.velocity_ned_mps[0]),
    ("velocity_east_mps", |row| row.velocity_ned_mps[1]),
    ("velocity_down_mps", |row| row.velocity_ned_mps[2]),
    ("true_airspeed_mps", |row| row.true_airspeed_mps),
    ("flap_ratio", |row| row.controls.flap_ratio),
    ("gear_ratio", |row| row.controls.gear_ratio),
];

/// Labels.
pub(crate) const LABELLED: Columns<TickLabels, 4> = [
    ("dtd_m", |labels| labels.dtd_m),
    ("along_track_m", |labels| labels.along_track_m),
    ("cross_track_m", |labels| labels.cross_track_m),
    ("height_over_target_m", |labels| labels.height_over_target_m),
];
