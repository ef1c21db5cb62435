//! Measures the cost of the bridge's client in lockstep: `cargo run --release -p mock-xplane --example lockstep_cost`.
//!
//! 30 ticks per second, two views of 1920x1280 each, against a stand-in that does not draw and runs on separate threads of the same
//! process. The client, including its other work (it watches 110 datarefs), has one thread, whose processor time the kernel counts. Once
//! with the pictures in shared memory, once over the link (442 MB per second through the loopback), as from a simulator on another
//! computer. Linux only.

use std::error::Error;
use std::fs;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use dataset::conditions::{Clock, Conditions, Weather};
use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::{Controls, Pose};
use mock_xplane::server::serve_with;
use testkit::changi_02l;
use testkit_simulator::{Blank, quiet};
use xplane_bridge::{CONNECT_TIMEOUT, CaptureRequest, ConnectOptions, Deliver, Simulator};

const TICKS: u32 = 300;
const TICK: Duration = Duration::from_nanos(1_000_000_000 / 30);
const VIEWS: u32 = 2;

/// Cost of a run.
struct Cost {
    /// Processor time of the client's thread, seconds.
    client_s: f64,
    /// Elapsed time, seconds.
    wall_s: f64,
    /// Ticks that ended after the next one should have started.
    late: u32,
}

fn main() -> Result<(), Box<dyn Error>> {
    for (what, no_shared_memory) in [
        ("pictures in shared memory", false),
        ("pictures over the link", true),
    ] {
        let Cost {
            client_s,
            wall_s,
            late,
        } = cost(no_shared_memory)?;
        println!(
            "{what}: {:.1} % of one core in the client, {TICKS} ticks of {VIEWS} views in {wall_s:.2} s, {late} late",
            100.0 * client_s / wall_s
        );
    }
    Ok(())
}

fn cost(no_shared_memory: bool) -> Result<Cost, Box<dyn Error>> {
    let server = tokio::runtime::Runtime::new()?;
    let (tell, told) = std::sync::mpsc::channel();
    server.spawn(serve_with(quiet(), Arc::new(Blank), move |addresses| {
        let _ = tell.send(addresses.udp);
    }));
    let address = told.recv()?;
    let client = std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(|error| error.to_string())?;
        runtime
            .block_on(drive(address, no_shared_memory))
            .map_err(|error| error.to_string())
    });
    let cost = client.join().map_err(|_| "the client panicked")??;
    server.shutdown_background();
    Ok(cost)
}

async fn drive(address: SocketAddr, no_shared_memory: bool) -> Result<Cost, Box<dyn Error>> {
    let options = ConnectOptions {
        no_shared_memory,
        ..ConnectOptions::default()
    };
    let mut simulator = Simulator::connect_with(address, CONNECT_TIMEOUT, options).await?;
    simulator.set_conditions(&conditions()).await?;
    simulator.freeze(&changi_02l()).await?;
    // The first tick prepares memory and scene.
    tick(&mut simulator, 0).await?;
    let (begin, begin_s) = (Instant::now(), thread_time_s()?);
    let mut late = 0;
    for number in 1..=TICKS {
        tick(&mut simulator, number).await?;
        let next = begin + TICK * number;
        late += u32::from(Instant::now() > next);
        tokio::time::sleep_until(next.into()).await;
    }
    let cost = Cost {
        client_s: thread_time_s()? - begin_s,
        wall_s: begin.elapsed().as_secs_f64(),
        late,
    };
    simulator.release().await?;
    Ok(cost)
}

async fn tick(simulator: &mut Simulator, tick: u32) -> Result<(), Box<dyn Error>> {
    for view in 0..VIEWS {
        simulator.send_capture(&capture(tick, view)).await?;
    }
    for _ in 0..VIEWS {
        let frame = simulator.receive_frame().await?;
        simulator.recycle(frame.rgb);
    }
    Ok(())
}

/// Processor time of the calling thread: the first number is nanoseconds on a processor.
fn thread_time_s() -> Result<f64, Box<dyn Error>> {
    let text = fs::read_to_string("/proc/thread-self/schedstat")?;
    let nanoseconds: f64 = text.split_whitespace().next().unwrap_or_default().parse()?;
    Ok(nanoseconds * 1e-9)
}

fn pose() -> Pose {
    Pose {
        latitude_deg: 1.25,
        longitude_deg: 103.94,
        altitude_msl_m: 500.0,
        heading_true_deg: 23.02,
        pitch_deg: 1.6,
        roll_deg: 0.0,
    }
}

fn capture(tick: u32, view: u32) -> CaptureRequest {
    CaptureRequest {
        tick,
        time_ns: i64::from(tick) * TICK.as_nanos() as i64,
        view,
        pose: pose(),
        controls: Controls::default(),
        camera: CameraPose {
            pose: pose(),
            hfov_deg: 10.0,
        },
        width_px: 1_920,
        height_px: 1_280,
        deliver: Deliver::Picture,
    }
}

fn conditions() -> Conditions {
    Conditions {
        time_of_day: "12:00".into(),
        clock: Clock {
            day_of_year: 172,
            zulu_time_s: 14_400.0,
        },
        weather_name: "clear".into(),
        weather: Weather {
            visibility_m: 30_000.0,
            clouds: vec![],
            rain_ratio: 0.0,
            wind_speed_mps: 3.0,
            wind_from_true_deg: 60.0,
            turbulence_ratio: 0.0,
        },
    }
}
