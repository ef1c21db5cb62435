use std::sync::Mutex;

use xplane_bridge::datarefs::Generation;

use super::*;
use crate::server::engine::{Instants, OtherAircraft, SceneRenderer, SceneSetting};
use crate::server::world::airport::on_final;
use crate::server::world::flight_start;

const SIZE: (u64, u64) = (32, 24);

/// Draws a single colour: the rain, the tenth of a second at which it falls, and whether an aircraft is within a kilometre of the camera.
struct Plain;

struct PlainPicture {
    rain: u8,
    camera_m: DVec3,
}

impl Engine for Plain {
    fn prepare(&self, scene: &SceneSetting<'_>) -> Box<dyn SceneRenderer> {
        Box::new(PlainPicture {
            rain: (scene.weather.rain_ratio * 200.0) as u8,
            camera_m: scene.camera.center_ecef_m,
        })
    }
}

impl SceneRenderer for PlainPicture {
    fn draw(
        &self,
        (pose, _): (&Pose, &Controls),
        others: &[OtherAircraft],
        instants: Instants,
        rgb: &mut [u8],
    ) {
        let rain = self.rain + (10.0 * instants.weather_s) as u8;
        let mut poses = std::iter::once(pose).chain(others.iter().map(|other| &other.pose));
        let is_near = |pose: &Pose| pose.position().to_ecef().distance(self.camera_m) < 1_000.0;
        let near = u8::from(poses.any(is_near));
        for pixel in rgb.chunks_exact_mut(3) {
            pixel.copy_from_slice(&[rain, 100, near]);
        }
    }
}

/// A scene with some quirks, and the world behind it.
struct Hosted {
    world: Shared,
    scene: PluginScene,
}

impl Hosted {
    fn new(quirks: &str) -> Self {
        Self::with(quirks, PluginOptions::new("unused"))
    }

    fn with(quirks: &str, options: PluginOptions) -> Self {
        let world = World::new(Generation::XPlane12, true, quirks.parse().unwrap());
        let world = Shared(Arc::new(Mutex::new(world)));
        let scene = PluginScene::new(world.clone(), Arc::new(Plain), &options, Faults::default());
        Self { world, scene }
    }

    fn ask(&mut self, what: &str, arguments: Value) -> Value {
        self.scene
            .answer(what, arguments.as_array().unwrap())
            .unwrap_or_else(|| panic!("{what} is no question"))
    }

    fn frame(&mut self) {
        self.ask("begin_frame", json!([]));
    }

    fn get(&mut self, name: &str) -> f64 {
        self.ask("want_nothing", json!([]));
        self.ask("want", json!([name, 0]));
        self.ask("values", json!([]))[0].as_f64().unwrap()
    }

    /// The shares of the image that are panel or pop-up, and its last pixel's colour.
    async fn draw(&self, windows: bool) -> (f64, [u8; 3]) {
        let arguments = [json!(SIZE.0), json!(SIZE.1), json!(windows)];
        let rgb = self.scene.render(&arguments).await.unwrap();
        let plain = |pixel: &[u8]| pixel[1] == 100;
        let covered = rgb.chunks_exact(3).filter(|pixel| !plain(pixel)).count();
        let middle = rgb.chunks_exact(3).find(|pixel| plain(pixel)).unwrap();
        let share = covered as f64 / (SIZE.0 * SIZE.1) as f64;
        (share, [middle[0], middle[1], middle[2]])
    }

    fn start(&mut self, distance_nm: f64) {
        let start = flight_start::FlightStart {
            aircraft: None,
            pose: on_final(distance_nm),
            speed_mps: 72.0,
            zulu: None,
            weather: Vec::new(),
        };
        self.world.lock().begin(&start).unwrap();
    }
}

#[tokio::test]
async fn from_the_cockpit_the_camera_shows_the_panel_until_an_outside_view_is_selected() {
    let mut hosted = Hosted::new("cockpit_view");
    assert!(hosted.draw(false).await.0 > 0.5);
    hosted.ask("command", json!(["sim/view/free_camera"]));
    assert_eq!(hosted.draw(false).await.0, 0.0);
    assert_eq!(hosted.get("sim/graphics/view/view_is_external"), 1.0);
    // Losing the camera returns to the cockpit, and so does a new flight.
    hosted.ask("lose_camera", json!([]));
    assert!(hosted.draw(false).await.0 > 0.5);
    hosted.ask("command", json!(["sim/view/circle"]));
    hosted.start(9.0);
    assert!(hosted.draw(false).await.0 > 0.5);
}

#[tokio::test]
async fn a_pop_up_lies_over_the_windows_but_not_the_scene_until_it_is_closed() {
    let mut hosted = Hosted::new("pop_ups");
    assert_eq!(hosted.draw(false).await.0, 0.0);
    assert!(hosted.draw(true).await.0 > 0.1);
    hosted.ask("command", json!(["sim/instruments/popup_1_close"]));
    assert_eq!(hosted.draw(true).await.0, 0.0);
    hosted.start(9.0);
    assert!(hosted.draw(true).await.0 > 0.1);
    hosted.ask(
        "set",
        json!(["sim/cockpit2/radios/indicators/show_popup", 1, 0]),
    );
    assert_eq!(hosted.draw(true).await.0, 0.0);
}

#[tokio::test]
async fn other_aircraft_are_in_the_picture_until_they_are_removed() {
    let mut hosted = Hosted::new("ai_aircraft");
    // Far enough to the right that only the neighbouring aircraft is within a kilometre.
    let [x, y, z] = hosted.scene.vector(LOCAL_XYZ).to_array();
    let (sin, cos) = ON_THRESHOLD.heading_true_deg.to_radians().sin_cos();
    let camera = json!([x + 1_030.0 * cos, y, z + 1_030.0 * sin, 0.0, 0.0, 0.0]);
    hosted.ask("place_camera", camera);
    assert_eq!(hosted.draw(false).await.1[2], 1);
    hosted.ask("let_others_fly", json!([0]));
    assert_eq!(hosted.ask("others_fly", json!([])), json!(false));
    assert_eq!(hosted.draw(false).await.1[2], 0);
    hosted.start(9.0);
    assert_eq!(hosted.ask("others_fly", json!([])), json!(true));
}

#[tokio::test]
async fn rain_is_drawn_while_time_runs_only() {
    let mut hosted = Hosted::new("particles_stop_when_paused");
    {
        let mut world = hosted.world.lock();
        world.write(names::RAIN, 0.5).unwrap();
        world.write(names::UPDATE_IMMEDIATELY, 1.0).unwrap();
    }
    assert_eq!(hosted.draw(false).await.1[0], 100);
    hosted.ask("command", json!([names::COMMAND_PAUSE_ON]));
    assert_eq!(hosted.draw(false).await.1[0], 0);
}

#[test]
fn altitude_hold_dials_the_altitude_of_the_moment() {
    for (quirks, wanted_ft) in [("none", 2_500.0), ("altitude_hold_captures", 1_000.0)] {
        let mut hosted = Hosted::new(quirks);
        let meters = 1_000.0 * METERS_PER_FOOT;
        hosted.ask("place_user", json!([1.3, 103.95, meters, 23.0, 72.0]));
        hosted.ask("set", json!([ALTITUDE_DIAL_FT, 0, 2_500.0]));
        hosted.ask("command", json!(["sim/autopilot/altitude_hold"]));
        let dialled_ft = hosted.get(ALTITUDE_DIAL_FT);
        assert!(
            (dialled_ft - wanted_ft).abs() < 0.1,
            "{quirks}: {dialled_ft}"
        );
    }
}

#[test]
fn the_autopilot_has_no_power_until_its_master_is_on() {
    let mut hosted = Hosted::new("electric_master_off");
    hosted.ask("place_user", json!([1.3, 103.95, 500.0, 23.0, 72.0]));
    hosted.ask("command", json!([names::COMMAND_SERVOS_ON]));
    assert_eq!(hosted.get(names::AUTOPILOT_MODE), 0.0);
    let master = "sim/cockpit2/autopilot/autopilot_electric_master";
    hosted.ask("set", json!([master, 0, 1]));
    hosted.ask("command", json!([names::COMMAND_SERVOS_ON]));
    assert_eq!(hosted.get(names::AUTOPILOT_MODE), 2.0);
}

#[test]
fn a_flight_that_the_web_api_starts_is_the_plugins_and_the_other_way_round() {
    let mut hosted = Hosted::new("far_away");
    let away_deg = hosted.world.lock().position().latitude_deg;
    assert!(away_deg > 9.0, "{away_deg}");
    (0..60).for_each(|_| hosted.frame());
    let before_s = hosted.get(FLIGHT_TIME_S);
    hosted.start(9.0);
    hosted.frame();
    let flight_s = hosted.get(FLIGHT_TIME_S);
    assert!(
        flight_s < 0.1 && flight_s < before_s,
        "{before_s} {flight_s}"
    );
    let speed_mps = hosted.scene.vector(LOCAL_VELOCITY).length();
    assert!((speed_mps - 72.0).abs() < 1e-3, "{speed_mps}");
    let off_m = |hosted: &Hosted| {
        let found = hosted.scene.aircraft().position();
        found.to_ecef().distance(on_final(9.0).position().to_ecef())
    };
    assert!(off_m(&hosted) < 3.0, "{}", off_m(&hosted));
    let knots = hosted.get(INDICATED_AIRSPEED);
    assert!(knots > 100.0, "{knots}");
    hosted.ask("place_user", json!([1.5, 103.95, 500.0, 23.0, 72.0]));
    hosted.frame();
    let found_deg = hosted.world.lock().position().latitude_deg;
    assert!((found_deg - 1.5).abs() < 1e-3, "{found_deg}");
    let from_origin_m = hosted.scene.vector(LOCAL_XYZ).length();
    assert!(from_origin_m < 100_000.0, "{from_origin_m}");
}

#[test]
fn rates_that_a_plugin_writes_put_the_aircraft_nowhere() {
    let mut hosted = Hosted::new("none");
    hosted.frame();
    let north_m = hosted.scene.vector(LOCAL_XYZ).z - 1_000.0;
    hosted.ask("set", json!([LOCAL_XYZ[2], 0, north_m]));
    hosted.ask("set", json!(["sim/flightmodel/position/Q", 0, 0.0]));
    hosted.frame();
    assert_eq!(hosted.scene.vector(LOCAL_XYZ).z, north_m);
}

#[test]
fn scenery_of_a_new_place_has_no_ground_for_20_s_and_settles_then() {
    let mut hosted = Hosted::new("far_away,slow_scenery,settling_terrain,moving_origin");
    let origin = |hosted: &mut Hosted| hosted.ask("local_to_world", json!([0.0, 0.0, 0.0]));
    let before = origin(&mut hosted);
    hosted.start(9.0);
    let mut heights = Vec::new();
    let mut origins = Vec::new();
    for _ in 0..26 {
        hosted.frame();
        hosted.world.lock().advance(1.0);
        let below = hosted.scene.frame.local(ON_THRESHOLD.position());
        let ground = hosted.ask("ground_below", json!(below.to_array()));
        heights.push(ground.as_array().map(|ground| {
            let local = DVec3::from_array([0, 1, 2].map(|at| ground[at].as_f64().unwrap()));
            let off_m = hosted.scene.frame.world(local).altitude_msl_m - GROUND_MSL_M;
            off_m.round()
        }));
        origins.push(origin(&mut hosted));
    }
    let loading = heights.iter().take_while(|height| height.is_none()).count();
    assert!((19..=21).contains(&loading), "{heights:?}");
    assert!(heights[loading] > Some(2.0), "{heights:?}");
    assert_eq!(heights.last(), Some(&Some(0.0)));
    origins.dedup();
    assert!(origins.len() >= 2 && origins[0] != before, "{origins:?}");
}

async fn bytes(hosted: &Hosted) -> Vec<u8> {
    let arguments = [json!(SIZE.0), json!(SIZE.1), json!(false)];
    hosted.scene.render(&arguments).await.unwrap()
}

#[tokio::test]
async fn a_pause_may_keep_the_pose_water_may_move_and_an_exposure_be_slow() {
    for (quirk, kept, moves, bright) in [
        ("none", false, false, false),
        ("pause_keeps_pose", true, false, false),
        ("water_moves", false, true, false),
        ("slow_exposure", false, false, true),
    ] {
        let mut hosted = Hosted::new(quirk);
        let [x, y, z] = hosted.scene.vector(LOCAL_XYZ).to_array();
        hosted.ask("place_camera", json!([x, y, z, 0.0, 0.0, 0.0]));
        hosted.frame();
        hosted.ask("command", json!([names::COMMAND_PAUSE_ON]));
        hosted.frame();
        let before = bytes(&hosted).await;
        assert_eq!(before[2], 1, "{quirk}: near");
        hosted.frame();
        assert_eq!(bytes(&hosted).await != before, moves, "{quirk}");
        // Two kilometres up no ground is near the camera.
        hosted.ask("set", json!([LOCAL_XYZ[1], 0, y + 2_000.0]));
        hosted.frame();
        assert_eq!(bytes(&hosted).await[2] == 1, kept, "{quirk}");
        hosted.ask("place_camera", json!([x, y, z, 40.0, 0.0, 0.0]));
        hosted.frame();
        assert_eq!(bytes(&hosted).await[1] > 100, bright, "{quirk}");
    }
}

#[tokio::test]
async fn rain_falls_and_clouds_drift_while_time_runs_only() {
    for (quirk, moves) in [("none", false), ("weather_moves", true)] {
        let mut hosted = Hosted::new(quirk);
        hosted.frame();
        let before = bytes(&hosted).await;
        (0..60).for_each(|_| hosted.frame());
        let after = bytes(&hosted).await;
        assert_eq!(before != after, moves, "{quirk}");
        hosted.ask("command", json!([names::COMMAND_PAUSE_ON]));
        (0..60).for_each(|_| hosted.frame());
        assert_eq!(bytes(&hosted).await, after, "{quirk}");
    }
}

#[tokio::test]
async fn the_scene_is_as_many_frames_behind_as_the_options_say_or_else_the_quirk() {
    for (quirk, option, frames) in [
        ("none", None, 0),
        ("stale_frames", None, 4),
        ("stale_frames", Some(SceneBehind::Constant(1)), 1),
        ("none", Some(SceneBehind::Constant(3)), 3),
    ] {
        let options = PluginOptions {
            scene_behind: option,
            ..PluginOptions::new("unused")
        };
        let counted = options.frames_drawn.clone();
        let mut hosted = Hosted::with(quirk, options);
        let [x, y, z] = hosted.scene.vector(LOCAL_XYZ).to_array();
        hosted.ask("place_camera", json!([x, y, z, 0.0, 0.0, 0.0]));
        (0..9).for_each(|_| hosted.frame());
        // Two kilometres up no ground is near the camera.
        hosted.ask("set", json!([LOCAL_XYZ[1], 0, y + 2_000.0]));
        let mut old = 0;
        for _ in 0..9 {
            old += usize::from(bytes(&hosted).await[2] == 1);
            hosted.frame();
        }
        assert_eq!(old, frames, "{quirk} {option:?}");
        assert_eq!(counted.get(), 18);
    }
}
