//! `calibration.json`: the cameras of a scenario.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::camera::{Camera, CameraPose};
use crate::error::Result;
use crate::json_file::{read_json, write_json};

/// All cameras of a scenario by their identifiers, in the order of the identifiers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// What the numbers mean, for whoever opens the file without the documentation.
    pub conventions: Conventions,
    /// The cameras.
    pub cameras: BTreeMap<String, CameraEntry>,
}

/// The conventions of the file in words.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Conventions {
    /// Directions of the camera's axes.
    pub camera_axes: String,
    /// Where pixel (0, 0) is.
    pub pixel_origin: String,
    /// Frame and height datum of the extrinsics.
    pub world: String,
}

impl Default for Conventions {
    fn default() -> Self {
        Self {
            camera_axes: "OpenCV: x right, y down, z forward".into(),
            pixel_origin: "(0, 0) is the centre of the top-left pixel".into(),
            world: "ECEF metres on WGS-84; heights above mean sea level are taken as heights above the ellipsoid".into(),
        }
    }
}

/// One camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraEntry {
    /// Width of the picture, pixels.
    pub width_px: u32,
    /// Height of the picture, pixels.
    pub height_px: u32,
    /// Intrinsics, row-major.
    pub k: [[f64; 3]; 3],
    /// OpenCV distortion coefficients; empty for a pure pinhole.
    pub distortion: Vec<f64>,
    /// Extrinsics.
    pub ecef_from_camera: RigidTransform,
    /// The same placement as it was asked of the simulator.
    pub placed: CameraPose,
}

/// A rotation and a translation: `x_ecef = rotation * x_camera + translation_m`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RigidTransform {
    /// Rotation matrix, row-major.
    pub rotation: [[f64; 3]; 3],
    /// Translation, metres.
    pub translation_m: [f64; 3],
}

impl CameraEntry {
    /// The entry of a placed camera.
    pub fn from_pose(placed: CameraPose, width_px: u32, height_px: u32) -> Self {
        let camera = Camera::from_pose(&placed, width_px, height_px);
        Self {
            width_px,
            height_px,
            k: camera.k(),
            distortion: Vec::new(),
            ecef_from_camera: RigidTransform {
                rotation: camera.ecef_from_camera.transpose().to_cols_array_2d(),
                translation_m: camera.center_ecef_m.to_array(),
            },
            placed,
        }
    }

    /// The camera for projecting.
    pub fn camera(&self) -> Camera {
        Camera {
            width_px: self.width_px,
            height_px: self.height_px,
            focal_px: self.k[0][0],
            principal_px: DVec2::new(self.k[0][2], self.k[1][2]),
            ecef_from_camera: DMat3::from_cols_array_2d(&self.ecef_from_camera.rotation)
                .transpose(),
            center_ecef_m: DVec3::from_array(self.ecef_from_camera.translation_m),
        }
    }
}

impl Calibration {
    /// A calibration of placed cameras, all with the same picture size.
    pub fn from_poses<'a>(
        placed: impl IntoIterator<Item = (&'a str, CameraPose)>,
        width_px: u32,
        height_px: u32,
    ) -> Self {
        let cameras = placed
            .into_iter()
            .map(|(id, pose)| {
                (
                    id.to_owned(),
                    CameraEntry::from_pose(pose, width_px, height_px),
                )
            })
            .collect();
        Self {
            conventions: Conventions::default(),
            cameras,
        }
    }

    /// Reads `calibration.json`.
    pub fn read(path: &Path) -> Result<Self> {
        read_json(path, "calibration")
    }

    /// Writes `calibration.json`.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_json(path, self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Pose;

    #[test]
    fn a_camera_read_back_from_json_projects_to_the_same_pixel() {
        let placed = CameraPose {
            pose: Pose {
                latitude_deg: 1.36,
                longitude_deg: 103.98,
                altitude_msl_m: 16.7,
                heading_true_deg: 203.0,
                pitch_deg: 1.5,
                roll_deg: 0.2,
            },
            hfov_deg: 10.0,
        };
        let calibration = Calibration::from_poses([("left", placed)], 1920, 1280);
        let text = serde_json::to_string(&calibration).unwrap();
        let back: Calibration = serde_json::from_str(&text).unwrap();
        let point = placed
            .pose
            .body_point_to_ecef(DVec3::new(7_000.0, 100.0, -200.0));
        let expected = Camera::from_pose(&placed, 1920, 1280)
            .project(point)
            .unwrap();
        assert!(
            back.cameras["left"]
                .camera()
                .project(point)
                .unwrap()
                .abs_diff_eq(expected, 1e-9)
        );
    }
}
