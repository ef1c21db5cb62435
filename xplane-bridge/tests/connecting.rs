//! Connecting to a missing, incomplete or foreign simulator ends in time, with an error that says what to do.

mod fake_web_api;

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use fake_web_api::{CAPABILITIES, server};
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, UdpSocket};
use xplane_bridge::datarefs::{CAPTURE_PORT, RUNNING_TIME_S, VERSION};
use xplane_bridge::packet::{DatarefValue, DatarefValues, FromSimulator, ToSimulator};
use xplane_bridge::{BridgeError, ConnectOptions, Simulator};

/// A simulator that reports its version and the capture link's port, and loses the first datagrams.
async fn simulator_with_port(port: Option<u16>, lost: usize) -> SocketAddr {
    simulator(1_000.0, lost, move |_| port).await
}

/// A simulator with a running time, and a port that may change with the time since now.
async fn simulator(
    running_s: f32,
    lost: usize,
    port: impl Fn(Duration) -> Option<u16> + Send + 'static,
) -> SocketAddr {
    let began = Instant::now();
    let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let address = socket.local_addr().unwrap();
    tokio::spawn(async move {
        let mut buffer = [0; 2048];
        let mut received = 0;
        loop {
            let (length, from) = socket.recv_from(&mut buffer).await.unwrap();
            received += 1;
            let Ok(ToSimulator::SubscribeDataref(request)) = ToSimulator::decode(&buffer[..length])
            else {
                continue;
            };
            let value = match request.path.as_str() {
                VERSION => Some(120_400.0),
                CAPTURE_PORT => port(began.elapsed()).map(f32::from),
                RUNNING_TIME_S => Some(running_s),
                _ => Some(0.0),
            };
            if let Some(value) = value
                && received > lost
                && !request.is_end()
            {
                let values = vec![DatarefValue {
                    index: request.index,
                    value,
                }];
                let reply = FromSimulator::DatarefValues(DatarefValues { values });
                socket
                    .send_to(&reply.encode().unwrap(), from)
                    .await
                    .unwrap();
            }
        }
    });
    address
}

async fn error_of(address: SocketAddr, timeout: Duration) -> BridgeError {
    let begin = Instant::now();
    let error = Simulator::connect(address, timeout).await.unwrap_err();
    assert!(begin.elapsed() <= timeout, "took {:?}", begin.elapsed());
    error
}

#[tokio::test]
async fn nobody_there_is_said_within_the_time_limit_with_what_to_do() {
    // A port that was free a moment ago (refused), and one with a silent listener.
    let free = UdpSocket::bind("127.0.0.1:0")
        .await
        .unwrap()
        .local_addr()
        .unwrap();
    let silent = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    for address in [free, silent.local_addr().unwrap()] {
        let error = error_of(address, Duration::from_secs(1)).await;
        assert!(
            matches!(error, BridgeError::NobodyAnswers { .. }),
            "{error}"
        );
        let text = error.to_string();
        assert!(
            text.contains("--sim mock") && text.contains("Accept incoming connections"),
            "{text}"
        );
    }
}

#[tokio::test]
async fn x_plane_without_our_plugin_is_told_apart_from_nobody() {
    for port in [None, Some(0)] {
        let address = simulator_with_port(port, 0).await;
        let error = error_of(address, Duration::from_secs(1)).await;
        assert!(matches!(error, BridgeError::NoPlugin { .. }), "{error}");
        assert!(error.to_string().contains("PythonPlugins"), "{error}");
    }
}

#[tokio::test]
async fn a_plugin_that_starts_late_is_waited_for_if_the_simulator_has_just_begun_to_run() {
    let closed = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = closed.local_addr().unwrap().port();
    drop(closed);
    let late = Duration::from_millis(1_500);
    let address = simulator(3.0, 0, move |since| (since > late).then_some(port)).await;
    let error = Simulator::connect(address, Duration::from_secs(1)).await;
    let error = error.unwrap_err();
    assert!(
        matches!(error, BridgeError::CannotOpenLink { .. }),
        "{error}"
    );
}

#[tokio::test]
async fn a_main_menu_that_refuses_a_flight_is_asked_again_with_growing_pauses() {
    let address = simulator_with_port(None, 0).await;
    let (web_api, requests) = server(&[
        ("GET /api/capabilities", 200, CAPABILITIES),
        ("GET /api/v3/datarefs?", 200, r#"{"data":[]}"#),
        ("POST /api/v3/flight", 400, r#"{"error_code":"busy"}"#),
    ])
    .await;
    let options = ConnectOptions {
        web_api: Some(web_api),
        ..ConnectOptions::default()
    };
    let connected = Simulator::connect_with(address, Duration::from_secs(6), options).await;
    let error = connected.unwrap_err();
    assert!(matches!(error, BridgeError::NoPlugin { .. }), "{error}");
    // After 1 and 3 seconds, and not in each of them.
    let requests = requests.lock().unwrap();
    let starts = requests
        .iter()
        .filter(|(request, _)| request.starts_with("POST"));
    assert_eq!(starts.count(), 2, "{requests:?}");
}

#[tokio::test]
async fn a_capture_link_of_another_version_is_refused_although_datagrams_were_lost() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().port();
    let address = simulator_with_port(Some(port), 4).await;
    tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        stream.write_all(b"DTDL\x01\0\0\0").await.unwrap();
        // Stays open: the client must notice the failure without a hang-up.
        std::future::pending::<()>().await;
    });
    let error = error_of(address, Duration::from_secs(3)).await;
    assert!(
        error
            .to_string()
            .contains("version 1 of the capture link, expected 2"),
        "{error}"
    );
}

#[tokio::test]
async fn an_announced_link_that_nobody_serves_is_named() {
    let port = TcpListener::bind("127.0.0.1:0")
        .await
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let address = simulator_with_port(Some(port), 0).await;
    let error = error_of(address, Duration::from_secs(2)).await;
    assert!(
        matches!(error, BridgeError::CannotOpenLink { .. }),
        "{error}"
    );
    assert!(error.to_string().contains(&port.to_string()), "{error}");
}
