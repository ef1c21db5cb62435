//! Compares the time that a plan expects with the time that recording then takes, for live flights of an X-Plane 11: the stand-in hosts
//! the plugin and draws 60 frames a second, so that flights take real time.
//!
//! `scripts/plan-accuracy.sh plugin`, four minutes, mostly of waiting. As on a first evening, `dtd doctor` measures
//! first, and one scenario is recorded, from which the profile has how long the start of a flight and the weather take.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use generator::generate::{Cancel, GenerateOptions, Patience, SimulatorTarget, generate};
use generator::plan::{Estimate, Pacing, expand};
use generator::shard::Shard;
use generator::sweep::Sweep;
use mock_xplane::server::{LinkServer, PluginOptions, ServerOptions};
use serde_json::json;
use testkit::repository;
use testkit::sweep::{SmallSweep, starting_from};
use testkit_simulator::{plugin, quiet, serving};
use xplane_bridge::datarefs::Generation;
use xplane_bridge::doctor::{DoctorOptions, examine};
use xplane_bridge::pixels::{FfmpegScreen, PixelChoice, Screen};
use xplane_bridge::{LocalUdp, Simulator};

const SIZE_PX: (u32, u32) = (64, 64);
const FRAMES_PER_S: f64 = 60.0;
const PATIENCE: Duration = Duration::from_secs(60);

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let simulator = serving(ServerOptions {
        generation: Generation::XPlane11,
        link: LinkServer::Plugin(PluginOptions {
            most_frames_per_s: Some(FRAMES_PER_S),
            ..plugin::options(SIZE_PX)
        }),
        ..quiet()
    })
    .await;
    // Python takes a while to start.
    Simulator::connect(simulator, PATIENCE)
        .await?
        .release()
        .await?;
    let folder = tempfile::tempdir()?;
    let screen: Arc<dyn Screen> = Arc::new(FfmpegScreen::here());
    let options = GenerateOptions {
        simulators: SimulatorTarget::Address(simulator).into(),
        local_udp: LocalUdp::default(),
        stand_in_program: PathBuf::from("unused"),
        pixels: PixelChoice::Auto,
        encoder: None,
        screen,
        only: Vec::new(),
        shard: Shard::WHOLE,
        patience: Patience::default(),
        restart: None,
        remote: None,
    };
    examine(&DoctorOptions::at(Some(simulator)), &mut |_| {}).await;
    let first = sweep("first", 1, 1)?;
    record(&first, &folder.path().join("first"), &options).await?;

    let asked = Simulator::connect(simulator, PATIENCE).await?;
    let profile = asked.description().profile.current().cloned();
    asked.release().await?;
    let sweep = sweep("accuracy", 2, 3)?;
    let plan = expand(&sweep);
    let pacing = Pacing::XPlane(profile.map(Box::new));
    let expected = Estimate::new(&plan.common, &plan.scenarios, (&pacing, None), None);
    let began = Instant::now();
    record(&sweep, &folder.path().join("accuracy"), &options).await?;
    let took_s = began.elapsed().as_secs_f64();
    let expected_s = 3_600.0 * expected.making_h;
    println!(
        "{}",
        json!({
            "scenarios": expected.scenarios, "pictures": expected.pictures,
            "expected_s": expected_s, "took_s": took_s, "ratio": expected_s / took_s,
            "parts": expected.durations,
        })
    );
    Ok(())
}

/// Live flights from 2 NM, of which the last one is a recording if there are several.
fn sweep(name: &str, seed: u32, repeats: u32) -> Result<Sweep, Box<dyn Error>> {
    let recorded = if repeats > 1 {
        format!(
            "[[recorded]]\nfiles = \"flights/01_calm_ils.csv\"\nweathers = [\"clear\"]\nrepeats = [{repeats}]\n"
        )
    } else {
        String::new()
    };
    let toml = SmallSweep {
        name,
        seed,
        weathers: &["clear"],
        repeats,
        size_px: SIZE_PX,
        frame_rate: "1/2",
        tables: &format!(
            "{}{recorded}[weather.clear]\nvisibility_m = 30000\n",
            starting_from(1.9, 2.1, 200)
        ),
    }
    .toml();
    let data = repository().join("tests/data");
    Ok(Sweep::parse(Path::new("accuracy.toml"), &data, toml)?)
}

async fn record(
    sweep: &Sweep,
    folder: &Path,
    options: &GenerateOptions,
) -> Result<(), Box<dyn Error>> {
    let outcome = generate(sweep, folder, options, &Cancel::new(), &mut |_| ()).await?;
    if outcome.failed.is_empty() {
        Ok(())
    } else {
        Err(format!("{:?}", outcome.failed).into())
    }
}
