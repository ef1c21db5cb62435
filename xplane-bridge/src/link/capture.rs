//! A view at an instant: the request, and the drawn frame.

use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::{Controls, Pose};
use serde::{Deserialize, Serialize};

use super::{PictureBytes, PictureSize};

/// Maximum image side, pixels. Limits how much memory a request can make the other side allocate.
pub(crate) const MAX_PICTURE_SIDE_PX: u32 = 8_192;

/// Delivery of the drawn frame to the client.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Deliver {
    /// The answer's payload has the pixels.
    #[default]
    Picture,
    /// It stays on the screen until the next request; the client grabs it there. The payload is empty.
    Drawn,
    /// It is on the screen for one drawn frame, with that frame's number in the margins around it. The payload is empty.
    Coded,
    /// As [`Self::Coded`], with the aircraft displaced: the frame reveals the lag of the scene behind the number.
    Probe,
}

/// A frame to draw.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaptureRequest {
    /// Tick of the scenario.
    pub tick: u32,
    /// Simulator time of the tick since the first one, nanoseconds.
    pub time_ns: i64,
    /// Index of the rig's camera, counted from 0.
    pub view: u32,
    /// Pose of the aircraft.
    pub pose: Pose,
    /// Flaps and gear.
    pub controls: Controls,
    /// Pose of the camera.
    pub camera: CameraPose,
    /// Width of the image, pixels.
    pub width_px: u32,
    /// Height of the image, pixels.
    pub height_px: u32,
    /// Delivery of the image.
    #[serde(default)]
    pub deliver: Deliver,
}

impl CaptureRequest {
    /// Size of the image, bytes.
    pub fn rgb_bytes(&self) -> usize {
        let (width_px, height_px) = (self.width_px, self.height_px);
        PictureSize {
            width_px,
            height_px,
        }
        .rgb_bytes()
    }

    /// Size of the answer's payload, bytes: the image's size, or none if it is only drawn.
    pub fn payload_bytes(&self) -> usize {
        match self.deliver {
            Deliver::Picture => self.rgb_bytes(),
            Deliver::Drawn | Deliver::Coded | Deliver::Probe => 0,
        }
    }

    /// Rejects what cannot be drawn: an invalid size or field of view, or a place that is not on earth.
    pub fn check(&self) -> Result<(), BadCapture> {
        for (name, side) in [("width_px", self.width_px), ("height_px", self.height_px)] {
            if !(1..=MAX_PICTURE_SIDE_PX).contains(&side) {
                return Err(BadCapture(format!(
                    "{name} is {side}, expected 1 to {MAX_PICTURE_SIDE_PX}"
                )));
            }
        }
        let Controls {
            flap_ratio,
            gear_ratio,
        } = self.controls;
        for (name, ratio) in [("flap_ratio", flap_ratio), ("gear_ratio", gear_ratio)] {
            if !(0.0..=1.0).contains(&ratio) {
                return Err(BadCapture(format!("{name} is {ratio}, expected 0 to 1")));
            }
        }
        let hfov_deg = self.camera.hfov_deg;
        if !(hfov_deg > 0.0 && hfov_deg < 180.0) {
            return Err(BadCapture(format!(
                "hfov_deg is {hfov_deg}, expected more than 0 and less than 180"
            )));
        }
        for (name, pose) in [("pose", &self.pose), ("camera", &self.camera.pose)] {
            let angles = [pose.heading_true_deg, pose.pitch_deg, pose.roll_deg];
            let on_earth = pose.latitude_deg.abs() <= 90.0
                && pose.longitude_deg.abs() <= 360.0
                && pose.altitude_msl_m.abs() <= 1e6;
            if !on_earth || angles.iter().any(|angle| !angle.is_finite()) {
                return Err(BadCapture(format!(
                    "{name} is not a position and attitude on earth: {pose:?}"
                )));
            }
        }
        Ok(())
    }
}

/// Reason why an image cannot be drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct BadCapture(String);

/// A drawn frame. Pose and camera are read from the drawn image, not copied from the request.
///
/// Unknown keys are ignored, as in all answers: a simulator may report more than this client needs. A request with unknown keys is
/// rejected, since it could not be fulfilled.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FrameHeader {
    /// Tick of the request.
    pub tick: u32,
    /// View of the request.
    pub view: u32,
    /// The simulator's count of drawn frames; grows from each image to the next.
    pub sim_frame: u64,
    /// Pose of the drawn aircraft.
    pub pose: Pose,
    /// Pose of the camera.
    pub camera: CameraPose,
    /// Width of the image, pixels.
    pub width_px: u32,
    /// Height of the image, pixels.
    pub height_px: u32,
}

/// An image and its content.
#[derive(Debug, Clone, PartialEq)]
pub struct CapturedFrame {
    /// Description of the drawn frame.
    pub header: FrameHeader,
    /// Red, green, blue, one byte each, row by row from the top left. Empty if the image was only drawn.
    pub rgb: PictureBytes,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_without_size_or_place_is_refused_with_its_reason() {
        let pose = Pose {
            latitude_deg: 1.3,
            longitude_deg: 104.0,
            altitude_msl_m: 700.0,
            heading_true_deg: 23.0,
            pitch_deg: 0.0,
            roll_deg: 0.0,
        };
        let good = CaptureRequest {
            tick: 0,
            time_ns: 0,
            view: 0,
            pose,
            controls: Controls::default(),
            camera: CameraPose {
                pose,
                hfov_deg: 10.0,
            },
            width_px: 1_920,
            height_px: 1_280,
            deliver: Deliver::Picture,
        };
        assert_eq!(good.check(), Ok(()));
        assert_eq!(good.payload_bytes(), 7_372_800);
        let drawn = CaptureRequest {
            deliver: Deliver::Drawn,
            ..good
        };
        assert_eq!((drawn.rgb_bytes(), drawn.payload_bytes()), (7_372_800, 0));
        let huge = CaptureRequest {
            width_px: u32::MAX,
            ..good
        };
        assert!(huge.check().unwrap_err().to_string().contains("4294967295"));
        let blind = CaptureRequest {
            camera: CameraPose {
                hfov_deg: f64::NAN,
                ..good.camera
            },
            ..good
        };
        assert!(blind.check().unwrap_err().to_string().contains("hfov_deg"));
        let lost = CaptureRequest {
            pose: Pose {
                latitude_deg: 91.0,
                ..pose
            },
            ..good
        };
        assert!(lost.check().unwrap_err().to_string().contains("pose"));
    }
}
