use super::*;

#[test]
fn a_dropped_picture_and_a_truncated_video_are_found() {
    let findings =
        Example::with(|example| write_video(&example.path("views/right.mp4"), TICKS - 1));
    assert_found(
        &findings,
        "views/right.mp4 view right: has 4 images, but scenario.json says 5 ticks",
    );
    let findings = Example::with(|example| {
        let path = example.path("views/left.mp4");
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    });
    assert_found(&findings, "views/left.mp4 view left: cannot read it");
}

#[test]
fn times_of_a_video_are_compared_whatever_its_unit_of_time() {
    let findings = Example::with(|example| {
        let path = example.path("views/left.mp4");
        let fine = path.with_extension("fine.mp4");
        let copied = std::process::Command::new("ffmpeg")
            .args(["-v", "error", "-i"])
            .arg(&path)
            .args(["-c", "copy", "-video_track_timescale", "60000"])
            .arg(&fine)
            .status()
            .expect("the ffmpeg program, which scripts/setup.sh installs");
        assert!(copied.success());
        fs::rename(fine, path).unwrap();
    });
    assert_eq!(findings, "");
    let findings = Example::with(|example| {
        let path = example.path("views/left.mp4");
        let twice_as_fast = FrameRate {
            numerator: 1,
            denominator: 1,
        };
        write_video_at(&path, TICKS, twice_as_fast);
    });
    assert_found(
        &findings,
        "row 1 view left: timestamp: is 1 in units of 1/1 s, expected 2 in units of 1/1 s",
    );
}

#[test]
fn the_sealed_video_is_looked_at_whatever_lies_beside_it() {
    let example = Example::new();
    let folder = example.scenario();
    fs::write(folder.root().join("views/left.mov"), "no video").unwrap();
    let findings = example.findings();
    assert_found(&findings, "views/left.mov is not listed in MANIFEST.b3");
    assert_eq!(findings.lines().count(), 1, "{findings}");
}
