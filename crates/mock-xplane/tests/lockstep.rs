//! The stand-in and the bridge's client over real sockets: conditions, flights, images in lockstep, and leaving.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use airframe::AircraftType;
use dataset::conditions::{Clock, CloudKind, CloudLayer, Conditions, Weather};
use dataset::geometry::approach_profile::ApproachProfile;
use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::geometry::runway::Runway;
use mock_xplane::server::{
    Engine, Instants, NotFlown, OtherAircraft, SceneRenderer, SceneSetting, ServerOptions,
};
use mock_xplane::window::{DisplayWindow, WindowError};
use testkit::changi_02l;
use testkit_simulator::client::{self, captured, level};
use testkit_simulator::{Running, quiet};
use tokio::net::UdpSocket;
use tokio::time::timeout;
use xplane_bridge::datarefs::ZULU_TIME_S;
use xplane_bridge::fly::{FlightStart, FlyRequest};
use xplane_bridge::link::{LinkToken, PixelKind, SimulatorWindow};
use xplane_bridge::packet::{FromSimulator, SubscribeDataref, ToSimulator};
use xplane_bridge::pixels::{RgbPicture, check_pattern};
use xplane_bridge::udp::discovery::{DISCOVERY_TIMEOUT, announced};
use xplane_bridge::udp::subscription::Subscription;
use xplane_bridge::{
    BridgeError, CONNECT_TIMEOUT, CaptureRequest, ConnectOptions, Deliver, Simulator,
};

/// Writes the image's time into every byte, slower for even ticks so that images finish out of order, and remembers the requests.
#[derive(Default)]
struct Scribe {
    prepared: Mutex<Vec<(Weather, Clock)>>,
    flown: Mutex<Vec<(FlyRequest, Weather)>>,
}

struct Page;

impl Engine for Scribe {
    fn fly(
        &self,
        request: &FlyRequest,
        aircraft: &AircraftType,
        weather: &Weather,
    ) -> Result<Vec<FlightState>, NotFlown> {
        assert_eq!(aircraft.name, "B737-800");
        let flight = (request.clone(), weather.clone());
        self.flown.lock().unwrap().push(flight);
        if request.seed == 13 {
            return Err(NotFlown::Because("thirteen is unlucky"));
        }
        let state = |i: u32| FlightState {
            time_s: f64::from(i) / 3.0,
            pose: pose(i),
            velocity_north_mps: 70.0,
            velocity_east_mps: 30.0,
            velocity_down_mps: 4.0,
            true_airspeed_mps: 76.3,
            controls: Controls::default(),
            on_ground: i == 999,
        };
        Ok((0..1_000).map(state).collect())
    }

    fn prepare(&self, scene: &SceneSetting<'_>) -> Box<dyn SceneRenderer> {
        self.prepared
            .lock()
            .unwrap()
            .push((scene.weather.clone(), *scene.clock));
        Box::new(Page)
    }
}

impl SceneRenderer for Page {
    fn draw(&self, _: (&Pose, &Controls), _: &[OtherAircraft], instants: Instants, rgb: &mut [u8]) {
        let time_s = instants.lamps_s;
        if (time_s as u32).is_multiple_of(2) {
            std::thread::sleep(Duration::from_millis(20));
        }
        rgb.fill(time_s as u8);
    }
}

/// A stand-in with this engine.
async fn start(engine: Arc<dyn Engine>) -> Running {
    Running::start_with(quiet(), engine).await
}

async fn connected(running: &Running) -> Simulator {
    Simulator::connect(running.addresses.udp, CONNECT_TIMEOUT)
        .await
        .unwrap()
}

fn runway() -> Runway {
    Runway {
        course_magnetic_deg: Some(22.7),
        ..changi_02l()
    }
}

fn conditions() -> Conditions {
    Conditions {
        time_of_day: "06:00".into(),
        clock: Clock {
            day_of_year: 80,
            zulu_time_s: 79_200.5,
        },
        weather_name: "stormy".into(),
        weather: Weather {
            visibility_m: 8_000.0,
            clouds: vec![CloudLayer {
                kind: CloudKind::Stratus,
                cover_ratio: 0.875,
                base_msl_m: 600.0,
                top_msl_m: 2_500.0,
            }],
            rain_ratio: 0.5,
            wind_speed_mps: 10.0,
            wind_from_true_deg: 340.0,
            turbulence_ratio: 0.25,
        },
    }
}

fn pose(tick: u32) -> Pose {
    Pose {
        latitude_deg: 1.2 + f64::from(tick) / 3_000.0,
        longitude_deg: 103.9 + f64::from(tick) / 7_000.0,
        altitude_msl_m: 762.0 - f64::from(tick) / 7.0,
        heading_true_deg: 23.021_4,
        pitch_deg: 2.5,
        roll_deg: -0.1,
    }
}

fn fly_request(seed: u64) -> FlyRequest {
    let runway = runway();
    let position = runway.point_on_approach(18_520.0, 0.0).at_altitude_m(762.0);
    FlyRequest {
        start: FlightStart {
            position,
            heading_true_deg: 23.02,
            speed_mps: 90.0,
        },
        runway,
        profile: ApproachProfile::GlidePath {
            level_altitude_msl_m: 762.0,
        },
        seed,
        time_limit_s: 900.0,
        already_started: false,
    }
}

fn capture(tick: u32, view: u32) -> CaptureRequest {
    let camera = Pose {
        pitch_deg: 1.6,
        ..level(1.36 + f64::from(view) / 1_000.0, 103.98, 16.7, 203.0)
    };
    CaptureRequest {
        time_ns: i64::from(tick) * 1_000_000_000,
        view,
        controls: Controls {
            flap_ratio: 0.5,
            gear_ratio: 1.0,
        },
        ..client::capture(tick, pose(tick), (camera, 10.0), (40, 30))
    }
}

fn nearly(found: &Weather, wanted: &Weather) -> bool {
    let same = (found.visibility_m - wanted.visibility_m).abs() < 0.01;
    same && Weather {
        visibility_m: wanted.visibility_m,
        ..found.clone()
    } == *wanted
}

/// Waits until the clock is ahead of the one that was set.
async fn until_the_clock_runs(address: SocketAddr) {
    let mut watch = Subscription::start(address, [ZULU_TIME_S.to_owned()], 20)
        .await
        .unwrap();
    let later = async {
        while watch.readings()[0]
            .is_none_or(|reading| f64::from(reading.value) <= conditions().clock.zulu_time_s)
        {
            watch.changed().await;
        }
    };
    let seen = timeout(Duration::from_secs(20), later).await;
    assert!(seen.is_ok(), "{:?}", watch.readings());
    watch.end().await;
}

#[tokio::test]
async fn what_was_set_over_udp_is_what_is_flown_and_drawn() {
    let scribe = Arc::new(Scribe::default());
    let running = start(scribe.clone()).await;
    let mut simulator = connected(&running).await;
    assert_eq!(simulator.description().name, "mock-xplane");
    assert_eq!(simulator.description().version, "12.4.0");

    simulator.set_conditions(&conditions()).await.unwrap();
    let states = simulator.fly(&fly_request(1)).await.unwrap();
    assert_eq!(states.len(), 1_000);
    // To the last bit: a flight does not go through 32-bit datarefs.
    assert_eq!(states[500].pose, pose(500));
    assert!(nearly(
        &scribe.flown.lock().unwrap()[0].1,
        &conditions().weather
    ));

    // The clock runs until it is frozen, and is exact then.
    until_the_clock_runs(running.addresses.udp).await;
    simulator.freeze(&runway()).await.unwrap();
    captured(&mut simulator, &capture(0, 0)).await;
    let (weather, clock) = scribe.prepared.lock().unwrap()[0].clone();
    assert!(nearly(&weather, &conditions().weather), "{weather:?}");
    assert_eq!(clock, conditions().clock);
    simulator.release().await.unwrap();
}

#[tokio::test]
async fn a_flight_is_begun_by_the_web_api_of_the_same_simulator_and_without_it_by_udp_and_link() {
    let scribe = Arc::new(Scribe::default());
    let running = start(scribe.clone()).await;
    let other = start(Arc::new(Scribe::default())).await;
    // With the Web API, without one, and with a different simulator's, which must not be commanded by mistake.
    for web_api in [running.addresses.web_api, None, other.addresses.web_api] {
        let options = ConnectOptions {
            web_api,
            ..ConnectOptions::default()
        };
        let mut simulator =
            Simulator::connect_with(running.addresses.udp, CONNECT_TIMEOUT, options)
                .await
                .unwrap();
        simulator.set_aircraft("B737-800");
        simulator.set_conditions(&conditions()).await.unwrap();
        let states = simulator.fly(&fly_request(1)).await.unwrap();
        assert_eq!(states[500].pose, pose(500));
        simulator.release().await.unwrap();
    }
    let flown = scribe.flown.lock().unwrap();
    let begun_already: Vec<bool> = flown.iter().map(|(fly, _)| fly.already_started).collect();
    assert_eq!(begun_already, [true, false, false]);
    for (_, weather) in flown.iter() {
        assert!(nearly(weather, &conditions().weather), "{weather:?}");
    }
}

#[tokio::test]
async fn pipelined_captures_are_answered_in_order_with_their_own_picture_and_pose() {
    let scribe = Arc::new(Scribe::default());
    let running = start(scribe.clone()).await;
    let mut simulator = connected(&running).await;
    simulator.freeze(&runway()).await.unwrap();
    let requests: Vec<_> = (0..40)
        .flat_map(|tick| [capture(tick, 0), capture(tick, 1)])
        .collect();
    let mut frames = Vec::new();
    let mut sent = 0;
    for received in 0..requests.len() {
        while sent < requests.len().min(received + 12) {
            simulator.send_capture(&requests[sent]).await.unwrap();
            sent += 1;
        }
        let frame = simulator.receive_frame().await.unwrap();
        frames.push((
            frame.header.tick,
            frame.header.view,
            frame.header.sim_frame,
            frame.header.pose,
            frame.header.camera,
            frame.rgb[0],
        ));
        assert!(
            frame
                .rgb
                .iter()
                .all(|&byte| byte == frame.header.tick as u8)
        );
        assert_eq!(frame.rgb.len(), 40 * 30 * 3);
        simulator.recycle(frame.rgb);
    }
    for (request, frame) in requests.iter().zip(&frames) {
        assert_eq!((frame.0, frame.1), (request.tick, request.view));
        assert_eq!(frame.3, request.pose);
        assert_eq!(frame.4, request.camera);
    }
    assert!(
        frames.windows(2).all(|pair| pair[0].2 < pair[1].2),
        "frame numbers do not grow"
    );
    // Two cameras, one weather: prepared once each.
    assert_eq!(scribe.prepared.lock().unwrap().len(), 2);
    assert!(matches!(
        simulator.receive_frame().await,
        Err(BridgeError::NothingOutstanding)
    ));
    simulator.release().await.unwrap();
}

#[tokio::test]
async fn refusals_come_with_their_reason_and_leave_the_link_usable() {
    let running = start(Arc::new(Scribe::default())).await;
    let mut simulator = connected(&running).await;
    simulator.send_capture(&capture(0, 0)).await.unwrap();
    let error = simulator.receive_frame().await.unwrap_err();
    assert!(error.to_string().contains("send freeze first"), "{error}");
    let error = simulator.fly(&fly_request(13)).await.unwrap_err();
    assert!(error.to_string().contains("thirteen is unlucky"), "{error}");
    let blind = CaptureRequest {
        width_px: 0,
        ..capture(0, 0)
    };
    let error = simulator.send_capture(&blind).await.unwrap_err();
    assert!(error.to_string().contains("width_px is 0"), "{error}");
    simulator.freeze(&runway()).await.unwrap();
    assert_eq!(
        captured(&mut simulator, &capture(3, 0)).await.header.tick,
        3
    );
}

#[tokio::test]
async fn the_client_is_told_who_serves_the_link() {
    let running = start(Arc::new(Scribe::default())).await;
    let simulator = connected(&running).await;
    assert_eq!(simulator.description().plugin, None);
    assert_eq!(simulator.description().pixels, [PixelKind::Link]);
    assert_eq!(simulator.description().window, None);
}

/// An invisible window that keeps its images.
#[derive(Debug, Default)]
struct Wall(Mutex<Vec<RgbPicture>>);

impl DisplayWindow for Wall {
    fn describe(&self) -> Result<SimulatorWindow, WindowError> {
        Ok(SimulatorWindow {
            title: "wall".into(),
            x_px: 0,
            y_px: 0,
            width_px: capture(0, 0).width_px,
            height_px: capture(0, 0).height_px,
            scale: 1.0,
        })
    }

    fn show(&self, picture: &RgbPicture) -> Result<(), WindowError> {
        self.0.lock().unwrap().push(picture.clone());
        Ok(())
    }
}

async fn start_on(wall: Arc<Wall>) -> Running {
    let on_wall = ServerOptions {
        stage: Some(wall),
        ..quiet()
    };
    Running::start_with(on_wall, Arc::new(Scribe::default())).await
}

#[tokio::test]
async fn a_stand_in_without_a_window_shows_nothing_and_says_how_to_have_one() {
    let running = start(Arc::new(Scribe::default())).await;
    let mut simulator = connected(&running).await;
    simulator.freeze(&runway()).await.unwrap();
    let error = simulator.check_pattern(Some(1)).await.unwrap_err();
    assert!(error.to_string().contains("--window"), "{error}");
    let drawn = CaptureRequest {
        deliver: Deliver::Drawn,
        ..capture(0, 0)
    };
    simulator.send_capture(&drawn).await.unwrap();
    let error = simulator.receive_frame().await.unwrap_err();
    assert!(error.to_string().contains("--window"), "{error}");
}

#[tokio::test]
async fn nothing_is_captured_under_the_check_pattern() {
    let wall = Arc::new(Wall::default());
    let running = start_on(wall.clone()).await;
    let mut simulator = connected(&running).await;
    simulator.freeze(&runway()).await.unwrap();
    let shown = simulator.check_pattern(Some(0xDEAD_BEEF)).await.unwrap();
    let seen = check_pattern::read(wall.0.lock().unwrap().last().unwrap());
    assert_eq!(seen.map(|seen| seen.code), Ok(0xDEAD_BEEF));
    simulator.send_capture(&capture(0, 0)).await.unwrap();
    let error = simulator.receive_frame().await.unwrap_err();
    assert!(error.to_string().contains("check pattern"), "{error}");
    let gone = simulator.check_pattern(None).await.unwrap();
    let frame = captured(&mut simulator, &capture(0, 0)).await;
    assert!(shown < gone && gone < frame.header.sim_frame);
}

#[tokio::test]
async fn a_frame_that_is_only_drawn_has_no_payload() {
    let wall = Arc::new(Wall::default());
    let running = start_on(wall.clone()).await;
    let mut simulator = connected(&running).await;
    simulator.freeze(&runway()).await.unwrap();
    let drawn = CaptureRequest {
        deliver: Deliver::Drawn,
        ..capture(7, 0)
    };
    for request in [drawn, capture(8, 0)] {
        let frame = captured(&mut simulator, &request).await;
        assert_eq!(request.payload_bytes(), frame.rgb.len());
        assert_eq!(frame.header.pose, request.pose);
    }
    let shown = wall.0.lock().unwrap();
    assert_eq!(shown.len(), 1, "only what was to be drawn");
    assert_eq!(shown[0].rgb, vec![7; drawn.rgb_bytes()]);
}

#[tokio::test]
async fn a_link_with_a_token_admits_who_knows_it_and_refuses_all_others() {
    let guarded = ServerOptions {
        token: LinkToken::new("sesame"),
        ..quiet()
    };
    let running = Running::start_with(guarded, Arc::new(Scribe::default())).await;
    let connect = |token: Option<&str>| {
        let token = token.map(str::to_owned);
        Simulator::connect_with(
            running.addresses.udp,
            CONNECT_TIMEOUT,
            ConnectOptions {
                token,
                ..ConnectOptions::default()
            },
        )
    };
    for wrong in [None, Some("Sesame"), Some("")] {
        let error = connect(wrong).await.unwrap_err();
        assert!(error.to_string().contains("DTD_LINK_TOKEN"), "{error}");
    }
    connect(Some("sesame")).await.unwrap();
}

#[tokio::test]
async fn a_plain_udp_client_gets_its_values_and_none_after_it_unsubscribed() {
    let running = start(Arc::new(Scribe::default())).await;
    let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let simulator = running.addresses.udp;
    // As XPlaneConnectX asks: `0` as fifth byte, `[0]` behind a scalar.
    let path = "sim/version/xplane_internal_version[0]".to_owned();
    let request = SubscribeDataref {
        frequency_hz: 100,
        index: 42,
        path,
    };
    let mut datagram = ToSimulator::SubscribeDataref(request).encode().unwrap();
    datagram[4] = b'0';
    socket.send_to(&datagram, simulator).await.unwrap();
    let mut buffer = [0; 2048];
    for _ in 0..3 {
        let (length, from) = socket.recv_from(&mut buffer).await.unwrap();
        assert_eq!(from.ip(), simulator.ip());
        assert_ne!(from.port(), simulator.port(), "as X-Plane: from 49001");
        assert_eq!(&buffer[..5], b"RREF,");
        let Ok(FromSimulator::DatarefValues(reply)) = FromSimulator::decode(&buffer[..length])
        else {
            panic!("not a reply");
        };
        assert_eq!(
            (reply.values[0].index, reply.values[0].value),
            (42, 124_009.0)
        );
    }
    let end = SubscribeDataref {
        frequency_hz: 0,
        index: 42,
        path: String::new(),
    };
    let end = ToSimulator::SubscribeDataref(end).encode().unwrap();
    socket.send_to(&end, simulator).await.unwrap();
    // Twenty times as long as between two frames.
    let end = Instant::now() + Duration::from_secs(20);
    let next = async |buffer: &mut [u8]| {
        let received = timeout(Duration::from_millis(200), socket.recv(buffer)).await;
        received.is_ok()
    };
    while next(&mut buffer).await {
        assert!(
            Instant::now() < end,
            "values after the end of the subscription"
        );
    }
}

#[tokio::test]
async fn the_built_in_engine_flies_to_the_runway() {
    let running = Running::start(quiet()).await;
    let mut simulator = connected(&running).await;
    let mut calm = conditions();
    calm.weather.clouds.clear();
    calm.weather.rain_ratio = 0.0;
    calm.clock.zulu_time_s = 4.0 * 3_600.0;
    simulator.set_conditions(&calm).await.unwrap();
    let states = simulator.fly(&fly_request(7)).await.unwrap();
    let last = states.last().unwrap();
    let target = runway().touchdown_target().lat_lon();
    assert!(last.on_ground);
    assert!(
        target.distance_m(last.pose.position().lat_lon()) < 2_500.0,
        "{last:?}"
    );
    simulator.release().await.unwrap();
}

#[tokio::test]
async fn a_stand_in_on_this_computer_is_found_with_its_port_and_version() {
    let announcing = ServerOptions {
        beacon: true,
        ..quiet()
    };
    let running = Running::start(announcing).await;
    let address = running.addresses.udp;
    // A second one may run on this computer, so that the wanted one need not be the only one.
    let found = announced(DISCOVERY_TIMEOUT, Some(address)).await;
    let found = found.unwrap();
    let this = found
        .iter()
        .find(|one| one.address.port() == address.port());
    let this = this.unwrap_or_else(|| panic!("{address} is not among {found:?}"));
    assert_eq!(this.address, address);
    assert_eq!((this.beacon.host, this.beacon.version), (1, 124_009));
}
