//! The estimators of distance to touchdown: the one list of their names, their words in the report, and their answers.
//!
//! One more estimator is one more variant: whatever it lacks, the compiler names.

use burn::tensor::Device;

use crate::encoded::Encoded;
use crate::mono_network::MonoInputs;
use crate::normalisation::TARGET_UNIT_M;
use crate::samples::{Sample, ScenarioSummary};
use crate::trained_run::TrainedRun;
use crate::{paper_lstm, pinhole, triangulation};

/// One estimator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Estimator {
    /// Calibration networks, then an LSTM over the views.
    PaperLstm,
    /// Least squares of the inverse range.
    InverseRange,
    /// The point nearest to the rays through the boxes.
    Triangulation,
    /// A network per view that sees the whole box.
    MonoNetworkBox,
    /// A network per view that sees the box's size.
    MonoNetwork,
    /// A formula per view.
    MonoPinhole,
}

/// How an estimator is presented.
pub(crate) struct Description {
    /// Name in `metrics.json` and, followed by `_dtd_m`, in `predictions.parquet`.
    pub(crate) name: &'static str,
    /// Title in the report.
    pub(crate) title: &'static str,
    /// Its method in a line.
    pub(crate) how: &'static str,
}

/// Samples to estimate, and what a training learned.
pub(crate) struct Task<'a> {
    run: &'a TrainedRun,
    scenarios: &'a [ScenarioSummary],
    samples: &'a [&'a Sample],
    encoded: Encoded,
}

impl<'a> Task<'a> {
    /// `scenarios` are those that the samples refer to.
    pub(crate) fn new(
        run: &'a TrainedRun,
        scenarios: &'a [ScenarioSummary],
        samples: &'a [&'a Sample],
    ) -> Self {
        Self {
            run,
            scenarios,
            samples,
            encoded: Encoded::new(samples.iter().copied(), &run.normalisation),
        }
    }

    /// A network's answers in metres. It always returns something, even without any box.
    fn metres(&self, units: Vec<f32>) -> Vec<Option<f64>> {
        let metres = |(unit, sample): (f32, &&Sample)| {
            (sample.detections() > 0).then(|| f64::from(unit) * TARGET_UNIT_M)
        };
        units.into_iter().zip(self.samples).map(metres).collect()
    }

    fn mono(&self, inputs: MonoInputs) -> Vec<Option<f64>> {
        let networks = match inputs {
            MonoInputs::Size => &self.run.networks.mono_size,
            MonoInputs::Box => &self.run.networks.mono_box,
        };
        let loss = self.run.config.loss;
        self.metres(networks.predict(inputs, &self.encoded, loss, &Device::flex()))
    }

    fn each(&self, formula: impl Fn(&Sample) -> Option<f64>) -> Vec<Option<f64>> {
        self.samples.iter().map(|sample| formula(sample)).collect()
    }
}

impl Estimator {
    /// All of them, in the order of tables, plots and columns.
    pub(crate) const ALL: [Self; 6] = [
        Self::PaperLstm,
        Self::InverseRange,
        Self::Triangulation,
        Self::MonoNetworkBox,
        Self::MonoNetwork,
        Self::MonoPinhole,
    ];

    /// Its name in files.
    pub(crate) fn name(self) -> &'static str {
        self.description().name
    }

    /// Its names and its method.
    pub(crate) fn description(self) -> Description {
        let [name, title, how] = match self {
            Self::PaperLstm => [
                "paper_lstm",
                "Calibration networks + LSTM",
                "the paper's networks; they see boxes only, but mixed training samples are computed with the cameras",
            ],
            Self::InverseRange => [
                "inverse_range",
                "Inverse range",
                "least squares on the places in all views, registered with each other; learned from labels, without the cameras",
            ],
            Self::Triangulation => [
                "triangulation",
                "Triangulation",
                "geometry with the known cameras; needs two views",
            ],
            Self::MonoNetworkBox => [
                "mono_network_box",
                "Monoscopic network, whole box",
                "each view by itself from place and size, averaged",
            ],
            Self::MonoNetwork => [
                "mono_network",
                "Monoscopic network, size",
                "each view by itself from width and height, averaged",
            ],
            Self::MonoPinhole => [
                "mono_pinhole",
                "Monoscopic pinhole",
                "each view by itself from width and span, averaged",
            ],
        };
        Description { name, title, how }
    }

    /// Distances to touchdown in the order of the samples, metres, all finite; `None` where it has no answer.
    pub(crate) fn predict(self, task: &Task) -> Vec<Option<f64>> {
        let answers = self.answers(task).into_iter();
        answers
            .map(|answer| answer.filter(|distance_m| distance_m.is_finite()))
            .collect()
    }

    fn answers(self, task: &Task) -> Vec<Option<f64>> {
        let (networks, baselines) = (&task.run.networks, &task.run.baselines);
        match self {
            Self::PaperLstm => task.metres(paper_lstm::predict(
                &networks.calibration,
                &networks.estimator,
                &task.encoded,
                task.run.config.loss,
                &Device::flex(),
            )),
            Self::InverseRange => task.each(|s| baselines.inverse_range.predict(s)),
            Self::MonoNetwork => task.mono(MonoInputs::Size),
            Self::MonoNetworkBox => task.mono(MonoInputs::Box),
            Self::MonoPinhole => task.each(|s| pinhole::predict(&baselines.pinholes, s)),
            Self::Triangulation => task.each(|sample| {
                let scenario = &task.scenarios[sample.scenario];
                triangulation::predict(
                    &baselines.centre_offsets,
                    &scenario.cameras,
                    sample,
                    scenario.touchdown,
                )
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_in_files() {
        assert_eq!(
            Estimator::ALL.map(Estimator::name),
            [
                "paper_lstm",
                "inverse_range",
                "triangulation",
                "mono_network_box",
                "mono_network",
                "mono_pinhole"
            ]
        );
    }
}
