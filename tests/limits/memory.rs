//! Every verb in 2 GiB of address space: it works, or it says how much it needs.

use std::os::unix::process::ExitStatusExt;

use crate::tiny::{self, TOO_LONG, Tiny};
use testkit::command::said;

const TWO_GIB_KIB: u64 = 2 << 20;

#[test]
fn every_verb_works_in_two_gibibytes_or_says_what_it_needs() {
    let tiny = Tiny::made().copy();
    let store = tiny.store();
    let verbs: [&[&str]; 14] = [
        &["plan", "sweep.toml", "--against", "corpus"],
        &["generate", "sweep.toml", "--out", "again"],
        &["label", "again"],
        &["detect", "again", "--model", tiny::MODEL],
        &["evaluate-detector", "corpus", "--out", "judged"],
        &["verify", "corpus"],
        &testkit::command::words("train corpus --out another --config training.toml"),
        &["evaluate", "run", "--corpus", "corpus"],
        &["export-estimators", "run", "--out", "models"],
        &testkit::command::words("train-detector corpus --out detector/new.onnx --minutes 0.001"),
        &["push", "corpus", &store],
        &["fetch", &store, "--out", "fetched"],
        &["schema"],
        &testkit::command::words("mock-xplane --port 0 --no-beacon --until-stdin-ends"),
    ];
    let mut wrong = Vec::new();
    for arguments in verbs {
        let verb = arguments[0];
        let Some(output) = tiny::run(&mut tiny.dtd_within(TWO_GIB_KIB, arguments), TOO_LONG) else {
            wrong.push(format!("{verb} hangs"));
            continue;
        };
        let words = said(&output);
        let says_what_it_needs = output.status.code() == Some(2)
            && words.contains("memory")
            && ["MiB", "GiB", "MB", "GB"]
                .iter()
                .any(|unit| words.contains(unit));
        if output.status.signal().is_some()
            || words.contains("panicked")
            || !(output.status.success() || says_what_it_needs)
        {
            wrong.push(format!("{verb} ended with {}: {words}", output.status));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_detector_is_trained_in_little_memory_or_it_is_said_what_that_needs() {
    let tiny = Tiny::made().copy();
    for limit_kib in [400_000, 600_000, 900_000, 1_200_000] {
        let out = format!("within-{limit_kib}.onnx");
        let arguments = [
            "train-detector",
            "corpus",
            "--out",
            &out,
            "--minutes",
            "0.001",
        ];
        let command = &mut tiny.dtd_within(limit_kib, &arguments);
        let output = tiny::run(command, TOO_LONG).expect("it ends");
        let words = said(&output);
        let refused = output.status.code() == Some(2) && words.contains("of memory");
        assert!(
            refused || output.status.success(),
            "{limit_kib} KiB: {}: {words}",
            output.status
        );
    }
}
