//! `ALRT`: a message box in the simulator.

use serde::{Deserialize, Serialize};

use super::PacketError;
use super::body::{Fields, push_text, start, text};

const TAG: &str = "ALRT";
const LINES: usize = 4;
const LINE_BYTES: usize = 240;

/// `ALRT` to the simulator.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Alert {
    /// The lines of the message, at most 239 bytes each; the unused ones are empty.
    pub lines: [String; LINES],
}

impl Alert {
    pub(super) fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let mut fields = Fields::new(TAG, datagram);
        let mut lines = <[String; LINES]>::default();
        for line in &mut lines {
            *line = text(TAG, "line", &fields.array::<LINE_BYTES>("line")?)?;
        }
        Ok(Self { lines })
    }

    pub(super) fn encode(&self) -> Result<Vec<u8>, PacketError> {
        let mut datagram = start(b"ALRT", LINES * LINE_BYTES);
        for line in &self.lines {
            push_text(&mut datagram, TAG, "line", line, LINE_BYTES)?;
        }
        Ok(datagram)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_alert_takes_965_bytes_whatever_it_says() {
        assert_eq!(Alert::default().encode().unwrap().len(), 965);
    }
}
