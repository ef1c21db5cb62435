//! From a camera as planned on an airfield to a calibrated one on the earth.
//!
//! Input: a mast beside a runway with its lens, where a scenario aims it, and its placement error. Output: position, direction, lens, air
//! and sensor, as in `calibration.json`.
//!
//! A single function does this: `dtd generate` records with its result, and `dtd verify` compares with it.

use serde::{Deserialize, Serialize};

use super::Picture;
use crate::corpus::calibration::CameraEntry;
use crate::geometry::camera::CameraPose;
use crate::geometry::distortion::Distortion;
use crate::geometry::geodesy::{Geodetic, LatLon};
use crate::geometry::imaging::Imaging;
use crate::geometry::pose::Pose;
use crate::geometry::runway::Runway;
use crate::numbers::limits::{self, Check, check_fields};
use crate::numbers::units::{Degrees, METERS_PER_NAUTICAL_MILE};

/// Up to this latitude, meridians at a runway and its masts are parallel within 0.0006 degrees, and are taken as such: so directions in
/// corpora of Changi stay as they are.
const PARALLEL_MERIDIANS_DEG: f64 = 2.0;

/// A camera on a mast beside the runway, as in a plan's rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlannedCamera {
    /// Identifier of the view: names its video and its columns.
    pub id: String,
    /// Distance past the touchdown target along the landing course, metres. Either this or `beyond_threshold_m`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beyond_touchdown_m: Option<f64>,
    /// Distance past the threshold along the landing course, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beyond_threshold_m: Option<f64>,
    /// Offset right of the landing course, metres; negative is left.
    pub right_m: f64,
    /// Height above the touchdown target, metres.
    pub height_m: f64,
    /// Turn of the optical axis from the reciprocal of the course towards the runway's axis, degrees, measured at the mast. Either this or
    /// `heading_true_deg`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inward_deg: Option<f64>,
    /// Direction of the optical axis, degrees true.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heading_true_deg: Option<f64>,
    /// Elevation of the optical axis, degrees, up positive.
    pub pitch_deg: f64,
    /// Horizontal field of view, degrees.
    pub hfov_deg: f64,
    /// Distortion of the lens; `None` is a pinhole. A scenario's lens is in its [`Imaging`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
}

/// Aim of the scenario's cameras, as drawn.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged, deny_unknown_fields)]
pub enum Aim {
    /// A point of the glide path.
    GlidePath {
        /// Distance of the point to the touchdown target, nautical miles.
        dtd_nm: f64,
    },
    /// A direction.
    Direction {
        /// Degrees true.
        heading_true_deg: f64,
        /// Degrees, up positive.
        pitch_deg: f64,
    },
}

/// Placement error of the scenario's camera, as drawn.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Jitter {
    /// Along the landing course, metres.
    pub along_m: f64,
    /// Right of the landing course, metres.
    pub right_m: f64,
    /// Up, metres.
    pub height_m: f64,
    /// Degrees clockwise.
    pub heading_deg: f64,
    /// Degrees up.
    pub pitch_deg: f64,
    /// Degrees, right side down.
    pub roll_deg: f64,
    /// Degrees of the field of view.
    pub hfov_deg: f64,
}

impl PlannedCamera {
    /// The camera as a scenario has it: placed, aimed, and with its lens, air and sensor.
    pub fn calibrated(
        &self,
        runway: &Runway,
        picture: Picture,
        aim: Option<Aim>,
        jitter: &Jitter,
        imaging: &Imaging,
    ) -> CameraEntry {
        let placed = place_in(self, runway, aim, jitter);
        CameraEntry::from_pose(placed, picture.width_px, picture.height_px).with_imaging(imaging)
    }

    /// Checks for numbers outside their limits.
    pub fn check(&self, check: &mut Check) {
        check_fields!(
            check,
            self,
            optional {
                beyond_touchdown_m: limits::MAST_DISTANCE_M,
                beyond_threshold_m: limits::MAST_DISTANCE_M,
            }
        );
        check_fields!(check, self, {
            right_m: limits::MAST_DISTANCE_M,
            height_m: limits::MAST_HEIGHT_M,
        });
        check_fields!(
            check,
            self,
            optional {
                inward_deg: limits::MAST_TURN_DEG,
                heading_true_deg: limits::MAST_TURN_DEG,
            }
        );
        check_fields!(check, self, {
            pitch_deg: limits::MAST_PITCH_DEG,
            hfov_deg: limits::HFOV_DEG,
        });
    }
}

impl Jitter {
    /// Checks for numbers outside their limits.
    pub fn check(&self, check: &mut Check) {
        check_fields!(check, self, {
            along_m: limits::JITTER_M,
            right_m: limits::JITTER_M,
            height_m: limits::JITTER_M,
            heading_deg: limits::JITTER_DEG,
            pitch_deg: limits::JITTER_DEG,
            roll_deg: limits::JITTER_DEG,
            hfov_deg: limits::JITTER_DEG,
        });
    }
}

/// The scenario's camera position and direction: as in its rig or aimed elsewhere, plus its placement error.
fn place_in(
    camera: &PlannedCamera,
    runway: &Runway,
    aim: Option<Aim>,
    jitter: &Jitter,
) -> CameraPose {
    let moved = PlannedCamera {
        beyond_touchdown_m: camera.beyond_touchdown_m.map(|m| m + jitter.along_m),
        beyond_threshold_m: camera.beyond_threshold_m.map(|m| m + jitter.along_m),
        right_m: camera.right_m + jitter.right_m,
        height_m: camera.height_m + jitter.height_m,
        ..camera.clone()
    };
    let mut placed = place(&moved, runway);
    // Inward is defined by the rig: jitter that moves a mast across the runway's axis does not flip it.
    placed.pose.heading_true_deg = place(camera, runway).pose.heading_true_deg;
    if let Some(aim) = aim {
        // Aimed from its position in the rig: the error applies to a camera that was set up by the plan.
        (placed.pose.heading_true_deg, placed.pose.pitch_deg) =
            direction(aim, place(camera, runway).pose.position(), runway);
    }
    let Pose {
        heading_true_deg,
        pitch_deg,
        roll_deg,
        ..
    } = &mut placed.pose;
    if jitter.heading_deg != 0.0 {
        *heading_true_deg = Degrees(*heading_true_deg + jitter.heading_deg)
            .wrapped_360()
            .0;
    }
    *pitch_deg += jitter.pitch_deg;
    *roll_deg += jitter.roll_deg;
    placed.hfov_deg += jitter.hfov_deg;
    placed
}

/// True direction and elevation of the camera at this place, degrees.
fn direction(aim: Aim, from: Geodetic, runway: &Runway) -> (f64, f64) {
    match aim {
        Aim::Direction {
            heading_true_deg,
            pitch_deg,
        } => (heading_true_deg, pitch_deg),
        Aim::GlidePath { dtd_nm } => {
            let dtd_m = dtd_nm * METERS_PER_NAUTICAL_MILE;
            let height_m = dtd_m * runway.glide_path_deg.to_radians().tan();
            let at = runway
                .point_on_approach(dtd_m, 0.0)
                .at_altitude_m(runway.touchdown_target().altitude_msl_m + height_m);
            let seen = from.ecef_from_ned().transpose() * (at.to_ecef() - from.to_ecef());
            let heading_deg = seen.y.atan2(seen.x).to_degrees();
            let pitch_deg = (-seen.z).atan2(seen.truncate().length()).to_degrees();
            (Degrees(heading_deg).wrapped_360().0, pitch_deg)
        }
    }
}

/// Position and direction of the rig's camera.
fn place(camera: &PlannedCamera, runway: &Runway) -> CameraPose {
    let target = runway.touchdown_target();
    let beyond_target_m = match (camera.beyond_touchdown_m, camera.beyond_threshold_m) {
        (Some(beyond_touchdown_m), _) => beyond_touchdown_m,
        (None, beyond_threshold_m) => {
            beyond_threshold_m.unwrap_or(0.0) - runway.touchdown_past_threshold_m
        }
    };
    let position = runway
        .point_on_approach(-beyond_target_m, camera.right_m)
        .at_altitude_m(target.altitude_msl_m + camera.height_m);
    let back = runway.course_true_deg + 180.0 + convergence_deg(runway, position.lat_lon());
    // Looking back along the course, cameras left of the course have the runway's axis on their left.
    let turned = back + clockwise_deg(camera.inward_deg.unwrap_or(0.0), camera.right_m);
    let heading = camera.heading_true_deg.unwrap_or(turned);
    CameraPose {
        pose: Pose {
            latitude_deg: position.latitude_deg,
            longitude_deg: position.longitude_deg,
            altitude_msl_m: position.altitude_msl_m,
            heading_true_deg: Degrees(heading).wrapped_360().0,
            pitch_deg: camera.pitch_deg,
            roll_deg: 0.0,
        },
        hfov_deg: camera.hfov_deg,
    }
}

/// Turn of north from the touchdown target to a mast, degrees: a direction that stays parallel to the runway has a different azimuth there.
fn convergence_deg(runway: &Runway, mast: LatLon) -> f64 {
    let target = runway.touchdown_target().lat_lon();
    if !meridians_converge(runway) || target == mast {
        return 0.0;
    }
    let leaves_deg = target.azimuth_to_deg(mast);
    let arrives_deg = mast.azimuth_to_deg(target) + 180.0;
    Degrees(arrives_deg - leaves_deg).wrapped_180().0
}

/// True where north turns from a runway to its masts.
pub(super) fn meridians_converge(runway: &Runway) -> bool {
    runway.threshold.latitude_deg.abs() >= PARALLEL_MERIDIANS_DEG
}

/// A turn towards the runway's axis is clockwise for cameras on the right and anticlockwise on the left. A camera on the axis has no inward
/// side.
fn clockwise_deg(inward_deg: f64, right_m: f64) -> f64 {
    if right_m == 0.0 {
        0.0
    } else {
        inward_deg * right_m.signum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::camera::Camera as Pinhole;
    use crate::geometry::runway::tests::changi_02l;

    fn mast(id: &str, right_m: f64) -> PlannedCamera {
        PlannedCamera {
            id: id.into(),
            beyond_touchdown_m: Some(1_500.0),
            beyond_threshold_m: None,
            right_m,
            height_m: 10.0,
            inward_deg: Some(5.3),
            heading_true_deg: None,
            pitch_deg: 1.6,
            hfov_deg: 10.0,
            distortion: None,
        }
    }

    #[test]
    fn a_camera_that_is_aimed_at_the_glide_path_has_that_point_in_the_middle_of_its_picture() {
        let runway = changi_02l();
        for dtd_nm in [0.5, 3.0, 9.0] {
            let aim = Some(Aim::GlidePath { dtd_nm });
            let placed = place_in(&mast("left", -300.0), &runway, aim, &Jitter::default());
            let dtd_m = dtd_nm * METERS_PER_NAUTICAL_MILE;
            let at = runway.point_on_approach(dtd_m, 0.0).at_altitude_m(
                runway.touchdown_target().altitude_msl_m + dtd_m * 3.0_f64.to_radians().tan(),
            );
            let pixel = Pinhole::from_pose(&placed, 1920, 1280)
                .project(at.to_ecef())
                .unwrap();
            assert!(
                pixel.distance(glam::DVec2::new(959.5, 639.5)) < 1e-3,
                "{pixel}"
            );
        }
        let direction = Aim::Direction {
            heading_true_deg: 190.0,
            pitch_deg: 2.5,
        };
        let placed = place_in(
            &mast("left", -300.0),
            &runway,
            Some(direction),
            &Jitter::default(),
        );
        assert_eq!(
            (placed.pose.heading_true_deg, placed.pose.pitch_deg),
            (190.0, 2.5)
        );
    }

    #[test]
    fn jitter_moves_and_turns_a_camera_by_what_was_drawn_and_none_changes_nothing() {
        let runway = changi_02l();
        let camera = mast("left", -300.0);
        let rig = place(&camera, &runway);
        assert_eq!(place_in(&camera, &runway, None, &Jitter::default()), rig);
        let jitter = Jitter {
            along_m: 1.0,
            right_m: -2.0,
            height_m: 0.5,
            heading_deg: -0.2,
            pitch_deg: 0.1,
            roll_deg: 0.3,
            hfov_deg: -0.05,
        };
        let off = place_in(&camera, &runway, None, &jitter);
        let moved_m = off
            .pose
            .position()
            .to_ecef()
            .distance(rig.pose.position().to_ecef());
        assert!((moved_m - 5.25_f64.sqrt()).abs() < 1e-3, "{moved_m}");
        let close = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert!(close(
            off.pose.heading_true_deg,
            rig.pose.heading_true_deg - 0.2
        ));
        assert!(close(off.pose.pitch_deg, 1.7) && close(off.pose.roll_deg, 0.3));
        assert!(close(off.hfov_deg, 9.95));
    }

    #[test]
    fn a_mast_that_jitter_takes_over_the_axis_keeps_looking_where_it_did() {
        let runway = changi_02l();
        let camera = mast("near", 1.0);
        let jitter = Jitter {
            right_m: -3.0,
            ..Jitter::default()
        };
        let [rig, off] = [
            place(&camera, &runway),
            place_in(&camera, &runway, None, &jitter),
        ];
        assert_eq!(rig.pose.heading_true_deg, off.pose.heading_true_deg);
    }

    #[test]
    fn both_cameras_see_the_glide_path_from_ten_miles_to_a_tenth_and_mirror_each_other() {
        let runway = changi_02l();
        let [left, right] = [("left", -300.0), ("right", 300.0)]
            .map(|(id, side)| Pinhole::from_pose(&place(&mast(id, side), &runway), 1920, 1280));
        for dtd_nm in [10.0, 7.6, 5.0, 2.0, 0.5, 0.1] {
            let dtd_m = dtd_nm * 1_852.0;
            let height_m =
                (dtd_m * 3.0_f64.to_radians().tan()).min(755.0) + runway.threshold.altitude_msl_m;
            let aircraft = runway
                .point_on_approach(dtd_m, 0.0)
                .at_altitude_m(height_m)
                .to_ecef();
            let [a, b] = [&left, &right].map(|camera| camera.project(aircraft).unwrap());
            for pixel in [a, b] {
                assert!(
                    (20.0..1_900.0).contains(&pixel.x) && (20.0..1_260.0).contains(&pixel.y),
                    "{dtd_nm} NM: {pixel}"
                );
            }
            assert!(
                (a.x + b.x - 1_919.0).abs() < 0.5,
                "{dtd_nm} NM: {a} and {b}"
            );
        }
    }

    #[test]
    fn a_rig_has_the_same_directions_relative_to_the_runway_at_every_latitude() {
        // The axes of each camera in the runway's frame.
        let at_latitude = |latitude_deg: f64, course_true_deg: f64| {
            let mut runway = changi_02l();
            runway.threshold.latitude_deg = latitude_deg;
            runway.course_true_deg = course_true_deg;
            let runway_axes = runway.touchdown_target().ecef_from_ned()
                * glam::DMat3::from_rotation_z(course_true_deg.to_radians());
            [-300.0, 300.0].map(|side| {
                let placed = place(&mast("view", side), &runway);
                let camera = Pinhole::from_pose(&placed, 1920, 1280);
                runway_axes.transpose() * camera.ecef_from_camera
            })
        };
        let changi = at_latitude(1.35, 23.02);
        for (latitude_deg, course_true_deg) in [(47.5, 137.2), (-20.4, 317.0), (64.0, 190.0)] {
            let there = at_latitude(latitude_deg, course_true_deg);
            for (here, there) in changi.iter().zip(&there) {
                let turn = here.transpose() * *there;
                let off_deg = (turn.y_axis - glam::DVec3::Y).length().to_degrees();
                let aside_deg = (turn.z_axis - glam::DVec3::Z).length().to_degrees();
                assert!(
                    off_deg < 0.0008 && aside_deg < 0.0008,
                    "{latitude_deg}: {off_deg} {aside_deg}"
                );
            }
        }
    }

    #[test]
    fn a_camera_placed_from_the_threshold_stays_when_the_target_moves() {
        let near = changi_02l();
        let far = Runway {
            touchdown_past_threshold_m: 617.7,
            ..near.clone()
        };
        let camera = PlannedCamera {
            beyond_touchdown_m: None,
            beyond_threshold_m: Some(896.7),
            ..mast("east", 411.0)
        };
        let [a, b] = [&near, &far].map(|runway| place(&camera, runway).pose.position());
        assert!(a.to_ecef().distance(b.to_ecef()) < 1e-3);
    }
}
