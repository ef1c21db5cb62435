//! Compares recording from end to end with encoding alone: `cargo run --release -p dtd-generator --example throughput`.
//!
//! The stand-in, in this process, flies the last nautical miles of an approach; its two views of 1920x1280 are drawn, sent, encoded
//! and committed with their tables, as in `dtd generate`. Then the same images are drawn again and only encoded, one thread per
//! view, and only the encoding is timed; byte-identical videos prove that it was the same work. Rounds alternate. Arguments: a
//! weather (`clear`, `cloudy`, `stormy` or `foggy`; default cloudy), the number of rounds (3), and from how many nautical miles the
//! approach is recorded (2): the longer it is, the less one-time work such as preparing the backdrops matters; in a corpus it is
//! done once for all scenarios of a weather and time.

use std::error::Error;
use std::fs;
use std::net::Ipv4Addr;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use dataset::conditions::Weather;
use dataset::corpus::Corpus;
use dataset::geometry::camera::Camera;
use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::video::{VideoSettings, VideoWriter};
use generator::generate::{Cancel, Event, GenerateOptions, SimulatorTarget, generate};
use generator::sweep::Sweep;
use mock_xplane::server::{
    BuiltIn, Engine, Instants, NotFlown, SceneRenderer, SceneSetting, ServerOptions, serve_with,
};
use testkit::processor_time;
use xplane_bridge::fly::FlyRequest;

/// Ticks that are drawn before they are encoded when encoding is timed alone. Limits memory: 14.7 MB a tick.
const TICKS_AT_ONCE: usize = 16;
/// Targets: share of the rate of encoding alone, and images per second.
const GOAL: (f64, f64) = (0.7, 45.0);

/// The stand-in's engine, remembering what it draws.
#[derive(Default)]
struct Remembering {
    scenes: Mutex<Vec<(Camera, Arc<dyn SceneRenderer>)>>,
    drawn: Arc<Mutex<Vec<Drawn>>>,
}

/// Content of an image.
#[derive(Clone, Copy)]
struct Drawn {
    scene: usize,
    pose: Pose,
    controls: Controls,
    instants: Instants,
}

struct RememberedScene {
    number: usize,
    scene: Arc<dyn SceneRenderer>,
    drawn: Arc<Mutex<Vec<Drawn>>>,
}

impl Engine for Remembering {
    fn fly(&self, request: &FlyRequest, weather: &Weather) -> Result<Vec<FlightState>, NotFlown> {
        BuiltIn.fly(request, weather)
    }

    fn prepare(&self, setting: &SceneSetting<'_>) -> Box<dyn SceneRenderer> {
        let scene = BuiltIn.prepare(setting);
        let scene: Arc<dyn SceneRenderer> = scene.into();
        let mut scenes = self.scenes.lock().unwrap_or_else(PoisonError::into_inner);
        scenes.push((*setting.camera, scene.clone()));
        Box::new(RememberedScene {
            number: scenes.len() - 1,
            scene,
            drawn: self.drawn.clone(),
        })
    }
}

impl SceneRenderer for RememberedScene {
    fn draw(&self, pose: &Pose, controls: &Controls, instants: Instants, rgb: &mut [u8]) {
        let drawn = Drawn {
            scene: self.number,
            pose: *pose,
            controls: *controls,
            instants,
        };
        let mut all = self.drawn.lock().unwrap_or_else(PoisonError::into_inner);
        all.push(drawn);
        drop(all);
        self.scene.draw(pose, controls, instants, rgb);
    }
}

/// The cost of some work.
#[derive(Debug, Clone, Copy, Default)]
struct Cost {
    wall: Duration,
    /// Processor time of all threads.
    cpu: Duration,
}

impl Cost {
    /// Of everything since the process started.
    fn so_far(began: Instant) -> Self {
        Self {
            wall: began.elapsed(),
            cpu: processor_time::own_and_children()[0],
        }
    }

    fn since(self, before: Self) -> Self {
        Self {
            wall: self.wall - before.wall,
            cpu: self.cpu.saturating_sub(before.cpu),
        }
    }

    fn plus(self, other: Self) -> Self {
        Self {
            wall: self.wall + other.wall,
            cpu: self.cpu + other.cpu,
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let weather = arguments.next().unwrap_or_else(|| "cloudy".into());
    let rounds: u32 = arguments.next().map_or(Ok(3), |text| text.parse())?;
    let from_nm: f64 = arguments.next().map_or(Ok(2.0), |text| text.parse())?;
    let folder = tempfile::tempdir()?;
    println!(
        "two views of 1920x1280, 30 ticks/s, {weather}, from {from_nm} NM; load before: {}",
        fs::read_to_string("/proc/loadavg")?.trim_end()
    );
    println!(
        "| round | images | recording, images/s | encoding alone, images/s | ratio | recording, CPU ms | encoding alone, CPU ms | CPU ratio | bytes per image |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for round in 1..=rounds {
        let corpus = folder.path().join(format!("corpus-{round}"));
        let engine = Arc::new(Remembering::default());
        let recording = record(&sweep(&weather, from_nm)?, &corpus, engine.clone())?;
        let (pictures, encoding) = encode_again(&corpus, &engine)?;
        let per_second = |cost: Cost| pictures as f64 / cost.wall.as_secs_f64();
        let cpu_ms = |cost: Cost| cost.cpu.as_secs_f64() * 1e3 / pictures as f64;
        println!(
            "| {round} | {pictures} | {:.1} | {:.1} | {:.2} | {:.1} | {:.1} | {:.2} | {} |",
            per_second(recording),
            per_second(encoding),
            per_second(recording) / per_second(encoding),
            cpu_ms(recording),
            cpu_ms(encoding),
            cpu_ms(encoding) / cpu_ms(recording),
            bytes_of_videos(&corpus)? / pictures as u64,
        );
        fs::remove_dir_all(&corpus)?;
    }
    println!(
        "to be reached on two free cores: a ratio of {}, {} images/s; load after: {}",
        GOAL.0,
        GOAL.1,
        fs::read_to_string("/proc/loadavg")?.trim_end()
    );
    Ok(())
}

/// The sweep of `scenarios.toml`, reduced to one scenario from this distance.
fn sweep(weather: &str, from_nm: f64) -> Result<Sweep, Box<dyn Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut table: toml::Table = fs::read_to_string(root.join("scenarios.toml"))?.parse()?;
    let weathers = toml::Value::Array(vec![weather.into()]);
    let mut change = toml::toml! {
        [grid]
        times = ["12:00"]
        weathers = []
        repeats = 1
        day_of_year = 172
        utc_offset_h = 8

        [start]
        dtd_nm = 0.0
        speed_mps = 72
        profiles = ["short"]

        [profile.short]
        kind = "glide_path"
        level_altitude_msl_m = 0
    };
    change["grid"]["weathers"] = weathers;
    change["start"]["dtd_nm"] = from_nm.into();
    // Above the glide path of three degrees at the start.
    change["profile"]["short"]["level_altitude_msl_m"] = (50.0 + 100.0 * from_nm).into();
    table.extend(change);
    Ok(Sweep::parse(
        Path::new("throughput.toml"),
        &root,
        table.to_string(),
    )?)
}

/// Records the corpus; returns the cost from the end of the flight until the scenario is committed.
fn record(sweep: &Sweep, corpus: &Path, engine: Arc<Remembering>) -> Result<Cost, Box<dyn Error>> {
    let began = Instant::now();
    let (mut from, mut to) = (None, None);
    // Separate threads, as in a separate process.
    let simulator = tokio::runtime::Runtime::new()?;
    let (tell, told) = std::sync::mpsc::channel();
    let options = ServerOptions {
        bind: Ipv4Addr::LOCALHOST.into(),
        port: 0,
        beacon: false,
        ..ServerOptions::default()
    };
    simulator.spawn(serve_with(options, engine, move |addresses| {
        let _ = tell.send(addresses.udp);
    }));
    let options = GenerateOptions::new(SimulatorTarget::Address(told.recv()?));
    let mut on_event = |event: Event<'_>| match event {
        Event::Flown { .. } => from = Some(Cost::so_far(began)),
        Event::Committed { .. } => to = Some(Cost::so_far(began)),
        _ => {}
    };
    let cancel = Cancel::new();
    let run = generate(sweep, corpus, &options, &cancel, &mut on_event);
    let outcome = tokio::runtime::Runtime::new()?.block_on(run)?;
    simulator.shutdown_background();
    match (from, to) {
        (Some(from), Some(to)) => Ok(to.since(from)),
        _ => Err(format!("the scenario was not made: {outcome:?}").into()),
    }
}

/// Draws the same images again and encodes them; returns their number and the cost of the encoding alone.
fn encode_again(corpus: &Path, engine: &Remembering) -> Result<(usize, Cost), Box<dyn Error>> {
    let scenario = Corpus::open(corpus)?
        .scenarios()?
        .pop()
        .ok_or("no scenario was made")?;
    let opened = scenario.open()?;
    let (record, calibration) = (opened.record()?, opened.calibration()?);
    let scenes = engine.scenes.lock().unwrap_or_else(PoisonError::into_inner);
    let drawn = engine.drawn.lock().unwrap_or_else(PoisonError::into_inner);
    let settings = VideoSettings::default();
    let folder = tempfile::tempdir()?;
    let began = Instant::now();
    let mut cost = Cost::default();

    // The images of each view, in order.
    let mut views = Vec::new();
    for view in &record.views {
        let camera = calibration.cameras[view].camera();
        let scene = scenes
            .iter()
            .position(|(drawn_by, _)| *drawn_by == camera)
            .ok_or_else(|| format!("no image of view {view} was drawn"))?;
        let mut pictures: Vec<Drawn> = drawn.iter().filter(|d| d.scene == scene).copied().collect();
        pictures.sort_by(|a, b| a.instants.lamps_s.total_cmp(&b.instants.lamps_s));
        views.push((view, camera, scene, pictures));
    }
    let path = |view: &str| folder.path().join(format!("{view}.mp4"));
    let before = Cost::so_far(began);
    let mut writers = views
        .iter()
        .map(|(view, camera, ..)| {
            VideoWriter::create(
                &path(view),
                &settings,
                camera.width_px,
                camera.height_px,
                record.frame_rate,
            )
        })
        .collect::<Result<Vec<_>, _>>()?;
    cost = cost.plus(Cost::so_far(began).since(before));

    let mut memory: Vec<Vec<Vec<u8>>> = vec![Vec::new(); views.len()];
    let ticks = record.ticks as usize;
    for first in (0..ticks).step_by(TICKS_AT_ONCE) {
        let these = first..ticks.min(first + TICKS_AT_ONCE);
        for ((_, camera, scene, pictures), memory) in views.iter().zip(&mut memory) {
            let bytes = camera.width_px as usize * camera.height_px as usize * 3;
            memory.resize(these.len(), vec![0; bytes]);
            for (drawn, rgb) in pictures[these.clone()].iter().zip(memory) {
                scenes[*scene]
                    .1
                    .draw(&drawn.pose, &drawn.controls, drawn.instants, rgb);
            }
        }
        let before = Cost::so_far(began);
        std::thread::scope(|scope| {
            let threads: Vec<_> = writers
                .iter_mut()
                .zip(&memory)
                .map(|(writer, memory)| {
                    scope.spawn(|| {
                        memory
                            .iter()
                            .try_for_each(|rgb| writer.write(rgb).map(drop))
                    })
                })
                .collect();
            threads
                .into_iter()
                .try_for_each(|thread| thread.join().expect("an encoder's thread"))
        })?;
        cost = cost.plus(Cost::so_far(began).since(before));
    }
    let before = Cost::so_far(began);
    writers.into_iter().try_for_each(VideoWriter::finish)?;
    cost = cost.plus(Cost::so_far(began).since(before));

    for (view, ..) in &views {
        let recorded = fs::read(scenario.video_path(view))?;
        if recorded != fs::read(path(view))? {
            return Err(format!("view {view}: encoding the same images gave another video").into());
        }
    }
    Ok((ticks * views.len(), cost))
}

/// Size of the videos of the one scenario of a corpus.
fn bytes_of_videos(corpus: &Path) -> Result<u64, Box<dyn Error>> {
    let scenario = Corpus::open(corpus)?.scenarios()?.pop();
    let scenario = scenario.ok_or("no scenario was made")?;
    let mut bytes = 0;
    for view in scenario.open()?.record()?.views {
        bytes += fs::metadata(scenario.video_path(&view))?.len();
    }
    Ok(bytes)
}
