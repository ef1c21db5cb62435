//! Sweeps as their authors experience them: the command reports mistakes with file, line and column, and the schema for editors and
//! checkers agrees as far as a schema can.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;
use testkit::command::{Dtd, said, text};
use testkit::{program_of_venv, repository};

/// A valid sweep; each case changes one line.
const SOUND: &str = r#"#:schema ./sweep.schema.json
[corpus]
name = "small"
seed = 0

[approach]
airport = "WSSS"
runway = "02L"
aircraft = "B737-800"
rig = "pair"

[grid]
times = ["06:00", { from = "10:00", to = "12:00", every_min = 60 }]
weathers = ["clear", "foggy"]
repeats = 2
day_of_year = 172
utc_offset_h = 8

[picture]
width_px = 96
height_px = 64
frame_rate = "1/2"

[video]
crf = 12

[start]
dtd_nm = { mean = 10.0, sd = 0.05 }
speed_mps = { mean = 80, sd = 5, min = 72, max = 88 }
cross_track_m = { one_of = [-40, 0, 40] }
profiles = ["step-down", "mine"]

[split]
train = 0.6
validation = 0.1
test = 0.3

[[exclude]]
times = ["06:00"]
weathers = ["foggy"]

[[include]]
times = ["20:00"]
weathers = ["foggy"]
repeats = [1]

[[recorded]]
files = "flights/*_ils.csv"
times = ["12:00"]

[weather.clear]
visibility_m = { min = 30000, max = 80000 }

[weather.foggy]
visibility_m = 9260
clouds = [{ kind = "stratus", cover_ratio = 0.9, base_msl_m = 300, top_msl_m = 900 }]
rain_ratio = 0.1
wind_speed_mps = 3
wind_from_true_deg = 60
turbulence_ratio = 0.1

[profile.mine]
kind = "glide_path"
level_altitude_msl_m = 914.4

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
beyond_threshold_m = 1840
right_m = 300
height_m = 10
heading_true_deg = 208
pitch_deg = 1.6
hfov_deg = 10

[airport.WSSS.runway.02L]
touchdown_past_threshold_m = 617.7
"#;

/// Detector of a mistake: a schema knows structure and ranges of numbers; only the command knows names, files and sums.
#[derive(PartialEq)]
enum By {
    Schema,
    CommandOnly,
}
use By::{CommandOnly, Schema};

/// The original text, its replacement, the position that the message must point at (these words' first occurrence in the changed sweep),
/// words that must be in it, and who finds it.
type Case = (&'static str, &'static str, &'static str, &'static str, By);

#[rustfmt::skip]
const CASES: &[Case] = &[
    // Form.
    ("[corpus]", "[corpus", "\nname", "expected", Schema),
    ("seed = 0", "seed = 0\ncolour = 1", "colour", "unknown field `colour`", Schema),
    ("seed = 0", "seed = -1", "-1", "expected a whole number", Schema),
    ("seed = 0", "seed = \"zero\"", "\"zero\"", "expected a whole number", Schema),
    ("name = \"small\"\n", "", "[corpus]", "missing field `name`", Schema),
    ("name = \"small\"", "name = \"\"", "\"\"", "name is empty", Schema),
    ("seed = 0", "seed = 0\nseed = 1", "seed = 1", "duplicate key", Schema),
    // Approach.
    ("\"WSSS\"", "\"XXXX\"", "\"XXXX\"", "airport \"XXXX\" is not known; known are BIKF 19", CommandOnly),
    ("\"02L\"", "\"20C\"", "\"20C\"", "runway \"20C\" of WSSS is not known", CommandOnly),
    ("B737-800", "A350", "\"A350\"", "the nearest is A350-900; known are B737-800 (B738), A320neo", Schema),
    ("\"B737-800\"", "{ one_of = [] }", "aircraft = { one_of", "expected at least one", Schema),
    ("\"B737-800\"", "{ one_of = [\"B738\", \"B737-800\"] }", "aircraft = { one_of", "and each once", CommandOnly),
    ("\"B737-800\"", "{ any_of = [\"B738\"] }", "{ any_of", "expected an aircraft type, or", Schema),
    ("rig = \"pair\"", "rig = \"trio\"", "\"trio\"", "defined are pair, seed, wide-baseline", CommandOnly),
    // Grid.
    ("\"06:00\", {", "\"24:00\", {", "\"24:00\"", "expected HH:MM", Schema),
    ("\"06:00\", {", "\"11:00\", {", "{ from", "11:00 is listed twice", CommandOnly),
    ("to = \"12:00\"", "to = \"09:00\"", "\"09:00\"", "09:00 is before 10:00", CommandOnly),
    ("every_min = 60", "every_min = 0", "0 }]", "expected 1 to 1439 minutes", Schema),
    ("every_min = 60", "every_minute = 60", "every_minute", "unknown field `every_minute`", Schema),
    ("[\"clear\", \"foggy\"]", "[\"clear\", \"fogy\"]", "\"fogy\"", "defined are clear, foggy; add a table [weather.fogy]", CommandOnly),
    ("[\"clear\", \"foggy\"]", "[\"foggy\", \"foggy\"]", "\"foggy\"]\nrepeats", "foggy is listed twice", Schema),
    ("[\"clear\", \"foggy\"]", "[]", "grid]", "the grid is empty", Schema),
    ("repeats = 2", "repeats = 0", "grid]", "the grid is empty", Schema),
    ("repeats = 2", "repeats = 999999", "999999", "at most 1000000", CommandOnly),
    ("repeats = 2", "repeats = 2\nprofiles = [\"mine\"]", "[\"step-down\"", "either grid.profiles", CommandOnly),
    ("repeats = 2", "repeats = 2\nprofiles = [\"dive\"]", "\"dive\"", "profile \"dive\" is not defined", CommandOnly),
    ("day_of_year = 172", "day_of_year = 400", "400", "from 1 to 365", Schema),
    ("utc_offset_h = 8", "utc_offset_h = 80", "80\n\n[picture]", "from -12 to 14", Schema),
    ("times = [\"06:00\"]\n", "times = [\"07:00\"]\n", "\"07:00\"", "there is no time 07:00 in the sweep; there are 06:00", CommandOnly),
    ("times = [\"06:00\"]\nweathers = [\"foggy\"]\n", "", "exclude]]", "every combination", Schema),
    ("times = [\"20:00\"]\nweathers = [\"foggy\"]", "times = [\"12:00\"]", "[[include]]", "includes nothing", CommandOnly),
    ("repeats = [1]", "repeats = [0]", "0]\n\n[[recorded", "0 is not a repeat", Schema),
    // Image and video.
    ("width_px = 96", "width_px = 97", "97", "even number", Schema),
    ("width_px = 96", "width_px = 0", "0\nheight", "from 64 to 8192", Schema),
    ("\"1/2\"", "-30", "-30", "expected frames per second", Schema),
    ("\"1/2\"", "\"30/0\"", "\"30/0\"", "expected 1/60 to 240 per second", Schema),
    ("\"1/2\"", "500", "500", "expected 1/60 to 240 per second", Schema),
    ("crf = 12", "crf = 99", "99", "expected 0 (best) to 51", Schema),
    ("crf = 12", "preset = \"warp\"", "\"warp\"", "superfast", Schema),
    // Start.
    ("sd = 0.05", "sd = -1", "{ mean = 10.0", "sd >= 0", Schema),
    ("sd = 0.05", "sd = 5", "dtd_nm", "can give -20 to 40, which is out of range", CommandOnly),
    ("mean = 10.0", "mean = 200.0", "dtd_nm", "nautical miles from 0.5 to 40", Schema),
    ("min = 72, max = 88", "min = 82, max = 88", "{ mean = 80", "min <= mean <= max", CommandOnly),
    ("one_of = [-40, 0, 40]", "one_of = []", "{ one_of", "at least one value", Schema),
    ("one_of = [-40, 0, 40]", "one_of = [-40, 0, 9000]", "cross_track_m", "from -5000 to 5000", Schema),
    ("\"mine\"]", "\"dive\"]", "\"dive\"", "profile \"dive\" is not defined", CommandOnly),
    ("test = 0.3", "test = 0.5", "split]", "add up to 1.2", CommandOnly),
    ("test = 0.3\n", "", "[split]", "missing field", Schema),
    // Weather.
    ("visibility_m = 9260", "visibility_m = 3", "3\nclouds", "from 50 to 200000", Schema),
    ("visibility_m = 9260", "visibility_m = 9260\nhail = 1", "hail", "unknown field `hail`", Schema),
    ("visibility_m = 9260", "visibility_m = 9260\nsnow_ratio = 1", "1\nclouds", "snow is not supported", Schema),
    ("visibility_m = 9260", "visibility_m = 9260\ntemperature_c = 5", "5\nclouds", "the standard atmosphere", Schema),
    ("min = 30000", "min = 90000", "{ min = 90000", "above max", CommandOnly),
    ("cover_ratio = 0.9", "cover_ratio = 9", "9, base", "from 0 to 1", Schema),
    ("top_msl_m = 900", "top_msl_m = 200", "200 }", "above the base", CommandOnly),
    ("\"stratus\"", "\"fluffy\"", "\"fluffy\"", "unknown variant `fluffy`", Schema),
    ("wind_from_true_deg = 60", "wind_from_true_deg = 361", "361", "from 0 to 360", Schema),
    ("turbulence_ratio = 0.1", "turbulence_ratio = 1.1", "1.1", "from 0 to 1", Schema),
    ("[weather.foggy]", "[weather.\"fog gy\"]", "\"fog gy\"", "letters, digits", Schema),
    // Profiles, rigs, airports, recordings.
    ("level_altitude_msl_m = 914.4", "level_altitude_msl_m = 20", "20\n\n[[rig", "above the runway", CommandOnly),
    ("kind = \"glide_path\"", "kind = \"loop\"", "\"loop\"", "unknown variant `loop`", Schema),
    ("id = \"left\"", "id = \"le/ft\"", "\"le/ft\"", "letters, digits", Schema),
    ("id = \"left\"", "id = \"right\"", "\"right\"\nbeyond_threshold", "two cameras", CommandOnly),
    ("beyond_touchdown_m = 1500\n", "", "[[rig.pair", "either beyond_touchdown_m or beyond_threshold_m", Schema),
    ("inward_deg = 5.3", "inward_deg = 5.3\nheading_true_deg = 200", "200\npitch", "either inward_deg or heading_true_deg", Schema),
    ("hfov_deg = 10\n\n[[rig", "hfov_deg = 0\n\n[[rig", "0\n\n[[rig", "field of view", Schema),
    ("hfov_deg = 10\n\n[[rig", "hfov_deg = 10\ndistortion = { k1 = -200 }\n\n[[rig", "distortion", "folds the image over", CommandOnly),
    ("hfov_deg = 10\n\n[[rig", "hfov_deg = 10\ndistortion = { k4 = 1 }\n\n[[rig", "k4", "unknown field `k4`", Schema),
    // Misplaced cameras, degraded images.
    ("[video]", "[aim]\ndtd_nm = 5\npitch_deg = 1\n\n[video]", "aim]", "expected either dtd_nm", Schema),
    ("[video]", "[aim]\ndtd_nm = { min = 3, max = 70 }\n\n[video]", "dtd_nm = { min = 3", "from -0.5 to 40", Schema),
    ("[video]", "[jitter]\nheading_deg = 20\n\n[video]", "20\n\n[video", "from -10 to 10", Schema),
    ("[video]", "[jitter]\nheight_m = -12\n\n[video]", "-12", "2 m under the ground", CommandOnly),
    ("[video]", "[imaging]\nblur_sigma_px = -0.5\n\n[video]", "-0.5", "from 0 to 20", Schema),
    ("[video]", "[imaging.sensor]\nread_noise_electrons = 5\n\n[video]", "sensor]", "missing field `full_well_electrons`", Schema),
    ("[video]", "[imaging]\npreset = \"tower\"\n\n[video]", "\"tower\"", "unknown variant `tower`", Schema),
    ("[video]", "[imaging.sway]\nrms_px = 50\n\n[video]", "50\n\n", "from 0 to 20", Schema),
    ("[video]", "[imaging.seeing]\nwind_mps = 5\n\n[video]", "5\n\n[video", "no effect without aperture_m", CommandOnly),
    ("[video]", "[imaging.seeing]\ncorrelation_s = 0.1\nwind_mps = 5\n\n[video]", "0.1\nwind", "expected one of them", CommandOnly),
    ("[video]", "[imaging.seeing]\ntilt_rms_arcsec = { mean = 5, sd = 2 }\n\n[video]", "tilt_rms_arcsec", "can give -7 to 17", CommandOnly),
    ("touchdown_past_threshold_m = 617.7", "touchdown_past_threshold_m = -1", "-1", "from 0 to 3000", Schema),
    ("[airport.WSSS", "[airport.WSSS.runway.20C]\ncourse_true_deg = 400\n\n[airport.WSSS", "400", "from 0 to 360", Schema),
    ("*_ils.csv", "*_lost.csv", "\"flights", "no file matches", CommandOnly),
    ("*_ils.csv", "README.md", "\"flights", "README.md", CommandOnly),
    ("times = [\"12:00\"]\n\n[weather", "times = [\"12:00\"]\nweathers = [\"hail\"]\n\n[weather", "\"hail\"", "there is no weather hail", CommandOnly),
];

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// Runs a program of the virtual environment that `scripts/setup.sh` creates.
fn judge(program: &str, folder: &Path, arguments: &[&str]) -> Output {
    Command::new(program_of_venv(program))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

/// A folder with the schema, the recorded flights, `sound.toml` and a file per case.
fn sweeps() -> (tempfile::TempDir, Vec<(PathBuf, String)>) {
    let folder = tempfile::tempdir().unwrap();
    let flights = folder.path().join("flights");
    fs::create_dir(&flights).unwrap();
    for name in ["01_calm_ils.csv", "README.md"] {
        let from = repository().join("tests/data/flights").join(name);
        fs::copy(from, flights.join(name)).unwrap();
    }
    let schema = repository().join("schema/sweep.schema.json");
    fs::copy(schema, folder.path().join("sweep.schema.json")).unwrap();
    fs::write(folder.path().join("sound.toml"), SOUND).unwrap();
    let mut files = Vec::new();
    for (number, (from, to, ..)) in CASES.iter().enumerate() {
        assert!(SOUND.contains(from), "the sound sweep has no {from:?}");
        let text = SOUND.replacen(from, to, 1);
        let path = folder.path().join(format!("bad{number:02}.toml"));
        fs::write(&path, &text).unwrap();
        files.push((path, text));
    }
    (folder, files)
}

fn line_and_column(text: &str, words: &str) -> (usize, usize) {
    let offset = text.find(words).unwrap_or_else(|| panic!("{words:?}"));
    let before = &text[..offset];
    let line_start = before.rfind('\n').map_or(0, |at| at + 1);
    let line = before.matches('\n').count() + 1;
    (line, text[line_start..offset].chars().count() + 1)
}

#[test]
fn a_bad_sweep_is_refused_with_file_line_column_and_what_was_expected_and_nothing_is_written() {
    let (folder, files) = sweeps();
    let sound = folder.path().join("sound.toml");
    DTD.succeeds(&["plan", text(&sound)]);
    let mut wrong = String::new();
    for ((path, sweep), (_, to, place, words, _)) in files.iter().zip(CASES) {
        let output = DTD.run(&["plan", text(path)]);
        let message = said(&output);
        let (line, column) = line_and_column(sweep, place);
        let start = format!("error: {}:{line}:{column}: ", path.display());
        let shown = format!("{line} | ");
        let good = output.status.code() == Some(2)
            && message
                .split_once(' ')
                .is_some_and(|(_, said)| said.starts_with(&start))
            && message.contains(words)
            && message.contains(&shown)
            && message.trim_end().ends_with('^');
        if !good {
            let code = output.status.code();
            writeln!(wrong, "{to:?}: expected {line}:{column} and {words:?}, exit 2; found exit {code:?}: {message}").unwrap();
        }
    }
    assert!(wrong.is_empty(), "\n{wrong}");
    let corpus = folder.path().join("corpus");
    let generate = ["generate", text(&files[0].0), "--out", text(&corpus)];
    DTD.ends_with(&generate, 2, &[text(&files[0].0)]);
    assert!(!corpus.exists(), "something was written");
}

#[test]
fn the_minimal_sweep_of_the_documentation_is_complete_and_needs_each_of_its_keys() {
    let page = fs::read_to_string(repository().join("docs/sweeps.md")).unwrap();
    let (_, section) = page.split_once("## A minimal sweep").unwrap();
    let (_, example) = section.split_once("```toml\n").unwrap();
    let (sweep, _) = example.split_once("```").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sweep.toml");
    let plan = |text: &str| {
        fs::write(&path, text).unwrap();
        DTD.run(&["plan", "--json", path.to_str().unwrap()])
    };
    let output = plan(sweep);
    assert!(output.status.success(), "{}", said(&output));
    let planned: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(planned["scenarios"].as_array().unwrap().len(), 20);
    for line in sweep.lines().filter(|line| line.contains(" = ")) {
        if line.starts_with("clouds") {
            continue;
        }
        let output = plan(&sweep.replacen(&format!("{line}\n"), "", 1));
        assert_eq!(output.status.code(), Some(2), "without {line}");
    }
}

#[test]
fn the_committed_schemas_are_what_the_command_prints() {
    for (of, file) in [
        ("sweep", "schema/sweep.schema.json"),
        ("train", "schema/train.schema.json"),
    ] {
        let output = DTD.succeeds(&["schema", of]);
        let committed = fs::read(repository().join(file)).unwrap();
        assert!(
            output.stdout == committed,
            "{file} is old: run `dtd schema {of} > {file}`"
        );
    }
}

const OURS: [&str; 11] = [
    "scenarios.toml",
    "demo.toml",
    "detector.toml",
    "paper.toml",
    "docs/results/detector-judge.toml",
    "docs/results/detector-judge-imaging.toml",
    "docs/results/jitter-imaging.toml",
    "docs/results/paper-turned-camera.toml",
    "docs/results/tower-camera.toml",
    "tests/data/chain.toml",
    "tests/data/recorded.toml",
];

#[test]
fn taplo_accepts_our_sweeps_and_refuses_what_a_schema_can_refuse() {
    let output = judge("taplo", repository(), &[&["check"], &OURS[..]].concat());
    assert!(output.status.success(), "{}", said(&output));
    for ours in OURS {
        let text = fs::read_to_string(repository().join(ours)).unwrap();
        assert!(
            text.starts_with("#:schema ./") || text.starts_with("#:schema ../"),
            "{ours}"
        );
    }
    let (folder, files) = sweeps();
    let output = judge("taplo", folder.path(), &["check", "sound.toml"]);
    assert!(output.status.success(), "{}", said(&output));
    for ((path, _), (_, to, _, _, by)) in files.iter().zip(CASES) {
        let output = judge("taplo", folder.path(), &["check", path.to_str().unwrap()]);
        assert_eq!(
            output.status.success(),
            *by == CommandOnly,
            "{to:?}: {}",
            said(&output)
        );
    }
}

#[test]
fn check_jsonschema_agrees_with_taplo() {
    let schema = repository().join("schema/sweep.schema.json");
    let meta = ["--check-metaschema", schema.to_str().unwrap()];
    let output = judge("check-jsonschema", repository(), &meta);
    assert!(output.status.success(), "{}", said(&output));

    let (folder, files) = sweeps();
    let mut arguments = vec![
        "--schemafile",
        schema.to_str().unwrap(),
        "--output-format",
        "json",
        "sound.toml",
    ];
    arguments.extend(
        files
            .iter()
            .map(|(path, _)| path.file_name().unwrap().to_str().unwrap()),
    );
    let output = judge("check-jsonschema", folder.path(), &arguments);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let refused: Vec<&str> = ["errors", "parse_errors"]
        .iter()
        .flat_map(|kind| report[kind].as_array().into_iter().flatten())
        .filter_map(|error| error["filename"].as_str())
        .collect();
    assert!(!refused.contains(&"sound.toml"), "{report:#}");
    for ((path, _), (_, to, _, _, by)) in files.iter().zip(CASES) {
        let name = path.file_name().unwrap().to_str().unwrap();
        assert_eq!(refused.contains(&name), *by == Schema, "{to:?}");
    }

    let ours: Vec<&str> = ["--schemafile", schema.to_str().unwrap()]
        .into_iter()
        .chain(OURS)
        .collect();
    let output = judge("check-jsonschema", repository(), &ours);
    assert!(output.status.success(), "{}", said(&output));
}
