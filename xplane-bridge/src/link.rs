//! The capture link: a TCP connection to our plugin inside the simulator (or to the stand-in), for what UDP cannot carry.
//!
//! UDP values have 32 bits, a metre of longitude; poses and images need 64 bits and megabytes. Protocol: after an 8-byte greeting
//! in both directions, messages of two lengths, a JSON header and bytes. Answers come in the order of the requests, which may be
//! pipelined. `docs/capture-link.md` specifies it for other implementations.

mod capture;
mod description;
mod flight;
mod message;
mod picture_bytes;
mod screen;
mod soundness;
mod token;
mod traffic;
mod wire;

pub use capture::{BadCapture, CaptureRequest, CapturedFrame, Deliver, FrameHeader};
pub(crate) use description::MARGIN_PX;
pub use description::{PictureSize, PixelKind, SimulatorWindow};
pub use flight::{BadFlightPayload, FLIGHT_COLUMNS, decode_flight, encode_flight};
pub use message::{Answer, Hello, Installation, Request};
pub use picture_bytes::{PictureBytes, PooledPicture};
pub use screen::{ScreenAnswer, ScreenOffer, ScreenRequest};
pub use soundness::UnsoundRequest;
pub use token::LinkToken;
pub(crate) use traffic::STATES_PER_REQUEST;
pub use traffic::{TrafficPart, TrafficState};
pub use wire::{
    LINK_VERSION, LinkError, MAGIC, MAX_HEADER_BYTES, MAX_PAYLOAD_BYTES, exchange_greetings,
    not_the_link, read_header, read_lengths, read_payload, read_request, read_request_length,
    write_message,
};

/// Maximum outstanding captures per client. Their requests (some 700 bytes each) then always fit the socket's buffers, so that sending
/// never waits for an answer that is itself waiting to be received.
pub(crate) const MAX_OUTSTANDING_CAPTURES: usize = 64;
