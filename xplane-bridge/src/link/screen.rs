//! Messages of a connection for the screen: a client on another computer grabs the simulator's screen through its plugin.
//!
//! It is a separate conversation from the one of the seat, so that images never wait for the simulator's frames. A server that does not
//! support it rejects its first message.

use serde::{Deserialize, Serialize};

/// From client to plugin. None has a payload.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "snake_case")]
pub enum ScreenRequest {
    /// The first message, instead of a hello.
    OpenScreen {
        /// Name and version of the client.
        client: String,
        /// The secret of the link.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        token: Option<String>,
    },
    /// Take an image of the screen now.
    Grab {
        /// The region; everything if missing.
        #[serde(flatten)]
        part: Option<ScreenPart>,
    },
}

/// A region of the screen: all monitors together, physical pixels from the top left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ScreenPart {
    /// Its leftmost column.
    pub x_px: u32,
    /// Its topmost row.
    pub y_px: u32,
    /// Number of columns.
    pub width_px: u32,
    /// Number of rows.
    pub height_px: u32,
}

/// From plugin to client: one for every request, in the same order.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "snake_case")]
pub enum ScreenAnswer {
    /// To [`ScreenRequest::OpenScreen`]: the size of the screen.
    ScreenOpened {
        /// Width of the whole screen, pixels.
        width_px: u32,
        /// Its height.
        height_px: u32,
    },
    /// To [`ScreenRequest::Grab`]; the payload is the image.
    Grabbed {
        /// Width of the image, pixels.
        width_px: u32,
        /// Its height.
        height_px: u32,
    },
    /// Instead of either.
    Error {
        /// Description of the failure.
        text: String,
    },
}

/// A plugin's report about its screen in its hello, sent only to a client on another computer.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ScreenOffer {
    /// The reason why the plugin does not grab it; missing if it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
}
