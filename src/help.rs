//! Parts of `--help` beyond the arguments: verbs in groups, and examples.

use std::fmt::Write;

use clap::Command;

/// Maximum width of help texts.
pub(crate) const COLUMNS: usize = 80;

/// Verbs grouped by task, in the order of use.
const GROUPS: &[(&str, &[&str])] = &[
    ("Start here", &["demo", "paper", "examples"]),
    (
        "Corpora",
        &[
            "aircraft", "airport", "tracks", "import", "plan", "generate", "label", "detect",
            "status", "verify", "view", "export", "push", "fetch", "schema",
        ],
    ),
    (
        "Estimators",
        &[
            "train",
            "refit",
            "evaluate",
            "predict",
            "estimate",
            "export-estimators",
        ],
    ),
    ("Detectors", &["train-detector", "evaluate-detector"]),
    (
        "Simulators",
        &["doctor", "install-plugin", "tape", "mock-xplane"],
    ),
    ("The program itself", &["completions", "man", "help"]),
];

/// The groups stand between these two parts of clap's template. Braces in a verb's description would be read as tags.
const BEFORE_GROUPS: &str = "{about-with-newline}\n{usage-heading} {usage}\n";
const AFTER_GROUPS: &str = "\nOptions:\n{options}{after-help}";

pub(crate) const ENDINGS: &str = "\
Exit codes: 0 done, 1 failed, 2 bad arguments or input, 3 finished but some
scenarios were lost, 75 interrupted: run the same command again to resume.
Results go to stdout, progress and logs to stderr.";

pub(crate) const PLAN: &str = "\
Examples:
  dtd plan scenarios.toml                     its scenarios, time and size
  dtd plan scenarios.toml --against corpus    what is missing or has changed
  dtd plan scenarios.toml --sim auto          how long that X-Plane would take";

pub(crate) const GENERATE: &str = "\
Examples:
  dtd generate demo.toml --out corpus               bundled simulator
  dtd generate demo.toml --out corpus --sim mock:2  with two of them
  dtd generate demo.toml --out corpus --sim 127.0.0.1:49000
                                                    with X-Plane; first: doctor
  dtd generate scenarios.toml --out s3://bucket/corpus --shard 0/4
  dtd generate demo.toml --out corpus --sim auto --restart-simulator ./restart

Environment:
  DTD_LINK_TOKEN        the secret of a capture link on another computer
  DTD_WEB_API           address of X-Plane 12's Web API, or off
  SLURM_ARRAY_TASK_ID, or JOB_COMPLETION_INDEX with DTD_SHARDS
                        the default of --shard
  Credentials of object stores: docs/corpus.md";

pub(crate) const LABEL: &str = "\
Example:
  dtd label corpus";

pub(crate) const DETECT: &str = "\
Examples:
  dtd detect corpus
  dtd detect corpus --model detector.onnx
  dtd detect corpus --shard 0/4          a quarter of the scenarios
  dtd detect corpus --mode full          every image whole, at several times
                                         the cost (docs/tracks.md)
  dtd detect corpus --registration-of run
                                         for a wrong calibration.json

Environment:
  ORT_DYLIB_PATH        ONNX Runtime's library, unless --onnx-runtime names it
  SLURM_ARRAY_TASK_ID, or JOB_COMPLETION_INDEX with DTD_SHARDS
                        the default of --shard";

pub(crate) const TRAIN: &str = "\
Examples:
  dtd train corpus --out run --quick
  dtd train corpus --out run --config TRAIN.toml --seed 1
  dtd train corpus --out run --leave-out weather=stormy
  dtd train corpus more --out run --start-from earlier";

pub(crate) const REFIT: &str = "\
Example:
  dtd refit run --corpus moved --view left --out run2";

pub(crate) const EVALUATE: &str = "\
Examples:
  dtd evaluate run --corpus corpus            adds metrics.json, report.html
  dtd evaluate run --corpus other --side all --out judged
                                              flights that no training saw
  dtd evaluate --predictions mine.csv --corpus corpus --out judged
                                              predictions of other software";

pub(crate) const EXPORT_ESTIMATORS: &str = "\
Example:
  dtd export-estimators run --out models      ONNX files and MODEL_CARD.md

Environment:
  ORT_DYLIB_PATH        ONNX Runtime's library, unless --onnx-runtime names it";

pub(crate) const PREDICT: &str = "\
Example:
  dtd predict run --corpus corpus --out distances.parquet";

pub(crate) const ESTIMATE: &str = "\
Examples:
  dtd estimate run --view left=rtsp://user@camera1/video \\
      --view right=rtsp://user@camera2/video --metrics 127.0.0.1:9464
  dtd estimate run --view left=left.mp4 --view right=right.mp4 \\
      --as-fast-as-possible
  dtd estimate run --view left=corpus:corpus/1200-clear-r1 \\
      --view right=corpus:corpus/1200-clear-r1

Environment:
  DTD_PASSWORD_VIEW     password of a view's server, e.g. DTD_PASSWORD_LEFT
  ORT_DYLIB_PATH        ONNX Runtime's library, unless --onnx-runtime names it";

pub(crate) const EVALUATE_DETECTOR: &str = "\
Examples:
  dtd evaluate-detector corpus --out judged
  dtd evaluate-detector corpus --out judged --model M.onnx --mode full,tracked

Environment:
  ORT_DYLIB_PATH        ONNX Runtime's library, unless --onnx-runtime names it";

pub(crate) const STATUS: &str = "\
Examples:
  dtd status corpus
  dtd status corpus --watch                   every 5 s, until all is recorded
  dtd status s3://bucket/corpus --json";

pub(crate) const VERIFY: &str = "\
Examples:
  dtd verify corpus
  dtd verify corpus --no-decode               hashes, tables and plan only
  dtd verify corpus --against expected        and labels as in an earlier one
  dtd verify s3://bucket/corpus               one scenario after the other";

pub(crate) const VIEW: &str = "\
Examples:
  dtd view                                    ./corpus, in the browser
  dtd view corpus --run run --run other-run   with the errors of two runs
  dtd view corpus --port 0 --no-open          prints its address, as JSON";

pub(crate) const TRAIN_DETECTOR: &str = "\
Examples:
  dtd train-detector corpus --out detector.onnx --minutes 60
  dtd train-detector corpus --out detector.onnx --start-from earlier.onnx";

pub(crate) const PUSH: &str = "\
Example:
  dtd push corpus s3://bucket/corpus";

pub(crate) const FETCH: &str = "\
Example:
  dtd fetch s3://bucket/corpus --out corpus --only 1200-clear-r1";

pub(crate) const EXPORT: &str = "\
Examples:
  dtd export corpus --to coco --out coco-folder
  dtd export corpus --to yolo --out yolo-folder --every 10 --pictures jpeg
  dtd export corpus --to mcap --out recordings --only 1200-clear-r1";

pub(crate) const DOCTOR: &str = "\
Examples:
  dtd doctor                                  X-Plane on this computer
  dtd doctor --sim 192.168.1.20:49000 --sweep scenarios.toml
  dtd doctor --first-hour first-hour          a report of an X-Plane to send

Environment:
  DTD_LINK_TOKEN        the secret of a capture link on another computer";

pub(crate) const INSTALL_PLUGIN: &str = "\
Example:
  dtd install-plugin \"$HOME/X-Plane 12\"";

pub(crate) const AIRCRAFT: &str = "\
Examples:
  dtd aircraft                            names, sizes and speeds
  dtd aircraft show A359 --png A359.png   what it looks like";

pub(crate) const AIRCRAFT_SHOW: &str = "\
Example:
  dtd aircraft show B738 A359 --png types.png";

pub(crate) const AIRPORT_IMPORT: &str = "\
Example:
  dtd airport import EDDM 26L --from apt.dat earth_nav.dat runways.csv \\
      >> sweep.toml";

pub(crate) const TRACKS_IMPORT: &str = "\
Example:
  dtd tracks import arrivals/*.csv --runway LFPG/09R --airports sweep.toml \\
      --out flights

Exit codes: 3 if a file or track was refused, 2 if all were.";

pub(crate) const IMPORT: &str = "\
Example:
  dtd import tower.toml --out corpus
  dtd verify corpus && dtd train corpus --out run

Exit codes: 3 if a file, camera or arrival was refused, 2 if nothing is left.";

pub(crate) const TAPE: &str = "\
Examples:
  dtd tape --sim 127.0.0.1:49000 --out session.mcap
  dtd doctor --sim 127.0.0.1:49100            beside it: a session to record
  dtd generate demo.toml --out corpus --sim tape:session.mcap";

pub(crate) const MOCK_XPLANE: &str = "\
Examples:
  dtd mock-xplane                             an awkward X-Plane 12, port 49000
  dtd mock-xplane --quirks none               a well-behaved one";

pub(crate) const DEMO: &str = "\
Examples:
  dtd demo                                    results in target/demo
  dtd demo --out /tmp/demo";

pub(crate) const PAPER: &str = "\
Examples:
  dtd paper --out paper --scale small         a first look, in three minutes
  dtd paper --out paper                       100 scenarios: hours; resumes
  dtd paper --out paper --frame-rate 1/4      an eighth of the images
  dtd paper --out paper --pretrained-detector yolo11n.onnx

Environment:
  ORT_DYLIB_PATH        ONNX Runtime's library, unless --onnx-runtime names it";

pub(crate) const EXAMPLES: &str = "\
Example:
  dtd examples sweeps && dtd plan sweeps/scenarios.toml";

pub(crate) const SCHEMA: &str = "\
Examples:
  dtd schema > sweep.schema.json              in a sweep: #:schema FILE
  dtd schema train > train.schema.json
  dtd schema progress                         of generate ... --progress json";

pub(crate) const COMPLETIONS: &str = "\
Examples:
  source <(dtd completions bash)
  dtd completions zsh > \"${fpath[1]}/_dtd\"
  dtd completions fish > ~/.config/fish/completions/dtd.fish";

pub(crate) const MAN: &str = "\
Example:
  dtd man ~/.local/share/man/man1 && man dtd-generate";

/// Help template with the verbs in groups.
pub(crate) fn template(command: &Command) -> String {
    format!("{BEFORE_GROUPS}{}{AFTER_GROUPS}", groups(command))
}

fn groups(command: &Command) -> String {
    let about = |verb: &str| match command.find_subcommand(verb) {
        Some(found) => found.get_about().map(ToString::to_string),
        None => Some("Show this text, or the help of a verb".to_owned()),
    };
    let widest = GROUPS.iter().flat_map(|(_, verbs)| verbs.iter());
    let width = widest.map(|verb| verb.len()).max().unwrap_or(0);
    let mut text = String::new();
    for (title, verbs) in GROUPS {
        let _ = writeln!(text, "\n{title}:");
        for verb in *verbs {
            let _ = writeln!(
                text,
                "  {verb:<width$}  {}",
                about(verb).unwrap_or_default()
            );
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use super::*;

    #[test]
    fn every_verb_is_in_one_group_described_in_a_line_and_has_an_example() {
        let command = crate::args::Args::grouped_command();
        command.clone().debug_assert();
        let mut grouped: Vec<&str> = GROUPS
            .iter()
            .flat_map(|(_, verbs)| *verbs)
            .copied()
            .collect();
        grouped.sort_unstable();
        let mut verbs: Vec<&str> = command.get_subcommands().map(Command::get_name).collect();
        verbs.push("help");
        verbs.sort_unstable();
        assert_eq!(grouped, verbs);
        for verb in command.get_subcommands() {
            let about = verb.get_about().unwrap().to_string();
            assert!(!about.contains(['{', '}']), "{about}");
            let name = verb.get_name();
            let after = verb.get_after_help().unwrap_or_else(|| panic!("{name}"));
            assert!(after.to_string().contains(&format!("dtd {name}")), "{name}");
        }
    }

    /// The verbs, then `dtd` itself.
    fn commands() -> Vec<Command> {
        let mut command = crate::args::Args::grouped_command();
        command.build();
        let mut all: Vec<Command> = command.get_subcommands().cloned().collect();
        all.push(command);
        all
    }

    #[test]
    fn no_help_has_a_line_wider_than_80_columns() {
        for mut command in commands() {
            let examples = command.get_after_help().map(ToString::to_string);
            let texts = [
                command.render_help().to_string(),
                command.render_long_help().to_string(),
                // Before clap wraps them.
                examples.unwrap_or_default(),
            ];
            for line in texts.iter().flat_map(|text| text.lines()) {
                let columns = line.chars().count();
                let name = command.get_name();
                assert!(columns <= COLUMNS, "{name}: {columns} columns: {line}");
            }
        }
    }

    /// Options that several verbs describe in their own words, and the words that all of them share. `out` is where a verb writes.
    const OWN_WORDS: &[(&str, &str)] = &[
        ("corpus", "Folder of "),
        ("mode", "Parts of the images to search"),
        ("out", ""),
        ("port", "; 0 takes any free one"),
        ("restart-simulator", "Shell command that restarts "),
        ("rows", "Rows of the images to search: "),
        ("run", "un whose "),
        ("side", "Side of the split to "),
        ("sim", "simulator"),
        ("start-from", "to start from instead of random"),
        ("sweep", "The sweep to "),
        ("timeout", "Longest wait for "),
        ("view", "iew"),
    ];

    #[test]
    fn a_verb_has_one_subject_and_everything_else_is_an_option() {
        for verb in commands() {
            let subjects = verb.get_positionals().count();
            let most = if verb.get_name() == "push" { 2 } else { 1 };
            assert!(subjects <= most, "{}: {subjects}", verb.get_name());
        }
    }

    #[test]
    fn an_option_has_one_meaning_in_all_verbs() {
        let mut texts: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for verb in commands().iter().filter(|verb| verb.get_name() != "dtd") {
            for option in verb.get_arguments() {
                if let (Some(name), Some(help)) = (option.get_long(), option.get_help()) {
                    texts
                        .entry(name.to_owned())
                        .or_default()
                        .insert(help.to_string());
                }
            }
        }
        for (name, texts) in texts.iter().filter(|(_, texts)| texts.len() > 1) {
            let own = OWN_WORDS.iter().find(|(option, _)| option == name);
            let shared = own.map(|(_, words)| *words);
            let has_it = |text: &String| shared.is_some_and(|words| text.contains(words));
            assert!(texts.iter().all(has_it), "--{name}: {texts:#?}");
        }
    }
}
