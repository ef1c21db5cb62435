//! Run results: forms of the outputs, and boxes.

use std::borrow::Cow;

use ort::session::{Session, SessionOutputs};
use ort::value::{TensorElementType, ValueType};

use crate::detector::answer::Answer;
use crate::detector::layout::efficient_nms::OutputForm;
use crate::detector::layout::{boxes_and_scores, efficient_nms};
use crate::detector::outputs::BoxOutputs;
use crate::error::ModelFault;

/// Names, types and shapes of the inputs, for messages.
pub(crate) fn inputs_in_words(session: &Session) -> String {
    let inputs = session.inputs().iter();
    let inputs: Vec<_> = inputs
        .map(|input| format!("{:?} {}", input.name(), input.dtype()))
        .collect();
    format!("inputs {}", inputs.join(", "))
}

/// Names, types and shapes of the outputs, for messages.
pub(crate) fn outputs_in_words(outputs: &SessionOutputs<'_>) -> String {
    let outputs: Vec<_> = outputs
        .iter()
        .map(|(name, value)| format!("{name:?} {}", value.dtype()))
        .collect();
    format!("outputs {}", outputs.join(", "))
}

pub(crate) fn forms_of(outputs: &SessionOutputs<'_>) -> Vec<OutputForm> {
    let form = |(name, value): (&str, ort::value::ValueRef<'_>)| {
        let (holds_integers, shape) = match value.dtype() {
            ValueType::Tensor { ty, shape, .. } => (is_integer(*ty), sizes(shape)),
            // Told apart from boxes by its rank.
            _ => (false, Vec::new()),
        };
        OutputForm {
            name: name.to_owned(),
            holds_integers,
            shape,
        }
    };
    outputs.iter().map(form).collect()
}

/// Reads the numbers from one output, or from several joined ones.
pub(crate) fn read_answer<T>(
    outputs: &SessionOutputs<'_>,
    at: BoxOutputs,
    read: impl FnOnce(Answer<'_>) -> Result<T, ModelFault>,
) -> Result<T, ModelFault> {
    match at {
        BoxOutputs::One(index) => {
            let output = Output::of(outputs, index)?;
            read(output.answer()?).map_err(|fault| output.fault(fault))
        }
        BoxOutputs::BoxesAndScores(at) => {
            let boxes = Output::of(outputs, at.boxes)?;
            let scores = Output::of(outputs, at.scores)?;
            let joined = boxes_and_scores::joined(boxes.answer()?, scores.answer()?);
            let (shape, numbers) = joined.map_err(|fault| boxes.fault(fault))?;
            let answer = Answer::new(&shape, &numbers).and_then(read);
            answer.map_err(|fault| boxes.fault(fault))
        }
        BoxOutputs::EfficientNms(at) => {
            let counts = Output::of(outputs, at.counts)?;
            let corners = Output::of(outputs, at.corners)?;
            let scores = Output::of(outputs, at.scores)?;
            let classes = Output::of(outputs, at.classes)?;
            let joined = efficient_nms::joined([
                counts.answer()?,
                corners.answer()?,
                scores.answer()?,
                classes.answer()?,
            ]);
            let (shape, numbers) = joined.map_err(|fault| counts.fault(fault))?;
            let answer = Answer::new(&shape, &numbers).and_then(read);
            answer.map_err(|fault| corners.fault(fault))
        }
    }
}

struct Output<'a> {
    name: &'a str,
    shape: Vec<usize>,
    numbers: Cow<'a, [f32]>,
}

impl<'a> Output<'a> {
    fn of(outputs: &'a SessionOutputs<'_>, index: usize) -> Result<Self, ModelFault> {
        let name = outputs.keys().nth(index).unwrap_or_default();
        let value = &outputs[index];
        let other = || {
            ModelFault::new(format!(
                "output {name:?} is {}, expected numbers of f32 (i32 or i64 for counts and classes); export it without half precision",
                value.dtype()
            ))
        };
        let ValueType::Tensor { ty, shape, .. } = value.dtype() else {
            return Err(other());
        };
        let numbers = match ty {
            TensorElementType::Float32 => value
                .try_extract_tensor::<f32>()
                .map(|(_, numbers)| Cow::Borrowed(numbers)),
            TensorElementType::Int32 => value
                .try_extract_tensor::<i32>()
                .map(|(_, numbers)| numbers.iter().map(|&number| number as f32).collect()),
            TensorElementType::Int64 => value
                .try_extract_tensor::<i64>()
                .map(|(_, numbers)| numbers.iter().map(|&number| number as f32).collect()),
            _ => return Err(other()),
        };
        Ok(Self {
            name,
            shape: sizes(shape),
            numbers: numbers.map_err(|_| other())?,
        })
    }

    fn answer(&self) -> Result<Answer<'_>, ModelFault> {
        Answer::new(&self.shape, &self.numbers).map_err(|fault| self.fault(fault))
    }

    fn fault(&self, fault: ModelFault) -> ModelFault {
        ModelFault::new(format!("output {:?} {fault}", self.name))
    }
}

fn is_integer(ty: TensorElementType) -> bool {
    matches!(ty, TensorElementType::Int32 | TensorElementType::Int64)
}

fn sizes(shape: &[i64]) -> Vec<usize> {
    let size = |&length: &i64| usize::try_from(length).unwrap_or(0);
    shape.iter().map(size).collect()
}
