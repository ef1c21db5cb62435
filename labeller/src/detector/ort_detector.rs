//! A detector from an ONNX file, run by ONNX Runtime.

use std::path::{Path, PathBuf};

use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::TensorRef;

use super::answer::{Answer, AnswerFault};
use super::input::{Batch, CHANNELS, Input, WindowSize, most_windows, numbers_in};
use super::layout::{Decoding, Layout};
use super::model_file::ModelFile;
use super::onnx_runtime;
use super::profile::{METADATA_KEY, ModelProfile};
use super::window::{PictureView, Window};
use super::{Detector, ScoredBox};
use crate::error::{Error, Result};

/// Where to look for weights outside the model's own file. Nowhere: the hash of the model would not cover them, and an untrusted
/// model could read files of its choice.
const EXTERNAL_WEIGHTS: &str = "session.model_external_initializers_file_folder_path";
const NOWHERE: &str = "/dev/null";

/// A window that tells whether a model takes any size: small, and not square.
const PROBE_PX: [u32; 2] = [160, 128];

/// Options for running a model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OrtOptions {
    /// ONNX Runtime's library; `None` means `ORT_DYLIB_PATH`, else the installation's own. Applies to the first model of a process.
    pub library: Option<PathBuf>,
    /// Threads within one run.
    pub threads: usize,
    /// Maximum number of windows per run; a model with a fixed batch uses its own number.
    pub batch: usize,
}

/// A detector from an ONNX file.
pub struct OrtDetector {
    path: PathBuf,
    session: Session,
    profile: ModelProfile,
    layout: Layout,
    input: Input,
    output: String,
    /// The windows of one run, reused.
    planes: Vec<f32>,
}

impl OrtDetector {
    /// Reads and loads a model.
    pub fn load(path: &Path, options: &OrtOptions) -> Result<Self> {
        Self::of(&ModelFile::read(path)?, options)
    }

    /// Loads a model, runs it once on an empty window and finds out how it answers.
    pub fn of(model: &ModelFile, options: &OrtOptions) -> Result<Self> {
        let path = model.path.as_path();
        let environment = onnx_runtime::environment(options.library.as_deref())?;
        let fault = |e: &dyn std::fmt::Display| {
            Error::model(path, format!("ONNX Runtime cannot load it: {e}"))
        };
        let mut builder = Session::builder(environment)
            .map_err(|e| fault(&e))?
            .with_optimization_level(GraphOptimizationLevel::All)
            .map_err(|e| fault(&e))?
            .with_intra_threads(options.threads)
            .map_err(|e| fault(&e))?
            // Threads that spin while waiting would take the cores that decode the next picture.
            .with_intra_op_spinning(false)
            .map_err(|e| fault(&e))?
            .with_config_entry(EXTERNAL_WEIGHTS, NOWHERE)
            .map_err(|e| fault(&e))?;
        let session = builder
            .commit_from_memory(&model.onnx)
            .map_err(|e| fault(&e))?;
        let metadata = session
            .metadata()
            .ok()
            .and_then(|metadata| metadata.custom(METADATA_KEY));
        let profile = ModelProfile::find(model, metadata)?;
        let input = Input::of(&session, &profile, options.batch)
            .map_err(|fault| Error::model(path, fault))?;
        let output = session.outputs()[0].name().to_owned();
        let mut detector = Self {
            path: path.to_owned(),
            session,
            profile,
            layout: Layout::Rows,
            input,
            output,
            planes: Vec::new(),
        };
        if let WindowSize::Any { .. } = input.size {
            // Lengths may be open although the grid inside is not.
            match detector.probe(PROBE_PX) {
                Ok(()) => return Ok(detector),
                Err(_) => detector.input = input.of_usual_size(),
            }
        }
        detector.probe(detector.input.size.usual_px())?;
        Ok(detector)
    }

    /// Runs the model on blank windows of a size, finds out its output layout (from the profile, else from the shape of the output),
    /// and reads the output, so that a mismatch shows before the first picture.
    fn probe(&mut self, size_px: [u32; 2]) -> Result<()> {
        let windows = match self.input.batch {
            Batch::Exactly(windows) => windows,
            Batch::UpTo(_) => 1,
        };
        self.planes.resize(windows * numbers_in(size_px), 0.0);
        let shape = self.run(windows, size_px, |answer| Ok(answer.shape().to_vec()))?;
        let said = self.profile.layout;
        self.layout = said.or_else(|| Layout::of_shape(&shape, size_px)).ok_or_else(|| {
            self.fault(format!(
                "output {:?} has the shape {shape:?}, which is none of the known layouts (see docs of `Layout`); \
                 name one in {}.json, or export the model with its grid",
                self.output,
                self.path.display()
            ))
        })?;
        let profile = self.profile;
        let decoding = Decoding {
            layout: self.layout,
            profile: &profile,
            window_px: size_px,
            score_floor: 1.0,
        };
        self.run(windows, size_px, |answer| decoding.decode(answer, windows))?;
        Ok(())
    }

    /// Runs the model on the first `windows` windows in `planes`, which all have this width and height.
    fn run<T>(
        &mut self,
        windows: usize,
        size_px: [u32; 2],
        read: impl FnOnce(Answer<'_>) -> std::result::Result<T, AnswerFault>,
    ) -> Result<T> {
        let path = &self.path;
        let fault = |e: ort::Error| Error::model(path, format!("ONNX Runtime cannot run it: {e}"));
        let [width, height] = size_px.map(|side_px| side_px as usize);
        let numbers = &self.planes[..windows * numbers_in(size_px)];
        let input = TensorRef::from_array_view(([windows, CHANNELS, height, width], numbers))
            .map_err(fault)?;
        let outputs = self.session.run(ort::inputs![input]).map_err(fault)?;
        let (shape, numbers) = outputs[0].try_extract_tensor::<f32>().map_err(fault)?;
        let shape: Vec<usize> = shape
            .iter()
            .map(|size| usize::try_from(*size).unwrap_or(0))
            .collect();
        Answer::new(&shape, numbers)
            .and_then(read)
            .map_err(|fault| Error::model(path, format!("output {:?} {fault}", self.output)))
    }

    fn fault(&self, message: impl ToString) -> Error {
        Error::model(&self.path, message)
    }
}

impl Detector for OrtDetector {
    fn window_size(&self) -> WindowSize {
        self.input.size
    }

    fn detect(
        &mut self,
        picture: &PictureView<'_>,
        windows: &[Window],
        score_floor: f64,
    ) -> Result<Vec<Vec<ScoredBox>>> {
        let (order, scale) = (
            self.profile.order(self.layout),
            self.profile.scale(self.layout),
        );
        let mut found = Vec::with_capacity(windows.len());
        let size_of = |window: &Window| [window.width_px, window.height_px];
        for same in windows.chunk_by(|a, b| size_of(a) == size_of(b)) {
            let size_px = size_of(&same[0]);
            let most = match self.input.batch {
                Batch::Exactly(most) => most,
                Batch::UpTo(most) => most.min(most_windows(size_px)).max(1),
            };
            for some in same.chunks(most) {
                let in_run = match self.input.batch {
                    Batch::Exactly(windows) => windows,
                    Batch::UpTo(_) => some.len(),
                };
                let numbers = numbers_in(size_px);
                if self.planes.len() < in_run * numbers {
                    self.planes.resize(in_run * numbers, 0.0);
                }
                for (window, planes) in some.iter().zip(self.planes.chunks_exact_mut(numbers)) {
                    window.write_planes(picture, order, scale, planes);
                }
                let profile = self.profile;
                let decoding = Decoding {
                    layout: self.layout,
                    profile: &profile,
                    window_px: size_px,
                    score_floor,
                };
                let boxes = self.run(in_run, size_px, |answer| {
                    decoding.decode(answer, some.len())
                })?;
                let in_picture = some.iter().zip(boxes).map(|(window, boxes)| {
                    let of_window = boxes.into_iter();
                    of_window.map(|found| window.to_picture(found)).collect()
                });
                found.extend(in_picture);
            }
        }
        Ok(found)
    }

    fn description(&self) -> String {
        format!("{:?}, {}", self.layout, self.input.size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPTIONS: OrtOptions = OrtOptions {
        library: None,
        threads: 1,
        batch: 6,
    };

    #[test]
    fn a_missing_model_is_named() {
        let message = OrtDetector::load(Path::new("gone.onnx"), &OPTIONS)
            .err()
            .unwrap()
            .to_string();
        assert!(
            message.contains("gone.onnx") && message.contains("ONNX file"),
            "{message}"
        );
    }

    #[test]
    fn a_real_yolox_model_answers_every_window_whatever_the_batch() {
        let Some(path) = std::env::var_os("DTD_YOLOX_MODEL").map(PathBuf::from) else {
            eprintln!(
                "skipped: DTD_YOLOX_MODEL does not name a YOLOX model (nor ORT_DYLIB_PATH ONNX Runtime)"
            );
            return;
        };
        let mut detector = OrtDetector::load(&path, &OPTIONS).unwrap();
        assert_eq!(
            (detector.layout, detector.window_size()),
            (Layout::Yolox, WindowSize::square(416))
        );
        let rgb = vec![120; 900 * 500 * 3];
        let picture = PictureView {
            rgb: &rgb,
            width_px: 900,
            height_px: 500,
        };
        let windows = [0, 416, 832].map(|left_px| Window {
            left_px,
            top_px: 0,
            width_px: 416,
            height_px: 416,
            shrink: 1,
        });
        let found = detector.detect(&picture, &windows, 0.0).unwrap();
        assert_eq!(found.iter().map(Vec::len).collect::<Vec<_>>(), [3_549; 3]);
        let best = found
            .iter()
            .flatten()
            .map(|candidate| candidate.score)
            .fold(0.0, f64::max);
        assert!(
            best < 0.3,
            "an even grey picture has no aircraft, but one of score {best} was found"
        );
    }
}
