//! A session with the stand-in, recorded and served again, as a client sees it.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use dataset::conditions::Conditions;
use dataset::geometry::pose::Pose;
use dataset::geometry::runway::Runway;
use mock_xplane::server::{Addresses, serve_tape};
use testkit::changi_02l;
use testkit::short_flight::noon;
use testkit_simulator::client::{self, level};
use testkit_simulator::{quiet, serving};
use tokio::net::UdpSocket;
use tokio::sync::oneshot;
use tokio::time::timeout;
use xplane_bridge::packet::{SubscribePosition, ToSimulator};
use xplane_bridge::{BridgeError, CaptureRequest, CapturedFrame, Simulator};
use xplane_tape::{RecordOptions, record};

const PATIENCE: Duration = Duration::from_secs(20);

async fn played(tape: &Path) -> Addresses {
    let (tell, told) = oneshot::channel();
    let tape = tape.to_owned();
    tokio::spawn(async move {
        serve_tape(&tape, &quiet(), |at| tell.send(at).unwrap())
            .await
            .unwrap();
    });
    told.await.unwrap()
}

fn runway() -> Runway {
    Runway {
        threshold: pose(1.35).position(),
        ..changi_02l()
    }
}

fn pose(latitude_deg: f64) -> Pose {
    Pose {
        pitch_deg: 2.0,
        ..level(latitude_deg, 103.98, 100.0, 23.0)
    }
}

fn request(tick: u32, latitude_deg: f64) -> CaptureRequest {
    CaptureRequest {
        time_ns: i64::from(tick) * 1_000_000_000,
        ..client::capture(tick, pose(latitude_deg), (pose(1.34), 20.0), (48, 32))
    }
}

async fn capture(
    simulator: &mut Simulator,
    request: &CaptureRequest,
) -> Result<CapturedFrame, BridgeError> {
    simulator.send_capture(request).await?;
    simulator.receive_frame().await
}

async fn connect(address: SocketAddr) -> Simulator {
    Simulator::connect(address, PATIENCE).await.unwrap()
}

/// A client's actions in the session: two images, and a look at the position.
async fn session(address: SocketAddr) -> (Vec<CapturedFrame>, Vec<u8>) {
    let mut simulator = connect(address).await;
    // A separate clock makes the images repeatable.
    simulator.set_conditions(&conditions()).await.unwrap();
    simulator.freeze(&runway()).await.unwrap();
    let mut frames = Vec::new();
    for tick in 0..2 {
        frames.push(
            capture(
                &mut simulator,
                &request(tick, 1.345 + f64::from(tick) * 1e-3),
            )
            .await
            .unwrap(),
        );
    }
    let position = position(address).await;
    simulator.release().await.unwrap();
    (frames, position)
}

async fn position(address: SocketAddr) -> Vec<u8> {
    let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let ask = ToSimulator::SubscribePosition(SubscribePosition { frequency_hz: 10 })
        .encode()
        .unwrap();
    socket.send_to(&ask, address).await.unwrap();
    let mut buffer = [0; 256];
    let received = timeout(PATIENCE, socket.recv(&mut buffer))
        .await
        .expect("no position");
    buffer[..received.unwrap()].to_vec()
}

fn conditions() -> Conditions {
    let mut conditions = noon(30_000.0);
    conditions.weather.wind_speed_mps = 3.0;
    conditions.weather.wind_from_true_deg = 60.0;
    conditions
}

/// A tape of the session, and the client's results.
async fn recorded(folder: &Path) -> (PathBuf, (Vec<CapturedFrame>, Vec<u8>)) {
    let simulator = serving(quiet()).await;
    let tape = folder.join("session.mcap");
    let options = RecordOptions::new(simulator, tape.clone());
    let (tell, told) = oneshot::channel();
    let (stop, stopped) = oneshot::channel::<()>();
    let recording = tokio::spawn(async move {
        let ready = |at: xplane_tape::RecorderAddresses| tell.send(at.udp).unwrap();
        record(options, ready, async { stopped.await.unwrap() })
            .await
            .unwrap()
    });
    let got = session(told.await.unwrap()).await;
    stop.send(()).unwrap();
    let summary = recording.await.unwrap();
    assert!(summary.messages > 20, "{summary:?}");
    (tape, got)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_gets_the_same_frames_and_positions_from_the_tape() {
    let folder = tempfile::tempdir().unwrap();
    let (tape, got) = recorded(folder.path()).await;
    let player = played(&tape).await;
    assert!(session(player.udp).await == got);
    // And once more: a tape is played as often as one likes.
    assert!(session(player.udp).await == got, "the second time");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_not_on_the_tape_is_refused_with_what_there_is() {
    let folder = tempfile::tempdir().unwrap();
    let (tape, _) = recorded(folder.path()).await;
    let player = played(&tape).await;
    let cases = [
        (
            request(0, 1.346),
            "pose.latitude_deg was 1.345 then, and is 1.346 now",
        ),
        (
            request(7, 1.345),
            "no capture of tick 7, view 0. It has 2 capture (ticks 0 to 1, views 0 to 0)",
        ),
    ];
    for (request, words) in cases {
        let mut simulator = connect(player.udp).await;
        simulator.set_conditions(&conditions()).await.unwrap();
        simulator.freeze(&runway()).await.unwrap();
        let error = capture(&mut simulator, &request)
            .await
            .unwrap_err()
            .to_string();
        assert!(error.contains(words), "{error}");
    }

    // A sky that was not written then is not acknowledged now.
    let mut other = conditions();
    other.weather.visibility_m = 1_234.0;
    let mut simulator = connect(player.udp).await;
    let error = simulator.set_conditions(&other).await.unwrap_err();
    let BridgeError::NotTaken { name, wanted, .. } = &error else {
        panic!("{error}");
    };
    assert!(name.ends_with("visibility_reported_sm"), "{error}");
    assert!((wanted - 0.767).abs() < 1e-3, "{error}");
}
