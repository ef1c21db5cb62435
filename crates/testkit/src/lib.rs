//! Test support that needs no simulator: one runway, one rig, approaches, small sweeps and corpora of them, and the
//! `dtd` command.
//!
//! Only a dev-dependency. It knows nothing but `dataset`, so that the unit tests of every other crate can use it; those of `dataset`
//! itself cannot (they would see a second `dataset`) and share only the file `changi_02l.json`. What runs a stand-in is in
//! `testkit-simulator`.

#![forbid(unsafe_code)]

pub mod approach;
mod chromium;
pub mod command;
pub mod files;
mod free_port;
mod judge;
mod made_once;
pub mod miscalibrated;
pub mod peak;
pub mod pictures;
pub mod processor_time;
mod repository;
pub mod rig;
mod runway;
pub mod scenario;
pub mod short_corpus;
pub mod short_flight;
mod skip;
pub mod sweep;
pub mod synthetic;
mod tiny_training;
pub mod watch;

pub use chromium::judge_in_chromium;
pub use free_port::free_udp_port;
pub use judge::judged;
pub use made_once::MadeOnce;
pub use repository::{
    onnx_runtime, onnx_runtime_with_openvino, program_of_venv, python_with_torch, repository,
};
pub use runway::changi_02l;
pub use skip::skipped;
pub use tiny_training::TINY_TRAINING;
