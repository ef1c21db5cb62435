//! MCAP for Foxglove: a file per scenario with the coded images of all views, the aircraft's pose and place, the cameras, the boxes and
//! the labels, in the order of time. Images are the packets of the corpus's videos, without re-encoding.
//!
//! Places are relative to the touchdown target, in the frame `touchdown`: x east, y north, z up. The aircraft's frame `aircraft` has x
//! forward, y left, z up; the frame of a camera has the name of its view and OpenCV's axes. Times count from tick 0.

mod foxglove;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use dataset::corpus::calibration::CameraEntry;
use dataset::geometry::geodesy::Geodetic;
use dataset::tables::frames::{TickLabels, TickRow};
use dataset::video::PacketReader;
use glam::{DMat3, DQuat, DVec3};
use mcap::records::MessageHeader;
use mcap::{Compression, McapError, WriteOptions, Writer};
use serde::Serialize;
use serde_json::{Value, json};

use self::foxglove::{
    CameraCalibration, Color, CompressedVideo, FrameTransform, FrameTransforms, ImageAnnotations,
    LINE_LOOP, LocationFix, Named, Point2, PointsAnnotation, Pose, PoseInFrame, Quaternion,
    SCHEMAS, TextAnnotation, Timestamp, Vector3,
};
use crate::error::{Error, Result};
use crate::file_format::{FileFormat, Writing, Written};
use crate::request::{Abilities, BoxSource};
use crate::scenarios::{LabelledBox, Source};

const WORLD: &str = "touchdown";
const AIRCRAFT: &str = "aircraft";
const GREEN: Color = Color {
    r: 0.1,
    g: 0.9,
    b: 0.2,
    a: 1.0,
};
const ORANGE: Color = Color {
    r: 1.0,
    g: 0.6,
    b: 0.0,
    a: 1.0,
};

/// Values that `/labels` plots.
#[derive(Serialize)]
struct Labels {
    #[serde(flatten)]
    labels: TickLabels,
    true_airspeed_mps: f64,
}

/// The format.
pub(super) struct Mcap;

impl FileFormat for Mcap {
    fn abilities(&self) -> Abilities {
        Abilities {
            has_every: false,
            ..Abilities::of_videos("mcap")
        }
    }

    fn write(&self, scenario: &Writing<'_>) -> Result<Value> {
        let source = &scenario.source;
        let path = scenario.folder.join(format!("{}.mcap", source.record.id));
        let mut views = Vec::new();
        for view in &source.selected.views {
            let packets = source.scenario.open_packets(view)?;
            let (index, camera) = source.view(view)?;
            views.push(View {
                name: view,
                index,
                camera,
                packets,
            });
        }
        let world = World::at(source.record.touchdown);
        let mut file = McapFile::create(&path)?;
        file.metadata(source)?;
        for row in &source.frames.rows {
            let time = Time::of(row);
            if row.tick == 0 {
                file.cameras(&views, &world, time)?;
            }
            file.aircraft(row, &world, time)?;
            if let Some(labels) = row.labels {
                file.labels(row, labels, time)?;
            }
            for view in &mut views {
                scenario.watch.check()?;
                let expected = row.views[view.index].pts;
                let picture = view.packets.next_picture()?;
                let found = picture.as_ref().map(|picture| picture.pts);
                let picture = picture.filter(|picture| picture.pts == expected);
                let picture = picture
                    .ok_or_else(|| source.lost_picture(view.name, row.tick, expected, found))?;
                let video = CompressedVideo {
                    timestamp: Some(time.stamp()),
                    frame_id: view.name.to_owned(),
                    data: picture.data,
                    format: "h264".to_owned(),
                };
                file.send(&format!("/{}/video", view.name), time, &video)?;
                let boxes = source.boxes_of(view.name, row.tick);
                let found = match scenario.export.request.boxes {
                    BoxSource::Truth => {
                        let topic = format!("/{}/boxes", view.name);
                        file.send(&topic, time, &annotations(boxes, GREEN, time))?;
                        source.beside(view.name, row.tick)
                    }
                    BoxSource::Detections => boxes,
                };
                if source.model.is_some() {
                    let topic = format!("/{}/detections", view.name);
                    file.send(&topic, time, &annotations(found, ORANGE, time))?;
                }
                scenario.pictures_done(1);
            }
        }
        file.finish()?;
        Ok(Value::Null)
    }

    fn finish(&self, _: &Written<'_>) -> Result<()> {
        Ok(())
    }
}

/// A view whose packets are read.
struct View<'a> {
    name: &'a str,
    /// Index in the table's rows.
    index: usize,
    camera: &'a CameraEntry,
    packets: PacketReader,
}

/// Time since tick 0.
#[derive(Clone, Copy)]
struct Time {
    ns: u64,
}

impl Time {
    fn of(row: &TickRow) -> Self {
        Self {
            ns: u64::try_from(row.time_ns).unwrap_or(0),
        }
    }

    fn stamp(self) -> Timestamp {
        const NS_PER_S: u64 = 1_000_000_000;
        Timestamp {
            seconds: (self.ns / NS_PER_S) as i64,
            nanos: (self.ns % NS_PER_S) as i32,
        }
    }
}

/// The frame of the touchdown target.
struct World {
    origin_ecef_m: DVec3,
    enu_from_ecef: DMat3,
}

impl World {
    fn at(target: Geodetic) -> Self {
        let enu_from_ned = DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::NEG_Z);
        Self {
            origin_ecef_m: target.to_ecef(),
            enu_from_ecef: enu_from_ned * target.ecef_from_ned().transpose(),
        }
    }

    fn pose(&self, ecef_from_body: DMat3, ecef_m: DVec3) -> Pose {
        let position = self.enu_from_ecef * (ecef_m - self.origin_ecef_m);
        let turned = DQuat::from_mat3(&(self.enu_from_ecef * ecef_from_body)).normalize();
        Pose {
            position: Some(Vector3 {
                x: position.x,
                y: position.y,
                z: position.z,
            }),
            orientation: Some(Quaternion {
                x: turned.x,
                y: turned.y,
                z: turned.z,
                w: turned.w,
            }),
        }
    }

    /// Aircraft pose: x forward, y left, z up.
    fn aircraft(&self, row: &TickRow) -> Pose {
        let forward_right_down_from_forward_left_up =
            DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        self.pose(
            row.pose.ecef_from_body() * forward_right_down_from_forward_left_up,
            row.pose.position().to_ecef(),
        )
    }
}

fn transform(time: Time, child: &str, pose: Pose) -> FrameTransform {
    FrameTransform {
        timestamp: Some(time.stamp()),
        parent_frame_id: WORLD.to_owned(),
        child_frame_id: child.to_owned(),
        translation: pose.position,
        rotation: pose.orientation,
    }
}

fn calibration(view: &View<'_>, time: Time) -> CameraCalibration {
    let k = view.camera.k;
    let [[fx, _, cx], [_, fy, cy], _] = k;
    let identity = DMat3::IDENTITY.to_cols_array();
    CameraCalibration {
        timestamp: Some(time.stamp()),
        frame_id: view.name.to_owned(),
        width: view.camera.width_px,
        height: view.camera.height_px,
        distortion_model: if view.camera.distortion.is_empty() {
            String::new()
        } else {
            "plumb_bob".to_owned()
        },
        d: view.camera.distortion.clone(),
        k: k.concat(),
        r: identity.to_vec(),
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
}

/// Boxes as outlines: above a detection its score, above a ground-truth box the number of its aircraft if there are several.
fn annotations(boxes: &[LabelledBox], color: Color, time: Time) -> ImageAnnotations {
    let outline = |labelled: &LabelledBox| {
        let [left, top, width, height] = labelled.corner_and_size();
        let (right, bottom) = (left + width, top + height);
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
        PointsAnnotation {
            timestamp: Some(time.stamp()),
            kind: LINE_LOOP,
            points: corners.map(|(x, y)| Point2 { x, y }).to_vec(),
            outline_color: Some(color),
            thickness: 1.0,
        }
    };
    let text = |labelled: &LabelledBox| {
        let [x, y, ..] = labelled.corner_and_size();
        let number = labelled.truth.and_then(|truth| truth.aircraft_number);
        let score = labelled.score.map(|score| format!("{score:.2}"));
        let words = score.or_else(|| number.map(|number| number.to_string()));
        words.map(|text| TextAnnotation {
            timestamp: Some(time.stamp()),
            position: Some(Point2 { x, y }),
            text,
            font_size: 12.0,
            text_color: Some(color),
        })
    };
    ImageAnnotations {
        timestamp: Some(time.stamp()),
        points: boxes.iter().map(outline).collect(),
        texts: boxes.iter().filter_map(text).collect(),
    }
}

/// A file that is written.
struct McapFile {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    /// Messages that were sent, by channel.
    sent: BTreeMap<u16, u32>,
}

impl McapFile {
    fn create(path: &Path) -> Result<Self> {
        let file = File::create(path).map_err(dataset::Error::io("create", path))?;
        let options = WriteOptions::new()
            .library(concat!("dtd ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_threads(0);
        let writer = options.create(BufWriter::new(file));
        Ok(Self {
            writer: writer.map_err(failed(path))?,
            path: path.to_owned(),
            sent: BTreeMap::new(),
        })
    }

    /// Writes the description of the scenario.
    fn metadata(&mut self, source: &Source<'_>) -> Result<()> {
        let record = &source.record;
        let metadata = [
            ("scenario", &*record.id),
            ("weather", record.weather_name()),
            ("time_of_day", record.time_of_day()),
            ("config_hash", &record.config_hash),
            ("manifest_blake3", &source.scenario.seal().manifest_blake3),
        ];
        let metadata = mcap::records::Metadata {
            name: "dtd".to_owned(),
            metadata: metadata
                .map(|(name, value)| (name.to_owned(), value.to_owned()))
                .into(),
        };
        let written = self.writer.write_metadata(&metadata);
        written.map_err(failed(&self.path))
    }

    fn cameras(&mut self, views: &[View<'_>], world: &World, time: Time) -> Result<()> {
        let transforms = views.iter().map(|view| {
            let camera = view.camera.camera();
            let pose = world.pose(camera.ecef_from_camera, camera.center_ecef_m);
            transform(time, view.name, pose)
        });
        let transforms = FrameTransforms {
            transforms: transforms.collect(),
        };
        self.send("/cameras", time, &transforms)?;
        for view in views {
            let topic = format!("/{}/calibration", view.name);
            self.send(&topic, time, &calibration(view, time))?;
        }
        Ok(())
    }

    fn aircraft(&mut self, row: &TickRow, world: &World, time: Time) -> Result<()> {
        let pose = world.aircraft(row);
        let transforms = FrameTransforms {
            transforms: vec![transform(time, AIRCRAFT, pose)],
        };
        self.send("/aircraft/transform", time, &transforms)?;
        let in_frame = PoseInFrame {
            timestamp: Some(time.stamp()),
            frame_id: WORLD.to_owned(),
            pose: Some(pose),
        };
        self.send("/aircraft/pose", time, &in_frame)?;
        let location = LocationFix {
            latitude: row.pose.latitude_deg,
            longitude: row.pose.longitude_deg,
            altitude: row.pose.altitude_msl_m,
            timestamp: Some(time.stamp()),
            frame_id: AIRCRAFT.to_owned(),
        };
        self.send("/aircraft/location", time, &location)
    }

    fn labels(&mut self, row: &TickRow, labels: TickLabels, time: Time) -> Result<()> {
        let labels = Labels {
            labels,
            true_airspeed_mps: row.true_airspeed_mps,
        };
        let bytes = serde_json::to_vec(&labels)
            .map_err(|e| dataset::Error::io("write", &self.path)(e.into()))?;
        let schema = schema_of_labels().to_string();
        let schema = ("dtd.Labels", "jsonschema", schema.as_bytes());
        self.write("/labels", schema, "json", time, &bytes)
    }

    /// Writes a message of Foxglove's.
    fn send<M: Named>(&mut self, topic: &str, time: Time, message: &M) -> Result<()> {
        let schema = (M::SCHEMA, "protobuf", SCHEMAS);
        self.write(topic, schema, "protobuf", time, &message.encode_to_vec())
    }

    /// Writes a message; `schema` is its name, encoding and text.
    fn write(
        &mut self,
        topic: &str,
        schema: (&str, &str, &[u8]),
        encoding: &str,
        time: Time,
        data: &[u8],
    ) -> Result<()> {
        let failed = failed(&self.path);
        // A schema and a channel are written when they are added for the first time.
        let (name, schema_encoding, text) = schema;
        let added = self.writer.add_schema(name, schema_encoding, text);
        let schema = added.map_err(&failed)?;
        let added = (self.writer).add_channel(schema, topic, encoding, &BTreeMap::new());
        let channel_id = added.map_err(&failed)?;
        let sent = self.sent.entry(channel_id).or_default();
        let header = MessageHeader {
            channel_id,
            sequence: *sent,
            log_time: time.ns,
            publish_time: time.ns,
        };
        *sent += 1;
        let written = self.writer.write_to_known_channel(&header, data);
        written.map_err(failed)
    }

    fn finish(mut self) -> Result<()> {
        self.writer.finish().map_err(failed(&self.path))?;
        let ended = self.writer.into_inner().into_inner();
        ended.map_err(|e| dataset::Error::io("write", &self.path)(e.into_error()))?;
        Ok(())
    }
}

fn schema_of_labels() -> Value {
    let number = json!({"type": "number"});
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "dtd.Labels",
        "description": "Where the aircraft is relative to the touchdown target, as in the corpus's frames.parquet.",
        "type": "object",
        "properties": {
            "dtd_m": number,
            "along_track_m": number,
            "cross_track_m": number,
            "height_over_target_m": number,
            "time_to_touchdown_s": {"type": ["number", "null"]},
            "true_airspeed_mps": number,
        },
    })
}

fn failed(path: &Path) -> impl Fn(McapError) -> Error {
    let path = path.to_owned();
    move |source| Error::Mcap {
        path: path.clone(),
        r#source: Box::new(source),
    }
}
