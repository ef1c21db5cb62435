//! The output layouts of detectors, recognised by their shapes, and how each becomes boxes. Where a shape has several meanings, the numbers
//! of an answer decide (`meaning.rs`).
//!
//! | layout | shape | a candidate |
//! |---|---|---|
//! | [`Layout::Rows`] | `[B, N, 6]`, any other N | cx, cy, w, h in px, objectness, class score: this project's own detector |
//! | [`Layout::AnchorRows`] | `[B, 3 * cells, 5 + classes]` | the same with any classes: YOLOv5 and v7 exported with their grid |
//! | [`Layout::Yolox`] | `[B, cells, 5 + classes]` | centre and size relative to the cell, undecoded: YOLOX |
//! | [`Layout::YoloxDecoded`] | `[B, cells, 5 + classes]` | like `AnchorRows`: YOLOX exported with its decoder |
//! | [`Layout::ClassRows`] | `[B, N, 4 + classes]` | cx, cy, w, h, class scores: earlier exports of RT-DETR |
//! | [`Layout::BoxesAndScores`] | two outputs | `[B, N, 4]` and `[B, N, classes]`: DETR and its kin (`boxes_and_scores.rs`) |
//! | [`Layout::Columns`] | `[B, 4 + classes, N]` | a column cx, cy, w, h in px, class scores: YOLOv8, v11 |
//! | [`Layout::Corners`] | `[B, 300, 6]` | x0, y0, x1, y1 in px, score, class: YOLOv10, v26; others with their suppression |
//! | [`Layout::BatchCorners`] | `[K, 7]` | window, x0, y0, x1, y1 in px, class, score (YOLOv7 end to end) or score, class (YOLO-NAS) |
//! | [`Layout::EfficientNms`] | four outputs | counts, corners in px, scores, classes: exports for TensorRT (`efficient_nms.rs`) |
//!
//! `cells` is the number of cells of the grids of strides 8, 16 and 32, and of 64 in YOLOv5 and v7 for large images. A model that is
//! read wrongly declares its layout in its [`ModelProfile`](super::ModelProfile). `docs/detectors.md` says more of each.

use std::fmt;
use std::ops::RangeInclusive;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::ScoredBox;
use super::answer::Answer;
use super::profile::{BoxForm, BoxOrigin, BoxUnit, ScoreForm};
use crate::error::ModelFault;
use dataset::tables::pixel_box::PixelBox;
use meaning::Meaning;

const STRIDES: [usize; 3] = [8, 16, 32];
/// Strides of models for 1,280 px images.
const STRIDES_OF_LARGE: [usize; 4] = [8, 16, 32, 64];
/// Further strides of models with anchors, for small objects and of small models. Only settings choose them.
const STRIDES_OF_OTHERS: [&[usize]; 3] = [&[4, 8, 16, 32], &[4, 8, 16, 32, 64], &[16, 32]];
/// The stride of this project's own detector.
const OWN_STRIDE: usize = 8;
/// Boxes that end-to-end YOLO models return per image.
const END_TO_END_BOXES: usize = 300;

/// Layout of a detector's output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// Decoded rows: this project's own detector.
    Rows,
    /// Decoded rows, three anchors a cell: YOLOv5, v7.
    AnchorRows,
    /// Undecoded rows, one a cell: YOLOX.
    Yolox,
    /// Decoded rows, one a cell: YOLOX with its decoder.
    YoloxDecoded,
    /// Decoded rows without objectness: RT-DETR.
    ClassRows,
    /// Boxes in one output, their class scores in another: DETR, YOLO-NAS without suppression.
    BoxesAndScores,
    /// Decoded columns: YOLOv8, v11.
    Columns,
    /// Final boxes by corners: YOLOv10, v26.
    Corners,
    /// Final boxes of a whole batch: YOLOv7 end to end.
    BatchCorners,
    /// Final boxes in four outputs: exports for TensorRT.
    EfficientNms,
}

/// Context for decoding the numbers.
#[derive(Debug, Clone)]
pub(super) struct Decoding {
    pub(super) meaning: Meaning,
    /// Number of the aircraft among the classes.
    pub(super) class: usize,
    pub(super) origin: BoxOrigin,
    pub(super) window_px: [u32; 2],
    pub(super) score_floor: f64,
}

/// Probabilities, with their rounding errors.
pub(super) const PROBABILITIES: RangeInclusive<f32> = -1e-3..=1.0 + 1e-3;

/// Grid cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    pub(super) stride_px: f32,
    pub(super) column: f32,
    pub(super) line: f32,
}

/// All cells in row order, for models with one candidate per cell.
pub(super) fn cells_in_order(window_px: [u32; 2]) -> impl Iterator<Item = Cell> {
    STRIDES.into_iter().flat_map(move |stride_px| {
        let [columns, rows] = grid(window_px, stride_px);
        (0..columns * rows).map(move |cell| Cell {
            stride_px: stride_px as f32,
            column: (cell % columns) as f32,
            line: (cell / columns) as f32,
        })
    })
}

/// Columns and rows of a stride's grid.
fn grid([width_px, height_px]: [u32; 2], stride: usize) -> [usize; 2] {
    [width_px, height_px].map(|side_px| side_px as usize / stride)
}

fn cells(window_px: [u32; 2], strides: &[usize]) -> usize {
    let of_stride = |&stride| grid(window_px, stride).iter().product::<usize>();
    strides.iter().map(of_stride).sum()
}

impl fmt::Display for Layout {
    /// Name as in the settings.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

impl Layout {
    /// Guesses the layout from a single output, for windows of this width and height. `has_objectness`: false if the candidates are known
    /// to have none; `named`: number of classes that the model names.
    pub fn of_shape(
        shape: &[usize],
        window_px: [u32; 2],
        has_objectness: bool,
        named: Option<usize>,
    ) -> Option<Self> {
        let plain = cells(window_px, &STRIDES);
        let of_anchors = [STRIDES.as_slice(), &STRIDES_OF_LARGE];
        let of_anchors = of_anchors.map(|strides| 3 * cells(window_px, strides));
        match *shape {
            [_, 7] => Some(Self::BatchCorners),
            // As many as were found.
            [_, 0, 6] => Some(Self::Corners),
            [_, _, 6] if !has_objectness => Some(Self::Corners),
            [_, rows, columns]
                if !has_objectness
                    && named.is_some_and(|named| columns == 4 + named && rows != 4 + named) =>
            {
                Some(Self::ClassRows)
            }
            [_, rows, columns] if columns == plain && rows >= 5 => Some(Self::Columns),
            [_, rows, columns] if of_anchors.contains(&rows) && columns >= 6 => {
                Some(Self::AnchorRows)
            }
            [_, rows, columns] if rows == plain && columns >= 6 => Some(Self::Yolox),
            [_, rows, 6] if rows == cells(window_px, &[OWN_STRIDE]) => Some(Self::Rows),
            [_, END_TO_END_BOXES, 6] => Some(Self::Corners),
            [_, rows, columns] if columns > rows && rows >= 5 => Some(Self::Columns),
            [_, _, 6] => Some(Self::Rows),
            _ => None,
        }
    }

    /// True if an output of this shape can have this layout.
    pub(super) fn fits(self, shape: &[usize], window_px: [u32; 2]) -> bool {
        let of_grids = || {
            let usual = [STRIDES.as_slice(), &STRIDES_OF_LARGE];
            let all = usual.into_iter().chain(STRIDES_OF_OTHERS);
            all.map(|strides| cells(window_px, strides))
        };
        match (self, shape) {
            (Self::BatchCorners, &[_, columns]) => columns == 7,
            (Self::Rows, &[_, _, columns]) => columns >= 6,
            // One a cell: YOLOv6.
            (Self::AnchorRows, &[_, rows, columns]) => {
                let is_grid = |cells| rows == cells || rows == 3 * cells;
                columns >= 6 && (rows == 0 || of_grids().any(is_grid))
            }
            (Self::Yolox | Self::YoloxDecoded, &[_, rows, columns]) => {
                rows == cells(window_px, &STRIDES) && columns >= 6
            }
            (Self::ClassRows | Self::BoxesAndScores, &[_, _, columns]) => columns >= 5,
            (Self::Columns, &[_, rows, _]) => rows >= 5,
            (Self::Corners | Self::EfficientNms, &[_, _, columns]) => columns == 6,
            _ => false,
        }
    }

    /// The shapes that have this layout, in words.
    pub(super) fn shape(self) -> &'static str {
        match self {
            Self::Rows => "[batch, candidates, 5 + classes]",
            Self::AnchorRows => {
                "[batch, one or three a cell of strides 8, 16 and 32 (or 4 to 32, 4 to 64, 8 to 64, 16 and 32), 5 + classes]"
            }
            Self::Yolox | Self::YoloxDecoded => {
                "[batch, cells of strides 8, 16 and 32, 5 + classes]"
            }
            Self::ClassRows => "[batch, candidates, 4 + classes]",
            Self::BoxesAndScores => {
                "two outputs: boxes [batch, candidates, 4] and scores [batch, candidates, classes]"
            }
            Self::Columns => "[batch, 4 + classes, candidates]",
            Self::Corners => "[batch, boxes, 6]",
            Self::BatchCorners => "[boxes, 7]",
            Self::EfficientNms => {
                "four outputs: counts [batch, 1], corners [batch, boxes, 4], scores and classes [batch, boxes]"
            }
        }
    }

    /// The number of classes that an output of this shape tells apart; `None` if it does not say.
    pub(super) fn classes(self, shape: &[usize]) -> Option<usize> {
        match (self, shape) {
            (
                Self::Rows | Self::AnchorRows | Self::Yolox | Self::YoloxDecoded,
                &[_, _, columns],
            ) => columns.checked_sub(5),
            (Self::ClassRows | Self::BoxesAndScores, &[_, _, columns]) => columns.checked_sub(4),
            (Self::Columns, &[_, rows, _]) => rows.checked_sub(4),
            _ => None,
        }
    }

    /// True if the models take images like YOLOX.
    pub(super) fn is_of_yolox(self) -> bool {
        matches!(self, Self::Yolox | Self::YoloxDecoded)
    }

    /// Usual box numbers.
    pub(super) fn usual_form(self) -> BoxForm {
        match self {
            Self::Corners | Self::BatchCorners | Self::EfficientNms => BoxForm::Corners,
            _ => BoxForm::CenterSize,
        }
    }

    /// The pixel origin that models of this layout use.
    pub(crate) fn usual_origin(self) -> BoxOrigin {
        match self {
            Self::Rows => BoxOrigin::PixelCenter,
            _ => BoxOrigin::PixelCorner,
        }
    }
}

/// Probabilities of classes that exclude each other, from logits.
pub(super) fn softmax(logits: &[f32]) -> Vec<f32> {
    let most = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let parts = logits.iter().map(|logit| (logit - most).exp());
    let sum: f32 = parts.clone().sum();
    parts.map(|part| part / sum).collect()
}

/// The output does not fit its layout.
fn misfit(shape: &[usize], expected: &str, windows: usize, layout: Layout) -> ModelFault {
    ModelFault::new(format!(
        "has the shape {shape:?}, expected {expected} for {windows} windows (layout {layout})"
    ))
}

/// The candidates that are boxes.
fn found(
    candidates: impl Iterator<Item = Result<Option<ScoredBox>, ModelFault>>,
) -> Result<Vec<ScoredBox>, ModelFault> {
    candidates.filter_map(Result::transpose).collect()
}

impl Decoding {
    /// Boxes of each of `windows` windows. A window without a candidate has none.
    pub(super) fn decode(
        &self,
        answer: Answer<'_>,
        windows: usize,
    ) -> Result<Vec<Vec<ScoredBox>>, ModelFault> {
        let layout = self.meaning.layout;
        let shape = answer.shape();
        let misfit = |expected| misfit(shape, expected, windows, layout);
        if !layout.fits(shape, self.window_px) {
            return Err(misfit(layout.shape()));
        }
        if layout == Layout::BatchCorners {
            return self.batch_corners(answer.numbers(), windows);
        }
        let &[batch, _, columns] = shape else {
            return Err(misfit("three dimensions"));
        };
        if batch < windows {
            return Err(misfit("an answer for each window"));
        }
        if let Some(classes) = layout.classes(shape)
            && self.class >= classes
        {
            return Err(ModelFault::new(format!(
                "has {classes} classes, expected more than {}, the number of the aircraft",
                self.class
            )));
        }
        let boxes = |of_window: &[f32]| match layout {
            Layout::Columns => self.columns(of_window, columns),
            Layout::Yolox => self.yolox(of_window, columns),
            Layout::Rows | Layout::AnchorRows | Layout::YoloxDecoded => {
                self.rows(of_window, columns)
            }
            Layout::ClassRows | Layout::BoxesAndScores => self.class_rows(of_window, columns),
            Layout::Corners | Layout::BatchCorners | Layout::EfficientNms => {
                self.corners(of_window)
            }
        };
        answer.of_windows(windows).into_iter().map(boxes).collect()
    }

    fn rows(&self, answer: &[f32], columns: usize) -> Result<Vec<ScoredBox>, ModelFault> {
        let scored = |row: &[f32]| {
            let score = self.score(row[4])? * self.score(row[5 + self.class])?;
            Ok(self.boxed([row[0], row[1], row[2], row[3]], score))
        };
        found(answer.chunks_exact(columns).map(scored))
    }

    fn class_rows(&self, answer: &[f32], columns: usize) -> Result<Vec<ScoredBox>, ModelFault> {
        let scored = |row: &[f32]| {
            let score = match self.meaning.scores {
                ScoreForm::Softmax => softmax(&row[4..])[self.class],
                _ => self.score(row[4 + self.class])?,
            };
            Ok(self.boxed([row[0], row[1], row[2], row[3]], score))
        };
        found(answer.chunks_exact(columns).map(scored))
    }

    fn columns(&self, answer: &[f32], candidates: usize) -> Result<Vec<ScoredBox>, ModelFault> {
        let value = |field: usize, candidate: usize| answer[field * candidates + candidate];
        let scored = |k: usize| {
            let score = self.score(value(4 + self.class, k))?;
            Ok(self.boxed([0, 1, 2, 3].map(|field| value(field, k)), score))
        };
        found((0..candidates).map(scored))
    }

    fn yolox(&self, answer: &[f32], columns: usize) -> Result<Vec<ScoredBox>, ModelFault> {
        let scored = |(row, cell): (&[f32], Cell)| {
            let Cell {
                stride_px: stride,
                column,
                line,
            } = cell;
            let centre = [(row[0] + column) * stride, (row[1] + line) * stride];
            let size = [row[2].exp() * stride, row[3].exp() * stride];
            let score = self.score(row[4])? * self.score(row[5 + self.class])?;
            Ok(self.centred([centre[0], centre[1], size[0], size[1]], score))
        };
        let rows = answer.chunks_exact(columns);
        found(rows.zip(cells_in_order(self.window_px)).map(scored))
    }

    fn corners(&self, answer: &[f32]) -> Result<Vec<ScoredBox>, ModelFault> {
        let scored = |row: &[f32]| {
            if row[5] != self.class as f32 {
                return Ok(None);
            }
            let score = self.score(row[4])?;
            Ok(self.boxed([row[0], row[1], row[2], row[3]], score))
        };
        found(answer.chunks_exact(6).map(scored))
    }

    fn batch_corners(
        &self,
        numbers: &[f32],
        windows: usize,
    ) -> Result<Vec<Vec<ScoredBox>>, ModelFault> {
        let mut found = vec![Vec::new(); windows];
        let rows = || numbers.chunks_exact(7);
        // YOLO-NAS has them in the other order. Classes are whole numbers; scores may be exactly 1, but a box of score 0 is never returned.
        let is_class_and_score = |class: usize, score: usize| {
            rows().filter(|row| row[1..5] != [0.0; 4]).all(|row| {
                row[class] >= 0.0
                    && row[class].fract() == 0.0
                    && row[score] > 0.0
                    && row[score] <= 1.0
            })
        };
        let (class, score) = if is_class_and_score(6, 5) && !is_class_and_score(5, 6) {
            (6, 5)
        } else {
            (5, 6)
        };
        for row in rows() {
            let window = row[0];
            if window < 0.0 || window.fract() != 0.0 {
                let most = windows.saturating_sub(1);
                return Err(ModelFault::new(format!(
                    "has a box of window {window}, expected 0 to {most}"
                )));
            }
            // Windows beyond the requested ones only fill a fixed batch: they are empty.
            if let Some(boxes) = found.get_mut(window as usize)
                && row[class] == self.class as f32
            {
                let score = self.score(row[score])?;
                boxes.extend(self.boxed([row[1], row[2], row[3], row[4]], score));
            }
        }
        Ok(found)
    }

    fn score(&self, number: f32) -> Result<f32, ModelFault> {
        match self.meaning.scores {
            ScoreForm::Logit => Ok(1.0 / (1.0 + (-number).exp())),
            ScoreForm::Probability | ScoreForm::Softmax
                if number.is_finite() && !PROBABILITIES.contains(&number) =>
            {
                Err(ModelFault::new(format!(
                    "has a score of {number}, expected 0 to 1; if its scores are logits, say score_form = \"logit\" in its settings, or \"softmax\" \
                     if its last class is `no object`"
                )))
            }
            ScoreForm::Probability | ScoreForm::Softmax => Ok(number),
        }
    }

    /// Box from a candidate's four numbers.
    fn boxed(&self, numbers: [f32; 4], score: f32) -> Option<ScoredBox> {
        let [width, height] = match self.meaning.unit {
            BoxUnit::Pixels => [1.0; 2],
            BoxUnit::Normalized => self.window_px.map(|side_px| side_px as f32),
        };
        let [a, b, c, d] = numbers;
        let [a, b, c, d] = [a * width, b * height, c * width, d * height];
        let centred = match self.meaning.form {
            BoxForm::CenterSize => [a, b, c, d],
            BoxForm::Corners => [(a + c) / 2.0, (b + d) / 2.0, c - a, d - b],
        };
        self.centred(centred, score)
    }

    /// A box from centre and size in the model's coordinates, unless its score is below the floor or it is invalid.
    fn centred(&self, numbers: [f32; 4], score: f32) -> Option<ScoredBox> {
        let confident = f64::from(score) >= self.score_floor;
        // A finite value may have overflowed in the exponential function, or in a product.
        if !confident || numbers.iter().any(|number| !number.is_finite()) {
            return None;
        }
        let [cx, cy, width_px, height_px] = numbers.map(f64::from);
        let to_pixel_centre = match self.origin {
            BoxOrigin::PixelCenter => 0.0,
            BoxOrigin::PixelCorner => -0.5,
        };
        // Larger or more distant boxes come from overflows that happen to be finite.
        let most_px = 4.0 * f64::from(self.window_px[0].max(self.window_px[1]));
        let is_near = [cx, cy].iter().all(|at_px| at_px.abs() <= most_px);
        let is_size = |px: f64| px > 0.0 && px <= most_px;
        (is_near && is_size(width_px) && is_size(height_px)).then(|| ScoredBox {
            pixel_box: PixelBox {
                cx_px: cx + to_pixel_centre,
                cy_px: cy + to_pixel_centre,
                width_px,
                height_px,
            },
            score: f64::from(score).min(1.0),
        })
    }
}

pub(crate) mod boxes_and_scores;
pub(crate) mod efficient_nms;
pub(crate) mod meaning;
pub(crate) mod suppression;
#[cfg(test)]
mod tests;
