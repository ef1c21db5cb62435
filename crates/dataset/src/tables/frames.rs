//! `frames.parquet`: one row per tick, with the evidence that every view shows that tick.

use std::path::Path;

use schemars::JsonSchema;
use serde::Serialize;

use crate::error::Result;
use crate::geometry::camera::CameraPose;
use crate::geometry::pose::{Controls, Pose};
use crate::numbers::limits;
use crate::tables::columns::{ColumnOutOfLimits, Table, TableWriter};
use crate::tables::row_parts::{NumberColumn, Numbers, numbers};
use crate::work::memory;

/// The simulator's report about a view's image at one tick.
#[derive(Debug, Clone, Copy, PartialEq, JsonSchema)]
pub struct ViewStamp {
    /// The simulator's frame counter of the image, counted from the scenario's first image. It grows from image to image, views of a tick
    /// in the order of `views` in `scenario.json`. With `blocks` in `scenario.json`: the drawn frame in which the tick was written; no two
    /// ticks of a view share one, all frames of a block and view come before the frames of the next, and within a block they grow with the
    /// ticks but for at most `repeated_ticks`.
    pub sim_frame: u64,
    /// Presentation timestamp of the image in the view's video, in units of 1/numerator of the frame rate, seconds.
    pub pts: i64,
    /// The pose of the aircraft that the simulator reports as drawn: equal to the tick's within 0.01 m and 0.001 degrees (X-Plane uses
    /// 32-bit floats; the bundled simulator reports it exactly).
    pub echoed_pose: Pose,
    /// The camera that the simulator reports as used: the calibrated one within 0.01 m and 0.0002 degrees.
    pub echoed_camera: CameraPose,
}

/// Tick labels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct TickLabels {
    /// **Distance to touchdown** (DTD): geodesic distance over ground from the centre of gravity to the touchdown target, metres.
    pub dtd_m: f64,
    /// Remaining distance along the course, metres; negative past the target.
    pub along_track_m: f64,
    /// Offset from the extended centreline, metres; right of the landing course positive.
    pub cross_track_m: f64,
    /// Height of the centre of gravity over the touchdown target, metres.
    pub height_over_target_m: f64,
    /// Time until the aircraft passes abeam the target, seconds; negative afterwards; null if the recording does not contain that moment.
    pub time_to_touchdown_s: Option<f64>,
}

/// A tick.
#[derive(Debug, Clone, PartialEq, JsonSchema)]
pub struct TickRow {
    /// Number of the tick, from 0.
    pub tick: u32,
    /// Time since tick 0, nanoseconds.
    pub time_ns: i64,
    /// Pose of the aircraft's centre of gravity.
    pub pose: Pose,
    /// Velocity over ground: north, east, down, metres per second.
    pub velocity_ned_mps: [f64; 3],
    /// True airspeed, metres per second.
    pub true_airspeed_mps: f64,
    /// Flaps and gear.
    pub controls: Controls,
    /// True if a wheel touches the ground.
    pub on_ground: bool,
    /// Stamps of the views' images, in the order of [`Frames::views`]; empty in a recorded scenario.
    pub views: Vec<ViewStamp>,
    /// Only in recorded scenarios: time of the view's image nearest to the tick, within half a period, by the corrected clock,
    /// nanoseconds since tick 0; null if the view has none.
    pub image_times_ns: Vec<Option<i64>>,
    /// Labels, once `dtd label` has run.
    pub labels: Option<TickLabels>,
    /// Only in recorded scenarios: standard deviation of `dtd_m`, metres.
    pub dtd_sd_m: Option<f64>,
}

/// The whole table.
#[derive(Debug, Clone, PartialEq)]
pub struct Frames {
    /// Identifiers of the views.
    pub views: Vec<String>,
    /// All ticks, in order.
    pub rows: Vec<TickRow>,
}

numbers!(Pose, 6, {
    latitude_deg: limits::LATITUDE_DEG,
    longitude_deg: limits::LONGITUDE_DEG,
    altitude_msl_m: limits::ALTITUDE_MSL_M,
    heading_true_deg: limits::HEADING_TRUE_DEG,
    pitch_deg: limits::PITCH_DEG,
    roll_deg: limits::ROLL_DEG,
});

numbers!(Controls, 2, {
    flap_ratio: limits::RATIO,
    gear_ratio: limits::RATIO,
});

/// Columns of the camera's pose, which may look up or lie on its side.
const CAMERA_POSE: [NumberColumn; 6] = {
    let mut columns = Pose::COLUMNS;
    columns[4].1 = limits::CAMERA_PITCH_DEG;
    columns[5].1 = limits::CAMERA_ROLL_DEG;
    columns
};

const VELOCITY: [NumberColumn; 3] = [
    ("velocity_north_mps", limits::VELOCITY_MPS),
    ("velocity_east_mps", limits::VELOCITY_MPS),
    ("velocity_down_mps", limits::VELOCITY_DOWN_MPS),
];

/// Columns of [`TickLabels`] without gaps.
const LABELS: [NumberColumn; 4] = [
    ("dtd_m", limits::DTD_M),
    ("along_track_m", limits::TRACK_M),
    ("cross_track_m", limits::TRACK_M),
    ("height_over_target_m", limits::HEIGHT_OVER_TARGET_M),
];

/// Start of the name of a recorded view's column.
const IMAGE_TIME: &str = "image_time_ns_";
const DTD_SD: &str = "dtd_sd_m";

/// A view's columns: their names with a prefix and the view's identifier.
fn of_view<const N: usize>(
    columns: [NumberColumn; N],
    prefix: &str,
    view: &str,
) -> [NumberColumn<String>; N] {
    columns.map(|(name, limits)| (format!("{prefix}_{name}_{view}"), limits))
}

impl Frames {
    /// Writes the table if all numbers are within their limits. It has label columns if every row has labels.
    pub fn write(&self, path: &Path) -> Result<()> {
        self.columns().write(path)
    }

    /// True if the images have their own times: no simulator drew them for the ticks.
    pub fn is_recorded(&self) -> bool {
        let mut rows = self.rows.iter();
        rows.any(|row| !row.image_times_ns.is_empty())
    }

    /// The table with its columns.
    pub fn columns(&self) -> TableWriter {
        let rows = &self.rows;
        let mut table = TableWriter::new()
            .u32("tick", rows.iter().map(|r| r.tick))
            .i64("time_ns", rows.iter().map(|r| r.time_ns))
            .numbers(Pose::COLUMNS, rows.iter().map(|r| r.pose.to_array()))
            .numbers(VELOCITY, rows.iter().map(|r| r.velocity_ned_mps))
            .f64_within(
                "true_airspeed_mps",
                limits::TRUE_AIRSPEED_MPS,
                rows.iter().map(|r| r.true_airspeed_mps),
            )
            .numbers(
                Controls::COLUMNS,
                rows.iter().map(|r| r.controls.to_array()),
            )
            .bool("on_ground", rows.iter().map(|r| r.on_ground));
        for (v, id) in self.views.iter().enumerate() {
            if self.is_recorded() {
                let times = rows.iter().map(|r| r.image_times_ns[v]);
                table = table.optional_i64(&format!("{IMAGE_TIME}{id}"), times);
                continue;
            }
            let stamps = rows.iter().map(|r| &r.views[v]);
            let cameras = stamps.clone().map(|stamp| stamp.echoed_camera);
            table = table
                .u64(
                    &format!("sim_frame_{id}"),
                    stamps.clone().map(|stamp| stamp.sim_frame),
                )
                .i64(&format!("pts_{id}"), stamps.clone().map(|stamp| stamp.pts))
                .numbers(
                    of_view(Pose::COLUMNS, "echo", id),
                    stamps.map(|stamp| stamp.echoed_pose.to_array()),
                )
                .numbers(
                    of_view(CAMERA_POSE, "camera", id),
                    cameras.clone().map(|camera| camera.pose.to_array()),
                )
                .f64_within(
                    &format!("camera_hfov_deg_{id}"),
                    limits::HFOV_DEG,
                    cameras.map(|camera| camera.hfov_deg),
                );
        }
        if let Some(labels) = rows.iter().map(|r| r.labels).collect::<Option<Vec<_>>>() {
            let numbers = |l: &TickLabels| {
                [
                    l.dtd_m,
                    l.along_track_m,
                    l.cross_track_m,
                    l.height_over_target_m,
                ]
            };
            table = table
                .numbers(LABELS, labels.iter().map(numbers))
                .optional_f64_within(
                    "time_to_touchdown_s",
                    limits::TIME_TO_TOUCHDOWN_S,
                    labels.iter().map(|l| l.time_to_touchdown_s),
                );
        }
        if let Some(sds_m) = rows.iter().map(|r| r.dtd_sd_m).collect::<Option<Vec<_>>>()
            && self.is_recorded()
        {
            table = table.f64_within(DTD_SD, limits::SD_M, sds_m);
        }
        table
    }

    /// Reads the table. A number outside its limits is an error.
    pub fn read(path: &Path) -> Result<Self> {
        Self::of_table(&mut Table::read(path, limits::MAX_TICKS.into())?)
    }

    /// Like [`Self::read`], but collects numbers outside their limits.
    pub fn read_with_faults(path: &Path) -> Result<(Self, Vec<ColumnOutOfLimits>)> {
        Table::read_with_faults(path, limits::MAX_TICKS.into(), Self::of_table)
    }

    /// Reads the content of the table's file; messages name it as `path`.
    pub fn parse(content: Vec<u8>, path: &Path) -> Result<Self> {
        Self::of_table(&mut Table::parse(content, path, limits::MAX_TICKS.into())?)
    }

    fn of_table(table: &mut Table) -> Result<Self> {
        let named = |prefix: &str| -> Vec<String> {
            let names = table.column_names();
            let views = names.filter_map(|name| name.strip_prefix(prefix));
            views.map(str::to_owned).collect()
        };
        let mut views = named("sim_frame_");
        let is_recorded = views.is_empty();
        if is_recorded {
            views = named(IMAGE_TIME);
        }
        if views.len() > limits::MAX_VIEWS {
            let (found, most) = (views.len(), limits::MAX_VIEWS);
            return Err(table.fault(format!("has {found} views, expected at most {most}")));
        }
        let row_bytes = size_of::<TickRow>() + 2 * views.len() * size_of::<ViewStamp>();
        memory::check("table of frames", (table.rows() * row_bytes) as u64)?;
        let pose = table.numbers(Pose::COLUMNS)?;
        let tick = table.u32("tick")?;
        let time_ns = table.i64("time_ns")?;
        let velocity_ned_mps = table.numbers(VELOCITY)?;
        let true_airspeed_mps = table.f64_within("true_airspeed_mps", limits::TRUE_AIRSPEED_MPS)?;
        let controls = table.numbers(Controls::COLUMNS)?;
        let on_ground = table.bool("on_ground")?;
        let (mut stamps, mut image_times, mut sds_m) = (Vec::new(), Vec::new(), None);
        for id in &views {
            if is_recorded {
                image_times.push(table.optional_i64(&format!("{IMAGE_TIME}{id}"))?);
            } else {
                stamps.push(read_stamps(table, id)?);
            }
        }
        if is_recorded && table.has(DTD_SD) {
            sds_m = Some(table.f64_within(DTD_SD, limits::SD_M)?);
        }
        let labels = read_labels(table)?;
        let rows = (0..table.rows())
            .map(|row| TickRow {
                tick: tick[row],
                time_ns: time_ns[row],
                pose: Pose::of_array(pose[row]),
                velocity_ned_mps: velocity_ned_mps[row],
                true_airspeed_mps: true_airspeed_mps[row],
                controls: Controls::of_array(controls[row]),
                on_ground: on_ground[row],
                views: stamps.iter().map(|stamps| stamps[row]).collect(),
                image_times_ns: image_times.iter().map(|times| times[row]).collect(),
                labels: labels.as_ref().map(|labels| labels[row]),
                dtd_sd_m: sds_m.as_ref().map(|sds_m| sds_m[row]),
            })
            .collect();
        Ok(Self { views, rows })
    }
}

fn read_stamps(table: &mut Table, id: &str) -> Result<Vec<ViewStamp>> {
    let sim_frame = table.u64(&format!("sim_frame_{id}"))?;
    let pts = table.i64(&format!("pts_{id}"))?;
    let pose = table.numbers(of_view(Pose::COLUMNS, "echo", id))?;
    let camera = table.numbers(of_view(CAMERA_POSE, "camera", id))?;
    let hfov_deg = table.f64_within(&format!("camera_hfov_deg_{id}"), limits::HFOV_DEG)?;
    Ok((0..table.rows())
        .map(|row| ViewStamp {
            sim_frame: sim_frame[row],
            pts: pts[row],
            echoed_pose: Pose::of_array(pose[row]),
            echoed_camera: CameraPose {
                pose: Pose::of_array(camera[row]),
                hfov_deg: hfov_deg[row],
            },
        })
        .collect())
}

fn read_labels(table: &mut Table) -> Result<Option<Vec<TickLabels>>> {
    if !table.has("dtd_m") {
        return Ok(None);
    }
    let numbers = table.numbers(LABELS)?.into_iter();
    let times_s = table.optional_f64_within("time_to_touchdown_s", limits::TIME_TO_TOUCHDOWN_S)?;
    let labels = numbers.zip(times_s).map(
        |([dtd_m, along_track_m, cross_track_m, height_over_target_m], time_to_touchdown_s)| {
            TickLabels {
                dtd_m,
                along_track_m,
                cross_track_m,
                height_over_target_m,
                time_to_touchdown_s,
            }
        },
    );
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

    fn frames(labels: Option<TickLabels>) -> Frames {
        let stamp = |view: f64| ViewStamp {
            sim_frame: 812,
            pts: 1,
            echoed_pose: pose(0.25),
            echoed_camera: CameraPose {
                pose: pose(view),
                hfov_deg: 10.0,
            },
        };
        let row = TickRow {
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
            image_times_ns: Vec::new(),
            labels,
            dtd_sd_m: None,
        };
        Frames {
            views: vec!["left".into(), "right".into()],
            rows: vec![row],
        }
    }

    #[test]
    fn what_is_written_is_read_back_with_and_without_labels() {
        let labels = TickLabels {
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
    fn a_number_that_no_airliner_has_is_neither_written_nor_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("frames.parquet");
        type Change = fn(&mut TickRow);
        let changes: [(&str, Change); 6] = [
            ("pitch_deg 1e17", |f| f.pose.pitch_deg = 1e17),
            ("roll_deg 179", |f| f.pose.roll_deg = 179.0),
            ("true_airspeed_mps 1e308", |f| f.true_airspeed_mps = 1e308),
            ("gear_ratio -5", |f| f.controls.gear_ratio = -5.0),
            ("echo_latitude_deg_right NaN", |f| {
                f.views[1].echoed_pose.latitude_deg = f64::NAN;
            }),
            ("camera_hfov_deg_left inf", |f| {
                f.views[0].echoed_camera.hfov_deg = f64::INFINITY;
            }),
        ];
        for (words, change) in changes {
            let mut table = frames(None);
            let mut odd = table.rows[0].clone();
            change(&mut odd);
            table.rows.push(odd);
            let words = format!("frames.parquet row 1: {words} is out of range; expected ");
            let message = table.write(&path).unwrap_err().to_string();
            assert!(message.contains(&words), "{message}");
            table.columns().unchecked().write(&path).unwrap();
            let message = Frames::read(&path).unwrap_err().to_string();
            assert!(message.contains(&words), "{message}");
            let (read, faults) = Frames::read_with_faults(&path).unwrap();
            assert_eq!((read.rows.len(), faults.len()), (2, 1));
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
