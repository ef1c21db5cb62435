//! Options and parsers that several verbs share.

pub(crate) mod choice;
pub(crate) mod local_udp;
pub(crate) mod output;
pub(crate) mod search;
pub(crate) mod shard;
