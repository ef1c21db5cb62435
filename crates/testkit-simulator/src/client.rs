//! A client of a stand-in, and its usual requests.

use std::net::SocketAddr;
use std::time::Duration;

use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::{Controls, Pose};
use serde_json::Value;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use xplane_bridge::doctor::{Check, DoctorOptions, Measuring, examine};
use xplane_bridge::{
    CaptureRequest, CapturedFrame, ConnectOptions, Deliver, Simulator, WebApiPlace,
};

/// Connects without the Web API.
pub async fn connected_without_web_api(address: SocketAddr) -> Simulator {
    let options = ConnectOptions {
        web_api: None,
        ..ConnectOptions::from_environment(address).unwrap()
    };
    Simulator::connect_with(address, Duration::from_secs(20), options)
        .await
        .unwrap()
}

/// Runs `dtd doctor` without the Web API.
pub async fn examined(address: SocketAddr, measuring: Measuring) -> Vec<Check> {
    let options = DoctorOptions {
        web_api: WebApiPlace::Off,
        listen: Duration::from_millis(1),
        // Values come from frames, which take seconds on a busy machine.
        wait: Duration::from_secs(30),
        measuring,
        ..DoctorOptions::at(Some(address))
    };
    examine(&options, &mut |_| {}).await
}

/// A pose without pitch and roll.
pub fn level(
    latitude_deg: f64,
    longitude_deg: f64,
    altitude_msl_m: f64,
    heading_true_deg: f64,
) -> Pose {
    Pose {
        latitude_deg,
        longitude_deg,
        altitude_msl_m,
        heading_true_deg,
        pitch_deg: 0.0,
        roll_deg: 0.0,
    }
}

/// A request for the first view, with flaps and gear up.
pub fn capture(
    tick: u32,
    pose: Pose,
    (camera, hfov_deg): (Pose, f64),
    (width_px, height_px): (u32, u32),
) -> CaptureRequest {
    CaptureRequest {
        tick,
        time_ns: 0,
        view: 0,
        pose,
        controls: Controls::default(),
        camera: CameraPose {
            pose: camera,
            hfov_deg,
        },
        width_px,
        height_px,
        deliver: Deliver::Picture,
    }
}

/// Requests a frame and receives it.
pub async fn captured(simulator: &mut Simulator, request: &CaptureRequest) -> CapturedFrame {
    simulator.send_capture(request).await.unwrap();
    simulator.receive_frame().await.unwrap()
}

/// Sends a request to the Web API on a separate connection; returns status and body, or `None` if there is no answer.
pub async fn web_request(
    web_api: SocketAddr,
    method: &str,
    path: &str,
    body: &Value,
) -> Option<(u16, Value)> {
    let mut stream = TcpStream::connect(web_api).await.ok()?;
    let body = if body.is_null() {
        String::new()
    } else {
        body.to_string()
    };
    let request = format!(
        "{method} {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nAccept: application/json\r\n\
         Content-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    );
    stream.write_all(request.as_bytes()).await.ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.ok()?;
    let (head, body) = answer.split_once("\r\n\r\n")?;
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    Some((status, serde_json::from_str(body).ok()?))
}
