//! Meaning of the numbers of an answer whose shape has several meanings.
//!
//! Input: the answer to a blank window, and what settings and metadata say. A detector answers that with candidates of low scores all over
//! the window, or with no box at all; then the shape alone decides. The same shape is told apart by
//!
//! - **Classes by number**: in a row of six, the last number of final boxes is whole; that of candidates is a score.
//! - **Edges**: the third and fourth number exceed the first two in corners, but hardly ever in centres and sizes.
//! - **Unit**: no number of a box in parts of the window is far above 1; in pixels most are.
//! - **Cells**: the centre of a decoded candidate is near its cell; an undecoded one is near 0.

use std::fmt;

use dataset::numbers::spread::median;

use crate::detector::answer::Answer;
use crate::detector::layout::{Cell, Layout, PROBABILITIES, cells_in_order, softmax};
use crate::detector::profile::metadata::ModelMetadata;
use crate::detector::profile::{BoxForm, BoxUnit, ModelProfile, ScoreForm};

/// Last module of RT-DETR as Ultralytics exports it: rows of centre and size in parts of the window, score, class.
const RT_DETR: &str = "RTDETRDecoder";
/// Range of relative box coordinates; boxes may lie partly outside the window.
const NORMALIZED: std::ops::RangeInclusive<f32> = -0.5..=1.5;
/// Part of the boxes by corners whose edges are in order. Single ones of low score are turned inside out.
const MIN_ORDERED: f64 = 0.75;
/// Part of the numbers of boxes in parts of the window that are in that range. A few may be overflows.
const MIN_NORMALIZED: f64 = 0.99;
/// Part of the scores of logits that are no probabilities. The answer to a blank window has low ones.
const MIN_LOGITS: f64 = 0.25;

/// Part of the candidates of a blank window that are no object, by the last of excluding classes.
const MIN_NO_OBJECT: f64 = 0.9;

/// Model properties besides its outputs.
pub(crate) struct KnownModel<'a> {
    pub(crate) window_px: [u32; 2],
    pub(crate) profile: &'a ModelProfile,
    pub(crate) metadata: &'a ModelMetadata,
}

/// Interpretation of the numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Meaning {
    pub(crate) layout: Layout,
    pub(crate) form: BoxForm,
    pub(crate) unit: BoxUnit,
    pub(crate) scores: ScoreForm,
}

impl Meaning {
    /// Usual interpretation for a layout.
    pub(crate) fn usual(layout: Layout) -> Self {
        Self {
            layout,
            form: layout.usual_form(),
            unit: BoxUnit::Pixels,
            scores: ScoreForm::Probability,
        }
    }

    /// Interpretation of the answer to a blank window, whose shape has this layout.
    pub(crate) fn of_probe(layout: Layout, answer: Answer<'_>, known: &KnownModel<'_>) -> Self {
        let profile = known.profile;
        let judged = match profile.layout {
            Some(said) => Self::usual(said),
            None if known.is_rt_detr(layout, answer) => Self {
                form: BoxForm::CenterSize,
                unit: BoxUnit::Normalized,
                ..Self::usual(layout)
            },
            None => Self::usual(layout_by_numbers(layout, answer, known)),
        };
        let boxes = Boxes::of(judged.layout, answer);
        let form = match judged.layout {
            Layout::BoxesAndScores if boxes.are_ordered() => BoxForm::Corners,
            Layout::Corners if !boxes.all.is_empty() && !boxes.are_ordered() => BoxForm::CenterSize,
            _ => judged.form,
        };
        let unit = if boxes.are_normalized() {
            BoxUnit::Normalized
        } else {
            judged.unit
        };
        let scores = match judged.layout {
            Layout::BoxesAndScores if has_logits(answer) => {
                if has_no_object(answer) {
                    ScoreForm::Softmax
                } else {
                    ScoreForm::Logit
                }
            }
            _ => judged.scores,
        };
        Self {
            layout: judged.layout,
            form: profile.box_form.unwrap_or(form),
            unit: profile.box_unit.unwrap_or(unit),
            scores: profile.score_form.unwrap_or(scores),
        }
    }
}

impl fmt::Display for Meaning {
    /// The layout, and its unusual properties.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let usual = Self::usual(self.layout);
        write!(f, "{}", self.layout)?;
        if self.form != usual.form {
            f.write_str(match self.form {
                BoxForm::CenterSize => " by centre and size",
                BoxForm::Corners => " by corners",
            })?;
        }
        if self.unit == BoxUnit::Normalized {
            f.write_str(" in parts of the window")?;
        }
        f.write_str(match self.scores {
            ScoreForm::Probability => "",
            ScoreForm::Logit => ", logits",
            ScoreForm::Softmax => ", logits with a class for no object",
        })
    }
}

impl KnownModel<'_> {
    /// True if an output of this layout is RT-DETR's, by its head. A row of six may also be of two class scores.
    fn is_rt_detr(&self, layout: Layout, answer: Answer<'_>) -> bool {
        let is_row_of_six = matches!(answer.shape(), [_, _, 6])
            && layout == Layout::Corners
            && answer
                .numbers()
                .chunks_exact(6)
                .all(|row| row[5].fract() == 0.0);
        self.metadata.head.as_deref() == Some(RT_DETR)
            && (is_row_of_six || layout == Layout::ClassRows)
    }
}

/// The layout of this shape that the numbers have.
fn layout_by_numbers(layout: Layout, answer: Answer<'_>, known: &KnownModel<'_>) -> Layout {
    let &[_, _, columns] = answer.shape() else {
        return layout;
    };
    let is_of_rows = matches!(
        layout,
        Layout::Rows | Layout::AnchorRows | Layout::Yolox | Layout::Corners
    );
    let boxes = Boxes::of(Layout::Corners, answer);
    if is_of_rows && columns == 6 && !boxes.all.is_empty() {
        let has_classes = answer
            .numbers()
            .chunks_exact(6)
            .all(|row| (0.0..=1.0).contains(&row[4]) && row[5] >= 0.0 && row[5].fract() == 0.0);
        // The rows of grids are candidates, whose class score may be 1 everywhere.
        let is_grid = matches!(layout, Layout::AnchorRows | Layout::Yolox);
        if has_classes && (boxes.are_ordered() || !is_grid && boxes.are_normalized()) {
            return Layout::Corners;
        }
        if layout == Layout::Corners && !has_classes && known.metadata.named_classes() == Some(2) {
            return Layout::ClassRows;
        }
    }
    if layout == Layout::Yolox && is_decoded(answer, columns, known.window_px) {
        // YOLOv6 has no objectness, and writes 1 in its place.
        let mut rows = answer.numbers().chunks_exact(columns);
        return if rows.all(|row| row[4] == 1.0 || row[..4] == [0.0; 4]) {
            Layout::AnchorRows
        } else {
            Layout::YoloxDecoded
        };
    }
    layout
}

/// True if the candidates of cells, in pixels or in parts of the window, are nearer to their cells than to 0.
fn is_decoded(answer: Answer<'_>, columns: usize, window_px: [u32; 2]) -> bool {
    let (mut from_cell, mut from_cell_in_parts, mut from_zero) =
        (Vec::new(), Vec::new(), Vec::new());
    let [width_px, height_px] = window_px.map(|side_px| side_px as f32);
    for of_window in answer.of_windows(1) {
        for (row, cell) in of_window
            .chunks_exact(columns)
            .zip(cells_in_order(window_px))
        {
            if row[..4] == [0.0; 4] {
                continue;
            }
            let Cell {
                stride_px,
                column,
                line,
            } = cell;
            let apart = |x: f32, y: f32| f64::from((x - 0.5).abs() + (y - 0.5).abs());
            from_cell.push(apart(
                row[0] / stride_px - column,
                row[1] / stride_px - line,
            ));
            from_cell_in_parts.push(apart(
                row[0] * width_px / stride_px - column,
                row[1] * height_px / stride_px - line,
            ));
            from_zero.push(apart(row[0], row[1]));
        }
    }
    if from_zero.is_empty() {
        return false;
    }
    let [in_px, in_parts, zero] =
        [from_cell, from_cell_in_parts, from_zero].map(|mut distances| median(&mut distances));
    in_px < zero || in_parts < zero
}

/// True if many scores are outside the range of probabilities.
fn has_logits(answer: Answer<'_>) -> bool {
    let scores = || scores_of(answer).flatten();
    let outside = scores().filter(|score| !PROBABILITIES.contains(score));
    outside.count() as f64 > MIN_LOGITS * scores().count() as f64
}

/// Class scores of each candidate, after the box.
fn scores_of(answer: Answer<'_>) -> impl Iterator<Item = &[f32]> {
    let columns = answer.shape().last().copied().unwrap_or(0).max(4);
    answer.numbers().chunks_exact(columns).map(|row| &row[4..])
}

/// True if almost all candidates of a blank window are of the last class, as in DETR.
fn has_no_object(answer: Answer<'_>) -> bool {
    // Logits of classes that do not exclude each other are below 0 where nothing is.
    let is_none = |scores: &[f32]| {
        let last = scores.last().copied().unwrap_or_default();
        scores.len() > 1 && last > 0.0 && softmax(scores)[scores.len() - 1] > 0.5
    };
    let none = scores_of(answer).filter(|scores| is_none(scores)).count();
    none as f64 >= MIN_NO_OBJECT * scores_of(answer).count() as f64
}

/// The boxes of the first window, without those of zeros, which fill places that no box takes.
struct Boxes {
    all: Vec<[f32; 4]>,
}

impl Boxes {
    fn of(layout: Layout, answer: Answer<'_>) -> Self {
        let of_rows = |numbers: &[f32], columns: usize, first: usize| {
            let rows = numbers.chunks_exact(columns.max(first + 4));
            rows.map(|row| [0, 1, 2, 3].map(|field| row[first + field]))
                .collect()
        };
        let mut all: Vec<[f32; 4]> = match (layout, answer.shape()) {
            // Not boxes yet.
            (Layout::Yolox, _) => Vec::new(),
            (_, &[_, columns]) => of_rows(answer.numbers(), columns, 1),
            (Layout::Columns, &[batch, rows, candidates]) if batch > 0 && rows >= 4 => {
                let value = |field: usize, k: usize| answer.numbers()[field * candidates + k];
                (0..candidates)
                    .map(|k| [0, 1, 2, 3].map(|field| value(field, k)))
                    .collect()
            }
            (Layout::EfficientNms, &[_, _, columns]) => {
                // A place past the number of boxes has no class.
                let rows = answer.numbers().chunks_exact(columns.max(6));
                let counted = rows.filter(|row| row[5] >= 0.0);
                counted
                    .map(|row| [row[0], row[1], row[2], row[3]])
                    .collect()
            }
            (_, &[batch, _, columns]) if batch > 0 => of_rows(answer.of_windows(1)[0], columns, 0),
            _ => Vec::new(),
        };
        all.retain(|numbers| *numbers != [0.0; 4]);
        Self { all }
    }

    /// True if the numbers are corners, by the order of the edges.
    fn are_ordered(&self) -> bool {
        let ordered = self.all.iter().filter(|[a, b, c, d]| c > a && d > b);
        !self.all.is_empty() && ordered.count() as f64 >= MIN_ORDERED * self.all.len() as f64
    }

    fn are_normalized(&self) -> bool {
        let numbers = self.all.iter().flatten();
        let inside = numbers.filter(|number| NORMALIZED.contains(number)).count();
        !self.all.is_empty() && inside as f64 >= MIN_NORMALIZED * (4 * self.all.len()) as f64
    }
}

#[cfg(test)]
mod tests;
