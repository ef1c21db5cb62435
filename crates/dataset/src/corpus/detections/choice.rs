//! Choice among a corpus's detections.

use std::collections::BTreeMap;

use super::{models_of, named};
use crate::corpus::ScenarioFolder;
use crate::corpus::model_identity::NamedDetections;
use crate::error::Result;

/// Reasons why no detections were chosen. Lists name the available ones.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NoChoice {
    /// There are none at all.
    None,
    /// There are only detections of models other than the requested one.
    Others(String),
    /// Several are meant.
    Several(String),
}

/// The requested detections, by the model's file name or by hash, or the only ones that there are.
///
/// # Errors
/// A folder cannot be read.
pub fn choose(
    folders: &[ScenarioFolder],
    asked: Option<&str>,
) -> Result<std::result::Result<NamedDetections, NoChoice>> {
    let mut found = BTreeMap::new();
    for folder in folders {
        for hash in models_of(folder)? {
            let detections = found
                .entry(hash)
                .or_insert_with_key(|hash| named(folder, hash));
            if detections.model.is_none() {
                // A different scenario's record may be undamaged.
                *detections = named(folder, &detections.hash);
            }
        }
    }
    let is_meant =
        |detections: &&NamedDetections| asked.is_none_or(|asked| detections.is_meant_by(asked));
    let meant: Vec<_> = found.values().filter(is_meant).collect();
    Ok(match meant.as_slice() {
        [one] => Ok((*one).clone()),
        [] if found.is_empty() => Err(NoChoice::None),
        [] => Err(NoChoice::Others(listed(found.values()))),
        several => Err(NoChoice::Several(listed(several.iter().copied()))),
    })
}

fn listed<'a>(detections: impl Iterator<Item = &'a NamedDetections>) -> String {
    let shown: Vec<_> = detections.map(ToString::to_string).collect();
    shown.join(", ")
}
