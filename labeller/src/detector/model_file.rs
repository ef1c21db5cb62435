//! A model and its profile, read once: every session is made from the bytes that were hashed for the record, even if the files
//! change in the meantime.

use std::path::{Path, PathBuf};

use dataset::outside_file::{self, FileKind};

use crate::error::{Error, Result};

/// The content of a model's files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModelFile {
    /// Its path.
    pub path: PathBuf,
    /// The ONNX file.
    pub onnx: Vec<u8>,
    /// `<model file name>.json`, if there is one.
    pub profile: Option<Vec<u8>>,
}

impl ModelFile {
    /// Reads a model and its profile.
    pub fn read(path: &Path) -> Result<Self> {
        if !path.is_file() {
            return Err(Error::model(path, "is not there; expected an ONNX file"));
        }
        let fault = |error: dataset::Error| Error::model(path, error);
        let onnx = outside_file::read(path, FileKind::MODEL).map_err(fault)?;
        let beside = Self::profile_path(path);
        let profile = match outside_file::read(&beside, FileKind::json("model profile")) {
            Ok(profile) => Some(profile),
            Err(error) if error.is_not_found() => None,
            Err(error) => return Err(fault(error)),
        };
        Ok(Self {
            path: path.to_owned(),
            onnx,
            profile,
        })
    }

    /// Path of a model's profile.
    pub(super) fn profile_path(model: &Path) -> PathBuf {
        let mut beside = model.as_os_str().to_owned();
        beside.push(".json");
        beside.into()
    }
}
