//! Frames that the simulator draws for each picture of a recording off the screen: `cargo run --release -p dtd-generator --example blocks`.
//!
//! The stand-in hosts the plugin, shows 60 frames a second on an X server (Xvfb) and draws the scene 0 to 4 frames behind. A clear and a
//! stormy flight are recorded at 30 pictures a second from two views. Frames are counted from the moment at which the flight is known to
//! the last picture, so that settling and probes are included; the check of the window before and after is not, nor is the trial before
//! the first scenario. Arguments: width and height of the pictures (480 320) and the largest lag (4).

use std::env;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

use dataset::corpus::Corpus;
use generator::generate::{Cancel, Event, GenerateOptions, Patience, SimulatorTarget, generate};
use generator::shard::Shard;
use generator::sweep::Sweep;
use mock_xplane::server::{FramesDrawn, LinkServer, PluginOptions, SceneBehind, ServerOptions};
use mock_xplane::window::{DisplayWindow, X11Window};
use serde_json::json;
use testkit::repository;
use testkit::sweep::SmallSweep;
use testkit_simulator::{Xvfb, quiet, serving};
use xplane_bridge::LocalUdp;
use xplane_bridge::datarefs::Generation;
use xplane_bridge::pixels::{FfmpegScreen, PixelChoice};

/// Of a screen.
const FRAMES_PER_S: f64 = 60.0;
/// On each side of the picture.
const MARGIN_PX: u32 = 16;
const TABLES: &str = r#"
[start]
dtd_nm = { min = 1.0, max = 1.0 }
cross_track_m = { mean = 0, sd = 20 }
speed_mps = 72
profiles = ["short"]

[profile.short]
kind = "glide_path"
level_altitude_msl_m = 200

[[recorded]]
files = "flights/01_calm_ils.csv"
weathers = ["clear", "stormy"]

[weather.clear]
visibility_m = 30000

[weather.stormy]
visibility_m = 20000
rain_ratio = 0.8
clouds = [{ kind = "cumulonimbus", cover_ratio = 0.9, base_msl_m = 1000, top_msl_m = 9000 }]
"#;

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let numbers: Vec<u32> = env::args()
        .skip(1)
        .map(|text| text.parse())
        .collect::<Result<_, _>>()?;
    let number = |at: usize, default: u32| numbers.get(at).copied().unwrap_or(default);
    let size_px = (number(0, 480), number(1, 320));
    for lag in 0..=number(2, 4) as usize {
        for recorded in record(size_px, lag).await? {
            println!("{recorded}");
        }
    }
    Ok(())
}

/// Records two scenarios of each weather and returns the figures of the second ones.
async fn record(
    (width_px, height_px): (u32, u32),
    lag: usize,
) -> Result<Vec<serde_json::Value>, Box<dyn Error>> {
    let window_px = (width_px + 2 * MARGIN_PX, height_px + 2 * MARGIN_PX);
    let xvfb = Xvfb::start(&format!("{}x{}x24", window_px.0, window_px.1));
    let window = X11Window::open(Some(xvfb.display()), window_px)?;
    let frames = FramesDrawn::default();
    let address = serving(ServerOptions {
        generation: Generation::XPlane12,
        link: LinkServer::Plugin(PluginOptions {
            most_frames_per_s: Some(FRAMES_PER_S),
            scene_behind: Some(SceneBehind::Constant(lag)),
            frames_drawn: frames.clone(),
            ..testkit_simulator::plugin::options(window_px)
        }),
        stage: Some(Arc::new(window) as Arc<dyn DisplayWindow>),
        ..quiet()
    })
    .await;
    let toml = SmallSweep {
        name: "blocks",
        seed: 0,
        weathers: &["clear", "stormy"],
        repeats: 2,
        size_px: (width_px, height_px),
        frame_rate: "30/1",
        tables: TABLES,
    }
    .toml();
    let sweep = Sweep::parse(
        Path::new("blocks.toml"),
        &repository().join("tests/data"),
        toml,
    )?;
    let folder = tempfile::tempdir()?;
    let options = GenerateOptions {
        simulators: SimulatorTarget::Address(address).into(),
        local_udp: LocalUdp::default(),
        stand_in_program: PathBuf::from("unused"),
        pixels: PixelChoice::Auto,
        encoder: None,
        screen: Arc::new(FfmpegScreen::of_display(xvfb.display())),
        only: Vec::new(),
        shard: Shard::WHOLE,
        patience: Patience::default(),
        restart: None,
        remote: None,
    };
    let (from, to) = (AtomicU64::new(0), AtomicU64::new(0));
    let mut began = Instant::now();
    let mut found = Vec::new();
    let mut listen = |event: Event<'_>| match event {
        Event::Flown { .. } => {
            from.store(frames.get(), Relaxed);
            began = Instant::now();
        }
        Event::Captured { .. } => to.store(frames.get(), Relaxed),
        Event::Committed { id, ticks, .. } => {
            let drawn = to.load(Relaxed) - from.load(Relaxed);
            let pictures = 2 * u64::from(ticks);
            found.push((
                id.to_owned(),
                drawn,
                pictures,
                began.elapsed().as_secs_f64(),
            ));
        }
        _ => {}
    };
    let outcome = generate(&sweep, folder.path(), &options, &Cancel::new(), &mut listen).await?;
    if !outcome.failed.is_empty() {
        return Err(format!("{:?}", outcome.failed).into());
    }
    let corpus = Corpus::open(folder.path())?;
    found
        .into_iter()
        .filter(|(id, ..)| id.ends_with("r2"))
        .map(|(id, drawn, pictures, seconds)| {
            let record: serde_json::Value =
                serde_json::from_slice(&fs::read(corpus.scenario(&id).record_path())?)?;
            Ok(json!({
                "scenario": id, "frames_behind": lag, "pictures": pictures,
                "frames_per_picture": drawn as f64 / pictures as f64,
                "pictures_per_s": pictures as f64 / seconds,
                "blocks": record["blocks"],
            }))
        })
        .collect()
}
