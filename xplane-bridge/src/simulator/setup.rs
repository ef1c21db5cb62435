//! Client requests during setup: the ground's height, and the check pattern.

use super::{SWITCH_TIMEOUT, Simulator, wrong};
use crate::error::BridgeError;
use crate::link::{Answer, Request};
use futures_util::future::BoxFuture;

impl Simulator {
    /// Height of the ground that the simulator shows at a place, above mean sea level, metres. Airport data can be tens of metres
    /// off.
    ///
    /// # Errors
    /// The simulator has no ground there, or the link is broken.
    pub fn probe_terrain(
        &mut self,
        latitude_deg: f64,
        longitude_deg: f64,
    ) -> BoxFuture<'_, Result<f64, BridgeError>> {
        Box::pin(async move {
            let request = Request::ProbeTerrain {
                latitude_deg,
                longitude_deg,
            };
            match self
                .link
                .ask("probing terrain", &request, SWITCH_TIMEOUT)
                .await?
            {
                Answer::Terrain { elevation_msl_m } => Ok(elevation_msl_m),
                other => Err(wrong("terrain", &other)),
            }
        })
    }

    /// Draws the check pattern with a code over the simulator's window, or removes it. Returns the number of the first frame that
    /// shows it so. While it is shown, captures are rejected.
    ///
    /// # Errors
    /// The simulator cannot draw it, or the link is broken.
    pub fn check_pattern(&mut self, code: Option<u32>) -> BoxFuture<'_, Result<u64, BridgeError>> {
        Box::pin(self.link.check_pattern(code, false))
    }
}
