//! A model and its settings, read once: every session is made from the bytes that were hashed for the record, even if the files
//! change in the meantime.

use std::path::{Path, PathBuf};

use dataset::corpus::model_identity::ModelIdentity;
use dataset::files::outside_file::{self, FileKind};

use super::profile::ModelProfile;
use crate::error::{Error, Result};

/// Content of the model's files.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelFile {
    /// Model path.
    pub path: PathBuf,
    /// The ONNX file.
    pub onnx: Vec<u8>,
    /// The settings in `<model file name>.toml`, if there is one.
    pub profile: Option<ModelProfile>,
}

impl ModelFile {
    /// Reads a model and the settings next to it.
    pub fn read(path: &Path) -> Result<Self> {
        if !path.is_file() {
            return Err(Error::model(path, "is not there; expected an ONNX file"));
        }
        let fault = |error: dataset::Error| Error::model(path, error);
        let onnx = outside_file::read(path, FileKind::MODEL).map_err(fault)?;
        let beside = Self::profile_path(path);
        let profile = match outside_file::read_text(&beside, FileKind::SETTINGS) {
            Ok(text) => Some(ModelProfile::parse(&text, &beside, path)?),
            Err(error) if error.is_not_found() => None,
            Err(error) => return Err(fault(error)),
        };
        Ok(Self {
            path: path.to_owned(),
            onnx,
            profile,
        })
    }

    /// The model's settings: from the file next to it, else from its metadata, else none.
    pub(super) fn settings(&self, metadata: Option<&str>) -> Result<ModelProfile> {
        match (&self.profile, metadata) {
            (Some(profile), _) => Ok(profile.clone()),
            (None, Some(text)) => ModelProfile::of_metadata(text, &self.path),
            (None, None) => Ok(ModelProfile::default()),
        }
    }

    /// True if a tensor names a file in which its numbers are (`external_data` with the key `location`).
    pub(super) fn has_weights_elsewhere(&self) -> bool {
        const KEY: &[u8] = b"\x0a\x08location";
        self.onnx.windows(KEY.len()).any(|bytes| bytes == KEY)
    }

    /// Identifies its detections.
    pub fn identity(&self) -> ModelIdentity {
        let file_name = self.path.file_name().unwrap_or_default();
        ModelIdentity {
            model: Some(file_name.to_string_lossy().into_owned()),
            model_blake3: blake3::hash(&self.onnx).to_string(),
            profile_blake3: self.profile.as_ref().and_then(ModelProfile::blake3),
        }
    }

    /// Path of the model's settings.
    pub fn profile_path(model: &Path) -> PathBuf {
        let mut beside = model.as_os_str().to_owned();
        beside.push(".toml");
        beside.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_model_is_named() {
        let message = ModelFile::read(Path::new("gone.onnx"))
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("gone.onnx") && message.contains("ONNX file"),
            "{message}"
        );
    }
}
