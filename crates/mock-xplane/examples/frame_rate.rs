//! Measures frames through the capture link at full size: `cargo run --release -p mock-xplane --example frame_rate`.
//!
//! Once with blank pictures, which gives the cost of the link alone, and once with the renderer's.

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::{Controls, Pose};
use dataset::geometry::runway::Runway;
use mock_xplane::server::{BuiltIn, Engine, serve_with};
use testkit::changi_02l;
use testkit_simulator::{Blank, quiet};
use tokio::sync::oneshot;
use xplane_bridge::{CONNECT_TIMEOUT, CaptureRequest, Deliver, Simulator};

/// Frames per measurement.
const FRAMES: u32 = 200;
/// Captures in flight.
const AHEAD: u32 = 4;

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    for (name, engine) in [
        ("link alone", Arc::new(Blank) as Arc<dyn Engine>),
        ("renderer", Arc::new(BuiltIn)),
    ] {
        let rate = frames_per_second(engine).await?;
        println!("{name}: {rate:.1} frames of 1920x1280 per second");
    }
    Ok(())
}

async fn frames_per_second(engine: Arc<dyn Engine>) -> Result<f64, Box<dyn Error>> {
    let (tell, told) = oneshot::channel();
    let server = tokio::spawn(serve_with(quiet(), engine, |addresses| {
        let _ = tell.send(addresses);
    }));
    let mut simulator = Simulator::connect(told.await?.udp, CONNECT_TIMEOUT).await?;
    let runway = changi_02l();
    simulator.freeze(&runway).await?;
    // The first frames prepare the scene and the memory.
    let mut begin = Instant::now();
    for tick in 0..FRAMES + 2 * AHEAD {
        simulator.send_capture(&capture(&runway, tick)).await?;
        if tick >= AHEAD {
            let frame = simulator.receive_frame().await?;
            simulator.recycle(frame.rgb);
        }
        if tick == 2 * AHEAD - 1 {
            begin = Instant::now();
        }
    }
    let rate = f64::from(FRAMES) / begin.elapsed().as_secs_f64();
    simulator.release().await?;
    server.abort();
    Ok(rate)
}

fn capture(runway: &Runway, tick: u32) -> CaptureRequest {
    let to_go_m = 18_000.0 - f64::from(tick) * 80.0;
    let place =
        |along_track_m: f64, cross_track_m: f64, altitude_msl_m: f64, heading_true_deg: f64| {
            let at = runway.point_on_approach(along_track_m, cross_track_m);
            Pose {
                latitude_deg: at.latitude_deg,
                longitude_deg: at.longitude_deg,
                altitude_msl_m,
                heading_true_deg,
                pitch_deg: 1.6,
                roll_deg: 0.0,
            }
        };
    CaptureRequest {
        tick,
        time_ns: i64::from(tick) * 1_000_000_000,
        view: 0,
        pose: place(
            to_go_m,
            0.0,
            6.71 + to_go_m * 3_f64.to_radians().tan(),
            23.02,
        ),
        controls: Controls {
            flap_ratio: 1.0,
            gear_ratio: 1.0,
        },
        camera: CameraPose {
            pose: place(-1_500.0, -300.0, 16.71, 208.32),
            hfov_deg: 10.0,
        },
        width_px: 1_920,
        height_px: 1_280,
        deliver: Deliver::Picture,
    }
}
