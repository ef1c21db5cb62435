//! The files that belong to the whole corpus: the plan, the split, and what lies among the scenarios.

use std::collections::BTreeMap;
use std::fs;

use serde_json::Value;

use super::Faults;
use crate::corpus::{Corpus, PARTIAL_SUFFIX, ScenarioFolder};
use crate::json_file::read_json;
use crate::scenario::ScenarioRecord;
use crate::splits::Splits;

const PLAN: &str = "plan.json";
const SPLITS: &str = "splits.json";

pub(super) fn check(
    corpus: &Corpus,
    scenarios: &[ScenarioFolder],
    records: &BTreeMap<String, ScenarioRecord>,
    faults: &mut Faults,
) {
    check_plan(corpus, records, faults);
    check_splits(corpus, records, faults);
    check_strangers(corpus, scenarios, faults);
}

/// Every scenario is as it was planned.
fn check_plan(corpus: &Corpus, records: &BTreeMap<String, ScenarioRecord>, faults: &mut Faults) {
    let Some(plan) = faults.keep(PLAN, read_json::<Value>(&corpus.plan_path(), "plan")) else {
        return;
    };
    let planned: BTreeMap<&str, &Value> = plan["scenarios"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|scenario| Some((scenario["id"].as_str()?, scenario)))
        .collect();
    for (id, record) in records {
        let Some(scenario) = planned.get(id.as_str()) else {
            faults.file(
                PLAN,
                format!("scenario {id} is in the corpus, but not in the plan"),
            );
            continue;
        };
        let decided = [
            (
                "config_hash",
                &scenario["config_hash"],
                Value::from(record.config_hash.as_str()),
            ),
            ("seed", &scenario["seed"], Value::from(record.seed)),
            (
                "trajectory",
                &scenario["trajectory"],
                Value::from(record.trajectory.as_str()),
            ),
            (
                "conditions",
                &scenario["parameters"]["conditions"],
                serde_json::to_value(&record.conditions).unwrap_or_default(),
            ),
        ];
        for (what, planned, recorded) in decided {
            if *planned != recorded {
                faults.file(
                    PLAN,
                    format!(
                        "scenario {id}: {what} was planned as {planned}, but recorded as {recorded}"
                    ),
                );
            }
        }
    }
}

/// No trajectory is on two sides, and every scenario is on the side of the trajectory that it really flew.
fn check_splits(corpus: &Corpus, records: &BTreeMap<String, ScenarioRecord>, faults: &mut Faults) {
    let Some(splits) = faults.keep(SPLITS, Splits::read(&corpus.splits_path())) else {
        return;
    };
    let mut sides = BTreeMap::new();
    for (id, record) in records {
        let Some(assignment) = splits.scenarios.get(id) else {
            faults.file(SPLITS, format!("scenario {id} is on no side"));
            continue;
        };
        if assignment.trajectory != record.trajectory {
            let (found, expected) = (&assignment.trajectory, &record.trajectory);
            faults.file(
                SPLITS,
                format!("scenario {id} is listed with trajectory {found}, but flew {expected}"),
            );
        }
        let (first, side) = *sides
            .entry(&record.trajectory)
            .or_insert((id, assignment.side));
        if side != assignment.side {
            let trajectory = &record.trajectory;
            faults.file(
                SPLITS,
                format!(
                    "leak: trajectory {trajectory} is flown by {first} ({side:?}) and by {id} ({:?})",
                    assignment.side
                ),
            );
        }
    }
}

/// Folders among the scenarios that are neither whole nor marked as unfinished.
fn check_strangers(corpus: &Corpus, scenarios: &[ScenarioFolder], faults: &mut Faults) {
    let Ok(entries) = fs::read_dir(corpus.root().join("scenarios")) else {
        return;
    };
    for entry in entries.flatten() {
        let path = entry.path();
        let name = entry.file_name().to_string_lossy().into_owned();
        let known = scenarios.iter().any(|folder| folder.root() == path);
        if !known && !name.ends_with(PARTIAL_SUFFIX) {
            faults.file(
                &format!("scenarios/{name}"),
                "is no whole scenario: it has no seal (DONE.json)",
            );
        }
    }
}
