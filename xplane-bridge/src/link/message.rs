//! The headers of the capture link's messages: a client's requests, a simulator's answers.

use std::collections::BTreeMap;

use dataset::conditions::Clock;
use dataset::geometry::imaging::Imaging;
use dataset::geometry::runway::Runway;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

use super::{
    CaptureRequest, FrameHeader, PictureSize, PixelKind, ScreenOffer, SimulatorWindow, TrafficPart,
};
use crate::fly::{FlightStart, FlyRequest};

/// A client's message to the simulator, without a payload.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "snake_case")]
pub enum Request {
    /// The first message: identification.
    Hello {
        /// Name and version of the client, for the simulator's log.
        client: String,
        /// The token, if the link requires one.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        token: Option<String>,
    },
    /// Stop the flight model, the clock and the clouds: poses come from captures now.
    Freeze {
        /// The runway of the scenario, whose surroundings the images show.
        runway: Runway,
        /// Frames that X-Plane draws with a new pose and camera before the one that counts, so that everything has followed.
        settle_frames: u32,
        /// Lens, air and sensor of each view, in their order; missing views, or a missing list, are ideal. Only for simulators that
        /// announce support in [`Answer::Hello`].
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        imaging: Vec<Imaging>,
        /// Let time run, and set the clock back to this in every frame: X-Plane's rain and snow stop falling in a pause.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        running_at: Option<Clock>,
        /// Margins of the window around the images, left and right, above and below, pixels; images fill the window if missing. Only
        /// for plugins that announce frame codes in [`Answer::Hello`].
        #[serde(default, skip_serializing_if = "Option::is_none")]
        margins_px: Option<[u32; 2]>,
    },
    /// Draw another aircraft as well, on this path, until the next [`Request::Freeze`]. Only while frozen, and only for simulators that
    /// announce support in [`Answer::Hello`].
    Traffic(TrafficPart),
    /// Start a flight there, unless it has started, and hold the aircraft there once the scenery has loaded. For plugins only.
    Travel {
        /// Start position.
        start: FlightStart,
        /// True if the flight has already started there (by X-Plane 12's Web API).
        #[serde(default)]
        already_started: bool,
    },
    /// Draw the check pattern over the window, to prove that the client grabs this window. Only for registration: while it is shown,
    /// captures are rejected.
    CheckPattern {
        /// The number in the pattern; `None` removes the pattern.
        code: Option<u32>,
        /// Under the windows of the user interface and of plugins, instead of over them. Only for simulators that announce it in
        /// [`Answer::Hello`].
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        under: bool,
    },
    /// Run one of the simulator's commands exactly once: over UDP it could be lost without notice.
    Command {
        /// Command name, e.g. `sim/operation/regen_weather`.
        path: String,
    },
    /// Store measurements of this simulator, and send them to every client with the hello.
    KeepProfile {
        /// A [`crate::profile::Profile`], of whichever version.
        profile: Value,
    },
    /// Report if the frame of the last [`Request::Capture`] has been on the screen ever since its answer. The camera may be taken from the
    /// plugin while a client grabs the frame.
    StillShown,
    /// Describe what X-Plane draws with, by its own files. For plugins only.
    Installation,
    /// Let everything run again.
    Release,
    /// Fly an approach, as fast as the simulator can.
    Fly(FlyRequest),
    /// Draw a view at a tick. Only while frozen.
    Capture(CaptureRequest),
}

/// A simulator's description of itself and of its capture link.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Name of the simulator.
    pub name: String,
    /// Version of the simulator.
    pub version: String,
    /// Name and version of the plugin that serves the link; `None` if the simulator itself does.
    pub plugin: Option<String>,
    /// Sources of images, the best first. Unknown names are ignored.
    #[serde(deserialize_with = "known_kinds")]
    pub pixels: Vec<PixelKind>,
    /// The simulator's window, if there is one.
    pub window: Option<SimulatorWindow>,
    /// Size of X-Plane's window, the only possible image size. `None` if any size can be drawn, and for plugins that are older than
    /// this key.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drawn_size: Option<PictureSize>,
    /// True if it can draw lenses, refraction, turbulent air and noise; X-Plane cannot.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub imaging: bool,
    /// Maximum number of other aircraft that it can draw; X-Plane does not report where it drew any.
    #[serde(default, skip_serializing_if = "is_none")]
    pub traffic: u32,
    /// True if it can draw the check pattern under its own windows.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub patterns_under: bool,
    /// The screen of the plugin's computer, for clients on a different one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub screen: Option<ScreenOffer>,
    /// Stored measurements, if any: a [`crate::profile::Profile`] in any version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<Value>,
    /// True if a tape gives the answers: missing ones will not come later either.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub replayed: bool,
    /// True if it can show a tick for one drawn frame, with the frame's number in the margins around the image.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub frame_codes: bool,
}

impl Hello {
    /// Names and versions of simulator and plugin.
    pub fn versions(&self) -> String {
        let Self { name, version, .. } = self;
        match &self.plugin {
            Some(plugin) => format!("{name} {version} with {plugin}"),
            None => format!("{name} {version}"),
        }
    }
}

/// The simulator's answer to a client: one per request, in the same order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "snake_case")]
pub enum Answer {
    /// Answer to [`Request::Hello`].
    Hello(Hello),
    /// Answer to [`Request::Freeze`].
    Frozen,
    /// Answer to [`Request::Traffic`].
    TrafficKept,
    /// Answer to [`Request::Travel`].
    Arrived,
    /// Answer to [`Request::CheckPattern`].
    CheckPatternShown {
        /// The first frame that is drawn with it, or without it.
        sim_frame: u64,
    },
    /// Answer to [`Request::Command`].
    Commanded,
    /// Answer to [`Request::KeepProfile`].
    ProfileKept,
    /// Answer to [`Request::StillShown`].
    Shown {
        /// True if every frame since then has shown the same.
        still: bool,
    },
    /// Answer to [`Request::Installation`].
    Installation(Installation),
    /// Answer to [`Request::Release`].
    Released,
    /// Answer to [`Request::Fly`]; the payload is `rows` x `columns` 64-bit floats.
    Flown {
        /// Names of the columns.
        columns: Vec<String>,
        /// Number of states.
        rows: usize,
    },
    /// Answer to [`Request::Capture`]; the payload is the image.
    Frame(FrameHeader),
    /// Error in place of any other answer.
    Error {
        /// Description of the failure.
        text: String,
        /// True if the same request would be refused again.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        repeats: bool,
    },
}

/// X-Plane's graphics and other plugins, by its own files.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Installation {
    /// Complaints of the log about the plugin, each once; at most some twenty.
    pub complaints: Vec<String>,
    /// Device, driver, desktop session, graphics settings and scenery, by their names there.
    pub settings: BTreeMap<String, String>,
    /// The exposure of the last frame, at ISO 100; missing where X-Plane has none.
    #[serde(default)]
    pub exposure_ev100: Option<f64>,
    /// Signatures of all plugins.
    pub plugins: Vec<String>,
}

fn is_none(count: &u32) -> bool {
    *count == 0
}

fn known_kinds<'de, D: Deserializer<'de>>(source: D) -> Result<Vec<PixelKind>, D::Error> {
    let names = Vec::<String>::deserialize(source)?;
    let known = |name: &String| PixelKind::ALL.into_iter().find(|kind| kind.name() == name);
    Ok(names.iter().filter_map(known).collect())
}

impl Answer {
    /// A refusal that may not last.
    pub fn refusal(text: impl Into<String>) -> Self {
        Self::Error {
            text: text.into(),
            repeats: false,
        }
    }

    /// Refusal that would be repeated.
    pub fn lasting_refusal(text: impl Into<String>) -> Self {
        Self::Error {
            text: text.into(),
            repeats: true,
        }
    }

    /// The answer's name, for messages.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Hello(_) => "hello",
            Self::Frozen => "frozen",
            Self::TrafficKept => "traffic_kept",
            Self::Arrived => "arrived",
            Self::CheckPatternShown { .. } => "check_pattern_shown",
            Self::Commanded => "commanded",
            Self::ProfileKept => "profile_kept",
            Self::Shown { .. } => "shown",
            Self::Installation(_) => "installation",
            Self::Released => "released",
            Self::Flown { .. } => "flown",
            Self::Frame(_) => "frame",
            Self::Error { .. } => "error",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_may_say_more_than_is_known_and_a_request_may_not_wish_it() {
        let pose = r#"{"latitude_deg":1,"longitude_deg":2,"altitude_msl_m":3,"heading_true_deg":4,"pitch_deg":5,"roll_deg":6,"yaw_rate_dps":0}"#;
        let camera = pose.replace('}', r#","hfov_deg":10}"#);
        let frame = format!(
            r#"{{"message":"frame","tick":1,"view":0,"sim_frame":9,"pose":{pose},"camera":{camera},"width_px":4,"height_px":2,"exposure_s":0.01}}"#
        );
        let answer: Answer = serde_json::from_str(&frame).unwrap();
        assert!(matches!(answer, Answer::Frame(header) if header.sim_frame == 9));
        let hello = r#"{"message":"hello","name":"X-Plane","version":"13.00","plugin":null,"pixels":["hologram","screen"],"window":null}"#;
        let answer: Answer = serde_json::from_str(hello).unwrap();
        assert!(matches!(answer, Answer::Hello(hello) if hello.pixels == [PixelKind::Screen]));
        let capture = |more: &str| {
            format!(
                r#"{{"message":"capture","tick":1,"time_ns":0,"view":0,"pose":{pose},"controls":{{"flap_ratio":0,"gear_ratio":1}},"camera":{camera},"width_px":4,"height_px":2{more}}}"#
            )
        };
        assert!(serde_json::from_str::<Request>(&capture("")).is_ok());
        let wish = serde_json::from_str::<Request>(&capture(r#","exposure_s":0.01"#));
        assert!(wish.unwrap_err().to_string().contains("exposure_s"));
    }

    #[test]
    fn only_a_lasting_refusal_says_that_it_repeats() {
        for (error, expected) in [
            (Answer::refusal("no"), r#"{"message":"error","text":"no"}"#),
            (
                Answer::lasting_refusal("no"),
                r#"{"message":"error","text":"no","repeats":true}"#,
            ),
        ] {
            assert_eq!(serde_json::to_string(&error).unwrap(), expected);
            let read: Answer = serde_json::from_str(expected).unwrap();
            assert!(read == error, "{read:?}");
        }
    }
}
