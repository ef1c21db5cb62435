//! `dtd verify` of a corpus in which one view is late by a fraction of a tick, as its stand-in was told: tables, echoes and labels agree
//! with each other, and only the images show it.

use std::fs;
use std::path::Path;

use dataset::corpus::Corpus;
use testkit::command::{Dtd, text};
use testkit::sweep::{SmallSweep, starting_from};
use verify::verify;

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
const CLEAR: &str = "\n[weather.clear]\nvisibility_m = 80000\n";

/// Records a short approach with two cameras, which have these faults, and labels it.
fn record(folder: &Path, faults: &str) -> Corpus {
    let sweep = SmallSweep {
        name: "late",
        seed: 4,
        weathers: &["clear"],
        repeats: 1,
        size_px: (960, 640),
        frame_rate: "1/2",
        tables: &(starting_from(3.5, 3.5, 330) + CLEAR),
    };
    let file = folder.join("sweep.toml");
    fs::write(&file, sweep.toml()).unwrap();
    let stand_in = DTD.serve(&[
        "mock-xplane",
        "--no-beacon",
        "--quirks=none",
        "--faults",
        faults,
    ]);
    let root = folder.join("corpus");
    for arguments in [
        &[
            "generate",
            text(&file),
            "--out",
            text(&root),
            "--sim",
            stand_in.udp(),
        ][..],
        &["label", text(&root)],
    ] {
        DTD.succeeds(arguments);
    }
    stand_in.end();
    Corpus::open(&root).unwrap()
}

#[test]
fn a_view_that_is_late_by_a_fifth_of_a_tick_is_a_fault_in_milliseconds_and_metres() {
    let folder = tempfile::tempdir().unwrap();
    let report = verify(&record(folder.path(), "late=1:450"));
    let [first, finding] = &report.findings[..] else {
        panic!("{:#?}", report.findings);
    };
    // The first image is of the time before the flight.
    assert_eq!((first.view.as_deref(), first.row), (Some("right"), Some(0)));
    println!("{finding}");
    assert_eq!(finding.view.as_deref(), Some("right"));
    assert!(finding.message.contains(" ms late"), "{finding}");
    let late = |view: &str| {
        let mut proofs = report.views.iter();
        let proof = proofs.find(|proof| proof.view == view).unwrap();
        (proof.lag_ms.unwrap(), proof.lag_error_ms.unwrap())
    };
    let ((left_ms, left_error_ms), (right_ms, right_error_ms)) = (late("left"), late("right"));
    assert!(left_ms.abs() < 3.0 * left_error_ms, "{:#?}", report.views);
    assert!(
        (right_ms - 450.0).abs() < 3.0 * right_error_ms,
        "{:#?}",
        report.views
    );
}
