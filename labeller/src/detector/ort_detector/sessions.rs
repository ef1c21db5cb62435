//! A model's ONNX Runtime sessions: one for all windows or, on a device that is faster with known sizes, one per window size.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::fmt::Display;

use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::ValueType;

use crate::detector::device::Device;
use crate::detector::model_file::ModelFile;
use crate::detector::onnx_runtime::{self, Runtime};
use crate::detector::ort_detector::OrtOptions;
use crate::error::{Error, Result};

/// Folder of weights outside the model's file. Not allowed: the model's hash would not cover them, and an untrusted model could read any
/// file.
const EXTERNAL_WEIGHTS: &str = "session.model_external_initializers_file_folder_path";
const NOWHERE: &str = "/dev/null";

/// A shape of the input: windows, channels, height, width.
pub(crate) type InputShape = [usize; 4];

pub(crate) struct Sessions {
    /// Session for every shape. It describes the model, and runs all windows if there are no others.
    any: Session,
    of_shape: Option<SessionsOfShape>,
}

/// Sessions that take one shape each, made when the first windows of that shape come.
struct SessionsOfShape {
    model: ModelFile,
    options: OrtOptions,
    open_lengths: OpenLengths,
    made: HashMap<Vec<usize>, Session>,
}

/// For each length of the input, its name if it is open and no other has the same name.
type OpenLengths = Vec<Option<String>>;

impl Sessions {
    pub(crate) fn load(model: &ModelFile, options: &OrtOptions) -> Result<Self> {
        if options.device.prefers_known_shapes() {
            let to_describe = OrtOptions {
                device: Device::CPU,
                ..options.clone()
            };
            let any = session(model, &to_describe, &[])?;
            let open_lengths = open_lengths_of(&any);
            if open_lengths.iter().any(Option::is_some) {
                let of_shape = SessionsOfShape {
                    model: model.clone(),
                    options: options.clone(),
                    open_lengths,
                    made: HashMap::new(),
                };
                return Ok(Self {
                    any,
                    of_shape: Some(of_shape),
                });
            }
        }
        Ok(Self {
            any: session(model, options, &[])?,
            of_shape: None,
        })
    }

    pub(crate) fn any(&self) -> &Session {
        &self.any
    }

    /// The one to run windows of this shape in.
    pub(crate) fn for_shape(&mut self, shape: InputShape) -> Result<&mut Session> {
        match &mut self.of_shape {
            Some(sessions) => sessions.get(shape),
            None => Ok(&mut self.any),
        }
    }
}

impl SessionsOfShape {
    fn get(&mut self, shape: InputShape) -> Result<&mut Session> {
        let lengths = self.open_lengths.iter().zip(shape);
        let lengths: Vec<(&str, usize)> = lengths
            .filter_map(|(name, length)| Some((name.as_deref()?, length)))
            .collect();
        match self
            .made
            .entry(lengths.iter().map(|&(_, length)| length).collect())
        {
            Entry::Occupied(made) => Ok(made.into_mut()),
            Entry::Vacant(place) => {
                Ok(place.insert(session(&self.model, &self.options, &lengths)?))
            }
        }
    }
}

/// Open lengths of the only input; none for several inputs and for non-tensors.
fn open_lengths_of(session: &Session) -> OpenLengths {
    let [input] = session.inputs() else {
        return OpenLengths::new();
    };
    let ValueType::Tensor {
        dimension_symbols: names,
        ..
    } = input.dtype()
    else {
        return OpenLengths::new();
    };
    let is_own = |name: &String| {
        !name.is_empty() && names.iter().filter(|other| *other == name).count() == 1
    };
    names
        .iter()
        .map(|name| is_own(name).then(|| name.clone()))
        .collect()
}

/// Loads a model with fixed values for these open lengths.
fn session(model: &ModelFile, options: &OrtOptions, lengths: &[(&str, usize)]) -> Result<Session> {
    let OrtOptions {
        library,
        device,
        threads,
        ..
    } = options;
    let runtime: &Runtime = onnx_runtime::runtime(library.as_deref())?;
    let providers = device.providers(runtime, *threads)?;
    let fault = |e: &dyn Display| {
        let lengths = lengths
            .iter()
            .map(|(name, length)| format!("{name} = {length}"));
        let lengths: Vec<String> = lengths.collect();
        let with = if lengths.is_empty() { "" } else { " with " };
        let message = format!(
            "ONNX Runtime cannot load it{with}{}: {e}",
            lengths.join(", ")
        );
        Error::model(&model.path, message)
    };
    let mut builder = Session::builder(&runtime.environment)
        .map_err(|e| fault(&e))?
        .with_optimization_level(GraphOptimizationLevel::All)
        .map_err(|e| fault(&e))?
        .with_intra_threads(*threads)
        .map_err(|e| fault(&e))?
        // Threads that spin while waiting would take the cores that decode the next image.
        .with_intra_op_spinning(false)
        .map_err(|e| fault(&e))?
        .with_config_entry(EXTERNAL_WEIGHTS, NOWHERE)
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
        .map_err(|e| {
            if model.has_weights_elsewhere() {
                let fault = "keeps weights in further files, which are not read; export it as one file, e.g. in Python: \
                             onnx.save(onnx.load(\"model.onnx\"), \"one.onnx\")";
                Error::model(&model.path, fault)
            } else {
                fault(&e)
            }
        })
}
