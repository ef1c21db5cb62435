//! Client-side view of injected faults: a simulator that hangs, one that restarts, a lossy network.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use dataset::geometry::pose::{Controls, Pose};
use mock_xplane::server::{
    Engine, Faults, Instants, OtherAircraft, SceneRenderer, SceneSetting, ServerOptions,
};
use testkit::changi_02l;
use testkit_simulator::client::{self, captured, level};
use testkit_simulator::{Blank, Running, quiet};
use tokio::net::UdpSocket;
use tokio::time::timeout;
use xplane_bridge::packet::{FromSimulator, SubscribeDataref, ToSimulator, WriteDataref};
use xplane_bridge::{CONNECT_TIMEOUT, CaptureRequest, Simulator};

const VISIBILITY: &str = "sim/weather/region/visibility_reported_sm";

async fn start(faults: &str) -> Running {
    let options = ServerOptions {
        faults: faults.parse::<Faults>().unwrap(),
        ..quiet()
    };
    Running::start_with(options, Arc::new(Blank)).await
}

fn capture(tick: u32) -> CaptureRequest {
    let pose = level(1.3, 103.9, 500.0, 23.0);
    client::capture(tick, pose, (pose, 10.0), (8, 8))
}

/// A client that is written by hand: without repetitions.
struct PlainClient {
    socket: UdpSocket,
    simulator: SocketAddr,
}

impl PlainClient {
    async fn send(&self, packet: &ToSimulator) {
        let datagram = packet.encode().unwrap();
        self.socket
            .send_to(&datagram, self.simulator)
            .await
            .unwrap();
    }
}

/// Sends one datagram and waits a while for a value.
async fn read(client: &PlainClient, path: &str) -> Option<f32> {
    let request = |frequency_hz| {
        ToSimulator::SubscribeDataref(SubscribeDataref {
            frequency_hz,
            index: 1,
            path: path.into(),
        })
    };
    let mut buffer = [0; 2048];
    while client.socket.try_recv(&mut buffer).is_ok() {}
    client.send(&request(50)).await;
    let received = timeout(Duration::from_millis(300), client.socket.recv(&mut buffer)).await;
    client.send(&request(0)).await;
    let length = received.ok()?.unwrap();
    match FromSimulator::decode(&buffer[..length]).unwrap() {
        FromSimulator::DatarefValues(reply) => Some(reply.values[0].value),
        other => panic!("{other:?}"),
    }
}

async fn write(client: &PlainClient, path: &str, value: f32) {
    let write = WriteDataref {
        path: path.into(),
        value,
    };
    client.send(&ToSimulator::WriteDataref(write)).await;
}

async fn plain_client(running: &Running) -> PlainClient {
    PlainClient {
        socket: UdpSocket::bind("127.0.0.1:0").await.unwrap(),
        simulator: running.addresses.udp,
    }
}

#[tokio::test]
async fn a_restart_closes_the_link_forgets_everything_and_comes_back_on_the_same_ports() {
    let running = start("restart=captures:3:0.5").await;
    let udp = plain_client(&running).await;
    let first_value = read(&udp, VISIBILITY).await.unwrap();
    write(&udp, VISIBILITY, 3.0).await;
    assert_eq!(read(&udp, VISIBILITY).await, Some(3.0));

    let mut simulator = Simulator::connect(running.addresses.udp, CONNECT_TIMEOUT)
        .await
        .unwrap();
    simulator.freeze(&changi_02l()).await.unwrap();
    for tick in 0..2 {
        let frame = captured(&mut simulator, &capture(tick)).await;
        assert_eq!(frame.header.sim_frame, u64::from(tick) + 1);
    }
    simulator.send_capture(&capture(2)).await.unwrap();
    let error = simulator.receive_frame().await.unwrap_err();
    assert!(error.to_string().contains("link"), "{error}");
    assert_eq!(read(&udp, VISIBILITY).await, None, "answers while down");
    drop(simulator);

    let mut simulator = Simulator::connect(running.addresses.udp, CONNECT_TIMEOUT)
        .await
        .unwrap();
    assert_eq!(read(&udp, VISIBILITY).await, Some(first_value));
    simulator.freeze(&changi_02l()).await.unwrap();
    for tick in 0..4 {
        let frame = captured(&mut simulator, &capture(tick)).await;
        assert_eq!(
            frame.header.sim_frame,
            u64::from(tick) + 1,
            "one restart only"
        );
    }
}

#[tokio::test]
async fn a_frozen_simulator_keeps_its_connections_and_answers_later() {
    let running = start("freeze=captures:1:0.6").await;
    let udp = plain_client(&running).await;
    let mut simulator = Simulator::connect(running.addresses.udp, CONNECT_TIMEOUT)
        .await
        .unwrap();
    write(&udp, VISIBILITY, 3.0).await;
    simulator.freeze(&changi_02l()).await.unwrap();
    simulator.send_capture(&capture(0)).await.unwrap();
    let silence = timeout(Duration::from_millis(100), simulator.receive_frame()).await;
    assert!(silence.is_err(), "an answer from a frozen simulator");
    assert_eq!(read(&udp, VISIBILITY).await, None);
    let again = async {
        loop {
            if let Some(value) = read(&udp, VISIBILITY).await {
                return value;
            }
        }
    };
    let value = timeout(Duration::from_secs(20), again).await;
    assert_eq!(value.expect("it answers again"), 3.0);
}

#[tokio::test]
async fn the_network_loses_and_doubles_what_it_was_told_to() {
    let lossy = start("loss=1").await;
    assert_eq!(read(&plain_client(&lossy).await, VISIBILITY).await, None);

    let doubling = start("dup=1").await;
    let udp = plain_client(&doubling).await;
    let request = SubscribeDataref {
        frequency_hz: 30,
        index: 7,
        path: "sim/time/total_running_time_sec".into(),
    };
    udp.send(&ToSimulator::SubscribeDataref(request)).await;
    let mut received = Vec::new();
    let mut buffer = [0; 64];
    for _ in 0..6 {
        let length = udp.socket.recv(&mut buffer).await.unwrap();
        received.push(buffer[..length].to_vec());
    }
    // Time runs, so that only copies are equal.
    assert_eq!(received[0], received[1]);
    assert_ne!(received[1], received[2]);
    assert_eq!(received[2], received[3]);
}

/// Writes the camera's focal length into every byte, pixels.
struct FocalLength(u8);

impl Engine for FocalLength {
    fn prepare(&self, scene: &SceneSetting<'_>) -> Box<dyn SceneRenderer> {
        Box::new(Self(scene.camera.focal_px as u8))
    }
}

impl SceneRenderer for FocalLength {
    fn draw(&self, _: (&Pose, &Controls), _: &[OtherAircraft], _: Instants, rgb: &mut [u8]) {
        rgb.fill(self.0);
    }
}

#[tokio::test]
async fn exchanged_views_show_the_other_camera_from_the_first_image_on() {
    let options = ServerOptions {
        faults: "source=0:1,source=1:0,zoom=1:100:0".parse().unwrap(),
        ..quiet()
    };
    let running = Running::start_with(options, Arc::new(FocalLength(0))).await;
    let mut simulator = Simulator::connect(running.addresses.udp, CONNECT_TIMEOUT)
        .await
        .unwrap();
    simulator.freeze(&changi_02l()).await.unwrap();
    // Focal lengths of 45.7 and 22.7 pixels.
    let requests = [(0, 10.0), (1, 20.0)].map(|(view, hfov_deg)| {
        let mut request = capture(0);
        request.camera.hfov_deg = hfov_deg;
        CaptureRequest { view, ..request }
    });
    for request in &requests {
        simulator.send_capture(request).await.unwrap();
    }
    for (request, focal_px) in requests.iter().zip([22, 91]) {
        let frame = simulator.receive_frame().await.unwrap();
        assert_eq!(frame.rgb[0], focal_px);
        assert_eq!(frame.header.camera, request.camera);
    }
}
