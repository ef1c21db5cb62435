//! `[[recorded]]`: scenarios that fly recordings instead of the simulator's own flight model.

use std::path::Path;

use dataset::geometry::runway::Runway;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::recording::{Allowed, Recording, RecordingError, matching_files};
use crate::seed;
use crate::sweep::check::fault::{Checked, fault};
use crate::sweep::grid::times::LocalDay;
use crate::sweep::grid::{Combination, Selection};

/// `[[recorded]]`: the first rule that matches a scenario applies; a rule without `times`, `weathers` and `repeats` matches
/// all.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordedRule {
    /// A CSV file, or a glob for several (`flights/*.csv`, `flights/**/*_ils.csv`); relative to the sweep. Repeats fly them in turn,
    /// starting with any.
    #[schemars(length(min = 1))]
    pub files: String,
    /// Times of matching scenarios.
    #[serde(default)]
    pub times: Vec<String>,
    /// Weathers of matching scenarios.
    #[serde(default)]
    pub weathers: Vec<String>,
    /// Repeats of matching scenarios, counted from 1.
    #[serde(default)]
    pub repeats: Vec<u32>,
    /// Flights that are no approach are rejected, except for these kinds.
    #[serde(default)]
    pub allow: Vec<Allowed>,
}

/// A rule of the sweep and the recordings that its pattern found, in the order of their names.
#[derive(Debug, Clone)]
pub struct RecordedFlights {
    /// The rule.
    pub rule: RecordedRule,
    /// The recordings; never empty.
    pub recordings: Vec<Recording>,
}

impl RecordedFlights {
    /// Indices of the recordings in flying order, for a condition's repeats. Every recording is flown once before one is flown twice; the
    /// order is shuffled for every condition, so it depends only on the condition, the seed and the recordings.
    pub(crate) fn order_for(&self, condition: &str, master_seed: u64) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.recordings.len()).collect();
        order.sort_by_cached_key(|index| {
            let item = format!("{condition}/{}", self.recordings[*index].blake3);
            seed::shuffle_key(master_seed, "recording", &item)
        });
        order
    }
}

/// Reads the recordings of all rules, and assigns each scenario its rule.
pub(crate) fn read(
    rules: Vec<RecordedRule>,
    combinations: &[Combination],
    folder: &Path,
    runway: &Runway,
    longest_nm: f64,
    day: &LocalDay,
) -> Checked<(Vec<RecordedFlights>, Vec<Option<usize>>)> {
    let mut rule_of = vec![None; combinations.len()];
    let mut all = Vec::with_capacity(rules.len());
    for (index, rule) in rules.into_iter().enumerate() {
        let key = |field: &str| format!("recorded.{index}.{field}");
        let scenarios = Selection {
            times: rule.times.clone(),
            weathers: rule.weathers.clone(),
            repeats: rule.repeats.clone(),
        };
        let matches = scenarios.matcher(combinations, day, key)?;
        let mut taken = 0;
        for (combination, rule) in combinations.iter().zip(&mut rule_of) {
            if rule.is_none() && matches(combination) {
                *rule = Some(index);
                taken += 1;
            }
        }
        if taken == 0 {
            return fault(
                format!("recorded.{index}"),
                "no scenario is left for this rule; the first rule that fits a scenario decides: put narrower rules first",
            );
        }
        let recordings = recordings(&rule, folder, runway, longest_nm)
            .or_else(|error| fault(key("files"), error.to_string()))?;
        all.push(RecordedFlights { rule, recordings });
    }
    Ok((all, rule_of))
}

fn recordings(
    rule: &RecordedRule,
    folder: &Path,
    runway: &Runway,
    longest_nm: f64,
) -> Result<Vec<Recording>, RecordingError> {
    let longest_m = longest_nm * METERS_PER_NAUTICAL_MILE;
    let files = matching_files(folder, &rule.files)?;
    files
        .iter()
        .map(|file| Recording::read(file, runway, longest_m, &rule.allow))
        .collect()
}
