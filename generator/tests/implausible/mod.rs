//! Recordings that are changed from good ones.

pub(super) mod mistakes;
pub(super) mod odd;
pub(super) mod table;
