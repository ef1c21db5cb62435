//! Names of X-Plane that client and plugin touch: only names of the running version, whatever they do.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use dataset::conditions::{CloudKind, CloudLayer, Conditions, Weather};
use dataset::geometry::approach_profile::ApproachProfile;
use dataset::geometry::pose::Pose;
use mock_xplane::server::{LinkServer, PluginOptions, ServerOptions};
use testkit::changi_02l;
use testkit::short_flight::noon;
use testkit_simulator::client::{self, captured, examined, level};
use testkit_simulator::{plugin, quiet, serving};
use xplane_bridge::datarefs::Generation;
use xplane_bridge::doctor::{Measuring, Verdict};
use xplane_bridge::fly::{FlightStart, FlyRequest};
use xplane_bridge::udp::subscription::Subscription;
use xplane_bridge::{CaptureRequest, Deliver, Simulator};

const SIZE_PX: (u32, u32) = (96, 64);
/// The stand-in's count of looked-up names that are not in its version.
const FOREIGN_NAMES: &str = "dtd/mock/foreign_names";
const CONNECT_TIMEOUT: Duration = Duration::from_secs(30);
const GENERATIONS: [Generation; 2] = [Generation::XPlane11, Generation::XPlane12];

async fn stand_in(generation: Generation, link: LinkServer) -> SocketAddr {
    serving(ServerOptions {
        generation,
        link,
        ..quiet()
    })
    .await
}

async fn read(address: SocketAddr, name: &str) -> f32 {
    let mut watch = Subscription::start(address, [name.to_owned()], 20)
        .await
        .unwrap();
    while watch.readings()[0].is_none() {
        watch.changed().await;
    }
    let value = watch.readings()[0].as_ref().unwrap().value;
    watch.end().await;
    value
}

fn storm() -> Conditions {
    Conditions {
        weather_name: "storm".into(),
        weather: Weather {
            visibility_m: 8_000.0,
            clouds: vec![CloudLayer {
                kind: CloudKind::Cumulonimbus,
                cover_ratio: 0.75,
                base_msl_m: 600.0,
                top_msl_m: 9_000.0,
            }],
            rain_ratio: 0.5,
            wind_speed_mps: 10.0,
            wind_from_true_deg: 30.0,
            turbulence_ratio: 0.1,
        },
        ..noon(8_000.0)
    }
}

fn capture(deliver: Deliver) -> CaptureRequest {
    let at = |along_m, up_m, heading_true_deg| {
        let place = changi_02l().point_on_approach(along_m, -20.0);
        Pose {
            pitch_deg: 3.0,
            ..level(
                place.latitude_deg,
                place.longitude_deg,
                up_m,
                heading_true_deg,
            )
        }
    };
    let pose = at(2_000.0, 120.0, 23.0);
    CaptureRequest {
        deliver,
        ..client::capture(1, pose, (at(0.0, 10.0, 203.0), 20.0), SIZE_PX)
    }
}

/// Weather, images and a live flight.
async fn use_everything(address: SocketAddr, deliver: Deliver) {
    let runway = changi_02l();
    let mut simulator = Simulator::connect(address, CONNECT_TIMEOUT).await.unwrap();
    simulator.set_conditions(&storm()).await.unwrap();
    simulator.freeze(&runway).await.unwrap();
    captured(&mut simulator, &capture(deliver)).await;
    let flight = FlyRequest {
        start: FlightStart {
            position: runway.point_on_approach(1_500.0, 0.0).at_altitude_m(86.0),
            heading_true_deg: 23.02,
            speed_mps: 76.0,
        },
        runway: runway.clone(),
        profile: ApproachProfile::GlidePath {
            level_altitude_msl_m: 200.0,
        },
        seed: 0,
        time_limit_s: 400.0,
        already_started: false,
    };
    simulator.fly(&flight).await.unwrap();
    simulator.release().await.unwrap();
}

fn hosted(folder: PathBuf) -> LinkServer {
    LinkServer::Plugin(PluginOptions {
        window_px: SIZE_PX,
        frame_period_s: 0.1,
        ..PluginOptions::new(folder)
    })
}

#[ignore = "waits in real time for minutes: cargo test --release --workspace --test names -- --ignored"]
#[tokio::test(flavor = "multi_thread")]
async fn client_and_plugin_look_up_no_name_of_another_version() {
    for generation in GENERATIONS {
        for link in [LinkServer::BuiltIn, hosted(plugin::folder())] {
            let reads_back =
                matches!(link, LinkServer::BuiltIn) || generation == Generation::XPlane11;
            let deliver = if reads_back {
                Deliver::Picture
            } else {
                Deliver::Drawn
            };
            let is_hosted = matches!(link, LinkServer::Plugin(_));
            let address = stand_in(generation, link).await;
            let checks = examined(address, Measuring::Once).await;
            let complaints = checks
                .iter()
                .find(|check| check.name == "complaints")
                .unwrap();
            let wanted = if is_hosted {
                Verdict::Ok
            } else {
                Verdict::Skipped
            };
            assert_eq!(complaints.verdict, wanted, "{complaints:?}");
            use_everything(address, deliver).await;
            let foreign = read(address, FOREIGN_NAMES).await;
            assert_eq!(foreign, 0.0, "{generation:?}, hosted: {is_hosted}");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_plugin_that_looks_up_a_deprecated_name_is_reported_and_spoils_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let rude = plugin::with(
        folder.path(),
        &[(
            "datarefs.py",
            "    USE_REAL_WEATHER, MODERN_DRIVER,",
            "    MODERN_DRIVER,",
        )],
    );
    let address = stand_in(Generation::XPlane12, hosted(rude)).await;
    let checks = examined(address, Measuring::Once).await;
    let complaints = checks
        .iter()
        .find(|check| check.name == "complaints")
        .unwrap();
    assert_eq!(complaints.verdict, Verdict::Warning, "{complaints:?}");
    assert!(
        complaints.found.contains("use_real_weather_bool"),
        "{complaints:?}"
    );
    assert_eq!(read(address, FOREIGN_NAMES).await, 1.0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_reads_a_deprecated_name_gets_x_planes_error_into_its_pictures() {
    let address = stand_in(Generation::XPlane12, LinkServer::BuiltIn).await;
    let mut simulator = Simulator::connect(address, CONNECT_TIMEOUT).await.unwrap();
    simulator.freeze(&changi_02l()).await.unwrap();
    let mut pictures = Vec::new();
    for name in [
        "sim/time/paused",
        "sim/cockpit2/controls/flap_ratio",
        "sim/weather/use_real_weather_bool",
    ] {
        read(address, name).await;
        simulator
            .send_capture(&capture(Deliver::Picture))
            .await
            .unwrap();
        pictures.push(simulator.receive_frame().await.unwrap().rgb.to_vec());
    }
    assert_eq!(pictures[0], pictures[1], "that one is only logged");
    let changed = pictures[1]
        .chunks(3)
        .zip(pictures[2].chunks(3))
        .filter(|(a, b)| a != b)
        .count();
    let share = changed as f64 / f64::from(SIZE_PX.0 * SIZE_PX.1);
    assert!((0.03..0.07).contains(&share), "{share}");
    assert_eq!(read(address, FOREIGN_NAMES).await, 2.0);
    simulator.release().await.unwrap();
}
