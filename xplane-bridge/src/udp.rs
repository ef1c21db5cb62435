//! UDP: finding simulators, their addresses, one socket for all readers, subscribed datarefs.

pub mod discovery;
pub mod simulator_address;
pub(crate) mod socket;
pub mod subscription;
