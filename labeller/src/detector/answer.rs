//! The raw output of a model, checked before anything is read from it: a model is untrusted and may return anything.

use super::layout::Layout;

/// Maximum bytes of the windows of one run, or of the output for them: five windows of the largest size.
pub(super) const MAX_RUN_BYTES: usize = 1 << 30;

/// Numbers and their shape. The count matches the shape, and all of them are finite.
#[derive(Debug, Clone, Copy)]
pub(super) struct Answer<'a> {
    shape: &'a [usize],
    numbers: &'a [f32],
}

/// A fault of an output. The caller names model and output.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum AnswerFault {
    #[error(
        "has the shape {shape:?}, more than {MAX_RUN_BYTES} bytes; expected a few thousand candidates a window"
    )]
    TooLarge { shape: Vec<usize> },
    #[error("has {found} numbers, which does not match its shape {shape:?}")]
    Length { shape: Vec<usize>, found: usize },
    #[error(
        "is {found} at {place:?} of {shape:?}, expected a finite number: the model is damaged, or was exported for numbers of other precision"
    )]
    NotFinite {
        found: f32,
        place: Vec<usize>,
        shape: Vec<usize>,
    },
    #[error("has the shape {shape:?}, expected {expected} for {windows} windows (layout {layout})")]
    Misfit {
        shape: Vec<usize>,
        expected: &'static str,
        windows: usize,
        layout: Layout,
    },
    #[error("has {classes} classes, expected more than {class}, the number of the aircraft")]
    FewClasses { classes: usize, class: usize },
    #[error("counts {found} boxes in a window, expected 0 to {most}")]
    Count { found: f32, most: usize },
    #[error("has a box of window {found}, expected 0 to {most}")]
    NoSuchWindow { found: f32, most: usize },
}

impl<'a> Answer<'a> {
    /// Checks that the number count matches the shape, and that every number is finite.
    pub(super) fn new(shape: &'a [usize], numbers: &'a [f32]) -> Result<Self, AnswerFault> {
        match numbers_of(shape) {
            Some(expected) if expected == numbers.len() => {}
            Some(_) => {
                return Err(AnswerFault::Length {
                    shape: shape.to_vec(),
                    found: numbers.len(),
                });
            }
            None => {
                return Err(AnswerFault::TooLarge {
                    shape: shape.to_vec(),
                });
            }
        }
        match numbers.iter().position(|number| !number.is_finite()) {
            None => Ok(Self { shape, numbers }),
            Some(at) => Err(AnswerFault::NotFinite {
                found: numbers[at],
                place: place_of(at, shape),
                shape: shape.to_vec(),
            }),
        }
    }

    pub(super) fn shape(&self) -> &'a [usize] {
        self.shape
    }

    pub(super) fn numbers(&self) -> &'a [f32] {
        self.numbers
    }

    /// The parts of the first `windows` windows, if the output is a row of them. Empty parts are included.
    pub(super) fn of_windows(&self, windows: usize) -> Vec<&'a [f32]> {
        let batch = self.shape.first().copied().unwrap_or(0);
        let each = self.numbers.len() / batch.max(1);
        (0..windows)
            .map(|window| &self.numbers[window * each..(window + 1) * each])
            .collect()
    }
}

/// The number of elements of a shape; `None` if there are too many for an output.
pub(super) fn numbers_of(shape: &[usize]) -> Option<usize> {
    // A length of 0 makes all of it empty, however long the others are.
    if shape.contains(&0) {
        return Some(0);
    }
    shape
        .iter()
        .try_fold(1_usize, |product, &length| product.checked_mul(length))
        .filter(|numbers| *numbers <= MAX_RUN_BYTES / size_of::<f32>())
}

/// The indices of an element, the last one varying fastest.
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
        assert!(matches!(
            fault(&[1, 2, 6], &[0.0; 11]),
            AnswerFault::Length { found: 11, .. }
        ));
        for shape in [&[usize::MAX, 6][..], &[1 << 20, 1 << 20, 6]] {
            assert!(matches!(fault(shape, &[]), AnswerFault::TooLarge { .. }));
        }
        let mut numbers = [0.0; 24];
        numbers[17] = f32::NAN;
        let said = fault(&[2, 2, 6], &numbers).to_string();
        assert!(said.contains("NaN at [1, 0, 5] of [2, 2, 6]"), "{said}");
    }
}
