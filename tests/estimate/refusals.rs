//! Refused inputs and outputs, with remedies.

use std::fs;

use serde_json::Value;
use testkit::command::{Ending, said, text};
use testkit::files::copy_folder;

use crate::workshop::{DTD, VIEWS, Workshop, ffmpeg};

#[test]
fn what_can_never_work_is_refused_with_what_to_do() {
    let workshop = Workshop::shared();
    let source = workshop.source();
    let run = workshop.run();
    let no_video = workshop.folder.path().join("words.mp4");
    fs::write(&no_video, "these are words").unwrap();
    let small = workshop.folder.path().join("small.mp4");
    ffmpeg(&["-f", "lavfi", "-i", "testsrc2=s=640x480:d=1", text(&small)]);
    let no_streams = workshop.folder.path().join("words.sdp");
    fs::write(&no_streams, "these are words").unwrap();
    let no_offsets = workshop.folder.path().join("words.json");
    fs::write(&no_offsets, "these are words").unwrap();
    let of = |view: &str, source: &str| format!("{view}={source}");
    let [left, right] = VIEWS.map(|view| of(view, &source));
    let cases: &[(&[&str], &str)] = &[
        (&["--view", &left], "--without right"),
        (
            &["--view", &left, "--view", &of("tower", &source)],
            "its views are left, right",
        ),
        (
            &["--view", &left, "--view", &left, "--view", &right],
            "given twice",
        ),
        (
            &["--view", &left, "--view", &of("right", "missing.mp4")],
            "missing.mp4",
        ),
        (
            &["--view", &left, "--view", &of("right", text(&no_video))],
            "not an intact video file",
        ),
        (
            &["--view", &left, "--view", &of("right", text(&no_streams))],
            "words.sdp",
        ),
        (
            &["--view", &left, "--view", &right, "--offset", "right=soon"],
            "expected seconds, or auto",
        ),
        (
            &["--view", &left, "--view", &right, "--offset", "left=auto"],
            "compared with the first one",
        ),
        (
            &[
                "--view",
                &left,
                "--view",
                &right,
                "--keep-offsets",
                text(&no_offsets),
            ],
            "words.json",
        ),
        (
            &[
                "--view",
                &of("left", text(&small)),
                "--view",
                &of("right", text(&small)),
            ],
            "views left and right have the same source",
        ),
        (
            &["--view", &left, "--view", &of("right", text(&small))],
            "640x480 pixels, expected 960x640",
        ),
        (
            &[
                "--view",
                &left,
                "--view",
                &of("right", "rtsp://me:secret@host/x"),
            ],
            "DTD_PASSWORD",
        ),
        (
            &[
                "--view",
                &left,
                "--view",
                &of("right", "rtsp://host/x"),
                "--as-fast-as-possible",
            ],
            "is a camera",
        ),
        (
            &["--view", &left, "--view", &right, "--insecure-tls", "tower"],
            "no such view",
        ),
        (
            &["--view", &left, "--view", &right, "--without", "right"],
            "leave one of them out",
        ),
        (
            &["--view", &left, "--view", &right, "--offset", "tower=1"],
            "no such view",
        ),
        (
            &["--view", &left, "--view", &right, "--offset", "left=1e300"],
            "expected -3600 to 3600",
        ),
        (
            &[
                "--view",
                &left,
                "--view",
                &right,
                "--password-file",
                "tower=missing",
            ],
            "its views are left, right",
        ),
    ];
    for (arguments, expected) in cases {
        let output = DTD
            .command(&["estimate", text(&run)])
            .args(*arguments)
            .output()
            .unwrap();
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(
            said.contains(expected) && !said.contains("secret"),
            "{arguments:?}: {said}"
        );
        assert!(!String::from_utf8_lossy(&output.stdout).contains("dtd_m"));
    }
}

#[test]
fn a_run_that_is_not_what_the_training_wrote_is_refused() {
    let workshop = Workshop::shared();
    let source = workshop.source();
    let other = workshop.folder.path().join("other-run");
    copy_folder(&workshop.run(), &other);
    let described = fs::read_to_string(other.join("run.json")).unwrap();
    let mut described: Value = serde_json::from_str(&described).unwrap();
    described["format"] = 1.into();
    fs::write(other.join("run.json"), described.to_string()).unwrap();
    let [left, right] = VIEWS.map(|view| format!("{view}={source}"));
    let arguments = ["estimate", text(&other), "--view", &left, "--view", &right];
    DTD.ends_with(&arguments, 2, &["other-run"]);
}

#[cfg(target_os = "linux")]
#[test]
fn an_output_that_is_full_is_a_failure() {
    let workshop = Workshop::shared();
    let source = workshop.source();
    workshop
        .command([&source, &source])
        .arg("--as-fast-as-possible")
        .stdout(fs::File::create("/dev/full").unwrap())
        .ends_with(1, &["No space"]);
}

#[test]
fn a_port_in_use_is_refused() {
    let workshop = Workshop::shared();
    let source = workshop.source();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    workshop
        .command([&source, &source])
        .args(["--metrics", &address])
        .ends_with(2, &[&address]);
}

#[test]
fn a_camera_that_is_not_plugged_in_is_named_by_the_check() {
    let workshop = Workshop::shared();
    let source = workshop.source();
    let mut command = workshop.command([&source, "/dev/video97"]);
    command
        .arg("--check")
        .ends_with(1, &["/dev/video97", "No such file"]);
}
