//! Images that come with the simulator's answer, ready to use.

use super::{ComingPicture, PixelKind, PixelSource};
use crate::link::MAX_OUTSTANDING_CAPTURES;

/// The source `link` or `gl`: the answer's payload is the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Payload(pub(crate) PixelKind);

impl PixelSource for Payload {
    fn kind(&self) -> PixelKind {
        self.0
    }

    fn most_outstanding(&self) -> usize {
        MAX_OUTSTANDING_CAPTURES
    }

    fn picture(&mut self, payload: Vec<u8>) -> ComingPicture<'_> {
        Box::pin(std::future::ready(Ok(payload)))
    }
}
