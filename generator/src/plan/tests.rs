use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use dataset::corpus::splits::Side;
use dataset::plan::{Aim, Common, Difference, Parameters, Plan, PlannedScenario};
use dataset::video::{VideoCodec, VideoSettings};
use serde_json::json;
use xplane_bridge::profile::Profile;

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

/// Every kind of spread, a range of times, profiles to draw from, an exclusion and an inclusion.
fn rich() -> String {
    let rules = "\n[[exclude]]\ntimes = [\"06:00\"]\nweathers = [\"foggy\"]\n\n[[include]]\ntimes = [\"20:00\"]\n";
    SMALL
        .replace("[\"06:00\", \"12:00\"]", "[{ from = \"06:00\", to = \"12:00\", every_min = 120 }]")
        .replace("repeats = 2", "repeats = 3")
        .replace(
            "[start]",
            "[start]\nprofiles = [\"step-down\", \"continuous\"]\ncross_track_m = { mean = 0, sd = 40 }\nabove_profile_m = { mean = 0, sd = 15, min = -20, max = 30 }\nheading_offset_deg = { min = -1, max = 1 }\nspeed_mps = { one_of = [78, 80.5, 82] }",
        )
        .replace("visibility_m = 9260", "visibility_m = { min = 3000, max = 9260 }")
        + rules
}

/// Air and sensor before there were presets.
const IMAGED: &str = r"
[imaging]
refraction_coefficient = { min = 0.1, max = 0.16 }
blur_sigma_px = { min = 0.5, max = 0.9 }
[imaging.sensor]
full_well_electrons = { min = 5000, max = 10000 }
read_noise_electrons = 4
[imaging.seeing]
tilt_rms_arcsec = { min = 2, max = 15 }
blur_sigma_arcsec = 5
";

#[test]
fn a_plan_does_not_change_from_version_to_version_or_machine_to_machine() {
    // Existing corpora contain these hashes. If they change, those can no longer be extended.
    for (text, plan_hash) in [
        (
            SMALL.to_owned(),
            "0b46626f31ce4188da96d7f32603d2a958e8c6f6809d0a677510b740130f5024",
        ),
        (
            rich(),
            "76ae0bb1790a769f3b4a57674d2a2ff00679e702740e97b17f0fe374369ee2f8",
        ),
        (
            SMALL.to_owned() + IMAGED,
            "a6e371ef5dd9b03597223339d469a6232c57f7a83234b73c50fa547e347095bb",
        ),
        (
            SMALL.to_owned() + "\n[imaging.seeing]\n",
            "566c2db1186e243b0ddf5801e1a0e575a8cd9982d85203bc5529b737a355c8a2",
        ),
    ] {
        assert_eq!(expand(&sweep_of(&text)).plan_hash, plan_hash);
    }
}

#[test]
fn cameras_and_pictures_are_drawn_from_generators_of_their_own_and_leave_all_else_as_it_was() {
    let plain = expand(&sweep_of(&rich()));
    let tables = "\n[aim]\ndtd_nm = { min = 3, max = 7 }\n[jitter]\nheading_deg = { mean = 0, sd = 0.1 }\n[imaging]\nrefraction_coefficient = { min = 0.1, max = 0.16 }\nblur_sigma_px = { min = 0.5, max = 0.9 }\n[imaging.seeing]\ntilt_rms_arcsec = 5\n";
    let changed = expand(&sweep_of(&(rich() + tables)));
    let mut headings = BTreeSet::new();
    let mut seeds = BTreeSet::new();
    for (before, after) in plain.scenarios.iter().zip(&changed.scenarios) {
        assert_eq!((&before.id, before.seed), (&after.id, after.seed));
        let Parameters {
            aim,
            jitter,
            imaging,
            ..
        } = &after.parameters;
        let without = Parameters {
            aim: None,
            jitter: BTreeMap::new(),
            imaging: BTreeMap::new(),
            ..after.parameters.clone()
        };
        assert_eq!(before.parameters, without);
        assert!(matches!(aim, Some(Aim::GlidePath { dtd_nm }) if (3.0..7.0).contains(dtd_nm)));
        let [left, right] = ["left", "right"].map(|camera| imaging[camera]);
        // All cameras look through the same air, each with its own lens and its own noise.
        assert_eq!(left.refraction_coefficient, right.refraction_coefficient);
        assert!((0.1..0.16).contains(&left.refraction_coefficient));
        for camera in ["left", "right"] {
            headings.insert(jitter[camera].heading_deg.to_bits());
            seeds.insert(imaging[camera].degradation.unwrap().seed);
        }
        assert!(seeds.iter().all(|seed| *seed < 1 << 53));
    }
    assert_eq!(headings.len(), 2 * plain.scenarios.len());
    assert_eq!(seeds.len(), 2 * plain.scenarios.len());

    // An additional value changes no other.
    let more = expand(&sweep_of(&(rich() + tables + "correlation_s = 0.1\n")));
    for (a, b) in changed.scenarios.iter().zip(&more.scenarios) {
        assert_eq!(a.parameters.jitter, b.parameters.jitter);
        let seed = |s: &PlannedScenario| s.parameters.imaging["left"].degradation.unwrap().seed;
        assert_eq!(seed(a), seed(b));
    }
    let [_, text] = [changed, plain].map(|plan| {
        let text = serde_json::to_string(&plan).unwrap();
        assert_eq!(serde_json::from_str::<Plan>(&text).unwrap(), plan);
        text
    });
    assert!(
        ["aim", "jitter", "imaging"]
            .iter()
            .all(|key| !text.contains(&format!("\"{key}\"")))
    );
}

#[test]
fn identifiers_name_time_weather_and_repeat() {
    let plan = expand(&sweep_of(SMALL));
    let ids: Vec<&str> = plan.scenarios.iter().map(|s| s.id.as_str()).collect();
    assert_eq!(
        ids[..3],
        ["0600-clear-r1", "0600-foggy-r1", "1200-clear-r1"]
    );
    assert_eq!(ids[7], "1200-foggy-r2");
    let seeds: BTreeSet<u64> = plan.scenarios.iter().map(|s| s.seed).collect();
    assert_eq!(seeds.len(), 8);
}

fn conflict(plan: &Plan, frozen: &Plan) -> Option<String> {
    Difference::between(frozen, plan).conflict()
}

#[test]
fn more_repeats_only_add_and_other_changes_are_named() {
    let plan = expand(&sweep_of(SMALL));
    let longer = expand(&sweep_of(&SMALL.replace("repeats = 2", "repeats = 3")));
    assert_eq!(conflict(&longer, &plan), None);
    assert!(
        conflict(&plan, &longer)
            .unwrap()
            .contains("0600-clear-r3 is no longer in the sweep")
    );
    let wider = expand(&sweep_of(&SMALL.replace("width_px = 96", "width_px = 128")));
    let message = conflict(&wider, &plan).unwrap();
    assert!(
        message.contains("picture.width_px was 96, now 128") && message.contains("5 more"),
        "{message}"
    );
}

#[test]
fn of_another_seed_the_seed_is_named_and_not_what_it_drew() {
    let one = expand(&sweep_of(SMALL));
    let other = expand(&sweep_of(&SMALL.replace("seed = 0", "seed = 1")));
    let changed = Difference::between(&one, &other).changed;
    assert_eq!(changed.len(), one.scenarios.len());
    for change in changed {
        assert!(
            change.what.contains("`seed` of [corpus] is another"),
            "{}",
            change.what
        );
    }
}

/// Every scenario of `before` is in `after`, hash included.
fn assert_extends(before: &Plan, after: &Plan, what: &str) {
    let difference = Difference::between(before, after);
    assert_eq!(
        (difference.changed, difference.removed),
        (vec![], vec![]),
        "{what}"
    );
    assert_eq!(
        difference.added.len(),
        after.scenarios.len() - before.scenarios.len(),
        "{what}"
    );
    assert!(!difference.added.is_empty(), "{what}");
}

#[test]
fn a_time_a_weather_a_repeat_or_an_inclusion_changes_nothing_that_exists() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = with_recordings(folder.path());
    let before = expand(&sweep);
    let more_weather = "\n[weather.grey]\nvisibility_m = 20000\n";
    for (what, text) in [
        (
            "a time in the middle",
            sweep.text.replace("\"06:00\", ", "\"06:00\", \"09:00\", "),
        ),
        (
            "a weather in front",
            sweep.text.replace("[\"clear\"", "[\"grey\", \"clear\"") + more_weather,
        ),
        ("a repeat", sweep.text.replace("repeats = 2", "repeats = 3")),
        (
            "an inclusion",
            format!("{}\n[[include]]\ntimes = [\"20:00\"]\n", sweep.text),
        ),
    ] {
        let grown = Sweep::parse(&folder.path().join("sweep.toml"), folder.path(), text).unwrap();
        assert_extends(&before, &expand(&grown), what);
    }
}

#[test]
fn the_order_of_lists_says_only_what_is_made_first() {
    let turned = SMALL.replace("\"06:00\", \"12:00\"", "\"12:00\", \"06:00\"");
    let mut turned = expand(&sweep_of(&turned)).scenarios;
    let mut straight = expand(&sweep_of(SMALL)).scenarios;
    assert_ne!(turned, straight);
    turned.sort_by(|a, b| a.id.cmp(&b.id));
    straight.sort_by(|a, b| a.id.cmp(&b.id));
    assert_eq!(turned, straight);
}

#[test]
fn a_value_is_drawn_from_its_own_generator_and_no_other_moves_with_it() {
    let spread = SMALL.replace(
        "[start]",
        "[start]\ncross_track_m = { mean = 0, sd = 40 }\nspeed_mps = { min = 75, max = 85 }",
    );
    let wider = spread.replace("sd = 40", "sd = 80");
    let [a, b] = [spread, wider].map(|text| expand(&sweep_of(&text)));
    for (a, b) in a.scenarios.iter().zip(&b.scenarios) {
        let (x, y) = (&a.parameters, &b.parameters);
        assert_eq!(x.start_dtd_m, y.start_dtd_m);
        let [x, y] = [x, y].map(|parameters| parameters.live.as_ref().unwrap());
        assert_eq!(x.speed_mps, y.speed_mps);
        assert_eq!(2.0 * x.cross_track_m, y.cross_track_m);
    }
}

#[test]
fn the_numbers_of_a_weather_can_vary_from_scenario_to_scenario() {
    let text = SMALL
        .replace(
            "visibility_m = 9260",
            "visibility_m = { min = 3000, max = 9260 }",
        )
        .replace(
            "cover_ratio = 0.9",
            "cover_ratio = { mean = 0.9, sd = 0.1, min = 0.5, max = 1 }",
        );
    let plan = expand(&sweep_of(&text));
    let fogs: Vec<_> = plan
        .scenarios
        .iter()
        .filter(|s| s.weather == "foggy")
        .map(|s| &s.parameters.conditions.weather)
        .collect();
    let different: BTreeSet<String> = fogs.iter().map(|w| w.visibility_m.to_string()).collect();
    assert_eq!(different.len(), 4);
    for weather in fogs {
        assert!((3_000.0..=9_260.0).contains(&weather.visibility_m));
        assert!((0.5..=1.0).contains(&weather.clouds[0].cover_ratio));
        assert_eq!(weather.clouds[0].base_msl_m, 300.0);
    }
}

#[test]
fn a_profile_that_is_added_to_those_drawn_changes_only_scenarios_that_draw_it() {
    let two = SMALL.replace("repeats = 2", "repeats = 40").replace(
        "[start]",
        "[start]\nprofiles = [\"level-then-glide-path\", \"continuous\"]",
    );
    let three = two.replace("\"continuous\"]", "\"continuous\", \"step-down\"]");
    let [two, three] = [two, three].map(|text| expand(&sweep_of(&text)));
    let mut moved = 0;
    for (before, after) in two.scenarios.iter().zip(&three.scenarios) {
        if before != after {
            moved += 1;
            let live = after.parameters.live.as_ref().unwrap();
            assert_eq!(live.profile_name, "step-down");
        }
    }
    assert!((35..75).contains(&moved), "{moved} of 160");
}

fn with_recordings(folder: &Path) -> Sweep {
    for name in ["a.csv", "b.csv"] {
        recording::tests::write_example(
            &folder.join(name),
            if name == "a.csv" { 3_030.0 } else { 2_500.0 },
        );
    }
    with_rule(folder)
}

/// A sweep that flies all recordings from a folder in fog.
fn with_rule(folder: &Path) -> Sweep {
    let rule = "\n[[recorded]]\nfiles = \"*.csv\"\nweathers = [\"foggy\"]\n";
    Sweep::parse(&folder.join("sweep.toml"), folder, format!("{SMALL}{rule}")).unwrap()
}

#[test]
fn the_repeats_of_a_condition_fly_recordings_in_turn_where_the_rule_fits() {
    let folder = tempfile::tempdir().unwrap();
    let plan = expand(&with_recordings(folder.path()));
    let flights: Vec<&str> = plan.scenarios.iter().map(|s| s.flight.as_str()).collect();
    // Of both conditions in fog, each repeat flies a different file; which one is first is shuffled.
    assert_eq!(
        flights,
        [
            "live", "b.csv", "live", "b.csv", "live", "a.csv", "live", "a.csv"
        ]
    );
    assert_eq!(plan.scenarios[1].trajectory, plan.scenarios[3].trajectory);
    assert!(plan.scenarios[5].parameters.live.is_none());
    // 3,030 m at 75 m/s are 40.4 s: tick 0, 20 ticks of two seconds, and the first one past the target.
    assert_eq!(plan.scenarios[5].ticks, 22);
}

#[test]
fn a_renamed_copy_of_a_recording_is_the_same_trajectory() {
    let folder = tempfile::tempdir().unwrap();
    with_recordings(folder.path());
    std::fs::copy(folder.path().join("a.csv"), folder.path().join("b.csv")).unwrap();
    let plan = expand(&with_rule(folder.path()));
    let recorded = || plan.scenarios.iter().filter(|s| s.flight != "live");
    let files: BTreeSet<&str> = recorded().map(|s| s.flight.as_str()).collect();
    let same: BTreeSet<&str> = recorded().map(|s| s.trajectory.as_str()).collect();
    assert!(files.len() == 2 && same.len() == 1, "{files:?} {same:?}");
    assert!(
        same.iter().all(|name| name.starts_with("recorded-a-")),
        "{same:?}"
    );
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

#[test]
fn more_room_is_asked_for_than_is_expected_and_far_more_without_loss() {
    let plan = expand(&sweep_of(SMALL));
    let estimate =
        |common: &Common, size| Estimate::new(common, &plan.scenarios, &Pacing::StandIn, size);
    let default = Common {
        video: VideoSettings::default(),
        ..plan.common.clone()
    };
    let usual = estimate(&default, None);
    assert!(usual.room_bytes > usual.bytes.unwrap());
    assert_eq!(room_bytes(&default, &plan.scenarios), usual.room_bytes);
    let lossless = Common {
        video: VideoSettings::of(VideoCodec::H264Lossless),
        ..plan.common.clone()
    };
    let lossless = estimate(&lossless, None);
    assert_eq!(lossless.bytes, None);
    assert!(
        lossless.room_bytes > 10 * usual.room_bytes,
        "{} and {}",
        lossless.room_bytes,
        usual.room_bytes
    );
    let measured = MeasuredSize {
        bytes: 1_000_000,
        pictures: 10,
        scenarios: 1,
    };
    let known = estimate(&default, Some(measured));
    let expected = known.bytes.unwrap();
    assert!((expected..2 * expected).contains(&known.room_bytes));
}

fn seconds(pacing: &Pacing) -> [f64; 5] {
    let plan = expand(&sweep_of(SMALL));
    let estimate = Estimate::new(&plan.common, &plan.scenarios, pacing, None);
    let parts = &estimate.durations;
    [
        parts.pictures_h,
        parts.live_flying_h,
        parts.loading_h,
        parts.weather_h,
        estimate.making_h,
    ]
    .map(|hours| hours * 3_600.0)
}

#[test]
fn an_x_plane_flies_in_real_time_and_every_part_of_its_night_is_counted() {
    let plan = expand(&sweep_of(SMALL));
    let scenarios = plan.scenarios.len() as f64;
    let ticks: u32 = plan.scenarios.iter().map(|s| s.ticks).sum();
    let flight_s = f64::from(ticks) * plan.common.picture.frame_rate.period_s();
    let [pictures, flying, loading, weather, total] = seconds(&Pacing::XPlane(None));
    assert!((pictures - f64::from(ticks) * 2.0 / 8.0).abs() < 1e-6);
    assert!((flight_s..flight_s + 10.0 * scenarios).contains(&flying));
    assert!(loading >= 20.0 * scenarios && weather >= 55.0 * scenarios);
    let sum = pictures + flying + loading + weather;
    assert!((total - sum).abs() < 1e-6, "{total} and {sum}");
}

/// An X-Plane profile with nothing but a pace.
fn profile(pace: serde_json::Value) -> Box<Profile> {
    let mut kept = json!({
        "format": 1, "measured_at": "", "simulator": "", "plugin": null, "weather_follows": {},
        "pace": { "found": pace },
    });
    for unknown in [
        "wind_unit",
        "pause_shows_poses",
        "frames_until_settled",
        "still_pictures_move",
    ] {
        kept[unknown] = json!({ "not_measured": "not today" });
    }
    Box::new(serde_json::from_value(kept).unwrap())
}

#[test]
fn what_a_profile_has_measured_takes_the_place_of_what_is_assumed() {
    let pace = json!({
        "measured_by": "generate", "size": { "width_px": 1920, "height_px": 1280 }, "in_blocks": true, "settle_frames": 5,
        "pictures_per_s": 50.0, "loading_s": 10.0, "weather_s": 20.0,
    });
    let pacing = Pacing::XPlane(Some(profile(pace)));
    let [_, _, loading, weather, _] = seconds(&pacing);
    for (found, expected) in [(loading, 80.0), (weather, 160.0)] {
        assert!((found - expected).abs() < 1e-6, "{found}, {expected}");
    }
    let plan = expand(&sweep_of(SMALL));
    let durations = Estimate::new(&plan.common, &plan.scenarios, &pacing, None).durations;
    assert!(durations.pictures_basis.contains("blocks"), "{durations:?}");
    let loading = &durations.loading_basis;
    assert!(loading.contains("10 s each, measured"), "{loading}");
}

#[test]
fn computed_flights_take_no_time_to_fly_and_the_plan_of_live_ones_is_what_it_was() {
    let live = expand(&sweep_of(SMALL));
    let said = expand(&sweep_of(
        &SMALL.replace("[start]", "[start]\nfly = \"live\""),
    ));
    assert_eq!(live.plan_hash, said.plan_hash);
    assert_eq!(live.scenarios, said.scenarios);
    let computed = expand(&sweep_of(
        &SMALL.replace("[start]", "[start]\nfly = \"computed\""),
    ));
    assert_ne!(live.plan_hash, computed.plan_hash);
    let flights: BTreeSet<&str> = computed
        .scenarios
        .iter()
        .map(|s| s.flight.as_str())
        .collect();
    assert_eq!(flights, BTreeSet::from(["computed"]));
    for (live, computed) in live.scenarios.iter().zip(&computed.scenarios) {
        assert_eq!(live.parameters.live, computed.parameters.live);
        assert_eq!((&live.id, live.seed), (&computed.id, computed.seed));
    }
    let pacing = Pacing::XPlane(None);
    let estimate = Estimate::new(&computed.common, &computed.scenarios, &pacing, None);
    assert_eq!(estimate.durations.live_flying_h, 0.0);
}

#[test]
fn one_type_is_common_to_all_scenarios_and_several_are_drawn_by_each() {
    let plan_of = |aircraft: &str| expand(&sweep_of(&SMALL.replace("\"B737-800\"", aircraft)));
    let usual = plan_of("\"B737-800\"");
    for same in ["\"B738\"", "{ one_of = [\"B738\"] }"] {
        assert_eq!(plan_of(same).plan_hash, usual.plan_hash);
        assert_eq!(plan_of(same).common, usual.common);
    }
    assert_ne!(plan_of("\"A20N\"").plan_hash, usual.plan_hash);

    let many = SMALL.replace("repeats = 2", "repeats = 40");
    let drawn = |types: &str| {
        let plan = expand(&sweep_of(&many.replace("\"B737-800\"", types)));
        assert_eq!(plan.common.aircraft, None);
        plan.check_hashes().unwrap();
        plan.scenarios
    };
    let two = drawn("{ one_of = [\"B738\", \"A359\"] }");
    let three = drawn("{ one_of = [\"A359\", \"AT76\", \"B738\"] }");
    let own = |scenario: &PlannedScenario| scenario.parameters.aircraft.clone().unwrap();
    let wide = two.iter().filter(|one| own(one) == "A350-900").count();
    assert!((60..100).contains(&wide), "{wide} of {}", two.len());
    let one_type = expand(&sweep_of(&many)).scenarios;
    for ((before, after), usual) in two.iter().zip(&three).zip(&one_type) {
        assert!([own(before), "ATR72-600".to_owned()].contains(&own(after)));
        // The type changes nothing else.
        let without = Parameters {
            aircraft: None,
            ..before.parameters.clone()
        };
        assert_eq!(without, usual.parameters);
        assert_eq!(before.seed, usual.seed);
    }
}

#[test]
fn traffic_is_drawn_from_generators_of_its_own_and_is_part_of_the_hash() {
    let plain = expand(&sweep_of(&rich()));
    let rules = "\n[[traffic]]\nrole = \"arrival\"\nspacing_nm = { min = 3, max = 5 }\n\n[[traffic]]\nrole = \"parked\"\ntype = \"A359\"\nweathers = [\"foggy\"]\n";
    let busy = expand(&sweep_of(&(rich() + rules)));
    assert_ne!(plain.plan_hash, busy.plan_hash);
    let mut spacings = BTreeSet::new();
    for (before, after) in plain.scenarios.iter().zip(&busy.scenarios) {
        assert_eq!((&before.id, before.seed), (&after.id, after.seed));
        let traffic = &after.parameters.traffic;
        let without = Parameters {
            traffic: Vec::new(),
            ..after.parameters.clone()
        };
        assert_eq!(before.parameters, without);
        let expected = 1 + usize::from(after.weather == "foggy");
        assert_eq!(traffic.len(), expected, "{}", after.id);
        let spacing_nm = traffic[0].spacing_nm.unwrap();
        assert!((3.0..5.0).contains(&spacing_nm));
        spacings.insert(spacing_nm.to_bits());
        assert_eq!(traffic[0].aircraft, "B737-800");
        if let Some(parked) = traffic.get(1) {
            assert_eq!((parked.aircraft_number, &*parked.aircraft), (2, "A350-900"));
        }
    }
    assert_eq!(spacings.len(), plain.scenarios.len());
    let text = serde_json::to_string(&busy).unwrap();
    assert_eq!(serde_json::from_str::<Plan>(&text).unwrap(), busy);
    assert!(!serde_json::to_string(&plain).unwrap().contains("traffic"));
}
