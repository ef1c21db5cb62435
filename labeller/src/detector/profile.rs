//! The input format of a model and the meaning of its output, where the shapes do not tell.
//!
//! Taken from the first of: a file `<model file name>.json` next to the model (`aircraft.onnx.json`), the model's own metadata
//! property `dtd_profile` (the same JSON as text), the defaults for its layout. For example:
//!
//! ```json
//! {"input": {"order": "bgr", "scale": 1.0, "size_px": 416}, "layout": "yolox", "aircraft_class": 4}
//! ```

use dataset::json_file::parse_json;
use serde::{Deserialize, Serialize};

use super::layout::Layout;
use super::model_file::ModelFile;
use crate::error::{Error, Result};

/// Name of the metadata property of a model that contains its profile.
pub(super) const METADATA_KEY: &str = "dtd_profile";
/// Index of `airplane` among the 80 classes of COCO.
const COCO_AIRPLANE: usize = 4;

/// Order of the channels of a model's input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ChannelOrder {
    /// Red first.
    Rgb,
    /// Blue first, as in OpenCV.
    Bgr,
}

/// Which point of the top-left pixel has the coordinates (0, 0) in a model's output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BoxOrigin {
    /// Its centre, as everywhere in this project.
    PixelCenter,
    /// Its top-left corner, as in all YOLO models: half a pixel is subtracted.
    PixelCorner,
}

/// Optional declarations about a model. Missing ones follow from its shapes and its layout.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ModelProfile {
    /// The input.
    pub input: InputProfile,
    /// The output; default [`Layout::of_shape`].
    pub layout: Option<Layout>,
    /// Index of the aircraft among the model's classes; default 0 of 1 class or 4 of COCO's 80.
    pub aircraft_class: Option<usize>,
    /// Origin of the boxes; default [`Layout::usual_origin`].
    pub box_origin: Option<BoxOrigin>,
}

/// The input of a model.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct InputProfile {
    /// Order of the channels; default RGB, for YOLOX BGR.
    pub order: Option<ChannelOrder>,
    /// Factor on the 8-bit values; default 1/255, for YOLOX 1.
    pub scale: Option<f32>,
    /// Window size, pixels, if the model leaves it open; default 640.
    pub size_px: Option<u32>,
}

impl ModelProfile {
    /// The profile of a model: from the file next to it, else from its metadata, else empty.
    pub(super) fn find(file: &ModelFile, metadata: Option<String>) -> Result<Self> {
        let model = file.path.as_path();
        let (profile, from) = if let Some(text) = &file.profile {
            let beside = ModelFile::profile_path(model);
            let read = parse_json::<Self>(text, &beside, "model profile");
            let profile = read.map_err(|error| Error::model(model, error))?;
            (profile, beside.display().to_string())
        } else if let Some(text) = metadata {
            let from = format!("its metadata property {METADATA_KEY}");
            let profile = serde_json::from_str(&text)
                .map_err(|e| Error::model(model, format!("{from} is not a profile: {e}")))?;
            (profile, from)
        } else {
            return Ok(Self::default());
        };
        match profile.input.scale {
            // Not a number, too.
            Some(scale) if !(scale.is_finite() && scale > 0.0) => Err(Error::model(
                model,
                format!("{from} says input.scale = {scale}, expected a finite number above zero"),
            )),
            _ => Ok(profile),
        }
    }

    /// Order of the channels for a layout.
    pub(super) fn order(&self, layout: Layout) -> ChannelOrder {
        self.input.order.unwrap_or(if layout == Layout::Yolox {
            ChannelOrder::Bgr
        } else {
            ChannelOrder::Rgb
        })
    }

    /// Factor on the 8-bit values for a layout.
    pub(super) fn scale(&self, layout: Layout) -> f32 {
        self.input.scale.unwrap_or(if layout == Layout::Yolox {
            1.0
        } else {
            1.0 / 255.0
        })
    }

    /// Index of the aircraft among `classes`; `None` if it is ambiguous.
    pub(super) fn aircraft_class(&self, classes: usize) -> Option<usize> {
        let usual = match classes {
            1 => Some(0),
            80 => Some(COCO_AIRPLANE),
            _ => None,
        };
        self.aircraft_class
            .or(usual)
            .filter(|class| *class < classes)
    }

    /// Class number of the aircraft in an output that gives class numbers without the number of classes.
    pub(super) fn aircraft_class_or_coco(&self) -> usize {
        self.aircraft_class.unwrap_or(COCO_AIRPLANE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(profile: Option<&str>) -> ModelFile {
        ModelFile {
            path: "net.onnx".into(),
            onnx: Vec::new(),
            profile: profile.map(|text| text.as_bytes().to_vec()),
        }
    }

    #[test]
    fn a_file_beside_the_model_goes_before_its_metadata_and_unknown_keys_are_refused() {
        let metadata = Some(r#"{"input": {"scale": 1.0}}"#.to_owned());
        assert_eq!(
            ModelProfile::find(&model(None), metadata.clone())
                .unwrap()
                .scale(Layout::Rows),
            1.0
        );
        let beside = model(Some(r#"{"input": {"scale": 0.5, "order": "bgr"}}"#));
        let profile = ModelProfile::find(&beside, metadata).unwrap();
        assert_eq!(
            (profile.scale(Layout::Rows), profile.order(Layout::Rows)),
            (0.5, ChannelOrder::Bgr)
        );
        let unknown = model(Some(r#"{"colour": "bgr"}"#));
        let message = format!("{}", ModelProfile::find(&unknown, None).unwrap_err());
        assert!(
            message.contains("net.onnx.json") && message.contains("colour"),
            "{message}"
        );
    }

    #[test]
    fn a_scale_that_spoils_every_picture_is_refused() {
        for scale in ["0.0", "-1.0"] {
            let metadata = Some(format!(r#"{{"input": {{"scale": {scale}}}}}"#));
            let found = ModelProfile::find(&model(None), metadata);
            let said = found.unwrap_err().to_string();
            assert!(
                said.contains("net.onnx") && said.contains("input.scale"),
                "{said}"
            );
        }
    }

    #[test]
    fn the_aircraft_is_the_only_class_or_cocos_airplane_or_has_to_be_named() {
        let nothing_said = ModelProfile::default();
        assert_eq!(
            [1, 80, 7].map(|classes| nothing_said.aircraft_class(classes)),
            [Some(0), Some(4), None]
        );
        let said = ModelProfile {
            aircraft_class: Some(6),
            ..Default::default()
        };
        assert_eq!(
            [7, 3].map(|classes| said.aircraft_class(classes)),
            [Some(6), None]
        );
    }
}
