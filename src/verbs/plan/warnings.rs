//! Warnings about a sweep that can be recorded, but hardly as intended.

use std::collections::BTreeSet;

use dataset::plan::Plan;
use generator::plan::Outlook;
use generator::sweep::Sweep;

/// Warns of local times that the airport does not have, unused parts of the sweep, views that never have the
/// aircraft in sight, and flights that miss the runway.
pub(crate) fn warn(sweep: &Sweep, plan: &Plan, outlook: &Outlook) {
    let lines = unused(sweep, plan).into_iter();
    for line in lines
        .chain(outlook.hidden_aircraft())
        .chain(outlook.missed_runways())
    {
        eprint_warning!("{line}");
    }
}

fn unused(sweep: &Sweep, plan: &Plan) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(zone_h) = sweep
        .zone_offset_h
        .filter(|zone_h| *zone_h != sweep.utc_offset_h)
    {
        lines.push(format!(
            "local time is {} h ahead of UTC by utc_offset_h, and {zone_h} h by the time zone of {} on day {}; without utc_offset_h it is the \
             latter",
            sweep.utc_offset_h, sweep.runway.airport, sweep.day_of_year
        ));
    }
    let text: toml::Table = toml::from_str(&sweep.text).unwrap_or_default();
    let used: BTreeSet<&str> = plan.scenarios.iter().map(|s| s.weather.as_str()).collect();
    // By default, the grid has all weathers.
    let listed = text.get("grid").and_then(|grid| grid.get("weathers"));
    let is_in_grid = |weather: &str| {
        let listed = listed.and_then(toml::Value::as_array);
        listed.is_none_or(|listed| listed.iter().any(|name| name.as_str() == Some(weather)))
    };
    for weather in sweep.weathers.keys() {
        if !used.contains(weather.as_str()) {
            let why = if is_in_grid(weather) {
                "[[exclude]] omits every combination with it"
            } else {
                "name it in `weathers` of [grid]"
            };
            lines.push(format!("no scenario has the weather {weather:?}: {why}"));
        }
    }
    let defined = |kind: &str| {
        let table = text.get(kind).and_then(toml::Value::as_table);
        let names = table.into_iter().flat_map(toml::Table::keys);
        names.cloned().collect::<Vec<_>>()
    };
    let rigs = defined("rig").into_iter();
    for rig in rigs.filter(|rig| !rig.eq_ignore_ascii_case(&sweep.rig_name)) {
        let used = &sweep.rig_name;
        lines.push(format!(
            "the rig {rig:?} is not used: `rig` of [approach] is {used:?}"
        ));
    }
    let live = plan
        .scenarios
        .iter()
        .filter_map(|s| s.parameters.live.as_ref());
    let flown: BTreeSet<&str> = live.map(|live| live.profile_name.as_str()).collect();
    let profiles = defined("profile").into_iter();
    for profile in profiles.filter(|profile| !flown.contains(profile.as_str())) {
        lines.push(format!("no scenario flies the profile {profile:?}"));
    }
    lines
}
