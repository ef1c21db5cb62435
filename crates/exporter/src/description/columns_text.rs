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
    "number of the tick, from 0; the image with this number in the video of each view",
);
const CX: Column = column(
    "cx_px",
    Kind::F64,
    "centre of the box, right; (0, 0) is the centre of the top-left pixel",
);
const CY: Column = column("cy_px", Kind::F64, "centre of the box, down");
const WIDTH: Column = column("width_px", Kind::F64, "width of the box");
const HEIGHT: Column = column("height_px", Kind::F64, "height of the box");

/// A list of columns: shared ones by their names, others as `(name kind meaning)`.
macro_rules! columns {
    ($($column:tt),* $(,)?) => {
        &[$(column!($column)),*]
    };
}

/// A column of a list.
macro_rules! column {
    (($name:literal $kind:ident $(($length:literal))? $meaning:literal)) => {
        column($name, Kind::$kind$(($length))?, $meaning)
    };
    ($shared:ident) => {
        $shared
    };
}

pub(crate) const SCENARIOS: TableText = TableText {
    name: "scenarios",
    row: "scenario: a recorded approach",
    columns: columns![
        SCENARIO,
        TRAJECTORY,
        WEATHER,
        TIME_OF_DAY,
        ("visibility_m" F64 "meteorological visibility"),
        ("rain_ratio" F64 "rain, 0 to 1"),
        ("turbulence_ratio" F64 "turbulence, 0 to 1"),
        ("wind_speed_mps" F64 "speed of the wind"),
        ("wind_from_true_deg" F64 "where the wind comes from, clockwise from true north"),
        ("aircraft" Text "type of the aircraft"),
        ("airport" Text "ICAO identifier of the airport"),
        ("runway" Text "name of the runway"),
        ("course_true_deg" F64 "course of the landing, clockwise from true north"),
        ("glide_path_deg" F64 "slope of the glide path"),
        ("touchdown_latitude_deg" F64 "touchdown target, WGS-84"),
        ("touchdown_longitude_deg" F64 "touchdown target, WGS-84"),
        ("touchdown_altitude_msl_m" F64 "height of the touchdown target, taken as height above the ellipsoid"),
        ("rig" Text "name of the camera rig"),
        ("ticks" U32 "number of ticks of the recording"),
        ("frame_rate_numerator" U32 "images in frame_rate_denominator seconds"),
        ("frame_rate_denominator" U32 "seconds in which frame_rate_numerator images pass"),
        ("seed" U64 "seed of its random values"),
        ("simulator" Text "what drew the images"),
        ("dtd_version" Text "version of dtd that recorded it"),
        ("config_hash" Text "BLAKE3 hash of all its parameters"),
        ("manifest_blake3" Text "BLAKE3 hash of the manifest of its files in the corpus"),
    ],
};

pub(crate) const VIEWS: TableText = TableText {
    name: "views",
    row: "scenario and view: a camera and its video",
    columns: columns![
        SCENARIO,
        VIEW,
        ("video" Text "file of the video in this export"),
        ("width_px" U32 "width of the images"),
        ("height_px" U32 "height of the images"),
        ("focal_px" F64 "focal length; pixels are square"),
        ("principal_x_px" F64 "principal point, right"),
        ("principal_y_px" F64 "principal point, down"),
        ("k1" F64 "distortion, as in OpenCV; missing without distortion, like the next four"),
        ("k2" F64 "distortion, as in OpenCV"),
        ("p1" F64 "distortion, as in OpenCV"),
        ("p2" F64 "distortion, as in OpenCV"),
        ("k3" F64 "distortion, as in OpenCV"),
        ("refraction_coefficient" F64 "k: a point at the horizontal distance d appears lifted by k d^2 / (2 R), R = 6371008.8 m"),
        ("r00" F64 "rotation from camera axes (right, down, forward) to ECEF, first row, first column; likewise the next eight"),
        ("r01" F64 "rotation"),
        ("r02" F64 "rotation"),
        ("r10" F64 "rotation"),
        ("r11" F64 "rotation"),
        ("r12" F64 "rotation"),
        ("r20" F64 "rotation"),
        ("r21" F64 "rotation"),
        ("r22" F64 "rotation"),
        ("ecef_x_m" F64 "place of the camera, ECEF on WGS-84"),
        ("ecef_y_m" F64 "place of the camera, ECEF on WGS-84"),
        ("ecef_z_m" F64 "place of the camera, ECEF on WGS-84"),
    ],
};

pub(crate) const TICKS: TableText = TableText {
    name: "ticks",
    row: "scenario and tick: where the aircraft is",
    columns: columns![
        SCENARIO,
        TICK,
        ("time_ns" I64 "time since tick 0"),
        ("latitude_deg" F64 "centre of gravity of the aircraft, WGS-84"),
        ("longitude_deg" F64 "centre of gravity of the aircraft, WGS-84"),
        ("altitude_msl_m" F64 "its height, taken as height above the ellipsoid"),
        ("heading_true_deg" F64 "heading, clockwise from true north"),
        ("pitch_deg" F64 "pitch, nose up"),
        ("roll_deg" F64 "roll, right wing down"),
        ("velocity_north_mps" F64 "velocity over ground"),
        ("velocity_east_mps" F64 "velocity over ground"),
        ("velocity_down_mps" F64 "velocity over ground"),
        ("true_airspeed_mps" F64 "true airspeed"),
        ("flap_ratio" F64 "flaps, 0 up to 1 full"),
        ("gear_ratio" F64 "gear, 0 up to 1 down"),
        ("on_ground" Bool "whether a wheel touches the ground"),
        ("dtd_m" F64 "distance to touchdown: geodesic distance over ground to the touchdown target; missing without labels, like the next four"),
        ("along_track_m" F64 "remaining distance along the course; negative past the target"),
        ("cross_track_m" F64 "offset from the extended centreline, right of the course positive"),
        ("height_over_target_m" F64 "height over the touchdown target"),
        ("time_to_touchdown_s" F64 "time until the aircraft passes abeam the target; missing if the recording ends before"),
    ],
};

pub(crate) const BOXES: TableText = TableText {
    name: "boxes",
    row: "ground-truth box: scenario, view and tick that show the aircraft",
    columns: columns![
        SCENARIO,
        VIEW,
        TICK,
        CX,
        CY,
        WIDTH,
        HEIGHT,
        ("visible_fraction" F64 "part of the silhouette inside the image and above the ground"),
        ("truncated_fraction" F64 "part of the unclipped box outside the image"),
        ("transmission_ratio" F64 "share of contrast that haze leaves"),
        ("sight" Text "in_sight; haze: beyond the visibility; cloud: above the base of the lowest clouds, perhaps hidden"),
        ("is_expected" Bool "whether most of the aircraft is in the image"),
    ],
};

pub(crate) const DETECTIONS: TableText = TableText {
    name: "detections",
    row: "detected box",
    columns: columns![
        SCENARIO,
        VIEW,
        TICK,
        ("model" Text "hash of the model and its settings"),
        CX,
        CY,
        WIDTH,
        HEIGHT,
        ("score" F64 "confidence, 0 to 1"),
        ("track" U32 "number of the track in its view; missing if nothing was tracked"),
        ("mode" Text "how the image was searched: full, tracked or scaled"),
        ("confirmed" Bool "whether the box counts: its track has enough boxes and does not stand still"),
    ],
};

pub(crate) const PREDICTIONS: TableText = TableText {
    name: "predictions",
    row: "run, scenario, tick and estimator",
    columns: columns![
        ("run" Text "name of the folder of the run"),
        SCENARIO,
        TICK,
        ("estimator" Text "name of the estimator"),
        ("predicted_dtd_m" F64 "predicted distance to touchdown; missing if the estimator had no answer"),
        ("predicted_dtd_sd_m" F64 "stated standard deviation; missing if it states none"),
        ("predicted_dtd_from_m" F64 "lower end of the stated 90 % interval"),
        ("predicted_dtd_to_m" F64 "upper end of the stated 90 % interval"),
    ],
};

pub(crate) const LEROBOT_FRAMES: TableText = TableText {
    name: "frames",
    row: "scenario and tick",
    columns: columns![
        ("observation.state" F64s(16) "pose, velocity and distances; meta/info.json names the numbers with their units"),
        ("timestamp" F64 "time of the image in the scenario's videos, seconds"),
        ("frame_index" I64 "number within the scenario, from 0"),
        ("episode_index" I64 "number of the scenario"),
        ("index" I64 "number within the dataset, from 0"),
        ("task_index" I64 "number of the task"),
        ("tick" I64 "number of the tick in the corpus"),
        ("time_ns" I64 "time since tick 0"),
    ],
};

pub(crate) const LEROBOT_EPISODES: TableText = TableText {
    name: "episodes",
    row: SCENARIOS.row,
    columns: columns![
        ("episode_index" I64 "number of the scenario"),
        ("length" I64 "number of rows"),
        ("dataset_from_index" I64 "its first row"),
        ("dataset_to_index" I64 "the row after its last"),
        SCENARIO,
        TRAJECTORY,
        ("split" Text "side of the split"),
        WEATHER,
        TIME_OF_DAY,
        ("calibration" Text "the cameras, as calibration.json of the corpus"),
    ],
};

/// The long tables, in the order in which they are described.
pub(crate) const TABLES: [TableText; 6] = [SCENARIOS, VIEWS, TICKS, BOXES, DETECTIONS, PREDICTIONS];
