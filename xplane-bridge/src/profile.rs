//! Measurements by `dtd doctor` on an X-Plane installation, for questions on which reports contradict each other or are missing.
//!
//! Input: a few minutes of writing, reading and examining images ([`crate::doctor`]). Output: a record that the plugin stores and sends to
//! every client with its `hello`, on any computer. [`crate::Simulator`] uses some of it; the rest is for people, who send it to us.
//!
//! Without a profile, `dtd generate` checks the images itself before the first scenario, and treats the weather as most reports describe
//! it.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use dataset::corpus::effective_weather::EffectiveQuantity;
use dataset::numbers::units::MPS_PER_KNOT;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::datarefs::{DatarefWrite, WIND_SPEED};
use crate::error::BridgeError;
use crate::link::PictureSize;

/// Record version. Records with a different version are measured again.
pub(crate) const PROFILE_FORMAT: u32 = 1;
/// The plugin rejects more frames than these.
const MAX_SETTLE_FRAMES: u32 = 600;

/// A measurement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Finding<T> {
    /// It was.
    Found(T),
    /// It was not made, for this reason.
    NotMeasured(String),
}

impl<T> From<Result<T, BridgeError>> for Finding<T> {
    fn from(measured: Result<T, BridgeError>) -> Self {
        measured.map_or_else(Self::not_measured, Self::Found)
    }
}

impl<T> Finding<T> {
    pub(crate) fn not_measured(reason: impl ToString) -> Self {
        Self::NotMeasured(reason.to_string())
    }

    /// The result, if any.
    pub fn found(&self) -> Option<&T> {
        match self {
            Self::Found(value) => Some(value),
            Self::NotMeasured(_) => None,
        }
    }
}

/// Unit in which X-Plane takes `wind_speed_msc`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WindUnit {
    /// The unit in its name.
    MetersPerSecond,
    /// The unit in Laminar's list of datarefs.
    Knots,
}

/// Origin of a [`Pace`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PacedBy {
    /// `dtd doctor`, by images that were not encoded.
    Doctor,
    /// `dtd generate`, by a whole scenario.
    Generate,
}

impl fmt::Display for PacedBy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Doctor => "dtd doctor",
            Self::Generate => "dtd generate",
        })
    }
}

/// Durations of a scenario's parts, for the estimates of `dtd plan`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pace {
    /// Origin of the measurement.
    pub measured_by: PacedBy,
    /// Size of the images.
    pub size: PictureSize,
    /// True if the camera rested while the aircraft moved from drawn frame to drawn frame.
    pub in_blocks: bool,
    /// Frames that each view settled otherwise.
    pub settle_frames: u32,
    /// Images per second, all views together.
    pub pictures_per_s: f64,
    /// Time from connecting until a live flight has begun and its scenery is loaded, seconds; absent if no flight was begun.
    pub loading_s: Option<f64>,
    /// Time from writing the weather until it is there, seconds.
    pub weather_s: Option<f64>,
}

impl Pace {
    /// The image procedure, as text.
    pub fn procedure(&self) -> String {
        if self.in_blocks {
            "from a camera that rests for blocks of ticks".into()
        } else {
            format!("each settled for {} frames", self.settle_frames)
        }
    }
}

/// Durations of a recorded scenario's parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecordedPace {
    /// Image size.
    pub size: PictureSize,
    /// True if they were taken in blocks.
    pub in_blocks: bool,
    /// Images per second, all views together, encoding included.
    pub pictures_per_s: f64,
    /// Time from connecting until the live flight had begun; absent for other flights.
    pub loading: Option<Duration>,
    /// Time from writing the weather until it was there.
    pub weather: Duration,
}

/// All measurements.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Profile {
    /// [`PROFILE_FORMAT`].
    pub format: u32,
    /// Time of the measurement, UTC.
    pub measured_at: String,
    /// Name and version of the simulator.
    pub simulator: String,
    /// Name and version of the plugin, if one serves the link.
    pub plugin: Option<String>,
    /// The unit of `wind_speed_msc`.
    pub wind_unit: Finding<WindUnit>,
    /// For each quantity of the weather at the aircraft, true if it follows the written value.
    pub weather_follows: BTreeMap<EffectiveQuantity, Finding<bool>>,
    /// True if a pose and a camera that are written in a pause are drawn.
    pub pause_shows_poses: Finding<bool>,
    /// After how many frames an image is final when the camera has turned: shadows and exposure.
    pub frames_until_settled: Finding<u32>,
    /// True if images change in a pause although the scene is static (water).
    pub still_pictures_move: Finding<bool>,
    /// Speed of recording.
    pub pace: Finding<Pace>,
}

/// Reason why a profile cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct ProfileError(String);

/// Profile of the connected simulator, as far as there is one.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum KnownProfile {
    /// No measurements.
    #[default]
    None,
    /// There is a profile, but it cannot be used.
    Unusable(ProfileError),
    /// A complete profile.
    Current(Box<Profile>),
    /// This client's own checks of the images, without any of the weather.
    PicturesOnly(Box<Profile>),
}

impl KnownProfile {
    pub(crate) fn of(kept: Option<Value>, simulator: &str, plugin: Option<&str>) -> Self {
        let Some(kept) = kept else {
            return Self::None;
        };
        match Profile::read(kept, simulator, plugin) {
            Ok(profile) => Self::Current(Box::new(profile)),
            Err(error) => Self::Unusable(error),
        }
    }

    /// The profile, if usable.
    pub fn current(&self) -> Option<&Profile> {
        match self {
            Self::Current(profile) | Self::PicturesOnly(profile) => Some(profile),
            Self::None | Self::Unusable(_) => None,
        }
    }
}

/// Says which profile is used, or how to get one.
impl fmt::Display for KnownProfile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Current(profile) => write!(
                f,
                "has a profile, measured at {}, which is used",
                profile.measured_at
            ),
            Self::None => f.write_str(
                "has no profile: what sources disagree on is taken as most of them have it. `dtd doctor` measures it",
            ),
            Self::PicturesOnly(profile) => {
                f.write_str("has no profile of this version: ")?;
                match profile.pictures_in_doubt() {
                    None => f.write_str("its images were looked at now")?,
                    Some(why) => write!(f, "its images may be wrong, since it could not be seen how they settle ({why})")?,
                }
                f.write_str(", and its weather is taken as most sources have it. `dtd doctor` measures both")
            }
            Self::Unusable(error) => write!(
                f,
                "has a profile that is not used: {error}. `dtd doctor` measures it again"
            ),
        }
    }
}

impl Profile {
    fn read(kept: Value, simulator: &str, plugin: Option<&str>) -> Result<Self, ProfileError> {
        let format = kept.get("format").and_then(Value::as_u64);
        if format != Some(u64::from(PROFILE_FORMAT)) {
            return Err(ProfileError(format!(
                "it has format {format:?}, expected {PROFILE_FORMAT}"
            )));
        }
        let profile: Self = serde_json::from_value(kept)
            .map_err(|error| ProfileError(format!("it cannot be read: {error}")))?;
        let words = |simulator: &str, plugin: Option<&str>| match plugin {
            Some(plugin) => format!("{simulator} and {plugin}"),
            None => simulator.to_owned(),
        };
        let measured = words(&profile.simulator, profile.plugin.as_deref());
        let found = words(simulator, plugin);
        if measured == found {
            Ok(profile)
        } else {
            Err(ProfileError(format!(
                "it was measured with {measured}, and this is {found}"
            )))
        }
    }

    /// Frames that a new pose and camera are drawn before the one that counts, at least `default`.
    pub(crate) fn settle_frames(&self, default: u32) -> u32 {
        let measured = self.frames_until_settled.found().copied().unwrap_or(0);
        // Any program of the simulator's computer can store a profile.
        default.max(measured.min(MAX_SETTLE_FRAMES))
    }

    /// True if time must run while images are taken, because a pause does not show new poses.
    pub(crate) fn time_has_to_run(&self) -> bool {
        self.pause_shows_poses.found() == Some(&false)
    }

    /// The reason why it is not known that images show the written state; `None` if it is known.
    fn pictures_in_doubt(&self) -> Option<&str> {
        match (&self.pause_shows_poses, &self.frames_until_settled) {
            (Finding::NotMeasured(why), _) | (_, Finding::NotMeasured(why)) => Some(why),
            (Finding::Found(_), Finding::Found(_)) => None,
        }
    }

    /// True if images change without a new pose, so that two equal ones are no evidence.
    pub(crate) fn pictures_move(&self) -> bool {
        self.still_pictures_move.found() == Some(&true)
    }

    /// True if a quantity of the weather at the aircraft was measured to follow the written value.
    pub(crate) fn follows(&self, quantity: EffectiveQuantity) -> bool {
        let finding = self.weather_follows.get(&quantity);
        finding.is_some_and(|finding| finding.found() == Some(&true))
    }

    /// True if X-Plane takes winds in knots.
    pub(crate) fn winds_are_in_knots(&self) -> bool {
        self.wind_unit.found() == Some(&WindUnit::Knots)
    }
}

impl WindUnit {
    /// Writes of winds in metres per second, converted to this unit.
    pub(crate) fn applied_to(self, mut writes: Vec<DatarefWrite>) -> Vec<DatarefWrite> {
        if self == Self::Knots {
            let winds = writes
                .iter_mut()
                .filter(|write| write.name.split('[').next() == Some(WIND_SPEED));
            for wind in winds {
                wind.value = (f64::from(wind.value) / MPS_PER_KNOT) as f32;
            }
        }
        writes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured() -> Profile {
        let not = || "not today".to_owned();
        Profile {
            format: PROFILE_FORMAT,
            measured_at: "2026-11-22T06:00:00Z".into(),
            simulator: "X-Plane 12.4.3".into(),
            plugin: Some("dtd_bridge 0.1.0".into()),
            wind_unit: Finding::Found(WindUnit::Knots),
            weather_follows: [
                (EffectiveQuantity::Rain, Finding::Found(true)),
                (EffectiveQuantity::Visibility, Finding::Found(false)),
                (EffectiveQuantity::CloudCover, Finding::NotMeasured(not())),
            ]
            .into(),
            pause_shows_poses: Finding::Found(false),
            frames_until_settled: Finding::Found(24),
            still_pictures_move: Finding::Found(true),
            pace: Finding::Found(Pace {
                measured_by: PacedBy::Doctor,
                size: PictureSize {
                    width_px: 1920,
                    height_px: 1280,
                },
                in_blocks: false,
                settle_frames: 4,
                pictures_per_s: 8.5,
                loading_s: None,
                weather_s: None,
            }),
        }
    }

    #[test]
    fn a_profile_is_used_by_the_versions_that_it_was_measured_with_and_by_no_other() {
        let kept = || Some(serde_json::to_value(measured()).unwrap());
        let plugin = Some("dtd_bridge 0.1.0");
        let known = KnownProfile::of(kept(), "X-Plane 12.4.3", plugin);
        assert_eq!(known.current(), Some(&measured()));
        for (simulator, plugin) in [("X-Plane 12.5.0", plugin), ("X-Plane 12.4.3", None)] {
            let known = KnownProfile::of(kept(), simulator, plugin);
            assert_eq!(known.current(), None);
            let said = known.to_string();
            assert!(
                said.contains("X-Plane 12.4.3 and dtd_bridge 0.1.0") && said.contains(simulator),
                "{said}"
            );
        }
        let mut other = kept().unwrap();
        other["format"] = 2.into();
        let said = KnownProfile::of(Some(other), "X-Plane 12.4.3", plugin).to_string();
        assert!(said.contains("format Some(2), expected 1"), "{said}");
        let said = KnownProfile::of(None, "X-Plane 12.4.3", plugin).to_string();
        assert!(
            said.contains("no profile") && said.contains("dtd doctor"),
            "{said}"
        );
    }

    #[test]
    fn only_a_quantity_that_was_seen_to_follow_does() {
        let follows = |profile: &Profile| -> Vec<EffectiveQuantity> {
            let all = EffectiveQuantity::ALL.into_iter();
            all.filter(|quantity| profile.follows(*quantity)).collect()
        };
        assert_eq!(follows(&measured()), [EffectiveQuantity::Rain]);
    }

    #[test]
    fn what_was_measured_changes_what_is_written_and_waited_for() {
        let mut profile = measured();
        assert_eq!(profile.settle_frames(3), 24);
        assert_eq!(profile.settle_frames(30), 30);
        profile.frames_until_settled = Finding::Found(u32::MAX);
        assert_eq!(profile.settle_frames(3), 600);
        assert!(profile.time_has_to_run());
        let writes = || {
            vec![
                DatarefWrite::new(format!("{WIND_SPEED}[3]"), 10.0),
                DatarefWrite::new("sim/weather/region/rain_percent", 0.5),
            ]
        };
        let values = |writes: &[DatarefWrite]| -> Vec<f32> {
            writes.iter().map(|write| write.value).collect()
        };
        let knots = values(&WindUnit::Knots.applied_to(writes()));
        assert!(
            (knots[0] - 19.438).abs() < 1e-3 && knots[1] == 0.5,
            "{knots:?}"
        );
        let as_written = WindUnit::MetersPerSecond.applied_to(writes());
        assert_eq!(values(&as_written), [10.0, 0.5]);
    }
}
