//! Our plugin's own Python instead of the built-in capture link: `dtd mock-xplane --plugin DIR`.
//!
//! A Python child runs the plugin against a fake of XPPython3's module `xp` (`fake_xp/`). The fake queries the world here, through
//! the child's standard input and output, and the images that the plugin reads back are drawn here, from the pose and the camera
//! that it wrote in X-Plane's local coordinates. A wrong sign in the plugin gives a wrong image.
//!
//! So the generator and the plugin meet over the real link, without X-Plane: whether X-Plane itself behaves like the fake is not
//! shown here.

mod behind;
mod flight;
mod own;
mod scene;
mod shot;
mod window_covers;

use std::path::PathBuf;
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use serde_json::{Value, json};
use tokio::io::{AsyncBufReadExt, AsyncWriteExt, BufReader};
use tokio::process::{Child, Command};
use xplane_bridge::link::LinkToken;

pub use self::behind::SceneBehind;
use self::scene::PluginScene;
pub use self::window_covers::{WindowCovers, WindowForm};
use super::engine::Engine;
use super::faults::outages::Outages;
use super::{Faults, MockError, Shared};
use crate::quirks::Quirk;
use crate::window::DisplayWindow;

/// [`Quirk::CameraTaken`] takes the camera repeatedly, at this interval in frames.
const CAMERA_TAKEN_EVERY: u32 = 401;
const FAKE_XP: &str = include_str!("../../fake_xp/fake_xp.py");
const RULES: &str = include_str!("../../fake_xp/xp_rules.py");
const HELD_LOCK: &str = include_str!("../../fake_xp/held_lock.py");
const HOST: &str = include_str!("../../fake_xp/host.py");
/// End mark for the name of a question that has no answer.
const STATEMENT: char = '!';
/// Creates the modules from the settings in the first line, and runs the host.
const BOOTSTRAP: &str = "import json, sys, types
settings = json.loads(sys.stdin.buffer.readline())
for name in ('xp_rules', 'fake_xp', 'held_lock', 'host'):
    module = sys.modules[name] = types.ModuleType(name)
    exec(compile(settings[name], name + '.py', 'exec'), module.__dict__)
sys.modules['host'].run(settings)";

/// The plugin to run, and the faults of the simulator around it.
#[derive(Debug, Clone)]
pub struct PluginOptions {
    /// Folder of `PI_dtd_bridge.py`.
    pub folder: PathBuf,
    /// The Python to run it, 3.10 or newer.
    pub python: PathBuf,
    /// Width and height of the simulator's window, pixels.
    pub window_px: (u32, u32),
    /// Simulated time between two frames, seconds.
    pub frame_period_s: f64,
    /// Maximum number of frames drawn per second, in real time.
    pub most_frames_per_s: Option<f64>,
    /// Lag of the scene in frames; `None` for no lag, or the lag of [`Quirk::StaleFrames`].
    pub scene_behind: Option<SceneBehind>,
    /// Counts the frames.
    pub frames_drawn: FramesDrawn,
    /// Windows of the simulator and of its plugins over the scene.
    pub window_covers: WindowCovers,
    /// Takes the camera from the plugin every this many frames, as a view key does.
    pub steal_camera_every_frames: Option<u32>,
    /// Moves the local origin every this many frames, as loading scenery does.
    pub move_origin_every_frames: Option<u32>,
}

impl PluginOptions {
    /// Simulated time between two frames at 60 frames per second.
    pub const FRAME_PERIOD_S: f64 = 1.0 / 60.0;

    /// Runs the plugin in a folder undisturbed.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self {
            folder: folder.into(),
            python: "python3".into(),
            window_px: (1_920, 1_280),
            frame_period_s: Self::FRAME_PERIOD_S,
            most_frames_per_s: None,
            scene_behind: None,
            frames_drawn: FramesDrawn::default(),
            window_covers: WindowCovers::default(),
            steal_camera_every_frames: None,
            move_origin_every_frames: None,
        }
    }
}

/// A counter of drawn frames. Its clones count together.
#[derive(Debug, Clone, Default)]
pub struct FramesDrawn(Arc<AtomicU64>);

impl FramesDrawn {
    /// Frames drawn.
    pub fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }

    fn count(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

/// Values of the plugin's settings, and the speed of the simulator's clock.
#[derive(Debug, Clone)]
pub(super) struct HostSettings {
    pub(super) bind: std::net::IpAddr,
    pub(super) port: u16,
    pub(super) token: Option<LinkToken>,
    pub(super) clock_rate: f64,
    /// Faults of what the window shows.
    pub(super) faults: Faults,
}

/// Runs the plugin until the future is dropped.
pub(super) async fn run(
    options: PluginOptions,
    host: HostSettings,
    world: Shared,
    engine: Arc<dyn Engine>,
    outages: Arc<Outages>,
    stage: Option<Arc<dyn DisplayWindow>>,
) -> Result<(), MockError> {
    let failed = |what: String| MockError::Plugin {
        folder: options.folder.clone(),
        what,
    };
    let mut child = spawn(&options).map_err(|error| {
        failed(format!(
            "cannot start {}: {error}",
            options.python.display()
        ))
    })?;
    let (Some(mut questions), Some(mut answers)) =
        (child.stdout.take().map(BufReader::new), child.stdin.take())
    else {
        return Err(failed("it has no pipes".into()));
    };
    let (is_x_plane_11, quirks) = {
        let world = world.lock();
        (world.version() < 120_000, world.quirks)
    };
    // The plugin waits in real time; here as long as the awaited event takes, which may be no time at all.
    let pace = quirks.pace(host.clock_rate);
    let quirk_names: Vec<&str> = quirks.iter().map(|quirk| quirk.facts().name).collect();
    let steal_every = options
        .steal_camera_every_frames
        .or_else(|| quirks.has(Quirk::CameraTaken).then_some(CAMERA_TAKEN_EVERY));
    let settings = json!({
        "xp_rules": RULES,
        "fake_xp": FAKE_XP,
        "held_lock": HELD_LOCK,
        "host": HOST,
        "plugin": options.folder,
        "is_x_plane_11": is_x_plane_11,
        "bind": host.bind,
        "port": host.port,
        "token": host.token.as_ref().map(LinkToken::secret),
        "pace": pace,
        "least_frame_s": options.most_frames_per_s.map_or(0.0, f64::recip),
        "steal_camera_every_frames": steal_every,
        "quirks": quirk_names,
        "shows_frames": stage.is_some(),
    });
    let broken = |error: std::io::Error| failed(error.to_string());
    let mut line = settings.to_string();
    line.push('\n');
    answers.write_all(line.as_bytes()).await.map_err(broken)?;
    let mut scene = PluginScene::new(world, engine, &options, host.faults);
    loop {
        line.clear();
        if questions.read_line(&mut line).await.map_err(broken)? == 0 {
            let ending = child.wait().await.map_err(broken)?;
            return Err(failed(format!(
                "its Python ended ({ending}); see above for why"
            )));
        }
        let question: Vec<Value> =
            serde_json::from_str(&line).map_err(|error| failed(format!("{error} in {line:?}")))?;
        let (answer, bytes) = match question.split_first() {
            Some((Value::String(what), arguments)) if what == "render" => {
                let rgb = scene.render(arguments).await;
                let rgb = rgb.ok_or_else(|| failed(format!("it cannot draw {line}")))?;
                (json!(rgb.len()), rgb)
            }
            Some((Value::String(what), arguments)) if what == "show" => {
                let rectangles = arguments.first().unwrap_or(&Value::Null);
                if let Some(stage) = &stage {
                    scene.show_frame(rectangles, stage).await.map_err(failed)?;
                }
                (Value::Null, Vec::new())
            }
            Some((Value::String(what), arguments)) => {
                if what == "begin_frame" {
                    // A frozen simulator draws no frame.
                    outages.over().await;
                }
                let statement = what.strip_suffix(STATEMENT);
                let answer = scene.answer(statement.unwrap_or(what), arguments);
                let answer = answer.ok_or_else(|| failed(format!("it asks {line}")))?;
                if statement.is_some() {
                    continue;
                }
                (answer, Vec::new())
            }
            _ => return Err(failed(format!("it asks {line}"))),
        };
        let mut reply = answer.to_string().into_bytes();
        reply.push(b'\n');
        reply.extend(bytes);
        answers.write_all(&reply).await.map_err(broken)?;
    }
}

/// Isolated from the user's packages; leaves no byte code next to the plugin; ends with this value.
fn spawn(options: &PluginOptions) -> std::io::Result<Child> {
    Command::new(&options.python)
        .args(["-I", "-B", "-u", "-c", BOOTSTRAP])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .kill_on_drop(true)
        .process_group(0)
        .spawn()
}
