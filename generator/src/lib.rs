//! From a sweep to recorded scenario folders.
//!
//! ```text
//! sweep.toml --[sweep]--> Sweep --[plan]--> Plan --[generate]--> corpus/scenarios/<id>/
//! ```
//!
//! [`sweep`] reads and checks the author's file; [`plan`] expands it to fully specified scenarios, the same on every machine;
//! [`generate`] flies and records them, atomically, and resumes interrupted runs; [`plan::shard`] selects one machine's part.

#![forbid(unsafe_code)]

pub mod airports;
pub mod generate;
pub mod plan;
pub mod progress;
pub mod recording;
pub mod seed;
pub mod spread;
pub mod sweep;
pub mod sweep_language;
pub mod time_of_day;
pub mod tracks;
pub mod trajectory;
