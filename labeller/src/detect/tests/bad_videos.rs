//! Videos that do not match the tables are named in an error, and no tables are written.

use dataset::numbers::frame_rate::FrameRate;
use dataset::video::{VideoSettings, VideoWriter};

use super::*;

/// Spoils the first of two scenarios; the second one is searched nevertheless.
fn reason_after(spoil: impl FnOnce(&ScenarioFolder)) -> String {
    let (corpus, _root) = corpus(&["0001-a", "0002-b"]);
    let folder = corpus.scenario("0001-a");
    spoil(&folder);
    seal_folder(folder.root(), "config").unwrap();
    let outcome = detect(&corpus, &two_workers());
    assert_eq!(outcome.detected, ["0002-b"]);
    let written = fs::read_dir(folder.root().join("detections"));
    assert!(written.is_err(), "{:?}", written.unwrap().next());
    outcome.failed[0].reason.clone()
}

fn write_video(folder: &ScenarioFolder, ticks: u32) {
    let rate = FrameRate::new(1, 1).unwrap();
    let path = folder.video_path("right");
    let settings = VideoSettings::default();
    let mut writer = VideoWriter::create(&path, &settings, WIDTH, HEIGHT, rate).unwrap();
    let mut rgb = vec![20; (WIDTH * HEIGHT * 3) as usize];
    for tick in 0..ticks {
        paint_blob(&mut rgb, WIDTH, &blob("right", tick));
        writer.write(&rgb).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn a_video_that_ends_early_is_refused_with_the_tick_where_it_ends() {
    let reason = reason_after(|folder| write_video(folder, 2));
    assert!(
        reason.contains(
            "view right: at tick 2 expected an image with timestamp 2, found the end of the video"
        ) && reason.contains("generate the scenario again"),
        "{reason}"
    );
}

#[test]
fn a_video_that_goes_on_after_the_last_tick_is_refused() {
    let reason = reason_after(|folder| write_video(folder, 4));
    let words = "view right: after the last tick there is an image with timestamp 3";
    assert!(reason.contains(words), "{reason}");
}

#[test]
fn a_view_without_a_video_is_refused_by_name() {
    let reason = reason_after(|folder| fs::remove_file(folder.video_path("right")).unwrap());
    assert!(
        reason.contains("has no sealed video of view right"),
        "{reason}"
    );
}
