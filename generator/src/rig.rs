//! From a rig as it is measured out on an airfield to cameras on the earth.

use dataset::camera::CameraPose;
use dataset::pose::Pose;
use dataset::runway::Runway;
use dataset::units::Degrees;

use crate::sweep::Camera;

/// Where a camera of a rig stands and looks.
pub fn place(camera: &Camera, runway: &Runway) -> CameraPose {
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
    let back = runway.course_true_deg + 180.0;
    // Seen by somebody who looks back along the course, the runway's axis is on the left of a camera that stands left of the
    // course.
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

/// A turn towards the runway's axis is clockwise for cameras on the right and anticlockwise on the left. A camera on the axis has
/// no inward side.
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
    use crate::airports;
    use dataset::camera::Camera as Pinhole;

    fn mast(id: &str, right_m: f64) -> Camera {
        Camera {
            id: id.into(),
            beyond_touchdown_m: Some(1_500.0),
            beyond_threshold_m: None,
            right_m,
            height_m: 10.0,
            inward_deg: Some(5.3),
            heading_true_deg: None,
            pitch_deg: 1.6,
            hfov_deg: 10.0,
        }
    }

    #[test]
    fn both_cameras_see_the_glide_path_from_ten_miles_to_a_tenth_and_mirror_each_other() {
        let runway = airports::bundled("WSSS", "02L").unwrap();
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
    fn a_camera_placed_from_the_threshold_stays_when_the_target_moves() {
        let near = airports::bundled("WSSS", "02L").unwrap();
        let far = Runway {
            touchdown_past_threshold_m: 617.7,
            ..near.clone()
        };
        let camera = Camera {
            beyond_touchdown_m: None,
            beyond_threshold_m: Some(896.7),
            ..mast("east", 411.0)
        };
        let [a, b] = [&near, &far].map(|runway| place(&camera, runway).pose.position());
        assert!(a.to_ecef().distance(b.to_ecef()) < 1e-3);
    }
}
