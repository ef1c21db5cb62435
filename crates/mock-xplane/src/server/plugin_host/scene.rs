//! Answers the fake `xp`: the plugin's view of the stand-in's world, in X-Plane's local coordinates.
//!
//! Position, attitude and camera are stored here as in X-Plane: metres and angles about the axes of the local origin. Everything
//! else (time, weather, pause, radios) belongs to the world, which the client sets over UDP.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use dataset::geometry::camera::CameraPose;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::imaging::Imaging;
use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::geometry::runway::Runway;
use dataset::numbers::units::{METERS_PER_FOOT, MPS_PER_KNOT};
use glam::{DMat3, DQuat, DVec3, EulerRot};
use serde_json::{Value, json};
use tokio::task::spawn_blocking;
use xplane_bridge::datarefs as names;
use xplane_bridge::fly::FlightStart;
use xplane_bridge::pixels::RgbPicture;

use super::behind::{SceneBehind, Shots};
use super::flight::{self, Playback};
use super::own::{
    ALTITUDE_DIAL_FT, ENGINES_RUNNING, FLAPS, FLIGHT_TIME_S, GEAR, INDICATED_AIRSPEED,
    LOCAL_VELOCITY, LOCAL_XYZ, ON_GROUND, OWN, TRUE_AIRSPEED, VERTICAL_SPEED_FPM,
};
use super::shot::{Exposure, Painter, Shot, Windows};
use super::window_covers::WindowCovers;
use super::{FramesDrawn, PluginOptions};
use crate::datarefs::{Dataref, Datarefs, Kind};
use crate::quirks::{Quirk, Quirks};
use crate::render::overlay::Canvas;
use crate::server::engine::Engine;
use crate::server::faults::drawing::CodeFault;
use crate::server::scenes::{SceneKey, Scenes};
use crate::server::world::World;
use crate::server::world::airport::{GROUND_MSL_M, ON_THRESHOLD};
use crate::server::world::motion::FLYING_MPS;
use crate::server::world::scenery::local_frame::LocalFrame;
use crate::server::{Faults, Shared};
use crate::window::DisplayWindow;

const POSITION: &str = "sim/flightmodel/position/";
const VIEW: &str = "sim/graphics/view/";
/// Order of the camera's list.
const CAMERA: [&str; 6] = [
    "view_x",
    "view_y",
    "view_z",
    "view_pitch",
    "view_heading",
    "view_roll",
];
const FRAME_PERIOD: &str = "sim/operation/misc/frame_rate_period";
const PAUSED: &str = "sim/time/paused";
const MINUTE_S: f64 = 60.0;
/// Duration of a frame that a driver inserts: half a frame at 60 frames per second.
const INSERTED_FOR: Duration = Duration::from_millis(8);
/// Prefix of the autopilot's commands.
const AUTOPILOT: &str = "sim/autopilot/";
/// Positions to which the local origin moves on demand: the corners of X-Plane's one-degree square are its farthest positions from the
/// airport.
const ORIGINS: [(f64, f64); 3] = [(1.5, 103.5), (1.4, 104.4), (1.0, 103.9)];

#[derive(Debug, Clone, PartialEq)]
struct PictureToDraw {
    key: SceneKey,
    painter: Painter,
    shot: Shot,
}

/// The plugin's side of the world.
pub(super) struct PluginScene {
    world: Shared,
    engine: Arc<dyn Engine>,
    scenes: Arc<Scenes>,
    frame: LocalFrame,
    own: Datarefs,
    /// Values that the fake reads together.
    wanted: Vec<(String, usize)>,
    frames: u64,
    frames_drawn: FramesDrawn,
    window_covers: WindowCovers,
    /// [`FLIGHT_TIME_S`] with full precision.
    flight_time_s: f64,
    /// Time that has run, without pauses, for what drifts and falls.
    weather_time_s: f64,
    flight: Option<Playback>,
    move_origin_every_frames: Option<u32>,
    quirks: Quirks,
    /// Number of placements of the aircraft by others at the last check.
    placements: u64,
    shots: Shots,
    /// The last image before the pause, if a pause freezes it.
    before_pause: Option<Shot>,
    exposure: Exposure,
    window_px: (u32, u32),
    /// The content of the window: the scene, the simulator's windows over it, and the rectangles that the plugin drew.
    shown: Option<(PictureToDraw, Windows, Value)>,
    /// Image memory, which is drawn over.
    memory: Vec<u8>,
    faults: Faults,
    began: Instant,
    /// The frame's number that was shown last, as rectangles.
    last_code: Value,
}

impl PluginScene {
    pub(super) fn new(
        world: Shared,
        engine: Arc<dyn Engine>,
        options: &PluginOptions,
        faults: Faults,
    ) -> Self {
        let (frame, parked, placements, quirks) = {
            let mut world = world.lock();
            let (width, height) = options.window_px;
            world.set_own(&format!("{VIEW}window_width"), f64::from(width));
            world.set_own(&format!("{VIEW}window_height"), f64::from(height));
            world.set_own(FRAME_PERIOD, options.frame_period_s);
            let (parked, _) = world.aircraft();
            (world.host(), parked, world.placements, world.quirks)
        };
        let mut scene = Self {
            world,
            engine,
            scenes: Arc::default(),
            frame,
            own: Datarefs::of(OWN),
            wanted: Vec::new(),
            frames: 0,
            frames_drawn: options.frames_drawn.clone(),
            window_covers: options.window_covers.clone(),
            flight_time_s: 0.0,
            weather_time_s: 0.0,
            flight: None,
            move_origin_every_frames: options.move_origin_every_frames,
            quirks,
            placements,
            shots: Shots::new(scene_behind(options, quirks), quirks),
            before_pause: None,
            exposure: Exposure::NEW,
            window_px: options.window_px,
            shown: None,
            memory: Vec::new(),
            faults,
            began: Instant::now(),
            last_code: Value::Null,
        };
        scene.put_aircraft(&parked.pose);
        scene
    }

    /// The answer to a question, or null to a statement; `None` if the fake never says it.
    pub(super) fn answer(&mut self, what: &str, arguments: &[Value]) -> Option<Value> {
        let text = |at: usize| arguments.get(at)?.as_str();
        let number = |at: usize| arguments.get(at)?.as_f64();
        let vector = || Some(DVec3::new(number(0)?, number(1)?, number(2)?));
        let index = || arguments.get(1)?.as_u64().map(|index| index as usize);
        match what {
            "kind" => return Some(self.kind(text(0)?)),
            "want" => {
                let (name, at) = (text(0)?, index()?);
                self.get(name, at)?;
                self.wanted.push((name.to_owned(), at));
            }
            "want_nothing" => self.wanted.clear(),
            "values" => {
                let values = self.wanted.iter().map(|(name, at)| self.get(name, *at));
                return Some(json!(values.collect::<Option<Vec<f64>>>()?));
            }
            "set" => self.set(text(0)?, index()?, number(2)?),
            "command" => {
                let path = text(0)?;
                if path.starts_with(AUTOPILOT) && !self.flies() {
                    tracing::warn!(
                        path,
                        "ignored: the autopilot of an aircraft that does not fly"
                    );
                    return Some(json!(false));
                }
                let known = self.world.lock().command(path);
                self.capture_on_command(path);
                return Some(json!(known));
            }
            "knows_command" => {
                let path = text(0)?;
                return Some(json!(World::commands().any(|known| known == path)));
            }
            "lose_camera" => self.world.lock().lose_camera(),
            "let_others_fly" => self.world.lock().let_others_fly(number(0)? != 0.0),
            "others_fly" => return Some(json!(self.world.lock().others_fly)),
            "place_user" => self.begin_flight(place(vector()?), number(3)?, number(4)?),
            "world_to_local" => {
                return Some(json!(self.frame.local(place(vector()?)).to_array()));
            }
            "local_to_world" => return Some(coordinates(self.frame.world(vector()?))),
            "ground_below" => {
                let ground = self.ground_below(vector()?);
                return Some(json!(ground.map(|ground| ground.to_array())));
            }
            "publish" => self.world.lock().set_own(text(0)?, number(1)?),
            "begin_frame" => {
                let frame = self.begin_frame();
                return Some(json!([frame, coordinates(self.frame.origin)]));
            }
            "own_camera" => self.show_own_view(),
            "place_camera" => {
                let mut world = self.world.lock();
                for (at, name) in CAMERA.into_iter().enumerate() {
                    world.set_own(&format!("{VIEW}{name}"), number(at)?);
                }
            }
            "log" => tracing::info!(plugin = text(0)?),
            _ => return None,
        }
        Some(Value::Null)
    }

    /// The image of the plugin's pose and camera, with overlays: `windows` too, or not yet.
    pub(super) async fn render(&self, arguments: &[Value]) -> Option<Vec<u8>> {
        let side = |at: usize| u32::try_from(arguments.get(at)?.as_u64()?).ok();
        let (width_px, height_px) = (side(0)?, side(1)?);
        let windows = arguments.get(2)?.as_bool()?;
        let frame = self.frame_to_draw(width_px, height_px);
        let mut rgb = self.draw(frame, Vec::new()).await?;
        if windows {
            self.windows()
                .draw(&mut canvas(&mut rgb, (width_px, height_px)));
        }
        Some(rgb)
    }

    /// Shows the frame in a window, with rectangles that the plugin drew under the windows of the user interface or over them, unless
    /// it is already shown.
    pub(super) async fn show_frame(
        &mut self,
        rectangles: &Value,
        stage: &Arc<dyn DisplayWindow>,
    ) -> Result<(), String> {
        let (width_px, height_px) = self.window_px;
        let frame = self.frame_to_draw(width_px, height_px);
        let fault = self.fault_of_code(rectangles);
        let rectangles = &self.shown_code(rectangles, fault);
        let shown = (frame.clone(), self.windows(), rectangles.clone());
        if self.shown.as_ref() == Some(&shown) {
            return Ok(());
        }
        let memory = std::mem::take(&mut self.memory);
        let last = (fault == Some(CodeFault::Inserted)).then(|| memory.clone());
        let Some(mut rgb) = self.draw(frame, memory).await else {
            return Err("the frame was not drawn".into());
        };
        let mut canvas = canvas(&mut rgb, (width_px, height_px));
        fill_rectangles(&mut canvas, rectangles, false);
        shown.1.draw(&mut canvas);
        fill_rectangles(&mut canvas, rectangles, true);
        let picture = RgbPicture {
            width_px,
            height_px,
            rgb,
        };
        let stage = stage.clone();
        let result = spawn_blocking(move || {
            if let Some(inserted) = last.and_then(|last| mean(&last, &picture)) {
                stage.show(&inserted)?;
                thread::sleep(INSERTED_FOR);
            }
            stage.show(&picture).map(|()| picture.rgb)
        })
        .await;
        self.memory = result
            .map_err(|error| error.to_string())?
            .map_err(|error| error.to_string())?;
        self.shown = Some(shown);
        Ok(())
    }

    /// The fault of the number that these rectangles are; the check pattern, which stays for many frames, has none.
    fn fault_of_code(&self, rectangles: &Value) -> Option<CodeFault> {
        let first = rectangles.as_array()?.first()?;
        if is_check_pattern(first) {
            return None;
        }
        (self.faults.codes).of_frame(self.frames, self.faults.seed)
    }

    /// The rectangles that are shown for the ones that the plugin drew: a frame's number may be an earlier one, or missing.
    fn shown_code(&mut self, rectangles: &Value, fault: Option<CodeFault>) -> Value {
        let drawn = rectangles.as_array().map_or(&[][..], Vec::as_slice);
        if drawn.first().is_none_or(is_check_pattern) {
            return rectangles.clone();
        }
        match fault {
            Some(CodeFault::Vanished) => return Value::Null,
            Some(CodeFault::Half) => return json!(drawn[..drawn.len() / 2]),
            Some(CodeFault::Repeated) if !self.last_code.is_null() => {}
            _ => self.last_code.clone_from(rectangles),
        }
        self.last_code.clone()
    }

    /// Draws a frame over an image of any size.
    async fn draw(&self, frame: PictureToDraw, mut rgb: Vec<u8>) -> Option<Vec<u8>> {
        let (engine, scenes) = (self.engine.clone(), self.scenes.clone());
        let drawn = spawn_blocking(move || {
            let PictureToDraw { key, painter, shot } = frame;
            rgb.resize(key.width_px as usize * key.height_px as usize * 3, 0);
            scenes.with(engine.as_ref(), &key, |picture| {
                painter.draw(picture, &shot, (key.width_px, key.height_px), &mut rgb);
            });
            rgb
        });
        drawn.await.ok()
    }

    /// The windows of the user interface now.
    fn windows(&self) -> Windows {
        let world = self.world.lock();
        Windows {
            pop_up: world.shows_pop_up(),
            alert: world.shows_alert,
            shown: self.window_covers.shown(),
        }
    }

    /// The scene of the current frame, in a size.
    fn frame_to_draw(&self, width_px: u32, height_px: u32) -> PictureToDraw {
        let mut shot = self.shots.drawn(self.shot());
        if let Some(before) = self.before_pause {
            shot = before;
        }
        let world = self.world.lock();
        let paused = world.datarefs().get(PAUSED) != 0.0;
        let mut weather = world.weather();
        if paused && self.quirks.has(Quirk::ParticlesStopWhenPaused) {
            weather.rain_ratio = 0.0;
        }
        let mut clock = world.clock();
        if !paused {
            // Changes within a minute are invisible, and preparing an image for every instant is too expensive.
            clock.zulu_time_s = (clock.zulu_time_s / MINUTE_S).floor() * MINUTE_S;
        }
        PictureToDraw {
            key: SceneKey {
                camera: shot.camera,
                // Like X-Plane, whose plugin rejects anything else.
                imaging: Imaging::default(),
                width_px,
                height_px,
                runway: scenery(),
                weather,
                clock,
                aircraft: world.aircraft_type(),
            },
            painter: Painter {
                scale: world.aircraft_scale(),
                other: world.others_fly.then(|| world.aircraft_type()),
                panel: shot.panel,
                gain: if self.quirks.has(Quirk::SlowExposure) {
                    self.exposure.gain()
                } else {
                    1.0
                },
                swing: self
                    .faults
                    .swing
                    .map(|swing| (swing, self.faults.seed, self.began.elapsed().as_secs_f64())),
                wave: self.quirks.has(Quirk::WaterMoves).then_some(self.frames),
            },
            shot,
        }
    }

    /// The shot that would be drawn now.
    fn shot(&self) -> Shot {
        let world = self.world.lock();
        let view = |name: &str| world.datarefs().get(&format!("{VIEW}{name}"));
        Shot {
            camera: CameraPose {
                pose: self.pose(
                    DVec3::new(view("view_x"), view("view_y"), view("view_z")),
                    rotation(view("view_heading"), view("view_pitch"), view("view_roll")),
                ),
                hfov_deg: view("field_of_view_deg"),
            },
            pose: self.aircraft(),
            controls: self.controls(),
            panel: world.shows_panel(),
            weather_time_s: if self.quirks.has(Quirk::WeatherMoves) {
                self.weather_time_s
            } else {
                0.0
            },
        }
    }

    /// X-Plane's own view, which clients do not control: from the aircraft.
    fn show_own_view(&self) {
        let [x, y, z] = self.vector(LOCAL_XYZ).to_array();
        let angle = |name: &str| self.own(&format!("{POSITION}{name}"))[0];
        let own = [x, y, z, angle("theta"), angle("psi"), angle("phi")];
        let mut world = self.world.lock();
        for (name, value) in CAMERA.into_iter().zip(own) {
            world.set_own(&format!("{VIEW}{name}"), value);
        }
    }

    /// Some modes of the autopilot capture the current value when they are switched on.
    fn capture_on_command(&mut self, path: &str) {
        if !self.quirks.has(Quirk::AltitudeHoldCaptures) {
            return;
        }
        match path {
            "sim/autopilot/altitude_hold" => {
                let altitude_ft = self.aircraft().altitude_msl_m / METERS_PER_FOOT;
                self.put(ALTITUDE_DIAL_FT, altitude_ft);
            }
            "sim/autopilot/vertical_speed" => {
                let up_mps = self.own(LOCAL_VELOCITY[1])[0];
                self.put(VERTICAL_SPEED_FPM, up_mps * 60.0 / METERS_PER_FOOT);
            }
            _ => {}
        }
    }

    /// Adopts a placement by a different client, and the origin of local coordinates.
    fn look_at_world(&mut self) {
        let (placements, (state, speed_mps), frame, flight_time_s) = {
            let world = self.world.lock();
            let flight_time_s = world.datarefs().get(FLIGHT_TIME_S);
            (
                world.placements,
                world.aircraft(),
                world.frame(),
                flight_time_s,
            )
        };
        if placements != self.placements {
            self.placements = placements;
            self.frame = frame;
            // A flight that has begun counts from 0, an aircraft that was moved continues counting.
            self.flight_time_s = flight_time_s;
            self.put(FLIGHT_TIME_S, flight_time_s);
            self.adopt(state, speed_mps);
        } else if frame != self.frame {
            let pose = self.aircraft();
            self.frame = frame;
            self.put_aircraft(&pose);
        }
    }

    /// A flight that was started from outside, or an aircraft that was moved.
    fn adopt(&mut self, state: FlightState, speed_mps: f64) {
        self.flight = None;
        let (sin, cos) = state.pose.heading_true_deg.to_radians().sin_cos();
        if !state.on_ground {
            self.start_engines();
        }
        self.show(&FlightState {
            velocity_north_mps: speed_mps * cos,
            velocity_east_mps: speed_mps * sin,
            true_airspeed_mps: speed_mps,
            controls: self.controls(),
            ..state
        });
    }

    fn start_engines(&mut self) {
        if let Some((_, engines)) = self.own.values_mut(ENGINES_RUNNING) {
            engines[..2].fill(1.0);
        }
    }

    /// Reports the aircraft's position to the world.
    fn tell_world(&self) {
        let pose = self.aircraft();
        let velocity_local = self.vector(LOCAL_VELOCITY);
        let ned = pose.position().ecef_from_ned().transpose()
            * self.frame.origin.ecef_from_ned()
            * DVec3::new(-velocity_local.z, velocity_local.x, -velocity_local.y);
        let state = FlightState {
            time_s: self.flight_time_s,
            pose,
            velocity_north_mps: ned.x,
            velocity_east_mps: ned.y,
            velocity_down_mps: ned.z,
            true_airspeed_mps: self.own(TRUE_AIRSPEED)[0],
            controls: self.controls(),
            on_ground: self.own(ON_GROUND)[0] != 0.0,
        };
        let mut world = self.world.lock();
        if world.placements != self.placements {
            // It has just been placed: that counts, from the next frame on.
            return;
        }
        world.show_hosted(state, self.frame);
        world.set_own(FLIGHT_TIME_S, self.flight_time_s);
    }

    fn begin_frame(&mut self) -> u64 {
        self.frames += 1;
        self.frames_drawn.count();
        let shot = self.shot();
        self.shots.record(shot);
        self.exposure.record(&shot.camera);
        self.keep_through_pause(shot);
        self.look_at_world();
        if let Some(every) = self.move_origin_every_frames
            && self.frames.is_multiple_of(u64::from(every.max(1)))
        {
            let pose = self.aircraft();
            let (latitude_deg, longitude_deg) =
                ORIGINS[(self.frames / u64::from(every.max(1))) as usize % ORIGINS.len()];
            self.frame = LocalFrame {
                origin: Geodetic {
                    latitude_deg,
                    longitude_deg,
                    altitude_msl_m: 0.0,
                },
            };
            self.put_aircraft(&pose);
        }
        self.fly_on();
        self.tell_world();
        self.frames
    }

    /// Remembers the image that a pause keeps showing, as long as there is one.
    fn keep_through_pause(&mut self, shot: Shot) {
        let paused = self.world.lock().datarefs().get(PAUSED) != 0.0;
        if !paused || !self.quirks.has(Quirk::PauseKeepsPose) {
            self.before_pause = None;
        } else {
            self.before_pause.get_or_insert(shot);
        }
    }

    /// X-Plane's own start in the air: a new flight, with the engines running.
    fn begin_flight(&mut self, position: Geodetic, heading_true_deg: f64, speed_mps: f64) {
        let (sin, cos) = heading_true_deg.to_radians().sin_cos();
        self.flight = None;
        self.flight_time_s = 0.0;
        self.put(FLIGHT_TIME_S, 0.0);
        self.start_engines();
        // X-Plane's local origin is always near: far from it 32 bits are too few for a camera.
        self.frame = LocalFrame::around(position);
        self.world.lock().flight_began(position.lat_lon());
        self.show(&FlightState {
            time_s: 0.0,
            pose: Pose {
                latitude_deg: position.latitude_deg,
                longitude_deg: position.longitude_deg,
                altitude_msl_m: position.altitude_msl_m,
                heading_true_deg,
                pitch_deg: 0.0,
                roll_deg: 0.0,
            },
            velocity_north_mps: speed_mps * cos,
            velocity_east_mps: speed_mps * sin,
            velocity_down_mps: 0.0,
            true_airspeed_mps: speed_mps,
            controls: self.controls(),
            on_ground: false,
        });
        self.tell_world();
    }

    /// Flies for one more frame, unless the flight model is stopped or there is a pause: down the approach while the autopilot follows the
    /// landing system, and otherwise straight ahead.
    fn fly_on(&mut self) {
        let (period_s, paused, stopped, engaged) = {
            let world = self.world.lock();
            let get = |name: &str| world.datarefs().get(name);
            (
                get(FRAME_PERIOD),
                get(PAUSED) != 0.0,
                get(names::OVERRIDE_FLIGHT_MODEL) != 0.0,
                world.flies_approach(),
            )
        };
        if paused {
            return;
        }
        self.flight_time_s += period_s;
        self.weather_time_s += period_s;
        self.put(FLIGHT_TIME_S, self.flight_time_s);
        if stopped {
            return;
        }
        if !engaged {
            self.flight = None;
        } else if self.flight.is_none() && self.flies() {
            self.flight = Some(self.approach());
        }
        match self.flight.as_mut().and_then(|f| f.advance(period_s)) {
            Some(state) => self.show(&state),
            None if self.flies() => self.go_straight(period_s),
            None => {}
        }
    }

    /// True if the aircraft is in the air, fast enough and with its engines running.
    fn flies(&self) -> bool {
        let speed_mps = self.vector(LOCAL_VELOCITY).length();
        let free = self
            .world
            .lock()
            .datarefs()
            .get(names::OVERRIDE_FLIGHT_MODEL)
            == 0.0;
        free && speed_mps >= FLYING_MPS
            && self.own(ENGINES_RUNNING)[0] != 0.0
            && self.own(ON_GROUND)[0] == 0.0
    }

    fn go_straight(&mut self, elapsed_s: f64) {
        let moved = self.vector(LOCAL_XYZ) + self.vector(LOCAL_VELOCITY) * elapsed_s;
        for (name, value) in LOCAL_XYZ.into_iter().zip(moved.to_array()) {
            self.put(name, value);
        }
    }

    /// Three datarefs of the aircraft.
    fn vector(&self, names: [&str; 3]) -> DVec3 {
        DVec3::from_array(names.map(|name| self.own(name)[0]))
    }

    fn put(&mut self, name: &str, value: f64) {
        if let Some((dataref, values)) = self.own.values_mut(name) {
            values.fill(dataref.kind.rounded(value));
        }
    }

    fn show(&mut self, state: &FlightState) {
        self.put_aircraft(&state.pose);
        let position = state.pose.position();
        let velocity_ned = DVec3::new(
            state.velocity_north_mps,
            state.velocity_east_mps,
            state.velocity_down_mps,
        );
        let v =
            self.frame.origin.ecef_from_ned().transpose() * position.ecef_from_ned() * velocity_ned;
        let Controls {
            flap_ratio,
            gear_ratio,
        } = state.controls;
        let [east, up, south] = LOCAL_VELOCITY;
        for (name, value) in [
            (east, v.y),
            (up, -v.z),
            (south, -v.x),
            (TRUE_AIRSPEED, state.true_airspeed_mps),
            (INDICATED_AIRSPEED, state.true_airspeed_mps / MPS_PER_KNOT),
            (ON_GROUND, f64::from(u8::from(state.on_ground))),
            ("sim/flightmodel2/controls/flap1_deploy_ratio", flap_ratio),
            ("sim/flightmodel2/gear/deploy_ratio", gear_ratio),
        ] {
            self.put(name, value);
        }
    }

    /// The autopilot takes over from here. Without states, if the engine cannot fly such an approach.
    fn approach(&self) -> Playback {
        let speed_mps = self.vector(LOCAL_VELOCITY).length();
        let pose = self.aircraft();
        let start = FlightStart {
            position: pose.position(),
            heading_true_deg: pose.heading_true_deg,
            speed_mps,
        };
        let altitude_dial_ft = self.own(ALTITUDE_DIAL_FT)[0];
        let (weather, aircraft) = {
            let world = self.world.lock();
            (world.weather(), world.aircraft_type())
        };
        let request = flight::request(start, scenery(), altitude_dial_ft);
        let states = self.engine.fly(&request, aircraft, &weather);
        Playback::new(states.unwrap_or_else(|reason| {
            tracing::warn!(%reason, "the plugin's approach is not flown");
            Vec::new()
        }))
    }

    /// A dataref's type, and X-Plane's complaint when it is looked up, if there is one.
    fn kind(&self, name: &str) -> Value {
        let described = |dataref: &Dataref, complaint: Option<String>| {
            let kind = match dataref.kind {
                Kind::Int => "int",
                Kind::Float => "float",
                Kind::Double => "double",
                Kind::Byte => "byte",
            };
            json!([kind, dataref.length, dataref.writable, complaint])
        };
        if let Some((dataref, _)) = self.own.find(name) {
            return described(dataref, None);
        }
        let mut world = self.world.lock();
        let complaint = world.looked_up(name);
        match world.datarefs().find(name) {
            Some((dataref, _)) => described(dataref, complaint),
            None => Value::Null,
        }
    }

    fn get(&self, name: &str, index: usize) -> Option<f64> {
        match self.own.find(name) {
            Some((_, values)) => values.get(index).copied(),
            None => {
                let world = self.world.lock();
                let (_, values) = world.datarefs().find(name)?;
                values.get(index).copied()
            }
        }
    }

    fn set(&mut self, name: &str, index: usize, value: f64) {
        if name == LOCAL_XYZ[0] {
            // Placed somewhere else: the previous flight is over.
            self.flight = None;
        }
        if let Some((dataref, values)) = self.own.values_mut(name) {
            if let Some(cell) = values.get_mut(index).filter(|_| dataref.writable) {
                *cell = dataref.kind.rounded(value);
            }
            return;
        }
        let mut world = self.world.lock();
        let is_array = world
            .datarefs()
            .find(name)
            .is_some_and(|(dataref, _)| dataref.length.is_some());
        let path = if is_array {
            format!("{name}[{index}]")
        } else {
            name.to_owned()
        };
        if let Err(reason) = world.write_exact(&path, value) {
            tracing::warn!(path, value, %reason, "the plugin's write is ignored");
        }
    }

    fn own(&self, name: &str) -> &[f64] {
        self.own.find(name).map_or(&[], |(_, values)| values)
    }

    /// The drawn pose: oriented by `q`, which X-Plane draws from.
    fn aircraft(&self) -> Pose {
        let at = |axis: &str| self.own(&format!("{POSITION}local_{axis}"))[0];
        let attitude = match *self.own(&format!("{POSITION}q")) {
            [w, x, y, z] => DQuat::from_xyzw(x, y, z, w).normalize(),
            _ => DQuat::IDENTITY,
        };
        self.pose(
            DVec3::new(at("x"), at("y"), at("z")),
            DMat3::from_quat(attitude),
        )
    }

    fn put_aircraft(&mut self, pose: &Pose) {
        let flight = self.flight.take();
        let local = self.frame.local(pose.position());
        let turned = self.frame.origin.ecef_from_ned().transpose() * pose.ecef_from_body();
        let attitude = DQuat::from_mat3(&turned);
        let (psi, theta, phi) = attitude.to_euler(EulerRot::ZYX);
        for (name, value) in [
            ("local_x", local.x),
            ("local_y", local.y),
            ("local_z", local.z),
            ("psi", psi.to_degrees().rem_euclid(360.0)),
            ("theta", theta.to_degrees()),
            ("phi", phi.to_degrees()),
        ] {
            self.set(&format!("{POSITION}{name}"), 0, value);
        }
        let DQuat { x, y, z, w } = attitude;
        for (index, value) in [w, x, y, z].into_iter().enumerate() {
            self.set(&format!("{POSITION}q"), index, value);
        }
        self.flight = flight;
    }

    fn controls(&self) -> Controls {
        Controls {
            flap_ratio: self.own(FLAPS)[0],
            gear_ratio: self.own(GEAR)[0],
        }
    }

    /// A pose on earth from a place and a rotation about the local axes (north, east, down at the origin).
    fn pose(&self, local: DVec3, turned: DMat3) -> Pose {
        let position = self.frame.world(local);
        let ned_from_body =
            position.ecef_from_ned().transpose() * self.frame.origin.ecef_from_ned() * turned;
        let (heading, pitch, roll) = DQuat::from_mat3(&ned_from_body).to_euler(EulerRot::ZYX);
        Pose {
            latitude_deg: position.latitude_deg,
            longitude_deg: position.longitude_deg,
            altitude_msl_m: position.altitude_msl_m,
            heading_true_deg: heading.to_degrees().rem_euclid(360.0),
            pitch_deg: pitch.to_degrees(),
            roll_deg: roll.to_degrees(),
        }
    }

    /// Along the local y axis, as X-Plane's probes look; `None` where no scenery is loaded.
    fn ground_below(&self, mut local: DVec3) -> Option<DVec3> {
        let at = self.frame.world(local).lat_lon();
        let off_m = self.world.lock().ground_off_m(at)?;
        for _ in 0..6 {
            local.y -= self.frame.world(local).altitude_msl_m - GROUND_MSL_M - off_m;
        }
        Some(local)
    }
}

/// Wraps an image to be drawn on.
fn canvas(rgb: &mut [u8], (width_px, height_px): (u32, u32)) -> Canvas<'_> {
    Canvas {
        rgb,
        width_px: width_px as usize,
        height_px: height_px as usize,
    }
}

/// Fills the rectangles of draw callbacks: those that came before the windows of the user interface were drawn, or after it.
fn fill_rectangles(canvas: &mut Canvas<'_>, rectangles: &Value, after_windows: bool) {
    for rectangle in rectangles.as_array().into_iter().flatten() {
        let number = |at: usize| rectangle[at].as_f64().unwrap_or_default();
        if (number(7) != 0.0) == after_windows {
            let [left, bottom, right, top] = [0, 1, 2, 3].map(number);
            let colour = [4, 5, 6].map(|at| number(at) as u8);
            // OpenGL counts rows from the bottom.
            let height = canvas.height_px as f64;
            canvas.fill_px([left, height - top, right, height - bottom], colour);
        }
    }
}

/// The frame that a driver shows between two others; `None` before the first one.
fn mean(last: &[u8], picture: &RgbPicture) -> Option<RgbPicture> {
    (last.len() == picture.rgb.len()).then(|| RgbPicture {
        rgb: last
            .iter()
            .zip(&picture.rgb)
            .map(|(last, next)| last.midpoint(*next))
            .collect(),
        ..*picture
    })
}

/// True if rectangles begin with the check pattern's magenta border; numbers are black and white.
fn is_check_pattern(first: &Value) -> bool {
    let [red, green] = [4, 5].map(|at| first[at].as_f64());
    red != green
}

/// Taken from the options, or else from the quirk.
fn scene_behind(options: &PluginOptions, quirks: Quirks) -> SceneBehind {
    let by_quirk = if quirks.has(Quirk::StaleFrames) {
        SceneBehind::Constant(SceneBehind::MAX_FRAMES)
    } else {
        SceneBehind::Constant(0)
    };
    options.scene_behind.unwrap_or(by_quirk)
}

/// Heading, then pitch, then roll, degrees, as a rotation from body axes (forward, right, down).
fn rotation(psi_deg: f64, theta_deg: f64, phi_deg: f64) -> DMat3 {
    DMat3::from_euler(
        EulerRot::ZYX,
        psi_deg.to_radians(),
        theta_deg.to_radians(),
        phi_deg.to_radians(),
    )
}

fn coordinates(place: Geodetic) -> Value {
    json!([
        place.latitude_deg,
        place.longitude_deg,
        place.altitude_msl_m
    ])
}

fn place(at: DVec3) -> Geodetic {
    Geodetic {
        latitude_deg: at.x,
        longitude_deg: at.y,
        altitude_msl_m: at.z,
    }
}

/// The stand-in's scenery has one airport.
fn scenery() -> Runway {
    Runway {
        airport: "WSSS".into(),
        name: "02L".into(),
        threshold: Geodetic {
            altitude_msl_m: GROUND_MSL_M,
            ..ON_THRESHOLD.position()
        },
        course_true_deg: 23.02,
        glide_path_deg: 3.0,
        touchdown_past_threshold_m: 340.1,
        ils_frequency_mhz: Some(110.9),
        course_magnetic_deg: Some(23.0),
        length_m: None,
        width_m: None,
    }
}

#[cfg(test)]
mod tests;
