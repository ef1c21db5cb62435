//! Our plugin's own Python, hosted by the stand-in, draws what the built-in link draws, however the simulator around it misbehaves.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
#[cfg(target_os = "linux")]
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::time::Duration;

use dataset::geometry::approach_profile::ApproachProfile;
use dataset::geometry::distortion::Distortion;
use dataset::geometry::echo::{aircraft_mismatch, camera_mismatch};
use dataset::geometry::imaging::{Degradation, Imaging, Sensor};
use dataset::geometry::pose::{Controls, FlightState, Pose};
use mock_xplane::server::{LinkServer, PluginOptions, ServerOptions, serve};
#[cfg(target_os = "linux")]
use mock_xplane::window::X11Window;
use testkit::short_flight::{noon, runway};
#[cfg(target_os = "linux")]
use testkit_simulator::Xvfb;
use testkit_simulator::client;
use testkit_simulator::{quiet, serving};
use xplane_bridge::datarefs::{self, Generation};
use xplane_bridge::fly::{FlightStart, FlyRequest};
use xplane_bridge::link::PixelKind;
use xplane_bridge::pixels::{FfmpegScreen, PixelChoice, Screen};
#[cfg(target_os = "linux")]
use xplane_bridge::pixels::{Grab, PixelError, Rectangle, RgbPicture};
use xplane_bridge::udp::subscription::Subscription;
use xplane_bridge::{CaptureRequest, CapturedFrame, Deliver, Simulator};

const SIZE_PX: (u32, u32) = (160, 120);
/// Python starts within a fraction of a second on an idle machine.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(30);

fn plugin() -> PluginOptions {
    testkit_simulator::plugin::options(SIZE_PX)
}

async fn connected(generation: Generation, link: LinkServer) -> Simulator {
    let address = serving(ServerOptions {
        generation,
        link,
        ..quiet()
    })
    .await;
    Simulator::connect(address, CONNECT_TIMEOUT).await.unwrap()
}

/// Waits until datarefs read so.
async fn until_read(watch: &mut Subscription, wanted: &[f32]) {
    let seen = async {
        while watch
            .readings()
            .iter()
            .zip(wanted)
            .any(|(reading, wanted)| reading.is_none_or(|reading| reading.value != *wanted))
        {
            watch.changed().await;
        }
    };
    let seen = tokio::time::timeout(CONNECT_TIMEOUT, seen).await;
    assert!(seen.is_ok(), "{wanted:?}: {:?}", watch.readings());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_is_killed_leaves_the_simulator_as_it_was_found() {
    let address = serving(ServerOptions {
        link: LinkServer::Plugin(plugin()),
        quirks: "real_weather_at_start,cockpit_view".parse().unwrap(),
        ..quiet()
    })
    .await;
    let names = [
        datarefs::OVERRIDE_FLIGHT_MODEL,
        datarefs::PAUSED,
        "sim/graphics/view/field_of_view_deg",
        datarefs::CHANGE_MODE,
        datarefs::USE_SYSTEM_TIME,
        "sim/graphics/view/view_is_external",
        "sim/cockpit2/switches/landing_lights_switch[0]",
    ];
    let mut watch = Subscription::start(address, names.map(str::to_owned), 20)
        .await
        .unwrap();
    // Real weather, the computer's clock, the cockpit, in the dark.
    let found = [0.0, 0.0, 60.0, 7.0, 1.0, 0.0, 0.0];
    until_read(&mut watch, &found).await;
    for _ in 0..2 {
        let mut simulator = Simulator::connect(address, CONNECT_TIMEOUT).await.unwrap();
        simulator.set_conditions(&noon(30_000.0)).await.unwrap();
        simulator.freeze(&runway()).await.unwrap();
        let drawn = CaptureRequest {
            deliver: Deliver::Drawn,
            ..capture(1)
        };
        simulator.send_capture(&drawn).await.unwrap();
        simulator.receive_frame().await.unwrap();
        until_read(&mut watch, &[1.0, 1.0, 20.0, 3.0, 0.0, 1.0, 1.0]).await;
        // As `kill -9` does: the connection ends without a word.
        drop(simulator);
        until_read(&mut watch, &found).await;
    }
    watch.end().await;
}

/// The aircraft in a different attitude each tick, seen large from a camera that is turned and rolled as well.
fn capture(tick: u32) -> CaptureRequest {
    let step = f64::from(tick);
    let aircraft = Pose {
        latitude_deg: 1.30 + step / 200.0,
        longitude_deg: 103.956 + step / 300.0,
        altitude_msl_m: 300.0 - 20.0 * step,
        heading_true_deg: 23.0 + 40.0 * step,
        pitch_deg: 8.0 - 5.0 * step,
        roll_deg: 25.0 - 15.0 * step,
    };
    let bearing_deg = 10.0 + 25.0 * step;
    let at = aircraft
        .position()
        .lat_lon()
        .destination(bearing_deg, 220.0);
    let camera = Pose {
        latitude_deg: at.latitude_deg,
        longitude_deg: at.longitude_deg,
        altitude_msl_m: aircraft.altitude_msl_m - 15.0,
        heading_true_deg: bearing_deg + 180.0 + 2.0,
        pitch_deg: 4.0,
        roll_deg: 3.0 * step,
    };
    CaptureRequest {
        controls: Controls {
            flap_ratio: 0.5,
            gear_ratio: 1.0,
        },
        ..client::capture(tick, aircraft, (camera, 20.0), SIZE_PX)
    }
}

async fn pictures(simulator: &mut Simulator) -> Vec<CapturedFrame> {
    simulator.set_conditions(&noon(30_000.0)).await.unwrap();
    simulator.freeze(&runway()).await.unwrap();
    let mut frames = Vec::new();
    let deliver = simulator.deliver();
    for tick in 0..4 {
        let capture = CaptureRequest {
            deliver,
            ..capture(tick)
        };
        simulator.send_capture(&capture).await.unwrap();
        frames.push(simulator.receive_frame().await.unwrap());
    }
    frames
}

/// Mean and largest difference of two images, levels of 255.
fn difference(a: &[u8], b: &[u8]) -> (f64, u8) {
    assert_eq!(a.len(), b.len());
    let each = || a.iter().zip(b).map(|(a, b)| a.abs_diff(*b));
    let sum: f64 = each().map(f64::from).sum();
    (sum / a.len() as f64, each().max().unwrap_or(0))
}

/// A lens, bent light and noise.
fn imaging() -> Imaging {
    Imaging {
        distortion: Some(Distortion {
            k1: -0.5,
            ..Distortion::default()
        }),
        refraction_coefficient: 0.13,
        degradation: Some(Degradation {
            sensor: Some(Sensor {
                full_well_electrons: 5_000.0,
                read_noise_electrons: 4.0,
                exposure_ev: 0.0,
            }),
            seed: 9,
            ..Degradation::default()
        }),
    }
}

async fn picture(simulator: &mut Simulator) -> Vec<u8> {
    simulator.send_capture(&capture(1)).await.unwrap();
    simulator.receive_frame().await.unwrap().rgb.to_vec()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_stand_in_draws_through_lens_air_and_sensor_until_the_next_freeze() {
    let mut simulator = connected(Generation::XPlane11, LinkServer::BuiltIn).await;
    simulator.set_conditions(&noon(30_000.0)).await.unwrap();
    simulator.freeze(&runway()).await.unwrap();
    let ideal = picture(&mut simulator).await;
    simulator
        .freeze_with_imaging(&runway(), &[imaging()])
        .await
        .unwrap();
    let drawn = picture(&mut simulator).await;
    assert!(difference(&drawn, &ideal).0 > 1.0);
    assert!(
        drawn == picture(&mut simulator).await,
        "noise is not that of its seed and instant"
    );
    // Views other than the one with the lens are ideal.
    simulator
        .freeze_with_imaging(&runway(), &[Imaging::default(), imaging()])
        .await
        .unwrap();
    assert!(picture(&mut simulator).await == ideal);

    let folding = Imaging {
        distortion: Some(Distortion {
            k1: -40.0,
            ..Distortion::default()
        }),
        ..Imaging::default()
    };
    simulator
        .freeze_with_imaging(&runway(), &[folding])
        .await
        .unwrap();
    simulator.send_capture(&capture(1)).await.unwrap();
    let error = simulator.receive_frame().await.unwrap_err().to_string();
    assert!(error.contains("folds the image over"), "{error}");
    let endless = Imaging {
        degradation: Some(Degradation {
            blur_sigma_px: 1e9,
            ..Degradation::default()
        }),
        ..Imaging::default()
    };
    let error = simulator.freeze_with_imaging(&runway(), &[endless]).await;
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("blur_sigma_px 1000000000 is out of range"),
        "{error}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn x_plane_behind_its_plugin_refuses_what_it_cannot_draw() {
    let mut simulator = connected(Generation::XPlane11, LinkServer::Plugin(plugin())).await;
    assert!(!simulator.description().imaging);
    let error = simulator
        .freeze_with_imaging(&runway(), &[Imaging::default(), imaging()])
        .await;
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("X-Plane draws images of ideal pinholes") && error.contains("view 1"),
        "{error}"
    );
    simulator
        .freeze_with_imaging(&runway(), &[Imaging::default()])
        .await
        .unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_plugins_pictures_are_those_of_the_built_in_link_in_any_attitude_and_under_disturbance()
{
    let mut built_in = connected(Generation::XPlane11, LinkServer::BuiltIn).await;
    let wanted = pictures(&mut built_in).await;
    let disturbed = PluginOptions {
        steal_camera_every_frames: Some(7),
        move_origin_every_frames: Some(5),
        ..plugin()
    };
    for options in [plugin(), disturbed] {
        let mut simulator = connected(Generation::XPlane11, LinkServer::Plugin(options)).await;
        let description = simulator.description().clone();
        assert_eq!(description.name, "X-Plane");
        assert!(description.plugin.unwrap().starts_with("dtd_bridge "));
        assert_eq!(description.pixels, [PixelKind::Gl, PixelKind::Screen]);
        let found = pictures(&mut simulator).await;
        assert_like(&found, &wanted);
        assert!(
            found
                .windows(2)
                .all(|pair| pair[0].header.sim_frame < pair[1].header.sim_frame)
        );
        simulator.release().await.unwrap();
    }
    // The measure can fail: the next tick's image is far from this one's.
    let (mean, _) = difference(&wanted[0].rgb, &wanted[1].rgb);
    assert!(mean > 2.0, "{mean}");
}

/// All images equal the wanted ones, except for a few edge pixels: a camera some millimetres aside.
fn assert_like(found: &[CapturedFrame], wanted: &[CapturedFrame]) {
    for (tick, (found, wanted)) in found.iter().zip(wanted).enumerate() {
        let asked = capture(tick as u32);
        assert_eq!(aircraft_mismatch(&found.header.pose, &asked.pose), None);
        assert_eq!(camera_mismatch(&found.header.camera, &asked.camera), None);
        let (mean, largest) = difference(&found.rgb, &wanted.rgb);
        assert!(mean < 0.1, "tick {tick}: {mean} {largest}");
    }
}

#[cfg(target_os = "linux")]
#[tokio::test(flavor = "multi_thread")]
async fn a_frame_that_somebody_replaces_while_it_is_grabbed_is_grabbed_again() {
    let xvfb = Xvfb::start(&format!("{}x{}x24", SIZE_PX.0, SIZE_PX.1));
    let window = X11Window::open(Some(xvfb.display()), SIZE_PX).unwrap();
    let address = serving(ServerOptions {
        generation: Generation::XPlane12,
        link: LinkServer::Plugin(plugin()),
        quirks: "cockpit_view".parse().unwrap(),
        stage: Some(Arc::new(window)),
        ..quiet()
    })
    .await;
    let mut simulator = Simulator::connect(address, CONNECT_TIMEOUT).await.unwrap();
    let disturbances = Arc::new(Disturbances {
        simulator: address,
        pending: AtomicU32::new(0),
    });
    let screen: Arc<dyn Screen> = Arc::new(DisturbedScreen {
        screen: FfmpegScreen::of_display(xvfb.display()),
        disturbances: disturbances.clone(),
    });
    let choice = PixelChoice::Only(PixelKind::Screen);
    simulator
        .use_pixels(choice, SIZE_PX, &screen)
        .await
        .unwrap();
    let wanted = pictures(&mut simulator).await;
    let deliver = simulator.deliver();
    for (tick, wanted) in wanted.iter().enumerate() {
        let capture = CaptureRequest {
            deliver,
            ..capture(tick as u32)
        };
        disturbances.pending.store(1 + tick as u32, Relaxed);
        simulator.send_capture(&capture).await.unwrap();
        let found = simulator.receive_frame().await.unwrap();
        assert_eq!(disturbances.pending.load(Relaxed), 0);
        assert!(found.rgb == wanted.rgb, "tick {tick}");
    }
    // A client that does it all the time gets no image, and a reason.
    disturbances.pending.store(u32::MAX, Relaxed);
    let capture = CaptureRequest {
        deliver,
        ..capture(0)
    };
    simulator.send_capture(&capture).await.unwrap();
    let error = simulator.receive_frame().await.unwrap_err().to_string();
    assert!(error.contains("each of the 5 times"), "{error}");
}

/// Grabs while the user looks into the cockpit.
#[cfg(target_os = "linux")]
struct Disturbances {
    simulator: SocketAddr,
    pending: AtomicU32,
}

#[cfg(target_os = "linux")]
struct DisturbedScreen {
    screen: FfmpegScreen,
    disturbances: Arc<Disturbances>,
}

#[cfg(target_os = "linux")]
impl std::fmt::Debug for DisturbedScreen {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:?}, disturbed", self.screen)
    }
}

#[cfg(target_os = "linux")]
impl Screen for DisturbedScreen {
    fn name(&self) -> String {
        self.screen.name()
    }

    fn open(&self, part: Option<Rectangle>) -> Result<Box<dyn Grab>, PixelError> {
        Ok(Box::new(DisturbedGrab {
            grab: self.screen.open(part)?,
            disturbances: self.disturbances.clone(),
        }))
    }
}

#[cfg(target_os = "linux")]
struct DisturbedGrab {
    grab: Box<dyn Grab>,
    disturbances: Arc<Disturbances>,
}

#[cfg(target_os = "linux")]
impl Grab for DisturbedGrab {
    fn grab(&mut self, picture: &mut RgbPicture) -> Result<(), PixelError> {
        self.grab.grab(picture)?;
        let pending = self.disturbances.pending.load(Relaxed);
        if pending == 0 {
            return Ok(());
        }
        self.disturbances.pending.store(pending - 1, Relaxed);
        // The plugin takes the view back within some frames: this is repeated until a grab sees a different view.
        let keyboard = std::net::UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let right = picture.rgb.clone();
        // On a busy machine many grabs fit between two frames.
        let began = std::time::Instant::now();
        while began.elapsed() < Duration::from_secs(20) {
            let key = b"CMND\0sim/view/3d_cockpit_cmnd_look";
            keyboard.send_to(key, self.disturbances.simulator).unwrap();
            self.grab.grab(picture)?;
            if picture.rgb != right {
                return Ok(());
            }
        }
        panic!("the cockpit is never seen");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn x_plane_12_has_no_readback_but_draws_probes_and_shows_the_check_pattern() {
    let mut simulator = connected(Generation::XPlane12, LinkServer::Plugin(plugin())).await;
    assert_eq!(simulator.description().version, "12.4.0");
    assert_eq!(simulator.description().pixels, [PixelKind::Screen]);
    simulator.freeze(&runway()).await.unwrap();
    simulator.send_capture(&capture(0)).await.unwrap();
    let error = simulator.receive_frame().await.unwrap_err();
    assert!(error.to_string().contains("Vulkan or Metal"), "{error}");
    let shown = simulator.check_pattern(Some(7)).await.unwrap();
    let gone = simulator.check_pattern(None).await.unwrap();
    let drawn = CaptureRequest {
        deliver: Deliver::Drawn,
        ..capture(1)
    };
    simulator.send_capture(&drawn).await.unwrap();
    let frame = simulator.receive_frame().await.unwrap();
    assert!(shown < gone && gone < frame.header.sim_frame && frame.rgb.is_empty());
    assert_eq!(aircraft_mismatch(&frame.header.pose, &drawn.pose), None);
    simulator.release().await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_live_approach_through_the_plugin_lands_where_the_built_in_one_does() {
    let start = runway()
        .point_on_approach(6_000.0, 0.0)
        .at_altitude_m(320.0);
    let request = FlyRequest {
        start: FlightStart {
            position: start,
            heading_true_deg: 23.02,
            speed_mps: 76.0,
        },
        runway: runway(),
        profile: ApproachProfile::GlidePath {
            level_altitude_msl_m: 320.0,
        },
        seed: 0,
        time_limit_s: 400.0,
        already_started: false,
    };
    let coarse = PluginOptions {
        frame_period_s: 0.1,
        move_origin_every_frames: Some(97),
        ..plugin()
    };
    let mut flown = Vec::new();
    for link in [LinkServer::BuiltIn, LinkServer::Plugin(coarse)] {
        let mut simulator = connected(Generation::XPlane12, link).await;
        simulator.set_conditions(&noon(30_000.0)).await.unwrap();
        let states = simulator.fly(&request).await.unwrap();
        assert!(states.last().unwrap().on_ground);
        simulator.release().await.unwrap();
        flown.push(states);
    }
    let touchdown = |states: &[FlightState]| {
        let landed = states.iter().find(|state| state.on_ground).unwrap();
        landed.pose.position().lat_lon()
    };
    let apart_m = touchdown(&flown[0]).distance_m(touchdown(&flown[1]));
    // The plugin engages the autopilot in the air, a frame or two of 0.1 s after the start: 7 m each.
    assert!(apart_m < 30.0, "touchdowns {apart_m} m apart");
    let begin = flown[1][0]
        .pose
        .position()
        .to_ecef()
        .distance(start.to_ecef());
    assert!(begin < 30.0, "starts {begin} m off");
    // Positions move as velocities say, in spite of jumps of the local origin. Turns and flare within 0.1 s remain as a difference.
    for pair in flown[1].windows(2) {
        let way = pair[1].position_ecef() - pair[0].position_ecef();
        let step_s = pair[1].time_s - pair[0].time_s;
        let expected = (pair[0].velocity_ecef() + pair[1].velocity_ecef()) * (step_s / 2.0);
        let off_m = way.distance(expected);
        assert!(off_m < 0.2, "{off_m} m: {pair:?}");
    }
}

#[tokio::test]
async fn a_folder_without_the_plugin_is_named() {
    let options = ServerOptions {
        port: 0,
        beacon: false,
        link: LinkServer::Plugin(PluginOptions::new("/no/such/folder")),
        ..ServerOptions::default()
    };
    let error = serve(options, |_| ()).await.unwrap_err();
    assert!(error.to_string().contains("/no/such/folder"), "{error}");
}
