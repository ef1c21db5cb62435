//! The four outputs of models that suppress duplicates as TensorRT's plugin `EfficientNMS_TRT` does: per window the number of boxes,
//! their corners, scores and classes. The last three have room for the same number of boxes; those past the number mean nothing.

use crate::detector::answer::Answer;
use crate::detector::layout::{self, Layout};
use crate::error::ModelFault;

/// A class that no model has, for places past the number of boxes.
const NO_CLASS: f32 = -1.0;
/// Numbers per box: four edges, score, class.
pub(crate) const NUMBERS: usize = 6;

/// Places of the four outputs among a model's outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NmsOutputs {
    pub(crate) counts: usize,
    pub(crate) corners: usize,
    pub(crate) scores: usize,
    pub(crate) classes: usize,
}

/// Distinguishes outputs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct OutputForm {
    pub(crate) name: String,
    pub(crate) holds_integers: bool,
    pub(crate) shape: Vec<usize>,
}

impl NmsOutputs {
    /// If a model has exactly these. Scores and classes have the same shape: classes are integers, else the names decide.
    pub(crate) fn of(outputs: &[OutputForm]) -> Option<Self> {
        if outputs.len() != 4 {
            return None;
        }
        let only = |is_it: &dyn Fn(&OutputForm) -> bool| {
            let mut found = (0..outputs.len()).filter(|&index| is_it(&outputs[index]));
            found.next().filter(|_| found.next().is_none())
        };
        let corners = only(&|output| matches!(output.shape[..], [_, _, 4]))?;
        let &[batch, boxes, _] = &outputs[corners].shape[..] else {
            return None;
        };
        let counts = only(&|output| {
            output.holds_integers && (output.shape == [batch, 1] || output.shape == [batch])
        });
        // With room for one box, classes have the shape of counts.
        let counts = counts.or_else(|| only(&|output| output.name.contains("num")))?;
        let others: Vec<_> = (0..4)
            .filter(|index| ![corners, counts].contains(index))
            .collect();
        let &[one, other] = &others[..] else {
            return None;
        };
        if [one, other]
            .iter()
            .any(|&index| outputs[index].shape != [batch, boxes])
        {
            return None;
        }
        let is_of_classes = |index: usize| {
            let name = &outputs[index].name;
            name.contains("class") || name.contains("label")
        };
        let (scores, classes) = match [one, other].map(|index| outputs[index].holds_integers) {
            [false, true] => (one, other),
            [true, false] => (other, one),
            _ if is_of_classes(other) && !is_of_classes(one) => (one, other),
            _ if is_of_classes(one) && !is_of_classes(other) => (other, one),
            _ => return None,
        };
        Some(Self {
            counts,
            corners,
            scores,
            classes,
        })
    }
}

/// Joins counts, corners, scores and classes to an output of [`Layout::Corners`]; returns shape and numbers. Places past the number of
/// boxes get no class.
pub(crate) fn joined(
    [counts, corners, scores, classes]: [Answer<'_>; 4],
) -> Result<([usize; 3], Vec<f32>), ModelFault> {
    let shape = corners.shape();
    let layout = Layout::EfficientNms;
    let [counts, corners, scores, classes] =
        [counts, corners, scores, classes].map(|answer| answer.numbers());
    let misfit = || layout::misfit(shape, layout.shape(), counts.len(), layout);
    let &[batch, boxes, 4] = shape else {
        return Err(misfit());
    };
    if [scores.len(), classes.len()] != [batch * boxes; 2] || counts.len() != batch {
        return Err(misfit());
    }
    let mut joined = Vec::with_capacity(batch * boxes * NUMBERS);
    for (window, &count) in counts.iter().enumerate() {
        if count < 0.0 || count.fract() != 0.0 || count > boxes as f32 {
            return Err(ModelFault::new(format!(
                "counts {count} boxes in a window, expected 0 to {boxes}"
            )));
        }
        for place in 0..boxes {
            let index = window * boxes + place;
            let is_counted = (place as f32) < count;
            let class = if is_counted { classes[index] } else { NO_CLASS };
            joined.extend(&corners[4 * index..4 * index + 4]);
            joined.extend([scores[index], class]);
        }
    }
    Ok(([batch, boxes, NUMBERS], joined))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn form(name: &str, holds_integers: bool, shape: &[usize]) -> OutputForm {
        OutputForm {
            name: name.into(),
            holds_integers,
            shape: shape.to_vec(),
        }
    }

    #[test]
    fn the_four_outputs_are_found_in_any_order_by_shape_type_and_at_last_name() {
        let usual = [
            form("num_dets", true, &[2, 1]),
            form("det_boxes", false, &[2, 100, 4]),
            form("det_scores", false, &[2, 100]),
            form("det_classes", true, &[2, 100]),
        ];
        let expected = NmsOutputs {
            counts: 0,
            corners: 1,
            scores: 2,
            classes: 3,
        };
        assert_eq!(NmsOutputs::of(&usual), Some(expected));
        let mut turned = usual.clone();
        turned.reverse();
        let found = NmsOutputs::of(&turned).unwrap();
        assert_eq!(
            [found.counts, found.corners, found.scores, found.classes],
            [3, 2, 1, 0]
        );
        let floats = [
            form("num", true, &[1]),
            form("labels", false, &[1, 9]),
            form("boxes", false, &[1, 9, 4]),
            form("scores", false, &[1, 9]),
        ];
        let found = NmsOutputs::of(&floats).unwrap();
        assert_eq!(
            [found.counts, found.corners, found.scores, found.classes],
            [0, 2, 3, 1]
        );
        let mut one_box = usual.clone();
        for (output, shape) in one_box
            .iter_mut()
            .zip([&[1, 1][..], &[1, 1, 4], &[1, 1], &[1, 1]])
        {
            output.shape = shape.to_vec();
        }
        assert_eq!(NmsOutputs::of(&one_box), Some(expected));
    }

    #[test]
    fn other_outputs_are_not_these() {
        let usual = |shape: &[usize]| {
            [
                form("num_dets", true, &[1, 1]),
                form("det_boxes", false, shape),
                form("det_scores", false, &[1, 100]),
                form("det_classes", true, &[1, 100]),
            ]
        };
        assert!(NmsOutputs::of(&usual(&[1, 100, 4])).is_some());
        for shape in [&[1, 100, 5][..], &[1, 99, 4], &[100, 4]] {
            assert_eq!(NmsOutputs::of(&usual(shape)), None, "{shape:?}");
        }
        assert_eq!(NmsOutputs::of(&usual(&[1, 100, 4])[..3]), None);
    }

    fn joined_with(counts: &[f32]) -> Result<Vec<f32>, ModelFault> {
        let answer = |shape, numbers| Answer::new(shape, numbers).unwrap();
        let (shape, numbers) = joined([
            answer(&[2, 1], counts),
            answer(&[2, 1, 4], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]),
            answer(&[2, 1], &[0.5, 0.25]),
            answer(&[2, 1], &[4.0, 4.0]),
        ])?;
        assert_eq!(shape, [2, 1, NUMBERS]);
        Ok(numbers)
    }

    #[test]
    fn boxes_past_their_number_have_no_class() {
        assert_eq!(
            joined_with(&[1.0, 0.0]).unwrap(),
            [1.0, 2.0, 3.0, 4.0, 0.5, 4.0, 5.0, 6.0, 7.0, 8.0, 0.25, -1.0]
        );
        for count in [-1.0, 2.0, 0.5] {
            let said = joined_with(&[1.0, count]).unwrap_err().to_string();
            assert!(said.contains(&format!("counts {count} boxes")), "{said}");
        }
    }
}
