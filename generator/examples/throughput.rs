//! Compares recording from end to end with encoding alone: `cargo run --release -p dtd-generator --example throughput`.
//!
//! The stand-in, in this process, flies the last nautical miles of an approach; its two views of 1920x1280 are drawn, sent, encoded
//! and committed with their tables, as in `dtd generate`. Then the same images are drawn again from these tables and encoded, one
//! thread per view, and only the encoding is timed; byte-identical videos prove that it was the same work. Rounds alternate. Arguments: a
//! weather (`clear`, `cloudy`, `stormy` or `foggy`; default cloudy), the number of rounds (3), and from how many nautical miles the
//! approach is recorded (2): the longer it is, the less one-time work such as preparing the backdrops matters; in a corpus it is
//! done once for all scenarios of a weather and time.

use std::error::Error;
use std::fs;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use dataset::corpus::Corpus;
use dataset::geometry::camera::Camera;
use dataset::numbers::units::SimTime;
use dataset::tables::frames::TickRow;
use dataset::video::{VideoSettings, VideoWriter};
use generator::generate::{Cancel, Event, GenerateOptions, SimulatorTarget, generate};
use generator::sweep::Sweep;
use mock_xplane::server::{BuiltIn, Engine, Instants, SceneRenderer, SceneSetting};
use testkit::processor_time;
use testkit_simulator::{quiet, serving};
use tokio::runtime::Runtime;

/// Ticks that are drawn before they are encoded when encoding is timed alone. Limits memory: 14.7 MB a tick.
const TICKS_AT_ONCE: usize = 16;
/// Targets: share of the rate of encoding alone, and images per second.
const GOAL: (f64, f64) = (0.7, 45.0);

/// Seconds on the wall, and of the processor in all threads.
type Cost = [f64; 2];

/// A moment, by both clocks.
#[derive(Clone, Copy)]
struct Moment(Instant, Duration);

impl Moment {
    fn now() -> Self {
        Self(Instant::now(), processor_time::own_and_children()[0])
    }

    fn cost_since(self) -> Cost {
        let processor = processor_time::own_and_children()[0] - self.1;
        [self.0.elapsed(), processor].map(|time| time.as_secs_f64())
    }
}

/// Images of a recording that were encoded once more, alone.
struct Encoded {
    pictures: usize,
    bytes: usize,
    cost: Cost,
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
        let recording = record(&sweep(&weather, from_nm)?, &corpus)?;
        let encoded = encode_again(&corpus)?;
        let pictures = encoded.pictures as f64;
        let [per_s, per_s_alone] = [recording, encoded.cost].map(|[wall_s, _]| pictures / wall_s);
        let [cpu_ms, cpu_ms_alone] =
            [recording, encoded.cost].map(|[_, cpu_s]| 1e3 * cpu_s / pictures);
        println!(
            "| {round} | {pictures} | {per_s:.1} | {per_s_alone:.1} | {:.2} | {cpu_ms:.1} | {cpu_ms_alone:.1} | {:.2} | {} |",
            per_s / per_s_alone,
            cpu_ms_alone / cpu_ms,
            encoded.bytes / encoded.pictures,
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
fn record(sweep: &Sweep, corpus: &Path) -> Result<Cost, Box<dyn Error>> {
    // Separate threads, as in a separate process.
    let simulator = Runtime::new()?;
    let address = simulator.block_on(serving(quiet()));
    let options = GenerateOptions::new(SimulatorTarget::Address(address));
    let (mut flown, mut cost) = (None, None);
    let mut on_event = |event: Event<'_>| match event {
        Event::Flown { .. } => flown = Some(Moment::now()),
        Event::Committed { .. } => cost = flown.map(Moment::cost_since),
        _ => {}
    };
    let cancel = Cancel::new();
    let run = generate(sweep, corpus, &options, &cancel, &mut on_event);
    let outcome = Runtime::new()?.block_on(run)?;
    simulator.shutdown_background();
    cost.ok_or_else(|| format!("the scenario was not made: {outcome:?}").into())
}

/// Draws the recorded images again and encodes them.
fn encode_again(corpus: &Path) -> Result<Encoded, Box<dyn Error>> {
    let scenario = Corpus::open(corpus)?.scenarios()?.pop();
    let scenario = scenario.ok_or("no scenario was made")?;
    let opened = scenario.open()?;
    let (record, calibration, frames) = (opened.record()?, opened.calibration()?, opened.frames()?);
    let cameras: Vec<Camera> = (record.views.iter())
        .map(|view| calibration.cameras[view].camera())
        .collect();
    let scene = |camera| {
        BuiltIn.prepare(&SceneSetting {
            camera,
            runway: &record.runway,
            weather: &record.conditions.weather,
            clock: &record.conditions.clock,
            degradation: None,
        })
    };
    let scenes: Vec<Box<dyn SceneRenderer>> = cameras.iter().map(scene).collect();
    let draw = |row: &TickRow, view: usize| {
        let instants = Instants::all(SimTime(row.time_ns).seconds());
        let mut rgb =
            vec![0; cameras[view].width_px as usize * cameras[view].height_px as usize * 3];
        scenes[view].draw(&row.pose, &row.controls, instants, &mut rgb);
        rgb
    };
    let folder = tempfile::tempdir()?;
    let path = |view: &str| folder.path().join(format!("{view}.mp4"));
    let mut costs = Vec::new();

    let before = Moment::now();
    let mut writers = Vec::new();
    for (view, camera) in record.views.iter().zip(&cameras) {
        writers.push(VideoWriter::create(
            &path(view),
            &VideoSettings::default(),
            camera.width_px,
            camera.height_px,
            record.frame_rate,
        )?);
    }
    costs.push(before.cost_since());
    for rows in frames.rows.chunks(TICKS_AT_ONCE) {
        let drawn = (0..cameras.len()).map(|view| rows.iter().map(|row| draw(row, view)).collect());
        let drawn: Vec<Vec<Vec<u8>>> = drawn.collect();
        let before = Moment::now();
        thread::scope(|scope| {
            let views = writers.iter_mut().zip(&drawn);
            let threads = views.map(|(writer, images)| {
                scope.spawn(|| {
                    images
                        .iter()
                        .try_for_each(|rgb| writer.write(rgb).map(drop))
                })
            });
            let threads: Vec<_> = threads.collect();
            (threads.into_iter()).try_for_each(|thread| thread.join().expect("an encoder's thread"))
        })?;
        costs.push(before.cost_since());
    }
    let before = Moment::now();
    writers.into_iter().try_for_each(VideoWriter::finish)?;
    costs.push(before.cost_since());

    let mut bytes = 0;
    for view in &record.views {
        let recorded = fs::read(scenario.video_path(view))?;
        if recorded != fs::read(path(view))? {
            return Err(format!("view {view}: encoding the same images gave another video").into());
        }
        bytes += recorded.len();
    }
    Ok(Encoded {
        pictures: frames.rows.len() * cameras.len(),
        bytes,
        cost: [0, 1].map(|clock| costs.iter().map(|cost| cost[clock]).sum()),
    })
}
