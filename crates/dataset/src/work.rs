//! Long work: its progress, its threads and the memory that it may use.

pub mod memory;
pub mod progress;
pub mod workers;
