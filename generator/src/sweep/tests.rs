use std::path::Path;

use super::*;

/// A small sweep; the tests change single lines.
pub(crate) const SMALL: &str = r#"[corpus]
name = "small"
seed = 0

[approach]
airport = "WSSS"
runway = "02L"
aircraft = "B737-800"
rig = "pair"

[grid]
times = ["06:00", "12:00"]
weathers = ["clear", "foggy"]
repeats = 2
day_of_year = 172
utc_offset_h = 8

[picture]
width_px = 96
height_px = 64
frame_rate = "1/2"

[start]
dtd_nm = { mean = 2.0, sd = 0.05 }

[weather.clear]
visibility_m = 30000

[weather.foggy]
visibility_m = 9260
clouds = [{ kind = "stratus", cover_ratio = 0.9, base_msl_m = 300, top_msl_m = 900 }]

[[rig.pair.cameras]]
id = "left"
beyond_touchdown_m = 1500
right_m = -300
height_m = 10
inward_deg = 5.3
pitch_deg = 1.6
hfov_deg = 10

[[rig.pair.cameras]]
id = "right"
beyond_touchdown_m = 1500
right_m = 300
height_m = 10
inward_deg = 5.3
pitch_deg = 1.6
hfov_deg = 10
"#;

fn parse(text: &str) -> Result<Sweep, TomlError> {
    Sweep::parse(Path::new("sweep.toml"), Path::new("."), text.to_owned())
}

#[test]
fn a_sweep_is_read_with_its_defaults() {
    let sweep = parse(SMALL).unwrap();
    assert_eq!(sweep.combinations.len(), 8);
    assert_eq!(sweep.runway.course_true_deg, 23.02);
    assert_eq!(sweep.picture.frame_rate.to_string(), "1/2");
    assert_eq!(sweep.start.dtd_nm.to_string(), "{ mean = 2, sd = 0.05 }");
    assert_eq!(sweep.video, VideoSettings::default());
    assert_eq!(sweep.cameras.len(), 2);
}

/// The original text, its replacement, the line and column that the message must name, and words that it must contain.
type Fault = (&'static str, &'static str, (usize, usize), &'static str);

/// Faults beside those that `tests/sweeps.rs` has for the command.
#[rustfmt::skip]
const FAULTS: [Fault; 4] = [
    ("name = \"small\"", r#"name = "a\nsize 0 B""#, (2, 8), "has a control character"),
    ("times = [\"06:00\", \"12:00\"]", "times = [20:30]", (12, 10), "put it in quotes: \"20:30\""),
    ("\"1/2\"", "29.97", (21, 14), "expected frames per second"),
    ("visibility_m = 30000", "visibility_m = nan", (27, 16), "NaN is not a usable number"),
];

#[test]
fn bad_input_is_reported_with_its_place_and_what_was_expected() {
    for (instead_of, written, place, words) in FAULTS {
        assert!(SMALL.contains(instead_of), "{instead_of}");
        let error = parse(&SMALL.replacen(instead_of, written, 1)).expect_err(written);
        assert_eq!(error.place, Some(place), "{written}: {error}");
        assert!(error.message.contains(words), "{written}: {error}");
        assert!(!error.message.contains('\n'), "{error}");
        assert!(error.to_string().contains(" ^"), "{error}");
    }
}

/// Lines that are added, and words that the message must contain.
#[rustfmt::skip]
const FAULTS_OF_TABLES: [(&str, &str); 21] = [
    ("[[recorded]]\nfiles = \"nowhere.csv\"\n", "no file matches"),
    ("[[recorded]]\nfiles = \"nowhere.csv\"\ntimes = [\"07:00\"]\n", "there is no time 07:00"),
    ("[[recorded]]\nfiles = \"nowhere.csv\"\nrepeats = [3]\n", "there is no repeat 3"),
    ("[airport.WSSS.runway.02L]\nglide_path_deg = 30\n", "from 1 to 10"),
    ("[airport.WSSS.runway.02L]\nthreshold = { latitude_deg = 91, longitude_deg = 0, altitude_msl_m = 0 }\n", "from -85 to 85"),
    ("[rig.empty]\ncameras = []\n", "without cameras"),
    ("[[exclude]]\nweathers = [\"foggy\"]\n[[exclude]]\ntimes = [\"06:00\"]\nweathers = [\"foggy\"]\n", "there is no weather foggy in the sweep"),
    ("[[include]]\ntimes = [\"20:00\"]\nweathers = [\"hail\"]\n", "weather \"hail\" is not defined"),
    ("[imaging]\nrefraction_coefficient = 13\n", "expected a coefficient of refraction from -1 to 0.9"),
    ("[imaging.seeing]\ncorrelation_s = 0\n", "from 0.001 to 100"),
    ("[imaging]\nvignetting = 1\n", "unknown field `vignetting`"),
    ("[jitter]\nheading_deg = { mean = 0, sd = 30 }\n", "can give -180 to 180, which is out of range; expected a small angle in degrees from -10 to 10"),
    ("[jitter]\nright_m = 300\n", "expected a small offset in metres from -50 to 50"),
    ("[jitter]\nhfov_deg = { min = -10, max = 0 }\n", "can give camera \"left\" a field of view of 0 to 10 degrees"),
    ("[aim]\n", "expected either dtd_nm"),
    ("[aim]\nheading_true_deg = 203\n", "expected either dtd_nm"),
    ("[weather.odd]\nvisibility_m = { mean = 9000, sd = 5000 }\n", "can give -21000 to 39000, which is out of range"),
    (
        "[weather.odd]\nvisibility_m = 9000\nclouds = [{ kind = \"stratus\", cover_ratio = 1, base_msl_m = { min = 300, max = 900 }, top_msl_m = 800 }]\n",
        "top at 800 m, but the base is at 900 m",
    ),
    (
        "[weather.odd]\nvisibility_m = 9000\nclouds = [{ kind = \"stratus\", cover_ratio = 1, base_msl_m = 300, top_msl_m = { min = 500, max = 900 } }, { kind = \"cumulus\", cover_ratio = 1, base_msl_m = 800, top_msl_m = 1200 }]\n",
        "base at 800 m, but the layer before reaches to 900 m",
    ),
    ("[profile.odd]\nkind = \"loop\"\n", "unknown variant `loop`"),
    ("[split]\ntrain = 0.5\nvalidation = 0.1\ntest = 0.1\n", "add up to 0.7"),
];

#[test]
fn faults_of_whole_tables_are_reported() {
    for (added, words) in FAULTS_OF_TABLES {
        let error = parse(&format!("{SMALL}\n{added}")).expect_err(added);
        assert!(error.message.contains(words), "{added}: {error}");
        assert!(
            error.place.is_some_and(|(line, _)| line > 50),
            "{added}: {error}"
        );
    }
}

#[test]
fn the_sweep_can_change_a_known_runway_and_define_a_new_one() {
    let authors =
        format!("{SMALL}\n[airport.WSSS.runway.02L]\ntouchdown_past_threshold_m = 617.7\n");
    let runway = parse(&authors).unwrap().runway;
    assert_eq!(
        (runway.touchdown_past_threshold_m, runway.course_true_deg),
        (617.7, 23.02)
    );

    let elsewhere = SMALL
        .replace("\"WSSS\"", "\"EDDM\"")
        .replace("\"02L\"", "\"26R\"")
        .replace("utc_offset_h = 8", "utc_offset_h = 2");
    let half = format!("{elsewhere}\n[airport.EDDM.runway.26R]\ncourse_true_deg = 263\n");
    assert!(
        parse(&half)
            .unwrap_err()
            .message
            .contains("threshold is missing")
    );
    let whole = half
        + "threshold = { latitude_deg = 48.366, longitude_deg = 11.821, altitude_msl_m = 448 }\nglide_path_deg = 3\ntouchdown_past_threshold_m = 300\n";
    assert_eq!(parse(&whole).unwrap().runway.name, "26R");
    // The built-in pavement of 26L does not belong to a runway that the sweep places itself.
    let own = parse(&whole.replace("26R", "26L")).unwrap().runway;
    assert_eq!((own.length_m, own.width_m), (None, None));
}

#[test]
fn what_cannot_be_at_this_runway_is_refused() {
    let high = SMALL
        .replace("\"WSSS\"", "\"EDDM\"")
        .replace("\"02L\"", "\"26R\"")
        + "\n[airport.EDDM.runway.26R]\ncourse_true_deg = 263\nglide_path_deg = 3\ntouchdown_past_threshold_m = 300\n\
           threshold = { latitude_deg = 48.366, longitude_deg = 11.821, altitude_msl_m = 948 }\n";
    let message = parse(&high).unwrap_err().message;
    assert!(
        message.contains("top at 900 m, but the runway is 948 m"),
        "{message}"
    );
    let above = high.replace(
        "base_msl_m = 300, top_msl_m = 900",
        "base_msl_m = 1300, top_msl_m = 1900",
    );
    let message = parse(&above).unwrap_err().message;
    assert!(
        message.contains("the sun is 0.8 h ahead of UTC at EDDM 26R"),
        "{message}"
    );
    let local = above.replace("utc_offset_h = 8", "utc_offset_h = 2");
    let height_m = |text: &str| {
        let sweep = parse(text).unwrap();
        let profile = sweep.profiles["level-then-glide-path"];
        profile.start_altitude_msl_m() - sweep.runway.threshold.altitude_msl_m
    };
    assert!((height_m(&local) - height_m(SMALL)).abs() < 1e-9);
    let near = SMALL.replace("mean = 2.0, sd = 0.05", "mean = 0.6, sd = 0");
    let message = parse(&near).unwrap_err().message;
    assert!(message.contains("a descent of 34 degrees"), "{message}");
}

#[test]
fn heights_above_the_runway_are_those_above_the_sea_and_its_elevation() {
    let zurich = SMALL
        .replace("\"WSSS\"", "\"LSZH\"")
        .replace("\"02L\"", "\"14\"")
        .replace("utc_offset_h = 8\n", "")
        .replace(
            "base_msl_m = 300, top_msl_m = 900",
            "base_above_runway_m = 300, top_above_runway_m = { min = 700, max = 900 }",
        );
    let level = "\n[profile.level]\nkind = \"glide_path\"\nlevel_above_runway_m = 500\n";
    let sweep = parse(&(zurich.clone() + level)).unwrap();
    let ground_m = sweep.runway.threshold.altitude_msl_m;
    assert_eq!(sweep.utc_offset_h, 2.0);
    let clouds = &sweep.weathers["foggy"].draw(1, ground_m).clouds;
    assert_eq!(clouds[0].base_msl_m, ground_m + 300.0);
    assert!((ground_m + 700.0..ground_m + 900.0).contains(&clouds[0].top_msl_m));
    assert_eq!(
        sweep.profiles["level"].start_altitude_msl_m(),
        ground_m + 500.0
    );
    let steps = "\n[profile.steps]\nkind = \"step_down\"\nlower_above_runway_m = 450\n";
    let steps = parse(&(zurich.clone() + steps)).unwrap().profiles["steps"];
    let upper_m = steps.start_altitude_msl_m() - ground_m;
    assert!((upper_m - (762.0 - 6.71)).abs() < 0.01, "{upper_m}");
    let both = format!("{zurich}{level}level_altitude_msl_m = 900\n");
    assert!(
        parse(&both)
            .unwrap_err()
            .message
            .contains("expected one of them")
    );
    let neither = zurich.replace("base_above_runway_m = 300, ", "");
    let message = parse(&neither).unwrap_err().message;
    assert!(
        message.contains("expected one of base_msl_m and base_above_runway_m"),
        "{message}"
    );
}

fn ids(text: &str) -> Vec<String> {
    let sweep = parse(text).unwrap();
    sweep.combinations.iter().map(Combination::id).collect()
}

#[test]
fn a_range_of_times_stands_for_its_times() {
    let text = SMALL
        .replace(
            "[\"06:00\", \"12:00\"]",
            "[{ from = \"06:00\", to = \"07:30\", every_min = 40 }, \"12:00\"]",
        )
        .replace("repeats = 2", "repeats = 1")
        .replace(
            "weathers = [\"clear\", \"foggy\"]\n",
            "weathers = [\"foggy\"]\n",
        );
    assert_eq!(
        ids(&text),
        [
            "0600-foggy-r1",
            "0640-foggy-r1",
            "0720-foggy-r1",
            "1200-foggy-r1"
        ]
    );
}

#[test]
fn weathers_that_are_not_listed_are_all() {
    let text = SMALL.replace("weathers = [\"clear\", \"foggy\"]\n", "");
    assert_eq!(ids(&text), ids(SMALL));
}

#[test]
fn combinations_can_be_left_out_and_added() {
    let rules = "\n[[exclude]]\ntimes = [\"06:00\"]\nweathers = [\"foggy\"]\n\n[[include]]\ntimes = [\"20:00\"]\nweathers = [\"foggy\"]\nrepeats = [1]\n";
    assert_eq!(
        ids(&format!("{SMALL}{rules}")),
        [
            "0600-clear-r1",
            "1200-clear-r1",
            "1200-foggy-r1",
            "0600-clear-r2",
            "1200-clear-r2",
            "1200-foggy-r2",
            "2000-foggy-r1"
        ]
    );
}

#[test]
fn profiles_of_the_grid_are_combined_and_named_in_the_identifier() {
    let text = SMALL
        .replace(
            "repeats = 2",
            "repeats = 1\nprofiles = [\"step-down\", \"continuous\"]",
        )
        .replace("[\"06:00\", \"12:00\"]", "[\"06:00\"]");
    assert_eq!(
        ids(&text),
        [
            "0600-clear-step-down-r1",
            "0600-clear-continuous-r1",
            "0600-foggy-step-down-r1",
            "0600-foggy-continuous-r1"
        ]
    );
    let alike = format!(
        "{text}\n[weather.clear-step]\nvisibility_m = 9000\n[profile.down]\nkind = \"step_down\"\n"
    )
    .replace("[\"clear\", \"foggy\"]", "[\"clear\", \"clear-step\"]")
    .replace(
        "[\"step-down\", \"continuous\"]",
        "[\"step-down\", \"down\"]",
    );
    let error = parse(&alike).unwrap_err();
    assert!(
        error.message.contains("both be called \"clear-step-down\""),
        "{error}"
    );
}

#[test]
fn a_rig_is_built_in_or_defined_and_the_file_decides_about_its_name() {
    let built_in = SMALL.replace("rig = \"pair\"", "rig = \"seed\"");
    assert_eq!(parse(&built_in).unwrap().cameras[0].hfov_deg, 6.7);
    let own = built_in.replace("rig.pair", "rig.seed");
    assert_eq!(parse(&own).unwrap().cameras[0].hfov_deg, 10.0);
}

#[test]
fn the_step_down_needs_no_definition_and_is_the_chart() {
    let text = SMALL.replace("[start]", "[start]\nprofiles = [\"step-down\"]");
    assert_eq!(
        parse(&text).unwrap().profiles["step-down"],
        ApproachProfile::charted_step_down(0.0)
    );
}

#[test]
fn names_that_are_one_file_where_case_does_not_count_are_refused() {
    for (from, to, words) in [
        (
            "[weather.foggy]",
            "[weather.Clear]\nvisibility_m = 1000\n[weather.foggy]",
            "Clear",
        ),
        ("id = \"right\"", "id = \"Left\"", "Left"),
    ] {
        let message = parse(&SMALL.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(
            message.contains("where case does not count") && message.contains(words),
            "{message}"
        );
    }
}
