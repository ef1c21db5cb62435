//! The detector interface: finds aircraft in windows of an image.
//!
//! The real one runs an ONNX model ([`OrtDetector`]); tests use a finder of bright blobs behind the same trait. A window has the model's
//! input size, fixed or any; `crate::tiling` chooses the windows.

mod answer;
mod device;
mod input;
mod layout;
mod model_file;
mod number_model;
mod onnx_runtime;
mod ort_detector;
mod outputs;
mod plausibility;
mod profile;
mod window;

use dataset::tables::pixel_box::PixelBox;

pub use device::Device;
pub use input::WindowSize;
pub use layout::Layout;
pub use layout::suppression::keep_best;
pub use model_file::ModelFile;
pub use number_model::{NumberInput, run_numbers};
pub use onnx_runtime::NO_TELEMETRY_VARIABLE;
pub use ort_detector::{OrtDetector, OrtOptions};
pub use profile::{BoxForm, BoxOrigin, BoxUnit, ChannelOrder, ModelProfile, ScoreForm};
pub use window::{PictureView, Window};

use crate::error::Result;

/// A box with the detector's confidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoredBox {
    /// The box.
    pub pixel_box: PixelBox,
    /// Confidence, 0 to 1.
    pub score: f64,
}

/// Finds aircraft in image windows.
pub trait Detector {
    /// Sizes that a window may have.
    fn window_size(&self) -> WindowSize;

    /// For every window, all boxes of aircraft with at least `score_floor`, in the coordinates of the image, unordered and with
    /// duplicates ([`keep_best`] drops them).
    fn detect(
        &mut self,
        picture: &PictureView<'_>,
        windows: &[Window],
        score_floor: f64,
    ) -> Result<Vec<Vec<ScoredBox>>>;

    /// Shrink factor of the first pass.
    fn first_pass_shrink(&self) -> u32;

    /// Description for the record next to the detections.
    fn description(&self) -> String;
}
