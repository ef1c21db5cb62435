//! Fingerprint of everything in a run except a single view: settings, shared numbers, and the networks, formulas and cameras of all other
//! views.

use burn::store::ModuleSnapshot;
use serde_json::{Value, json};

use crate::run::trained::TrainedRun;

/// BLAKE3 over the numbers of `run` that do not belong to `view`.
pub(super) fn fingerprint(run: &TrainedRun, view: usize) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(others(run, view).to_string().as_bytes());
    let of_view = format!("calibration.views.{view}.");
    let mut tensors = run.networks.collect(None, None, false);
    tensors.retain(|tensor| !tensor.name.starts_with(&of_view));
    tensors.sort_by(|one, other| one.name.cmp(&other.name));
    for tensor in tensors {
        let bytes = tensor.to_bytes().expect("weights in memory have bytes");
        hasher.update(tensor.name.as_bytes());
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(&bytes);
    }
    hasher.finalize().to_string()
}

/// Settings and formulas, except those for the view.
fn others(run: &TrainedRun, view: usize) -> Value {
    let baselines = &run.baselines;
    let normalisation = &run.normalisation;
    json!({
        "config": run.config,
        "convergence": run.convergence,
        "views": baselines.views,
        "offset_px": without(view, &normalisation.offset_px),
        "scale_px": without(view, &normalisation.scale_px),
        "range_px": without(view, &normalisation.range_px),
        "pinholes": without(view, &baselines.pinholes),
        "centre_offsets": without(view, &baselines.centre_offsets),
        "inverse_range": baselines.inverse_range.without(view),
        "flight_filter": baselines.flight_filter.without(view, &baselines.inverse_range),
        "paired_views": baselines.paired_views.without(view),
        "mean_by_time": baselines.mean_by_time,
        "backgrounds": without(view, &baselines.backgrounds),
        "self_calibrated": baselines.self_calibrated.as_ref().map(|fitted| fitted.without(view)),
    })
}

fn without<T>(view: usize, of_views: &[T]) -> Vec<&T> {
    let others = of_views.iter().enumerate();
    others
        .filter(|(index, _)| *index != view)
        .map(|(_, of_view)| of_view)
        .collect()
}
