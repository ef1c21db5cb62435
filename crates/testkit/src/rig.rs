//! The rig `wide-baseline` at Changi 02L.

use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::Pose;
use dataset::geometry::runway::Runway;

use crate::changi_02l;

/// The rig's views.
pub const VIEWS: [&str; 2] = ["left", "right"];

/// Two cameras 1500 m past the touchdown target, 300 m to either side, turned 5.3 degrees inwards.
pub(crate) fn wide_baseline(runway: &Runway) -> [(&'static str, CameraPose); 2] {
    // Looking back down the approach, the axis is to the left camera's left.
    [
        (VIEWS[0], beside(runway, -300.0, -5.3)),
        (VIEWS[1], beside(runway, 300.0, 5.3)),
    ]
}

/// A third camera, between both.
pub fn middle(runway: &Runway) -> (&'static str, CameraPose) {
    ("middle", beside(runway, 0.0, 0.0))
}

fn beside(runway: &Runway, sideways_m: f64, turned_deg: f64) -> CameraPose {
    let at = runway.point_on_approach(-1_500.0, sideways_m);
    CameraPose {
        pose: Pose {
            latitude_deg: at.latitude_deg,
            longitude_deg: at.longitude_deg,
            altitude_msl_m: runway.threshold.altitude_msl_m + 10.0,
            heading_true_deg: (runway.course_true_deg + 180.0 + turned_deg).rem_euclid(360.0),
            pitch_deg: 1.6,
            roll_deg: 0.0,
        },
        hfov_deg: 10.0,
    }
}

/// A view's camera.
pub fn placed(view: &str) -> CameraPose {
    let rig = wide_baseline(&changi_02l());
    let found = rig.into_iter().find(|(id, _)| *id == view);
    found.unwrap_or_else(|| panic!("no view {view:?}")).1
}

#[cfg(test)]
mod tests {
    use dataset::geometry::camera::Camera;

    use super::*;

    #[test]
    fn both_cameras_see_the_aircraft_from_ten_miles_to_the_runway() {
        let runway = changi_02l();
        for (view, placed) in wide_baseline(&runway) {
            let camera = Camera::from_pose(&placed, 1920, 1280);
            for along_m in [18_520.0, 9_000.0, 2_000.0, 200.0] {
                let at = runway
                    .point_on_approach(along_m, 0.0)
                    .at_altitude_m(6.7 + along_m * 0.0524);
                let pixel = camera.project(at.to_ecef()).unwrap();
                assert!(
                    (0.0..1920.0).contains(&pixel.x) && (0.0..1280.0).contains(&pixel.y),
                    "{view} {along_m} {pixel}"
                );
            }
        }
    }
}
