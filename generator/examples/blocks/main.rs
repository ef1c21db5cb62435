//! Recording in blocks off the screen, with the stand-in that hosts the plugin and shows its frames on an X server (Xvfb).
//!
//! `cargo run --release -p dtd-generator --example blocks -- frames` counts the frames that the simulator draws per image, at 60 frames a
//! second and with the scene 0 to 4 frames behind. A clear and a stormy flight are recorded at 30 images per second from two views. Frames
//! are counted from the known flight to the last image, so that settling and probes are included; the check of the window before and after
//! is not, nor is the trial before the first scenario. Arguments: width and height of the images (480 320), the first and the last lag (0
//! 4), and faults of the simulator, such as `repeat=0.001`.
//!
//! `-- codes` records two clear flights whose frames show wrong numbers, and counts the images that differ from an undisturbed recording.
//! Arguments: width and height (480 320).
//!
//! `-- covers` puts something over the scene for a second in mid recording, in scenarios of four weathers: `covers.rs`. Arguments:
//! scenarios of each weather (25), a seed (0), and a JSON file to which the figures are added, else they are printed.
//!
//! `-- moving` records scenes that move slowly in a pause: 40 and 80 things of 6 pixels that swing in one to three seconds, of 8, 20 and 60
//! levels, in windows with margins and without. Arguments: width and height (480 320).
//!
//! `-- plan` compares the time that `dtd plan --sim` expects, after the doctor measured the simulator, with the time that `dtd generate`
//! takes: two flights from two views, by blocks, with one number in twenty repeated, and in a scene that moves all over, whose images are
//! all settled. Arguments: width and height (480 320).

mod codes;
mod covers;

use std::env;
use std::error::Error;
use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use dataset::corpus::Corpus;
use dataset::video::VideoReader;
use generator::generate::{Cancel, Event, GenerateOptions, SimulatorTarget, generate};
use generator::plan::{Estimate, Pacing, expand};
use generator::sweep::Sweep;
use mock_xplane::server::{
    FramesDrawn, LinkServer, PluginOptions, SceneBehind, ServerOptions, WindowCovers,
};
use mock_xplane::window::{DisplayWindow, X11Window};
use serde_json::json;
use testkit::repository;
use testkit::sweep::{SmallSweep, starting_from};
use testkit_simulator::{Running, Xvfb, quiet};
use xplane_bridge::Simulator;
use xplane_bridge::datarefs::Generation;
use xplane_bridge::doctor::{DoctorOptions, Intent, examine};
use xplane_bridge::link::PictureSize;
use xplane_bridge::pixels::{FfmpegScreen, Screen};

/// Refresh rate of the screen.
const FRAMES_PER_S: f64 = 60.0;
/// Margin on each side of the image.
const MARGIN_PX: u32 = 16;
/// Name of the corpus of [`Recording::record`].
const CORPUS: &str = "corpus";
const WEATHERS: [&str; 2] = ["clear", "stormy"];
const CLEAR_AND_STORMY: &str = r#"
[weather.clear]
visibility_m = 30000

[weather.stormy]
visibility_m = 20000
rain_ratio = 0.8
clouds = [{ kind = "cumulonimbus", cover_ratio = 0.9, base_msl_m = 1000, top_msl_m = 9000 }]
"#;

/// The tables of a recorded flight in these weathers.
fn recorded_in(weathers: &[&str]) -> String {
    format!(
        "\n[[recorded]]\nfiles = \"flights/01_calm_ils.csv\"\nweathers = {weathers:?}\n{CLEAR_AND_STORMY}"
    )
}

/// Two flights in each of these weathers from a distance.
fn sweep(size_px: (u32, u32), dtd_nm: f64, weathers: &[&str]) -> String {
    SmallSweep {
        name: "blocks",
        seed: 0,
        weathers,
        repeats: 2,
        size_px,
        frame_rate: "30/1",
        tables: &(starting_from(dtd_nm, dtd_nm, 200) + &recorded_in(weathers)),
    }
    .toml()
}

fn parsed(toml: String) -> Result<Sweep, Box<dyn Error>> {
    let folder = repository().join("tests/data");
    Ok(Sweep::parse(Path::new("blocks.toml"), &folder, toml)?)
}

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let what = arguments.first().map_or("", String::as_str);
    let number = |at: usize, default: u32| match arguments.get(at + 1) {
        Some(text) => text.parse().map_err(|error| format!("{text:?}: {error}")),
        None => Ok(default),
    };
    match what {
        "frames" => {
            let lags = number(2, 0)? as usize..=number(3, 4)? as usize;
            let faults = arguments.get(5).map_or("", String::as_str);
            frames((number(0, 480)?, number(1, 320)?), lags, faults).await
        }
        "codes" => codes::codes((number(0, 480)?, number(1, 320)?)).await,
        "plan" => plan((number(0, 480)?, number(1, 320)?)).await,
        "moving" => moving((number(0, 480)?, number(1, 320)?)).await,
        "covers" => {
            let file = arguments.get(3).map(Path::new);
            covers::covers(number(0, 25)?, number(1, 0)?, file).await
        }
        _ => Err("expected `frames`, `moving`, `codes`, `plan` or `covers`".into()),
    }
}

async fn frames(
    size_px: (u32, u32),
    lags: RangeInclusive<usize>,
    faults: &str,
) -> Result<(), Box<dyn Error>> {
    for lag in lags {
        let recording = Recording::start(size_px, MARGIN_PX, lag, faults).await?;
        for recorded in recording.record(0.5, &WEATHERS).await? {
            let pictures = recorded.pictures as f64;
            println!(
                "{}",
                json!({
                    "scenario": recorded.id, "frames_behind": lag, "faults": faults,
                    "pictures": recorded.pictures,
                    "frames_per_picture": recorded.frames as f64 / pictures,
                    "pictures_per_s": pictures / recorded.seconds,
                    "blocks": recorded.blocks,
                })
            );
        }
    }
    Ok(())
}

async fn moving(size_px: (u32, u32)) -> Result<(), Box<dyn Error>> {
    for (margin_px, things, levels) in [MARGIN_PX, 0]
        .into_iter()
        .flat_map(|margin_px| [40, 80].map(|things| (margin_px, things)))
        .flat_map(|(margin_px, things)| [8, 20, 60].map(|levels| (margin_px, things, levels)))
    {
        let faults = format!("swing={things}:3:6:{levels}");
        let recording = Recording::start(size_px, margin_px, 0, &faults).await?;
        for recorded in recording.record(0.5, &WEATHERS[..1]).await? {
            println!(
                "{}",
                json!({
                    "things": things, "levels": levels, "margin_px": margin_px,
                    "pictures": recorded.pictures,
                    "frames_per_picture": recorded.frames as f64 / recorded.pictures as f64,
                    "blocks": recorded.blocks,
                })
            );
        }
    }
    Ok(())
}

async fn plan(size_px: (u32, u32)) -> Result<(), Box<dyn Error>> {
    // Settled images take long.
    for (faults, dtd_nm) in [("", 2.0), ("repeat=0.05", 2.0), ("swing=3000:3:6:150", 1.0)] {
        let recording = Recording::start(size_px, MARGIN_PX, 1, faults).await?;
        let address = recording.simulator.addresses.udp;
        let doctor = DoctorOptions {
            screen: recording.screen.clone(),
            intent: Some(Intent {
                sweep: "blocks.toml".into(),
                pictures: PictureSize {
                    width_px: size_px.0,
                    height_px: size_px.1,
                },
            }),
            ..DoctorOptions::at(Some(address))
        };
        examine(&doctor, &mut |_| {}).await;
        let simulator = Simulator::connect(address, Duration::from_secs(60)).await?;
        let profile = simulator.profile().current().cloned().map(Box::new);
        simulator.release().await?;
        let toml = sweep(size_px, dtd_nm, &WEATHERS[..1]);
        let planned = expand(&parsed(toml.clone())?);
        let pacing = Pacing::XPlane(profile);
        let estimate = Estimate::new(&planned.common, &planned.scenarios, &pacing, None);
        let began = Instant::now();
        let corpus = recording.generate(CORPUS, toml, &mut |_| {}).await?;
        let took_s = began.elapsed().as_secs_f64();
        let record = corpus.scenarios()?[0].open()?.record()?;
        let expected_s = 3_600.0 * estimate.making_h;
        println!(
            "{}",
            json!({
                "faults": faults, "pictures": estimate.pictures, "basis": estimate.durations.pictures_basis,
                "expected_s": expected_s, "took_s": took_s, "expected_over_took": expected_s / took_s,
                "blocks": record.blocks,
            })
        );
    }
    Ok(())
}

/// A simulator with its screen, and a folder for the corpus.
struct Recording {
    size_px: (u32, u32),
    /// Aborted before its screen ends.
    simulator: Running,
    xvfb: Xvfb,
    screen: Arc<dyn Screen>,
    frames: FramesDrawn,
    covers: WindowCovers,
    folder: tempfile::TempDir,
}

struct Recorded {
    id: String,
    frames: u64,
    pictures: u64,
    seconds: f64,
    blocks: serde_json::Value,
}

impl Recording {
    async fn start(
        size_px: (u32, u32),
        margin_px: u32,
        lag: usize,
        faults: &str,
    ) -> Result<Self, Box<dyn Error>> {
        let window_px = (size_px.0 + 2 * margin_px, size_px.1 + 2 * margin_px);
        let xvfb = Xvfb::start(&format!("{}x{}x24", window_px.0, window_px.1));
        let window = X11Window::open(Some(xvfb.display()), window_px)?;
        let (frames, covers) = (FramesDrawn::default(), WindowCovers::default());
        let simulator = Running::start(ServerOptions {
            generation: Generation::XPlane12,
            link: LinkServer::Plugin(PluginOptions {
                most_frames_per_s: Some(FRAMES_PER_S),
                scene_behind: Some(SceneBehind::Constant(lag)),
                frames_drawn: frames.clone(),
                window_covers: covers.clone(),
                ..testkit_simulator::plugin::options(window_px)
            }),
            stage: Some(Arc::new(window) as Arc<dyn DisplayWindow>),
            faults: faults.parse()?,
            ..quiet()
        })
        .await;
        Ok(Self {
            size_px,
            simulator,
            screen: Arc::new(FfmpegScreen::of_display(xvfb.display())),
            xvfb,
            frames,
            covers,
            folder: tempfile::tempdir()?,
        })
    }

    /// Records a sweep into a folder of this name.
    async fn generate(
        &self,
        name: &str,
        toml: String,
        listen: &mut (dyn FnMut(Event<'_>) + Send),
    ) -> Result<Corpus, Box<dyn Error>> {
        let sweep = parsed(toml)?;
        let simulator = SimulatorTarget::Address(self.simulator.addresses.udp);
        let options = GenerateOptions {
            screen: self.screen.clone(),
            ..GenerateOptions::new(simulator)
        };
        let folder = self.folder.path().join(name);
        let outcome = generate(&sweep, &folder, &options, &Cancel::new(), listen).await?;
        if !outcome.failed.is_empty() {
            return Err(format!("{:?}", outcome.failed).into());
        }
        Ok(Corpus::open(&folder)?)
    }

    /// Records two scenarios of each weather from a distance, and returns the second ones: before the first one, a trial compares blocks
    /// with settled images.
    async fn record(
        &self,
        dtd_nm: f64,
        weathers: &[&str],
    ) -> Result<Vec<Recorded>, Box<dyn Error>> {
        let toml = sweep(self.size_px, dtd_nm, weathers);
        let (mut from, mut to) = (0, 0);
        let mut began = Instant::now();
        let mut recorded = Vec::new();
        let mut listen = |event: Event<'_>| match event {
            Event::Flown { .. } => {
                from = self.frames.get();
                began = Instant::now();
            }
            Event::Captured { .. } => to = self.frames.get(),
            Event::Committed { id, ticks, .. } => recorded.push(Recorded {
                id: id.to_owned(),
                frames: to - from,
                pictures: 2 * u64::from(ticks),
                seconds: began.elapsed().as_secs_f64(),
                blocks: json!(null),
            }),
            _ => {}
        };
        let corpus = self.generate(CORPUS, toml, &mut listen).await?;
        recorded.retain(|recorded| recorded.id.ends_with("r2"));
        for recorded in &mut recorded {
            let record = corpus.scenario(&recorded.id).open()?.record()?;
            recorded.blocks = serde_json::to_value(record.blocks)?;
        }
        Ok(recorded)
    }
}

/// Images of a scenario, of all views, that differ from the expected ones.
fn unlike(
    expected: &Corpus,
    found: &Corpus,
    id: &str,
    differs: impl Fn(&[u8], &[u8]) -> bool,
) -> Result<u32, Box<dyn Error>> {
    let [expected, found] = [expected.scenario(id), found.scenario(id)];
    let mut unlike = 0;
    for view in &found.open()?.record()?.views {
        let mut videos = [
            VideoReader::open(&expected.video_path(view))?,
            VideoReader::open(&found.video_path(view))?,
        ];
        let [mut one, mut other] = [Vec::new(), Vec::new()];
        loop {
            let [expected, found] = &mut videos;
            let images = (
                expected.next_frame(&mut one)?,
                found.next_frame(&mut other)?,
            );
            match images {
                (None, None) => break,
                (Some(_), Some(_)) => unlike += u32::from(differs(&one, &other)),
                _ => return Err(format!("{id}: {view} has not as many images").into()),
            }
        }
    }
    Ok(unlike)
}
