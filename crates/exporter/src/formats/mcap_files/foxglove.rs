//! Messages of Foxglove's published Protobuf schemas, limited to the fields that an approach has.

use prost::Message;

/// The schemas, as Protobuf describes itself (`crates/exporter/foxglove/make.py`).
pub(crate) const SCHEMAS: &[u8] = include_bytes!("../../../foxglove/schemas.bin");
/// `PointsAnnotation.Type`: a closed line.
pub(crate) const LINE_LOOP: i32 = 2;

/// A channel's message.
pub(crate) trait Named: Message {
    /// Schema name.
    const SCHEMA: &'static str;
}

macro_rules! named {
    ($($message:ident)*) => {
        $(impl Named for $message {
            const SCHEMA: &'static str = concat!("foxglove.", stringify!($message));
        })*
    };
}

named! { CameraCalibration CompressedVideo FrameTransforms ImageAnnotations LocationFix PoseInFrame }

/// Messages; a line is a field's tag, name, type in Rust and type in Protobuf.
macro_rules! messages {
    ($($message:ident $(($copy:ident))? {
        $($tag:tt $field:ident: $rust:ty [$($proto:tt)*],)*
    })*) => {
        $(#[derive(Clone, $($copy,)? PartialEq, Message)]
        pub(crate) struct $message {
            $(#[prost($($proto)*, tag = $tag)]
            pub(crate) $field: $rust,)*
        })*
    };
}

messages! {
    Timestamp (Copy) {
        1 seconds: i64 [int64],
        2 nanos: i32 [int32],
    }
    Vector3 (Copy) {
        1 x: f64 [double],
        2 y: f64 [double],
        3 z: f64 [double],
    }
    Quaternion (Copy) {
        1 x: f64 [double],
        2 y: f64 [double],
        3 z: f64 [double],
        4 w: f64 [double],
    }
    Pose (Copy) {
        1 position: Option<Vector3> [message, optional],
        2 orientation: Option<Quaternion> [message, optional],
    }
    PoseInFrame {
        1 timestamp: Option<Timestamp> [message, optional],
        2 frame_id: String [string],
        3 pose: Option<Pose> [message, optional],
    }
    FrameTransform {
        1 timestamp: Option<Timestamp> [message, optional],
        2 parent_frame_id: String [string],
        3 child_frame_id: String [string],
        4 translation: Option<Vector3> [message, optional],
        5 rotation: Option<Quaternion> [message, optional],
    }
    FrameTransforms {
        1 transforms: Vec<FrameTransform> [message, repeated],
    }
    LocationFix {
        1 latitude: f64 [double],
        2 longitude: f64 [double],
        3 altitude: f64 [double],
        6 timestamp: Option<Timestamp> [message, optional],
        7 frame_id: String [string],
    }
    CompressedVideo {
        1 timestamp: Option<Timestamp> [message, optional],
        2 frame_id: String [string],
        3 data: Vec<u8> [bytes = "vec"],
        4 format: String [string],
    }
    CameraCalibration {
        1 timestamp: Option<Timestamp> [message, optional],
        2 width: u32 [fixed32],
        3 height: u32 [fixed32],
        4 distortion_model: String [string],
        5 d: Vec<f64> [double, repeated],
        6 k: Vec<f64> [double, repeated],
        7 r: Vec<f64> [double, repeated],
        8 p: Vec<f64> [double, repeated],
        9 frame_id: String [string],
    }
    Point2 (Copy) {
        1 x: f64 [double],
        2 y: f64 [double],
    }
    Color (Copy) {
        1 r: f64 [double],
        2 g: f64 [double],
        3 b: f64 [double],
        4 a: f64 [double],
    }
    PointsAnnotation {
        1 timestamp: Option<Timestamp> [message, optional],
        2 kind: i32 [int32],
        3 points: Vec<Point2> [message, repeated],
        4 outline_color: Option<Color> [message, optional],
        7 thickness: f64 [double],
    }
    TextAnnotation {
        1 timestamp: Option<Timestamp> [message, optional],
        2 position: Option<Point2> [message, optional],
        3 text: String [string],
        4 font_size: f64 [double],
        5 text_color: Option<Color> [message, optional],
    }
    ImageAnnotations {
        2 points: Vec<PointsAnnotation> [message, repeated],
        3 texts: Vec<TextAnnotation> [message, repeated],
        5 timestamp: Option<Timestamp> [message, optional],
    }
}
