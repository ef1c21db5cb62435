//! Settings of a live estimation in a file, for what runs as a service: `ESTIMATE.toml`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde::{Deserialize, Serialize};

use crate::source::Decoder;

/// Settings of `dtd estimate`. Unknown keys are rejected. Paths are relative to the folder in which the command runs.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// The views of the run, by name. Of one whose source `--view` gives, and of one that `--without` names, nothing here is used.
    pub views: BTreeMap<String, ViewSettings>,
    /// Views of the run to estimate without. `--without` names further ones, and `--view` overrides it.
    pub without: Vec<String>,
    /// Estimator that answers; by default the training's choice, `inverse_range` with its filter. `--estimator` overrides it.
    pub estimator: Option<String>,
    /// The detector, an ONNX file; the bundled one by default. `--model` overrides it.
    pub model: Option<PathBuf>,
    /// Rows of the images to search, `TOP:BOTTOM`; all by default. `--rows` overrides it.
    pub rows: Option<String>,
    /// Device of the detector; cpu by default. `--device` overrides it.
    pub device: Option<String>,
    /// Decoder of the images; cpu by default. `--decoder` overrides it.
    pub decoder: Option<Decoder>,
    /// Address of the metrics, `ADDRESS:PORT`; none by default. `--metrics` overrides it.
    pub metrics: Option<String>,
    /// File in which measured offsets are kept for the next start. `--keep-offsets` overrides it.
    pub keep_offsets: Option<PathBuf>,
}

/// Settings of a view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ViewSettings {
    /// Source of its images, as for `--view`. Without a password.
    pub source: String,
    /// Seconds to add to the times of its images. `--offset` overrides it.
    pub offset_s: Option<f64>,
    /// True if its video file has a separate clock, to be compared with the first view's: `--offset VIEW=auto`.
    #[serde(default)]
    pub measures_offset: bool,
    /// File with the password of its server, on the first line. `--password-file` overrides it.
    pub password_file: Option<PathBuf>,
    /// True if its rtsps:// server may have any certificate: `--insecure-tls VIEW`.
    #[serde(default)]
    pub insecure_tls: bool,
}

/// The JSON Schema of a file with these settings, with a final newline. Draft 7: the newest that editors and `taplo` read.
pub fn schema() -> String {
    let mut schema = SchemaSettings::draft07()
        .into_generator()
        .into_root_schema_for::<Settings>();
    schema.insert("title".into(), "Settings of dtd estimate".into());
    format!("{:#}\n", schema.to_value())
}
