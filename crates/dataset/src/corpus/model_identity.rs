//! Identity of the detector that made a scenario's detections: an ONNX file and the settings beside it, identified by content.
//!
//! The same model with other settings finds other boxes, so both are hashed into the name of the detections. A model without settings
//! beside it keeps its own hash. The device it runs on (processor or accelerator) is not part of the identity, because it only affects
//! rounding.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Digits of the identity's hash that name the detections.
const NAME_DIGITS: usize = 16;

/// A model and the settings beside it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelIdentity {
    /// File name of the model; other programs may leave it out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// BLAKE3 hash of the model file.
    pub model_blake3: String,
    /// BLAKE3 hash of the settings beside the model; missing if there are none. Settings in the model's metadata are part of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile_blake3: Option<String>,
}

impl ModelIdentity {
    /// BLAKE3 hash of model and settings: the model's own without settings, else the hash of the lines `model_blake3` and `profile_blake3`.
    pub fn blake3(&self) -> String {
        match &self.profile_blake3 {
            None => self.model_blake3.clone(),
            Some(profile) => {
                let lines = format!("{}\n{profile}\n", self.model_blake3);
                blake3::hash(lines.as_bytes()).to_string()
            }
        }
    }

    /// Name of the detections: the first 16 digits of [`ModelIdentity::blake3`].
    pub fn name(&self) -> String {
        self.blake3().chars().take(NAME_DIGITS).collect()
    }

    /// True if detections with this name were made by it.
    pub(crate) fn has_name(&self, name: &str) -> bool {
        let hashes = [Some(&self.model_blake3), self.profile_blake3.as_ref()];
        let are_hashes = hashes.into_iter().flatten().all(|hash| is_hash(hash));
        are_hashes && !name.is_empty() && self.blake3().starts_with(name)
    }

    /// True if both have the same content, whatever the files are called.
    pub fn is_same_content(&self, other: &Self) -> bool {
        self.model_blake3 == other.model_blake3 && self.profile_blake3 == other.profile_blake3
    }
}

/// Detections as shown to users: the model's file name, if it is known, and the name of the detections.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct NamedDetections {
    /// File name of the model.
    pub model: Option<String>,
    /// Name of the detections, the start of the hash.
    pub hash: String,
}

impl NamedDetections {
    /// True if `asked`, as written by a user, names these detections.
    pub(crate) fn is_meant_by(&self, asked: &str) -> bool {
        self.hash == asked || self.model.as_deref() == Some(asked)
    }
}

impl fmt::Display for NamedDetections {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.model {
            Some(model) => write!(f, "{model} ({})", self.hash),
            None => write!(f, "{}", self.hash),
        }
    }
}

fn is_hash(text: &str) -> bool {
    text.len() == blake3::OUT_LEN * 2
        && text
            .bytes()
            .all(|digit| matches!(digit, b'0'..=b'9' | b'a'..=b'f'))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(model_blake3: &str, profile: Option<&str>) -> ModelIdentity {
        ModelIdentity {
            model: Some("net.onnx".into()),
            model_blake3: model_blake3.into(),
            profile_blake3: profile.map(|text| blake3::hash(text.as_bytes()).to_string()),
        }
    }

    #[test]
    fn a_model_without_settings_keeps_its_hash_and_each_settings_give_another() {
        let hash = "0123456789abcdef".repeat(4);
        let plain = of(&hash, None);
        assert_eq!(
            (plain.blake3(), plain.name()),
            (hash.clone(), hash[..16].to_owned())
        );
        let [one, other] = ["bgr", "rgb"].map(|text| of(&hash, Some(text)));
        let names = [plain.name(), one.name(), other.name()];
        assert!(names[0] != names[1] && names[0] != names[2] && names[1] != names[2]);
        assert!(one.has_name(&names[1]) && !one.has_name(&names[0]) && !one.has_name(""));
        let expected =
            blake3::hash(format!("{hash}\n{}\n", one.profile_blake3.as_ref().unwrap()).as_bytes());
        assert_eq!(one.blake3(), expected.to_string());
    }

    #[test]
    fn what_is_no_hash_names_nothing() {
        for hash in ["", "a model of mine", &"0123456789ABCDEF".repeat(4)] {
            let start: String = hash.chars().take(4).collect();
            assert!(!of(hash, None).has_name(&start), "{hash}");
        }
        let spoilt = ModelIdentity {
            profile_blake3: Some("mine".into()),
            ..of(&"a".repeat(64), None)
        };
        assert!(!spoilt.has_name(&spoilt.name()));
    }
}
