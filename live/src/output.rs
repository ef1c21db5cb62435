//! Answers, events and counts, as they are written.

pub(crate) mod line;
pub(crate) mod lines;
pub(crate) mod metrics;
pub(crate) mod metrics_server;
