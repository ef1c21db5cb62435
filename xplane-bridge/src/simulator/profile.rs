//! What was measured of this simulator: kept by its plugin, watched by it where only it can.

use super::{SWITCH_TIMEOUT, Simulator, wrong};
use crate::error::BridgeError;
use crate::link::{Answer, Request};
use crate::profile::{CallbackOrders, KnownProfile, Profile};

impl Simulator {
    /// Has the plugin keep a profile; from now on it is used here, too.
    ///
    /// # Errors
    /// If the plugin cannot keep it.
    pub async fn keep_profile(&mut self, profile: Profile) -> Result<(), BridgeError> {
        let kept = serde_json::to_value(&profile).map_err(|error| BridgeError::Refused {
            doing: "keeping the profile",
            text: error.to_string(),
        })?;
        let request = Request::KeepProfile { profile: kept };
        match self
            .link
            .ask("keeping the profile", &request, SWITCH_TIMEOUT)
            .await?
        {
            Answer::ProfileKept => {
                self.description.profile = KnownProfile::Current(Box::new(profile));
                Ok(())
            }
            other => Err(wrong("profile_kept", &other)),
        }
    }

    /// Uses what an earlier connection to the same simulator found out for itself, unless the plugin keeps more.
    pub fn use_profile(&mut self, known: KnownProfile) {
        if self.description.profile.current().is_none() {
            self.description.profile = known;
        }
    }

    /// In what order the plugin is called back in the next frames. Only behind a capture.
    ///
    /// # Errors
    /// If nobody is called back: a simulator that serves its link without a plugin.
    pub async fn watch_callbacks(&mut self, frames: u32) -> Result<CallbackOrders, BridgeError> {
        let request = Request::WatchCallbacks { frames };
        match self
            .link
            .ask("watching callbacks", &request, SWITCH_TIMEOUT)
            .await?
        {
            Answer::Callbacks(orders) => Ok(orders),
            other => Err(wrong("callbacks", &other)),
        }
    }

    /// Lets everything run again, and stays.
    pub(super) async fn let_go(&mut self) -> Result<(), BridgeError> {
        match self
            .link
            .ask("releasing", &Request::Release, SWITCH_TIMEOUT)
            .await?
        {
            Answer::Released => Ok(()),
            other => Err(wrong("released", &other)),
        }
    }
}
