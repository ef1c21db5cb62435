//! ONNX export of a run's estimators. The models contain everything between boxes in pixels and a distance in metres: box selection,
//! normalisation, networks or formulas.
//!
//! Input: a run folder. Output: [`ExportedRun`]: the models, their card, and ticks with this crate's answers, so that the caller can verify
//! a runtime before anybody uses the files.
//!
//! Each part of the graphs is written next to the code that it repeats.

mod model_card;
mod probes;

use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;

use crate::error::Result;
use crate::evaluation::metrics::Metrics;
use crate::run::estimator::{Estimator, Task};
use crate::run::folder::RunFolder;
use crate::run::sealed::SealedRun;
use crate::run::trained::TrainedRun;

use crate::networks::estimator_graph::REGISTRATIONS;
pub use probes::Probes;

/// Maximum difference between a runtime's answers and ours, relative to the distance, at least a nautical mile: the rounding
/// errors of networks do not shrink with the distance.
pub const TOLERANCE: f64 = 1e-5;

/// Exported estimators.
#[derive(Debug, Clone)]
pub struct ExportedRun {
    /// Models, one per estimator.
    pub models: Vec<ExportedModel>,
    /// Model card for users, as Markdown.
    pub card: String,
    /// Ticks that verify the models.
    pub probes: Probes,
}

/// Exported estimator.
#[derive(Debug, Clone)]
pub struct ExportedModel {
    /// Estimator name.
    pub name: &'static str,
    /// True if the model also takes registrations.
    pub takes_registrations: bool,
    /// Content of the ONNX file.
    pub onnx: Vec<u8>,
    /// Our answers to the probes, metres.
    pub expected_m: Vec<Option<f64>>,
}

/// Exports all estimators that need no cameras.
pub fn export(run: &RunFolder) -> Result<ExportedRun> {
    let sealed = SealedRun::read(run)?;
    let trained = TrainedRun::of(&sealed)?;
    let metrics: Option<Metrics> = sealed.result(RunFolder::METRICS, "metrics")?;
    let (probes, believed) = probes::draw(&trained.normalisation);
    let task = Task::new(&trained, &[], &believed);
    let model = |estimator: Estimator| {
        let model = estimator.to_onnx(&trained)?;
        Some(ExportedModel {
            name: estimator.name(),
            takes_registrations: model.graph.as_ref().is_some_and(|graph| {
                let mut names = graph.input.iter().map(|input| input.name.as_str());
                names.any(|name| name == REGISTRATIONS)
            }),
            onnx: model.bytes(),
            expected_m: estimator.answers(&task).distances_m,
        })
    };
    let models: Vec<ExportedModel> = Estimator::ALL.into_iter().filter_map(model).collect();
    Ok(ExportedRun {
        card: model_card::text(&trained, metrics.as_ref(), &models),
        models,
        probes,
    })
}

/// Agreement between a runtime's answers and ours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Number of probes with an answer.
    pub answered: usize,
    /// Maximum relative difference, as in [`TOLERANCE`]; infinite where only one side answers.
    pub largest: f64,
    /// Pair of answers at this maximum, the runtime's first, metres; NaN for no answer.
    pub worst_m: [f64; 2],
}

impl ExportedModel {
    /// Compares a runtime's answers with ours; NaN and missing answers count as none.
    pub fn agreement(&self, answers_m: &[f64]) -> Agreement {
        let expected = self.expected_m.iter().map(|m| m.unwrap_or(f64::NAN));
        let answers = answers_m.iter().copied().chain(std::iter::repeat(f64::NAN));
        let apart =
            |[answer_m, expected_m]: [f64; 2]| match (answer_m.is_nan(), expected_m.is_nan()) {
                (true, true) => 0.0,
                (false, false) => {
                    (answer_m - expected_m).abs() / expected_m.abs().max(METERS_PER_NAUTICAL_MILE)
                }
                _ => f64::INFINITY,
            };
        let none = Agreement {
            answered: self.expected_m.iter().flatten().count(),
            largest: 0.0,
            worst_m: [f64::NAN; 2],
        };
        let pairs = answers
            .zip(expected)
            .map(|(answer, expected)| [answer, expected]);
        pairs.fold(none, |agreement, worst_m| match apart(worst_m) {
            largest if largest > agreement.largest => Agreement {
                largest,
                worst_m,
                ..agreement
            },
            _ => agreement,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_agree_to_the_tolerance_and_only_where_both_have_one() {
        let model = ExportedModel {
            name: "mono_pinhole",
            takes_registrations: false,
            onnx: Vec::new(),
            expected_m: vec![Some(10_000.0), None, Some(10.0)],
        };
        let same = model.agreement(&[10_000.05, f64::NAN, 10.01]);
        assert_eq!(same.answered, 2);
        assert!((same.largest - 0.01 / 1_852.0).abs() < 1e-12 && same.largest < TOLERANCE);
        let apart = model.agreement(&[10_000.2, f64::NAN, 10.0]);
        assert!(apart.largest > TOLERANCE);
        assert_eq!(apart.worst_m, [10_000.2, 10_000.0]);
        for answers in [&[10_000.0, 5.0, 10.0][..], &[10_000.0, f64::NAN]] {
            assert_eq!(model.agreement(answers).largest, f64::INFINITY);
        }
    }
}
