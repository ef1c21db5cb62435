//! The headers of the capture link's messages: what a client asks, what a simulator answers.

use dataset::runway::Runway;
use serde::{Deserialize, Serialize};

use super::{CaptureRequest, FrameHeader};
use crate::fly::FlyRequest;

/// From client to simulator. None has a payload.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "snake_case")]
pub enum Request {
    /// First of all: who is there.
    Hello {
        /// Name and version of the client, for the simulator's log.
        client: String,
    },
    /// Stop the flight model, the clock and the clouds: poses come from captures now.
    Freeze {
        /// The runway of the scenario, whose surroundings the pictures show.
        runway: Runway,
    },
    /// Let everything run again.
    Release,
    /// Fly an approach, as fast as the simulator can.
    Fly(FlyRequest),
    /// Draw one view of one tick. Only while frozen.
    Capture(CaptureRequest),
}

/// From simulator to client: one for every request, in the same order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "snake_case")]
pub enum Answer {
    /// To [`Request::Hello`].
    Hello {
        /// Name of the simulator.
        name: String,
        /// Its version.
        version: String,
    },
    /// To [`Request::Freeze`].
    Frozen,
    /// To [`Request::Release`].
    Released,
    /// To [`Request::Fly`]; the payload is `rows` x `columns` 64-bit floats.
    Flown {
        /// Names of the columns.
        columns: Vec<String>,
        /// How many states.
        rows: usize,
    },
    /// To [`Request::Capture`]; the payload is the picture.
    Frame(FrameHeader),
    /// In place of any of them.
    Error {
        /// What went wrong.
        text: String,
    },
}

impl Answer {
    /// The answer's name, for messages.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Hello { .. } => "hello",
            Self::Frozen => "frozen",
            Self::Released => "released",
            Self::Flown { .. } => "flown",
            Self::Frame(_) => "frame",
            Self::Error { .. } => "error",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_flat_objects_that_name_their_message() {
        let text = serde_json::to_string(&Request::Release).unwrap();
        assert_eq!(text, r#"{"message":"release"}"#);
        let text = serde_json::to_string(&Answer::Error { text: "no".into() }).unwrap();
        assert_eq!(text, r#"{"message":"error","text":"no"}"#);
    }
}
