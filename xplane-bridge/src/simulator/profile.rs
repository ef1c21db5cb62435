//! The profile of this simulator, stored by its plugin.

use super::{SWITCH_TIMEOUT, Simulator};
use crate::error::BridgeError;
use crate::link::{Answer, Request};
use crate::profile::{Finding, KnownProfile, Pace, PacedBy, Profile, RecordedPace};

impl Simulator {
    /// Lets the plugin store a profile; from now on it is used here as well.
    ///
    /// # Errors
    /// The plugin cannot store it.
    pub(crate) async fn keep_profile(&mut self, profile: Profile) -> Result<(), BridgeError> {
        let kept = serde_json::to_value(&profile).map_err(|error| BridgeError::Refused {
            doing: "keeping the profile",
            text: error.to_string(),
            repeats: true,
        })?;
        let request = Request::KeepProfile { profile: kept };
        self.link
            .tell(
                "keeping the profile",
                &request,
                SWITCH_TIMEOUT,
                &Answer::ProfileKept,
            )
            .await?;
        self.profile = KnownProfile::Current(Box::new(profile));
        Ok(())
    }

    /// Adds to the profile how long a recorded scenario took, for later estimates. Without a profile of this simulator this has no effect.
    ///
    /// # Errors
    /// The plugin cannot store it.
    pub async fn keep_pace(&mut self, recorded: &RecordedPace) -> Result<(), BridgeError> {
        let KnownProfile::Current(profile) = &self.profile else {
            return Ok(());
        };
        let before = profile.pace.found().copied();
        let pace = Pace {
            measured_by: PacedBy::Generate,
            size: recorded.size,
            in_blocks: recorded.in_blocks,
            settle_frames: self.frames_to_settle(),
            pictures_per_s: recorded.pictures_per_s,
            loading_s: recorded
                .loading
                .map(|took| took.as_secs_f64())
                .or(before.and_then(|pace| pace.loading_s)),
            weather_s: Some(recorded.weather.as_secs_f64()),
        };
        let profile = Profile {
            pace: Finding::Found(pace),
            ..profile.as_ref().clone()
        };
        self.keep_profile(profile).await
    }

    /// Uses an earlier connection's findings about the same simulator, unless the plugin has more.
    pub fn use_profile(&mut self, known: KnownProfile) {
        if self.profile.current().is_none() {
            self.profile = known;
        }
    }

    /// Lets everything run again, time as well, and stays connected.
    pub(super) async fn go_on(&mut self) -> Result<(), BridgeError> {
        self.let_go().await?;
        self.resume().await
    }

    /// Lets everything run again, and stays connected.
    pub(super) async fn let_go(&mut self) -> Result<(), BridgeError> {
        let (request, expected) = (&Request::Release, &Answer::Released);
        self.link
            .tell("releasing", request, SWITCH_TIMEOUT, expected)
            .await
    }
}
