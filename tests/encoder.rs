//! `dtd generate --encoder`: an encoder that is named is tried before anything is recorded, and recorded in `scenario.json`.
#![cfg(target_os = "linux")]

use std::fs;
use std::path::Path;
use std::process::Output;

use dataset::corpus::Corpus;
use testkit::command::{Dtd, said, text};
use testkit::sweep::four_weathers;

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
const ID: &str = "1200-clear-r1";

fn generate(folder: &Path, encoder: &str, video: &str) -> Output {
    let sweep = folder.join("sweep.toml");
    fs::write(&sweep, format!("{}\n{video}", four_weathers())).unwrap();
    let corpus = folder.join("corpus");
    let arguments = ["generate", text(&sweep), "--out", text(&corpus)];
    let more = ["--sim", "mock", "--only", ID, "--encoder", encoder];
    DTD.run(&[&arguments[..], &more].concat())
}

#[test]
fn a_software_encoder_passes_its_trial_and_is_named_in_the_record() {
    for (video, encoder) in [("", "libx264"), ("[video]\ncodec = \"h265\"\n", "libx265")] {
        let folder = tempfile::tempdir().unwrap();
        let output = generate(folder.path(), "software", video);
        let words = said(&output);
        assert_eq!(output.status.code(), Some(0), "{words}");
        assert!(
            words.contains(&format!("encoder {encoder}: 100 images")),
            "{words}"
        );
        let scenario = Corpus::open(&folder.path().join("corpus"))
            .unwrap()
            .scenario(ID);
        let record = scenario.open().unwrap().record().unwrap();
        assert_eq!(record.versions.encoder.as_deref(), Some(encoder));
    }
}

#[test]
fn an_encoder_that_cannot_work_here_is_refused_with_what_it_needs_before_anything_is_recorded() {
    for (encoder, video, reasons) in [
        (
            "videotoolbox",
            "",
            ["this FFmpeg has no encoder h264_videotoolbox", "a Mac"],
        ),
        (
            "nvenc",
            "[video]\ncodec = \"ffv1\"\n",
            ["nvenc is not offered for this codec", "h264 or h265"],
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let output = generate(folder.path(), encoder, video);
        let words = said(&output);
        assert_eq!(output.status.code(), Some(2), "{words}");
        for reason in reasons.into_iter().chain(["record without --encoder"]) {
            assert!(words.contains(reason), "{reason:?}: {words}");
        }
        assert!(!folder.path().join("corpus").exists(), "{encoder}");
    }
}
