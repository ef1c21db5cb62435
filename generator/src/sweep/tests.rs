use std::path::Path;

use super::*;
use crate::spread::Spread;

/// A small sweep; the tests change one line of it.
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
    assert_eq!(sweep.len(), 8);
    assert_eq!(sweep.runway.course_true_deg, 23.02);
    assert_eq!(sweep.picture.frame_rate.to_string(), "1/2");
    assert_eq!(
        sweep.start.dtd_nm,
        Spread::Normal {
            mean: 2.0,
            sd: 0.05
        }
    );
    assert_eq!(sweep.video, VideoSettings::default());
    assert_eq!(sweep.cameras.len(), 2);
}

/// The original text, its replacement, the line and column that the message must name, and words that it must contain.
type Fault = (
    &'static str,
    &'static str,
    Option<(usize, usize)>,
    &'static str,
);

const FAULTS: [Fault; 38] = [
    (
        "name = \"small\"",
        r#"name = "a\nsize 0 B""#,
        Some((2, 8)),
        "has a control character",
    ),
    (
        "seed = 0",
        "seed = 0\ncolour = 1",
        Some((4, 1)),
        "unknown field `colour`",
    ),
    (
        "times = [\"06:00\", \"12:00\"]",
        "times = [20:30]",
        Some((12, 10)),
        "put it in quotes: \"20:30\"",
    ),
    (
        "seed = 0",
        "seed = -1",
        Some((3, 8)),
        "expected a whole number",
    ),
    (
        "name = \"small\"\n",
        "",
        Some((1, 1)),
        "missing field `name`",
    ),
    ("[grid]", "[grid", Some((11, 6)), "expected"),
    (
        "\"WSSS\"",
        "\"XXXX\"",
        Some((6, 11)),
        "airport \"XXXX\" is not known; known are WSSS 02L",
    ),
    (
        "\"02L\"",
        "\"20C\"",
        Some((7, 10)),
        "runway \"20C\" of WSSS is not known",
    ),
    ("B737-800", "A380", Some((8, 12)), "known are B737-800"),
    (
        "rig = \"pair\"",
        "rig = \"trio\"",
        Some((9, 7)),
        "defined are pair",
    ),
    ("\"12:00\"", "\"24:00\"", Some((12, 19)), "expected HH:MM"),
    ("\"12:00\"", "\"06:00\"", Some((12, 19)), "listed twice"),
    (
        "\"clear\", \"foggy\"",
        "\"clear\", \"fogy\"",
        Some((13, 22)),
        "weather \"fogy\" is not defined; defined are clear, foggy",
    ),
    ("repeats = 2", "repeats = 0", Some((11, 2)), "empty"),
    (
        "repeats = 2",
        "repeats = 999999",
        Some((14, 11)),
        "at most 1000000",
    ),
    (
        "day_of_year = 172",
        "day_of_year = 400",
        Some((15, 15)),
        "from 1 to 365",
    ),
    (
        "utc_offset_h = 8",
        "utc_offset_h = 80",
        Some((16, 16)),
        "from -12 to 14",
    ),
    (
        "width_px = 96",
        "width_px = 97",
        Some((19, 12)),
        "even number",
    ),
    (
        "\"1/2\"",
        "-30",
        Some((21, 14)),
        "invalid value: integer `-30`, expected frames per second above zero",
    ),
    (
        "\"1/2\"",
        "\"30/0\"",
        Some((21, 14)),
        "expected 1/60 to 240 per second",
    ),
    (
        "\"1/2\"",
        "29.97",
        Some((21, 14)),
        "expected frames per second",
    ),
    (
        "\"1/2\"",
        "500",
        Some((21, 14)),
        "expected 1/60 to 240 per second",
    ),
    ("sd = 0.05", "sd = -1", Some((24, 10)), "sd >= 0"),
    (
        "mean = 2.0",
        "mean = 200.0",
        Some((24, 1)),
        "nautical miles",
    ),
    (
        "[start]",
        "[start]\nprofiles = [\"dive\"]",
        Some((24, 13)),
        "profile \"dive\" is not defined",
    ),
    (
        "visibility_m = 30000",
        "visibility_m = 3",
        Some((27, 16)),
        "from 50 to 200000",
    ),
    (
        "visibility_m = 30000",
        "visibility_m = nan",
        Some((27, 16)),
        "NaN is not a usable number",
    ),
    (
        "visibility_m = 30000",
        "visibility_m = 30000\nsnow = 1",
        Some((28, 1)),
        "unknown field `snow`",
    ),
    (
        "cover_ratio = 0.9",
        "cover_ratio = 9",
        Some((31, 45)),
        "from 0 to 1",
    ),
    (
        "top_msl_m = 900",
        "top_msl_m = 200",
        Some((31, 80)),
        "above the base",
    ),
    (
        "\"stratus\"",
        "\"fluffy\"",
        Some((31, 20)),
        "unknown variant `fluffy`",
    ),
    (
        "id = \"left\"",
        "id = \"le/ft\"",
        Some((34, 6)),
        "letters, digits",
    ),
    (
        "id = \"left\"",
        "id = \"right\"",
        Some((43, 6)),
        "two cameras",
    ),
    (
        "beyond_touchdown_m = 1500\nright_m = -300",
        "right_m = -300",
        Some((33, 1)),
        "either beyond_touchdown_m or",
    ),
    (
        "hfov_deg = 10",
        "hfov_deg = 0",
        Some((40, 12)),
        "field of view",
    ),
    (
        "hfov_deg = 10",
        "hfov_deg = 10\ndistortion = { k1 = -200 }",
        Some((41, 1)),
        "folds the picture over",
    ),
    (
        "hfov_deg = 10",
        "hfov_deg = 10\ndistortion = { k4 = 1 }",
        Some((41, 16)),
        "unknown field `k4`",
    ),
    (
        "[picture]",
        "[video]\npreset = \"warp\"\n[picture]",
        Some((19, 10)),
        "superfast",
    ),
];

#[test]
fn every_kind_of_bad_input_is_reported_with_its_place_and_what_was_expected() {
    for (instead_of, written, place, words) in FAULTS {
        assert!(SMALL.contains(instead_of), "{instead_of}");
        let error = parse(&SMALL.replacen(instead_of, written, 1)).expect_err(written);
        assert_eq!(error.place, place, "{written}: {error}");
        assert!(error.message.contains(words), "{written}: {error}");
        assert!(!error.message.contains('\n'), "{error}");
        assert!(error.to_string().contains(" ^"), "{error}");
    }
}

#[test]
fn more_faults_of_whole_tables_are_reported() {
    let faults = [
        (
            "\n[split]\ntrain = 0.5\nvalidation = 0.1\ntest = 0.1\n",
            "add up to 0.7",
        ),
        ("\n[split]\ntrain = 0.9\n", "missing field"),
        (
            "\n[[recorded]]\nfiles = \"nowhere/*.csv\"\n",
            "no file matches",
        ),
        (
            "\n[[recorded]]\nfiles = \"nowhere.csv\"\n",
            "no file matches",
        ),
        (
            "\n[[recorded]]\nfiles = \"nowhere.csv\"\ntimes = [\"07:00\"]\n",
            "there is no time 07:00",
        ),
        (
            "\n[[recorded]]\nfiles = \"nowhere.csv\"\nweathers = [\"hail\"]\n",
            "there is no weather hail",
        ),
        (
            "\n[[recorded]]\nfiles = \"nowhere.csv\"\nrepeats = [3]\n",
            "there is no repeat 3",
        ),
        (
            "\n[airport.WSSS.runway.02L]\nglide_path_deg = 30\n",
            "from 1 to 10",
        ),
        (
            "\n[profile.low]\nkind = \"glide_path\"\nlevel_altitude_msl_m = 20\n",
            "above the runway",
        ),
        (
            "\n[profile.odd]\nkind = \"loop\"\n",
            "unknown variant `loop`",
        ),
        ("\n[rig.empty]\ncameras = []\n", "without cameras"),
        (
            "\n[[exclude]]\ntimes = [\"07:00\"]\n",
            "there is no time 07:00 in the sweep; there are 06:00, 12:00",
        ),
        (
            "\n[[exclude]]\nweathers = [\"foggy\"]\n[[exclude]]\ntimes = [\"06:00\"]\nweathers = [\"foggy\"]\n",
            "there is no weather foggy in the sweep",
        ),
        ("\n[[exclude]]\n", "every combination"),
        (
            "\n[[exclude]]\nprofiles = [\"step-down\"]\n",
            "there is no profile step-down in the sweep; there are none",
        ),
        ("\n[[include]]\ntimes = [\"06:00\"]\n", "includes nothing"),
        (
            "\n[[include]]\ntimes = [\"20:00\"]\nweathers = [\"hail\"]\n",
            "weather \"hail\" is not defined",
        ),
        ("\n[[include]]\nrepeats = [0]\n", "0 is not a repeat"),
        (
            "\n[weather.\"a b\"]\nvisibility_m = 9000\n",
            "letters, digits, - and _ only",
        ),
        (
            "\n[airport.WSSS.runway.02L]\nthreshold = { latitude_deg = 91, longitude_deg = 0, altitude_msl_m = 0 }\n",
            "from -85 to 85",
        ),
        (
            "\n[imaging]\nblur_sigma_px = -1\n",
            "-1 is out of range; expected a standard deviation in pixels from 0 to 20",
        ),
        (
            "\n[imaging]\nrefraction_coefficient = 13\n",
            "expected a coefficient of refraction from -1 to 0.9",
        ),
        (
            "\n[imaging.sensor]\nread_noise_electrons = 5\n",
            "missing field `full_well_electrons`",
        ),
        (
            "\n[imaging.seeing]\ncorrelation_s = 0\n",
            "from 0.001 to 100",
        ),
        (
            "\n[imaging]\nvignetting = 1\n",
            "unknown field `vignetting`",
        ),
        (
            "\n[jitter]\nheading_deg = { mean = 0, sd = 30 }\n",
            "can give -180 to 180, which is out of range; expected a small angle in degrees from -10 to 10",
        ),
        (
            "\n[jitter]\nright_m = 300\n",
            "expected a small offset in metres from -50 to 50",
        ),
        (
            "\n[jitter]\nheight_m = -12\n",
            "can put camera \"left\" 2 m under the ground",
        ),
        (
            "\n[jitter]\nhfov_deg = { min = -10, max = 0 }\n",
            "can give camera \"left\" a field of view of 0 to 10 degrees",
        ),
        ("\n[aim]\n", "expected either dtd_nm"),
        (
            "\n[aim]\ndtd_nm = 5\npitch_deg = 1\n",
            "expected either dtd_nm",
        ),
        (
            "\n[aim]\nheading_true_deg = 203\n",
            "expected either dtd_nm",
        ),
        (
            "\n[weather.odd]\nvisibility_m = { mean = 9000, sd = 5000 }\n",
            "can give -21000 to 39000, which is out of range",
        ),
        (
            "\n[weather.odd]\nvisibility_m = 9000\nclouds = [{ kind = \"stratus\", cover_ratio = 1, base_msl_m = { min = 300, max = 900 }, top_msl_m = 800 }]\n",
            "top at 800 m, but the base is at 900 m",
        ),
        (
            "\n[weather.odd]\nvisibility_m = 9000\nclouds = [{ kind = \"stratus\", cover_ratio = 1, base_msl_m = 300, top_msl_m = { min = 500, max = 900 } }, { kind = \"cumulus\", cover_ratio = 1, base_msl_m = 800, top_msl_m = 1200 }]\n",
            "base at 800 m, but the layer before reaches to 900 m",
        ),
    ];
    for (added, words) in faults {
        let error = parse(&format!("{SMALL}{added}")).expect_err(added);
        assert!(error.message.contains(words), "{added}: {error}");
        assert!(
            error.place.is_some_and(|(line, _)| line > 50),
            "{added}: {error}"
        );
    }
}

#[test]
fn a_missing_file_is_reported_by_name() {
    let error = Sweep::read(Path::new("no/such/sweep.toml")).unwrap_err();
    let message = error.to_string();
    assert!(
        message.contains("cannot read") && message.contains("no/such/sweep.toml"),
        "{message}"
    );
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
        .replace("\"02L\"", "\"26R\"");
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
    let backwards = text.replace("to = \"07:30\"", "to = \"05:30\"");
    let error = parse(&backwards).unwrap_err();
    assert!(error.message.contains("05:30 is before 06:00"), "{error}");
    assert_eq!(error.place.map(|(line, _)| line), Some(12));
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
    let both = text.replace("[start]", "[start]\nprofiles = [\"continuous\"]");
    let error = parse(&both).unwrap_err();
    assert!(error.message.contains("either grid.profiles"), "{error}");
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
        ApproachProfile::charted_step_down()
    );
    // A runway in the mountains: 2500 ft above sea level are below it.
    let high = format!(
        "{SMALL}\n[airport.WSSS.runway.02L]\nthreshold = {{ latitude_deg = 1.3, longitude_deg = 104, altitude_msl_m = 1500 }}\n"
    );
    let error = parse(&high).unwrap_err();
    assert!(
        error
            .message
            .contains("profile level-then-glide-path does not fit the runway"),
        "{error}"
    );
}

#[test]
fn the_sweeps_that_ship_are_sound() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let full = Sweep::read(&root.join("scenarios.toml")).unwrap();
    assert_eq!(full.len(), 100);
    assert_eq!(
        (full.picture.width_px, full.picture.height_px),
        (1_920, 1_280)
    );
    assert_eq!(full.picture.frame_rate.to_string(), "30");
    let demo = Sweep::read(&root.join("demo.toml")).unwrap();
    assert_eq!((demo.len(), demo.weathers.len()), (10, 4));
    assert_eq!(Sweep::read(&root.join("detector.toml")).unwrap().len(), 40);
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
