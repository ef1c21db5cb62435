//! Memory for images that client and simulator share: offered with the first capture, if the simulator is on this computer.
//!
//! If it is unavailable, or all in use, images are sent over the link.

use std::net::SocketAddr;

use crate::error::BridgeError;
use crate::link::{Answer, CaptureRequest, Deliver, Request, SharedPicture, SharedPictures};
use crate::simulator::{SWITCH_TIMEOUT, Simulator, wrong};

/// Maximum shared images in flight: a few being drawn, and those that wait for two encoders.
const SLOTS: u32 = 16;

/// State of the shared memory.
#[derive(Debug)]
pub(crate) enum Sharing {
    /// There is none.
    Impossible,
    /// The simulator supports it; the size is not known yet.
    Possible,
    /// The simulator draws into it.
    Shared(SharedPictures),
}

impl Sharing {
    /// Initial state for the client at `local`, with a simulator that shares memory with the client at `with`.
    pub(crate) fn with(with: Option<SocketAddr>, local: SocketAddr) -> Self {
        match with {
            Some(with) if with == local => Self::Possible,
            Some(with) => {
                tracing::debug!(%with, %local, "somebody stands between: images travel");
                Self::Impossible
            }
            None => Self::Impossible,
        }
    }
}

impl Simulator {
    /// Memory to lend for the requested image, unless it must be sent.
    pub(crate) async fn lend_memory(
        &mut self,
        request: &CaptureRequest,
    ) -> Result<Option<SharedPicture>, BridgeError> {
        if request.deliver != Deliver::Picture {
            return Ok(None);
        }
        let bytes = request.rgb_bytes();
        let has_room = match &self.sharing {
            Sharing::Impossible => return Ok(None),
            Sharing::Possible => false,
            Sharing::Shared(pictures) => pictures.largest_picture_bytes() >= bytes,
        };
        // The answer to an offer must not come after those to captures.
        if !has_room && self.outstanding.is_empty() {
            self.sharing = self.share_memory(bytes).await?;
        }
        Ok(match &self.sharing {
            Sharing::Shared(pictures) if pictures.largest_picture_bytes() >= bytes => {
                pictures.lend(bytes)
            }
            _ => None,
        })
    }

    async fn share_memory(&mut self, picture_bytes: usize) -> Result<Sharing, BridgeError> {
        let pictures = match SharedPictures::new(SLOTS, picture_bytes) {
            Ok(pictures) => pictures,
            Err(error) => {
                tracing::info!(%error, "no memory to share: images travel");
                return Ok(Sharing::Impossible);
            }
        };
        let offer = Request::ShareMemory(pictures.offer().clone());
        match self
            .link
            .ask("sharing memory", &offer, SWITCH_TIMEOUT)
            .await
        {
            Ok(Answer::MemoryShared) => Ok(Sharing::Shared(pictures)),
            Ok(other) => Err(wrong("memory_shared", &other)),
            Err(BridgeError::Refused { text, .. }) => {
                tracing::info!(text, "the simulator shares no memory: images travel");
                Ok(Sharing::Impossible)
            }
            Err(error) => Err(error),
        }
    }
}
