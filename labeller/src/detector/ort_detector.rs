//! A detector from an ONNX file, run by ONNX Runtime.

mod ort_output;
mod sessions;

use std::path::PathBuf;

use ort::session::{Session, SessionOutputs};
use ort::value::TensorRef;

use super::device::Device;
use super::input::{CHANNELS, Input, WindowSize, numbers_in};
use super::layout::meaning::{KnownModel, Meaning};
use super::layout::{Decoding, Layout};
use super::model_file::ModelFile;
use super::outputs::BoxOutputs;
use super::plausibility::Plausibility;
use super::profile::ModelProfile;
use super::profile::aircraft_class::aircraft_class;
use super::profile::metadata::ModelMetadata;
use super::window::{PictureView, Window};
use super::{Detector, ScoredBox};
use crate::error::{Error, ModelFault, Result};
use ort_output::{forms_of, inputs_in_words, outputs_in_words, read_answer};
use sessions::Sessions;

/// Probe window for models that may take any size, in units of the stride: small, and not square.
const PROBE_MULTIPLES: [u32; 2] = [5, 4];

/// Options for running a model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OrtOptions {
    /// ONNX Runtime's library; `None` means `ORT_DYLIB_PATH`, else the installation's own. Only the first model of a process decides.
    pub library: Option<PathBuf>,
    /// The device that runs the model.
    pub device: Device,
    /// Threads within one run.
    pub threads: usize,
}

/// A detector from an ONNX file.
pub struct OrtDetector {
    path: PathBuf,
    sessions: Sessions,
    profile: ModelProfile,
    metadata: ModelMetadata,
    input: Input,
    output: Output,
    planes: Vec<f32>,
    found: Plausibility,
}

/// Form of the answers.
#[derive(Debug, Clone, Copy)]
struct Output {
    boxes: BoxOutputs,
    meaning: Meaning,
    /// Number of the aircraft among the classes.
    class: usize,
}

impl OrtDetector {
    /// Loads a model, runs it once on an empty window and finds out how it answers.
    pub fn of(model: &ModelFile, options: &OrtOptions) -> Result<Self> {
        let path = model.path.as_path();
        let sessions = Sessions::load(model, options)?;
        let session = sessions.any();
        let metadata = metadata_of(session);
        if let Some(task) = metadata.other_task() {
            let message = format!(
                "is a model for the task {task:?} by its metadata, expected one for \"detect\"; export a detector"
            );
            return Err(Error::model(path, message));
        }
        let profile = model.settings(metadata.profile.as_deref())?;
        let input = Input::of(session, &profile, metadata.stride_px).map_err(|fault| {
            Error::model(path, format!("{fault}; {}", inputs_in_words(session)))
        })?;
        let mut detector = Self {
            path: path.to_owned(),
            sessions,
            profile,
            metadata,
            input,
            output: Output {
                boxes: BoxOutputs::One(0),
                meaning: Meaning::usual(Layout::Rows),
                class: 0,
            },
            planes: Vec::new(),
            found: Plausibility::default(),
        };
        if let WindowSize::Any { multiple_px } = input.size {
            // Lengths may be open although the grid inside is not.
            match detector.probe(PROBE_MULTIPLES.map(|multiples| multiples * multiple_px)) {
                Ok(()) => return Ok(detector),
                Err(_) => detector.input = input.of_usual_size(),
            }
        }
        detector.probe(detector.input.size.usual_px())?;
        Ok(detector)
    }

    /// Runs the model on blank windows, finds out how it answers (from the settings, else from names, shapes and numbers of its outputs),
    /// and reads the answer, so that a mismatch shows before the first image.
    fn probe(&mut self, size_px: [u32; 2]) -> Result<()> {
        let windows = self.input.windows;
        self.planes.resize(windows * numbers_in(size_px), 0.0);
        let inputs = inputs_in_words(self.sessions.any());
        let settings = ModelFile::profile_path(&self.path).display().to_string();
        let (profile, metadata) = (self.profile.clone(), self.metadata.clone());
        self.output = self.run(windows, size_px, |outputs| {
            let forms = forms_of(outputs);
            let with_shapes = |fault: ModelFault| {
                ModelFault::new(format!("{fault}; {inputs}; {}", outputs_in_words(outputs)))
            };
            let known = KnownModel {
                window_px: size_px,
                profile: &profile,
                metadata: &metadata,
            };
            let found = BoxOutputs::of(&forms, &known, &settings);
            let (boxes, layout) = found.map_err(with_shapes)?;
            let (meaning, count) = read_answer(outputs, boxes, |answer| {
                let meaning = Meaning::of_probe(layout, answer, &known);
                Ok((meaning, meaning.layout.classes(answer.shape())))
            })?;
            let says_form = profile.box_form.is_some() || profile.box_unit.is_some();
            if meaning.layout == Layout::Yolox && says_form {
                return Err(with_shapes(ModelFault::new(
                    "its settings say box_form or box_unit, but its layout is yolox, whose boxes are relative to their cells; remove them, \
                     or name another layout",
                )));
            }
            let class = aircraft_class(profile.aircraft_class, metadata.names.as_ref(), count);
            let class = class.map_err(with_shapes)?;
            Ok(Output {
                boxes,
                meaning,
                class,
            })
        })?;
        self.boxes_in(windows, windows, size_px, 1.0)?;
        Ok(())
    }

    /// Runs the model on the first `run` windows in `planes`, which all have this width and height, and reads the boxes of the first
    /// `windows`.
    fn boxes_in(
        &mut self,
        run: usize,
        windows: usize,
        size_px: [u32; 2],
        score_floor: f64,
    ) -> Result<Vec<Vec<ScoredBox>>> {
        let Output {
            boxes,
            meaning,
            class,
        } = self.output;
        let decoding = Decoding {
            meaning,
            class,
            origin: self.profile.origin(meaning.layout),
            window_px: size_px,
            score_floor,
        };
        self.run(run, size_px, |outputs| {
            read_answer(outputs, boxes, |answer| decoding.decode(answer, windows))
        })
    }

    /// Runs the model on the first `windows` windows in `planes`, which all have this width and height.
    fn run<T>(
        &mut self,
        windows: usize,
        size_px: [u32; 2],
        read: impl FnOnce(&SessionOutputs<'_>) -> std::result::Result<T, ModelFault>,
    ) -> Result<T> {
        let path = &self.path;
        let fault = |e: ort::Error| Error::model(path, format!("ONNX Runtime cannot run it: {e}"));
        let [width, height] = size_px.map(|side_px| side_px as usize);
        let numbers = &self.planes[..windows * numbers_in(size_px)];
        let shape = [windows, CHANNELS, height, width];
        let input = TensorRef::from_array_view((shape, numbers)).map_err(fault)?;
        let session = self.sessions.for_shape(shape)?;
        let outputs = session.run(ort::inputs![input]).map_err(fault)?;
        read(&outputs).map_err(|fault| Error::model(path, fault))
    }
}

/// Metadata that its exporter wrote into a model.
fn metadata_of(session: &Session) -> ModelMetadata {
    let metadata = session.metadata().ok();
    ModelMetadata::of(|key| metadata.as_ref()?.custom(key))
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
        let layout = self.output.meaning.layout;
        let (order, scale) = (self.profile.order(layout), self.profile.scale(layout));
        let mut found = Vec::with_capacity(windows.len());
        let size_of = |window: &Window| [window.width_px, window.height_px];
        for same in windows.chunk_by(|a, b| size_of(a) == size_of(b)) {
            let size_px = size_of(&same[0]);
            let in_run = self.input.windows;
            for some in same.chunks(in_run) {
                let numbers = numbers_in(size_px);
                if self.planes.len() < in_run * numbers {
                    self.planes.resize(in_run * numbers, 0.0);
                }
                for (window, planes) in some.iter().zip(self.planes.chunks_exact_mut(numbers)) {
                    window.write_planes(picture, order, scale, planes);
                    self.profile.input.standardize(planes);
                }
                // Scores of shrunk aircraft are lower, and their second window decides.
                let floor = match some[0].shrink {
                    1 => self.profile.score_floor(score_floor),
                    _ => score_floor,
                };
                let boxes = self.boxes_in(in_run, some.len(), size_px, floor)?;
                for boxes in &boxes {
                    self.found.add(boxes, size_px);
                }
                let in_picture = some.iter().zip(boxes).map(|(window, boxes)| {
                    let of_window = boxes.into_iter();
                    of_window.map(|found| window.to_picture(found)).collect()
                });
                found.extend(in_picture);
            }
        }
        Ok(found)
    }

    fn first_pass_shrink(&self) -> u32 {
        self.profile.first_pass_shrink.unwrap_or(1)
    }

    fn description(&self) -> String {
        let Output { meaning, class, .. } = self.output;
        format!("{meaning}, class {class}, {}", self.input.size)
    }
}
