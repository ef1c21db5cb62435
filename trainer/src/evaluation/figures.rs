//! SVG charts from a run, for other pages than its report.

use crate::error::Result;
use crate::evaluation::metrics::Metrics;
use crate::evaluation::report::{plots, tables};
use crate::run::folder::RunFolder;
use crate::run::sealed::SealedRun;
use crate::run::trained::Convergence;

/// Errors in both training stages by step, for validation and, thinner, for batches.
///
/// # Errors
/// The run cannot be read.
pub fn convergence(run: &RunFolder) -> Result<String> {
    let sealed = SealedRun::read(run)?;
    let log: Convergence = sealed.json(RunFolder::CONVERGENCE, "convergence log")?;
    Ok(plots::convergence(&log))
}

/// Box plot of the signed errors of some estimators by distance, in the order of these names; unknown names are left out.
pub fn errors_by_distance(metrics: &Metrics, estimators: &[&str]) -> String {
    let names = tables::names(&metrics.estimators);
    let shown = estimators.iter().filter_map(|estimator| {
        let number = names.iter().position(|name| name == estimator)?;
        let bins = &metrics.estimators[*estimator].by_distance_nm[..];
        Some((number, bins))
    });
    plots::errors_by_distance(&shown.collect::<Vec<_>>())
}
