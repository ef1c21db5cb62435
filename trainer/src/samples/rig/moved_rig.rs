//! Moving a rig with its runway to a different airport, and comparing cameras relative to runways.

use dataset::corpus::calibration::{CameraEntry, RigidTransform};
use dataset::geometry::camera::Camera;
use dataset::geometry::runway::Runway;
use glam::{DMat3, DVec3};

use crate::samples::rig::{Cameras, differences, form};

/// Maximum difference between cameras that count as the same, in metres and degrees: a `heading_true_deg` at a mast and at the touchdown
/// target differs by up to 0.04 degrees, depending on the latitude.
const SAME_PLACE_M: f64 = 0.5;
const SAME_DIRECTION_DEG: f64 = 0.1;

/// Rigid motion that maps one runway to a second one.
pub(crate) struct Move {
    rotation: DMat3,
    from_m: DVec3,
    to_m: DVec3,
}

/// Runway axes in ECEF (along the course, right, down) and touchdown target.
fn frame(runway: &Runway) -> (DMat3, DVec3) {
    let target = runway.touchdown_target();
    let ned_from_runway = DMat3::from_rotation_z(runway.course_true_deg.to_radians());
    (target.ecef_from_ned() * ned_from_runway, target.to_ecef())
}

impl Move {
    /// The motion; `None` if the runways are identical.
    pub(crate) fn between(from: &Runway, to: &Runway) -> Option<Self> {
        let ((from_axes, from_m), (to_axes, to_m)) = (frame(from), frame(to));
        let is_same = from_m == to_m && from_axes == to_axes;
        (!is_same).then(|| Self {
            rotation: to_axes * from_axes.transpose(),
            from_m,
            to_m,
        })
    }

    pub(crate) fn camera(&self, camera: &Camera) -> Camera {
        Camera {
            ecef_from_camera: self.rotation * camera.ecef_from_camera,
            center_ecef_m: self.to_m + self.rotation * (camera.center_ecef_m - self.from_m),
            ..*camera
        }
    }

    /// The entry with a moved matrix and position; the pose requested from the simulator stays.
    pub(crate) fn entry(&self, entry: &CameraEntry) -> CameraEntry {
        let moved = self.camera(&entry.camera());
        CameraEntry {
            ecef_from_camera: RigidTransform {
                rotation: moved.ecef_from_camera.transpose().to_cols_array_2d(),
                translation_m: moved.center_ecef_m.to_array(),
            },
            ..entry.clone()
        }
    }

    pub(crate) fn entries(&self, cameras: &Cameras) -> Cameras {
        let cameras = cameras.iter();
        cameras
            .map(|(view, entry)| (view.clone(), self.entry(entry)))
            .collect()
    }
}

/// Differences between the cameras here and a rig moved here; empty if they agree relative to the runway.
pub(crate) fn differences_elsewhere(
    here: (&str, &Cameras),
    moved: (&str, &Cameras),
) -> Vec<String> {
    if here.0 != moved.0 || form(here.1) != form(moved.1) {
        return differences(here, moved);
    }
    let pairs = here.1.iter().zip(moved.1.values());
    pairs
        .filter_map(|((view, here), moved)| {
            let optics = |entry: &CameraEntry| {
                (
                    entry.k,
                    entry.distortion.clone(),
                    entry.refraction_coefficient,
                )
            };
            if optics(here) != optics(moved) {
                return Some(format!("the optics of {view}"));
            }
            let (here, moved) = (here.camera(), moved.camera());
            let off_m = here.center_ecef_m.distance(moved.center_ecef_m);
            let turn = here.ecef_from_camera.transpose() * moved.ecef_from_camera;
            let cosine = (turn.x_axis.x + turn.y_axis.y + turn.z_axis.z - 1.0) / 2.0;
            let off_deg = cosine.clamp(-1.0, 1.0).acos().to_degrees();
            (off_m > SAME_PLACE_M || off_deg > SAME_DIRECTION_DEG).then(|| {
                format!(
                    "{view} is {off_m:.1} m and {off_deg:.2} degrees off, relative to the runway"
                )
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use testkit::changi_02l;

    fn elsewhere() -> Runway {
        let mut runway = changi_02l();
        runway.threshold.latitude_deg = 47.48;
        runway.threshold.longitude_deg = 8.53;
        runway.threshold.altitude_msl_m = 427.0;
        runway.course_true_deg = 137.0;
        runway
    }

    #[test]
    fn a_point_keeps_its_place_relative_to_the_runway() {
        let (here, there) = (changi_02l(), elsewhere());
        let motion = Move::between(&here, &there).unwrap();
        let camera = |runway: &Runway| {
            let place = runway.point_on_approach(-1_500.0, 300.0);
            let place = place.at_altitude_m(runway.threshold.altitude_msl_m + 10.0);
            place.to_ecef()
        };
        let found = motion.to_m + motion.rotation * (camera(&here) - motion.from_m);
        assert!(found.distance(camera(&there)) < SAME_PLACE_M);
        assert!(Move::between(&here, &changi_02l()).is_none());
    }
}
