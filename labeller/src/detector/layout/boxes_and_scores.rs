//! The two outputs of models that keep boxes and class scores apart: `[B, N, 4]` and `[B, N, classes]`, such as RF-DETR, D-FINE without its
//! postprocessor and YOLO-NAS without suppression.

use super::efficient_nms::OutputForm;
use crate::detector::answer::Answer;
use crate::detector::layout::{Layout, misfit};
use crate::error::ModelFault;

/// Numbers per box.
const BOX: usize = 4;

/// Places of the two outputs among a model's outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PairOutputs {
    pub(crate) boxes: usize,
    pub(crate) scores: usize,
}

impl PairOutputs {
    /// If a model has exactly these, besides outputs of other shapes. `named`: the settings' name of the output with the boxes; without it
    /// the one whose name says so is taken among two with four numbers: three classes and "no object" are four numbers as well.
    pub(crate) fn of(outputs: &[OutputForm], named: Option<&str>) -> Option<Self> {
        let is_row = |output: &OutputForm| !output.holds_integers && output.shape.len() == 3;
        let mut boxes: Vec<usize> = (0..outputs.len())
            .filter(|&index| is_row(&outputs[index]) && outputs[index].shape[2] == BOX)
            .filter(|&index| named.is_none_or(|name| outputs[index].name == name))
            .collect();
        if boxes.len() > 1 {
            let says_box = |name: &str| name.contains("box") || name.contains("det");
            boxes.retain(|&index| says_box(&outputs[index].name.to_lowercase()));
        }
        let &[boxes] = &boxes[..] else {
            return None;
        };
        let mut scores = (0..outputs.len()).filter(|&index| {
            index != boxes
                && is_row(&outputs[index])
                && outputs[index].shape[..2] == outputs[boxes].shape[..2]
        });
        let found = scores.next()?;
        scores.next().is_none().then_some(Self {
            boxes,
            scores: found,
        })
    }
}

/// Joins both outputs to rows of box and class scores; returns shape and numbers.
pub(crate) fn joined(
    boxes: Answer<'_>,
    scores: Answer<'_>,
) -> Result<([usize; 3], Vec<f32>), ModelFault> {
    let layout = Layout::BoxesAndScores;
    let windows = scores.shape().first().copied().unwrap_or(0);
    let fault = || misfit(boxes.shape(), layout.shape(), windows, layout);
    let (&[batch, candidates, BOX], &[_, _, classes]) = (boxes.shape(), scores.shape()) else {
        return Err(fault());
    };
    if scores.shape()[..2] != [batch, candidates] || classes == 0 {
        return Err(fault());
    }
    let mut joined = Vec::with_capacity(batch * candidates * (BOX + classes));
    let rows = boxes.numbers().chunks_exact(BOX);
    for (numbers, scores) in rows.zip(scores.numbers().chunks_exact(classes)) {
        joined.extend_from_slice(numbers);
        joined.extend_from_slice(scores);
    }
    Ok(([batch, candidates, BOX + classes], joined))
}
