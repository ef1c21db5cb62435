//! The tape: a whole X-Plane session as one MCAP file, for replay, for tests without a simulator and for inspection.
//!
//! [`record`] is a proxy between any clients and one simulator: UDP in both directions, and the capture link. All traffic is
//! written with its time, byte for byte, before it is forwarded. [`TapeReader`] returns it in that order, also from a tape whose
//! recorder was killed. `dtd mock-xplane --tape` answers clients from it.
//!
//! The content ([`format`](self::format) defines it in code, `docs/tape.md` for other readers): a channel per client and direction,
//! one datagram or one message of the link per MCAP message.

#![forbid(unsafe_code)]

mod chunk;
mod error;
mod format;
mod link_message;
mod reader;
mod recorder;
mod writer;

pub use error::TapeError;
pub use format::{Channel, Direction, PROFILE, Traffic};
pub use link_message::{BadLinkMessage, LinkMessage};
pub use reader::{Entry, MessagePosition, TapeReader};
pub use recorder::{RecordOptions, RecorderAddresses, record};
pub use writer::{TapeSummary, TapeWriter};
