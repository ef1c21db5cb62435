//! Scenarios recorded in blocks off a real screen, through the plugin's own Python.
#![cfg(target_os = "linux")]

mod small_corpus;

use std::path::Path;
use std::sync::Arc;

use dataset::corpus::Corpus;
use dataset::corpus::scenario::Blocks;
use generator::generate::{Cancel, Event, GenerateOptions, SimulatorTarget, generate};
use mock_xplane::server::{LinkServer, PluginOptions, SceneBehind, ServerOptions};
use mock_xplane::window::{DisplayWindow, X11Window};
use small_corpus::{IDS, options, sweep_of, sweep_toml};
use testkit_simulator::{Xvfb, quiet, serving};
use verify::verify;
use xplane_bridge::datarefs::Generation;
use xplane_bridge::pixels::{FfmpegScreen, PixelChoice};

/// The scenario that flies a recording.
const ID: &str = IDS[1];

/// Records it with a window of this size; returns how, and what was said.
async fn record(
    folder: &Path,
    window_px: (u32, u32),
    scene_behind: usize,
    faults: &str,
) -> (Option<Blocks>, String) {
    let xvfb = Xvfb::start("160x120x24");
    let window = X11Window::open(Some(xvfb.display()), window_px).unwrap();
    let address = serving(ServerOptions {
        generation: Generation::XPlane12,
        link: LinkServer::Plugin(PluginOptions {
            scene_behind: Some(SceneBehind::Constant(scene_behind)),
            most_frames_per_s: Some(60.0),
            ..testkit_simulator::plugin::options(window_px)
        }),
        stage: Some(Arc::new(window) as Arc<dyn DisplayWindow>),
        faults: faults.parse().unwrap(),
        ..quiet()
    })
    .await;
    let options = GenerateOptions {
        pixels: PixelChoice::Auto,
        screen: Arc::new(FfmpegScreen::of_display(xvfb.display())),
        ..options(SimulatorTarget::Address(address), &[ID])
    };
    let sweep = sweep_of(&(sweep_toml() + "\n[video]\ncodec = \"h264-lossless\"\n"));
    let mut said = String::new();
    let mut listen = |event: Event<'_>| {
        if let Event::Said(line) | Event::Warned(line) = event {
            said += line;
            said += "\n";
        }
    };
    let outcome = generate(&sweep, folder, &options, &Cancel::new(), &mut listen).await;
    let outcome = outcome.unwrap();
    assert_eq!(outcome.committed, [ID], "{:?}", outcome.failed);
    let corpus = Corpus::open(folder).unwrap();
    let findings = verify(&corpus).findings;
    let only_missing = findings
        .iter()
        .all(|finding| finding.to_string().contains("missing"));
    assert!(only_missing, "{findings:#?}");
    let record = corpus.scenario(ID).open().unwrap().record().unwrap();
    (record.blocks, said)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_window_with_margins_is_recorded_in_blocks_and_one_without_picture_by_picture() {
    let folder = tempfile::tempdir().unwrap();
    let (blocks, said) = record(&folder.path().join("blocks"), (128, 96), 3, "").await;
    let blocks = blocks.unwrap();
    assert!(said.contains("its images were looked at now"), "{said}");
    assert_eq!((blocks.frames_behind, blocks.held_ticks), (vec![3], 0));
    assert_eq!((blocks.count, blocks.measured), (2, 2));
    let (settled, _) = record(&folder.path().join("settled"), (96, 64), 3, "").await;
    assert_eq!(settled, None);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_scene_that_moves_in_a_pause_under_repeated_numbers_is_recorded_in_blocks() {
    let folder = tempfile::tempdir().unwrap();
    let (window_px, faults) = ((128, 96), "swing=40:3:6:20,repeat=0.05");
    let (blocks, said) = record(&folder.path().join("blocks"), window_px, 1, faults).await;
    assert!(blocks.is_some(), "{said}");
}
