//! Sources of images: the same scenario sent over the link and grabbed from a real screen, and sources that are missing.
#![cfg(target_os = "linux")]

mod small_corpus;

use std::fs;
use std::path::Path;
use std::sync::Arc;

use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::video::VideoReader;
use generator::generate::{Cancel, GenerateOptions, SimulatorTarget, generate};
use mock_xplane::server::ServerOptions;
use mock_xplane::window::{DisplayWindow, X11Window};
use serde_json::Value;
use small_corpus::{IDS, options, sweep_of, sweep_toml};
use testkit_simulator::{Xvfb, quiet, serving};
use xplane_bridge::pixels::{FfmpegScreen, PixelChoice, PixelKind};

/// The scenario that flies a recording; its images differ in every pixel of the aircraft from tick to tick.
const ID: &str = IDS[1];

/// The stand-in in this process with a window of this size, if any; it ends with the test's runtime.
async fn stand_in(display: &str, window_px: Option<(u32, u32)>) -> SimulatorTarget {
    let stage = window_px.map(|size| X11Window::open(Some(display), size).unwrap());
    let options = ServerOptions {
        stage: stage.map(|window| Arc::new(window) as Arc<dyn DisplayWindow>),
        ..quiet()
    };
    SimulatorTarget::Address(serving(options).await)
}

fn grabbing(target: SimulatorTarget, display: &str, kind: PixelKind) -> GenerateOptions {
    GenerateOptions {
        pixels: PixelChoice::Only(kind),
        screen: Arc::new(FfmpegScreen::of_display(display)),
        ..options(target, &[ID])
    }
}

/// All images in a video, with timestamps.
fn pictures(path: &Path) -> Vec<(i64, Vec<u8>)> {
    let mut reader = VideoReader::open(path).unwrap();
    let mut all = Vec::new();
    let mut rgb = Vec::new();
    while let Some(pts) = reader.next_frame(&mut rgb).unwrap() {
        all.push((pts, rgb.clone()));
    }
    all
}

fn record(folder: &ScenarioFolder) -> Value {
    serde_json::from_slice(&fs::read(folder.record_path()).unwrap()).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_scenario_grabbed_from_the_screen_is_the_one_sent_over_the_link_to_the_last_bit() {
    let xvfb = Xvfb::start("160x120x24");
    let sweep = sweep_of(&(sweep_toml() + "\n[video]\ncodec = \"h264-lossless\"\n"));
    let target = stand_in(xvfb.display(), Some((96, 64))).await;
    let corpora = [PixelKind::Link, PixelKind::Screen].map(|kind| (kind, tempfile::tempdir()));
    let mut made = Vec::new();
    for (kind, corpus) in &corpora {
        let corpus = corpus.as_ref().unwrap().path();
        let options = grabbing(target.clone(), xvfb.display(), *kind);
        let outcome = generate(&sweep, corpus, &options, &Cancel::new(), &mut |_| ()).await;
        assert_eq!(outcome.unwrap().committed, [ID], "{kind}");
        made.push(Corpus::open(corpus).unwrap().scenario(ID));
    }
    let [link, screen] = made.as_slice() else {
        panic!("{} corpora", made.len());
    };
    for path in [
        ScenarioFolder::frames_path,
        ScenarioFolder::calibration_path,
    ] {
        let [sent, grabbed] = [link, screen].map(|folder| fs::read(path(folder)).unwrap());
        assert!(sent == grabbed, "{} differs", path(link).display());
    }
    for view in ["left", "right"] {
        let [sent, grabbed] = [link, screen].map(|folder| pictures(&folder.video_path(view)));
        assert!(sent.len() > 10, "{} images", sent.len());
        assert!(sent == grabbed, "images of view {view} differ");
        let different = sent.windows(2).filter(|pair| pair[0].1 != pair[1].1);
        assert!(
            different.count() > 5,
            "the images of view {view} stand still"
        );
    }
    let [mut of_link, mut of_screen] = [link, screen].map(record);
    assert_eq!(of_link["versions"]["pixels"].take(), "link");
    assert_eq!(of_screen["versions"]["pixels"].take(), "screen");
    assert_eq!(of_link, of_screen);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_source_that_the_simulator_cannot_serve_is_refused_before_anything_is_written() {
    let xvfb = Xvfb::start("160x120x24");
    let sweep = sweep_of(&sweep_toml());
    let folder = tempfile::tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    let without = stand_in(xvfb.display(), None).await;
    let small = stand_in(xvfb.display(), Some((80, 60))).await;
    // Simulator, source, whether the same call would always fail again, words of the message.
    let cases = [
        (&without, PixelKind::Gl, true, ["--pixels gl", "only link"]),
        (
            &without,
            PixelKind::Screen,
            true,
            ["--pixels screen", "only link"],
        ),
        (&small, PixelKind::Screen, false, ["80x60", "96x64"]),
    ];
    for (target, kind, bad_input, words) in cases {
        let options = grabbing(target.clone(), xvfb.display(), kind);
        let refused = generate(&sweep, &corpus, &options, &Cancel::new(), &mut |_| ()).await;
        let error = refused.unwrap_err();
        let text = error.to_string();
        for word in words {
            assert!(text.contains(word), "no {word:?} in {text}");
        }
        assert_eq!(error.is_bad_input(), bad_input, "{text}");
        assert!(!corpus.exists(), "something was written: {text}");
    }
}
