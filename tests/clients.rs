//! Other people's X-Plane clients, unmodified, against `dtd mock-xplane` as a process.
//!
//! They were written against X-Plane itself: where the stand-in differs, they fail. The Python ones are in `tests/clients/` and run
//! in the environment that `scripts/setup.sh` creates for them.

use std::net::Ipv4Addr;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use mock_xplane::server::Addresses;
use testkit::command::{Dtd, Server};
use testkit::skipped;
use tokio::sync::Mutex;
use tokio::time::{Instant, timeout_at};
use xpudpc::{Beacon, PlacementConfig, Response, StartType, XPlaneClient};

/// Clients listen to the beacon's port in mutually exclusive ways.
static BEACON_PORT: Mutex<()> = Mutex::const_new(());

/// Listens like X-Plane. These clients join the beacon's group on the default interface, which a simulator that is bound to the loopback
/// interface does not reach.
const EVERYWHERE: [&str; 2] = ["--bind", "0.0.0.0"];

/// Timeout of everything on a busy computer.
const PATIENCE: Duration = Duration::from_secs(20);

/// Runs while the server lives.
struct StandIn {
    _server: Server,
    addresses: Addresses,
}

fn stand_in(options: &[&str]) -> StandIn {
    let mut command = Dtd::at(env!("CARGO_BIN_EXE_dtd")).command(&["mock-xplane", "--port", "0"]);
    command
        .args(["--until-stdin-ends", "--quirks=none"])
        .args(options)
        // Without one the capture link is not opened to everybody.
        .env("DTD_LINK_TOKEN", "clients");
    let server = Server::start(&mut command);
    let mut addresses: Addresses = serde_json::from_value(server.ready().clone()).unwrap();
    addresses.udp.set_ip(Ipv4Addr::LOCALHOST.into());
    StandIn {
        _server: server,
        addresses,
    }
}

/// Python with the clients.
const PYTHON: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/.venv-clients/bin/python");

fn assert_installed() {
    assert!(
        Path::new(PYTHON).exists(),
        "{PYTHON} is missing: run scripts/setup.sh"
    );
}

/// True if Python is new enough for the clients that need 3.12; skips the test otherwise.
fn is_new_enough(client: &str) -> bool {
    assert_installed();
    let new_enough = Command::new(PYTHON)
        .args(["-c", "import sys; sys.exit(sys.version_info < (3, 12))"])
        .status()
        .unwrap()
        .success();
    if !new_enough {
        skipped(&format!(
            "{client} needs Python 3.12 or newer: install one and run scripts/setup.sh again"
        ));
    }
    new_enough
}

fn run(script: &str, arguments: &[String]) {
    let script = format!("{}/tests/clients/{script}", env!("CARGO_MANIFEST_DIR"));
    let output = Command::new(PYTHON)
        .arg(script)
        .args(arguments)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success() && said.trim_end().ends_with("ok"),
        "{said}\n{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

#[test]
fn pyxpudpserver_discovers_subscribes_reads_writes_and_commands() {
    let _alone = BEACON_PORT.blocking_lock();
    assert_installed();
    let stand_in = stand_in(&EVERYWHERE);
    let port = stand_in.addresses.udp.port().to_string();
    run("pyxpudpserver_client.py", &[port]);
}

#[test]
fn pyxpudp_subscribes_reads_writes_and_commands() {
    if !is_new_enough("pyXPUDP") {
        return;
    }
    let stand_in = stand_in(&["--no-beacon"]);
    let port = stand_in.addresses.udp.port().to_string();
    run("pyxpudp_client.py", &[port]);
}

#[test]
fn xpwebapi_discovers_and_speaks_udp_and_rest() {
    if !is_new_enough("xpwebapi") {
        return;
    }
    let _alone = BEACON_PORT.blocking_lock();
    let stand_in = stand_in(&EVERYWHERE);
    let web_api = stand_in.addresses.web_api.unwrap();
    let ports = [stand_in.addresses.udp.port(), web_api.port()].map(|port| port.to_string());
    run("xpwebapi_client.py", &ports);
}

/// Receives until `wanted` succeeds.
async fn receive<T>(
    client: &XPlaneClient,
    what: &str,
    mut wanted: impl FnMut(Response) -> Option<T>,
) -> T {
    let end = Instant::now() + PATIENCE;
    loop {
        let response = timeout_at(end, client.recv())
            .await
            .unwrap_or_else(|_| panic!("{what} did not come"))
            .unwrap();
        if let Some(found) = wanted(response) {
            return found;
        }
    }
}

async fn value(client: &XPlaneClient, wanted: f32) {
    receive(
        client,
        &format!("the value {wanted}"),
        |response| match response {
            Response::DatarefValues(values) => {
                values.iter().any(|v| v.value == wanted).then_some(())
            }
            _ => None,
        },
    )
    .await;
}

#[tokio::test]
async fn xpudpc_discovers_the_stand_in_with_and_without_a_name() {
    let _alone = BEACON_PORT.lock().await;
    for options in [
        &[][..],
        &["--state", "nameless-beacon"],
        &["--xplane", "11"],
    ] {
        let stand_in = stand_in(&[&EVERYWHERE[..], options].concat());
        let end = Instant::now() + PATIENCE;
        // Other simulators may run on this computer.
        let beacon = loop {
            let beacon = timeout_at(end, Beacon::find(None)).await.unwrap().unwrap();
            if beacon.port == stand_in.addresses.udp.port() {
                break beacon;
            }
        };
        let version = if options.contains(&"11") {
            115_501
        } else {
            124_009
        };
        assert_eq!(beacon.version_number, version);
        let client = XPlaneClient::connect((beacon.ip, beacon.port))
            .await
            .unwrap();
        client
            .subscribe_dataref(20, 1, "sim/version/xplane_internal_version")
            .await
            .unwrap();
        value(&client, version as f32).await;
    }
}

#[tokio::test]
async fn xpudpc_subscribes_reads_writes_commands_and_starts_a_flight() {
    let stand_in = stand_in(&["--no-beacon"]);
    let client = XPlaneClient::connect(stand_in.addresses.udp).await.unwrap();
    let frequency = "sim/cockpit/radios/nav1_freq_hz";
    client.subscribe_dataref(20, 7, frequency).await.unwrap();
    value(&client, 11_030.0).await;
    client.set_dataref(frequency, 11_090.0).await.unwrap();
    value(&client, 11_090.0).await;
    client.unsubscribe_dataref(7).await.unwrap();
    client
        .subscribe_dataref(20, 8, "sim/time/paused")
        .await
        .unwrap();
    client.send_command("sim/operation/pause_on").await.unwrap();
    value(&client, 1.0).await;
    client
        .send_command("sim/operation/pause_off")
        .await
        .unwrap();
    value(&client, 0.0).await;
    client.unsubscribe_dataref(8).await.unwrap();

    client.request_position(30).await.unwrap();
    client
        .load_aircraft(0, "Aircraft/other.acf", 0)
        .await
        .unwrap();

    // A new flight flies, and its rates are not zero.
    let start = PlacementConfig {
        start_type: StartType::SpecifyLatLonEle,
        latitude: 1.1,
        longitude: 103.9,
        elevation: 762.0,
        heading: 23.0,
        speed: 80.0,
        ..PlacementConfig::default()
    };
    client.place_aircraft(&start).await.unwrap();
    receive(&client, "a flying aircraft", |response| match response {
        Response::Position(position) => {
            let flies = position.speed_south < -70.0 && position.latitude > 1.1;
            (flies && position.roll_rate != 0.0 && position.roll_rate.abs() < 0.1).then_some(())
        }
        _ => None,
    })
    .await;

    // The stream of positions may be stopped from a different socket.
    let other = XPlaneClient::connect(stand_in.addresses.udp).await.unwrap();
    other.stop_position().await.unwrap();
    let end = Instant::now() + PATIENCE;
    // Ten times as long as between two frames.
    while client
        .recv_timeout(Duration::from_millis(300))
        .await
        .is_ok()
    {
        assert!(Instant::now() < end, "positions after their end");
    }
}
