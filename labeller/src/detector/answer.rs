//! Raw model output, checked before it is read: a model is untrusted and may return anything.

use std::fmt::Debug;

use crate::error::ModelFault;

/// Maximum size of a run's windows, and of the output for them, bytes: five windows of the largest size.
pub(super) const MAX_RUN_BYTES: usize = 1 << 30;

/// Finite numbers with a matching shape.
#[derive(Debug, Clone, Copy)]
pub(super) struct Answer<'a> {
    shape: &'a [usize],
    numbers: &'a [f32],
}

/// The output would not fit into memory.
pub(super) fn too_large(shape: &dyn Debug) -> ModelFault {
    ModelFault::new(format!(
        "has the shape {shape:?}, more than {MAX_RUN_BYTES} bytes; expected a few thousand candidates a window"
    ))
}

impl<'a> Answer<'a> {
    /// Checks that the number count matches the shape, and that every number is finite.
    pub(super) fn new(shape: &'a [usize], numbers: &'a [f32]) -> Result<Self, ModelFault> {
        match numbers_of(shape) {
            Some(expected) if expected == numbers.len() => {}
            Some(_) => {
                return Err(ModelFault::new(format!(
                    "has {} numbers, which does not match its shape {shape:?}",
                    numbers.len()
                )));
            }
            None => return Err(too_large(&shape)),
        }
        match numbers.iter().position(|number| !number.is_finite()) {
            None => Ok(Self { shape, numbers }),
            Some(at) => Err(ModelFault::new(format!(
                "is {} at {:?} of {shape:?}, expected a finite number: the model is damaged, or was exported for numbers of other precision",
                numbers[at],
                place_of(at, shape)
            ))),
        }
    }

    pub(super) fn shape(&self) -> &'a [usize] {
        self.shape
    }

    pub(super) fn numbers(&self) -> &'a [f32] {
        self.numbers
    }

    /// The parts of the first `windows` windows, if the output has one row per window. Empty parts are included.
    pub(super) fn of_windows(&self, windows: usize) -> Vec<&'a [f32]> {
        let batch = self.shape.first().copied().unwrap_or(0);
        let each = self.numbers.len() / batch.max(1);
        (0..windows)
            .map(|window| &self.numbers[window * each..(window + 1) * each])
            .collect()
    }
}

/// Number of elements; `None` if there are too many for an output.
pub(super) fn numbers_of(shape: &[usize]) -> Option<usize> {
    // A length of 0 makes the whole output empty, whatever the others are.
    if shape.contains(&0) {
        return Some(0);
    }
    shape
        .iter()
        .try_fold(1_usize, |product, &length| product.checked_mul(length))
        .filter(|numbers| *numbers <= MAX_RUN_BYTES / size_of::<f32>())
}

/// Element indices, the last one varying fastest.
fn place_of(mut at: usize, shape: &[usize]) -> Vec<usize> {
    let mut place: Vec<usize> = shape
        .iter()
        .rev()
        .map(|&length| {
            let index = at % length;
            at /= length;
            index
        })
        .collect();
    place.reverse();
    place
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_has_as_many_numbers_as_its_shape_and_each_is_one() {
        let fault = |shape: &[usize], numbers: &[f32]| Answer::new(shape, numbers).unwrap_err();
        assert!(Answer::new(&[1, 0, 6], &[]).is_ok());
        let said = fault(&[1, 2, 6], &[0.0; 11]).to_string();
        assert!(said.contains("has 11 numbers"), "{said}");
        for shape in [&[usize::MAX, 6][..], &[1 << 20, 1 << 20, 6]] {
            let said = fault(shape, &[]).to_string();
            assert!(said.contains("more than"), "{said}");
        }
        let mut numbers = [0.0; 24];
        numbers[17] = f32::NAN;
        let said = fault(&[2, 2, 6], &numbers).to_string();
        assert!(said.contains("NaN at [1, 0, 5] of [2, 2, 6]"), "{said}");
    }
}
