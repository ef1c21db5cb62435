//! `calibration.json`: a scenario's cameras.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::corpus::scenario::{LENS_SCHEMA_VERSION, PINHOLE_SCHEMA_VERSION};
use crate::error::{Error, Result};
use crate::files::json_file::{parse_json, read_json, write_json};
use crate::geometry::camera::{Camera, CameraPose};
use crate::geometry::distortion::Distortion;
use crate::geometry::imaging::{Degradation, Imaging, is_zero};
use crate::numbers::limits::{self, Check, FieldOutOfLimits, check_fields};

/// A scenario's cameras by their identifiers, in the order of the identifiers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// The meaning of the numbers, for readers without the documentation.
    pub conventions: Conventions,
    /// The cameras.
    pub cameras: BTreeMap<String, CameraEntry>,
}

/// The conventions of the file in words.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Conventions {
    /// Directions of the camera's axes.
    pub camera_axes: String,
    /// Location of pixel (0, 0).
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

/// A calibrated camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraEntry {
    /// Width of the image, pixels.
    pub width_px: u32,
    /// Height of the image, pixels.
    pub height_px: u32,
    /// Intrinsics, row-major.
    pub k: [[f64; 3]; 3],
    /// OpenCV distortion coefficients k1, k2, p1, p2, k3; empty for a pure pinhole.
    pub distortion: Vec<f64>,
    /// Coefficient of terrestrial refraction: an object at a distance d appears lifted by `k d^2 / (2 R)`, with R = 6,371,008.8 m. Missing
    /// if light travels straight.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub refraction_coefficient: f64,
    /// Blur, seeing and noise of the images; they do not affect geometry. Missing if there are none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub degradation: Option<Degradation>,
    /// Extrinsics.
    pub ecef_from_camera: RigidTransform,
    /// Placement as requested from the simulator.
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
    /// A placed camera's entry.
    pub fn from_pose(placed: CameraPose, width_px: u32, height_px: u32) -> Self {
        let camera = Camera::from_pose(&placed, width_px, height_px);
        Self {
            width_px,
            height_px,
            k: camera.k(),
            distortion: Vec::new(),
            refraction_coefficient: 0.0,
            degradation: None,
            ecef_from_camera: RigidTransform {
                rotation: camera.ecef_from_camera.transpose().to_cols_array_2d(),
                translation_m: camera.center_ecef_m.to_array(),
            },
            placed,
        }
    }

    /// The entry with this lens, air and sensor.
    #[must_use]
    pub fn with_imaging(self, imaging: &Imaging) -> Self {
        Self {
            distortion: imaging
                .distortion
                .map_or_else(Vec::new, |lens| lens.coefficients().to_vec()),
            refraction_coefficient: imaging.refraction_coefficient,
            degradation: imaging.degradation,
            ..self
        }
    }

    /// Lens, air and sensor of the camera's images.
    pub fn imaging(&self) -> Imaging {
        Imaging {
            distortion: Distortion::from_coefficients(&self.distortion),
            refraction_coefficient: self.refraction_coefficient,
            degradation: self.degradation,
        }
    }

    /// The reason why points cannot be projected with this camera, if any: a matrix or a lens that this software does not support.
    pub fn fault(&self) -> Option<String> {
        let k = &self.k;
        if k[0][0] != k[1][1] || k[0][1] != 0.0 {
            return Some("has skew or non-square pixels; expected square ones".into());
        }
        if self.distortion.is_empty() {
            return None;
        }
        let Some(lens) = Distortion::from_coefficients(&self.distortion) else {
            return Some(format!(
                "has {} distortion coefficients; expected none or k1, k2, p1, p2, k3",
                self.distortion.len()
            ));
        };
        lens.fault(self.camera().corner())
    }

    /// Checks for numbers outside their limits.
    pub fn check(&self, check: &mut Check) {
        check_fields!(check, self, {
            width_px: limits::PICTURE_SIDE_PX,
            height_px: limits::PICTURE_SIDE_PX,
        });
        check.part("k", |check| {
            let k = &self.k;
            for (name, value, limits) in [
                ("focal_x_px", k[0][0], limits::FOCAL_LENGTH_PX),
                ("focal_y_px", k[1][1], limits::FOCAL_LENGTH_PX),
                ("principal_x_px", k[0][2], limits::PRINCIPAL_POINT_PX),
                ("principal_y_px", k[1][2], limits::PRINCIPAL_POINT_PX),
            ] {
                check.number(name, value, limits);
            }
        });
        for coefficient in &self.distortion {
            check.number("distortion", *coefficient, limits::DISTORTION);
        }
        self.imaging().check(check);
        check.part("ecef_from_camera", |check| {
            for element in self.ecef_from_camera.rotation.as_flattened() {
                check.number("rotation", *element, limits::ROTATION);
            }
            for coordinate in self.ecef_from_camera.translation_m {
                check.number("translation_m", coordinate, limits::ECEF_M);
            }
        });
        check.part("placed", |check| {
            self.placed.pose.check_camera(check);
            check.number("hfov_deg", self.placed.hfov_deg, limits::HFOV_DEG);
        });
    }

    /// True if a reader that supports only pinholes and straight light would misread this entry.
    pub(crate) fn bends_light(&self) -> bool {
        !self.distortion.is_empty() || self.refraction_coefficient != 0.0
    }

    /// The camera for projection.
    pub fn camera(&self) -> Camera {
        self.pinhole().seen_through(&self.imaging())
    }

    fn pinhole(&self) -> Camera {
        Camera {
            width_px: self.width_px,
            height_px: self.height_px,
            focal_px: self.k[0][0],
            principal_px: DVec2::new(self.k[0][2], self.k[1][2]),
            ecef_from_camera: DMat3::from_cols_array_2d(&self.ecef_from_camera.rotation)
                .transpose(),
            center_ecef_m: DVec3::from_array(self.ecef_from_camera.translation_m),
            distortion: None,
            refraction: None,
        }
    }
}

impl Calibration {
    /// A calibration of placed cameras, all with the same image size.
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

    /// Version of the file format for a scenario with these cameras: version 1, unless a version 1 reader would project incorrectly.
    pub fn schema_version(&self) -> u32 {
        if self.cameras.values().any(CameraEntry::bends_light) {
            LENS_SCHEMA_VERSION
        } else {
            PINHOLE_SCHEMA_VERSION
        }
    }

    /// Reads `calibration.json`. A number outside its limits is an error.
    pub fn read(path: &Path) -> Result<Self> {
        Self::sound(read_json(path, "calibration")?, path)
    }

    /// Reads the content of `calibration.json`; messages name it as `path`.
    pub fn parse(content: &[u8], path: &Path) -> Result<Self> {
        Self::sound(parse_json(content, path, "calibration")?, path)
    }

    fn sound(self, path: &Path) -> Result<Self> {
        Error::refuse_first(path, self.out_of_limits())?;
        Ok(self)
    }

    /// Like [`Self::read`], but collects numbers outside their limits.
    pub fn read_with_faults(path: &Path) -> Result<(Self, Vec<FieldOutOfLimits>)> {
        let calibration: Self = read_json(path, "calibration")?;
        let faults = calibration.out_of_limits();
        Ok((calibration, faults))
    }

    /// Writes `calibration.json` if all its numbers are within their limits.
    pub fn write(&self, path: &Path) -> Result<()> {
        Error::refuse_first(path, self.out_of_limits())?;
        write_json(path, self)
    }

    fn out_of_limits(&self) -> Vec<FieldOutOfLimits> {
        let mut check = Check::default();
        for (id, entry) in &self.cameras {
            check.part(format_args!("cameras.{id}"), |check| entry.check(check));
        }
        check.into_found()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::pose::Pose;

    #[test]
    fn a_pinhole_is_written_as_it_always_was_and_a_lens_comes_back() {
        let pose = Pose {
            latitude_deg: 1.36,
            longitude_deg: 103.98,
            altitude_msl_m: 16.7,
            heading_true_deg: 203.0,
            pitch_deg: 1.5,
            roll_deg: 0.0,
        };
        let placed = CameraPose {
            pose,
            hfov_deg: 60.0,
        };
        let plain = Calibration::from_poses([("left", placed)], 1920, 1280);
        let text = serde_json::to_string(&plain).unwrap();
        assert!(
            text.contains(r#""distortion":[],"ecef_from_camera""#),
            "{text}"
        );
        assert_eq!(plain.schema_version(), 1);

        let imaging = Imaging {
            distortion: Some(Distortion {
                k1: -0.2,
                k2: 0.03,
                p1: 0.001,
                p2: -0.002,
                k3: 0.004,
            }),
            refraction_coefficient: 0.13,
            degradation: Some(Degradation {
                blur_sigma_px: 0.7,
                seed: 5,
                ..Degradation::default()
            }),
        };
        let mut lens = plain.clone();
        let entry = lens.cameras["left"].clone().with_imaging(&imaging);
        lens.cameras.insert("left".into(), entry);
        assert_eq!(lens.schema_version(), 2);
        let text = serde_json::to_string(&lens).unwrap();
        assert!(text.contains("[-0.2,0.03,0.001,-0.002,0.004]"), "{text}");
        let back: Calibration = serde_json::from_str(&text).unwrap();
        assert_eq!(back.cameras["left"].imaging(), imaging);
        assert_eq!(back.cameras["left"].fault(), None);
        let [bent, straight] = [&back, &plain].map(|c| c.cameras["left"].camera());
        let corner = DVec2::new(20.0, 30.0);
        let point = bent.center_ecef_m + bent.ray(corner) * 100.0;
        // Refraction by 0.1 mm over the distance.
        assert!(bent.project(point).unwrap().distance(corner) < 0.01);
        assert!(straight.project(point).unwrap().distance(corner) > 30.0);
    }

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
