//! List of all estimators: names, descriptions for reports, and answers.
//!
//! For a new estimator, add a variant: compiler errors then show all missing parts of this file. [`crate::training`] fits its numbers and
//! [`crate::run::trained`] stores them. Estimators get whole flights of observations, without the truth, and return a distance or no
//! answer per tick. Views are removed from the observations beforehand.

use burn::tensor::Device;
use onnx_graph::proto::ModelProto;
use serde::Serialize;

use crate::config::TARGET_UNIT_M;
use crate::estimators::geometry::triangulation;
use crate::estimators::inverse_range::flight_filter::{Estimate, Knowing};
use crate::estimators::mono_network::MonoInputs;
use crate::estimators::mono_pinhole;
use crate::estimators::paper_lstm;
use crate::networks::encoded::Encoded;
use crate::networks::estimator_graph::EstimatorGraph;
use crate::run::trained::TrainedRun;
use crate::samples::{Observation, ScenarioSummary};

/// Declares the enum together with the complete list of variants.
macro_rules! estimators {
    ($($(#[$documented:meta])* $variant:ident,)*) => {
        /// Estimator of distance to touchdown.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub(crate) enum Estimator {
            $($(#[$documented])* $variant,)*
        }

        impl Estimator {
            /// Estimators in the order of tables, plots and columns.
            pub(crate) const ALL: [Self; [$(stringify!($variant)),*].len()] = [$(Self::$variant),*];
        }
    };
}

estimators! {
    /// Calibration networks, then an LSTM over the views.
    PaperLstm,
    /// Least squares of the inverse range.
    InverseRange,
    /// Kalman filter over the previous ticks.
    InverseRangeFiltered,
    /// Smoother over the whole flight.
    InverseRangeSmoothed,
    /// The point that cameras agree on that were fitted to the training flights.
    SelfCalibrated,
    /// The point nearest to the rays through the boxes.
    Triangulation,
    /// A network per view that sees the whole box.
    MonoNetworkBox,
    /// A network per view that sees the box's centre.
    MonoNetworkPosition,
    /// A network per view that sees the box's size.
    MonoNetwork,
    /// A formula per view.
    MonoPinhole,
    /// The mean distance of the training flights by time.
    NoVisionTime,
    /// The mean distance of the training flights by time and weather.
    NoVisionTimeWeather,
}

/// Role in comparisons.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Standing {
    /// Ranked.
    Competitor,
    /// Uses information that no installation has: compared, but never ranked.
    Oracle,
    /// Sees no image: a lower bound for the others, never ranked.
    NoVision,
}

/// Names and description for reports.
pub(crate) struct Description {
    /// Name in `metrics.json` and, followed by `_dtd_m`, in `predictions.parquet`.
    pub(crate) name: &'static str,
    /// Title in the report.
    pub(crate) title: &'static str,
    /// Method, a line.
    pub(crate) how: &'static str,
}

/// Answers from one estimator, tick by tick.
pub(crate) struct Answered {
    /// Finite distances, metres.
    pub distances_m: Vec<Option<f64>>,
    /// Full estimates; `None` for an estimator with distances only.
    pub estimates: Option<Vec<Option<Estimate>>>,
}

impl Answered {
    pub(crate) fn of_estimates(estimates: Vec<Option<Estimate>>) -> Self {
        let distance_m = |estimate: &Option<Estimate>| Some(estimate.as_ref()?.distance_m.value);
        Self {
            distances_m: estimates.iter().map(distance_m).collect(),
            estimates: Some(estimates),
        }
    }
}

/// Flights to estimate, and the run.
pub(crate) struct Task<'a> {
    run: &'a TrainedRun,
    scenarios: &'a [ScenarioSummary],
    observations: &'a [Observation],
    encoded: Encoded,
}

impl<'a> Task<'a> {
    /// Observations refer to `scenarios`. They are whole flights, one after the other: every tick in the order of time, including ticks
    /// without detections.
    pub(crate) fn new(
        run: &'a TrainedRun,
        scenarios: &'a [ScenarioSummary],
        observations: &'a [Observation],
    ) -> Self {
        Self {
            run,
            scenarios,
            observations,
            encoded: Encoded::of_observations(observations, &run.normalisation),
        }
    }

    /// Network answers in metres. Networks return a number even without any box; those are dropped.
    fn metres(&self, units: Vec<f32>) -> Vec<Option<f64>> {
        let metres = |(unit, observed): (f32, &Observation)| {
            (observed.detections() > 0).then(|| f64::from(unit) * TARGET_UNIT_M)
        };
        let answers = units.into_iter().zip(self.observations);
        answers.map(metres).collect()
    }

    fn mono(&self, inputs: MonoInputs) -> Vec<Option<f64>> {
        let networks = match inputs {
            MonoInputs::Size => &self.run.networks.mono_size,
            MonoInputs::Position => &self.run.networks.mono_position,
            MonoInputs::Box => &self.run.networks.mono_box,
        };
        let loss = self.run.config.target();
        self.metres(networks.predict(inputs, &self.encoded, loss, &Device::flex()))
    }

    fn filtered(&self, knowing: Knowing) -> Answered {
        let baselines = &self.run.baselines;
        let (filter, fits) = (&baselines.flight_filter, &baselines.inverse_range);
        let flights = self.observations.chunk_by(|a, b| a.scenario == b.scenario);
        let estimates = flights.flat_map(|flight| filter.predict(fits, flight, knowing));
        Answered::of_estimates(estimates.collect())
    }

    /// Applies a formula tick by tick.
    fn each(&self, formula: impl Fn(&Observation) -> Option<f64>) -> Vec<Option<f64>> {
        self.observations.iter().map(formula).collect()
    }
}

impl Estimator {
    pub(crate) fn name(self) -> &'static str {
        self.description().name
    }

    pub(crate) fn standing(self) -> Standing {
        match self {
            Self::Triangulation => Standing::Oracle,
            Self::NoVisionTime | Self::NoVisionTimeWeather => Standing::NoVision,
            _ => Standing::Competitor,
        }
    }

    /// True if live answers are possible: without later ticks, runway, weather or the scenario's start.
    pub(crate) fn is_online(self) -> bool {
        matches!(
            self,
            Self::PaperLstm
                | Self::InverseRange
                | Self::InverseRangeFiltered
                | Self::MonoNetworkBox
                | Self::MonoNetworkPosition
                | Self::MonoNetwork
                | Self::MonoPinhole
        )
    }

    pub(crate) fn description(self) -> Description {
        let [name, title, how] = match self {
            Self::PaperLstm => [
                "paper_lstm",
                "Calibration networks + LSTM",
                "calibration networks and an LSTM over the views; learned from boxes and labels",
            ],
            Self::InverseRange => [
                "inverse_range",
                "Inverse range",
                "least squares on the places in all views, registered with each other; learned from labels, without the places of the cameras",
            ],
            Self::InverseRangeFiltered => [
                "inverse_range_filtered",
                "Inverse range, filtered",
                "a Kalman filter over the ticks so far; views may be missing",
            ],
            Self::InverseRangeSmoothed => [
                "inverse_range_smoothed",
                "Inverse range, smoothed",
                "the filter and back again, so that later ticks count as well; not possible while the aircraft flies",
            ],
            Self::SelfCalibrated => [
                "self_calibrated",
                "Self-calibrated triangulation",
                "geometry with cameras fitted to the training flights, from the rig as planned; needs two views",
            ],
            Self::Triangulation => [
                "triangulation",
                "Triangulation (oracle)",
                "geometry with the true cameras of each scenario, which no other estimator gets; needs two views",
            ],
            Self::MonoNetworkBox => [
                "mono_network_box",
                "Monoscopic network, whole box",
                "each view by itself from place and size, averaged",
            ],
            Self::MonoNetworkPosition => [
                "mono_network_position",
                "Monoscopic network, position",
                "each view by itself from the place of the box, averaged",
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
            Self::NoVisionTime => [
                "no_vision_time",
                "No vision: time",
                "no image at all: the mean distance of the training flights at the same time since the start",
            ],
            Self::NoVisionTimeWeather => [
                "no_vision_time_weather",
                "No vision: time and weather",
                "no image at all: the same mean over the training flights in the same weather",
            ],
        };
        Description { name, title, how }
    }

    /// ONNX model, which takes boxes in pixels; `None` if cameras, time, or earlier ticks are needed.
    pub(crate) fn to_onnx(self, run: &TrainedRun) -> Option<ModelProto> {
        let (networks, baselines, loss) = (&run.networks, &run.baselines, run.config.target());
        let graph = &mut EstimatorGraph::new(&run.normalisation);
        let metres = match self {
            Self::PaperLstm => networks
                .estimator
                .to_onnx(&networks.calibration, loss, graph),
            // It would answer nothing.
            Self::InverseRange if baselines.inverse_range.is_empty() => return None,
            Self::InverseRange => baselines.inverse_range.to_onnx(graph),
            Self::MonoNetwork => networks.mono_size.to_onnx(MonoInputs::Size, loss, graph),
            Self::MonoNetworkBox => networks.mono_box.to_onnx(MonoInputs::Box, loss, graph),
            Self::MonoNetworkPosition => {
                (networks.mono_position).to_onnx(MonoInputs::Position, loss, graph)
            }
            Self::MonoPinhole => mono_pinhole::to_onnx(&baselines.pinholes, graph),
            _ => return None,
        };
        Some(graph.model(&metres, self.name()))
    }

    /// Answers in the order of the observations.
    pub(crate) fn answers(self, task: &Task) -> Answered {
        let (networks, baselines) = (&task.run.networks, &task.run.baselines);
        let distances_m = match self {
            Self::PaperLstm => task.metres(paper_lstm::predict(
                &networks.calibration,
                &networks.estimator,
                &task.encoded,
                task.run.config.target(),
                &Device::flex(),
            )),
            Self::InverseRange => task.each(|s| baselines.inverse_range.predict(s)),
            Self::InverseRangeFiltered => return task.filtered(Knowing::Past),
            Self::InverseRangeSmoothed => return task.filtered(Knowing::All),
            Self::SelfCalibrated => match &baselines.self_calibrated {
                None => vec![None; task.observations.len()],
                Some(fitted) => {
                    let locator = fitted.locator();
                    task.each(|s| locator.distance_m(s, &task.scenarios[s.scenario]))
                }
            },
            Self::MonoNetwork => task.mono(MonoInputs::Size),
            Self::MonoNetworkPosition => task.mono(MonoInputs::Position),
            Self::MonoNetworkBox => task.mono(MonoInputs::Box),
            Self::MonoPinhole => task.each(|s| mono_pinhole::predict(&baselines.pinholes, s)),
            Self::NoVisionTime => task.each(|s| baselines.mean_by_time.at(s)),
            Self::NoVisionTimeWeather => task.each(|observed| {
                let weather = &task.scenarios[observed.scenario].weather;
                baselines.mean_by_time.at_in(observed, weather)
            }),
            Self::Triangulation => task.each(|observed| {
                let scenario = &task.scenarios[observed.scenario];
                triangulation::predict(
                    &baselines.centre_offsets,
                    &scenario.cameras,
                    observed,
                    scenario.touchdown,
                )
            }),
        };
        let finite = |distance_m: Option<f64>| distance_m.filter(|m| m.is_finite());
        Answered {
            distances_m: distances_m.into_iter().map(finite).collect(),
            estimates: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_answers_live_is_neither_an_oracle_nor_without_vision() {
        for estimator in Estimator::ALL.into_iter().filter(|of| of.is_online()) {
            assert_eq!(estimator.standing(), Standing::Competitor, "{estimator:?}");
        }
    }

    #[test]
    fn names_are_those_in_files() {
        assert_eq!(
            Estimator::ALL.map(Estimator::name),
            [
                "paper_lstm",
                "inverse_range",
                "inverse_range_filtered",
                "inverse_range_smoothed",
                "self_calibrated",
                "triangulation",
                "mono_network_box",
                "mono_network_position",
                "mono_network",
                "mono_pinhole",
                "no_vision_time",
                "no_vision_time_weather"
            ]
        );
    }
}
