//! Evaluation of a detector on a labelled corpus: range, recall, false alarms and accuracy of its boxes.
//!
//! Input: a labelled corpus and a model. Output: [`Evaluation`] (`evaluation.json`) and a report page. The videos are searched by the code
//! of `dtd detect`, once in each mode; every image ends up as found, missed for a reason, or not expected, and is counted once. Recall and
//! ranges, defined as in the paper's table 2, follow from the counts; box errors, disparity errors between two views and COCO's average
//! precision follow from the boxes.

#![forbid(unsafe_code)]

mod accuracy;
mod average_precision;
mod error;
mod evaluation;
mod false_alarms;
mod figures;
pub mod mode;
mod outcome;
mod recall;
mod report;
#[cfg(test)]
mod samples;
mod search_store;

pub use accuracy::{BoxErrors, BoxSpreads, DisparityErrors, WidthFigures};
pub use average_precision::{AveragePrecision, PrecisionTally, TrueAircraft};
pub use error::{Error, Result};
pub use evaluation::{Ended, EvaluationOptions, evaluate_detector};
pub use false_alarms::{AlarmCounts, FalseAlarms};
pub use figures::{
    ConditionFigures, EvaluatedModel, Evaluation, ModeFigures, PictureFigures, RegistrationBin,
    RegistrationFigures, SightCounts,
};
pub use recall::{Counts, NotExpected, Range, Recall, RecallBin};
pub use search_store::REPORT;
