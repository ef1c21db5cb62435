//! The gain from several views.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::EstimatorMetrics;
use crate::run::estimator::Estimator;

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
            let removed = estimators.get(estimator.name())?.views_removed.iter();
            let alone = removed.filter_map(|(removal, of)| {
                let view = removal.strip_prefix("only_")?;
                Some((view.to_owned(), of.all.mape_pct))
            });
            let mape_by_view_pct: BTreeMap<_, _> = alone.collect();
            let errors = || mape_by_view_pct.values().flatten();
            let count = errors().count();
            let mean_pct = (count > 0).then(|| errors().sum::<f64>() / count as f64);
            let reduction_pct = several_pct.zip(mean_pct);
            (!mape_by_view_pct.is_empty()).then(|| Self {
                inputs: inputs.to_owned(),
                estimator: estimator.name().to_owned(),
                mape_by_view_pct,
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
