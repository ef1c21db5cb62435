//! ONNX Runtime's sessions of one model: one for all windows, or on a device that is faster when it knows the size in advance, one for
//! each size of window.

use std::collections::{HashMap, HashSet};
use std::fmt::Display;

use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::ValueType;

use super::model_file::ModelFile;
use super::onnx_runtime::{self, Runtime};
use super::ort_detector::OrtOptions;
use crate::error::{Error, Result};

/// Where to look for weights outside the model's own file. Nowhere: the hash of the model would not cover them, and an untrusted
/// model could read files of its choice.
const EXTERNAL_WEIGHTS: &str = "session.model_external_initializers_file_folder_path";
const NOWHERE: &str = "/dev/null";

/// A shape of the input: windows, channels, height, width.
pub(super) type InputShape = [usize; 4];

/// The sessions of a model.
pub(super) struct Sessions {
    /// Takes every shape that the model takes.
    any: Session,
    of_shape: Option<SessionsOfShape>,
}

/// Sessions that take one shape each, made when the first windows of that shape come.
struct SessionsOfShape {
    model: ModelFile,
    options: OrtOptions,
    /// Names of the input's open lengths; empty for a fixed one.
    open_lengths: Vec<String>,
    made: HashMap<InputShape, Session>,
}

impl Sessions {
    /// Loads a model.
    pub(super) fn load(model: &ModelFile, options: &OrtOptions) -> Result<Self> {
        let any = session(model, options, &[])?;
        let open_lengths = open_lengths_of(&any);
        let of_shape = options.device.prefers_known_shapes() && !open_lengths.is_empty();
        let of_shape = of_shape.then(|| SessionsOfShape {
            model: model.clone(),
            options: options.clone(),
            open_lengths,
            made: HashMap::new(),
        });
        Ok(Self { any, of_shape })
    }

    /// The one that takes every shape: it tells what the model is.
    pub(super) fn any(&self) -> &Session {
        &self.any
    }

    /// The one to run windows of this shape in.
    pub(super) fn for_shape(&mut self, shape: InputShape) -> Result<&mut Session> {
        match &mut self.of_shape {
            Some(sessions) => sessions.get(shape),
            None => Ok(&mut self.any),
        }
    }
}

impl SessionsOfShape {
    fn get(&mut self, shape: InputShape) -> Result<&mut Session> {
        if !self.made.contains_key(&shape) {
            let lengths = self.open_lengths.iter().zip(shape);
            let lengths = lengths.filter(|(name, _)| !name.is_empty());
            let lengths: Vec<(&str, usize)> = lengths
                .map(|(name, length)| (name.as_str(), length))
                .collect();
            let session = session(&self.model, &self.options, &lengths)?;
            self.made.insert(shape, session);
        }
        Ok(self.made.get_mut(&shape).expect("made above"))
    }
}

/// Names of the lengths of a model's only input, empty for those that are fixed; none if no length has a name of its own.
fn open_lengths_of(session: &Session) -> Vec<String> {
    let [input] = session.inputs() else {
        return Vec::new();
    };
    let ValueType::Tensor {
        dimension_symbols, ..
    } = input.dtype()
    else {
        return Vec::new();
    };
    let names: Vec<&String> = dimension_symbols
        .iter()
        .filter(|name| !name.is_empty())
        .collect();
    let different: HashSet<&String> = names.iter().copied().collect();
    if different.is_empty() || different.len() < names.len() {
        return Vec::new();
    }
    dimension_symbols.iter().cloned().collect()
}

/// Loads a model; these open lengths of its input are fixed.
fn session(model: &ModelFile, options: &OrtOptions, lengths: &[(&str, usize)]) -> Result<Session> {
    let OrtOptions {
        library,
        device,
        threads,
        ..
    } = options;
    let runtime: &Runtime = onnx_runtime::runtime(library.as_deref())?;
    let providers = device.providers(runtime, *threads)?;
    let fault =
        |e: &dyn Display| Error::model(&model.path, format!("ONNX Runtime cannot load it: {e}"));
    let mut builder = Session::builder(&runtime.environment)
        .map_err(|e| fault(&e))?
        .with_optimization_level(GraphOptimizationLevel::All)
        .map_err(|e| fault(&e))?
        .with_intra_threads(*threads)
        .map_err(|e| fault(&e))?
        // Threads that spin while waiting would take the cores that decode the next picture.
        .with_intra_op_spinning(false)
        .map_err(|e| fault(&e))?
        .with_config_entry(EXTERNAL_WEIGHTS, NOWHERE)
        .map_err(|e| fault(&e))?
        .with_memory_pattern(device.takes_memory_pattern())
        .map_err(|e| fault(&e))?
        .with_execution_providers(providers)
        .map_err(|e| device.fails(runtime, &e))?;
    for &(name, length) in lengths {
        builder = builder
            .with_dimension_override(name, length as i64)
            .map_err(|e| fault(&e))?;
    }
    builder
        .commit_from_memory(&model.onnx)
        .map_err(|e| fault(&e))
}
