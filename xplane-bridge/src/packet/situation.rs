//! `SIMO`: saving and loading a situation, which is a whole flight in a file.

use serde::{Deserialize, Serialize};

use super::PacketError;
use super::body::{Fields, push_text, start, text};

const TAG: &str = "SIMO";
const PATH_BYTES: usize = 150;
/// As in `ACFN`.
const PADDING: [u8; 2] = [0; 2];

/// What to do with the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SituationAction {
    /// Write the flight into it.
    Save,
    /// Take the flight from it.
    Load,
}

/// `SIMO` to the simulator.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Situation {
    /// What to do.
    pub action: SituationAction,
    /// Path of the `.sit` file below X-Plane's folder.
    pub path: String,
}

impl Situation {
    pub(super) fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let mut fields = Fields::new(TAG, datagram);
        let action = match fields.i32("action")? {
            0 => SituationAction::Save,
            1 => SituationAction::Load,
            other => {
                return Err(PacketError::BadField {
                    tag: TAG,
                    field: "action",
                    expected: "0 (save) or 1 (load)",
                    found: other.to_string(),
                });
            }
        };
        let path = text(TAG, "path", &fields.array::<PATH_BYTES>("path")?)?;
        fields.array::<{ PADDING.len() }>("padding")?;
        Ok(Self { action, path })
    }

    pub(super) fn encode(&self) -> Result<Vec<u8>, PacketError> {
        let action: i32 = match self.action {
            SituationAction::Save => 0,
            SituationAction::Load => 1,
        };
        let mut datagram = start(b"SIMO", 156);
        datagram.extend(action.to_le_bytes());
        push_text(&mut datagram, TAG, "path", &self.path, PATH_BYTES)?;
        datagram.extend(PADDING);
        Ok(datagram)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_situation_takes_161_bytes_and_a_third_action_is_refused() {
        let save = Situation {
            action: SituationAction::Save,
            path: "Output/situations/final.sit".into(),
        };
        let mut bytes = save.encode().unwrap();
        assert_eq!(bytes.len(), 161);
        bytes[5] = 2;
        let error = Situation::decode(&bytes).unwrap_err();
        assert!(error.to_string().contains("action is 2"), "{error}");
    }
}
