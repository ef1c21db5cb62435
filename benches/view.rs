//! How fast `dtd view` is in Chromium, beside what Chromium itself needs for the same videos, in one run:
//! `cargo bench --bench view [-- FOLDER]`.
//!
//! The corpus has 100 scenarios of about 7,700 ticks with detections and registrations (`testkit::synthetic`), the first of them with two
//! videos of 1920x1280: images of the stand-in's renderer, coded as `dtd generate` does and repeated until each tick has one. It is made
//! in FOLDER, and used again if it is there. `benches/view/in_chromium.py` measures. Needs ffmpeg, Chromium and Playwright
//! (scripts/setup.sh).

#[path = "video/scenery.rs"]
mod scenery;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use dataset::corpus::seal::seal_folder;
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::video::{VideoSettings, VideoWriter};
use scenery::{HEIGHT_PX, Scenery, WIDTH_PX, cloudy};
use testkit::command::Dtd;
use testkit::synthetic::SyntheticCorpus;
use testkit::{program_of_venv, repository};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
/// Images that are drawn: two groups that begin with a keyframe.
const DRAWN: u32 = 120;
/// The scenario that gets videos.
const WATCHED: &str = "0000";

fn main() {
    let given = std::env::args_os()
        .skip(1)
        .find(|argument| argument != "--bench");
    let kept = tempfile::tempdir().expect("a folder for the corpus");
    let root = given.map_or(kept.path().join("corpus"), PathBuf::from);
    if !root.join("splits.json").exists() {
        write(&root);
    }
    let server = DTD.serve(&["view", root.to_str().expect("a name in UTF-8"), "--no-open"]);
    let measured = Command::new(program_of_venv("python"))
        .arg(repository().join("benches/view/in_chromium.py"))
        .arg(format!("http://{}/", server.address("address")))
        .arg(WATCHED)
        .status()
        .expect("Python of the repository's environment");
    assert!(measured.success());
}

fn write(root: &Path) {
    let corpus = SyntheticCorpus::full().write(root).expect("a corpus");
    add_videos(&corpus.scenario(WATCHED));
    Corpus::open(root).expect("the corpus");
}

fn add_videos(folder: &ScenarioFolder) {
    let record = folder.open().and_then(|open| open.record());
    let record = record.expect("its record");
    let drawn = tempfile::tempdir().expect("a folder for videos");
    let path = drawn.path().join("drawn.mp4");
    let settings = VideoSettings::default();
    let writer = VideoWriter::create(&path, &settings, WIDTH_PX, HEIGHT_PX, record.frame_rate);
    let mut writer = writer.expect("a video");
    let scenery = Scenery::new(&cloudy(), 12.0);
    for number in 0..DRAWN {
        writer.write(&scenery.picture(number)).expect("an image");
    }
    writer.finish().expect("a video");
    for view in &record.views {
        let video = folder.video_path(view);
        fs::create_dir_all(video.parent().expect("a folder of videos")).expect("a folder");
        let repeats = record.ticks.div_ceil(DRAWN).to_string();
        let time_scale = record.frame_rate.numerator.to_string();
        let copied = Command::new("ffmpeg")
            .args(["-nostdin", "-loglevel", "error", "-stream_loop", &repeats])
            .arg("-i")
            .arg(&path)
            .args(["-c", "copy", "-frames:v", &record.ticks.to_string()])
            .args(["-video_track_timescale", &time_scale])
            .arg(&video)
            .status()
            .expect("ffmpeg");
        assert!(copied.success());
    }
    for name in ["DONE.json", "MANIFEST.b3"] {
        fs::remove_file(folder.root().join(name)).expect("the seal without videos");
    }
    seal_folder(folder.root(), "synthetic").expect("a seal");
}
