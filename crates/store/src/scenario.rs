//! One scenario in a store: upload, download, its seal, and the rule for two copies of it.

mod content_name;
mod detections;
mod fetch;
mod precedence;
mod send;
mod stored_fault;
mod stored_seal;
mod upload;

pub(crate) use content_name::file_name;
pub use detections::{LeftDetections, MovedDetections};
pub use fetch::Fetched;
pub use stored_fault::{StoredFault, StoredFaults};
pub use stored_seal::Committed;
#[cfg(test)]
pub(crate) use stored_seal::unix_ms;
pub use upload::{Before, Pushed};
