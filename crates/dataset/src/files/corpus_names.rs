//! Names of the files and folders of a corpus.

/// Folder of the scenarios.
pub(crate) const SCENARIOS: &str = "scenarios";
/// Suffix of a folder that is still being filled.
pub const PARTIAL_SUFFIX: &str = ".partial";
/// Name of the claim on the files that belong to the whole corpus.
pub const WHOLE_CORPUS: &str = "corpus";

/// All parameters of a scenario.
pub const RECORD: &str = "scenario.json";
/// The cameras of a scenario.
pub const CALIBRATION: &str = "calibration.json";
/// The ticks of a scenario.
pub const FRAMES: &str = "frames.parquet";
/// The ground-truth boxes of a scenario.
pub const TRUTH_BOXES: &str = "boxes_truth.parquet";
/// All aircraft of a scenario with traffic.
pub const AIRCRAFT: &str = "aircraft.parquet";
/// The files of a scenario except videos, detections with their tables, and seal.
pub const FILES: [&str; 5] = [RECORD, CALIBRATION, FRAMES, TRUTH_BOXES, AIRCRAFT];

/// Folder of the detections within a scenario.
pub const DETECTIONS: &str = "detections";
/// Folder of the registrations that belong to them.
pub const REGISTRATIONS: &str = "registrations";
/// Folder of the tables of the cameras' health that belong to them.
pub const HEALTH: &str = "health";
/// Folder of the backgrounds that these cameras saw.
pub const BACKGROUNDS: &str = "backgrounds";
/// All folders with tables of a model.
pub const MODEL_FOLDERS: [&str; 4] = [DETECTIONS, REGISTRATIONS, HEALTH, BACKGROUNDS];
