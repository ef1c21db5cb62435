//! Checks an untrusted `plan.json`: are its numbers possible, and its names valid file names?

use std::collections::BTreeSet;

use dataset::file_name;
use dataset::limits::{self, Check, FieldOutOfLimits};

use super::{Common, LiveStart, Parameters, Plan, PlannedScenario};

/// The first impossible value of a plan, as text.
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
    if count > limits::MOST_VIEWS || views.collect::<BTreeSet<_>>().len() != count {
        return Some(format!(
            "has {count} cameras, expected at most {} with different names",
            limits::MOST_VIEWS
        ));
    }
    let mut ids = BTreeSet::new();
    plan.scenarios.iter().find_map(|scenario| {
        let id = &scenario.id;
        if let Err(bad) = file_name::check_id(id) {
            Some(format!("scenario {bad}"))
        } else if !ids.insert(id) {
            Some(format!("has two scenarios {id}"))
        } else if !is_named_after(scenario) {
            let PlannedScenario {
                time_of_day,
                weather,
                ..
            } = scenario;
            Some(format!(
                "scenario {id}: its time is {time_of_day:?} and its weather {weather:?}, expected those of its name"
            ))
        } else {
            out_of_limits(scenario).map(|fault| format!("scenario {id}: {fault}"))
        }
    })
}

/// Whether the name starts with the time and the weather, as all names of scenarios do.
fn is_named_after(scenario: &PlannedScenario) -> bool {
    let digits = scenario.time_of_day.replace(':', "");
    let rest = scenario.id.strip_prefix(&digits);
    let rest = rest.and_then(|rest| rest.strip_prefix('-'));
    let rest = rest.and_then(|rest| rest.strip_prefix(&scenario.weather));
    rest.is_some_and(|rest| rest.starts_with('-'))
}

fn common(common: &Common, check: &mut Check) {
    check.part("runway", |check| common.runway.check(check));
    check.part("picture", |check| {
        let picture = common.picture;
        for (name, side_px) in [
            ("width_px", picture.width_px),
            ("height_px", picture.height_px),
        ] {
            check.number(name, side_px, limits::PICTURE_SIDE_PX);
        }
    });
    for camera in &common.cameras {
        check.part(format_args!("cameras.{}", camera.id), |check| {
            camera.mast().check(check);
        });
    }
}

fn out_of_limits(scenario: &PlannedScenario) -> Option<FieldOutOfLimits> {
    let Parameters {
        conditions,
        start_dtd_m,
        live,
        imaging,
        jitter,
        ..
    } = &scenario.parameters;
    let mut check = Check::default();
    check.number("ticks", scenario.ticks, limits::TICKS);
    check.part("conditions", |check| conditions.check(check));
    check.number("start_dtd_m", *start_dtd_m, limits::START_DTD_M);
    if let Some(live) = live {
        check.part("live", |check| check_live(live, check));
    }
    for (camera, imaging) in imaging {
        check.part(format_args!("imaging.{camera}"), |check| {
            imaging.check(check);
        });
    }
    for (camera, jitter) in jitter {
        check.part(format_args!("jitter.{camera}"), |check| jitter.check(check));
    }
    check.first()
}

fn check_live(live: &LiveStart, check: &mut Check) {
    for (name, value, limits) in [
        (
            "cross_track_m",
            live.cross_track_m,
            limits::START_CROSS_TRACK_M,
        ),
        (
            "above_profile_m",
            live.above_profile_m,
            limits::START_ABOVE_PROFILE_M,
        ),
        (
            "heading_offset_deg",
            live.heading_offset_deg,
            limits::START_HEADING_OFFSET_DEG,
        ),
        ("speed_mps", live.speed_mps, limits::START_SPEED_MPS),
        (
            "profile.start_altitude_msl_m",
            live.profile.start_altitude_msl_m(),
            limits::ALTITUDE_MSL_M,
        ),
    ] {
        check.number(name, value, limits);
    }
}
