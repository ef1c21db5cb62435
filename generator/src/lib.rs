//! From a sweep to recorded scenario folders.
//!
//! ```text
//! sweep.toml --[sweep]--> Sweep --[plan]--> Plan --[generate]--> corpus/scenarios/<id>/
//! ```
//!
//! [`sweep`] reads and checks what a researcher wrote; [`plan`] expands it to scenarios in which everything is decided, the same on
//! every machine; [`generate`] flies and records them, each whole or not at all, and goes on where an earlier run stopped; [`shard`] is one
//! machine's part.

#![forbid(unsafe_code)]

pub mod airports;
pub mod generate;
pub mod plan;
pub mod recording;
pub mod rig;
pub mod seed;
pub mod shard;
pub mod spread;
pub mod stand_in;
pub mod sweep;
pub mod time_of_day;
pub mod trajectory;
