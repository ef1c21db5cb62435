//! Long work: its progress and cancellation, its threads and the memory that it may use.

pub mod memory;
pub mod watch;
pub mod workers;
