//! The files of the whole corpus: the plan, the split, and stray entries among the scenarios.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use serde_json::Value;

use super::planned_cameras::{PlannedCameras, unreadable};
use super::{Faults, VerifyOptions};
use crate::calibration::Calibration;
use crate::corpus::{Corpus, PARTIAL_SUFFIX, ScenarioFolder};
use crate::json_file::read_json;
use crate::scenario::ScenarioRecord;
use crate::seal;
use crate::splits::Splits;

const PLAN: &str = "plan.json";
const SPLITS: &str = "splits.json";
const RECORD: &str = "scenario.json";

/// What was read of the scenarios.
pub(super) struct Found<'a> {
    pub(super) scenarios: &'a [ScenarioFolder],
    pub(super) records: &'a BTreeMap<String, ScenarioRecord>,
    pub(super) calibrations: &'a BTreeMap<String, Calibration>,
}

/// Checks the corpus's own files; returns the planned scenarios that are missing.
pub(super) fn check(
    corpus: &Corpus,
    found: &Found<'_>,
    options: VerifyOptions,
    faults: &mut Faults,
) -> Vec<String> {
    let plan = faults.keep(PLAN, read_json::<Value>(&corpus.plan_path(), "plan"));
    let missing = plan.map_or_else(Vec::new, |plan| {
        let planned = Planned::of(&plan, faults);
        planned.check(found, faults);
        planned.missing(found.scenarios)
    });
    if options.complete {
        for id in &missing {
            faults.of(id, PLAN, "is planned, but not in the corpus");
        }
    }
    check_splits(corpus, found.records, faults);
    check_strangers(corpus, found.scenarios, faults);
    missing
}

/// The plan: what every scenario should be.
struct Planned<'a> {
    /// What all scenarios have in common; null in plans of version 1, where every scenario has it in its own parameters.
    common: &'a Value,
    scenarios: BTreeMap<&'a str, &'a Value>,
}

impl<'a> Planned<'a> {
    fn of(plan: &'a Value, faults: &mut Faults) -> Self {
        let scenarios = || plan["scenarios"].as_array().into_iter().flatten();
        let text = |scenario: &'a Value, key: &str| scenario[key].as_str();
        let mut hasher = blake3::Hasher::new();
        for scenario in scenarios() {
            let id = text(scenario, "id").unwrap_or_default();
            let config_hash = text(scenario, "config_hash").unwrap_or_default();
            hasher.update(format!("{id} {config_hash}\n").as_bytes());
        }
        let again = hasher.finalize().to_string();
        if plan["plan_hash"] != again.as_str() {
            faults.file(
                PLAN,
                format!(
                    "plan_hash is {}, its scenarios give {again}",
                    plan["plan_hash"]
                ),
            );
        }
        Self {
            common: &plan["common"],
            scenarios: scenarios()
                .filter_map(|scenario| Some((text(scenario, "id")?, scenario)))
                .collect(),
        }
    }

    fn missing(&self, scenarios: &[ScenarioFolder]) -> Vec<String> {
        let there: BTreeSet<String> = scenarios.iter().map(ScenarioFolder::id).collect();
        self.scenarios
            .keys()
            .filter(|id| !there.contains(**id))
            .map(|id| (*id).to_owned())
            .collect()
    }

    /// Every scenario matches its plan.
    fn check(&self, found: &Found<'_>, faults: &mut Faults) {
        for (id, record) in found.records {
            let Some(scenario) = self.scenarios.get(id.as_str()) else {
                faults.of(id, PLAN, "is in the corpus, but not in the plan");
                continue;
            };
            let Ok(mut recorded) = serde_json::to_value(record) else {
                continue;
            };
            // The plan has it in readable form.
            recorded["frame_rate"] = record.frame_rate.to_string().into();
            let parameters = &scenario["parameters"];
            let shared = |key: &str| self.common.get(key).unwrap_or(&parameters[key]);
            let views: Vec<&Value> = shared("cameras")
                .as_array()
                .into_iter()
                .flatten()
                .map(|camera| &camera["id"])
                .collect();
            let views = serde_json::json!(views);
            let decided = [
                ("config_hash", &scenario["config_hash"]),
                ("seed", &scenario["seed"]),
                ("trajectory", &scenario["trajectory"]),
                ("conditions", &parameters["conditions"]),
                ("aircraft", shared("aircraft")),
                ("runway", shared("runway")),
                ("flight", &parameters["flight"]),
                ("rig", shared("rig")),
                ("frame_rate", &shared("picture")["frame_rate"]),
                ("views", &views),
            ];
            for (what, planned) in decided {
                let found = &recorded[what];
                if planned != found {
                    faults.of(
                        id,
                        RECORD,
                        format!(
                            "{what} was planned as {planned} (plan.json), but recorded as {found}"
                        ),
                    );
                }
            }
            if let Some(calibration) = found.calibrations.get(id) {
                match PlannedCameras::read(shared, parameters) {
                    Ok(cameras) => cameras.check(id, calibration, faults),
                    Err(message) => unreadable(id, &message, faults),
                }
            }
        }
    }
}

/// No trajectory is on two sides, and every scenario is on the side of the trajectory that it actually flew.
fn check_splits(corpus: &Corpus, records: &BTreeMap<String, ScenarioRecord>, faults: &mut Faults) {
    let Some(splits) = faults.keep(SPLITS, Splits::read(&corpus.splits_path())) else {
        return;
    };
    let mut sides = BTreeMap::new();
    for (id, record) in records {
        let Some(assignment) = splits.scenarios.get(id) else {
            faults.of(id, SPLITS, "the scenario is on no side");
            continue;
        };
        if assignment.trajectory != record.trajectory {
            let (found, expected) = (&assignment.trajectory, &record.trajectory);
            faults.of(
                id,
                SPLITS,
                format!("the scenario is listed with trajectory {found}, but flew {expected}"),
            );
        }
        let (first, side) = *sides
            .entry(&record.trajectory)
            .or_insert((id, assignment.side));
        if side != assignment.side {
            let trajectory = &record.trajectory;
            faults.of(
                id,
                SPLITS,
                format!(
                    "leak: trajectory {trajectory} is flown by {first} ({side:?}) and by {id} ({:?})",
                    assignment.side
                ),
            );
        }
    }
}

/// Folders among the scenarios that are neither complete nor marked as unfinished.
fn check_strangers(corpus: &Corpus, scenarios: &[ScenarioFolder], faults: &mut Faults) {
    let Ok(entries) = fs::read_dir(corpus.root().join("scenarios")) else {
        return;
    };
    for entry in entries.flatten() {
        let path = entry.path();
        let name = entry.file_name().to_string_lossy().into_owned();
        if entry.file_name().to_str().is_none() {
            faults.of(
                &name,
                "scenarios",
                "is a name that is not UTF-8, so no verb sees it; rename it or move it away",
            );
            continue;
        }
        let known = scenarios.iter().any(|folder| folder.root() == path)
            // Committed by another run since the scenarios were listed.
            || matches!(seal::read_seal(&path), Ok(Some(_)));
        if !known && !name.ends_with(PARTIAL_SUFFIX) {
            faults.of(
                &name,
                seal::DONE,
                "is missing: the scenario is not complete",
            );
        }
    }
}
