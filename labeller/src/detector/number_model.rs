//! Runs a model of numbers, in double precision, such as an exported estimator.

use std::borrow::Cow;
use std::path::Path;

use ort::session::{Session, SessionInputValue};
use ort::value::TensorRef;

use super::onnx_runtime;
use crate::error::{Error, Result};

/// Model input.
#[derive(Debug, Clone, Copy)]
pub struct NumberInput<'a> {
    /// Input name.
    pub name: &'a str,
    /// Input shape.
    pub shape: [usize; 3],
    /// Numbers, row by row.
    pub numbers: &'a [f64],
}

/// Runs a model once on the CPU, and returns the numbers of the first output. `name`: the model in errors; `library`: see
/// [`super::OrtOptions`].
pub fn run_numbers(
    name: &Path,
    onnx: &[u8],
    inputs: &[NumberInput],
    library: Option<&Path>,
) -> Result<Vec<f64>> {
    let fault =
        |e: &dyn std::fmt::Display| Error::model(name, format!("ONNX Runtime cannot run it: {e}"));
    let runtime = onnx_runtime::runtime(library)?;
    let mut session = Session::builder(&runtime.environment)
        .map_err(|e| fault(&e))?
        .with_intra_threads(1)
        .map_err(|e| fault(&e))?
        .commit_from_memory(onnx)
        .map_err(|e| fault(&e))?;
    let mut named: Vec<(Cow<'_, str>, SessionInputValue<'_>)> = Vec::new();
    for input in inputs {
        let tensor = TensorRef::from_array_view((input.shape, input.numbers));
        let tensor = tensor.map_err(|e| fault(&e))?;
        named.push((input.name.into(), tensor.into()));
    }
    let outputs = session.run(named).map_err(|e| fault(&e))?;
    let (_, numbers) = outputs[0]
        .try_extract_tensor::<f64>()
        .map_err(|e| fault(&e))?;
    Ok(numbers.to_vec())
}
