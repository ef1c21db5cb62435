//! Fingerprint of everything in a run except a single view: settings, shared numbers, and the networks, formulas and cameras of all other
//! views.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::Deserialize;
use serde_json::{Value, json};

use crate::error::{Error, Result, RunFault};
use crate::run::folder::RunFolder;
use crate::run::trained::TrainedRun;

/// Name of the metadata entry in Safetensors headers.
const METADATA: &str = "__metadata__";

#[derive(Deserialize)]
struct TensorEntry {
    data_offsets: [usize; 2],
}

/// BLAKE3 over the numbers of `run` that do not belong to `view`. Errors name `folder`.
pub(super) fn fingerprint(run: &TrainedRun, view: usize, folder: &RunFolder) -> Result<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(others(run, view).to_string().as_bytes());
    let weights = run.weights(folder)?;
    let of_view = format!("calibration.views.{view}.");
    let tensors = tensors(&weights)
        .ok_or_else(|| Error::run(&folder.weights_path(), RunFault::NotSafetensors))?;
    for (name, bytes) in tensors {
        if !name.starts_with(&of_view) {
            hasher.update(name.as_bytes());
            hasher.update(&(bytes.len() as u64).to_le_bytes());
            hasher.update(&weights[bytes]);
        }
    }
    Ok(hasher.finalize().to_string())
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

/// Byte ranges of the tensors in a Safetensors file, by name; `None` if the format is wrong.
fn tensors(file: &[u8]) -> Option<BTreeMap<String, Range<usize>>> {
    let length = u64::from_le_bytes(file.get(..8)?.try_into().ok()?);
    let data = 8_usize.checked_add(usize::try_from(length).ok()?)?;
    let header: BTreeMap<String, Value> = serde_json::from_slice(file.get(8..data)?).ok()?;
    let named = header.into_iter().filter(|(name, _)| name != METADATA);
    named
        .map(|(name, place)| {
            let TensorEntry {
                data_offsets: [from, to],
            } = serde_json::from_value(place).ok()?;
            let place = data.checked_add(from)?..data.checked_add(to)?;
            file.get(place.clone())?;
            Some((name, place))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tensors_are_found_behind_the_header_and_a_torn_file_has_none() {
        let header =
            br#"{"__metadata__":{"a":"b"},"w":{"dtype":"F32","shape":[1],"data_offsets":[0,4]}}"#;
        let mut file = (header.len() as u64).to_le_bytes().to_vec();
        file.extend_from_slice(header);
        file.extend_from_slice(&1.5_f32.to_le_bytes());
        let found = tensors(&file).unwrap();
        assert_eq!(found.keys().collect::<Vec<_>>(), ["w"]);
        assert_eq!(file[found["w"].clone()], 1.5_f32.to_le_bytes());
        for length in [3, 8, 40, file.len() - 1] {
            assert_eq!(tensors(&file[..length]), None);
        }
    }
}
