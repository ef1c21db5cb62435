//! Columns of an export's tables: one list for the tables themselves, their dataset card and `croissant.json`.

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Text,
    Bool,
    U32,
    U64,
    I64,
    F64,
    /// This many floats in each row.
    F64s(u32),
}

/// A column. Its unit is in its name.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Column {
    pub(crate) name: &'static str,
    pub(crate) kind: Kind,
    pub(crate) meaning: &'static str,
}

/// A table.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TableText {
    pub(crate) name: &'static str,
    /// Entity that a row describes.
    pub(crate) row: &'static str,
    pub(crate) columns: &'static [Column],
}

/// Units by the ending of a name, longer endings first.
const UNITS: [(&str, &str); 8] = [
    ("_mps", "m/s"),
    ("_deg", "degree"),
    ("_ns", "ns"),
    ("_px", "px"),
    ("_s", "s"),
    ("_m", "m"),
    ("_ratio", "1"),
    ("_fraction", "1"),
];

/// The unit that the name of a column says.
pub(crate) fn unit_of(name: &str) -> Option<&'static str> {
    let mut units = UNITS.iter();
    units.find_map(|(ending, unit)| name.ends_with(ending).then_some(*unit))
}

const fn column(name: &'static str, kind: Kind, meaning: &'static str) -> Column {
    Column {
        name,
        kind,
        meaning,
    }
}

const SCENARIO: Column = column("scenario", Kind::Text, "identifier of the scenario");
const TRAJECTORY: Column = column(
    "trajectory",
    Kind::Text,
    "what is flown; scenarios of one trajectory are on one side of the split",
);
const WEATHER: Column = column("weather", Kind::Text, "name of the weather");
const TIME_OF_DAY: Column = column("time_of_day", Kind::Text, "local time, HH:MM");
const VIEW: Column = column("view", Kind::Text, "identifier of the view");
const TICK: Column = column(
    "tick",
    Kind::U32,
    "number of the tick, from 0; the picture with this number in the video of each view",
);
const CX: Column = column(
    "cx_px",
    Kind::F64,
    "centre of the box, right; (0, 0) is the centre of the top-left pixel",
);
const CY: Column = column("cy_px", Kind::F64, "centre of the box, down");
const WIDTH: Column = column("width_px", Kind::F64, "width of the box");
const HEIGHT: Column = column("height_px", Kind::F64, "height of the box");

pub(crate) const SCENARIOS: TableText = TableText {
    name: "scenarios",
    row: "scenario: a recorded approach",
    columns: &[
        SCENARIO,
        TRAJECTORY,
        WEATHER,
        TIME_OF_DAY,
        column("visibility_m", Kind::F64, "meteorological visibility"),
        column("rain_ratio", Kind::F64, "rain, 0 to 1"),
        column("turbulence_ratio", Kind::F64, "turbulence, 0 to 1"),
        column("wind_speed_mps", Kind::F64, "speed of the wind"),
        column(
            "wind_from_true_deg",
            Kind::F64,
            "where the wind comes from, clockwise from true north",
        ),
        column("aircraft", Kind::Text, "type of the aircraft"),
        column("airport", Kind::Text, "ICAO identifier of the airport"),
        column("runway", Kind::Text, "name of the runway"),
        column(
            "course_true_deg",
            Kind::F64,
            "course of the landing, clockwise from true north",
        ),
        column("glide_path_deg", Kind::F64, "slope of the glide path"),
        column(
            "touchdown_latitude_deg",
            Kind::F64,
            "touchdown target, WGS-84",
        ),
        column(
            "touchdown_longitude_deg",
            Kind::F64,
            "touchdown target, WGS-84",
        ),
        column(
            "touchdown_altitude_msl_m",
            Kind::F64,
            "height of the touchdown target, taken as height above the ellipsoid",
        ),
        column("rig", Kind::Text, "name of the camera rig"),
        column("ticks", Kind::U32, "number of ticks of the recording"),
        column(
            "frame_rate_numerator",
            Kind::U32,
            "pictures in frame_rate_denominator seconds",
        ),
        column(
            "frame_rate_denominator",
            Kind::U32,
            "seconds in which frame_rate_numerator pictures pass",
        ),
        column("seed", Kind::U64, "seed of its random values"),
        column("simulator", Kind::Text, "what drew the pictures"),
        column("dtd_version", Kind::Text, "version of dtd that recorded it"),
        column(
            "config_hash",
            Kind::Text,
            "BLAKE3 hash of all its parameters",
        ),
        column(
            "manifest_blake3",
            Kind::Text,
            "BLAKE3 hash of the manifest of its files in the corpus",
        ),
    ],
};

pub(crate) const VIEWS: TableText = TableText {
    name: "views",
    row: "scenario and view: a camera and its video",
    columns: &[
        SCENARIO,
        VIEW,
        column("video", Kind::Text, "file of the video in this export"),
        column("width_px", Kind::U32, "width of the pictures"),
        column("height_px", Kind::U32, "height of the pictures"),
        column("focal_px", Kind::F64, "focal length; pixels are square"),
        column("principal_x_px", Kind::F64, "principal point, right"),
        column("principal_y_px", Kind::F64, "principal point, down"),
        column(
            "k1",
            Kind::F64,
            "distortion, as in OpenCV; missing without distortion, like the next four",
        ),
        column("k2", Kind::F64, "distortion, as in OpenCV"),
        column("p1", Kind::F64, "distortion, as in OpenCV"),
        column("p2", Kind::F64, "distortion, as in OpenCV"),
        column("k3", Kind::F64, "distortion, as in OpenCV"),
        column(
            "refraction_coefficient",
            Kind::F64,
            "k: a point at the horizontal distance d appears lifted by k d^2 / (2 R), R = 6371008.8 m",
        ),
        column(
            "r00",
            Kind::F64,
            "rotation from camera axes (right, down, forward) to ECEF, first row, first column; likewise the next eight",
        ),
        column("r01", Kind::F64, "rotation"),
        column("r02", Kind::F64, "rotation"),
        column("r10", Kind::F64, "rotation"),
        column("r11", Kind::F64, "rotation"),
        column("r12", Kind::F64, "rotation"),
        column("r20", Kind::F64, "rotation"),
        column("r21", Kind::F64, "rotation"),
        column("r22", Kind::F64, "rotation"),
        column("ecef_x_m", Kind::F64, "place of the camera, ECEF on WGS-84"),
        column("ecef_y_m", Kind::F64, "place of the camera, ECEF on WGS-84"),
        column("ecef_z_m", Kind::F64, "place of the camera, ECEF on WGS-84"),
    ],
};

pub(crate) const TICKS: TableText = TableText {
    name: "ticks",
    row: "scenario and tick: where the aircraft is",
    columns: &[
        SCENARIO,
        TICK,
        column("time_ns", Kind::I64, "time since tick 0"),
        column(
            "latitude_deg",
            Kind::F64,
            "centre of gravity of the aircraft, WGS-84",
        ),
        column(
            "longitude_deg",
            Kind::F64,
            "centre of gravity of the aircraft, WGS-84",
        ),
        column(
            "altitude_msl_m",
            Kind::F64,
            "its height, taken as height above the ellipsoid",
        ),
        column(
            "heading_true_deg",
            Kind::F64,
            "heading, clockwise from true north",
        ),
        column("pitch_deg", Kind::F64, "pitch, nose up"),
        column("roll_deg", Kind::F64, "roll, right wing down"),
        column("velocity_north_mps", Kind::F64, "velocity over ground"),
        column("velocity_east_mps", Kind::F64, "velocity over ground"),
        column("velocity_down_mps", Kind::F64, "velocity over ground"),
        column("true_airspeed_mps", Kind::F64, "true airspeed"),
        column("flap_ratio", Kind::F64, "flaps, 0 up to 1 full"),
        column("gear_ratio", Kind::F64, "gear, 0 up to 1 down"),
        column(
            "on_ground",
            Kind::Bool,
            "whether a wheel touches the ground",
        ),
        column(
            "dtd_m",
            Kind::F64,
            "distance to touchdown: geodesic distance over ground to the touchdown target; missing without labels, like the next four",
        ),
        column(
            "along_track_m",
            Kind::F64,
            "remaining distance along the course; negative past the target",
        ),
        column(
            "cross_track_m",
            Kind::F64,
            "offset from the extended centreline, right of the course positive",
        ),
        column(
            "height_over_target_m",
            Kind::F64,
            "height over the touchdown target",
        ),
        column(
            "time_to_touchdown_s",
            Kind::F64,
            "time until the aircraft passes abeam the target; missing if the recording ends before",
        ),
    ],
};

pub(crate) const BOXES: TableText = TableText {
    name: "boxes",
    row: "true box: scenario, view and tick that show the aircraft",
    columns: &[
        SCENARIO,
        VIEW,
        TICK,
        CX,
        CY,
        WIDTH,
        HEIGHT,
        column(
            "visible_fraction",
            Kind::F64,
            "part of the silhouette inside the picture and above the ground",
        ),
        column(
            "truncated_fraction",
            Kind::F64,
            "part of the unclipped box outside the picture",
        ),
        column(
            "transmission_ratio",
            Kind::F64,
            "share of contrast that haze leaves",
        ),
        column(
            "sight",
            Kind::Text,
            "in_sight; haze: beyond the visibility; cloud: above the base of the lowest clouds, perhaps hidden",
        ),
        column(
            "is_expected",
            Kind::Bool,
            "whether most of the aircraft is in the picture",
        ),
    ],
};

pub(crate) const DETECTIONS: TableText = TableText {
    name: "detections",
    row: "detected box",
    columns: &[
        SCENARIO,
        VIEW,
        TICK,
        column("model", Kind::Text, "hash of the model and its settings"),
        CX,
        CY,
        WIDTH,
        HEIGHT,
        column("score", Kind::F64, "confidence, 0 to 1"),
        column(
            "track",
            Kind::U32,
            "number of the track in its view; missing if nothing was tracked",
        ),
        column(
            "mode",
            Kind::Text,
            "how the picture was searched: full, tracked or scaled",
        ),
        column(
            "confirmed",
            Kind::Bool,
            "whether the box counts: its track has enough boxes and does not stand still",
        ),
    ],
};

pub(crate) const PREDICTIONS: TableText = TableText {
    name: "predictions",
    row: "run, scenario, tick and estimator",
    columns: &[
        column("run", Kind::Text, "name of the folder of the run"),
        SCENARIO,
        TICK,
        column("estimator", Kind::Text, "name of the estimator"),
        column(
            "predicted_dtd_m",
            Kind::F64,
            "predicted distance to touchdown; missing if the estimator had no answer",
        ),
        column(
            "predicted_dtd_sd_m",
            Kind::F64,
            "stated standard deviation; missing if it states none",
        ),
        column(
            "predicted_dtd_from_m",
            Kind::F64,
            "lower end of the stated 90 % interval",
        ),
        column(
            "predicted_dtd_to_m",
            Kind::F64,
            "upper end of the stated 90 % interval",
        ),
    ],
};

pub(crate) const LEROBOT_FRAMES: TableText = TableText {
    name: "frames",
    row: "scenario and tick",
    columns: &[
        column(
            "observation.state",
            Kind::F64s(16),
            "pose, velocity and distances; meta/info.json names the numbers with their units",
        ),
        column(
            "timestamp",
            Kind::F64,
            "time of the picture in the scenario's videos, seconds",
        ),
        column(
            "frame_index",
            Kind::I64,
            "number within the scenario, from 0",
        ),
        column("episode_index", Kind::I64, "number of the scenario"),
        column("index", Kind::I64, "number within the dataset, from 0"),
        column("task_index", Kind::I64, "number of the task"),
        column("tick", Kind::I64, "number of the tick in the corpus"),
        column("time_ns", Kind::I64, "time since tick 0"),
    ],
};

pub(crate) const LEROBOT_EPISODES: TableText = TableText {
    name: "episodes",
    row: SCENARIOS.row,
    columns: &[
        column("episode_index", Kind::I64, "number of the scenario"),
        column("length", Kind::I64, "number of rows"),
        column("dataset_from_index", Kind::I64, "its first row"),
        column("dataset_to_index", Kind::I64, "the row after its last"),
        SCENARIO,
        TRAJECTORY,
        column("split", Kind::Text, "side of the split"),
        WEATHER,
        TIME_OF_DAY,
        column(
            "calibration",
            Kind::Text,
            "the cameras, as calibration.json of the corpus",
        ),
    ],
};

/// The long tables, in the order in which they are described.
pub(crate) const TABLES: [TableText; 6] = [SCENARIOS, VIEWS, TICKS, BOXES, DETECTIONS, PREDICTIONS];
