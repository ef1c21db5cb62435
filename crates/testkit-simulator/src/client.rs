//! A client of a stand-in, and its usual requests.

use std::net::SocketAddr;
use std::time::Duration;

use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::{Controls, Pose};
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
