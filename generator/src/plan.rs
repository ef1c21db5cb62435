//! From a sweep to a plan: the scenarios, their cost and their split.
//!
//! Expansion is a pure function. A scenario is determined by its parameters (time, weather, profile and repeat) and the master seed, never
//! by its position among the others: a sweep that grows adds scenarios and leaves the others as they are. The format on disk is in
//! [`dataset::plan`].

mod duration;
mod estimate;
mod expand;
mod fly_request;
mod outlook;
pub mod shard;
mod split;
#[cfg(test)]
pub(crate) mod tests;

pub(crate) use duration::counted;
pub use duration::{Durations, Pacing};
pub use estimate::{Estimate, MeasuredSize, room_bytes};
pub use expand::{expand, is_seeded_by};
pub(crate) use fly_request::fly_request;
pub use outlook::{Outlook, Sight};
pub(crate) use split::assign_sides;
