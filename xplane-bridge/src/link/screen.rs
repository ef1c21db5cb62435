//! Messages of the screen connection: a client on a different computer grabs the simulator's screen through its plugin.
//!
//! It is a separate conversation from the one of the seat, so that images never wait for the simulator's frames. A server that does not
//! support it rejects its first message.

use serde::{Deserialize, Serialize};

use crate::pixels::Rectangle;

/// A client's message to the plugin, without a payload.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "snake_case")]
pub enum ScreenRequest {
    /// First message, instead of a hello.
    OpenScreen {
        /// Name and version of the client.
        client: String,
        /// The secret of the link.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        token: Option<String>,
    },
    /// Take an image of the screen now.
    Grab {
        /// The region of all monitors together, physical pixels from the top left; everything if missing.
        #[serde(flatten)]
        part: Option<Rectangle>,
    },
}

/// The plugin's answer to a client: one per request, in the same order.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "snake_case")]
pub enum ScreenAnswer {
    /// Answer to [`ScreenRequest::OpenScreen`]: the size of the screen.
    ScreenOpened {
        /// Width of the whole screen, pixels.
        width_px: u32,
        /// Height, pixels.
        height_px: u32,
    },
    /// Answer to [`ScreenRequest::Grab`]; the payload is the image.
    Grabbed {
        /// Width of the image, pixels.
        width_px: u32,
        /// Height, pixels.
        height_px: u32,
    },
    /// Instead of either.
    Error {
        /// Description of the failure.
        text: String,
    },
}

/// A plugin's offer of its screen in its hello, sent only to clients on other computers.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ScreenOffer {
    /// The reason why the plugin does not grab it; missing if it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
}
