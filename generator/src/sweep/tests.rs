use std::path::Path;

use super::*;
use crate::spread::Spread;

/// A small sweep; the tests change a line of it.
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

fn parse(text: &str) -> Result<Sweep, SweepError> {
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

/// What stands in the sound sweep, what is written instead, the line and column that the message must name, and words that must be
/// in it.
type Fault = (
    &'static str,
    &'static str,
    Option<(usize, usize)>,
    &'static str,
);

const FAULTS: [Fault; 34] = [
    (
        "seed = 0",
        "seed = 0\ncolour = 1",
        Some((4, 1)),
        "unknown field `colour`",
    ),
    ("seed = 0", "seed = -1", Some((3, 8)), "expected u64"),
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
        "repeats = 99999",
        Some((14, 11)),
        "at most 9999",
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
        "expected frames per second",
    ),
    (
        "\"1/2\"",
        "29.97",
        Some((21, 14)),
        "expected frames per second",
    ),
    ("\"1/2\"", "500", Some((21, 14)), "at most 240"),
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
        "NaN is out of range",
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
        assert!(!error.to_string().contains('\n'), "{error}");
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
        ("\n[[recorded]]\nfiles = \"nowhere/*.csv\"\n", "cannot list"),
        ("\n[[recorded]]\nfiles = \"nowhere.csv\"\n", "cannot read"),
        (
            "\n[[recorded]]\nfiles = \"nowhere.csv\"\ntimes = [\"07:00\"]\n",
            "no time of the grid",
        ),
        (
            "\n[[recorded]]\nfiles = \"nowhere.csv\"\nweathers = [\"hail\"]\n",
            "no weather of the grid",
        ),
        (
            "\n[[recorded]]\nfiles = \"nowhere.csv\"\nrepeats = [3]\n",
            "no repeat 3",
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
    assert!(
        error
            .to_string()
            .starts_with("no/such/sweep.toml: cannot read"),
        "{error}"
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
    assert!(demo.len() >= 8 && demo.grid.weathers.len() == 4 && demo.times.len() >= 3);
}
