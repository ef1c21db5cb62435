//! The files of the whole corpus: the plan, the split, and stray entries among the scenarios.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use serde::Serialize;
use serde_json::json;

use super::{VerifyOptions, VerifyReport, planned_cameras};
use crate::faults::Faults;
use dataset::corpus::calibration::Calibration;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::corpus::seal;
use dataset::corpus::splits::Splits;
use dataset::corpus::{Corpus, PARTIAL_SUFFIX, ScenarioFolder};
use dataset::plan::{Plan, PlannedScenario, plan_hash};

const PLAN: &str = Corpus::PLAN;
const SPLITS: &str = Corpus::SPLITS;
const RECORD: &str = "scenario.json";
const SCENARIOS: &str = "scenarios";

/// The scenarios, with the records and calibrations that could be read.
pub(super) struct ReadScenarios<'a> {
    pub(super) scenarios: &'a [ScenarioFolder],
    pub(super) records: &'a BTreeMap<String, ScenarioRecord>,
    pub(super) calibrations: &'a BTreeMap<String, Calibration>,
}

/// Checks the corpus's own files; adds the planned scenarios that are missing, and what could not be checked, to the report.
///
/// A corpus that was made elsewhere has neither plan nor sweep, and need not have a split. That is no fault: the report names the unchecked
/// items. A corpus with a plan or a sweep was generated, and so has all three.
pub(super) fn check(
    corpus: &Corpus,
    found: &ReadScenarios<'_>,
    options: VerifyOptions,
    report: &mut VerifyReport,
    faults: &mut Faults,
) {
    let is_imported = !corpus.plan_path().exists() && !corpus.sweep_path().exists();
    if is_imported && !options.complete {
        report.not_checked.push(format!(
            "whether the scenarios are complete and as planned: there is no {PLAN}"
        ));
    } else {
        let plan = faults.keep(PLAN, Plan::read(&corpus.plan_path()));
        report.missing = plan.map_or_else(Vec::new, |plan| check_plan(&plan, found, faults));
    }
    if options.complete {
        for id in &report.missing {
            faults.of(id, PLAN, "planned, but not in the corpus");
        }
    }
    if is_imported && !corpus.splits_path().exists() {
        report.not_checked.push(format!(
            "whether a trajectory is on two sides of the split: there is no {SPLITS}"
        ));
    } else {
        check_splits(corpus, found.records, faults);
    }
    check_strangers(corpus, found.scenarios, faults);
}

/// Checks the plan, and that every scenario matches it; returns the planned scenarios that are missing.
fn check_plan(plan: &Plan, found: &ReadScenarios<'_>, faults: &mut Faults) -> Vec<String> {
    let hashes = plan
        .scenarios
        .iter()
        .map(|scenario| (&*scenario.id, &*scenario.config_hash));
    let again = plan_hash(hashes);
    if plan.plan_hash != again {
        let message = format!(
            "plan_hash is {:?}, its scenarios give {again}",
            plan.plan_hash
        );
        faults.file(PLAN, message);
    }
    let planned: BTreeMap<&str, &PlannedScenario> = (plan.scenarios.iter())
        .map(|scenario| (&*scenario.id, scenario))
        .collect();
    for (id, record) in found.records {
        match planned.get(id.as_str()) {
            Some(scenario) => check_scenario(record, (plan, scenario), found, faults),
            None => faults.of(id, PLAN, "in the corpus, but not in the plan"),
        }
    }
    let there: BTreeSet<String> = found.scenarios.iter().map(ScenarioFolder::id).collect();
    let missing = planned.keys().filter(|id| !there.contains(**id));
    missing.map(|id| (*id).to_owned()).collect()
}

/// A scenario is as planned.
fn check_scenario(
    record: &ScenarioRecord,
    (plan, scenario): (&Plan, &PlannedScenario),
    found: &ReadScenarios<'_>,
    faults: &mut Faults,
) {
    let (id, common, parameters) = (&scenario.id, &plan.common, &scenario.parameters);
    let planned_aircraft = parameters.aircraft(common).to_owned();
    let frame_rates = [common.picture.frame_rate, record.frame_rate].map(|rate| rate.to_string());
    let views = (common.cameras.iter())
        .map(|camera| camera.id.clone())
        .collect();
    let differences = [
        other_than("config_hash", &scenario.config_hash, &record.config_hash),
        other_than("seed", &Some(scenario.seed), &record.seed),
        other_than("trajectory", &scenario.trajectory, &record.trajectory),
        other_than(
            "conditions",
            &Some(&parameters.conditions),
            &record.conditions.as_ref(),
        ),
        other_than("aircraft", &planned_aircraft, &record.aircraft),
        other_than("traffic", &parameters.traffic, &record.traffic),
        other_than("runway", &common.runway, &record.runway),
        other_than("flight", &parameters.flight, &record.flight),
        other_than("rig", &common.rig, &record.rig),
        other_than("frame_rate", &frame_rates[0], &frame_rates[1]),
        other_than("views", &views, &record.views),
    ];
    for difference in differences.into_iter().flatten() {
        faults.of(id, RECORD, difference);
    }
    if let Some(calibration) = found.calibrations.get(id) {
        planned_cameras::check(id, &parameters.cameras(common), calibration, faults);
    }
}

fn other_than<T: PartialEq + Serialize>(what: &str, planned: &T, recorded: &T) -> Option<String> {
    (planned != recorded).then(|| {
        format!(
            "{what} was planned as {} (plan.json), but recorded as {}",
            json!(planned),
            json!(recorded)
        )
    })
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
                    "leak: trajectory {trajectory} is flown by {first} ({side}) and by {id} ({})",
                    assignment.side
                ),
            );
        }
    }
}

/// Reports entries among the scenarios that are neither complete scenarios nor marked as unfinished.
fn check_strangers(corpus: &Corpus, scenarios: &[ScenarioFolder], faults: &mut Faults) {
    let Ok(entries) = fs::read_dir(corpus.root().join(SCENARIOS)) else {
        return;
    };
    for entry in entries.flatten() {
        let path = entry.path();
        let name = entry.file_name().to_string_lossy().into_owned();
        if entry.file_name().to_str().is_none() {
            faults.of(
                &name,
                SCENARIOS,
                "is a name that is not UTF-8, so no verb sees it; rename it or move it away",
            );
            continue;
        }
        let known = scenarios.iter().any(|folder| folder.root() == path)
            // Committed by a different run since the scenarios were listed.
            || matches!(seal::read_seal(&path), Ok(Some(_)));
        if known || name.ends_with(PARTIAL_SUFFIX) {
            continue;
        }
        if path.join(RECORD).exists() {
            faults.of(&name, seal::DONE, "missing: the scenario is not complete");
        } else {
            let file = format!("{SCENARIOS}/{name}");
            faults.file(&file, "not a scenario; move it out of the corpus");
        }
    }
}
