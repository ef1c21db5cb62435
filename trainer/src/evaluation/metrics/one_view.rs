//! Figures for one view alone, and the gain from several views.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{ErrorFigures, EstimatorMetrics, Outcome, by_key, weather_and_time};
use crate::run::estimator::Estimator;

/// Figures for an estimator with one view: ticks that this view saw are answered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SingleViewFigures {
    /// All ticks.
    #[serde(flatten)]
    pub all: ErrorFigures,
    /// Figures by weather name.
    pub by_weather: BTreeMap<String, ErrorFigures>,
    /// Figures by local time.
    pub by_time: BTreeMap<String, ErrorFigures>,
    /// Figures by weather name and local time, separated by a space.
    pub by_weather_and_time: BTreeMap<String, ErrorFigures>,
}

impl SingleViewFigures {
    pub(crate) fn of(outcomes: &[Outcome]) -> Self {
        let by = |key: fn(&Outcome) -> String| -> BTreeMap<String, ErrorFigures> {
            let groups = by_key(outcomes, key).into_iter();
            groups
                .map(|(name, group)| (name, ErrorFigures::of(group)))
                .collect()
        };
        Self {
            all: ErrorFigures::of(outcomes),
            by_weather: by(|outcome| outcome.of.weather.to_owned()),
            by_time: by(|outcome| outcome.of.time_of_day.to_owned()),
            by_weather_and_time: by(weather_and_time),
        }
    }
}

/// A monoscopic network, and the gain of `paper_lstm` over it. As in the paper, each view is evaluated separately, and the errors of the
/// views are averaged, not their answers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AgainstOneView {
    /// Box features that the network uses.
    pub inputs: String,
    /// Name of the estimator.
    pub estimator: String,
    /// Mean absolute percentage error per view.
    pub mape_by_view_pct: BTreeMap<String, Option<f64>>,
    /// Mean over the views.
    pub mean_pct: Option<f64>,
    /// Reduction of this error by `paper_lstm`, over all ticks, percent.
    pub reduction_pct: Option<f64>,
}

impl AgainstOneView {
    /// Figures for each kind of input; empty if single views were not evaluated.
    pub(crate) fn all(estimators: &BTreeMap<String, EstimatorMetrics>) -> Vec<Self> {
        let several = estimators.get(Estimator::PaperLstm.name());
        let several_pct = several.and_then(|of| of.overall.all.mape_pct);
        let of = |(inputs, estimator): (&str, Estimator)| {
            let views = &estimators.get(estimator.name())?.single_views;
            let errors = || views.values().filter_map(|of| of.all.mape_pct);
            let count = errors().count();
            let mean_pct = (count > 0).then(|| errors().sum::<f64>() / count as f64);
            let reduction_pct = several_pct.zip(mean_pct);
            (!views.is_empty()).then(|| Self {
                inputs: inputs.to_owned(),
                estimator: estimator.name().to_owned(),
                mape_by_view_pct: (views.iter())
                    .map(|(view, of)| (view.clone(), of.all.mape_pct))
                    .collect(),
                mean_pct,
                reduction_pct: reduction_pct.map(|(several, one)| 100.0 * (1.0 - several / one)),
            })
        };
        let kinds = [
            ("size", Estimator::MonoNetwork),
            ("position", Estimator::MonoNetworkPosition),
            ("position and size", Estimator::MonoNetworkBox),
        ];
        kinds.into_iter().filter_map(of).collect()
    }
}
