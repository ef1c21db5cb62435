//! A detector from an ONNX file, run by ONNX Runtime.

use std::path::{Path, PathBuf};

use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::{TensorElementType, TensorRef, ValueType};

use super::layout::{Decoding, Layout};
use super::onnx_runtime;
use super::profile::{METADATA_KEY, ModelProfile};
use super::window::{Picture, Window};
use super::{Detector, ScoredBox};
use crate::error::{Error, Result};

/// Edge length of a model that leaves it open.
const USUAL_WINDOW_PX: u32 = 640;
const CHANNELS: usize = 3;

/// How a model is run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OrtOptions {
    /// Threads within one run.
    pub threads: usize,
    /// Most windows in one run; a model with a fixed batch gets its own number.
    pub batch: usize,
}

/// A detector from an ONNX file.
pub struct OrtDetector {
    path: PathBuf,
    session: Session,
    profile: ModelProfile,
    layout: Layout,
    window_px: u32,
    batch: Batch,
    /// The input of one run, reused.
    planes: Vec<f32>,
}

/// Windows per run.
#[derive(Debug, Clone, Copy)]
enum Batch {
    /// The model takes exactly so many; missing ones are left empty.
    Exactly(usize),
    /// The model takes any number.
    UpTo(usize),
}

impl OrtDetector {
    /// Loads a model, runs it once on an empty window and finds out how it answers.
    pub fn load(path: &Path, options: OrtOptions) -> Result<Self> {
        if !path.is_file() {
            return Err(Error::model(path, "is not there; expected an ONNX file"));
        }
        let environment = onnx_runtime::environment()?;
        let fault = |e: &dyn std::fmt::Display| {
            Error::model(path, format!("ONNX Runtime cannot load it: {e}"))
        };
        let mut builder = Session::builder(environment)
            .map_err(|e| fault(&e))?
            .with_optimization_level(GraphOptimizationLevel::All)
            .map_err(|e| fault(&e))?
            .with_intra_threads(options.threads)
            .map_err(|e| fault(&e))?
            // Threads that spin while they wait take the cores that the next picture is decoded on.
            .with_intra_op_spinning(false)
            .map_err(|e| fault(&e))?;
        let session = builder.commit_from_file(path).map_err(|e| fault(&e))?;
        let metadata = session
            .metadata()
            .ok()
            .and_then(|metadata| metadata.custom(METADATA_KEY));
        let profile = ModelProfile::find(path, metadata)?;
        let (fixed_batch, window_px) =
            input_of(&session, &profile).map_err(|message| Error::model(path, message))?;
        let batch = fixed_batch.map_or(Batch::UpTo(options.batch.max(1)), Batch::Exactly);
        let mut detector = Self {
            path: path.to_owned(),
            session,
            profile,
            layout: Layout::Rows,
            window_px,
            batch,
            planes: Vec::new(),
        };
        detector.layout = detector.probe()?;
        Ok(detector)
    }

    /// The form of the answer: as the profile says, else by the shape of a real answer.
    fn probe(&mut self) -> Result<Layout> {
        let windows = match self.batch {
            Batch::Exactly(windows) => windows,
            Batch::UpTo(_) => 1,
        };
        self.planes.resize(windows * self.plane_numbers(), 0.0);
        let (said, window_px) = (self.profile.layout, self.window_px);
        let shape = self.run(windows, |shape, _| Ok(shape.to_vec()))?;
        said.or_else(|| Layout::of_shape(&shape, window_px)).ok_or_else(|| {
            self.fault(format!(
                "answers with the shape {shape:?}, which is none of the known layouts (see docs of `Layout`); \
                 name one in {}.json, or export the model with its grid",
                self.path.display()
            ))
        })
    }

    fn plane_numbers(&self) -> usize {
        CHANNELS * (self.window_px as usize).pow(2)
    }

    /// Runs the model on the first `windows` windows in `planes`.
    fn run<T>(
        &mut self,
        windows: usize,
        read: impl FnOnce(&[usize], &[f32]) -> std::result::Result<T, String>,
    ) -> Result<T> {
        let path = &self.path;
        let fault = |e: ort::Error| Error::model(path, format!("ONNX Runtime cannot run it: {e}"));
        let size = self.window_px as usize;
        let numbers = &self.planes[..windows * CHANNELS * size * size];
        let input = TensorRef::from_array_view(([windows, CHANNELS, size, size], numbers))
            .map_err(fault)?;
        let outputs = self.session.run(ort::inputs![input]).map_err(fault)?;
        let (shape, data) = outputs[0].try_extract_tensor::<f32>().map_err(fault)?;
        let shape: Vec<usize> = shape
            .iter()
            .map(|size| usize::try_from(*size).unwrap_or(0))
            .collect();
        read(&shape, data).map_err(|message| Error::model(path, message))
    }

    fn fault(&self, message: impl ToString) -> Error {
        Error::model(&self.path, message)
    }
}

/// The fixed batch, if it is fixed, and the edge length of the model's input.
fn input_of(
    session: &Session,
    profile: &ModelProfile,
) -> std::result::Result<(Option<usize>, u32), String> {
    let [input] = session.inputs() else {
        return Err(format!(
            "has {} inputs, expected one",
            session.inputs().len()
        ));
    };
    let [_] = session.outputs() else {
        return Err(format!(
            "has {} outputs, expected one; export it with its grid",
            session.outputs().len()
        ));
    };
    let wanted = "expected floats of the shape [batch, 3, size, size]";
    let ValueType::Tensor {
        ty: TensorElementType::Float32,
        shape,
        ..
    } = input.dtype()
    else {
        return Err(format!("its input is {:?}, {wanted}", input.dtype()));
    };
    let &[batch, channels, height, width] = &shape[..] else {
        return Err(format!(
            "its input has the shape {:?}, {wanted}",
            &shape[..]
        ));
    };
    if channels != CHANNELS as i64 || height != width {
        return Err(format!(
            "its input has the shape {:?}, {wanted}",
            &shape[..]
        ));
    }
    let open_size = profile.input.size_px.unwrap_or(USUAL_WINDOW_PX);
    let window_px = u32::try_from(width)
        .ok()
        .filter(|size| *size > 0)
        .unwrap_or(open_size);
    Ok((
        usize::try_from(batch).ok().filter(|batch| *batch > 0),
        window_px,
    ))
}

impl Detector for OrtDetector {
    fn window_px(&self) -> u32 {
        self.window_px
    }

    fn detect(
        &mut self,
        picture: &Picture<'_>,
        windows: &[Window],
        score_floor: f64,
    ) -> Result<Vec<Vec<ScoredBox>>> {
        let (Batch::Exactly(most) | Batch::UpTo(most)) = self.batch;
        let (order, scale) = (
            self.profile.order(self.layout),
            self.profile.scale(self.layout),
        );
        let mut found = Vec::with_capacity(windows.len());
        for some in windows.chunks(most) {
            let in_run = match self.batch {
                Batch::Exactly(windows) => windows,
                Batch::UpTo(_) => some.len(),
            };
            let plane_numbers = self.plane_numbers();
            if self.planes.len() < in_run * plane_numbers {
                self.planes.resize(in_run * plane_numbers, 0.0);
            }
            for (window, planes) in some.iter().zip(self.planes.chunks_exact_mut(plane_numbers)) {
                window.write_planes(picture, self.window_px, order, scale, planes);
            }
            let profile = self.profile;
            let decoding = Decoding {
                layout: self.layout,
                profile: &profile,
                window_px: self.window_px,
                score_floor,
            };
            found.extend(self.run(in_run, |shape, data| {
                decoding.decode(shape, data, some.len())
            })?);
        }
        Ok(found)
    }

    fn description(&self) -> String {
        format!("{:?}, windows of {} px", self.layout, self.window_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPTIONS: OrtOptions = OrtOptions {
        threads: 1,
        batch: 6,
    };

    #[test]
    fn a_missing_model_is_named() {
        let message = OrtDetector::load(Path::new("gone.onnx"), OPTIONS)
            .err()
            .unwrap()
            .to_string();
        assert!(
            message.contains("gone.onnx") && message.contains("ONNX file"),
            "{message}"
        );
    }

    #[test]
    fn a_file_that_is_no_model_is_an_error_and_no_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("broken.onnx");
        std::fs::write(&path, "this is no model").unwrap();
        let message = OrtDetector::load(&path, OPTIONS).err().unwrap().to_string();
        // Without the library the message names that instead: both are clear errors.
        assert!(
            message.contains("broken.onnx") || message.contains("scripts/setup.sh"),
            "{message}"
        );
    }

    #[test]
    fn a_real_yolox_model_answers_every_window_whatever_the_batch() {
        let Some(path) = std::env::var_os("DTD_YOLOX_MODEL").map(PathBuf::from) else {
            eprintln!("skipped: DTD_YOLOX_MODEL does not name a YOLOX model");
            return;
        };
        let mut detector = OrtDetector::load(&path, OPTIONS).unwrap();
        assert_eq!(
            (detector.layout, detector.window_px()),
            (Layout::Yolox, 416)
        );
        let rgb = vec![120; 900 * 500 * 3];
        let picture = Picture {
            rgb: &rgb,
            width_px: 900,
            height_px: 500,
        };
        let windows = [0, 416, 832].map(|left_px| Window { left_px, top_px: 0 });
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
