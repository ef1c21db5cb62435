//! The messages of Foxglove's published Protobuf schemas that an MCAP file of an approach holds, limited to the fields that are known here.

use prost::Message;

/// The schemas, as Protobuf describes itself (`crates/exporter/foxglove/make.py`).
pub(crate) const SCHEMAS: &[u8] = include_bytes!("../../../foxglove/schemas.bin");

/// A message with its name.
pub(crate) trait Named: Message {
    /// Name of its schema.
    const SCHEMA: &'static str;
}

macro_rules! named {
    ($($message:ident $schema:literal)*) => {
        $(impl Named for $message {
            const SCHEMA: &'static str = $schema;
        })*
    };
}

named! {
    CameraCalibration "foxglove.CameraCalibration"
    CompressedVideo "foxglove.CompressedVideo"
    FrameTransforms "foxglove.FrameTransforms"
    ImageAnnotations "foxglove.ImageAnnotations"
    LocationFix "foxglove.LocationFix"
    PoseInFrame "foxglove.PoseInFrame"
}

#[derive(Clone, Copy, PartialEq, Message)]
pub(crate) struct Timestamp {
    #[prost(int64, tag = 1)]
    pub(crate) seconds: i64,
    #[prost(int32, tag = 2)]
    pub(crate) nanos: i32,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub(crate) struct Vector3 {
    #[prost(double, tag = 1)]
    pub(crate) x: f64,
    #[prost(double, tag = 2)]
    pub(crate) y: f64,
    #[prost(double, tag = 3)]
    pub(crate) z: f64,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub(crate) struct Quaternion {
    #[prost(double, tag = 1)]
    pub(crate) x: f64,
    #[prost(double, tag = 2)]
    pub(crate) y: f64,
    #[prost(double, tag = 3)]
    pub(crate) z: f64,
    #[prost(double, tag = 4)]
    pub(crate) w: f64,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub(crate) struct Pose {
    #[prost(message, optional, tag = 1)]
    pub(crate) position: Option<Vector3>,
    #[prost(message, optional, tag = 2)]
    pub(crate) orientation: Option<Quaternion>,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct PoseInFrame {
    #[prost(message, optional, tag = 1)]
    pub(crate) timestamp: Option<Timestamp>,
    #[prost(string, tag = 2)]
    pub(crate) frame_id: String,
    #[prost(message, optional, tag = 3)]
    pub(crate) pose: Option<Pose>,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct FrameTransform {
    #[prost(message, optional, tag = 1)]
    pub(crate) timestamp: Option<Timestamp>,
    #[prost(string, tag = 2)]
    pub(crate) parent_frame_id: String,
    #[prost(string, tag = 3)]
    pub(crate) child_frame_id: String,
    #[prost(message, optional, tag = 4)]
    pub(crate) translation: Option<Vector3>,
    #[prost(message, optional, tag = 5)]
    pub(crate) rotation: Option<Quaternion>,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct FrameTransforms {
    #[prost(message, repeated, tag = 1)]
    pub(crate) transforms: Vec<FrameTransform>,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct LocationFix {
    #[prost(double, tag = 1)]
    pub(crate) latitude: f64,
    #[prost(double, tag = 2)]
    pub(crate) longitude: f64,
    #[prost(double, tag = 3)]
    pub(crate) altitude: f64,
    #[prost(message, optional, tag = 6)]
    pub(crate) timestamp: Option<Timestamp>,
    #[prost(string, tag = 7)]
    pub(crate) frame_id: String,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct CompressedVideo {
    #[prost(message, optional, tag = 1)]
    pub(crate) timestamp: Option<Timestamp>,
    #[prost(string, tag = 2)]
    pub(crate) frame_id: String,
    #[prost(bytes = "vec", tag = 3)]
    pub(crate) data: Vec<u8>,
    #[prost(string, tag = 4)]
    pub(crate) format: String,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct CameraCalibration {
    #[prost(message, optional, tag = 1)]
    pub(crate) timestamp: Option<Timestamp>,
    #[prost(fixed32, tag = 2)]
    pub(crate) width: u32,
    #[prost(fixed32, tag = 3)]
    pub(crate) height: u32,
    #[prost(string, tag = 4)]
    pub(crate) distortion_model: String,
    #[prost(double, repeated, tag = 5)]
    pub(crate) d: Vec<f64>,
    #[prost(double, repeated, tag = 6)]
    pub(crate) k: Vec<f64>,
    #[prost(double, repeated, tag = 7)]
    pub(crate) r: Vec<f64>,
    #[prost(double, repeated, tag = 8)]
    pub(crate) p: Vec<f64>,
    #[prost(string, tag = 9)]
    pub(crate) frame_id: String,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub(crate) struct Point2 {
    #[prost(double, tag = 1)]
    pub(crate) x: f64,
    #[prost(double, tag = 2)]
    pub(crate) y: f64,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub(crate) struct Color {
    #[prost(double, tag = 1)]
    pub(crate) r: f64,
    #[prost(double, tag = 2)]
    pub(crate) g: f64,
    #[prost(double, tag = 3)]
    pub(crate) b: f64,
    #[prost(double, tag = 4)]
    pub(crate) a: f64,
}

/// `PointsAnnotation.Type`: a closed line.
pub(crate) const LINE_LOOP: i32 = 2;

#[derive(Clone, PartialEq, Message)]
pub(crate) struct PointsAnnotation {
    #[prost(message, optional, tag = 1)]
    pub(crate) timestamp: Option<Timestamp>,
    #[prost(int32, tag = 2)]
    pub(crate) kind: i32,
    #[prost(message, repeated, tag = 3)]
    pub(crate) points: Vec<Point2>,
    #[prost(message, optional, tag = 4)]
    pub(crate) outline_color: Option<Color>,
    #[prost(double, tag = 7)]
    pub(crate) thickness: f64,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct TextAnnotation {
    #[prost(message, optional, tag = 1)]
    pub(crate) timestamp: Option<Timestamp>,
    #[prost(message, optional, tag = 2)]
    pub(crate) position: Option<Point2>,
    #[prost(string, tag = 3)]
    pub(crate) text: String,
    #[prost(double, tag = 4)]
    pub(crate) font_size: f64,
    #[prost(message, optional, tag = 5)]
    pub(crate) text_color: Option<Color>,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct ImageAnnotations {
    #[prost(message, repeated, tag = 2)]
    pub(crate) points: Vec<PointsAnnotation>,
    #[prost(message, repeated, tag = 3)]
    pub(crate) texts: Vec<TextAnnotation>,
    #[prost(message, optional, tag = 5)]
    pub(crate) timestamp: Option<Timestamp>,
}
