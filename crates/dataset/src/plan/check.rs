//! Checks an untrusted `plan.json`: are its numbers possible, and its names valid file names?

use std::collections::BTreeSet;

use super::{Common, Plan, PlannedScenario};
use crate::corpus::scenario::traffic;
use crate::files::file_name;
use crate::numbers::limits::{self, Check};

/// The plan's first impossible value, as text.
pub(super) fn fault(plan: &Plan) -> Option<String> {
    let mut check = Check::default();
    check.part("common", |check| common(&plan.common, check));
    if let Some(fault) = check.first() {
        return Some(fault.to_string());
    }
    let views = plan.common.cameras.iter().map(|camera| &camera.id);
    if let Some(bad) = views.clone().find_map(|id| file_name::check(id).err()) {
        return Some(format!("camera {bad}"));
    }
    let count = plan.common.cameras.len();
    if count > limits::MAX_VIEWS || views.collect::<BTreeSet<_>>().len() != count {
        return Some(format!(
            "has {count} cameras, expected at most {} with different names",
            limits::MAX_VIEWS
        ));
    }
    let mut ids = BTreeSet::new();
    plan.scenarios.iter().find_map(|scenario| {
        let id = &scenario.id;
        if let Err(bad) = file_name::check_id(id) {
            Some(format!("scenario {bad}"))
        } else if scenario.parameters.aircraft(&plan.common).is_empty() {
            Some(format!(
                "scenario {id} names no aircraft, and neither does `common`"
            ))
        } else if let Some(fault) = traffic::fault(&scenario.parameters.traffic) {
            Some(format!("scenario {id} {fault}"))
        } else if !ids.insert(id) {
            Some(format!("has two scenarios {id}"))
        } else if !scenario.is_named_after_its_conditions() {
            let PlannedScenario {
                time_of_day,
                weather,
                ..
            } = scenario;
            Some(format!(
                "scenario {id}: its time is {time_of_day:?} and its weather {weather:?}, expected those of its name"
            ))
        } else {
            let mut check = Check::default();
            scenario.check(&mut check);
            let fault = check.first()?;
            Some(format!("scenario {id}: {fault}"))
        }
    })
}

fn common(common: &Common, check: &mut Check) {
    check.part("runway", |check| common.runway.check(check));
    check.part("picture", |check| common.picture.check(check));
    for camera in &common.cameras {
        check.part(format_args!("cameras.{}", camera.id), |check| {
            camera.check(check);
        });
    }
}
