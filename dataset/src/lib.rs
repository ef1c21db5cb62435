//! The shared types of the project and their files.
//!
//! Generator, labeller, detector-training and trainer never call each other: they share the files of a corpus, and this crate is the
//! only place that knows those files. It contains the geometry that all of them must agree on (WGS-84, poses, cameras, runways), the
//! records and tables (`scenario.json`, `calibration.json`, `frames.parquet`, ...), the videos, and the protocol that commits a
//! scenario folder atomically even if the process is killed. `docs/dataset.md` describes every file and column.

pub mod approach_profile;
pub mod calibration;
pub mod camera;
pub mod claim;
pub mod columns;
pub mod conditions;
pub mod corpus;
pub mod detections;
pub mod distortion;
pub mod echo;
pub mod effective_weather;
pub mod error;
pub mod file_name;
pub mod flight;
pub mod frame_rate;
pub mod frames;
pub mod geodesy;
pub mod imaging;
pub mod json_file;
pub mod least_squares;
pub mod limits;
pub mod memory;
pub mod model_identity;
pub mod new_file;
pub mod new_folder;
pub mod open_scenario;
pub mod other_flight;
mod others_decoder;
pub mod outside_file;
pub mod own_path;
pub mod pixel_box;
pub mod plan;
pub mod pose;
pub mod progress;
pub mod rays;
pub mod refraction;
pub mod registrations;
pub mod runway;
pub mod scenario;
pub mod seal;
pub mod sealed;
pub mod set_aside;
pub mod sight;
pub mod splits;
pub mod spread;
pub mod toml_file;
pub mod units;
pub mod verify;
pub mod video;
pub mod workers;

pub use error::{Error, Result};
