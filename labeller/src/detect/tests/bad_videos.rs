//! Videos that do not match the tables are named in an error, and no tables are written.

use dataset::numbers::frame_rate::FrameRate;
use dataset::video::{VideoSettings, VideoWriter};

use super::*;

/// Spoils the first of two scenarios; the second one is searched nevertheless.
fn reason_after(spoil: impl FnOnce(&ScenarioFolder)) -> String {
    let (corpus, _root) = corpus(&["0001-a", "0002-b"]);
    let folder = corpus.scenario("0001-a");
    spoil(&folder);
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
fn a_video_that_is_not_what_tables_and_seal_say_is_refused_with_view_and_tick() {
    let other_timestamps = |folder: &ScenarioFolder| {
        let mut frames = folder.open().unwrap().frames().unwrap();
        frames.rows[2].views[1].pts += 1;
        frames.write(&folder.frames_path()).unwrap();
    };
    type Change<'a> = &'a dyn Fn(&ScenarioFolder);
    let cases: [(Change<'_>, &[&str]); 4] = [
        (
            &|folder| write_video(folder, 2),
            &[
                "view right: at tick 2 expected an image with timestamp 2, found the end of the video",
                "generate the scenario again",
            ],
        ),
        (
            &|folder| write_video(folder, 4),
            &["view right: after the last tick there is an image with timestamp 3"],
        ),
        (
            &other_timestamps,
            &["view right: at tick 2 expected an image with timestamp 3, found"],
        ),
        (
            &|folder| fs::remove_file(folder.video_path("right")).unwrap(),
            &["has no sealed video of view right"],
        ),
    ];
    for (spoil, words) in cases {
        let reason = reason_after(|folder| {
            spoil(folder);
            seal_folder(folder.root(), "config").unwrap();
        });
        for word in words {
            assert!(reason.contains(word), "{word} in {reason}");
        }
    }
    let unsealed = reason_after(|folder| {
        fs::copy(folder.video_path("left"), folder.video_path("right")).unwrap();
    });
    assert!(
        unsealed.contains("right.mp4: does not match its seal"),
        "{unsealed}"
    );
}
