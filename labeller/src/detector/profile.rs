//! Settings of a model: the format of its input and the meaning of its output, where shapes and metadata do not tell.
//!
//! Taken from the first of: a file `<model file name>.toml` next to the model (`aircraft.onnx.toml`), the model's own metadata
//! property `dtd_profile` (the same as JSON text, for programs that export models), the defaults for its layout. For example:
//!
//! ```toml
//! layout = "yolox"
//! aircraft_class = 4
//!
//! [input]
//! order = "bgr"
//! scale = 1.0
//! size_px = 416
//! ```
//!
//! `docs/reference/model-settings.md` lists every key.

pub(crate) mod aircraft_class;
pub(crate) mod metadata;

use std::fmt;
use std::ops::RangeInclusive;
use std::path::Path;

use dataset::files::toml_file::TomlFile;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::metadata::METADATA_KEY;
use super::layout::Layout;
use crate::error::{Error, Result};

/// Factors by which an image may be shrunk.
const SHRINKS: RangeInclusive<u32> = 1..=8;

/// Order of the channels of a model's input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ChannelOrder {
    /// Red first.
    Rgb,
    /// Blue first, as in OpenCV.
    Bgr,
}

/// The point of the top-left pixel that has the coordinates (0, 0) in a model's output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum BoxOrigin {
    /// Its centre, as everywhere in this project.
    PixelCenter,
    /// Its top-left corner, as in all YOLO models: half a pixel is subtracted.
    PixelCorner,
}

/// Meaning of a box's four numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum BoxForm {
    /// Centre, width and height.
    CenterSize,
    /// Left, top, right and bottom edge.
    Corners,
}

/// Unit of the numbers of a box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum BoxUnit {
    /// Pixels of the window.
    Pixels,
    /// Parts of the window's width and height, from 0 to 1.
    Normalized,
}

/// Meaning of a score.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ScoreForm {
    /// A confidence from 0 to 1.
    Probability,
    /// A number of any size, which the logistic function turns into a confidence.
    Logit,
    /// A number of any size; the softmax over all classes, the last of which is "no object", turns it into a confidence. Only for
    /// `boxes-and-scores` and `class-rows`.
    Softmax,
}

/// Optional declarations about a model. Missing ones follow from its shapes, its metadata, its answer to a blank window and its layout.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ModelProfile {
    /// Layout of the output (docs/detectors.md); by default from its shape, unless the numbers show another one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layout: Option<Layout>,
    /// Name of the output with the boxes; by default the only one with a known layout.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub output: Option<String>,
    /// The four numbers of a box; by default from layout and numbers. Not for `yolox`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub box_form: Option<BoxForm>,
    /// Unit of the numbers of a box; by default from the numbers. Not for `yolox`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub box_unit: Option<BoxUnit>,
    /// Form of the scores; probabilities by default, for `boxes-and-scores` from the numbers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub score_form: Option<ScoreForm>,
    /// Number of the aircraft among the model's classes, from 0; by default from the names in the model's metadata, else 0 of 1 class or
    /// 4 of COCO's 80.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aircraft_class: Option<usize>,
    /// Point of the top-left pixel that is (0, 0) in the model's boxes; `pixel-corner` by default, for `rows` `pixel-center`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub box_origin: Option<BoxOrigin>,
    /// Factor by which images are shrunk for the first pass over them; 1 by default. With 2 it takes a quarter of the time and misses the
    /// smallest aircraft.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_pass_shrink: Option<u32>,
    /// Smallest score of a box that the model reports in a window that is not shrunk, 0 to 1; 0 by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub least_score: Option<f64>,
    /// The input.
    #[serde(skip_serializing_if = "InputProfile::is_empty")]
    pub input: InputProfile,
}

/// The input of a model.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InputProfile {
    /// Order of the channels; `rgb` by default, for `yolox` and `yolox-decoded` `bgr`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub order: Option<ChannelOrder>,
    /// Factor on the 8-bit values; 1/255 by default, for `yolox` and `yolox-decoded` 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<f32>,
    /// Means of the channels, in their order, subtracted after scaling; 0 by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean: Option<[f32; 3]>,
    /// Standard deviations of the channels, by which they are divided last; 1 by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub std: Option<[f32; 3]>,
    /// Side of square windows, pixels, 32 to 4,096, for a model whose sides are open; by default any size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size_px: Option<u32>,
}

impl InputProfile {
    fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Subtracts the means and divides by the standard deviations.
    pub(super) fn standardize(&self, planes: &mut [f32]) {
        if self.mean.is_none() && self.std.is_none() {
            return;
        }
        let (mean, std) = (self.mean.unwrap_or_default(), self.std.unwrap_or([1.0; 3]));
        let each = planes.len() / mean.len();
        for (plane, (mean, std)) in planes.chunks_exact_mut(each).zip(mean.into_iter().zip(std)) {
            for value in plane {
                *value = (*value - mean) / std;
            }
        }
    }
}

/// A setting that no model can have.
struct BadSetting {
    key: &'static str,
    message: String,
}

impl ModelProfile {
    /// Reads the settings in a file next to a model.
    pub(super) fn parse(text: &str, path: &Path, model: &Path) -> Result<Self> {
        let file = TomlFile::new(path, text);
        let profile: Self = file.parse().map_err(|error| Error::model(model, error))?;
        match profile.check() {
            Ok(()) => Ok(profile),
            Err(BadSetting { key, message }) => {
                Err(Error::model(model, file.rejected(key, &message)))
            }
        }
    }

    /// Reads the settings in a model's metadata.
    pub(super) fn of_metadata(text: &str, model: &Path) -> Result<Self> {
        let fault = |message: String| {
            let message = format!("its metadata property {METADATA_KEY} {message}");
            Error::model(model, message)
        };
        let profile: Self = serde_json::from_str(text)
            .map_err(|error| fault(format!("has no settings: {error}")))?;
        match profile.check() {
            Ok(()) => Ok(profile),
            Err(BadSetting { message, .. }) => Err(fault(format!("says {message}"))),
        }
    }

    fn check(&self) -> std::result::Result<(), BadSetting> {
        let refused = |key, found: &dyn fmt::Display, expected: &str| {
            let message = format!("{key} = {found}, expected {expected}");
            Err(BadSetting { key, message })
        };
        let positive = |key, number: f32| {
            if number.is_finite() && number > 0.0 {
                return Ok(());
            }
            refused(key, &number, "a finite number above zero")
        };
        let is_bad_shrink = |shrink: &u32| !SHRINKS.contains(shrink);
        if let Some(shrink) = self.first_pass_shrink.filter(is_bad_shrink) {
            return refused("first_pass_shrink", &shrink, "1 to 8");
        }
        let is_bad_score = |score: &f64| !(0.0..=1.0).contains(score);
        if let Some(score) = self.least_score.filter(is_bad_score) {
            return refused("least_score", &score, "0 to 1");
        }
        self.input
            .scale
            .map_or(Ok(()), |scale| positive("input.scale", scale))?;
        for std in self.input.std.into_iter().flatten() {
            positive("input.std", std)?;
        }
        let mut means = self.input.mean.into_iter().flatten();
        match means.find(|mean| !mean.is_finite()) {
            None => Ok(()),
            Some(mean) => refused("input.mean", &mean, "finite numbers"),
        }
    }

    /// BLAKE3 hash of the settings; `None` if there are none. Comments and the order of keys do not change it.
    pub fn blake3(&self) -> Option<String> {
        (*self != Self::default()).then(|| {
            let text = serde_json::json!(self).to_string();
            blake3::hash(text.as_bytes()).to_string()
        })
    }

    /// Order of the channels for a layout.
    pub(super) fn order(&self, layout: Layout) -> ChannelOrder {
        self.input.order.unwrap_or(if layout.is_of_yolox() {
            ChannelOrder::Bgr
        } else {
            ChannelOrder::Rgb
        })
    }

    /// Factor on the 8-bit values for a layout.
    pub(super) fn scale(&self, layout: Layout) -> f32 {
        self.input.scale.unwrap_or(if layout.is_of_yolox() {
            1.0
        } else {
            1.0 / 255.0
        })
    }

    /// The smallest score to report, where a search asks for boxes from `floor` on.
    pub(super) fn score_floor(&self, floor: f64) -> f64 {
        self.least_score.unwrap_or(0.0).max(floor)
    }

    /// Origin of the boxes for a layout.
    pub(super) fn origin(&self, layout: Layout) -> BoxOrigin {
        self.box_origin.unwrap_or(layout.usual_origin())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detector::model_file::ModelFile;

    const BESIDE: &str = "net.onnx.toml";

    fn parse(text: &str) -> Result<ModelProfile> {
        ModelProfile::parse(text, Path::new(BESIDE), Path::new("net.onnx"))
    }

    fn model(profile: Option<&str>) -> ModelFile {
        ModelFile {
            path: "net.onnx".into(),
            onnx: Vec::new(),
            profile: profile.map(|text| parse(text).unwrap()),
        }
    }

    #[test]
    fn a_file_beside_the_model_goes_before_its_metadata() {
        let metadata = Some(r#"{"input": {"scale": 1.0}}"#);
        let found = |beside| model(beside).settings(metadata).unwrap();
        assert_eq!(found(None).scale(Layout::Rows), 1.0);
        let profile = found(Some("input = {scale = 0.5, order = 'bgr'}"));
        assert_eq!(
            (profile.scale(Layout::Rows), profile.order(Layout::Rows)),
            (0.5, ChannelOrder::Bgr)
        );
        let none = model(None).settings(None).unwrap();
        assert_eq!(none, ModelProfile::default());
    }

    #[test]
    fn a_mistake_in_the_file_is_shown_in_its_line_with_what_is_known() {
        for (text, place, words) in [
            (
                "layout = 'yolox'\ncolour = 'bgr'\n",
                ":2:1",
                ["colour", "aircraft_class"],
            ),
            ("[input]\nsize = 416\n", ":2:1", ["size", "size_px"]),
            ("layout = 'yolo99'\n", ":1:10", ["yolo99", "yolox"]),
            (
                "aircraft_class = -1\n",
                ":1:18",
                ["-1", "a whole number from 0"],
            ),
            ("[input]\nscale = 'one'\n", ":2:9", ["one", "a number"]),
            ("least_score = 1.5\n", ":1:15", ["1.5", "0 to 1"]),
            ("first_pass_shrink = 0\n", ":1:21", ["= 0", "1 to 8"]),
            (
                "[input]\nscale = 0\n",
                ":2:9",
                ["input.scale = 0", "above zero"],
            ),
            (
                "[input]\nscale = nan\n",
                ":2:9",
                ["input.scale = NaN", "above zero"],
            ),
        ] {
            let said = parse(text).unwrap_err().to_string();
            for word in ["net.onnx", &format!("{BESIDE}{place}"), "^"]
                .iter()
                .chain(&words)
            {
                assert!(said.contains(word), "{word} in {said}");
            }
        }
    }

    #[test]
    fn metadata_that_has_no_settings_is_named() {
        for (text, word) in [
            (r#"{"colour": "bgr"}"#, "colour"),
            (r#"{"input": {"scale": -1.0}}"#, "input.scale = -1"),
            ("layout = 'yolox'", "has no settings"),
        ] {
            let said = model(None).settings(Some(text));
            let said = said.unwrap_err().to_string();
            assert!(
                said.contains(word) && said.contains("net.onnx") && said.contains(METADATA_KEY),
                "{said}"
            );
        }
    }

    #[test]
    fn the_hash_is_of_the_settings_and_not_of_their_text() {
        let hash = |text: &str| parse(text).unwrap().blake3();
        assert_eq!([hash(""), hash("# none yet\n[input]\n")], [None, None]);
        let one = hash("aircraft_class = 4\n[input]\nscale = 1\n");
        let same = hash("# of COCO\ninput.scale = 1.0\naircraft_class = 4\n");
        assert!(one.is_some() && one == same, "{one:?} {same:?}");
        let others = [
            "aircraft_class = 5\n[input]\nscale = 1\n",
            "aircraft_class = 4\n",
            "[input]\nscale = 1\n",
            "layout = 'rows'\naircraft_class = 4\n[input]\nscale = 1\n",
        ];
        for other in others {
            assert_ne!(hash(other), one, "{other}");
        }
    }
}
