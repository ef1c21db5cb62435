//! `frames.parquet`: one row per tick, with the proof that every view shows that tick.

use std::path::Path;

use crate::camera::CameraPose;
use crate::columns::{Table, TableWriter};
use crate::error::Result;
use crate::pose::{Controls, Pose};

/// What the simulator reported of the frame that one view holds for one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewStamp {
    /// The simulator's frame counter when the picture was taken, counted from the scenario's first picture.
    pub sim_frame: u64,
    /// Presentation timestamp of the picture in the view's video, in units of the video's time base.
    pub pts: i64,
    /// The aircraft's pose that the simulator says it drew.
    pub echoed_pose: Pose,
    /// The camera that the simulator says it drew from.
    pub echoed_camera: CameraPose,
}

/// Labels of one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameLabels {
    /// Geodesic distance to touchdown, metres.
    pub dtd_m: f64,
    /// Distance still to go along the course, metres; negative past the target.
    pub along_track_m: f64,
    /// Offset right of the extended centreline, metres.
    pub cross_track_m: f64,
    /// Height over the touchdown target, metres.
    pub height_over_target_m: f64,
    /// Time until the aircraft passes the target, seconds; missing if the flight ends before.
    pub time_to_touchdown_s: Option<f64>,
}

/// One tick.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Number of the tick, from 0.
    pub tick: u32,
    /// Time since tick 0, nanoseconds.
    pub time_ns: i64,
    /// Pose of the aircraft's centre of gravity.
    pub pose: Pose,
    /// Velocity over ground (north, east, down), metres per second.
    pub velocity_ned_mps: [f64; 3],
    /// True airspeed, metres per second.
    pub true_airspeed_mps: f64,
    /// Flaps and gear.
    pub controls: Controls,
    /// Whether a wheel touches the ground.
    pub on_ground: bool,
    /// One stamp per view, in the order of [`Frames::views`].
    pub views: Vec<ViewStamp>,
    /// Labels, once `dtd label` has run.
    pub labels: Option<FrameLabels>,
}

/// The whole table.
#[derive(Debug, Clone, PartialEq)]
pub struct Frames {
    /// Identifiers of the views.
    pub views: Vec<String>,
    /// All ticks, in order.
    pub rows: Vec<Frame>,
}

/// Name of a value of a pose and how to get it.
type PoseField = (&'static str, fn(&Pose) -> f64);

pub(crate) const POSE_FIELDS: [PoseField; 6] = [
    ("latitude_deg", |p| p.latitude_deg),
    ("longitude_deg", |p| p.longitude_deg),
    ("altitude_msl_m", |p| p.altitude_msl_m),
    ("heading_true_deg", |p| p.heading_true_deg),
    ("pitch_deg", |p| p.pitch_deg),
    ("roll_deg", |p| p.roll_deg),
];

impl Frames {
    /// Writes the table. Label columns are there if every row has labels.
    pub fn write(&self, path: &Path) -> Result<()> {
        let rows = &self.rows;
        let mut table = TableWriter::new()
            .u32("tick", rows.iter().map(|r| r.tick))
            .i64("time_ns", rows.iter().map(|r| r.time_ns));
        for (name, get) in POSE_FIELDS {
            table = table.f64(name, rows.iter().map(|r| get(&r.pose)));
        }
        for (axis, name) in [
            "velocity_north_mps",
            "velocity_east_mps",
            "velocity_down_mps",
        ]
        .into_iter()
        .enumerate()
        {
            table = table.f64(name, rows.iter().map(|r| r.velocity_ned_mps[axis]));
        }
        table = table
            .f64(
                "true_airspeed_mps",
                rows.iter().map(|r| r.true_airspeed_mps),
            )
            .f64("flap_ratio", rows.iter().map(|r| r.controls.flap_ratio))
            .f64("gear_ratio", rows.iter().map(|r| r.controls.gear_ratio))
            .bool("on_ground", rows.iter().map(|r| r.on_ground));
        for (v, id) in self.views.iter().enumerate() {
            table = table
                .u64(
                    &format!("sim_frame_{id}"),
                    rows.iter().map(|r| r.views[v].sim_frame),
                )
                .i64(&format!("pts_{id}"), rows.iter().map(|r| r.views[v].pts));
            for (name, get) in POSE_FIELDS {
                table = table.f64(
                    &format!("echo_{name}_{id}"),
                    rows.iter().map(|r| get(&r.views[v].echoed_pose)),
                );
            }
            for (name, get) in POSE_FIELDS {
                table = table.f64(
                    &format!("camera_{name}_{id}"),
                    rows.iter().map(|r| get(&r.views[v].echoed_camera.pose)),
                );
            }
            table = table.f64(
                &format!("camera_hfov_deg_{id}"),
                rows.iter().map(|r| r.views[v].echoed_camera.hfov_deg),
            );
        }
        if let Some(labels) = rows.iter().map(|r| r.labels).collect::<Option<Vec<_>>>() {
            table = table
                .f64("dtd_m", labels.iter().map(|l| l.dtd_m))
                .f64("along_track_m", labels.iter().map(|l| l.along_track_m))
                .f64("cross_track_m", labels.iter().map(|l| l.cross_track_m))
                .f64(
                    "height_over_target_m",
                    labels.iter().map(|l| l.height_over_target_m),
                )
                .optional_f64(
                    "time_to_touchdown_s",
                    labels.iter().map(|l| l.time_to_touchdown_s),
                );
        }
        table.write(path)
    }

    /// Reads the table.
    pub fn read(path: &Path) -> Result<Self> {
        Self::of(&Table::read(path)?)
    }

    /// Reads the content of the table's file; messages name it as `path`.
    pub fn parse(content: Vec<u8>, path: &Path) -> Result<Self> {
        Self::of(&Table::parse(content, path)?)
    }

    fn of(table: &Table) -> Result<Self> {
        let views: Vec<String> = table
            .column_names()
            .filter_map(|name| name.strip_prefix("sim_frame_"))
            .map(str::to_owned)
            .collect();
        let pose = read_poses(table, "", "")?;
        let tick = table.u32("tick")?;
        let time_ns = table.i64("time_ns")?;
        let velocity = [
            table.f64("velocity_north_mps")?,
            table.f64("velocity_east_mps")?,
            table.f64("velocity_down_mps")?,
        ];
        let true_airspeed_mps = table.f64("true_airspeed_mps")?;
        let flap_ratio = table.f64("flap_ratio")?;
        let gear_ratio = table.f64("gear_ratio")?;
        let on_ground = table.bool("on_ground")?;
        let stamps = views
            .iter()
            .map(|id| read_stamps(table, id))
            .collect::<Result<Vec<_>>>()?;
        let labels = read_labels(table)?;
        let rows = (0..table.rows())
            .map(|row| Frame {
                tick: tick[row],
                time_ns: time_ns[row],
                pose: pose[row],
                velocity_ned_mps: [velocity[0][row], velocity[1][row], velocity[2][row]],
                true_airspeed_mps: true_airspeed_mps[row],
                controls: Controls {
                    flap_ratio: flap_ratio[row],
                    gear_ratio: gear_ratio[row],
                },
                on_ground: on_ground[row],
                views: stamps.iter().map(|stamps| stamps[row]).collect(),
                labels: labels.as_ref().map(|labels| labels[row]),
            })
            .collect();
        Ok(Self { views, rows })
    }
}

fn read_poses(table: &Table, prefix: &str, suffix: &str) -> Result<Vec<Pose>> {
    let column = |name: &str| table.f64(&format!("{prefix}{name}{suffix}"));
    let [latitude, longitude, altitude, heading, pitch, roll] = [
        column("latitude_deg")?,
        column("longitude_deg")?,
        column("altitude_msl_m")?,
        column("heading_true_deg")?,
        column("pitch_deg")?,
        column("roll_deg")?,
    ];
    Ok((0..table.rows())
        .map(|row| Pose {
            latitude_deg: latitude[row],
            longitude_deg: longitude[row],
            altitude_msl_m: altitude[row],
            heading_true_deg: heading[row],
            pitch_deg: pitch[row],
            roll_deg: roll[row],
        })
        .collect())
}

fn read_stamps(table: &Table, id: &str) -> Result<Vec<ViewStamp>> {
    let sim_frame = table.u64(&format!("sim_frame_{id}"))?;
    let pts = table.i64(&format!("pts_{id}"))?;
    let suffix = format!("_{id}");
    let pose = read_poses(table, "echo_", &suffix)?;
    let camera = read_poses(table, "camera_", &suffix)?;
    let hfov_deg = table.f64(&format!("camera_hfov_deg_{id}"))?;
    Ok((0..table.rows())
        .map(|row| ViewStamp {
            sim_frame: sim_frame[row],
            pts: pts[row],
            echoed_pose: pose[row],
            echoed_camera: CameraPose {
                pose: camera[row],
                hfov_deg: hfov_deg[row],
            },
        })
        .collect())
}

fn read_labels(table: &Table) -> Result<Option<Vec<FrameLabels>>> {
    if !table.has("dtd_m") {
        return Ok(None);
    }
    let dtd_m = table.f64("dtd_m")?;
    let along_track_m = table.f64("along_track_m")?;
    let cross_track_m = table.f64("cross_track_m")?;
    let height_over_target_m = table.f64("height_over_target_m")?;
    let time_to_touchdown_s = table.optional_f64("time_to_touchdown_s")?;
    let labels = (0..table.rows()).map(|row| FrameLabels {
        dtd_m: dtd_m[row],
        along_track_m: along_track_m[row],
        cross_track_m: cross_track_m[row],
        height_over_target_m: height_over_target_m[row],
        time_to_touchdown_s: time_to_touchdown_s[row],
    });
    Ok(Some(labels.collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(offset: f64) -> Pose {
        Pose {
            latitude_deg: 1.3 + offset,
            longitude_deg: 103.9,
            altitude_msl_m: 700.0,
            heading_true_deg: 23.0,
            pitch_deg: 2.5,
            roll_deg: -0.5,
        }
    }

    fn frames(labels: Option<FrameLabels>) -> Frames {
        let stamp = |view: f64| ViewStamp {
            sim_frame: 812,
            pts: 1,
            echoed_pose: pose(0.25),
            echoed_camera: CameraPose {
                pose: pose(view),
                hfov_deg: 10.0,
            },
        };
        let row = Frame {
            tick: 0,
            time_ns: 0,
            pose: pose(0.25),
            velocity_ned_mps: [60.0, 25.0, 3.5],
            true_airspeed_mps: 70.0,
            controls: Controls {
                flap_ratio: 0.75,
                gear_ratio: 1.0,
            },
            on_ground: false,
            views: vec![stamp(1.0), stamp(2.0)],
            labels,
        };
        Frames {
            views: vec!["left".into(), "right".into()],
            rows: vec![row],
        }
    }

    #[test]
    fn what_is_written_is_read_back_with_and_without_labels() {
        let labels = FrameLabels {
            dtd_m: 18_000.0,
            along_track_m: 17_999.0,
            cross_track_m: -3.0,
            height_over_target_m: 693.0,
            time_to_touchdown_s: None,
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("frames.parquet");
        for table in [frames(None), frames(Some(labels))] {
            table.write(&path).unwrap();
            assert_eq!(Frames::read(&path).unwrap(), table);
        }
    }

    #[test]
    fn a_missing_column_is_named_with_the_columns_that_are_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("frames.parquet");
        TableWriter::new().u32("tick", [0]).write(&path).unwrap();
        let message = Frames::read(&path).unwrap_err().to_string();
        assert!(
            message.contains("latitude_deg") && message.contains("its columns are tick"),
            "{message}"
        );
    }
}
