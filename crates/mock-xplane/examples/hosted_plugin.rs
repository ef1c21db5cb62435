//! Measures captures by our plugin in an X-Plane that draws 60 frames per second and holds Python's interpreter lock between callbacks:
//! `cargo run --release -p mock-xplane --example hosted_plugin`.
//!
//! Frames are only drawn, neither read back nor grabbed: what is left is the cost of settling, of the link and of its threads. Each way is
//! measured with the plugin as it is, and with one that gives its threads no time.

use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::{Controls, Pose};
use mock_xplane::server::{LinkServer, PluginOptions, ServerOptions};
use testkit::changi_02l;
use testkit_simulator::{plugin, quiet, serving};
use xplane_bridge::datarefs::Generation;
use xplane_bridge::{CONNECT_TIMEOUT, CaptureRequest, Deliver, Simulator};

const CAPTURES: u32 = 200;
const FRAMES_PER_SECOND: f64 = 60.0;
const SIZE_PX: (u32, u32) = (480, 320);

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::temp_dir().join(format!("dtd-hosted-plugin-{}", std::process::id()));
    let starving = plugin::with(
        &folder,
        &[("server.py", "GIVE_TIME_S = 0.004", "GIVE_TIME_S = 0.0")],
    );
    for (name, plugin) in [
        ("threads get time", plugin::folder()),
        ("threads get none", starving),
    ] {
        for ahead in [1, 4] {
            let (rate, frames) = measure(plugin.clone(), ahead).await?;
            println!(
                "{name}, {ahead} in flight: {rate:.1} captures a second, {frames:.1} frames drawn for each"
            );
        }
    }
    std::fs::remove_dir_all(folder)?;
    Ok(())
}

/// Captures a second, and frames drawn for each.
async fn measure(folder: PathBuf, ahead: u32) -> Result<(f64, f64), Box<dyn Error>> {
    let options = PluginOptions {
        window_px: SIZE_PX,
        most_frames_per_s: Some(FRAMES_PER_SECOND),
        ..PluginOptions::new(folder)
    };
    let address = serving(ServerOptions {
        generation: Generation::XPlane12,
        link: LinkServer::Plugin(options),
        ..quiet()
    })
    .await;
    let mut simulator = Simulator::connect(address, CONNECT_TIMEOUT).await?;
    simulator.freeze(&changi_02l()).await?;
    let (mut begin, mut first) = (Instant::now(), 0);
    let mut last = 0;
    for tick in 0..CAPTURES + 2 * ahead {
        simulator.send_capture(&capture(tick)).await?;
        if tick >= ahead - 1 {
            last = simulator.receive_frame().await?.sim_frame;
        }
        if tick == 2 * ahead - 1 {
            (begin, first) = (Instant::now(), last);
        }
    }
    let rate = f64::from(CAPTURES) / begin.elapsed().as_secs_f64();
    simulator.release().await?;
    Ok((rate, (last - first) as f64 / f64::from(CAPTURES)))
}

/// On the approach, from a camera at its side.
fn capture(tick: u32) -> CaptureRequest {
    let pose = |latitude_deg, longitude_deg, altitude_msl_m, heading_true_deg| Pose {
        latitude_deg,
        longitude_deg,
        altitude_msl_m,
        heading_true_deg,
        pitch_deg: 1.6,
        roll_deg: 0.0,
    };
    CaptureRequest {
        tick,
        time_ns: i64::from(tick) * 1_000_000_000,
        view: 0,
        pose: pose(1.2 + f64::from(tick) * 1e-4, 103.9, 700.0, 23.0),
        controls: Controls {
            flap_ratio: 1.0,
            gear_ratio: 1.0,
        },
        camera: CameraPose {
            pose: pose(1.36, 103.98, 16.7, 208.3),
            hfov_deg: 10.0,
        },
        width_px: SIZE_PX.0,
        height_px: SIZE_PX.1,
        deliver: Deliver::Drawn,
    }
}
