//! The check pattern, for whoever looks at the window himself.

use super::Simulator;
use crate::error::BridgeError;
use futures_util::future::BoxFuture;

impl Simulator {
    /// Draws the check pattern with a code over the simulator's window, or removes it. Returns the number of the first frame that
    /// shows it so. While it is shown, captures are rejected.
    ///
    /// # Errors
    /// The simulator cannot draw it, or the link is broken.
    pub fn check_pattern(&mut self, code: Option<u32>) -> BoxFuture<'_, Result<u64, BridgeError>> {
        Box::pin(self.link.check_pattern(code, false))
    }
}
