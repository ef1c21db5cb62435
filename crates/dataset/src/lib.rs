//! The shared types of the project and their files.
//!
//! Generator, labeller, detector-training and trainer never call each other: they share a corpus's files, and this crate is the only place
//! that knows those files. It contains the geometry that all must agree on (WGS-84, poses, cameras, runways), the records and tables
//! (`scenario.json`, `calibration.json`, `frames.parquet`, ...), the videos, and the protocol that commits a scenario folder atomically
//! even if the process is killed. `docs/dataset.md` describes every file and column.

pub mod conditions;
pub mod corpus;
pub mod error;
pub mod files;
pub mod geometry;
pub mod numbers;
pub mod plain;
pub mod plan;
pub mod tables;
pub mod video;
pub mod work;

pub use error::{Error, Result};
