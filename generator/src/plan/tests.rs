use std::collections::BTreeSet;
use std::path::Path;

use dataset::splits::Side;

use super::*;
use crate::recording;
use crate::sweep::Sweep;
use crate::sweep::tests::SMALL;

pub(crate) fn sweep_of(text: &str) -> Sweep {
    Sweep::parse(Path::new("sweep.toml"), Path::new("."), text.to_owned()).unwrap()
}

#[test]
fn the_same_sweep_gives_the_same_plan_and_another_seed_another() {
    let plan = expand(&sweep_of(SMALL));
    assert_eq!(plan, expand(&sweep_of(SMALL)));
    let other = expand(&sweep_of(&SMALL.replace("seed = 0", "seed = 1")));
    assert_ne!(plan.plan_hash, other.plan_hash);
    assert_ne!(
        plan.scenarios[0].parameters.start_dtd_m,
        other.scenarios[0].parameters.start_dtd_m
    );
}

#[test]
fn a_plan_does_not_change_from_version_to_version() {
    // Corpora in the field hold this hash. If it changes, they can no longer be finished.
    let plan = expand(&sweep_of(SMALL));
    assert_eq!(
        plan.plan_hash,
        "e22cfd15c20862d20c37fb846d883985b75274429dd8f466f09c6bf2281c00b7"
    );
}

#[test]
fn identifiers_name_number_time_weather_and_repeat() {
    let plan = expand(&sweep_of(SMALL));
    let ids: Vec<&str> = plan.scenarios.iter().map(|s| s.id.as_str()).collect();
    assert_eq!(
        ids[..3],
        [
            "0001-0600-clear-r1",
            "0002-0600-foggy-r1",
            "0003-1200-clear-r1"
        ]
    );
    assert_eq!(ids[7], "0008-1200-foggy-r2");
    let seeds: BTreeSet<u64> = plan.scenarios.iter().map(|s| s.seed).collect();
    assert_eq!(seeds.len(), 8);
}

#[test]
fn a_plan_read_back_is_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plan.json");
    let plan = expand(&sweep_of(SMALL));
    plan.write(&path).unwrap();
    assert_eq!(Plan::read(&path).unwrap(), plan);
}

#[test]
fn more_repeats_only_add_and_other_changes_are_named() {
    let plan = expand(&sweep_of(SMALL));
    let longer = expand(&sweep_of(&SMALL.replace("repeats = 2", "repeats = 3")));
    assert_eq!(longer.conflict_with(&plan), None);
    assert!(
        plan.conflict_with(&longer)
            .unwrap()
            .contains("0009-0600-clear-r3 is no longer in the sweep")
    );
    let wider = expand(&sweep_of(&SMALL.replace("width_px = 96", "width_px = 128")));
    let message = wider.conflict_with(&plan).unwrap();
    assert!(
        message.contains("parameters.picture.width_px was 96, now is 128")
            && message.contains("5 more"),
        "{message}"
    );
}

fn with_recordings(folder: &Path) -> Sweep {
    for name in ["a.csv", "b.csv"] {
        recording::tests::write_example(
            &folder.join(name),
            if name == "a.csv" { 3_030.0 } else { 2_500.0 },
        );
    }
    let rule = "\n[[recorded]]\nfiles = \"*.csv\"\nweathers = [\"foggy\"]\n";
    Sweep::parse(&folder.join("sweep.toml"), folder, format!("{SMALL}{rule}")).unwrap()
}

#[test]
fn recordings_are_flown_in_turn_where_the_rule_fits() {
    let folder = tempfile::tempdir().unwrap();
    let plan = expand(&with_recordings(folder.path()));
    let flights: Vec<&str> = plan.scenarios.iter().map(|s| s.flight.as_str()).collect();
    assert_eq!(
        flights,
        [
            "live", "a.csv", "live", "b.csv", "live", "a.csv", "live", "b.csv"
        ]
    );
    assert_eq!(plan.scenarios[1].trajectory, plan.scenarios[5].trajectory);
    assert!(plan.scenarios[1].parameters.live.is_none());
    // 3,030 m at 75 m/s are 40.4 s: tick 0, 20 ticks of two seconds, and the first one past the target.
    assert_eq!(plan.scenarios[1].ticks, 22);
}

#[test]
fn a_recording_is_on_one_side_only_and_every_side_has_something() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = with_recordings(folder.path());
    let plan = expand(&sweep);
    let splits = assign_sides(&plan, &sweep.split, 0, None).unwrap();
    for side in [Side::Train, Side::Validation, Side::Test] {
        assert!(
            splits.side(side).count() > 0,
            "{side:?} is empty: {splits:?}"
        );
    }
    assert_eq!(splits.leak(), None);
}

#[test]
fn the_test_side_holds_its_part_and_all_weathers_and_times() {
    let twelve = SMALL
        .replace(
            "[\"06:00\", \"12:00\"]",
            "[\"06:00\", \"12:00\", \"18:00\"]",
        )
        .replace(
            "[\"clear\", \"foggy\"]",
            "[\"clear\", \"foggy\", \"grey\", \"wet\"]",
        )
        .replace("repeats = 2", "repeats = 1")
        + "\n[weather.grey]\nvisibility_m = 20000\n[weather.wet]\nvisibility_m = 20000\nrain_ratio = 0.5\n";
    for seed in 0..20 {
        let sweep = sweep_of(&twelve.replace("seed = 0", &format!("seed = {seed}")));
        let plan = expand(&sweep);
        let splits = assign_sides(&plan, &sweep.split, seed, None).unwrap();
        let test: Vec<&PlannedScenario> = plan
            .scenarios
            .iter()
            .filter(|s| splits.scenarios[&s.id].side == Side::Test)
            .collect();
        assert_eq!(test.len(), 4);
        assert_eq!(
            test.iter()
                .map(|s| &s.weather)
                .collect::<BTreeSet<_>>()
                .len(),
            4,
            "seed {seed}"
        );
        assert_eq!(
            test.iter()
                .map(|s| &s.time_of_day)
                .collect::<BTreeSet<_>>()
                .len(),
            3,
            "seed {seed}"
        );
        assert_eq!(splits.side(Side::Validation).count(), 1);
    }
}

#[test]
fn what_was_held_out_stays_held_out_when_scenarios_are_added() {
    let sweep = sweep_of(SMALL);
    let before = assign_sides(&expand(&sweep), &sweep.split, 0, None).unwrap();
    let longer = sweep_of(&SMALL.replace("repeats = 2", "repeats = 5"));
    let after = assign_sides(&expand(&longer), &longer.split, 0, Some(&before)).unwrap();
    for (id, assignment) in &before.scenarios {
        assert_eq!(after.scenarios[id], *assignment);
    }
    assert_eq!(after.side(Side::Test).count(), 6);
}

#[test]
fn one_scenario_alone_is_no_error() {
    let one = SMALL
        .replace("[\"06:00\", \"12:00\"]", "[\"06:00\"]")
        .replace("[\"clear\", \"foggy\"]", "[\"clear\"]")
        .replace("repeats = 2", "repeats = 1");
    let sweep = sweep_of(&one);
    let splits = assign_sides(&expand(&sweep), &sweep.split, 0, None).unwrap();
    assert_eq!(splits.side(Side::Train).count(), 1);
}
